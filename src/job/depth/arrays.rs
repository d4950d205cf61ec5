//! Arrays of distances and coverages: one number per chart pixel, from the formats of charts, a channel of OpenEXR, or raw samples.

use super::scan;
use crate::failure::usage;
use crate::open::{self, Chart, ChartFlags};
use anyhow::{Context, Result};
use formats::chart::{ChartError, NanPolicy, exr, lacks_array, split_array};
use formats::durable::{is_url, link_target, parent_of};
use pipeline::geometry::Frame;
use std::path::{Path, PathBuf};

/// Whether a store has no array of the requested name.
pub fn is_missing(error: &anyhow::Error) -> bool {
    error.downcast_ref().is_some_and(|e| matches!(e, ChartError::NoArray { .. }))
}

/// Where arrays are decoded to: beside the film `film`.
pub fn temporary_directory(film: &Path) -> PathBuf {
    match is_url(film) {
        true => std::env::temp_dir(),
        false => parent_of(&link_target(film)).to_path_buf(),
    }
}

/// Opens an array of one number per chart pixel; `dtype`: of raw samples of this type.
pub fn array(spec: &str, frame: &Frame, name: &str, dtype: Option<&str>) -> Result<Chart> {
    let shape = format!("1,{},{}", frame.chart.height, frame.chart.width);
    let chart = open(spec, name, dtype.map(|dtype| (&*shape, dtype)))?;
    check_size(&chart, frame, spec, name)?;
    Ok(chart)
}

/// Opens an array of one number per pixel, of any size; `raw`: shape and type of raw samples.
pub fn open(spec: &str, name: &str, raw: Option<(&str, &str)>) -> Result<Chart> {
    // A drawn array has one band, whose wavelength has no meaning.
    let wavelengths = spec.starts_with("gen:").then_some("550");
    let flags = ChartFlags { nan: NanPolicy::Keep, wavelengths, raw, ..ChartFlags::default() };
    let mut chart = match exr::is_supported_path(Path::new(split_array(spec).0)) {
        true => open_exr(spec, NanPolicy::Keep),
        false => open::chart_with(spec, &flags),
    }
    .with_context(|| name.to_owned())?;
    // Renderers write large numbers for infinity.
    chart.limit_values(f32::MAX)?;
    let bands = chart.bands();
    if bands != 1 {
        return Err(usage(format!("{name}: the array has {bands} bands, expected rows and columns only")));
    }
    Ok(chart)
}

/// The channel that `FILE.exr//CHANNEL` names, else `Z` or `depth.Z`.
fn open_exr(spec: &str, nan: NanPolicy) -> Result<Chart> {
    let (file, channel) = split_array(spec);
    let names = if channel.is_empty() { &["Z", "depth.Z"][..] } else { &[channel][..] };
    Ok(Chart::Decoded(Box::new(exr::open_channel(Path::new(file), names, nan)?)))
}

pub fn check_size(chart: &Chart, frame: &Frame, spec: &str, name: &str) -> Result<()> {
    let (found, expected) = (chart.size(), frame.chart);
    let of = if name.ends_with(spec) { name.to_owned() } else { format!("{name}: {spec}") };
    match found == expected {
        true => Ok(()),
        false => Err(usage(format!(
            "{of}: {found} px, the chart has {expected}: arrays of surfaces are not resampled"
        ))),
    }
}

/// The coverage `spec`, if there is one.
pub fn coverage(spec: &str, frame: &Frame) -> Result<Option<Chart>> {
    if lacks_array(spec)? {
        return Ok(None);
    }
    match array(spec, frame, spec, None) {
        Ok(chart) => Ok(Some(chart)),
        Err(e) if is_missing(&e) => Ok(None),
        Err(e) => Err(e),
    }
}

/// Decodes the only band of an array that is not read where it is, into `directory`.
pub fn decode(chart: &Chart, directory: &Path, threads: usize) -> Result<()> {
    match chart {
        Chart::Decoded(decoded) => Ok(decoded.copy_bands(&[0], directory, threads, &|_, _| ())?),
        Chart::Store(_) | Chart::Raster(_) | Chart::Generated(_) | Chart::Scene(_) | Chart::Array(_) => {
            Ok(())
        }
    }
}

/// Fails if the chart `spec` has an alpha channel below 1: its colours are premultiplied, which `way_out` mends.
///
/// # Errors
/// Usage: a pixel that is not opaque. The file cannot be read.
pub fn check_opaque(spec: &str, way_out: &str, directory: &Path, threads: usize) -> Result<()> {
    let path = Path::new(spec);
    if !exr::is_supported_path(path) || !exr::open(path, NanPolicy::Keep)?.has_alpha {
        return Ok(());
    }
    let alpha = Chart::Decoded(Box::new(exr::open_channel(path, &["A"], NanPolicy::Keep)?));
    decode(&alpha, directory, threads)?;
    scan::for_each_row(&[Some(alpha.source())], scan::MIN_ROWS, |y, [values]| {
        match values.iter().position(|a| !matches!(a, 1.0..)) {
            None => Ok(()),
            Some(x) => Err(usage(format!(
                "chart {spec}: alpha at row {y}, column {x} is {}, so its colours are premultiplied, {way_out}",
                values[x]
            ))),
        }
    })
}
