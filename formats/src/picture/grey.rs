//! One band as a linear 16-bit grey PNG or TIFF: sample = round(65535 · exposure · value), clipped to 0..65535.
//!
//! In a PNG a gAMA chunk of 1 marks the samples as linear. A comment holds band and exposure: value = sample / 65535 / exposure.
//! Rows are written as they are read, so memory never holds the picture. An exposure that is measured takes a separate pass
//! over the source.

use std::path::Path;

use tiff::encoder::colortype::Gray16;

use super::area::{Grid, stream};
use super::exposure::Exposure;
use super::file::{Samples, png_file, tiff_file};
use super::streamed::ColourFile;
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
    file: ColourFile,
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
    let mut rows = |put: &mut (dyn FnMut(&[u16]) -> Result<(), PictureError> + Send)| {
        let mut row = Vec::with_capacity(grid.out.width);
        stream(source, &[band], &grid, threads, &progress, &mut |_, y, means| {
            row.clear();
            missing_pixels += means.iter().filter(|v| v.is_nan()).count() as u64;
            row.extend(means.iter().enumerate().map(|(x, &v)| sample(v, exposure, y, x)));
            put(&row)
        })
    };
    let (file, missing_samples) = match file {
        ColourFile::Png => png_file(path, grid.out, Samples::LinearGrey16, &comment, |out| {
            rows(&mut |row| {
                let bytes: Vec<u8> = row.iter().flat_map(|v| v.to_be_bytes()).collect();
                out.write_all(&bytes).map_err(|source| PictureError::Write { path: path.to_owned(), source })
            })
        }),
        ColourFile::Tiff => tiff_file::<Gray16, _>(path, grid.out, &comment, |out| rows(&mut |row| out(row))),
    }?;
    file.finish()?;
    Ok(PictureSummary { size: grid.out, exposure, missing_samples, missing_pixels })
}

fn sample(value: f32, exposure: f64, y: usize, x: usize) -> u16 {
    // `as` clips. Squaring is near enough to sRGB decoding for the chequer.
    let displayed = if value.is_nan() { chequer(y, x).powi(2) } else { f64::from(value) * exposure };
    (65535.0 * displayed).round() as u16
}
