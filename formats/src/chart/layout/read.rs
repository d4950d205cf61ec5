//! Reading and decoding of single chunks.

use std::borrow::Cow;
use std::num::NonZeroU64;

use zarrs::array::{DataType, FillValue, data_type};

use super::Layout;
use super::metadata::index_shape;
use crate::bounded::BoundedChain;
use crate::chart::error::ChartError;
use crate::chart::read_ahead::Place;
use crate::durable::{DurableError, FileBytes};

impl Layout {
    /// Whether chunks are found by a shard's index.
    pub(crate) fn is_sharded(&self) -> bool {
        self.index.is_some()
    }

    /// Reads the index of the shard that holds `chunk`: (offset, length) of every inner chunk. `None` if the shard is missing.
    pub(crate) fn read_index(&self, chunk: [usize; 3]) -> Result<Option<Vec<u64>>, ChartError> {
        let Some(index) = &self.index else { return Ok(None) };
        let offset = if index.at_start { 0 } else { -(index.bytes as i64) };
        let bytes = match self.store.read_range(&self.file_key(chunk), offset, index.bytes) {
            Err(e @ DurableError::Range { .. }) => return Err(self.corrupt_error(chunk, e.to_string())),
            other => other?,
        };
        let Some(bytes) = bytes else { return Ok(None) };
        let shape = index_shape(&self.order.to_array(&self.chunks_per_file().map(|n| n as u64)));
        let decoded = self.decode(
            chunk,
            &index.chain,
            &bytes,
            &shape,
            &data_type::uint64(),
            &FillValue::from(u64::MAX),
        )?;
        Ok(Some(decoded.as_chunks().0.iter().map(|&b| u64::from_ne_bytes(b)).collect()))
    }

    /// Where `chunk` is stored in a directory; `index` is that of its shard. `None` if it is not stored.
    pub(crate) fn place(
        &self,
        chunk: [usize; 3],
        index: Option<&[u64]>,
    ) -> Result<Option<Place>, ChartError> {
        let key = self.file_key(chunk);
        let range = match index {
            Some(index) => self.range(chunk, index)?,
            None if self.is_sharded() => None,
            None => match self.store.size_of(&key)? {
                Some(bytes) if bytes > self.max_encoded_bytes() => {
                    return Err(self.corrupt_error(chunk, format!("it holds {bytes} bytes")));
                }
                size => size.map(|bytes| (0, bytes)),
            },
        };
        Ok(range.map(|(offset, length)| Place { key, offset, length }))
    }

    /// (offset, length) of `chunk` in its shard; `None` if it is not stored.
    fn range(&self, chunk: [usize; 3], index: &[u64]) -> Result<Option<(u64, u64)>, ChartError> {
        let entry = self.index_entry(chunk);
        let (offset, length) = (index[entry], index[entry + 1]);
        if offset == u64::MAX && length == u64::MAX {
            return Ok(None);
        }
        if i64::try_from(offset).is_err() || length > self.max_encoded_bytes() {
            let reason = format!("its index contains {length} bytes at offset {offset}");
            return Err(self.corrupt_error(chunk, reason));
        }
        Ok(Some((offset, length)))
    }

    /// Limit of the encoded bytes of a chunk: codecs lengthen incompressible data slightly.
    fn max_encoded_bytes(&self) -> u64 {
        let decoded = self.chunk_shape.iter().product::<usize>() as u64 * self.sample.bytes() as u64;
        decoded * 2 + (1 << 20)
    }

    /// Reads the encoded bytes of `chunk`; `index` is that of its shard. `None` if it is not stored.
    pub(crate) fn read_encoded(
        &self,
        chunk: [usize; 3],
        index: Option<&[u64]>,
    ) -> Result<Option<FileBytes>, ChartError> {
        let key = self.file_key(chunk);
        let read = match index {
            None if self.is_sharded() => return Ok(None),
            None => self.store.read_at_most(&key, self.max_encoded_bytes()),
            Some(index) => match self.range(chunk, index)? {
                None => return Ok(None),
                Some((offset, length)) => self.store.read_range(&key, offset as i64, length),
            },
        };
        self.encoded(chunk, read.map(|bytes| bytes.map(FileBytes::from)))
    }

    /// As [`Layout::read_encoded`], past the page cache.
    pub(crate) fn read_direct(
        &self,
        chunk: [usize; 3],
        index: Option<&[u64]>,
    ) -> Result<Option<FileBytes>, ChartError> {
        match self.place(chunk, index)? {
            None => Ok(None),
            Some(Place { key, offset, length }) => {
                self.encoded(chunk, self.store.read_direct(&key, offset, length))
            }
        }
    }

    /// The result of reading `chunk`; one that is too short is damaged.
    pub(crate) fn encoded(
        &self,
        chunk: [usize; 3],
        read: Result<Option<FileBytes>, DurableError>,
    ) -> Result<Option<FileBytes>, ChartError> {
        match read {
            Err(e @ (DurableError::Length { .. } | DurableError::Range { .. })) => {
                Err(self.corrupt_error(chunk, e.to_string()))
            }
            other => Ok(other?),
        }
    }

    /// Decodes a chunk into samples of native byte order, including the part beyond the chart's edge.
    pub(crate) fn decode_chunk(&self, chunk: [usize; 3], encoded: &[u8]) -> Result<Vec<u8>, ChartError> {
        let samples = self.chunk_shape.iter().product::<usize>() * self.sample.bytes();
        let shape = self.chunk_shape.map(|n| NonZeroU64::new(n as u64).expect("chunks are not empty"));
        let shape = self.order.to_array(&shape);
        let (t, fill) = (self.array.data_type().clone(), self.array.fill_value().clone());
        let decoded = self.decode(chunk, &self.chain, encoded, &shape, &t, &fill)?;
        if decoded.len() != samples {
            return Err(
                self.corrupt_error(chunk, format!("it holds {} bytes, expected {samples}", decoded.len()))
            );
        }
        Ok(decoded)
    }

    fn decode(
        &self,
        chunk: [usize; 3],
        chain: &BoundedChain,
        bytes: &[u8],
        shape: &[NonZeroU64],
        t: &DataType,
        fill: &FillValue,
    ) -> Result<Vec<u8>, ChartError> {
        chain.decode(Cow::Borrowed(bytes), shape, t, fill).map_err(|reason| self.corrupt_error(chunk, reason))
    }

    pub(crate) fn corrupt_error(&self, chunk: [usize; 3], reason: String) -> ChartError {
        let (bands, region) = self.chunk_extent(chunk);
        ChartError::Corrupt {
            path: self.file_path(chunk),
            first_band: bands.start,
            end_band: bands.end,
            region,
            reason,
        }
    }
}
