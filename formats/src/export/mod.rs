//! Films and charts as files for other programs: samples as they are, in formats that many programs read.
//!
//! | file | samples | order in the file |
//! |---|---|---|
//! | spectral OpenEXR ([`exr`]) | f32, or f16 | tiles, in each line of a tile all bands |
//! | BigTIFF ([`tiff`]) | f32, one page a band | band by band, line by line |
//! | ENVI, NPY ([`flat`]) | f32 | band by band, line by line |
//!
//! f32 files hold the source's bits, NaN (shards not yet made) included and counted. The order of reading is the order of the
//! file as far as that goes: band by band in strips of what the source decodes at once, or for tiles ([`regions`]) all bands of a
//! region that fits in memory. Whatever is written has a temporary name until all files of the export are complete
//! ([`crate::durable::WholeFile`]).

pub mod exr;
pub mod flat;
mod in_order;
pub mod regions;
pub mod tiff;

use std::ops::Range;
use std::path::PathBuf;

use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};

use crate::durable::DurableError;

/// What is written.
pub struct Samples<'a> {
    /// Where the pixels are.
    pub source: &'a dyn ChartSource,
    /// Wavelength of each band of the source in nm.
    pub wavelengths_nm: &'a [f64],
    /// The part of it to write.
    pub window: Rect,
    /// Rows and columns that the source decodes at once; one pixel: it decodes nothing.
    pub piece: Size,
    /// What the values are.
    pub units: Option<&'a str>,
    /// Words about where they come from, for the file's header.
    pub description: &'a str,
    /// Threads that read and encode; what the file holds is the same for any number.
    pub threads: usize,
}

impl Samples<'_> {
    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.wavelengths_nm.len()
    }

    /// Rows of the window in strips that end where pieces of the source end.
    fn strips(&self) -> Vec<Range<i64>> {
        let (first, end) = (self.window.y, self.window.bottom());
        let rows = self.piece.height.clamp(64, 512) as i64;
        let starts = (first / rows..(end + rows - 1) / rows).map(|i| (i * rows).max(first));
        starts.map(|y| y..((y / rows + 1) * rows).min(end)).collect()
    }

    /// Reads `rect` of `band` into `out`; the number of NaN among them.
    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<u64, ExportError> {
        self.source.read(band, rect, out).map_err(|source| ExportError::Read { band, rect, source })?;
        Ok(out.iter().filter(|v| v.is_nan()).count() as u64)
    }
}

/// What was written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// Bytes of the file.
    pub bytes: u64,
    /// Samples that are NaN.
    pub missing: u64,
}

/// Told how many of how many samples are done.
pub type Progress<'a> = &'a (dyn Fn(u64, u64) + Sync);

/// A file cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The source cannot be read.
    #[error("reading band {band}, {rect}: {source}")]
    Read {
        /// The band.
        band: usize,
        /// The pixels.
        rect: Rect,
        /// The source's own words.
        source: SourceSinkError,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Storage(#[from] DurableError),
    /// The format cannot hold this.
    #[error("writing {}: {what}: expected {expected}, found {found}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Which property.
        what: &'static str,
        /// What the format can hold.
        expected: String,
        /// What there is.
        found: String,
    },
    /// A value beyond half precision.
    #[error(
        "writing {}: {value} at band {band}, row {row}, column {column} does not fit 16-bit floats (at most 65504); \
         write 32-bit floats, without --half", path.display()
    )]
    Half {
        /// The file.
        path: PathBuf,
        /// The band.
        band: usize,
        /// The row.
        row: usize,
        /// The column.
        column: usize,
        /// The value.
        value: f32,
    },
    /// Too little memory for the least that must be held at once.
    #[error(
        "{} bytes of memory cannot work: {bands} bands need at least {least} on {threads} threads; give that much, fewer --threads \
         or fewer --bands, or a format that is written band by band (ENVI, NPY, TIFF)",
        given
    )]
    Memory {
        /// What there is.
        given: usize,
        /// What is needed.
        least: usize,
        /// Bands.
        bands: usize,
        /// Threads.
        threads: usize,
    },
}

#[cfg(test)]
mod tests;
