//! Re-chunking of charts whose chunks span many bands: read as they are, each chunk would be decoded once per band.

use std::path::Path;

use super::band_chunks::BandChunkFile;
use super::error::ChartError;
use super::store::ChartStore;
use crate::parallel::{self, Progress};

impl ChartStore {
    /// Whether reading `bands` one after the other would decode chunks once per band: several of the bands share chunks, and these
    /// chunks, decoded, do not fit in the cache.
    pub fn rechunk_needed(&self, bands: &[usize]) -> bool {
        let per = self.layout.chunk_shape[0];
        let mut groups: Vec<usize> = bands.iter().map(|b| b / per).collect();
        groups.sort_unstable();
        let shared = groups.windows(2).any(|g| g[0] == g[1]);
        groups.dedup();
        let decoded = groups.len().saturating_mul(per.min(self.bands()));
        let decoded = decoded.saturating_mul(self.layout.size().pixels()).saturating_mul(4);
        self.band_chunks.get().is_none() && shared && decoded > self.cache.limit()
    }

    /// Decodes `bands` once, on `threads` threads that hold one chunk each, into a temporary file in `directory`, from which they are
    /// read from then on. `progress` receives the numbers of chunks done and in total. A second call does nothing.
    ///
    /// # Errors
    /// [`ChartError::Space`] before anything is written; [`ChartError`] if a chunk cannot be read or the file cannot be written.
    pub fn rechunk(
        &self,
        bands: &[usize],
        directory: &Path,
        threads: usize,
        progress: Progress<'_>,
    ) -> Result<(), ChartError> {
        if self.band_chunks.get().is_some() {
            return Ok(());
        }
        let mut bands: Vec<usize> = bands.iter().copied().filter(|b| *b < self.bands()).collect();
        bands.sort_unstable();
        bands.dedup();
        let file = BandChunkFile::create(directory, &bands, &self.layout, &self.array_path())?;
        let [groups, down, across] = self.layout.chunk_counts();
        let mut bands_of = vec![Vec::new(); groups];
        for band in bands {
            bands_of[band / self.layout.chunk_shape[0]].push(band);
        }
        let groups: Vec<usize> = (0..groups).filter(|g| !bands_of[*g].is_empty()).collect();
        let total = groups.len() * down * across;
        parallel::for_each::<ChartError>(threads, total, progress, |n| {
            let (group, i, j) = (groups[n / (down * across)], n / across % down, n % across);
            self.write_bands(&file, [group, i, j], &bands_of[group])
        })?;
        // Of two concurrent calls, which write equal files, the first is kept.
        let _ = self.band_chunks.set(file);
        Ok(())
    }

    /// Writes `bands` of a chunk to `file`.
    fn write_bands(
        &self,
        file: &BandChunkFile,
        chunk_index: [usize; 3],
        bands: &[usize],
    ) -> Result<(), ChartError> {
        let chunk = self.load(chunk_index)?;
        let pixels = chunk.rect.size().pixels();
        for &band in bands {
            self.check(chunk_index, &chunk, band)?;
            let start = (band - chunk.bands.start) * pixels;
            if chunk.data.is_empty() {
                file.write(band, [chunk_index[1], chunk_index[2]], &vec![chunk.fill; pixels])?;
            } else {
                file.write(band, [chunk_index[1], chunk_index[2]], &chunk.data[start..start + pixels])?;
            }
        }
        Ok(())
    }
}
