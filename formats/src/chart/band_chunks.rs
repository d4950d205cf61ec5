//! Temporary file of the decoded chunks of single bands, of a chart whose chunks span many bands.
//!
//! Chunk (i, j) of band b lies at ((entry of b · chunk rows + i) · chunk columns + j) · size of the largest chunk; samples are f32.

use std::path::Path;

use super::error::ChartError;
use super::layout::Layout;
use super::temp_file::TempFile;
use crate::durable::DurableError;

#[derive(Debug)]
pub(super) struct BandChunkFile {
    file: TempFile,
    /// Entry of each band of the chart.
    entries: Vec<Option<usize>>,
    /// Chunk rows and columns.
    grid: [usize; 2],
    /// Pixels of the largest chunk of one band.
    pixels: usize,
}

impl BandChunkFile {
    /// An empty file for `bands` of the array `chart`.
    pub(super) fn create(
        directory: &Path,
        bands: &[usize],
        layout: &Layout,
        chart: &Path,
    ) -> Result<Self, ChartError> {
        let [_, down, across] = layout.chunk_counts();
        let [_, rows, columns] = layout.chunk_shape;
        let size = layout.size();
        let pixels = rows.min(size.height) * columns.min(size.width);
        let bytes = (bands.len() * down * across) as u64 * (pixels * 4) as u64;
        let file = TempFile::create(directory, chart, bytes)?;
        let mut entries = vec![None; layout.shape[0]];
        for (entry, &band) in bands.iter().enumerate() {
            entries[band] = Some(entry);
        }
        Ok(Self { file, entries, grid: [down, across], pixels })
    }

    pub(super) fn contains(&self, band: usize) -> bool {
        self.entries[band].is_some()
    }

    fn offset(&self, band: usize, [i, j]: [usize; 2]) -> u64 {
        let entry = self.entries[band].expect("the caller checks `contains`");
        (((entry * self.grid[0] + i) * self.grid[1] + j) * self.pixels * 4) as u64
    }

    pub(super) fn write(&self, band: usize, chunk: [usize; 2], data: &[f32]) -> Result<(), DurableError> {
        self.file.write(self.offset(band, chunk), bytemuck::cast_slice(data))
    }

    pub(super) fn read(
        &self,
        band: usize,
        chunk: [usize; 2],
        pixels: usize,
    ) -> Result<Vec<f32>, DurableError> {
        self.file.read(self.offset(band, chunk), pixels)
    }
}
