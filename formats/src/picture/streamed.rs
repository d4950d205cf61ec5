//! The colour preview of any size, row by row: memory holds a strip of the picture (512 rows at most), never the picture.
//!
//! The values are those of [`super::preview`]. An exposure that is to be found from the picture takes a pass of its own over the
//! source. Written as 8-bit PNG, or as BigTIFF of 16 bits (steps of 1/65535 of the encoded value), both sRGB-encoded.

use std::path::Path;

use super::average::Grid;
use super::exposure::Levels;
use super::file::{Samples, write_png, write_tiff};
use super::preview::{PreviewOptions, Seen, White, encoded, luminance};
use super::{ChartSource, PictureError, Progress, Shown, chequer};

/// The file to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColourFile {
    /// 8 bits a channel.
    Png,
    /// 16 bits a channel.
    Tiff,
}

/// Writes the picture.
///
/// # Errors
/// As [`super::preview::write_preview`]; [`White::Auto`] cannot be met without the whole picture.
pub fn write_streamed(
    path: &Path,
    source: &dyn ChartSource,
    bands_nm: &[f64],
    options: &PreviewOptions,
    file: ColourFile,
    progress: Progress<'_>,
) -> Result<Shown, PictureError> {
    if let Some(problem) = options.exposure.problem() {
        return Err(PictureError::Setting { setting: "exposure", problem });
    }
    let White::Illuminant(light) = options.white else {
        let problem = "auto looks at the whole picture, which memory does not hold; name a light, or ask for a smaller picture";
        return Err(PictureError::Setting { setting: "white", problem: problem.into() });
    };
    let seen = Seen::new(bands_nm, options.white)?;
    let grid = Grid::new(source.size(), &options.view)?;
    let threads = options.view.threads;
    let exposure = match options.exposure.fixed() {
        Some(factor) => factor,
        None => {
            let mut levels = Levels::default();
            let first_half = |done, total: u64| progress(done, 2 * total);
            seen.rows(source, &grid, threads, &first_half, &mut |_, row| {
                row.iter().for_each(|p| levels.add(luminance(p.map(f64::from)) as f32));
                Ok(())
            })?;
            options.exposure.factor(&levels)
        }
    };
    let second_half = |done, total| progress(done + total, 2 * total);
    let progress: Progress<'_> = if options.exposure.fixed().is_some() { progress } else { &second_half };
    let comment = format!("lenscube preview, CIE 1931 2 deg, white {}, exposure {exposure}", light.name());
    let mut missing_pixels = 0;
    let mut show = |y: usize, x: usize, rgb: [f32; 3]| {
        if rgb.iter().all(|v| v.is_finite()) {
            return encoded(rgb.map(|v| f64::from(v) * exposure));
        }
        missing_pixels += 1;
        [chequer(y, x); 3]
    };
    let missing_samples = match file {
        ColourFile::Png => write_png(path, grid.out, Samples::Srgb8, &comment, |out| {
            let mut bytes = Vec::with_capacity(3 * grid.out.width);
            seen.rows(source, &grid, threads, progress, &mut |y, row| {
                bytes.clear();
                for (x, rgb) in row.iter().enumerate() {
                    bytes.extend(show(y, x, *rgb).map(|v| (255.0 * v).round() as u8));
                }
                out.write_all(&bytes).map_err(|source| PictureError::Write { path: path.to_owned(), source })
            })
        }),
        ColourFile::Tiff => write_tiff(path, grid.out, &comment, |out| {
            let mut samples = Vec::with_capacity(3 * grid.out.width);
            seen.rows(source, &grid, threads, progress, &mut |y, row| {
                samples.clear();
                for (x, rgb) in row.iter().enumerate() {
                    samples.extend(show(y, x, *rgb).map(|v| (65535.0 * v).round() as u16));
                }
                out(&samples)
            })
        }),
    }?;
    Ok(Shown { size: grid.out, exposure, missing_samples, missing_pixels })
}
