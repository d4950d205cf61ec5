//! The colour preview of any size, row by row: memory holds at most 512 rows of the picture, never the picture.
//!
//! Values are those of [`super::preview`]. An exposure that is measured on the picture takes a separate pass over the source.
//! Written as 8-bit PNG, or as BigTIFF of 16 bits (steps of 1/65535 of the encoded value), both sRGB-encoded.

use std::path::Path;

use tiff::encoder::colortype::RGB16;

use super::area::Grid;
use super::file::{Samples, png_file, tiff_file};
use super::preview::{PreviewOptions, White};
use super::spectral::VisibleBands;
use super::tone::{Tone, is_missing, luminance};
use super::{ChartSource, PictureError, PictureSummary, Progress};

/// File format.
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
/// As [`super::preview::write_preview`]; [`White::Auto`] needs the complete picture in memory and is not supported.
pub fn write_streamed(
    path: &Path,
    source: &dyn ChartSource,
    bands_nm: &[f64],
    options: &PreviewOptions,
    file: ColourFile,
    progress: Progress<'_>,
) -> Result<PictureSummary, PictureError> {
    options.exposure.check()?;
    let White::Illuminant(light) = options.white else {
        let problem = "auto needs the complete picture in memory; name a light, or request a smaller picture";
        return Err(PictureError::Setting { setting: "white", problem: problem.into() });
    };
    let visible = VisibleBands::new(bands_nm, light)?;
    let grid = Grid::new(source.size(), &options.view)?;
    let threads = options.view.threads;
    let exposure = options.exposure.measure(progress, |levels, progress| {
        visible.stream_rows(source, &grid, threads, progress, &mut |_, row| {
            row.iter().for_each(|p| levels.add(luminance(p.map(f64::from)) as f32));
            Ok(())
        })
    })?;
    let progress = options.exposure.progress_after_measuring(progress);
    let comment = format!("lenscube preview, CIE 1931 2 deg, white {}, exposure {exposure}", light.name());
    let tone = Tone { exposure, gamma: 1.0 };
    let mut missing_pixels = 0;
    let mut values = Vec::with_capacity(3 * grid.out.width);
    let mut encode = |emit: &mut (dyn FnMut(&[f64]) -> Result<(), PictureError> + Send)| {
        visible.stream_rows(source, &grid, threads, &progress, &mut |y, row| {
            values.clear();
            for (x, rgb) in row.iter().enumerate() {
                missing_pixels += u64::from(is_missing(rgb));
                values.extend(tone.encoded(*rgb, (y, x)));
            }
            emit(&values)
        })
    };
    let (file, missing_samples) = match file {
        ColourFile::Png => png_file(path, grid.out, Samples::Srgb8, &comment, |out| {
            encode(&mut |values| {
                let bytes: Vec<u8> = values.iter().map(|v| (255.0 * v).round() as u8).collect();
                out.write_all(&bytes).map_err(|source| PictureError::Write { path: path.to_owned(), source })
            })
        }),
        ColourFile::Tiff => tiff_file::<RGB16, _>(path, grid.out, &comment, |out| {
            encode(&mut |values| {
                out(&values.iter().map(|v| (65535.0 * v).round() as u16).collect::<Vec<_>>())
            })
        }),
    }?;
    file.finish()?;
    Ok(PictureSummary { size: grid.out, exposure, missing_samples, missing_pixels })
}
