//! Charts in flat files, memory-mapped: `.npy`, ENVI, or raw samples of a declared layout.
//!
//! | order | file | samples of a row of one band |
//! |---|---|---|
//! | BSQ | (band, row, column): NPY, raw, ENVI | contiguous |
//! | BIL | (row, band, column): ENVI | contiguous |
//! | BIP | (row, column, band): ENVI | one per pixel, all bands of a pixel contiguous |
//! | | columns slower than rows: NPY (also Fortran order), raw | one per column of the file |
//!
//! Only the requested rectangle is copied, and converted to f32; integers are values, scaled only if an ENVI header ([`envi`]) or the
//! attributes beside a `.npy` file ([`attributes`]) require it. Pages behind the reader are released, so a file of any size takes the memory of a few rows. Where bands interleave
//! finer than pages, reading band by band would fetch the entire file once per band: [`RasterChart::copy_bands`] first copies the
//! bands to a temporary file in BSQ order, in one pass.
//!
//! A file may be truncated while it is mapped. The lost part then reads as zeros ([`mapped`]), and the read fails.
//! Not supported: ENVI's georeference and bad band list.

mod attributes;
mod band_copy;
pub(super) mod bands;
mod envi;
pub(super) mod layout;
mod mapped;
mod npy_layout;
mod open;
mod samples;

pub(super) use open::beside;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};

use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use serde_json::{Value, json};

use super::error::ChartError;
use super::file_change::WatchedFile;
use super::header::{FileArray, check_declared_wavelengths};
use super::options::NanPolicy;
use super::values::Values;
use crate::durable::DurableError;
use crate::sample::RasterSample;
use layout::{Interleave, RasterLayout};
use mapped::MappedFile;

/// Rows kept in memory behind the reader, so that tiles of several workers lie within.
const KEPT_ROWS: usize = 2048;

/// A chart in a flat file.
#[derive(Debug)]
pub struct RasterChart {
    path: PathBuf,
    map: MappedFile,
    layout: RasterLayout,
    /// Sample type of the chart's file, which may have been copied to another.
    sample: RasterSample,
    /// Position of each band in the mapped file; `None`: not in it.
    entries: Vec<Option<usize>>,
    nan: NanPolicy,
    wavelengths_nm: Option<Vec<f64>>,
    values: Values,
    units: Option<String>,
    array: Option<FileArray>,
    notes: Vec<String>,
    replaced: AtomicU64,
    bytes_read: AtomicU64,
    /// Per band: rows whose pages were released.
    released_rows: Vec<AtomicUsize>,
    identity: (Value, Value),
    /// The data file, and its header or attributes.
    pub(super) files: Vec<WatchedFile>,
}

impl RasterChart {
    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.layout.shape[0]
    }

    /// Wavelengths in nm, if the header contains them with their unit.
    pub fn wavelengths_nm(&self) -> Option<&[f64]> {
        self.wavelengths_nm.as_deref()
    }

    /// Replaces the wavelengths of the header.
    ///
    /// # Errors
    /// [`ChartError::Header`] unless there is one per band, each within its bounds.
    pub fn with_wavelengths(mut self, nm: Vec<f64>) -> Result<Self, ChartError> {
        check_declared_wavelengths(&self.path, self.bands(), &nm)?;
        self.identity.0["wavelengths_nm"] = json!(nm);
        self.wavelengths_nm = Some(nm);
        Ok(self)
    }

    /// Multiplies all values by `scale`. To be called before [`RasterChart::copy_bands`].
    #[must_use]
    pub fn with_scale(mut self, scale: f64) -> Self {
        self.values.multiply(scale);
        if let Value::Object(identity) = &mut self.identity.0 {
            identity.insert("values".into(), self.values.identity());
        }
        self
    }

    /// Whether its values are its samples times a factor, or plus an offset.
    pub fn is_scaled(&self) -> bool {
        !self.values.scaling.is_empty()
    }

    /// Path of the data file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Sample type of the file.
    pub fn sample(&self) -> RasterSample {
        self.sample
    }

    /// Unit of the values, if the file declares it.
    pub fn units(&self) -> Option<&str> {
        self.units.as_deref()
    }

    /// Its array, if the file has several.
    pub fn array(&self) -> Option<&FileArray> {
        self.array.as_ref()
    }

    /// Remarks on the interpretation of the header, one line each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Makes values beyond `max_magnitude` an error, instead of those beyond [`MAX_VALUE`](super::MAX_VALUE).
    pub fn limit_values(&mut self, max_magnitude: f32) {
        self.values.max_magnitude = max_magnitude;
    }

    /// Everything that determines its values except the samples, and the modification time of the data file.
    ///
    /// # Errors
    /// [`ChartError::Changed`] if a file changed after it was opened.
    pub fn identity(&self) -> Result<(Value, Value), ChartError> {
        self.files.iter().try_for_each(WatchedFile::check_unchanged)?;
        Ok(self.identity.clone())
    }

    /// Bytes of samples read so far, and pixels without data that were read as 0.
    pub fn stats(&self) -> (u64, u64) {
        (self.bytes_read.load(Relaxed), self.replaced.load(Relaxed))
    }

    /// [`ChartSource::read`] with its own error type.
    ///
    /// # Errors
    /// [`ChartError`] if the rectangle is not inside the chart, a pixel is not finite, or a file changed.
    pub fn read_rect(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), ChartError> {
        let size = ChartSource::size(self);
        let entry = self.entries.get(band).copied().flatten();
        let Some(entry) = entry.filter(|_| size.rect().contains(rect) && out.len() == rect.size().pixels())
        else {
            return Err(ChartError::Request {
                path: self.path.clone(),
                band,
                rect,
                buffer: out.len(),
                bands: self.bands(),
                size,
            });
        };
        let (mut replaced, mut error) = (0, None);
        for (y, line) in (rect.y as usize..).zip(out.chunks_exact_mut(rect.width.max(1))) {
            let layout = &self.layout;
            let (first, step) = layout.position(entry, y, rect.x as usize);
            let bytes = self.map.bytes(first, (rect.width - 1) * step + layout.sample.bytes());
            match self.values.is_identity() {
                true => samples::convert(layout, bytes, step, line),
                false => samples::convert_by(layout, bytes, step, line, self.values.converter(band)),
            }
            let checked =
                self.values.check(band, line, |k| samples::read(layout, &bytes[k * step..]), self.nan);
            replaced += checked.replaced;
            if let Some((column, invalid)) = checked.error {
                let pixel = (band, y, rect.x as usize + column);
                let max_magnitude = self.values.max_magnitude;
                error.get_or_insert(invalid.into_error(self.path.clone(), pixel, max_magnitude));
            }
        }
        self.check_not_truncated()?;
        // After the read, so that the pixels are of the file that the identity describes.
        self.files.iter().try_for_each(WatchedFile::check_unchanged)?;
        if let Some(error) = error {
            return Err(error);
        }
        self.replaced.fetch_add(replaced, Relaxed);
        self.bytes_read.fetch_add((rect.size().pixels() * self.layout.sample.bytes()) as u64, Relaxed);
        self.release_rows(entry, rect.y as usize);
        Ok(())
    }

    fn check_not_truncated(&self) -> Result<(), ChartError> {
        if !self.map.has_lost_pages() {
            return Ok(());
        }
        let found = self.map.file_bytes().map_err(|e| DurableError::io("look up", &self.path, 0, e))?;
        let expected = self.map.expected_bytes();
        if found >= expected {
            let reason = "a page could not be read (I/O error, or the file was temporarily truncated)".into();
            return Err(ChartError::Damaged { path: self.path.clone(), reason });
        }
        Err(ChartError::Short { path: self.path.clone(), expected, found })
    }

    /// Releases the pages of a band more than [`KEPT_ROWS`] above `row`, once there are enough of them.
    fn release_rows(&self, entry: usize, row: usize) {
        let released = &self.released_rows[entry];
        let (start, end) = (released.load(Relaxed), row.saturating_sub(KEPT_ROWS));
        if end < start + KEPT_ROWS / 4 || !matches!(self.layout.interleave, Interleave::Bsq | Interleave::Bil)
        {
            return;
        }
        if released.compare_exchange(start, end, Relaxed, Relaxed).is_ok() {
            let (first, _) = self.layout.position(entry, start, 0);
            let (last, _) = self.layout.position(entry, end, 0);
            self.map.release(first, last - first);
        }
    }
}

impl ChartSource for RasterChart {
    fn size(&self) -> Size {
        Size::new(self.layout.shape[1], self.layout.shape[2])
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        Ok(self.read_rect(band, rect, out)?)
    }

    fn prefetch(&self, band: usize, rect: Rect) {
        let rect = rect.intersect(ChartSource::size(self).rect());
        let is_sparse = rect.is_empty() || self.layout.interleave.is_transposed();
        if let Some(entry) = self.entries.get(band).copied().flatten().filter(|_| !is_sparse) {
            for row in rect.y as usize..rect.bottom() as usize {
                let (first, step) = self.layout.position(entry, row, rect.x as usize);
                self.map.prefetch(first, rect.width * step);
            }
        }
    }
}

#[cfg(test)]
mod tests;
