//! NPY and ENVI: a header, then f32 samples, little endian, band after band (BSQ).
//!
//! NPY is one file, (bands, rows, columns). ENVI is two (NV5 Geospatial, "ENVI Header Files"): data, and a text `NAME.hdr`. Both are
//! complete under temporary names before they are renamed, the header last ([`finish_together`]): until then an existing pair is
//! unchanged, and a header is never beside the data of another export. Each thread reads a strip of rows of one band at a time.

use std::io::Write;
use std::path::{Path, PathBuf};

use pipeline::geometry::Rect;

use super::in_order::in_order;
use super::{ExportError, Progress, Samples, Written};
use crate::durable::{AtomicFile, DurableError, finish_together};
use crate::npy::header_of_f32;

/// Writes an NPY file.
///
/// # Errors
/// [`ExportError`]; no file is created then.
pub fn write_npy(path: &Path, samples: &Samples<'_>, progress: Progress<'_>) -> Result<Written, ExportError> {
    let rect = samples.rect;
    let head = header_of_f32(&[samples.bands(), rect.height, rect.width]);
    let (file, written) = write_samples(path, &head, samples, progress)?;
    file.finish()?;
    Ok(written)
}

/// Begins the NPY file `path` of an array of `shape`, rows last.
///
/// # Errors
/// [`DurableError`]; no file is created then.
pub fn npy_file(
    path: &Path,
    shape: &[usize],
    samples: impl Iterator<Item = f32>,
) -> Result<AtomicFile, DurableError> {
    let mut bytes = header_of_f32(shape);
    bytes.extend(samples.flat_map(f32::to_le_bytes));
    let file = AtomicFile::create(path)?;
    let written = file.writer().write_all(&bytes);
    written.map_err(|e| DurableError::io("write", path, bytes.len() as u64, e))?;
    Ok(file)
}

/// Paths of data and header of an ENVI export to `path`, which is either.
pub fn envi_files(path: &Path) -> (PathBuf, PathBuf) {
    let header = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("hdr"));
    let data = if header { path.with_extension("bsq") } else { path.to_path_buf() };
    (data.clone(), data.with_extension("hdr"))
}

/// Writes an ENVI header and its data.
///
/// # Errors
/// [`ExportError`]; an existing pair is unchanged then.
pub fn write_envi(
    path: &Path,
    samples: &Samples<'_>,
    progress: Progress<'_>,
) -> Result<Written, ExportError> {
    let (data, header) = envi_files(path);
    let (file, written) = write_samples(&data, &[], samples, progress)?;
    let header = AtomicFile::with_text(&header, &envi_header(samples))?;
    finish_together(vec![file, header])?;
    Ok(written)
}

fn envi_header(samples: &Samples<'_>) -> String {
    let list = samples.wavelengths_nm.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    // A brace would end the description, a line break would begin a new key.
    let description: String =
        samples.description.chars().map(|c| if "{}\n\r".contains(c) { ' ' } else { c }).collect();
    let units = samples.units.map_or(String::new(), |u| format!("data units = {u}\n"));
    let place = samples.pitch_um.map_or(String::new(), |pitch_um| {
        let metre = |um: f64| decimal(um * 1e-6);
        let (x, y) = (metre(samples.rect.x as f64 * pitch_um), metre(-(samples.rect.y as f64) * pitch_um));
        let pitch = metre(pitch_um);
        format!(
            "map info = {{Arbitrary, 1, 1, {x}, {y}, {pitch}, {pitch}, 0, units=Meters}}\npixel size = {{{pitch}, {pitch}, units=Meters}}\n"
        )
    });
    format!(
        "ENVI\ndescription = {{{description}}}\nsamples = {}\nlines = {}\nbands = {}\nheader offset = 0\nfile type = ENVI Standard\n\
         data type = 4\ninterleave = bsq\nbyte order = 0\n{units}{place}wavelength units = Nanometers\nwavelength = {{{list}}}\n",
        samples.rect.width,
        samples.rect.height,
        samples.bands(),
    )
}

/// A length in m to 10⁻¹² m, without an exponent.
fn decimal(m: f64) -> String {
    let text = format!("{m:.12}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.into() }
}

/// Writes `head`, then all samples, into a file that is complete except for its final name.
fn write_samples(
    path: &Path,
    head: &[u8],
    samples: &Samples<'_>,
    progress: Progress<'_>,
) -> Result<(AtomicFile, Written), ExportError> {
    let file = AtomicFile::create(path)?;
    let failed = |bytes: usize| move |e| DurableError::io("write", path, bytes as u64, e);
    let mut out = file.writer();
    out.write_all(head).map_err(failed(head.len()))?;
    let (all, strips) = (samples.rect, samples.strips());
    let total = (samples.bands() * all.size().pixels()) as u64;
    let mut written = Written { bytes: head.len() as u64, missing: 0 };
    let make = |unit: usize| {
        let (band, rows) = (unit / strips.len(), &strips[unit % strips.len()]);
        let rect = Rect::new(rows.start, all.x, (rows.end - rows.start) as usize, all.width);
        let mut pixels = vec![0.0; rect.size().pixels()];
        let missing = samples.read(band, rect, &mut pixels)?;
        let bytes: Vec<u8> = pixels.iter().flat_map(|v| v.to_le_bytes()).collect();
        Ok::<_, ExportError>((bytes, missing))
    };
    in_order(samples.bands() * strips.len(), samples.threads, make, |_, (bytes, missing)| {
        out.write_all(&bytes).map_err(failed(bytes.len()))?;
        written.bytes += bytes.len() as u64;
        written.missing += missing;
        progress((written.bytes - head.len() as u64) / 4, total);
        Ok(())
    })?;
    Ok((file, written))
}
