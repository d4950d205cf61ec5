//! One band as a 16-bit grey PNG, linear: sample = round(65535 · exposure · value), clipped to 0..65535.
//!
//! A gAMA chunk of 1 tells viewers that the samples are linear, and a comment holds band and exposure, so values can
//! be had back: value = sample / 65535 / exposure. Rows are written as they are read: memory holds strips, never the
//! picture. Where the exposure is to be found, the source is read twice. Missing pixels show as a chequer, like all pictures'.

use std::path::Path;

use super::average::{Grid, stream};
use super::exposure::{Exposure, Levels};
use super::file::{Samples, write_png};
use super::{ChartSource, PictureError, Progress, Shown, View, chequer, nearest_band};

/// How one band is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GreyOptions {
    /// What, how large, by how many threads.
    pub view: View,
    /// What shows as white.
    pub exposure: Exposure,
}

/// Writes the band nearest to `wanted_nm`.
///
/// # Errors
/// If there is no band within [`BAND_TOLERANCE_NM`](super::BAND_TOLERANCE_NM), the source cannot be read, a setting
/// cannot be met or the file cannot be written.
pub fn write_grey(
    path: &Path,
    source: &dyn ChartSource,
    bands_nm: &[f64],
    wanted_nm: f64,
    options: &GreyOptions,
    progress: Progress<'_>,
) -> Result<Shown, PictureError> {
    if let Some(problem) = options.exposure.problem() {
        return Err(PictureError::Setting { setting: "exposure", problem });
    }
    let band = nearest_band(bands_nm, wanted_nm)?;
    let grid = Grid::new(source.size(), &options.view)?;
    let threads = options.view.threads;
    let exposure = match options.exposure.fixed() {
        Some(factor) => factor,
        None => {
            let mut levels = Levels::default();
            let first_half = |done, total: u64| progress(done, 2 * total);
            stream(source, &[band], &grid, threads, &first_half, &mut |_, _, means| {
                means.iter().for_each(|&v| levels.add(v));
                Ok(())
            })?;
            options.exposure.factor(&levels)
        }
    };
    let second_half = |done, total| progress(done + total, 2 * total);
    let progress: Progress<'_> = if options.exposure.fixed().is_some() { progress } else { &second_half };
    let comment = format!("lenscube band {} nm, linear, value = sample / 65535 / {exposure}", bands_nm[band]);
    let mut missing_pixels = 0;
    let missing_samples = write_png(path, grid.out, Samples::LinearGrey16, &comment, |out| {
        let mut bytes = Vec::with_capacity(2 * grid.out.width);
        stream(source, &[band], &grid, threads, progress, &mut |_, y, means| {
            bytes.clear();
            for (x, &v) in means.iter().enumerate() {
                missing_pixels += u64::from(v.is_nan());
                bytes.extend(sample(v, exposure, y, x).to_be_bytes());
            }
            out.write_all(&bytes).map_err(|source| PictureError::Write { path: path.to_owned(), source })
        })
    })?;
    Ok(Shown { size: grid.out, exposure, missing_samples, missing_pixels })
}

fn sample(value: f32, exposure: f64, y: usize, x: usize) -> u16 {
    // A float becomes an integer by clipping; the chequer's
    // display values are near enough squared to linear.
    let shown = if value.is_nan() { chequer(y, x).powi(2) } else { f64::from(value) * exposure };
    (65535.0 * shown).round() as u16
}
