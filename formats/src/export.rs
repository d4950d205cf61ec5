//! Export of films and charts to files for other programs, with unchanged samples.
//!
//! | file | samples | order in the file |
//! |---|---|---|
//! | spectral OpenEXR ([`exr`]) | f32, or f16 | tiles, in each line of a tile all bands |
//! | BigTIFF ([`tiff`]) | f32, one plane a band | band by band, line by line |
//! | ENVI, NPY ([`flat`]) | f32 | band by band, line by line |
//!
//! Pitch and origin, where the pitch is known: TIFF's resolution and position in cm, ENVI's `map info` and `pixel size` in m (GDAL's
//! geotransform), OpenEXR's attributes `pixelPitchUm` and `originPx`. The origin is the upper left corner of the source.
//!
//! f32 files have the source's bits; NaN (missing shards) is kept and counted. Samples are read in the order of the file where possible:
//! band by band in strips of rows that end at chunk edges of the source, or for tiles ([`regions`]) all bands of a region that fits in memory.
//! Files have temporary names until all files of the export are complete ([`crate::durable::AtomicFile`]).

pub mod exr;
pub mod flat;
pub(crate) mod in_order;
pub mod regions;
pub mod tiff;

use std::ops::Range;
use std::path::PathBuf;

use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};

use crate::durable::DurableError;

/// Input of an export.
pub struct Samples<'a> {
    /// Film or chart.
    pub source: &'a dyn ChartSource,
    /// Wavelength of each band of the source in nm.
    pub wavelengths_nm: &'a [f64],
    /// Rectangle of the source to write.
    pub rect: Rect,
    /// Size of the source's compressed chunks; 1 × 1: uncompressed.
    pub chunk: Size,
    /// Unit of the samples.
    pub units: Option<&'a str>,
    /// Pixel pitch in µm, if known.
    pub pitch_um: Option<f64>,
    /// Description for the file's header.
    pub description: &'a str,
    /// Threads that read and encode; the file is the same for any number.
    pub threads: usize,
}

impl Samples<'_> {
    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.wavelengths_nm.len()
    }

    /// Strips of `rect`: the rows of one chunk of the source, but at least 64 and at most 512.
    fn strips(&self) -> Vec<Range<i64>> {
        let (first, end) = (self.rect.y, self.rect.bottom());
        let rows = self.chunk.height.clamp(64, 512) as i64;
        let starts = (first / rows..(end + rows - 1) / rows).map(|i| (i * rows).max(first));
        starts.map(|y| y..((y / rows + 1) * rows).min(end)).collect()
    }

    /// Reads `rect` of `band` into `out` and returns the number of NaN.
    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<u64, ExportError> {
        self.source.read(band, rect, out).map_err(|source| ExportError::Read { band, rect, source })?;
        Ok(out.iter().filter(|v| v.is_nan()).count() as u64)
    }
}

/// Result of an export.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// Bytes of the file.
    pub bytes: u64,
    /// Number of samples that are NaN.
    pub missing: u64,
}

pub use crate::parallel::Progress;

/// Error of an export.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages describe the fields")]
pub enum ExportError {
    /// The source cannot be read.
    #[error("reading band {band}, {rect}: {source}")]
    Read { band: usize, rect: Rect, source: SourceSinkError },
    /// The file cannot be written.
    #[error(transparent)]
    Storage(#[from] DurableError),
    /// The format does not support a property.
    #[error("writing {}: {what}: expected {expected}, found {found}", path.display())]
    Format { path: PathBuf, what: &'static str, expected: String, found: String },
    /// A value out of the range of binary16.
    #[error(
        "writing {}: {value} at band {band}, row {row}, column {column} does not fit 16-bit floats (at most 65504); \
         write 32-bit floats, without --half", path.display()
    )]
    Half { path: PathBuf, band: usize, row: usize, column: usize, value: f32 },
    /// The memory limit is too small.
    #[error(
        "{} bytes of memory are too small: {bands} bands need at least {minimum} on {threads} threads; increase --memory, reduce --threads \
         or --bands, or choose a format that is written band by band (ENVI, NPY, TIFF)",
        given
    )]
    Memory { given: usize, minimum: usize, bands: usize, threads: usize },
}

#[cfg(test)]
mod tests;
