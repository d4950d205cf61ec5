//! The chart: a multispectral image (wavelength, y, x) in a Zarr store, read rectangle by rectangle.
//!
//! [`ChartStore::open`] takes `PATH` or `PATH//array`: a group with an array `chart` (or `film`), or any Zarr v2/v3
//! array of f16/f32/f64/u8/u16; a 2-D array (y, x) counts as one band. Integers are read as values, scaled only by the
//! attributes `scale_factor` and `add_offset`; fill values and valid ranges are understood as well (CF conventions).
//! Opening checks all that the metadata can tell; [`pipeline::flow::ChartSource::read`] then decodes each inner chunk
//! once while it stays in a bounded cache, however many threads and halos ask for it, and checks it for NaN, infinity and
//! values that are too large to compute with.
//!
//! The unit of decoding is the *piece*: the inner chunk of a sharded array, the chunk otherwise. Left out: irregular chunk
//! grids, shards inside shards.

pub mod cache;
mod conventions;
mod coordinates;
mod error;
pub mod exr;
mod identity;
pub mod image;
mod layout;
mod open;
mod raster;
mod read;
mod spool;
mod stamps;
mod values;
mod watch;
mod write;

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicU64;
use std::sync::{Mutex, OnceLock};

use pipeline::geometry::Size;

pub use crate::shard::Codec;
pub use error::ChartError;
pub use identity::ChartIdentity;
pub use layout::Sample;
pub use open::split_array;
pub use raster::{Interleave, RasterChart, RasterLayout, RasterSample, sample_named};
pub use values::MAX_VALUE;
pub use write::{ChartMeta, WriteError, WriteReport, remove_chart, replace_chart, write_chart};

use cache::Cache;
use layout::Layout;
use read::Piece;
use spool::Spool;
use stamps::Stamps;

/// What to do with NaN and infinity in a chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum NanPolicy {
    /// An error that names band, row and column.
    #[default]
    Error,
    /// Read as 0, and counted.
    Zero,
    /// Read as they are: for looking at films that are not complete.
    Keep,
}

/// How to open a chart.
#[derive(Clone, Debug)]
pub struct ChartOptions {
    /// Bytes of decoded pixels to keep. Beyond them each reading thread holds one piece more.
    pub cache_bytes: usize,
    /// What NaN and infinity mean.
    pub nan: NanPolicy,
    /// Wavelengths in nm, one per band, instead of those in the store.
    pub wavelengths_nm: Option<Vec<f64>>,
}

impl Default for ChartOptions {
    fn default() -> Self {
        Self { cache_bytes: 256 << 20, nan: NanPolicy::Error, wavelengths_nm: None }
    }
}

/// What reading has cost so far, and what it met.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ReadStats {
    /// Encoded bytes read from the store.
    pub bytes_read: u64,
    /// Pieces decoded; a piece counts again when it comes back after it left the cache.
    pub pieces_decoded: u64,
    /// Time spent decoding and checking, summed over threads, in ns.
    pub decode_ns: u64,
    /// Different pieces that are not in the store and were read as the fill value.
    pub missing_pieces: u64,
    /// Different pixels whose NaN or infinity was read as 0.
    pub nan_replaced: u64,
}

#[derive(Debug, Default)]
struct Counters {
    bytes_read: AtomicU64,
    pieces_decoded: AtomicU64,
    decode_ns: AtomicU64,
    /// Per piece, so that a piece decoded twice counts once.
    missing: Mutex<HashMap<u64, u64>>,
    replaced: Mutex<HashMap<u64, u64>>,
}

/// A chart in a Zarr store.
#[derive(Debug)]
pub struct ChartStore {
    layout: Layout,
    options: ChartOptions,
    wavelengths_nm: Option<Vec<f64>>,
    pitch_um: Option<f64>,
    film_size: Option<Size>,
    units: Option<String>,
    cache: Cache<Piece>,
    indexes: Cache<Option<Vec<u64>>>,
    counters: Counters,
    spool: OnceLock<Spool>,
    stamps: Stamps,
}

impl ChartStore {
    /// Chart size in pixels.
    pub fn size(&self) -> Size {
        Size::new(self.layout.shape[1], self.layout.shape[2])
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.layout.shape[0]
    }

    /// Wavelength of each band in nm, if the store or the caller tells.
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

    /// What the values are: attribute `units`.
    pub fn units(&self) -> Option<&str> {
        self.units.as_deref()
    }

    /// Sample type in the store.
    pub fn sample(&self) -> Sample {
        self.layout.sample
    }

    /// (bands, rows, columns) of one file of the store: a shard, or a chunk.
    pub fn file_shape(&self) -> [usize; 3] {
        self.layout.chunk
    }

    /// (bands, rows, columns) of what is decoded at once: an inner chunk, or a chunk.
    pub fn piece_shape(&self) -> [usize; 3] {
        self.layout.piece
    }

    /// Where the store lies.
    pub fn path(&self) -> &Path {
        self.layout.store.root()
    }

    /// Where the array lies.
    pub fn array_path(&self) -> PathBuf {
        self.layout.store.root().join(&self.layout.name)
    }

    /// Bytes of cache with which tiles of `height` rows (halo included), walked row by row, decode each piece once: what
    /// two successive rows of tiles touch of one band.
    pub fn cache_for_rows(&self, height: usize) -> usize {
        let [bands, rows, _] = self.layout.piece;
        let rows = (height.div_ceil(rows) + 1).saturating_mul(rows).min(self.layout.shape[1]);
        let bands = if self.spool.get().is_some() { 1 } else { bands.min(self.layout.shape[0]) };
        rows.saturating_mul(self.layout.shape[2]).saturating_mul(bands * 4)
    }

    /// Makes values beyond `largest` in magnitude an error, where [`MAX_VALUE`] is too much. Call it before anything is read.
    pub fn limit_values(&mut self, largest: f32) {
        self.layout.values.largest = largest;
    }

    /// (scale, offset) of the raw samples, if they are scaled.
    pub fn scaling(&self) -> Option<(f64, f64)> {
        self.layout.values.scaling.first().copied()
    }

    /// What reading has cost so far, and what it met.
    pub fn stats(&self) -> ReadStats {
        use std::sync::atomic::Ordering::Relaxed;
        let c = &self.counters;
        ReadStats {
            bytes_read: c.bytes_read.load(Relaxed),
            pieces_decoded: c.pieces_decoded.load(Relaxed),
            decode_ns: c.decode_ns.load(Relaxed),
            missing_pieces: c.missing.lock().expect("no panic while counting").len() as u64,
            nan_replaced: c.replaced.lock().expect("no panic while counting").values().sum(),
        }
    }
}

#[cfg(test)]
mod tests;
