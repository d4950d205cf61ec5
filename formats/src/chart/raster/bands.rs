//! A temporary file of bands in BSQ order, native byte order.
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
    sample: RasterSample,
}

impl BandFile {
    /// Creates a file in `directory` for samples of `bands` of `chart`, which has `shape`.
    pub(in crate::chart) fn create(
        directory: &Path,
        chart: &Path,
        bands: &[usize],
        shape: [usize; 3],
        sample: RasterSample,
    ) -> Result<Self, ChartError> {
        let mut bands: Vec<usize> = bands.iter().copied().filter(|b| *b < shape[0]).collect();
        bands.sort_unstable();
        bands.dedup();
        let bytes = (bands.len() * sample.bytes()) as u64 * shape[1] as u64 * shape[2] as u64;
        let file = TempFile::create(directory, chart, bytes)?;
        file.file.set_len(bytes).map_err(|e| DurableError::io("write", &file.path, bytes, e))?;
        Ok(Self { file, bands, shape, sample })
    }

    /// The bands in the file.
    pub(in crate::chart) fn bands(&self) -> &[usize] {
        &self.bands
    }

    /// Whether `band` is in the file.
    pub(in crate::chart) fn contains(&self, band: usize) -> bool {
        self.bands.binary_search(&band).is_ok()
    }

    /// Writes f32 values from (`row`, `column`) on: complete rows, or part of one. Bands that are not in the file are ignored.
    pub(in crate::chart) fn write(
        &self,
        band: usize,
        row: usize,
        column: usize,
        pixels: &[f32],
    ) -> Result<(), DurableError> {
        debug_assert_eq!(self.sample, RasterSample::Plain(Sample::F32));
        self.write_samples(band, (row, column), bytemuck::cast_slice(pixels))
    }

    /// As [`BandFile::write`], of samples in native byte order.
    pub(in crate::chart) fn write_samples(
        &self,
        band: usize,
        (row, column): (usize, usize),
        samples: &[u8],
    ) -> Result<(), DurableError> {
        let Ok(entry) = self.bands.binary_search(&band) else { return Ok(()) };
        let offset = ((entry * self.shape[1] + row) * self.shape[2] + column) * self.sample.bytes();
        self.file.write(offset as u64, samples)
    }

    /// Layout of the file.
    pub(super) fn layout(&self) -> RasterLayout {
        RasterLayout {
            shape: self.shape,
            interleave: Interleave::Bsq,
            sample: self.sample,
            little_endian: cfg!(target_endian = "little"),
            offset: 0,
        }
    }

    /// Maps the file; the second result is the position of each band of the chart.
    pub(super) fn map(self) -> Result<(MappedFile, Vec<Option<usize>>), DurableError> {
        let length = (self.bands.len() * self.shape[1] * self.shape[2] * self.sample.bytes()) as u64;
        let entries = (0..self.shape[0]).map(|b| self.bands.binary_search(&b).ok()).collect();
        let TempFile { file, path } = self.file;
        let map = MappedFile::new(file, length).map_err(|e| DurableError::io("map", &path, length, e))?;
        Ok((map, entries))
    }
}
