//! A chart in a Zarr store: its properties and counters.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, OnceLock};

use pipeline::geometry::Size;
use serde_json::{Map, Value};

use super::band_chunks::BandChunkFile;
use super::cache::Cache;
use super::decoded::DecodedChunk;
use super::file_change::ChunkFileStates;
use super::layout::Layout;
use super::options::ChartOptions;
use super::read_ahead::ReadAhead;
use crate::sample::Sample;

/// Counters of the work done by reading a chart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ReadStats {
    /// Encoded bytes read from the store.
    pub bytes_read: u64,
    /// Chunks decoded; a chunk that is decoded again after it was evicted from the cache counts again.
    pub chunks_decoded: u64,
    /// Time spent decoding and checking, summed over threads, in ns.
    pub decode_ns: u64,
    /// Distinct chunks that are not stored and were read as the fill value.
    pub missing_chunks: u64,
    /// Distinct pixels without data that were read as 0, in bands that were read.
    pub nan_replaced: u64,
}

#[derive(Debug, Default)]
pub(super) struct Counters {
    pub(super) bytes_read: AtomicU64,
    pub(super) chunks_decoded: AtomicU64,
    pub(super) decode_ns: AtomicU64,
    /// Pixels by chunk number, so that a chunk decoded twice counts once.
    pub(super) missing: Mutex<HashMap<u64, u64>>,
    /// Pixels by chunk number and band, of bands that were read.
    pub(super) replaced: Mutex<HashMap<(u64, usize), u64>>,
}

/// A chart in a Zarr store.
#[derive(Debug)]
pub struct ChartStore {
    pub(super) layout: Layout,
    pub(super) options: ChartOptions,
    pub(super) wavelengths_nm: Option<Vec<f64>>,
    pub(super) pitch_um: Option<f64>,
    pub(super) film_size: Option<Size>,
    pub(super) units: Option<String>,
    /// Attributes of the array.
    pub(super) attributes: Map<String, Value>,
    pub(super) light: Option<String>,
    /// Whether chunks of the fill value are left out on purpose: missing ones are not counted.
    pub(super) leaves_out_chunks: bool,
    pub(super) cache: Cache<DecodedChunk>,
    /// Shard indexes; `None`: the shard is missing.
    pub(super) indexes: Cache<Option<Vec<u64>>>,
    pub(super) counters: Counters,
    /// Set by [`ChartStore::rechunk`].
    pub(super) band_chunks: OnceLock<BandChunkFile>,
    /// Set by [`ChartStore::read_past_page_cache`].
    pub(super) read_ahead: Option<ReadAhead>,
    /// Set by [`ChartStore::identity`].
    pub(super) file_states: ChunkFileStates,
}

impl ChartStore {
    /// Chart size in pixels.
    pub fn size(&self) -> Size {
        self.layout.size()
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.layout.shape[0]
    }

    /// Wavelength of each band in nm, if known.
    pub fn wavelengths_nm(&self) -> Option<&[f64]> {
        self.wavelengths_nm.as_deref()
    }

    /// Pixel pitch in µm: attribute `pitch_um`.
    pub fn pitch_um(&self) -> Option<f64> {
        self.pitch_um
    }

    /// Size of the film that the chart is meant for: attribute `film_size`.
    pub fn film_size(&self) -> Option<Size> {
        self.film_size
    }

    /// Unit of the values: attribute `units`.
    pub fn units(&self) -> Option<&str> {
        self.units.as_deref()
    }

    /// Text of the attribute `key` of its array.
    pub fn text_attribute(&self, key: &str) -> Option<&str> {
        self.attributes.get(key).and_then(Value::as_str)
    }

    /// Name of the illuminant of a white: attribute `illuminant`, or that of the drawn chart in the attribute `chart`.
    pub fn light(&self) -> Option<String> {
        self.light.clone()
    }

    /// Sample type in the store.
    pub fn sample(&self) -> Sample {
        self.layout.sample
    }

    /// (bands, rows, columns) of a file of the store: a shard, or a chunk.
    pub fn file_shape(&self) -> [usize; 3] {
        self.layout.file_shape
    }

    /// (bands, rows, columns) of the unit of decoding: an inner chunk, or a chunk.
    pub fn chunk_shape(&self) -> [usize; 3] {
        self.layout.chunk_shape
    }

    /// Path or URL of the store.
    pub fn path(&self) -> &Path {
        self.layout.store.root()
    }

    /// Path or URL of the array.
    pub fn array_path(&self) -> PathBuf {
        self.layout.store.root().join(&self.layout.name)
    }

    /// Bytes of cache with which tiles of `height` rows (halo included), read row by row, decode each chunk once: the chunks of one
    /// band that two successive rows of tiles touch.
    pub fn cache_for_rows(&self, height: usize) -> usize {
        let [bands, rows, _] = self.layout.chunk_shape;
        let rows = (height.div_ceil(rows) + 1).saturating_mul(rows).min(self.layout.shape[1]);
        let bands = if self.band_chunks.get().is_some() { 1 } else { bands.min(self.layout.shape[0]) };
        rows.saturating_mul(self.layout.shape[2]).saturating_mul(bands * 4)
    }

    /// Makes values beyond `max_magnitude` an error, instead of those beyond [`MAX_VALUE`](super::values::MAX_VALUE). To be called before
    /// the first read.
    pub fn limit_values(&mut self, max_magnitude: f32) {
        self.layout.values.max_magnitude = max_magnitude;
    }

    /// (scale, offset) of the raw samples, if they are scaled.
    pub fn scaling(&self) -> Option<(f64, f64)> {
        self.layout.values.scaling.first().copied()
    }

    /// The work done so far.
    pub fn stats(&self) -> ReadStats {
        let c = &self.counters;
        let missing = |c: &Counters| c.missing.lock().expect("no panic while counting").len() as u64;
        ReadStats {
            bytes_read: c.bytes_read.load(Relaxed),
            chunks_decoded: c.chunks_decoded.load(Relaxed),
            decode_ns: c.decode_ns.load(Relaxed),
            missing_chunks: if self.leaves_out_chunks { 0 } else { missing(c) },
            nan_replaced: c.replaced.lock().expect("no panic while counting").values().sum(),
        }
    }
}
