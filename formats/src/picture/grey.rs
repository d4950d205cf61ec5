//! One band as a linear 16-bit grey PNG: sample = round(65535 · exposure · value), clipped to 0..65535.
//!
//! A gAMA chunk of 1 marks the samples as linear, and a comment holds band and exposure: value = sample / 65535 / exposure.
//! Rows are written as they are read, so memory never holds the picture. An exposure that is measured takes a separate pass
//! over the source.

use std::path::Path;

use super::area::{Grid, stream};
use super::exposure::Exposure;
use super::file::{Samples, png_file};
use super::tone::chequer;
use super::{ChartSource, PictureError, PictureSummary, Progress, View, nearest_band};

/// Settings of a grey picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GreyOptions {
    /// Region, size, threads.
    pub view: View,
    /// Value that shows as white.
    pub exposure: Exposure,
}

/// Writes the band nearest to `wavelength_nm`.
///
/// # Errors
/// If there is no band within [`BAND_TOLERANCE_NM`](super::BAND_TOLERANCE_NM), the source cannot be read, a setting
/// is invalid or the file cannot be written.
pub fn write_grey(
    path: &Path,
    source: &dyn ChartSource,
    bands_nm: &[f64],
    wavelength_nm: f64,
    options: &GreyOptions,
    progress: Progress<'_>,
) -> Result<PictureSummary, PictureError> {
    options.exposure.check()?;
    let band = nearest_band(bands_nm, wavelength_nm)?;
    let grid = Grid::new(source.size(), &options.view)?;
    let threads = options.view.threads;
    let exposure = options.exposure.measure(progress, |levels, progress| {
        stream(source, &[band], &grid, threads, progress, &mut |_, _, means| {
            means.iter().for_each(|&v| levels.add(v));
            Ok(())
        })
    })?;
    let progress = options.exposure.progress_after_measuring(progress);
    let comment = format!("lenscube band {} nm, linear, value = sample / 65535 / {exposure}", bands_nm[band]);
    let mut missing_pixels = 0;
    let (file, missing_samples) = png_file(path, grid.out, Samples::LinearGrey16, &comment, |out| {
        let mut bytes = Vec::with_capacity(2 * grid.out.width);
        stream(source, &[band], &grid, threads, &progress, &mut |_, y, means| {
            bytes.clear();
            for (x, &v) in means.iter().enumerate() {
                missing_pixels += u64::from(v.is_nan());
                bytes.extend(sample(v, exposure, y, x).to_be_bytes());
            }
            out.write_all(&bytes).map_err(|source| PictureError::Write { path: path.to_owned(), source })
        })
    })?;
    file.finish()?;
    Ok(PictureSummary { size: grid.out, exposure, missing_samples, missing_pixels })
}

fn sample(value: f32, exposure: f64, y: usize, x: usize) -> u16 {
    // `as` clips. Squaring is near enough to sRGB decoding for the chequer.
    let displayed = if value.is_nan() { chequer(y, x).powi(2) } else { f64::from(value) * exposure };
    (65535.0 * displayed).round() as u16
}
