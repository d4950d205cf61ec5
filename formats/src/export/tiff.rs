//! BigTIFF: one page a band, f32, strips of about a megabyte, uncompressed; the wavelength is the page's description.
//!
//! TIFF 6.0 with 64-bit offsets (BigTIFF, magic 43), SampleFormat 3 (IEEE floating point). Readers take the pages as a stack
//! (bands, rows, columns). The colour preview is [`crate::picture::preview`]'s.

use std::io::BufWriter;
use std::path::Path;

use ::tiff::encoder::{TiffEncoder, colortype::Gray32Float};
use ::tiff::tags::Tag;
use pipeline::geometry::Rect;

use super::in_order::in_order;
use super::{ExportError, Progress, Samples, Written};
use crate::durable::{DurableError, WholeFile};

/// Writes every band as a page.
///
/// # Errors
/// [`ExportError`]; there is no new file then.
pub fn write_pages(
    path: &Path,
    samples: &Samples<'_>,
    progress: Progress<'_>,
) -> Result<Written, ExportError> {
    let window = samples.window;
    let side = |n: usize| u32::try_from(n).map_err(|_| too_large(path, n));
    let (width, height) = (side(window.width)?, side(window.height)?);
    let whole = WholeFile::create(path)?;
    let mut out = BufWriter::with_capacity(1 << 20, whole.file());
    let mut encoder = TiffEncoder::new_big(&mut out).map_err(|e| failed(path, e))?;
    let strips = samples.strips();
    let total = (samples.bands() * window.size().pixels()) as u64;
    let mut written = Written::default();
    let mut done = 0;
    for band in 0..samples.bands() {
        let mut page = encoder.new_image::<Gray32Float>(width, height).map_err(|e| failed(path, e))?;
        let words = page_words(samples, band);
        page.encoder().write_tag(Tag::ImageDescription, words.as_str()).map_err(|e| failed(path, e))?;
        let make = |unit: usize| {
            let rows = &strips[unit];
            let rect = Rect::new(rows.start, window.x, (rows.end - rows.start) as usize, window.width);
            let mut pixels = vec![0.0; rect.size().pixels()];
            let missing = samples.read(band, rect, &mut pixels)?;
            Ok::<_, ExportError>((pixels, missing))
        };
        // Strips of the file end where it says; those read end where pieces of the source do.
        let mut kept: Vec<f32> = Vec::new();
        in_order(strips.len(), samples.threads, make, |_, (pixels, missing)| {
            written.missing += missing;
            done += pixels.len() as u64;
            kept.extend(pixels);
            let mut first = 0;
            loop {
                let n = page.next_strip_sample_count() as usize;
                if n == 0 || kept.len() - first < n {
                    break;
                }
                page.write_strip(&kept[first..first + n]).map_err(|e| failed(path, e))?;
                first += n;
            }
            kept.drain(..first);
            progress(done, total);
            Ok(())
        })?;
        page.finish().map_err(|e| failed(path, e))?;
    }
    out.into_inner().map_err(|e| DurableError::io("write", path, 0, e.into_error()))?;
    written.bytes = whole.file().metadata().map_err(|e| DurableError::io("look up", path, 0, e))?.len();
    whole.finish()?;
    Ok(written)
}

/// ASCII, as the format wants it.
fn page_words(samples: &Samples<'_>, band: usize) -> String {
    let all = format!(
        "wavelength {} nm, {}; {}",
        samples.wavelengths_nm[band],
        samples.units.unwrap_or("units not told"),
        samples.description
    );
    all.replace('µ', "u").chars().map(|c| if c.is_ascii() { c } else { '?' }).collect()
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
            expected: "a TIFF that can hold it".into(),
            found: other.to_string(),
        },
    }
}
