//! A chart in one flat file, mapped into memory: `.npy`, ENVI, or raw samples of a told shape.
//!
//! | order | samples of a line of one band |
//! |---|---|
//! | BSQ, NPY, raw | side by side, lines and then bands one after the other |
//! | BIL | side by side, the bands of a line one after the other |
//! | BIP | one of each band, band after band |
//!
//! Nothing is copied but the rectangle asked for, converted to f32 on the way; integers are read as values, scaled only where an
//! ENVI header says so (`envi`).
//! Pages behind the reader are given back, so that a file of any size takes a few rows of memory. Read band by band,
//! samples that interleave finer than pages would fetch the whole file once per band: [`RasterChart::in_bands`] lays them
//! out band by band first, in one pass.
//!
//! A file may shrink while it is mapped. Then the lost part reads as zeros (`mapped`), the length shows it, and reading is an
//! error: neither garbage nor a dead process.
//! Left out: ENVI's georeference and bad band list, Fortran order.

pub(super) mod bands;
mod envi;
mod mapped;
mod npy;
mod samples;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};

use pipeline::bounds;
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use serde_json::{Value, json};

use super::values::Values;
use super::watch::Watched;
use super::{ChartError, NanPolicy, Sample};
use crate::durable::DurableError;
pub use crate::npy::sample as sample_named;
use bands::BandFile;
use mapped::Mapped;

/// Longest header of an ENVI file.
const MAX_HEADER: u64 = 16 << 20;
/// Beyond what any disk holds.
const MAX_BYTES: u64 = 1 << 60;
/// Lines of a band shorter than this share too many pages with other bands to be read where they lie.
const LONG_LINE: u64 = 16 << 10;
/// Rows kept behind the reader: tiles of several workers lie within.
const KEPT_ROWS: usize = 2048;

/// How bands lie among each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interleave {
    /// Band after band.
    Bsq,
    /// Line by line.
    Bil,
    /// Pixel by pixel.
    Bip,
}

/// What a flat file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct RasterLayout {
    /// (bands, rows, columns).
    pub shape: [usize; 3],
    /// How they lie.
    pub interleave: Interleave,
    /// Sample type; 16-bit integers of ENVI may be signed.
    pub sample: RasterSample,
    /// Lowest byte first.
    pub little_endian: bool,
    /// Bytes before the first sample.
    pub offset: u64,
}

/// Sample types of flat files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RasterSample {
    /// Signed 16-bit integer.
    I16,
    /// What charts in stores have.
    Plain(Sample),
}

impl RasterSample {
    /// Bytes of one sample.
    pub const fn bytes(self) -> usize {
        match self {
            Self::I16 => 2,
            Self::Plain(sample) => sample.bytes(),
        }
    }

    /// What a float file stores for `value`; the number itself for integers.
    fn nearest(self, value: f64) -> f64 {
        match self {
            Self::I16 => value,
            Self::Plain(sample) => sample.nearest(value),
        }
    }
}

/// A chart in a flat file.
#[derive(Debug)]
pub struct RasterChart {
    path: PathBuf,
    map: Mapped,
    layout: RasterLayout,
    /// Where each band lies among those of the file.
    slots: Vec<Option<usize>>,
    nan: NanPolicy,
    wavelengths_nm: Option<Vec<f64>>,
    /// What raw samples mean.
    values: Values,
    /// What the user should know of how the header is understood.
    notes: Vec<String>,
    replaced: AtomicU64,
    bytes_read: AtomicU64,
    /// Per band: rows given back.
    behind: Vec<AtomicUsize>,
    identity: (Value, Value),
    /// The files that it comes from.
    watched: Vec<Watched>,
}

/// What a flat file's header tells, beside the layout.
#[derive(Default)]
struct Told {
    wavelengths_nm: Option<Vec<f64>>,
    values: Values,
    notes: Vec<String>,
    header: Option<Watched>,
}

impl RasterChart {
    /// Whether `path` looks like a file that [`RasterChart::open`] takes.
    pub fn is_one(path: &Path) -> bool {
        path.is_file() && (is_npy(path) || is_header(path) || envi::header_of(path).is_some())
    }

    /// Opens a `.npy` file, an ENVI header, or the data beside one.
    ///
    /// # Errors
    /// [`ChartError`]: a header that cannot be read or be true, a file shorter than it says.
    pub fn open(path: &Path, nan: NanPolicy) -> Result<Self, ChartError> {
        if is_npy(path) {
            let mut head = Vec::new();
            let file = open(path)?;
            file.take(crate::npy::LONGEST)
                .read_to_end(&mut head)
                .map_err(|e| DurableError::io("read", path, 0, e))?;
            let layout =
                npy::layout(&head).map_err(|(what, expected, found)| header(path, what, expected, found))?;
            return Self::with(path, layout, Told::default(), nan);
        }
        let hdr = if is_header(path) { Some(path.to_path_buf()) } else { envi::header_of(path) };
        let hdr = hdr.ok_or_else(|| {
            header(path, "file", "a .npy file or one with an ENVI header (.hdr)", "neither")
        })?;
        let mut text = Vec::new();
        open(&hdr)?
            .take(MAX_HEADER)
            .read_to_end(&mut text)
            .map_err(|e| DurableError::io("read", &hdr, 0, e))?;
        let envi = envi::parse(&String::from_utf8_lossy(&text)).map_err(|(w, e, f)| header(&hdr, w, e, f))?;
        let data = if is_header(path) { envi::data_of(path) } else { Some(path.to_path_buf()) };
        let data =
            data.ok_or_else(|| header(&hdr, "data file", "a file beside it of the same name", "none"))?;
        let envi::Envi { layout, wavelengths_nm, values, notes } = envi;
        let header = Some(Watched::header(&hdr, MAX_HEADER, &text));
        Self::with(&data, layout, Told { wavelengths_nm, values, notes, header }, nan)
    }

    /// Opens raw samples.
    ///
    /// # Errors
    /// As [`RasterChart::open`].
    pub fn raw(path: &Path, layout: RasterLayout, nan: NanPolicy) -> Result<Self, ChartError> {
        Self::with(path, layout, Told::default(), nan)
    }

    fn with(path: &Path, layout: RasterLayout, told: Told, nan: NanPolicy) -> Result<Self, ChartError> {
        let Told { wavelengths_nm, values, notes, header: header_file } = told;
        let bytes =
            samples_bytes(&layout).and_then(|n| n.checked_add(layout.offset)).filter(|n| *n <= MAX_BYTES);
        let [bands, rows, columns] = layout.shape;
        if let Err(e) = bounds::chart_size(bands, Size::new(rows, columns)) {
            return Err(header(path, e.bound.name, e.bound.to_string(), e.found));
        }
        let Some(expected) = bytes else {
            return Err(header(path, "shape", "a size that a disk holds", format!("{:?}", layout.shape)));
        };
        check_wavelengths(path, wavelengths_nm.as_deref())?;
        let file = open(path)?;
        let meta = file.metadata().map_err(|e| DurableError::io("look up", path, 0, e))?;
        if meta.len() < expected {
            return Err(ChartError::Short { path: path.into(), expected, found: meta.len() });
        }
        let modified = meta.modified().ok().and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
        let identity = (
            json!({
                "raster": format!("{layout:?}"),
                "bytes": meta.len(),
                "wavelengths_nm": wavelengths_nm,
                "values": values.identity(),
            }),
            json!(modified.map_or(0, |t| t.as_nanos() as u64)),
        );
        let watched = header_file.into_iter().chain([Watched::data(path, &meta)]).collect();
        let map = Mapped::new(file, expected).map_err(|e| DurableError::io("map", path, expected, e))?;
        let behind = (0..layout.shape[0]).map(|_| AtomicUsize::new(0)).collect();
        Ok(Self {
            path: path.into(),
            map,
            slots: (0..layout.shape[0]).map(Some).collect(),
            layout,
            nan,
            wavelengths_nm,
            values,
            notes,
            replaced: AtomicU64::new(0),
            bytes_read: AtomicU64::new(0),
            behind,
            identity,
            watched,
        })
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.layout.shape[0]
    }

    /// Wavelengths in nm, if the header tells them with their unit.
    pub fn wavelengths_nm(&self) -> Option<&[f64]> {
        self.wavelengths_nm.as_deref()
    }

    /// Takes other wavelengths than the header's.
    ///
    /// # Errors
    /// [`ChartError::Header`] if they are not one a band.
    pub fn with_wavelengths(mut self, nm: Vec<f64>) -> Result<Self, ChartError> {
        if nm.len() != self.bands() {
            let (expected, found) = (format!("{}, one a band", self.bands()), nm.len().to_string());
            return Err(header(&self.path, "number of wavelengths", expected, found));
        }
        check_wavelengths(&self.path, Some(&nm))?;
        self.identity.0["wavelengths_nm"] = json!(nm);
        self.wavelengths_nm = Some(nm);
        Ok(self)
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// How its samples lie.
    pub fn layout(&self) -> &RasterLayout {
        &self.layout
    }

    /// What the user should know of how its header is understood, a line each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Makes values beyond `largest` in magnitude an error, where [`MAX_VALUE`](super::MAX_VALUE) is too much.
    pub fn limit_values(&mut self, largest: f32) {
        self.values.largest = largest;
    }

    /// What it is (all that its values follow from, the samples excepted), and when its data were last changed.
    ///
    /// # Errors
    /// [`ChartError::Changed`] if its files are not what they were when it was opened.
    pub fn identity(&self) -> Result<(Value, Value), ChartError> {
        self.watched.iter().try_for_each(Watched::unchanged)?;
        Ok(self.identity.clone())
    }

    /// Bytes of samples read so far; pixels read as 0 for not being finite.
    pub fn stats(&self) -> (u64, u64) {
        (self.bytes_read.load(Relaxed), self.replaced.load(Relaxed))
    }

    /// Whether reading band after band would fetch the same pages again and again.
    pub fn must_be_laid_out(&self) -> bool {
        let line = (self.layout.shape[2] * self.layout.sample.bytes()) as u64;
        self.bands() > 1
            && match self.layout.interleave {
                Interleave::Bsq => false,
                Interleave::Bil => line < LONG_LINE,
                Interleave::Bip => true,
            }
    }

    /// Lays `bands` out one after the other in a temporary file in `directory`, which has no name and is gone with the chart;
    /// bands keep their numbers, and those not asked for cannot be read from then on. `progress` is told rows done and rows
    /// in all.
    ///
    /// # Errors
    /// [`ChartError::Space`] before anything is written; [`ChartError`] if samples cannot be read, the file not written.
    pub fn in_bands(
        &mut self,
        bands: &[usize],
        directory: &Path,
        progress: &dyn Fn(u64, u64),
    ) -> Result<(), ChartError> {
        let [all, rows, columns] = self.layout.shape;
        let laid = BandFile::create(directory, &self.path, bands, [all, rows, columns])?;
        // A few megabytes of every band at a time, so that both files are walked in long pieces.
        let at_once = ((4 << 20) / (columns * 4)).clamp(1, rows);
        let mut block = vec![0.0f32; at_once * columns];
        for first in (0..rows).step_by(at_once) {
            let height = at_once.min(rows - first);
            let rect = Rect::new(first as i64, 0, height, columns);
            for &band in laid.bands() {
                let pixels = &mut block[..height * columns];
                self.read_rect(band, rect, pixels)?;
                laid.write(band, first, 0, pixels)?;
            }
            progress((first + height) as u64, rows as u64);
        }
        self.layout = laid.layout();
        (self.map, self.slots) = laid.map()?;
        // They are values now.
        self.values = Values { largest: self.values.largest, ..Values::default() };
        Ok(())
    }

    /// A chart of samples laid out in bands, which were read from `path`.
    pub(super) fn laid_out(
        path: &Path,
        laid: BandFile,
        nan: NanPolicy,
        wavelengths_nm: Option<Vec<f64>>,
        largest: f32,
    ) -> Result<Self, ChartError> {
        let layout = laid.layout();
        let (map, slots) = laid.map()?;
        Ok(Self {
            path: path.into(),
            map,
            slots,
            nan,
            wavelengths_nm,
            values: Values { largest, ..Values::default() },
            notes: Vec::new(),
            replaced: AtomicU64::new(0),
            bytes_read: AtomicU64::new(0),
            behind: (0..layout.shape[0]).map(|_| AtomicUsize::new(0)).collect(),
            layout,
            identity: (Value::Null, Value::Null),
            watched: Vec::new(),
        })
    }
}

impl RasterChart {
    /// [`ChartSource::read`] with its own error type.
    ///
    /// # Errors
    /// [`ChartError`] if the rectangle is not in the chart, a pixel is not finite, or the file has shrunk.
    pub fn read_rect(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), ChartError> {
        let size = ChartSource::size(self);
        let slot = self.slots.get(band).copied().flatten();
        let Some(slot) = slot.filter(|_| size.rect().contains(rect) && out.len() == rect.size().pixels())
        else {
            return Err(ChartError::Request {
                path: self.path.clone(),
                band,
                rect,
                room: out.len(),
                bands: self.bands(),
                size,
            });
        };
        let (mut replaced, mut error) = (0, None);
        for (y, line) in (rect.y as usize..).zip(out.chunks_exact_mut(rect.width.max(1))) {
            let (first, step) = self.place(slot, y, rect.x as usize);
            let bytes = self.map.bytes(first, (rect.width - 1) * step + self.layout.sample.bytes());
            let layout = &self.layout;
            match self.values.are_raw() {
                true => samples::convert(layout, bytes, step, line),
                false => samples::convert_by(layout, bytes, step, line, self.values.of_raw(band)),
            }
            let checked =
                self.values.check(band, line, |k| samples::raw(layout, &bytes[k * step..]), self.nan);
            replaced += checked.replaced;
            if let Some((column, unusable)) = checked.error {
                let place = (band, y, rect.x as usize + column);
                error.get_or_insert(unusable.at(self.path.clone(), place, self.values.largest));
            }
        }
        if self.map.is_torn() {
            let found = self.map.length().map_err(|e| DurableError::io("look up", &self.path, 0, e))?;
            let expected = self.map.expected();
            if found >= expected {
                let reason =
                    "the system could not read a page of it (I/O error, or it was cut short for a while)"
                        .into();
                return Err(ChartError::Damaged { path: self.path.clone(), reason });
            }
            return Err(ChartError::Short { path: self.path.clone(), expected, found });
        }
        // Afterwards, so that what was read is of the file that the identity is of.
        self.watched.iter().try_for_each(Watched::unchanged)?;
        if let Some(error) = error {
            return Err(error);
        }
        self.replaced.fetch_add(replaced, Relaxed);
        self.bytes_read.fetch_add((rect.size().pixels() * self.layout.sample.bytes()) as u64, Relaxed);
        self.give_back(slot, rect.y as usize);
        Ok(())
    }

    /// Offset of a sample, and bytes from one column to the next.
    fn place(&self, slot: usize, row: usize, column: usize) -> (usize, usize) {
        let [bands, rows, columns] = self.layout.shape;
        let n = self.layout.sample.bytes();
        let (sample, step) = match self.layout.interleave {
            Interleave::Bsq => ((slot * rows + row) * columns + column, 1),
            Interleave::Bil => ((row * bands + slot) * columns + column, 1),
            Interleave::Bip => ((row * columns + column) * bands + slot, bands),
        };
        (self.layout.offset as usize + sample * n, step * n)
    }

    /// Gives back the pages of a band well above `row`, once there are enough of them.
    fn give_back(&self, slot: usize, row: usize) {
        let behind = &self.behind[slot];
        let (done, end) = (behind.load(Relaxed), row.saturating_sub(KEPT_ROWS));
        if end < done + KEPT_ROWS / 4 || self.layout.interleave == Interleave::Bip {
            return;
        }
        if behind.compare_exchange(done, end, Relaxed, Relaxed).is_ok() {
            let (first, _) = self.place(slot, done, 0);
            let (last, _) = self.place(slot, end, 0);
            self.map.give_back(first, last - first);
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
        if let Some(slot) = self.slots.get(band).copied().flatten().filter(|_| !rect.is_empty()) {
            for row in rect.y as usize..rect.bottom() as usize {
                let (first, step) = self.place(slot, row, rect.x as usize);
                self.map.will_read(first, rect.width * step);
            }
        }
    }
}

fn samples_bytes(layout: &RasterLayout) -> Option<u64> {
    let count = layout.shape.iter().try_fold(1u64, |n, &d| n.checked_mul(d as u64))?;
    count.checked_mul(layout.sample.bytes() as u64)
}

/// Wavelengths of a header or of the caller within their bounds.
pub(super) fn check_wavelengths(path: &Path, nm: Option<&[f64]>) -> Result<(), ChartError> {
    bounds::WAVELENGTH_NM.check_all(nm.unwrap_or_default()).map_err(|(band, e)| {
        header(path, e.bound.name, e.bound.to_string(), format!("{} for band {band}", e.found))
    })
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

fn is_npy(path: &Path) -> bool {
    has_extension(path, "npy")
}

fn is_header(path: &Path) -> bool {
    has_extension(path, "hdr")
}

fn open(path: &Path) -> Result<File, ChartError> {
    match File::open(path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Err(ChartError::NotFound { path: path.into() }),
        other => Ok(other.map_err(|e| DurableError::io("open", path, 0, e))?),
    }
}

fn header(
    path: &Path,
    what: &'static str,
    expected: impl Into<String>,
    found: impl Into<String>,
) -> ChartError {
    ChartError::Header { path: path.into(), what, expected: expected.into(), found: found.into() }
}

#[cfg(test)]
mod tests;
