//! Charts in OpenEXR files: channels of the spectral layout, or R, G, B (or Y) as an image.
//!
//! Spectral layout (Fichet, Pacanowski, Wilkie, JCGT 10(3), 2021): `S0.400,000000nm` (emissive) or `T.400,000000nm`
//! (reflective), or all channels named as `w400nm`; wavelengths in nm, µm or m, with a decimal comma or point. R, G, B (a preview) and S1
//! to S3 (polarisation) beside them are ignored. One layer, f16 or f32, scan lines or tiles, every compression of the `exr` crate.
//!
//! Samples are compressed and bands interleave line by line, so the file is decoded once ([`DecodedChart`]). Sizes that a header
//! declares are compared with the file's length and with a limit per block before memory is allocated; a decoder that panics is an
//! error of the file. [`open_channel`] reads one channel of any name. Not supported: several layers, deep data, subsampled channels, bispectral images.

mod decode;
mod header;

use std::fs::File;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use ::exr::meta::MetaData;
use ::exr::meta::attribute::{AttributeValue, SampleType};
use pipeline::geometry::Size;
use serde_json::json;

use super::decoded_chart::{Declared, DecodedChart};
use super::error::ChartError;
use super::file_change::{WatchedFile, modified_json};
use super::options::NanPolicy;
use super::values::Values;
use crate::durable::DurableError;
use crate::sample::{RasterSample, Sample};
use decode::Blocks;
pub use header::ExrContent;
use header::{alpha_of, check_header, content, exr_error, named_channel, notes};

/// An OpenEXR file whose header has been read.
#[derive(Debug)]
pub struct ExrFile {
    /// Its bands.
    pub chart: DecodedChart,
    /// Content of the channels.
    pub content: ExrContent,
    /// Whether there is an alpha channel.
    pub has_alpha: bool,
    /// The alpha channel of the channels that are read.
    pub alpha: Option<String>,
}

/// Whether `path` is a file with the extension `exr`.
pub fn is_supported_path(path: &Path) -> bool {
    path.is_file() && path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"))
}

/// Reads the header of the OpenEXR file `path`.
///
/// # Errors
/// [`ChartError`] if it is not an OpenEXR file, or its header is invalid or not supported.
pub fn open(path: &Path, nan: NanPolicy) -> Result<ExrFile, ChartError> {
    open_bands(path, &[], nan)
}

/// Reads the header of the OpenEXR file `path`; its only band is the first channel with one of `names`.
///
/// # Errors
/// As [`open`]; there is no such channel.
pub fn open_channel(path: &Path, names: &[&str], nan: NanPolicy) -> Result<DecodedChart, ChartError> {
    let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
    Ok(open_bands(path, &names, nan)?.chart)
}

fn open_bands(path: &Path, wanted: &[String], nan: NanPolicy) -> Result<ExrFile, ChartError> {
    let file = File::open(path).map_err(|e| DurableError::io("open", path, 0, e))?;
    let meta = file.metadata().map_err(|e| DurableError::io("look up", path, 0, e))?;
    let read = || MetaData::read_from_unbuffered(file, false);
    let headers = match catch_unwind(AssertUnwindSafe(read)) {
        Ok(Ok(read)) => read.headers,
        Ok(Err(::exr::error::Error::Io(e))) if e.raw_os_error().is_some() => {
            return Err(DurableError::io("read", path, 0, e).into());
        }
        Ok(Err(e)) => return Err(exr_error(path, "file", "an OpenEXR image", e.to_string())),
        Err(_) => return Err(exr_error(path, "header", "valid attributes", "invalid ones".into())),
    };
    let [header] = &headers[..] else {
        let expected = "one; save the file with a single layer";
        return Err(exr_error(path, "layers", expected, headers.len().to_string()));
    };
    let block_bytes = check_header(path, header, meta.len())?;
    let (content, channels) = match wanted {
        [] => content(path, header)?,
        wanted => (ExrContent::Grey, vec![named_channel(path, header, wanted)?]),
    };
    let first = channels.first().copied();
    let text = |name: &str| match header.own_attributes.other.iter().find(|(k, _)| *k == name) {
        Some((_, AttributeValue::Text(t))) => Some(t.to_string()),
        _ => None,
    };
    let size = Size::new(header.layer_size.height(), header.layer_size.width());
    let channel = |&c: &usize| {
        let channel = &header.channels.list[c];
        let sample = match channel.sample_type {
            SampleType::F16 => "f16",
            SampleType::F32 => "f32",
            SampleType::U32 => "u32",
        };
        json!({ "name": channel.name.to_string(), "sample": sample })
    };
    let description = json!({
        "size": [size.height, size.width],
        "channels": channels.iter().map(channel).collect::<Vec<_>>(),
        "compression": header.compression.to_string(),
    });
    let declared = Declared {
        path: path.into(),
        size,
        bands: channels.len(),
        sample: RasterSample::Plain(Sample::F32),
        wavelengths_nm: match &content {
            ExrContent::Spectral { wavelengths_nm, .. } => Some(wavelengths_nm.clone()),
            _ => None,
        },
        values: Values::default(),
        units: text("emissiveUnits").filter(|u| u != "unknown"),
        array: None,
        notes: notes(header, &content),
        content: json!({ "exr": description, "bytes": meta.len() }),
        mtimes: modified_json(&meta),
        files: vec![WatchedFile::data(path, &meta)],
        nan,
    };
    let blocks = Blocks { path: path.into(), size, channels, wanted: wanted.to_vec(), block_bytes };
    let alpha = first.and_then(|channel| alpha_of(header, channel));
    Ok(ExrFile {
        chart: DecodedChart::new(declared, Box::new(blocks))?,
        content,
        has_alpha: header.channels.list.iter().any(|c| c.name == *"A"),
        alpha,
    })
}

#[cfg(test)]
mod tests;
