//! A temporary file of bands in BSQ order: f32, native byte order.
//!
//! Charts that are stored otherwise (interleaved, compressed, in tiles) are written to it once, in any order, and then mapped.

use std::path::Path;

use super::layout::{Interleave, RasterLayout};
use super::mapped::MappedFile;
use crate::chart::error::ChartError;
use crate::chart::temp_file::TempFile;
use crate::durable::DurableError;
use crate::sample::{RasterSample, Sample};

/// The file while it is written.
#[derive(Debug)]
pub(in crate::chart) struct BandFile {
    file: TempFile,
    /// Bands in the file, ascending.
    bands: Vec<usize>,
    shape: [usize; 3],
}

impl BandFile {
    /// Creates a file in `directory` for `bands` of `chart`, which has `shape`.
    pub(in crate::chart) fn create(
        directory: &Path,
        chart: &Path,
        bands: &[usize],
        shape: [usize; 3],
    ) -> Result<Self, ChartError> {
        let mut bands: Vec<usize> = bands.iter().copied().filter(|b| *b < shape[0]).collect();
        bands.sort_unstable();
        bands.dedup();
        let bytes = bands.len() as u64 * shape[1] as u64 * shape[2] as u64 * 4;
        let file = TempFile::create(directory, chart, bytes)?;
        file.file.set_len(bytes).map_err(|e| DurableError::io("write", &file.path, bytes, e))?;
        Ok(Self { file, bands, shape })
    }

    /// The bands in the file.
    pub(in crate::chart) fn bands(&self) -> &[usize] {
        &self.bands
    }

    /// Whether `band` is in the file.
    pub(in crate::chart) fn contains(&self, band: usize) -> bool {
        self.bands.binary_search(&band).is_ok()
    }

    /// Writes pixels from (`row`, `column`) on: complete rows, or part of one. Bands that are not in the file are ignored.
    pub(in crate::chart) fn write(
        &self,
        band: usize,
        row: usize,
        column: usize,
        pixels: &[f32],
    ) -> Result<(), DurableError> {
        let Ok(entry) = self.bands.binary_search(&band) else { return Ok(()) };
        let offset = ((entry * self.shape[1] + row) * self.shape[2] + column) * 4;
        self.file.write(offset as u64, pixels)
    }

    /// Layout of the file.
    pub(super) fn layout(&self) -> RasterLayout {
        RasterLayout {
            shape: self.shape,
            interleave: Interleave::Bsq,
            sample: RasterSample::Plain(Sample::F32),
            little_endian: cfg!(target_endian = "little"),
            offset: 0,
        }
    }

    /// Maps the file; the second result is the position of each band of the chart.
    pub(super) fn map(self) -> Result<(MappedFile, Vec<Option<usize>>), DurableError> {
        let length = (self.bands.len() * self.shape[1] * self.shape[2] * 4) as u64;
        let entries = (0..self.shape[0]).map(|b| self.bands.binary_search(&b).ok()).collect();
        let TempFile { file, path } = self.file;
        let map = MappedFile::new(file, length).map_err(|e| DurableError::io("map", &path, length, e))?;
        Ok((map, entries))
    }
}
