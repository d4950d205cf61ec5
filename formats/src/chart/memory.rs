//! Memory of reading charts, bytes; and the size of the chunk cache, once the memory of a run is planned.

use super::cache::Cache;
use super::store::ChartStore;

/// Memory of decoding the chunks of a chart, bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChunkMemory {
    /// Chunks of a band.
    pub count: usize,
    /// Encoded and decoded bytes of a chunk while it is decoded.
    pub decoding: usize,
    /// A decoded chunk as f32.
    pub values: usize,
    /// A chunk of several bands while its bands are written to a temporary file; 0 where none are.
    pub rechunking: usize,
}

impl ChartStore {
    /// Memory of a chunk while `bands` are read one after the other.
    pub fn chunk_memory(&self, bands: &[usize]) -> ChunkMemory {
        let ([chunk_bands, rows, columns], size) = (self.chunk_shape(), self.size());
        let bands_inside = chunk_bands.min(self.bands());
        let pixels = rows.min(size.height) * columns.min(size.width);
        let count = size.height.div_ceil(rows) * size.width.div_ceil(columns);
        let encoded = chunk_bands * rows * columns * self.sample().bytes();
        let values = 4 * bands_inside * pixels;
        let one_band = 4 * pixels;
        // From the temporary file one band of a chunk is read, as bytes and then as values; to write it, the complete chunk is held.
        match bands_inside > 1 && bands.len() > 1 {
            true => ChunkMemory {
                count,
                decoding: one_band,
                values: one_band,
                rechunking: 2 * encoded + values + one_band,
            },
            false => ChunkMemory { count, decoding: 2 * encoded, values, rechunking: 0 },
        }
    }

    /// Keeps at most `bytes` of decoded chunks from now on; what is cached is dropped.
    pub fn set_cache_bytes(&mut self, bytes: usize) {
        self.cache = Cache::new(bytes);
    }
}
