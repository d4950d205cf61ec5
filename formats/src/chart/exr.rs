//! Charts in OpenEXR files: channels of the spectral layout, or R, G, B (or Y) as an image.
//!
//! Spectral layout (Fichet, Pacanowski, Wilkie, JCGT 10(3), 2021): `S0.400,000000nm` (emissive) or `T.400,000000nm`
//! (reflective), wavelengths in nm, µm or m, with a decimal comma or point. R, G, B (a preview) and S1 to S3 (polarisation) beside
//! them are ignored. One layer, f16 or f32, scan lines or tiles, every compression of the `exr` crate.
//!
//! Samples are compressed and bands interleave line by line, so the file is decoded once to a temporary file
//! ([`ExrChart::copy_bands`]); a read before that call decodes all bands to the system's temporary directory. Sizes that a header
//! declares are compared with the file's length and with a limit per block before memory is allocated; a decoder that panics is an
//! error of the file. Not supported: several layers, deep data, subsampled channels, bispectral images.

mod decode;
mod header;

use std::fs::File;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock};

use ::exr::meta::MetaData;
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use serde_json::{Value, json};

use super::error::ChartError;
use super::file_change::{WatchedFile, modified_ns};
use super::header::{check_declared_wavelengths, check_wavelengths};
use super::options::NanPolicy;
use super::raster::RasterChart;
use super::raster::bands::BandFile;
use super::values::MAX_VALUE;
use crate::durable::DurableError;
pub use header::ExrContent;
use header::{check_header, content, exr_error};

/// A chart in an OpenEXR file.
#[derive(Debug)]
pub struct ExrChart {
    path: PathBuf,
    size: Size,
    block_bytes: usize,
    /// Channel of the file per band.
    channels: Vec<usize>,
    content: ExrContent,
    units: Option<String>,
    alpha: bool,
    wavelengths_nm: Option<Vec<f64>>,
    nan: NanPolicy,
    /// Factor of all values.
    scale: f64,
    max_magnitude: f32,
    identity: (Value, Value),
    file: WatchedFile,
    /// Decoded bands, see [`ExrChart::copy_bands`].
    copy: OnceLock<RasterChart>,
    /// Held while bands are decoded.
    decoding: Mutex<()>,
}

impl ExrChart {
    /// Whether `path` is a file with the extension `exr`.
    pub fn is_supported_path(path: &Path) -> bool {
        path.is_file() && path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"))
    }

    /// Reads the header.
    ///
    /// # Errors
    /// [`ChartError`] if it is no OpenEXR file, or its header is invalid or not supported.
    pub fn open(path: &Path, nan: NanPolicy) -> Result<Self, ChartError> {
        let file = File::open(path).map_err(|e| DurableError::io("open", path, 0, e))?;
        let meta = file.metadata().map_err(|e| DurableError::io("look up", path, 0, e))?;
        let read = || MetaData::read_from_unbuffered(file, false);
        let headers = match catch_unwind(AssertUnwindSafe(read)) {
            Ok(Ok(read)) => read.headers,
            Ok(Err(::exr::error::Error::Io(e))) if e.raw_os_error().is_some() => {
                return Err(DurableError::io("read", path, 0, e).into());
            }
            Ok(Err(e)) => return Err(exr_error(path, "file", "an OpenEXR image", e.to_string())),
            Err(_) => {
                return Err(exr_error(path, "header", "valid attributes", "invalid ones".into()));
            }
        };
        let [header] = &headers[..] else {
            return Err(exr_error(
                path,
                "layers",
                "one; save the file with a single layer",
                headers.len().to_string(),
            ));
        };
        let block_bytes = check_header(path, header, meta.len())?;
        let (content, channels) = content(path, header)?;
        let text = |name: &str| match header.own_attributes.other.iter().find(|(k, _)| *k == name) {
            Some((_, ::exr::meta::attribute::AttributeValue::Text(t))) => Some(t.to_string()),
            _ => None,
        };
        let units = text("emissiveUnits").filter(|u| u != "unknown");
        let wavelengths_nm = match &content {
            ExrContent::Spectral { wavelengths_nm, .. } => Some(wavelengths_nm.clone()),
            _ => None,
        };
        check_wavelengths(path, wavelengths_nm.as_deref().unwrap_or_default())?;
        let size = Size::new(header.layer_size.height(), header.layer_size.width());
        let samples: Vec<_> = channels.iter().map(|&c| header.channels.list[c].sample_type).collect();
        let description = format!(
            "{size}, {channels:?}, {samples:?}, {:?}, {:?}, {content:?}",
            header.compression, header.blocks
        );
        Ok(Self {
            path: path.into(),
            size,
            block_bytes,
            alpha: header.channels.list.iter().any(|c| c.name == *"A"),
            channels,
            content,
            units,
            wavelengths_nm,
            nan,
            scale: 1.0,
            max_magnitude: MAX_VALUE,
            file: WatchedFile::data(path, &meta),
            identity: (json!({ "exr": description, "bytes": meta.len() }), json!(modified_ns(&meta) as u64)),
            copy: OnceLock::new(),
            decoding: Mutex::new(()),
        })
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.channels.len()
    }

    /// Content of the channels.
    pub fn content(&self) -> &ExrContent {
        &self.content
    }

    /// Whether there is an alpha channel.
    pub fn has_alpha(&self) -> bool {
        self.alpha
    }

    /// Size in bytes of the largest decoded block.
    pub fn block_bytes(&self) -> usize {
        self.block_bytes
    }

    /// Unit of the values: attribute `emissiveUnits`.
    pub fn units(&self) -> Option<&str> {
        self.units.as_deref()
    }

    /// Wavelengths in nm.
    pub fn wavelengths_nm(&self) -> Option<&[f64]> {
        self.wavelengths_nm.as_deref()
    }

    /// Replaces the wavelengths of the channels' names.
    ///
    /// # Errors
    /// [`ChartError::Header`] unless there is one per band, each within its bounds.
    pub fn with_wavelengths(mut self, nm: Vec<f64>) -> Result<Self, ChartError> {
        check_declared_wavelengths(&self.path, self.bands(), &nm)?;
        self.identity.0["wavelengths_nm"] = json!(nm);
        self.wavelengths_nm = Some(nm);
        Ok(self)
    }

    /// Multiplies all values by `scale`. To be called before [`ExrChart::copy_bands`].
    #[must_use]
    pub fn with_scale(mut self, scale: f64) -> Self {
        self.scale *= scale;
        if self.scale != 1.0 {
            self.identity.0["scale"] = json!(self.scale);
        }
        self
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Makes values beyond `max_magnitude` an error, instead of those beyond [`MAX_VALUE`]. To be called before
    /// [`ExrChart::copy_bands`].
    pub fn limit_values(&mut self, max_magnitude: f32) {
        self.max_magnitude = max_magnitude;
    }

    /// Everything that determines its values except the samples, and the modification time of the file.
    ///
    /// # Errors
    /// [`ChartError::Changed`] if the file changed after it was opened.
    pub fn identity(&self) -> Result<(Value, Value), ChartError> {
        self.file.check_unchanged()?;
        Ok(self.identity.clone())
    }

    /// Bytes of samples read so far, and pixels without data that were read as 0.
    pub fn stats(&self) -> (u64, u64) {
        self.copy.get().map_or((0, 0), RasterChart::stats)
    }

    /// Decodes `bands` to a temporary file in `directory`, from which they are read from then on; other bands can no longer be read.
    /// `progress` receives the numbers of pixels done and in total. A second call does nothing.
    ///
    /// # Errors
    /// [`ChartError::Space`] before anything is written; [`ChartError`] if a block does not decode or the file cannot be written.
    pub fn copy_bands(
        &self,
        bands: &[usize],
        directory: &Path,
        threads: usize,
        progress: &(dyn Fn(u64, u64) + Sync),
    ) -> Result<(), ChartError> {
        let _decoding = self.decoding.lock().expect("no panic while decoding");
        if self.copy.get().is_some() {
            return Ok(());
        }
        let shape = [self.bands(), self.size.height, self.size.width];
        let out = BandFile::create(directory, &self.path, bands, shape)?;
        let decoded = self.decode(&out, threads, progress);
        self.file.check_unchanged()?;
        decoded?;
        let wavelengths_nm = self.wavelengths_nm.clone();
        let chart =
            RasterChart::from_band_file(&self.path, out, self.nan, wavelengths_nm, self.max_magnitude)?;
        let _ = self.copy.set(chart.with_scale(self.scale));
        Ok(())
    }

    /// [`ChartSource::read`] with its own error type.
    ///
    /// # Errors
    /// [`ChartError`] if the file does not decode, or as [`RasterChart::read_rect`].
    pub fn read_rect(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), ChartError> {
        if self.copy.get().is_none() {
            let all: Vec<usize> = (0..self.bands()).collect();
            self.copy_bands(&all, &std::env::temp_dir(), 1, &|_, _| ())?;
        }
        self.copy.get().expect("decoded above").read_rect(band, rect, out)
    }
}

impl ChartSource for ExrChart {
    fn size(&self) -> Size {
        self.size
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
