//! Charts whose bands are decoded once, by several threads, to a temporary file from which they are read: pictures, TIFF, OpenEXR, chunked
//! arrays of HDF5.
//!
//! A [`BandDecoder`] gives the stored samples of the requested bands. Integers all of which are valid are stored as they are, and converted when
//! they are read; other samples are converted to values and checked here. Other bands that lie in the same parts of a file are neither
//! converted nor checked.

use std::fmt::Debug;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, OnceLock};

use pipeline::bounds;
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use serde_json::{Value, json};

use super::error::ChartError;
use super::file_change::WatchedFile;
use super::header::{FileArray, check_declared_wavelengths, check_wavelengths, header_error};
use super::memory::ChunkMemory;
use super::options::NanPolicy;
use super::raster::RasterChart;
use super::raster::bands::BandFile;
use super::values::Values;
use crate::parallel::Progress;
use crate::sample::{RasterSample, Sample};

/// Samples that are converted and checked at a time.
const BLOCK_SAMPLES: usize = 16 << 10;

/// Receives samples in native byte order: (path of their file, band, row, column, samples). They are complete rows, or part of one.
pub(super) type Sink<'a> = &'a (dyn Fn(&Path, usize, usize, usize, &[u8]) -> Result<(), ChartError> + Sync);

/// Decoder of the files of a chart.
pub(super) trait BandDecoder: Debug + Send + Sync {
    /// Gives every sample of `bands` (ascending) to `sink` once, from `threads` threads, in any order; those of other bands may be given as
    /// well. `progress` receives the numbers of parts done and in total.
    fn decode(
        &self,
        bands: &[usize],
        threads: usize,
        progress: Progress<'_>,
        sink: Sink<'_>,
    ) -> Result<(), ChartError>;

    /// Bytes of memory that a thread needs.
    fn thread_bytes(&self) -> usize;
}

/// What a file declares about a chart.
#[derive(Debug)]
pub(super) struct Declared {
    /// Path of the file or folder, or the pattern.
    pub(super) path: PathBuf,
    pub(super) size: Size,
    pub(super) bands: usize,
    pub(super) sample: RasterSample,
    pub(super) wavelengths_nm: Option<Vec<f64>>,
    pub(super) values: Values,
    pub(super) units: Option<String>,
    /// The array, if the file has several.
    pub(super) array: Option<FileArray>,
    /// Remarks for the user, one line each.
    pub(super) notes: Vec<String>,
    /// What determines the samples, for the chart's identity.
    pub(super) content: Value,
    /// Modification times.
    pub(super) mtimes: Value,
    pub(super) files: Vec<WatchedFile>,
    pub(super) nan: NanPolicy,
}

/// A chart whose bands are decoded to a temporary file.
#[derive(Debug)]
pub struct DecodedChart {
    declared: Declared,
    decoder: Box<dyn BandDecoder>,
    identity: (Value, Value),
    replaced: AtomicU64,
    /// Decoded bands, see [`DecodedChart::copy_bands`].
    copy: OnceLock<RasterChart>,
    /// Held while bands are decoded.
    decoding: Mutex<()>,
}

impl DecodedChart {
    /// A chart as `declared`, decoded by `decoder`.
    pub(super) fn new(declared: Declared, decoder: Box<dyn BandDecoder>) -> Result<Self, ChartError> {
        let path = &declared.path;
        if let Err(e) = bounds::chart_size(declared.bands, declared.size) {
            return Err(header_error(path, e.bound.name, e.bound.to_string(), e.found));
        }
        check_wavelengths(path, declared.wavelengths_nm.as_deref().unwrap_or_default())?;
        let mut content = declared.content.clone();
        content["wavelengths_nm"] = json!(declared.wavelengths_nm);
        content["values"] = declared.values.identity();
        let identity = (content, declared.mtimes.clone());
        let (copy, decoding) = (OnceLock::new(), Mutex::new(()));
        Ok(Self { declared, decoder, identity, replaced: AtomicU64::new(0), copy, decoding })
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.declared.bands
    }

    /// Path of the file or folder, or the pattern.
    pub fn path(&self) -> &Path {
        &self.declared.path
    }

    /// Sample type of the files.
    pub fn sample(&self) -> RasterSample {
        self.declared.sample
    }

    /// Wavelengths in nm, if names or metadata contain them.
    pub fn wavelengths_nm(&self) -> Option<&[f64]> {
        self.declared.wavelengths_nm.as_deref()
    }

    /// Replaces the wavelengths.
    ///
    /// # Errors
    /// [`ChartError::Header`] unless there is one per band, each within its bounds.
    pub fn with_wavelengths(mut self, nm: Vec<f64>) -> Result<Self, ChartError> {
        check_declared_wavelengths(self.path(), self.bands(), &nm)?;
        self.identity.0["wavelengths_nm"] = json!(nm);
        self.declared.wavelengths_nm = Some(nm);
        Ok(self)
    }

    /// Multiplies all values by `scale`. To be called before [`DecodedChart::copy_bands`].
    #[must_use]
    pub fn with_scale(mut self, scale: f64) -> Self {
        self.declared.values.multiply(scale);
        self.identity.0["values"] = self.declared.values.identity();
        self
    }

    /// Whether its values are its samples times a factor, or plus an offset.
    pub fn is_scaled(&self) -> bool {
        !self.declared.values.scaling.is_empty()
    }

    /// Unit of the values: that of the metadata, or `counts` for unscaled integers.
    pub fn units(&self) -> Option<&str> {
        let is_count = self.sample().is_integer() && !self.is_scaled();
        self.declared.units.as_deref().or(is_count.then_some("counts"))
    }

    /// Its array, if the file has several.
    pub fn array(&self) -> Option<&FileArray> {
        self.declared.array.as_ref()
    }

    /// Whether several files are one band each.
    pub fn is_set(&self) -> bool {
        self.declared.files.len() > 1
    }

    /// Remarks for the user, one line each.
    pub fn notes(&self) -> &[String] {
        &self.declared.notes
    }

    /// Makes values beyond `max_magnitude` an error, instead of those beyond [`MAX_VALUE`](super::MAX_VALUE). To be called before
    /// [`DecodedChart::copy_bands`].
    pub fn limit_values(&mut self, max_magnitude: f32) {
        self.declared.values.max_magnitude = max_magnitude;
    }

    /// Everything that determines its values except the samples, and the modification times of the files.
    ///
    /// # Errors
    /// [`ChartError::Changed`] if a file changed after it was opened.
    pub fn identity(&self) -> Result<(Value, Value), ChartError> {
        self.check_unchanged()?;
        Ok(self.identity.clone())
    }

    pub(super) fn files(&self) -> &[WatchedFile] {
        &self.declared.files
    }

    fn check_unchanged(&self) -> Result<(), ChartError> {
        self.declared.files.iter().try_for_each(WatchedFile::check_unchanged)
    }

    /// Sample type of the temporary file of [`DecodedChart::copy_bands`].
    pub fn copied_sample(&self) -> RasterSample {
        let Declared { sample, values, .. } = &self.declared;
        match sample.is_integer() && !values.declares_no_data() {
            true => *sample,
            false => RasterSample::Plain(Sample::F32),
        }
    }

    /// Bytes of samples read so far, and pixels without data of the decoded bands that were read as 0.
    pub fn stats(&self) -> (u64, u64) {
        let (bytes, replaced) = self.copy.get().map_or((0, 0), RasterChart::stats);
        (bytes, replaced + self.replaced.load(Relaxed))
    }

    /// Memory of a thread while the bands are written to a temporary file.
    pub fn chunk_memory(&self) -> ChunkMemory {
        let converted = size_of::<f32>() * BLOCK_SAMPLES;
        ChunkMemory { rechunking: converted + self.decoder.thread_bytes(), ..ChunkMemory::default() }
    }

    /// Decodes `bands` on `threads` threads to a temporary file in `directory`, from which they are read from then on; other bands can no
    /// longer be read. `progress` receives the numbers of parts done and in total. A second call does nothing.
    ///
    /// # Errors
    /// [`ChartError::Space`] before anything is written; [`ChartError`] if a file does not decode, changed, or has an invalid value in
    /// one of these bands.
    pub fn copy_bands(
        &self,
        bands: &[usize],
        directory: &Path,
        threads: usize,
        progress: Progress<'_>,
    ) -> Result<(), ChartError> {
        let _decoding = self.decoding.lock().expect("no panic while decoding");
        if self.copy.get().is_some() {
            return Ok(());
        }
        let Declared { size, values, nan, .. } = &self.declared;
        let shape = [self.bands(), size.height, size.width];
        let is_stored_as_is = self.copied_sample().is_integer();
        let out = BandFile::create(directory, self.path(), bands, shape, self.copied_sample())?;
        let sink = |file: &Path, band: usize, row: usize, column: usize, samples: &[u8]| match is_stored_as_is
        {
            true => Ok(out.write_samples(band, (row, column), samples)?),
            false => self.store(&out, file, band, (row, column), samples),
        };
        let decoded = self.decoder.decode(out.bands(), threads, progress, &sink);
        self.check_unchanged()?;
        decoded?;
        let nm = self.declared.wavelengths_nm.clone();
        let values = match is_stored_as_is {
            true => values.clone(),
            false => Values { max_magnitude: values.max_magnitude, ..Values::default() },
        };
        let _ = self.copy.set(RasterChart::from_band_file(self.path(), out, *nan, nm, values)?);
        Ok(())
    }

    /// Converts, checks and writes samples of a band from (row, column) on; those of a band that is not requested are ignored.
    fn store(
        &self,
        out: &BandFile,
        file: &Path,
        band: usize,
        (row, column): (usize, usize),
        samples: &[u8],
    ) -> Result<(), ChartError> {
        if !out.contains(band) {
            return Ok(());
        }
        if !out.contains(band) {
            return Ok(());
        }
        let Declared { size, sample, values, nan, .. } = &self.declared;
        let at = |k: usize| (row + (column + k) / size.width, (column + k) % size.width);
        let mut pixels = Vec::with_capacity(BLOCK_SAMPLES);
        for (first, samples) in
            (0..).step_by(BLOCK_SAMPLES).zip(samples.chunks(BLOCK_SAMPLES * sample.bytes()))
        {
            pixels.clear();
            match values.is_identity() {
                true => sample.append(&mut pixels, samples),
                false => sample.append_converted(&mut pixels, samples, values.converter(band)),
            }
            let checked = values.check(band, &mut pixels, |k| sample.read(samples, k), *nan);
            if let Some((k, invalid)) = checked.error {
                let (row, column) = at(first + k);
                return Err(invalid.into_error(file.into(), (band, row, column), values.max_magnitude));
            }
            self.replaced.fetch_add(checked.replaced, Relaxed);
            let (row, column) = at(first);
            out.write(band, row, column, &pixels)?;
        }
        Ok(())
    }

    /// [`ChartSource::read`] with its own error type.
    ///
    /// # Errors
    /// [`ChartError`] if a file does not decode, or as [`RasterChart::read_rect`].
    pub fn read_rect(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), ChartError> {
        if self.copy.get().is_none() {
            let all: Vec<usize> = (0..self.bands()).collect();
            self.copy_bands(&all, &std::env::temp_dir(), 1, &|_, _| ())?;
        }
        self.copy.get().expect("decoded above").read_rect(band, rect, out)
    }
}

impl ChartSource for DecodedChart {
    fn size(&self) -> Size {
        self.declared.size
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        Ok(self.read_rect(band, rect, out)?)
    }

    fn prefetch(&self, band: usize, rect: Rect) {
        if let Some(copy) = self.copy.get() {
            copy.prefetch(band, rect);
        }
    }
}
