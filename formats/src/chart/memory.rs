//! Memory of reading charts, bytes; and the size of the chunk cache, once the memory of a run is planned.

use super::cache::Cache;
use super::read_ahead::ReadAhead;
use super::store::ChartStore;
use crate::durable::Store;

/// Chunks read ahead per thread: those of the tiles that a thread announces before it reads them, and as many again that are being read.
const CHUNKS_READ_AHEAD: usize = 8;
/// Maximum of the bytes read ahead: a chart of large chunks is read without.
const MAX_READ_AHEAD: u64 = 64 << 20;

/// Memory of decoding the chunks of a chart, bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChunkMemory {
    /// Chunks of a band.
    pub count: usize,
    /// Encoded and decoded bytes of a chunk while it is decoded.
    pub decoding: usize,
    /// A decoded chunk as f32.
    pub values: usize,
    /// Encoded chunks that are read ahead.
    pub read_ahead: usize,
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
                read_ahead: 0,
                rechunking: 2 * encoded + values + one_band,
            },
            false => {
                let read_ahead = self.read_ahead.as_ref().map_or(0, |ahead| ahead.bytes() as usize);
                ChunkMemory { count, decoding: 2 * encoded, values, read_ahead, rechunking: 0 }
            }
        }
    }

    /// Reads the chunks of `bands` past the page cache, with read-ahead for `threads` threads, if the page cache could not keep these
    /// bands for another run: they hold more than half of the `memory` of the machine, bytes. To be called before the first read.
    pub fn read_past_page_cache(&mut self, bands: &[usize], threads: usize, memory: u64) {
        let chunk: u64 =
            self.chunk_shape().iter().map(|&n| n as u64).product::<u64>() * self.sample().bytes() as u64;
        let all = (bands.len() * self.size().pixels() * self.sample().bytes()) as u64;
        let is_remote = matches!(&*self.layout.store, Store::Objects(_));
        // Chunks of several bands are read once, and sorted into a temporary file.
        if is_remote || all <= memory / 2 || self.chunk_shape()[0] > 1 {
            return;
        }
        let limit = chunk.saturating_mul((CHUNKS_READ_AHEAD * threads) as u64).min(MAX_READ_AHEAD);
        self.read_ahead = Some(ReadAhead::new(self.layout.store.clone(), limit));
    }

    /// Keeps at most `bytes` of decoded chunks from now on; what is cached is dropped.
    pub fn set_cache_bytes(&mut self, bytes: usize) {
        self.cache = Cache::new(bytes);
    }
}
