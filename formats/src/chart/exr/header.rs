//! OpenEXR headers: limits, and the bands among the channels.

use std::path::Path;

use ::exr::meta::BlockDescription;
use ::exr::meta::attribute::SampleType;
use ::exr::meta::header::Header;

use crate::chart::error::ChartError;
use crate::chart::header::header_error;
use crate::image::header::primaries_note;

/// Maximum size in bytes of a decoded block. Each thread holds one, and the `exr` crate allocates as much memory for the compressed
/// bytes of a block as its header declares, up to the size of a complete tile, before it reads them.
const MAX_BLOCK_BYTES: usize = 192 << 20;
const MAX_CHANNELS: usize = 4096;

/// Content of the channels.
#[derive(Clone, Debug, PartialEq)]
pub enum ExrContent {
    /// Bands of an emissive spectrum, or of reflectance.
    Spectral {
        /// Wavelength of each band, ascending.
        wavelengths_nm: Vec<f64>,
        /// Whether the values are reflectance.
        reflective: bool,
    },
    /// Red, green, blue.
    Rgb,
    /// One grey channel.
    Grey,
}

/// [`header_error`] with a bounded length of `found`.
pub(super) fn exr_error(path: &Path, what: &'static str, expected: &str, found: String) -> ChartError {
    header_error(path, what, expected, found.chars().take(200).collect::<String>())
}

/// Checks a header of a file of `length` bytes before memory is allocated for it; returns the size of the largest decoded block.
pub(super) fn check_header(path: &Path, header: &Header, length: u64) -> Result<usize, ChartError> {
    let (width, height) = (header.layer_size.width(), header.layer_size.height());
    let channels = &header.channels.list;
    if header.deep {
        let expected = "flat pixels; flatten it, e.g. to one file for each of its surfaces";
        return Err(exr_error(path, "data", expected, "deep data".into()));
    }
    if width == 0 || height == 0 || channels.is_empty() || channels.len() > MAX_CHANNELS {
        let found = format!("{} channels of {width}x{height} px", channels.len());
        return Err(exr_error(path, "size", "at least one pixel and 1 to 4096 channels", found));
    }
    if let Some(c) = channels.iter().find(|c| c.sampling != ::exr::prelude::Vec2(1, 1)) {
        return Err(exr_error(
            path,
            "channels",
            "one sample per pixel",
            format!("`{}` is subsampled", c.name),
        ));
    }
    let (columns, rows) = match header.blocks {
        BlockDescription::ScanLines => (width, header.compression.scan_lines_per_block().min(height)),
        // Not clipped to the image: see MAX_BLOCK_BYTES.
        BlockDescription::Tiles(t) => (t.tile_size.width(), t.tile_size.height()),
    };
    let pixel_bytes = header.channels.bytes_per_pixel;
    let block_bytes = columns.checked_mul(rows).and_then(|n| n.checked_mul(pixel_bytes));
    if block_bytes.is_none_or(|n| n > MAX_BLOCK_BYTES) {
        let found = format!("{columns}x{rows} px of {pixel_bytes} bytes");
        return Err(exr_error(path, "block size", "at most 192 MiB; save it in smaller tiles", found));
    }
    // The file holds an offset of eight bytes for each block.
    if header.chunk_count as u64 > length / 8 {
        return Err(ChartError::Short {
            path: path.into(),
            expected: (header.chunk_count as u64).saturating_mul(8),
            found: length,
        });
    }
    Ok(columns.min(width) * rows.min(height) * pixel_bytes)
}

/// The content of a file, and the channel of each band.
pub(super) fn content(path: &Path, header: &Header) -> Result<(ExrContent, Vec<usize>), ChartError> {
    let list = &header.channels.list;
    let names: Vec<String> = list.iter().map(|c| c.name.to_string()).collect();
    let bands = |prefix: &str| -> Result<Vec<(f64, usize)>, ChartError> {
        let named = names.iter().enumerate().filter_map(|(i, n)| Some((i, n.strip_prefix(prefix)?)));
        let mut found: Vec<(f64, usize)> = named
            .map(|(i, length)| {
                let nm = parse_wavelength(length).ok_or_else(|| {
                    exr_error(path, "channel", "a wavelength such as S0.400,0nm", format!("`{}`", names[i]))
                })?;
                Ok((nm, i))
            })
            .collect::<Result<_, ChartError>>()?;
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(found)
    };
    let (mut emissive, reflective) = (bands("S0.")?, bands("T.")?);
    if emissive.is_empty() && reflective.is_empty() {
        emissive = plain_bands(&names);
    }
    let layer = if emissive.is_empty() && reflective.is_empty() { colour_layer(path, &names)? } else { "" };
    let channel = |name: &str| channel_of(&names, layer, name);
    let (content, channels) = match (emissive.is_empty(), reflective.is_empty()) {
        (false, false) => {
            return Err(exr_error(path, "channels", "S0 or T", "both of them".into()));
        }
        (true, true) => match (channel("R"), channel("G"), channel("B"), channel("Y")) {
            (Some(r), Some(g), Some(b), _) => (ExrContent::Rgb, vec![r, g, b]),
            (None, None, None, Some(y)) => (ExrContent::Grey, vec![y]),
            _ => {
                let expected = "S0.…nm or T.…nm (spectral), …nm (all channels), R, G and B, or Y";
                return Err(exr_error(path, "channels", expected, names.join(", ")));
            }
        },
        (is_reflective, _) => {
            let found = if is_reflective { &reflective } else { &emissive };
            let wavelengths_nm = found.iter().map(|f| f.0).collect();
            (
                ExrContent::Spectral { wavelengths_nm, reflective: is_reflective },
                found.iter().map(|f| f.1).collect(),
            )
        }
    };
    if let Some(&i) = channels.iter().find(|&&i| list[i].sample_type == SampleType::U32) {
        return Err(exr_error(path, "samples", "half or float", format!("`{}` of integers", names[i])));
    }
    Ok((content, channels))
}

/// Index of channel `name` of a layer; the layer of channels without a prefix is empty.
fn channel_of(names: &[String], layer: &str, name: &str) -> Option<usize> {
    let is = |full: &String| match layer {
        "" => full == name,
        layer => full.strip_prefix(layer).and_then(|rest| rest.strip_prefix('.')) == Some(name),
    };
    names.iter().position(is)
}

/// The layer whose colours are read, as renderers name channels (`ViewLayer.Combined.R`): the channels without a prefix if there are colours among them,
/// else the only layer with R, G and B, or the only one of several that is named `Combined`. Empty if none has them.
///
/// # Errors
/// Several layers with colours.
fn colour_layer<'n>(path: &Path, names: &'n [String]) -> Result<&'n str, ChartError> {
    if ["R", "G", "B", "Y"].iter().any(|name| channel_of(names, "", name).is_some()) {
        return Ok("");
    }
    let of_red = names.iter().filter_map(|name| name.strip_suffix(".R"));
    let layers: Vec<&str> =
        of_red.filter(|l| ["G", "B"].iter().all(|c| channel_of(names, l, c).is_some())).collect();
    let combined: Vec<&str> =
        layers.iter().copied().filter(|l| l.rsplit('.').next() == Some("Combined")).collect();
    match (&layers[..], &combined[..]) {
        ([], _) => Ok(""),
        ([one], _) | (_, [one]) => Ok(one),
        (several, _) => {
            let expected =
                "colours of one layer, or of one that is named Combined; save it with that layer alone";
            Err(exr_error(path, "channels", expected, format!("the layers {}", several.join(", "))))
        }
    }
}

/// The alpha channel of the layer of channel `of`.
pub(super) fn alpha_of(header: &Header, of: usize) -> Option<String> {
    let list = &header.channels.list;
    let name = list[of].name.to_string();
    let alpha = name.rsplit_once('.').map_or_else(|| "A".to_owned(), |(layer, _)| format!("{layer}.A"));
    let names = [alpha, "A".to_owned()];
    names.into_iter().find(|name| list.iter().any(|c| c.name == **name))
}

/// Remarks on attributes that are not applied: a data window other than the display window, and other primaries than sRGB's.
pub(super) fn notes(header: &Header, content: &ExrContent) -> Vec<String> {
    let (window, at, size) =
        (header.shared_attributes.display_window, header.own_attributes.layer_position, header.layer_size);
    let mut notes = Vec::new();
    let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
    if let (ExrContent::Rgb, Ok(layer)) = (content, colour_layer(Path::new(""), &names))
        && !layer.is_empty()
    {
        notes.push(format!("the colours of its layer {layer} are read"));
    }
    if (window.position, window.size) != (at, size) {
        notes.push(format!(
            "its data window is read ({}x{} px at row {}, column {}), not its display window ({}x{} px at row {}, column {})",
            size.width(), size.height(), at.y(), at.x(),
            window.size.width(), window.size.height(), window.position.y(), window.position.x()
        ));
    }
    if let (Some(c), ExrContent::Rgb) = (header.shared_attributes.chromaticities, content) {
        notes.extend(primaries_note([c.red, c.green, c.blue, c.white].map(|xy| (xy.x(), xy.y()))));
    }
    notes
}

/// The first channel of `header` with one of `wanted` as its name.
pub(super) fn named_channel(path: &Path, header: &Header, wanted: &[String]) -> Result<usize, ChartError> {
    let list = &header.channels.list;
    let names: Vec<String> = list.iter().map(|c| c.name.to_string()).collect();
    let found = wanted.iter().find_map(|name| names.iter().position(|n| n == name));
    match found {
        Some(i) if list[i].sample_type == SampleType::U32 => {
            Err(exr_error(path, "samples", "half or float", format!("`{}` of integers", names[i])))
        }
        Some(i) => Ok(i),
        None => Err(exr_error(path, "channel", &wanted.join(" or "), names.join(", "))),
    }
}

/// Bands of a file whose channels are all named by a wavelength, such as `w420nm`, ascending; empty otherwise.
fn plain_bands(names: &[String]) -> Vec<(f64, usize)> {
    let band = |(i, name): (usize, &String)| {
        let length = name.trim_start_matches(|c: char| c.is_ascii_alphabetic() || "_-. ".contains(c));
        Some((parse_wavelength(length)?, i))
    };
    let mut found = names.iter().enumerate().map(band).collect::<Option<Vec<_>>>().unwrap_or_default();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found
}

/// The wavelength in nm of `400,000000nm` or `0.4um`.
fn parse_wavelength(text: &str) -> Option<f64> {
    let units = [("nm", 1.0), ("um", 1e3), ("µm", 1e3), ("m", 1e9)];
    let (number, per_unit) = units.iter().find_map(|(unit, nm)| Some((text.strip_suffix(unit)?, nm)))?;
    let nm = number.replace(',', ".").parse::<f64>().ok()? * per_unit;
    // 0.55 µm is 550 nm, not 550.0000000000001.
    Some((nm * 1e6).round() / 1e6).filter(|nm| *nm > 0.0 && nm.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_of_a_layer_are_found() {
        let layer = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(|n| (*n).to_owned()).collect();
            colour_layer(Path::new("a.exr"), &names).map(str::to_owned).map_err(|e| e.to_string())
        };
        let of = |layer: &str| ["R", "G", "B", "A"].map(|c| format!("{layer}.{c}"));
        let combined = of("ViewLayer.Combined");
        assert_eq!(layer(&combined.each_ref().map(String::as_str)).unwrap(), "ViewLayer.Combined");
        let both = [&of("V.Combined")[..], &of("V.Diffuse")[..]].concat();
        let both: Vec<&str> = both.iter().map(String::as_str).collect();
        assert_eq!(layer(&both).unwrap(), "V.Combined");
        assert!(layer(&both.iter().map(|n| n.trim_start_matches("V.Combined")).collect::<Vec<_>>()).is_ok());
        let two = [&of("a")[..], &of("b")[..]].concat();
        let error = layer(&two.iter().map(String::as_str).collect::<Vec<_>>()).unwrap_err();
        assert!(error.contains("the layers a, b"), "{error}");
        assert_eq!(layer(&["R", "G", "B", "x.R", "x.G", "x.B"]).unwrap(), "");
        assert_eq!(layer(&["depth.Z"]).unwrap(), "");
    }

    #[test]
    fn channels_named_by_wavelengths_are_bands() {
        let bands = |names: &[&str]| plain_bands(&names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>());
        assert_eq!(bands(&["w430nm", "w420nm", "0.41um"]), [(410.0, 2), (420.0, 1), (430.0, 0)]);
        assert!(bands(&["w430nm", "mask"]).is_empty() && bands(&["w430"]).is_empty());
    }
}
