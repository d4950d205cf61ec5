//! The shards of a film: their number, pixels, keys, encoding and storage.

use std::path::Path;

use bytes::Bytes;
use pipeline::geometry::{Rect, Size};

use super::store::FilmStore;
use crate::durable::is_url;
use crate::group::{GroupError, ShardFile};
use crate::shard::ShardError;

/// An encoded shard, to be committed.
#[derive(Debug)]
pub struct EncodedShard {
    pub(super) key: String,
    pub(super) bytes: Bytes,
}

impl EncodedShard {
    /// Key in the film's store.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// Its bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

impl FilmStore {
    /// Number of shards of the film at `path` to write concurrently: enough to use a disk fully, or to hide the round trip to an object
    /// store, about 0.2 s for 10 MB.
    pub fn concurrent_writes(path: &Path) -> usize {
        if is_url(path) { 6 } else { 2 }
    }

    /// Shard rows and columns of output `output`.
    pub fn shards(&self, output: usize) -> (usize, usize) {
        self.spec.shard_grid(output).count()
    }

    /// Film pixels of shard (`row`, `column`) of `output`.
    pub fn shard_rect(&self, output: usize, (row, column): (usize, usize)) -> Rect {
        self.spec.shard_grid(output).shard_rect(row, column)
    }

    /// All shards, as they are stored.
    pub(super) fn shard_files(&self) -> Vec<ShardFile<'_>> {
        let file = |(output, band, (row, column)): (usize, usize, (usize, usize))| {
            let grid = self.spec.shard_grid(output);
            let (shape, rect) = (grid.shard, grid.shard_rect(row, column));
            ShardFile { key: self.key(output, band, (row, column)), encoder: &self.encoder, shape, rect }
        };
        self.spec.all_shards().map(file).collect()
    }

    /// All shards of the film: output, band, (row, column).
    pub fn all_shards(&self) -> impl Iterator<Item = (usize, usize, (usize, usize))> + '_ {
        self.spec.all_shards()
    }

    /// Key of a shard.
    pub fn key(&self, output: usize, band: usize, shard: (usize, usize)) -> String {
        self.spec.key(output, band, shard)
    }

    /// Encodes a shard on the calling thread; `data` are its pixels inside the film ([`FilmStore::shard_rect`]), row by row. The same
    /// pixels give the same bytes.
    ///
    /// # Errors
    /// [`GroupError::NotFinite`] for NaN or infinity, [`GroupError::Overflow`] for a value beyond the range of f16; [`GroupError::Request`] for a
    /// shard outside the film or `data` of another length.
    pub fn encode_shard(
        &self,
        output: usize,
        band: usize,
        shard: (usize, usize),
        data: &[f32],
    ) -> Result<EncodedShard, GroupError> {
        let width = self.expected_rect(output, band, shard, data.len())?.width;
        let row = |y: usize| &data[y * width..][..width];
        self.encode_rows(output, band, shard, &row)
    }

    /// As [`FilmStore::encode_shard`], of `size` pixels whose rows `row` returns.
    ///
    /// # Errors
    /// As [`FilmStore::encode_shard`].
    pub fn encode_shard_rows<'a>(
        &self,
        output: usize,
        band: usize,
        shard: (usize, usize),
        size: Size,
        row: &dyn Fn(usize) -> &'a [f32],
    ) -> Result<EncodedShard, GroupError> {
        self.expected_rect(output, band, shard, size.pixels())?;
        self.encode_rows(output, band, shard, row)
    }

    /// The rectangle of a shard, which has `pixels` pixels.
    fn expected_rect(
        &self,
        output: usize,
        band: usize,
        shard: (usize, usize),
        pixels: usize,
    ) -> Result<Rect, GroupError> {
        let bands = self.spec.wavelengths_nm.len();
        let exists = output < self.spec.outputs.len() && band < bands && {
            let (down, across) = self.shards(output);
            shard.0 < down && shard.1 < across
        };
        let rect = if exists { self.shard_rect(output, shard) } else { Rect::new(0, 0, 0, 0) };
        if !exists || pixels != rect.size().pixels() {
            let expected = rect.size().pixels();
            return Err(GroupError::Request { output, band, shard, expected, found: pixels });
        }
        Ok(rect)
    }

    /// Encodes the rows of a shard.
    fn encode_rows<'a>(
        &self,
        output: usize,
        band: usize,
        shard: (usize, usize),
        row: &dyn Fn(usize) -> &'a [f32],
    ) -> Result<EncodedShard, GroupError> {
        let rect = self.shard_rect(output, shard);
        let chunks = self.encoder.chunks_of(self.spec.shard_grid(output).shard);
        let bytes =
            self.encoder.encode_rows(row, (rect.height, rect.width), chunks).map_err(|e| match e {
                ShardError::Overflow { row, column, value } => GroupError::Overflow {
                    output: self.spec.outputs[output].name.clone(),
                    band,
                    row: rect.y + row as i64,
                    column: rect.x + column as i64,
                    value,
                },
                ShardError::NotFinite { row, column, value } => GroupError::NotFinite {
                    shard: self.key(output, band, shard),
                    band,
                    row: rect.y + row as i64,
                    column: rect.x + column as i64,
                    value,
                },
                ShardError::Codec(reason) => GroupError::Codec { reason },
            })?;
        Ok(EncodedShard { key: self.key(output, band, shard), bytes: bytes.into() })
    }

    /// Writes a shard, durably and atomically; from then on it is present.
    ///
    /// # Errors
    /// [`GroupError::Storage`]; the shard is then unchanged. [`GroupError::Replaced`] or [`GroupError::Recreated`] if another film has replaced
    /// this one; that film is then unchanged.
    pub fn commit(&self, shard: &EncodedShard) -> Result<(), GroupError> {
        self.group.commit(&shard.key, shard.bytes.clone())
    }

    /// Sizes of stored shards in bytes; `None` of those that do not exist. Requests to an object store are concurrent.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if the store cannot be read.
    pub fn shards_bytes(
        &self,
        shards: &[(usize, usize, (usize, usize))],
    ) -> Result<Vec<Option<u64>>, GroupError> {
        let keys: Vec<String> = shards.iter().map(|&(o, b, s)| self.key(o, b, s)).collect();
        Ok(self.group.store.sizes_of(&keys)?)
    }

    /// Removes a shard, if it exists.
    #[cfg(test)]
    pub(super) fn remove_shard(
        &self,
        output: usize,
        band: usize,
        shard: (usize, usize),
    ) -> Result<(), GroupError> {
        Ok(self.group.store.remove(&self.key(output, band, shard))?)
    }
}
