//! NPY and ENVI: a header, then f32 samples, lowest byte first, band after band (BSQ).
//!
//! NPY is one file, (bands, rows, columns). ENVI is two (NV5 Geospatial, "ENVI Header Files"): data, and a text `NAME.hdr`. Both are
//! complete under temporary names before either gets its own, the header last ([`finish_together`]): until then an older pair stays as it
//! is, and at no time does a header lie beside the data of another export. A strip of one band is read at a time and thread.

use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use pipeline::geometry::Rect;

use super::in_order::in_order;
use super::{ExportError, Progress, Samples, Written};
use crate::durable::{DurableError, WholeFile, finish_together};
use crate::npy::header_of_f32;

/// Writes an NPY file.
///
/// # Errors
/// [`ExportError`]; there is no new file then.
pub fn write_npy(path: &Path, samples: &Samples<'_>, progress: Progress<'_>) -> Result<Written, ExportError> {
    let window = samples.window;
    let head = header_of_f32(&[samples.bands(), window.height, window.width]);
    let (whole, written) = write_after(path, &head, samples, progress)?;
    whole.finish()?;
    Ok(written)
}

/// The data file and the header of an ENVI export to `path`, which may name either.
pub fn envi_files(path: &Path) -> (PathBuf, PathBuf) {
    let header = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("hdr"));
    let data = if header { path.with_extension("bsq") } else { path.to_path_buf() };
    (data.clone(), data.with_extension("hdr"))
}

/// Writes an ENVI header and its data.
///
/// # Errors
/// [`ExportError`]; an older pair is as it was then.
pub fn write_envi(
    path: &Path,
    samples: &Samples<'_>,
    progress: Progress<'_>,
) -> Result<Written, ExportError> {
    let (data, header) = envi_files(path);
    let (whole, written) = write_after(&data, &[], samples, progress)?;
    let header = WholeFile::with_text(&header, &envi_header(samples))?;
    finish_together(vec![whole, header])?;
    Ok(written)
}

fn envi_header(samples: &Samples<'_>) -> String {
    let list = samples.wavelengths_nm.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    // Braces would end the description; lines would begin a new key.
    let words: String =
        samples.description.chars().map(|c| if "{}\n\r".contains(c) { ' ' } else { c }).collect();
    let units = samples.units.map_or(String::new(), |u| format!("data units = {u}\n"));
    format!(
        "ENVI\ndescription = {{{words}}}\nsamples = {}\nlines = {}\nbands = {}\nheader offset = 0\nfile type = ENVI Standard\n\
         data type = 4\ninterleave = bsq\nbyte order = 0\n{units}wavelength units = Nanometers\nwavelength = {{{list}}}\n",
        samples.window.width,
        samples.window.height,
        samples.bands(),
    )
}

/// The bytes `head`, then all samples, in a file that is complete but for its name.
fn write_after(
    path: &Path,
    head: &[u8],
    samples: &Samples<'_>,
    progress: Progress<'_>,
) -> Result<(WholeFile, Written), ExportError> {
    let whole = WholeFile::create(path)?;
    let failed = |bytes: usize| move |e| DurableError::io("write", path, bytes as u64, e);
    whole.file().write_all_at(head, 0).map_err(failed(head.len()))?;
    let (window, strips) = (samples.window, samples.strips());
    let total = (samples.bands() * window.size().pixels()) as u64;
    let mut written = Written { bytes: head.len() as u64, missing: 0 };
    let make = |unit: usize| {
        let (band, rows) = (unit / strips.len(), &strips[unit % strips.len()]);
        let rect = Rect::new(rows.start, window.x, (rows.end - rows.start) as usize, window.width);
        let mut pixels = vec![0.0; rect.size().pixels()];
        let missing = samples.read(band, rect, &mut pixels)?;
        let bytes: Vec<u8> = pixels.iter().flat_map(|v| v.to_le_bytes()).collect();
        Ok::<_, ExportError>((bytes, missing))
    };
    in_order(samples.bands() * strips.len(), samples.threads, make, |_, (bytes, missing)| {
        whole.file().write_all_at(&bytes, written.bytes).map_err(failed(bytes.len()))?;
        written.bytes += bytes.len() as u64;
        written.missing += missing;
        progress((written.bytes - head.len() as u64) / 4, total);
        Ok(())
    })?;
    Ok((whole, written))
}
