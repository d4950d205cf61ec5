//! Layout of a chart's Zarr array: bands and pixels of each chunk, and the file that holds it.
//!
//! A *chunk* is the unit of decoding: an inner chunk of a sharded array, a Zarr chunk otherwise. A *file* is what one key of the store
//! holds: a shard, or a chunk. Shapes and indices are (bands, rows, columns); a 2-D array has one band.

mod metadata;
mod read;

use std::path::PathBuf;
use std::sync::Arc;

use pipeline::geometry::{Rect, Size};
use zarrs::array::Array;

use super::axes::AxisOrder;
use super::error::ChartError;
use super::values::Values;
use crate::bounded::BoundedChain;
use crate::durable::{DurableError, Store};
use crate::sample::Sample;

/// Decoder and position of a shard's index.
#[derive(Debug)]
struct ShardIndex {
    chain: BoundedChain,
    at_start: bool,
    /// Encoded size.
    bytes: u64,
}

/// The array: its files, chunks and codecs.
#[derive(Debug)]
pub(super) struct Layout {
    pub(super) store: Arc<Store>,
    /// Path of the array in the store; empty for a bare array.
    pub(super) name: String,
    pub(super) array: Array<Store>,
    /// Axes of the array. All shapes and indices here are (bands, rows, columns).
    pub(super) order: AxisOrder,
    pub(super) shape: [usize; 3],
    pub(super) file_shape: [usize; 3],
    pub(super) chunk_shape: [usize; 3],
    pub(super) sample: Sample,
    /// Raw sample of pixels that are not stored.
    pub(super) fill: f64,
    pub(super) values: Values,
    chain: BoundedChain,
    /// For sharded arrays.
    index: Option<ShardIndex>,
}

impl Layout {
    pub(super) fn size(&self) -> Size {
        Size::new(self.shape[1], self.shape[2])
    }

    /// Number of chunks along each axis.
    pub(super) fn chunk_counts(&self) -> [usize; 3] {
        std::array::from_fn(|k| self.shape[k].div_ceil(self.chunk_shape[k]))
    }

    /// Number of files along each axis.
    fn file_counts(&self) -> [usize; 3] {
        std::array::from_fn(|k| self.shape[k].div_ceil(self.file_shape[k]))
    }

    /// Number of chunks of a file along each axis.
    fn chunks_per_file(&self) -> [usize; 3] {
        std::array::from_fn(|k| self.file_shape[k] / self.chunk_shape[k])
    }

    /// Row-major number of a chunk.
    pub(super) fn chunk_number(&self, chunk: [usize; 3]) -> u64 {
        row_major(chunk, self.chunk_counts())
    }

    /// Row-major number of the file that holds `chunk`.
    pub(super) fn file_number(&self, chunk: [usize; 3]) -> u64 {
        row_major(self.file_index(chunk), self.file_counts())
    }

    /// Bands and pixels of `chunk` inside the chart.
    pub(super) fn chunk_extent(&self, chunk: [usize; 3]) -> (std::ops::Range<usize>, Rect) {
        let start: [usize; 3] = std::array::from_fn(|k| chunk[k] * self.chunk_shape[k]);
        let count: [usize; 3] = std::array::from_fn(|k| self.chunk_shape[k].min(self.shape[k] - start[k]));
        let rect = Rect::new(start[1] as i64, start[2] as i64, count[1], count[2]);
        (start[0]..start[0] + count[0], rect)
    }

    fn file_index(&self, chunk: [usize; 3]) -> [usize; 3] {
        let per_file = self.chunks_per_file();
        std::array::from_fn(|k| chunk[k] / per_file[k])
    }

    /// Position in the shard's index of the (offset, length) of `chunk`.
    fn index_entry(&self, chunk: [usize; 3]) -> usize {
        let per_file = self.chunks_per_file();
        let inside: [usize; 3] = std::array::from_fn(|k| chunk[k] % per_file[k]);
        let (inside, per_file) = (self.order.to_array(&inside), self.order.to_array(&per_file));
        inside.iter().zip(&per_file).fold(0, |n, (i, side)| n * side + i) * 2
    }

    /// Key of the file that holds `chunk`, relative to the store.
    pub(super) fn file_key(&self, chunk: [usize; 3]) -> String {
        let indices = self.file_index(chunk).map(|i| i as u64);
        self.array.chunk_key(&self.order.to_array(&indices)).as_str().to_owned()
    }

    /// Path of the file that holds `chunk`.
    pub(super) fn file_path(&self, chunk: [usize; 3]) -> PathBuf {
        self.store.root().join(self.file_key(chunk))
    }

    /// Keys of all files that the array may have.
    pub(super) fn file_keys(&self) -> Vec<String> {
        let (files, per_file) = (self.file_counts(), self.chunks_per_file());
        let all = (0..files.iter().product()).map(|n: usize| {
            let file = [n / (files[1] * files[2]), n / files[2] % files[1], n % files[2]];
            self.file_key(std::array::from_fn(|k| file[k] * per_file[k]))
        });
        all.collect()
    }

    /// Whether `key`, relative to the array, is one of [`Layout::file_keys`], in the array's key encoding.
    pub(super) fn is_file_key(&self, key: &str) -> bool {
        let rank = self.array.shape().len();
        let numbers = key.split(|c: char| !c.is_ascii_digit()).filter(|digits| !digits.is_empty());
        let Ok(index) = numbers.take(rank).map(str::parse).collect::<Result<Vec<u64>, _>>() else {
            return false;
        };
        let counts = self.order.to_array(&self.file_counts());
        let exists = std::iter::zip(&index, &counts).all(|(i, n)| *i < *n as u64);
        index.len() == rank && exists && self.array.chunk_key(&index).as_str() == self.key_below_array(key)
    }

    /// `key`, relative to the array, relative to the store.
    fn key_below_array(&self, key: &str) -> String {
        let slash = if self.name.is_empty() { "" } else { "/" };
        format!("{}{slash}{key}", self.name)
    }

    /// Checks that the array's metadata still exist: a missing chunk reads as the fill value, but not if the store has been removed
    /// or unmounted.
    pub(super) fn check_exists(&self) -> Result<(), ChartError> {
        for file in ["zarr.json", ".zarray"] {
            if self.store.size_of(&self.key_below_array(file))?.is_some() {
                return Ok(());
            }
        }
        let path = self.store.root().join(&self.name);
        Err(DurableError::StoreMissing { path, missing: "metadata".into() }.into())
    }

    /// Samples from one band, row and column of a decoded chunk to the next.
    pub(super) fn chunk_strides(&self) -> [usize; 3] {
        let sides = self.order.to_array(&self.chunk_shape);
        let strides: Vec<usize> = (0..sides.len()).map(|k| sides[k + 1..].iter().product()).collect();
        self.order.to_chart(&strides, 0)
    }
}

fn row_major([b, i, j]: [usize; 3], [_, rows, columns]: [usize; 3]) -> u64 {
    (b as u64 * rows as u64 + i as u64) * columns as u64 + j as u64
}
