//! NPY and ENVI: a header, then f32 samples, lowest byte first, band after band (BSQ).
//!
//! NPY is one file, (bands, rows, columns). ENVI is two (NV5 Geospatial, "ENVI Header Files"): data, and a text `NAME.hdr` that is
//! written last, so that there is a header only beside whole data. A strip of one band is read at a time and thread.

use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use pipeline::geometry::Rect;

use super::in_order::in_order;
use super::{ExportError, Progress, Samples, Written};
use crate::durable::{DurableError, WholeFile};
use crate::npy::header_of_f32;

/// Writes an NPY file.
///
/// # Errors
/// [`ExportError`]; there is no new file then.
pub fn write_npy(path: &Path, samples: &Samples<'_>, progress: Progress<'_>) -> Result<Written, ExportError> {
    let window = samples.window;
    write_after(path, &header_of_f32(&[samples.bands(), window.height, window.width]), samples, progress)
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
/// [`ExportError`]; there is no new header then.
pub fn write_envi(
    path: &Path,
    samples: &Samples<'_>,
    progress: Progress<'_>,
) -> Result<Written, ExportError> {
    let (data, header) = envi_files(path);
    // An old header must not describe new data.
    match std::fs::remove_file(&header) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            return Err(DurableError::io("remove", &header, 0, e).into());
        }
        _ => (),
    }
    let written = write_after(&data, &[], samples, progress)?;
    let text = envi_header(samples);
    let file = WholeFile::create(&header)?;
    file.file()
        .write_all_at(text.as_bytes(), 0)
        .map_err(|e| DurableError::io("write", &header, text.len() as u64, e))?;
    file.finish()?;
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

/// The bytes `head`, then all samples.
fn write_after(
    path: &Path,
    head: &[u8],
    samples: &Samples<'_>,
    progress: Progress<'_>,
) -> Result<Written, ExportError> {
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
    whole.finish()?;
    Ok(written)
}
