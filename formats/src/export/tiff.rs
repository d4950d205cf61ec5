//! BigTIFF: one page per band, f32, uncompressed, strips of about a megabyte; the wavelength is in the page's description.
//!
//! TIFF 6.0 with 64-bit offsets (BigTIFF, magic 43), SampleFormat 3 (IEEE floating point). Readers present the pages as a stack
//! (bands, rows, columns). For colour previews see [`crate::picture::preview`].

use std::io::{BufWriter, Seek, Write};
use std::path::Path;

use ::tiff::TiffResult;
use ::tiff::encoder::colortype::{ColorType, Gray32Float};
use ::tiff::encoder::{ImageEncoder, Rational, TiffEncoder, TiffKindBig};
use ::tiff::tags::{ResolutionUnit, Tag};
use pipeline::geometry::Rect;

use super::in_order::in_order;
use super::{ExportError, Progress, Samples, Written};
use crate::durable::{AtomicFile, DurableError};

/// Tags XPosition and YPosition.
const X_POSITION: u16 = 286;
const Y_POSITION: u16 = 287;

/// Writes every band as a page.
///
/// # Errors
/// [`ExportError`]; no file is created then.
pub fn write_pages(
    path: &Path,
    samples: &Samples<'_>,
    progress: Progress<'_>,
) -> Result<Written, ExportError> {
    let all = samples.rect;
    let side = |n: usize| u32::try_from(n).map_err(|_| too_large(path, n));
    let (width, height) = (side(all.width)?, side(all.height)?);
    let file = AtomicFile::create(path)?;
    let mut out = BufWriter::with_capacity(1 << 20, file.file());
    let mut encoder = TiffEncoder::new_big(&mut out).map_err(|e| failed(path, e))?;
    let row_bands = samples.row_bands();
    let total = (samples.bands() * all.size().pixels()) as u64;
    let mut written = Written::default();
    let mut done = 0;
    for band in 0..samples.bands() {
        let mut page = encoder.new_image::<Gray32Float>(width, height).map_err(|e| failed(path, e))?;
        let description = page_description(samples, band);
        page.encoder().write_tag(Tag::ImageDescription, description.as_str()).map_err(|e| failed(path, e))?;
        if let Some(pitch_um) = samples.pitch_um {
            write_place(&mut page, samples, pitch_um).map_err(|e| failed(path, e))?;
        }
        let make = |unit: usize| {
            let rows = &row_bands[unit];
            let rect = Rect::new(rows.start, all.x, (rows.end - rows.start) as usize, all.width);
            let mut pixels = vec![0.0; rect.size().pixels()];
            let missing = samples.read(band, rect, &mut pixels)?;
            Ok::<_, ExportError>((pixels, missing))
        };
        // The file's strips end at other rows than the row bands read.
        let mut pending: Vec<f32> = Vec::new();
        in_order(row_bands.len(), samples.threads, make, |_, (pixels, missing)| {
            written.missing += missing;
            done += pixels.len() as u64;
            pending.extend(pixels);
            let mut first = 0;
            loop {
                let n = page.next_strip_sample_count() as usize;
                if n == 0 || pending.len() - first < n {
                    break;
                }
                page.write_strip(&pending[first..first + n]).map_err(|e| failed(path, e))?;
                first += n;
            }
            pending.drain(..first);
            progress(done, total);
            Ok(())
        })?;
        page.finish().map_err(|e| failed(path, e))?;
    }
    out.into_inner().map_err(|e| DurableError::io("write", path, 0, e.into_error()))?;
    written.bytes = file.file().metadata().map_err(|e| DurableError::io("look up", path, 0, e))?.len();
    file.finish()?;
    Ok(written)
}

/// Writes resolution and position of a page, in pixels per cm and cm.
fn write_place<W: Write + Seek, C: ColorType>(
    page: &mut ImageEncoder<'_, W, C, TiffKindBig>,
    samples: &Samples<'_>,
    pitch_um: f64,
) -> TiffResult<()> {
    page.resolution(ResolutionUnit::Centimeter, rational(1e4 / pitch_um));
    let cm = |px: i64| rational(px as f64 * pitch_um * 1e-4);
    page.encoder().write_tag(Tag::Unknown(X_POSITION), cm(samples.rect.x))?;
    page.encoder().write_tag(Tag::Unknown(Y_POSITION), cm(samples.rect.y))
}

/// The fraction nearest to a number that is not negative, with the largest power of ten up to 1000 as denominator that fits.
fn rational(v: f64) -> Rational {
    let d = [1000u32, 100, 10, 1].into_iter().find(|d| v * f64::from(*d) <= f64::from(u32::MAX)).unwrap_or(1);
    Rational { n: (v * f64::from(d)).round() as u32, d }
}

/// Description of a page; TIFF requires ASCII.
fn page_description(samples: &Samples<'_>, band: usize) -> String {
    let text = format!(
        "wavelength {} nm, {}; {}",
        samples.wavelengths_nm[band],
        samples.units.unwrap_or("unknown units"),
        samples.description
    );
    text.replace('µ', "u").chars().map(|c| if c.is_ascii() { c } else { '?' }).collect()
}

fn too_large(path: &Path, side: usize) -> ExportError {
    ExportError::Format {
        path: path.into(),
        what: "side in pixels",
        expected: format!("at most {}", u32::MAX),
        found: side.to_string(),
    }
}

fn failed(path: &Path, error: ::tiff::TiffError) -> ExportError {
    match error {
        ::tiff::TiffError::IoError(e) => DurableError::io("write", path, 0, e).into(),
        other => ExportError::Format {
            path: path.into(),
            what: "encoding",
            expected: "supported by TIFF".into(),
            found: other.to_string(),
        },
    }
}
