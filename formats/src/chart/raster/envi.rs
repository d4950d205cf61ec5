//! ENVI headers: text, `ENVI` in the first line, then `key = value` with lists in braces over any number of lines
//! (NV5 Geospatial, "ENVI Header Files").
//!
//! Required: `samples` (columns), `lines` (rows), `bands`, `data type`, `interleave`. Optional: `header offset` (0), `byte order` (0:
//! little-endian), `wavelength` with `wavelength units` (nanometers or micrometers), and the conversion of samples to values:
//!
//! | key | meaning |
//! |---|---|
//! | `data ignore value` | samples that stand for no data, compared before scaling |
//! | `data gain values`, `data offset values` | value = sample · gain + offset, one of each per band |
//! | `reflectance scale factor` | reflectance = sample / factor |
//!
//! `major frame offsets`, `minor frame offsets` and `file compression` other than 0 are errors.
//! Gains together with a factor are an error: their order is not defined.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::layout::{Interleave, RasterLayout};
use crate::chart::values::Values;
use crate::npy::HeaderError;
use crate::sample::{RasterSample, Sample};

/// A parsed header.
#[derive(Debug)]
pub(super) struct Envi {
    pub(super) layout: RasterLayout,
    pub(super) wavelengths_nm: Option<Vec<f64>>,
    pub(super) values: Values,
    /// Remarks for the user, one line each.
    pub(super) notes: Vec<String>,
}

/// Extensions of data files.
const DATA_EXTENSIONS: [&str; 7] = ["img", "dat", "raw", "bsq", "bil", "bip", "bin"];

/// The header beside a data file: `cube.hdr` or `cube.img.hdr` for `cube.img`.
pub(super) fn header_of(data: &Path) -> Option<PathBuf> {
    let mut longer = data.as_os_str().to_owned();
    longer.push(".hdr");
    [data.with_extension("hdr"), PathBuf::from(longer)].into_iter().find(|p| p != data && p.is_file())
}

/// The data file beside a header.
pub(super) fn data_of(header: &Path) -> Option<PathBuf> {
    let bare = header.with_extension("");
    let others = DATA_EXTENSIONS.iter().map(|e| header.with_extension(e));
    std::iter::once(bare).chain(others).find(|p| p.is_file())
}

/// Parses the text of a header.
pub(super) fn parse(text: &str) -> Result<Envi, HeaderError> {
    let mut lines = text.lines();
    if lines.next().map(str::trim) != Some("ENVI") {
        return Err(("first line", "ENVI".into(), "something else".into()));
    }
    let mut keys = HashMap::new();
    while let Some(line) = lines.next() {
        let Some((key, value)) = line.split_once('=') else { continue };
        let mut value = value.trim().to_owned();
        if value.starts_with('{') {
            while !value.contains('}') {
                let Some(more) = lines.next() else { break };
                value.push(' ');
                value.push_str(more.trim());
            }
        }
        keys.insert(key.trim().to_ascii_lowercase(), value);
    }
    let short = |t: &str| t.chars().take(40).collect::<String>();
    let integer = |key: &'static str, default: Option<u64>| match (keys.get(key), default) {
        (None, Some(n)) => Ok(n),
        (None, None) => Err((key, "an integer".to_owned(), "nothing".to_owned())),
        (Some(t), _) => {
            t.parse::<u64>().map_err(|_| (key, "an integer".to_owned(), format!("`{}`", short(t))))
        }
    };
    let side = |key| integer(key, None).map(|n| usize::try_from(n).unwrap_or(usize::MAX));
    let shape = [side("bands")?, side("lines")?, side("samples")?];
    let sample = match integer("data type", None)? {
        1 => RasterSample::Plain(Sample::U8),
        2 => RasterSample::I16,
        4 => RasterSample::Plain(Sample::F32),
        5 => RasterSample::Plain(Sample::F64),
        12 => RasterSample::Plain(Sample::U16),
        other => {
            let expected = "1 (u8), 2 (i16), 4 (f32), 5 (f64) or 12 (u16)";
            return Err(("data type", expected.into(), other.to_string()));
        }
    };
    let interleave = match keys.get("interleave").map(|t| t.to_ascii_lowercase()).as_deref() {
        Some("bsq") => Interleave::Bsq,
        Some("bil") => Interleave::Bil,
        Some("bip") => Interleave::Bip,
        other => {
            return Err((
                "interleave",
                "bsq, bil or bip".into(),
                format!("`{}`", short(other.unwrap_or(""))),
            ));
        }
    };
    let little_endian = match integer("byte order", Some(0))? {
        0 => true,
        1 => false,
        other => return Err(("byte order", "0 or 1".into(), other.to_string())),
    };
    check_stored_as_is(&keys)?;
    let mut values = Values::default();
    if let Some(t) = keys.get("data ignore value") {
        let ignore =
            t.trim().parse::<f64>().map_err(|_| ("data ignore value", "a number".to_owned(), short(t)))?;
        // NaN is no data in any case.
        values.no_data.extend(Some(sample.nearest(ignore)).filter(|v| v.is_finite()));
    }
    let mut notes = Vec::new();
    values.scaling = scaling(&keys, shape[0], &mut notes)?;
    let layout =
        RasterLayout { shape, interleave, sample, little_endian, offset: integer("header offset", Some(0))? };
    let wavelengths_nm = match keys.get("wavelength") {
        None => None,
        Some(list) => wavelengths(list, keys.get("wavelength units").map(String::as_str), shape[0])?,
    };
    Ok(Envi { layout, wavelengths_nm, values, notes })
}

/// Fails if samples are compressed, or other bytes lie between those of lines or bands.
fn check_stored_as_is(keys: &HashMap<String, String>) -> Result<(), HeaderError> {
    let expected = [
        ("major frame offsets", "0, without bytes between the frames"),
        ("minor frame offsets", "0, without bytes between the frames"),
        ("file compression", "0; decompress the data file, e.g. by gunzip"),
    ];
    for (key, expected) in expected {
        let Some(text) = keys.get(key) else { continue };
        let is_zero = |n: &str| n.trim().parse::<f64>() == Ok(0.0);
        let list = text.trim().trim_start_matches('{').trim_end_matches('}');
        if !list.split(',').all(is_zero) {
            let found = text.chars().take(40).collect();
            return Err((
                key,
                format!("{expected}; or let `gdal_translate -of ENVI IN OUT` rewrite it"),
                found,
            ));
        }
    }
    Ok(())
}

/// (gain, offset) of each band, or one pair for all; empty if samples are values.
fn scaling(
    keys: &HashMap<String, String>,
    bands: usize,
    notes: &mut Vec<String>,
) -> Result<Vec<(f64, f64)>, HeaderError> {
    let list = |key: &'static str| match keys.get(key) {
        None => Ok(None),
        Some(text) => match numbers(text) {
            Some(list) if list.len() == bands && list.iter().all(|v| v.is_finite()) => Ok(Some(list)),
            Some(list) => {
                Err((key, format!("{bands} finite numbers, one per band"), format!("{} numbers", list.len())))
            }
            None => Err((key, "numbers in braces".to_owned(), "something else".to_owned())),
        },
    };
    let (gains, offsets) = (list("data gain values")?, list("data offset values")?);
    if gains.as_ref().is_some_and(|g| g.contains(&0.0)) {
        return Err(("data gain values", "numbers other than 0".into(), "0".into()));
    }
    let scaling: Vec<_> = match (gains, offsets) {
        (None, None) => Vec::new(),
        (Some(gains), None) => gains.into_iter().map(|gain| (gain, 0.0)).collect(),
        (None, Some(offsets)) => offsets.into_iter().map(|offset| (1.0, offset)).collect(),
        (Some(gains), Some(offsets)) => gains.into_iter().zip(offsets).collect(),
    };
    let scaled = scaling.iter().any(|s| *s != (1.0, 0.0));
    let key = "reflectance scale factor";
    let factor = match keys.get(key) {
        None => 1.0,
        Some(text) => {
            let factor = text.trim().parse::<f64>().ok().filter(|f| f.is_finite() && *f > 0.0);
            let invalid = || (key, "a positive number".to_owned(), text.chars().take(40).collect());
            factor.ok_or_else(invalid)?
        }
    };
    match (scaled, factor == 1.0) {
        (true, false) => {
            let expected =
                "either it or data gain and offset values; remove from the header what does not apply";
            Err((key, expected.into(), "both".into()))
        }
        (true, true) => {
            notes.push(
                "the ENVI header's data gain and offset values are applied: value = sample · gain + offset"
                    .into(),
            );
            Ok(scaling)
        }
        (false, true) => Ok(Vec::new()),
        (false, false) => {
            notes.push(format!(
                "the ENVI header's reflectance scale factor is applied: value = sample / {factor}"
            ));
            Ok(vec![(1.0 / factor, 0.0)])
        }
    }
}

/// The numbers of a list in braces.
fn numbers(list: &str) -> Option<Vec<f64>> {
    let inner = list.trim().strip_prefix('{')?.split('}').next()?;
    inner.split(',').map(str::trim).filter(|n| !n.is_empty()).map(|n| n.parse().ok()).collect()
}

/// The list `{400.0, 410.0}` in nm; `None` without a unit of length: the unit of 0.55 or 550 is not guessed.
fn wavelengths(list: &str, units: Option<&str>, bands: usize) -> Result<Option<Vec<f64>>, HeaderError> {
    let per_unit = match units.map(|u| u.trim().to_ascii_lowercase()).as_deref() {
        Some("nanometers" | "nanometres" | "nm") => 1.0,
        Some("micrometers" | "micrometres" | "um" | "µm" | "microns") => 1e3,
        _ => return Ok(None),
    };
    let inner = list.trim().trim_start_matches('{').split('}').next().unwrap_or("");
    let numbers: Option<Vec<f64>> = inner
        .split(',')
        .map(str::trim)
        .filter(|w| !w.is_empty())
        .map(|w| w.parse::<f64>().ok().map(|v| v * per_unit).filter(|v| *v > 0.0 && v.is_finite()))
        .collect();
    match numbers {
        // 0.55 µm is 550 nm, not 550.0000000000001.
        Some(nm) if nm.len() == bands => Ok(Some(nm.iter().map(|v| (v * 1e6).round() / 1e6).collect())),
        Some(nm) => Err(("wavelength", format!("{bands} numbers, one per band"), nm.len().to_string())),
        None => Err(("wavelength", "positive numbers in braces".into(), "something else".into())),
    }
}
