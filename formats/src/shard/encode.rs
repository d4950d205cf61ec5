//! Encoding of pixels as a shard.

use std::borrow::Cow;
use std::num::NonZeroU64;

use serde_json::Value;
use zarrs::array::codec::CodecChain;
use zarrs::array::{ArrayBytes, ArrayToBytesCodecTraits, DataType, FillValue, data_type};

use super::codec::{Codec, SampleType, index_metadata};
use crate::bounded::{BoundedChain, single_threaded};

/// Pixels that cannot be encoded; rows and columns are those of the data passed in.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ShardError {
    #[error("{value} at row {row}, column {column}")]
    NotFinite { row: usize, column: usize, value: f32 },
    #[error("{value} at row {row}, column {column} does not fit float16")]
    Overflow { row: usize, column: usize, value: f32 },
    #[error("{0}")]
    Codec(String),
}

/// Encoder (and checker, see [`ShardEncoder::check`]) of the shards of one array.
#[derive(Debug)]
pub(crate) struct ShardEncoder {
    chain: CodecChain,
    index: CodecChain,
    /// Decoder of inner chunks.
    pub(super) bounded: BoundedChain,
    /// Decoder of indexes.
    pub(super) bounded_index: BoundedChain,
    pub(super) sample: SampleType,
    pub(super) data_type: DataType,
    /// Side of an inner chunk, px.
    pub(super) chunk: usize,
}

impl ShardEncoder {
    pub(crate) fn new(codec: Codec, sample: SampleType, chunk: usize) -> Result<Self, ShardError> {
        let chain = |metadata: Value| {
            let metadata: Vec<_> =
                serde_json::from_value(metadata).map_err(|e| ShardError::Codec(e.to_string()))?;
            CodecChain::from_metadata(&metadata).map_err(|e| ShardError::Codec(e.to_string()))
        };
        let (chain, index) = (chain(codec.metadata(sample))?, chain(index_metadata())?);
        let bounded = |chain: &CodecChain| BoundedChain::new(chain).map_err(ShardError::Codec);
        Ok(Self {
            bounded: bounded(&chain)?,
            bounded_index: bounded(&index)?,
            chain,
            index,
            sample,
            data_type: match sample {
                SampleType::F16 => data_type::float16(),
                SampleType::F32 => data_type::float32(),
            },
            chunk,
        })
    }

    /// Encodes a shard of `rows` × `columns` inner chunks. `data` (`height` × `width`) is the part of the shard inside the image,
    /// from the shard's first pixel on; a NaN or infinite pixel is an error.
    pub(crate) fn encode(
        &self,
        data: &[f32],
        (height, width): (usize, usize),
        (rows, columns): (usize, usize),
    ) -> Result<Vec<u8>, ShardError> {
        check_finite(data, width)?;
        self.encode_pixels(data, (height, width), (rows, columns))
    }

    /// As [`ShardEncoder::encode`], but accepts NaN and infinity.
    pub(crate) fn encode_pixels(
        &self,
        data: &[f32],
        (height, width): (usize, usize),
        (rows, columns): (usize, usize),
    ) -> Result<Vec<u8>, ShardError> {
        debug_assert_eq!(data.len(), height * width);
        let c = self.chunk;
        let (shape, fill) = (self.chunk_shape(), FillValue::new(self.sample.nan()));
        let options = single_threaded();
        let codec_error = |e: &dyn std::fmt::Display| ShardError::Codec(e.to_string());
        let mut shard = Vec::with_capacity(height * width * self.sample.bytes() / 2);
        let mut index = vec![u64::MAX; rows * columns * 2];
        for (i, j) in (0..height.div_ceil(c)).flat_map(|i| (0..width.div_ceil(c)).map(move |j| (i, j))) {
            let chunk = self.padded_chunk(data, (height, width), (i * c, j * c))?;
            let encoded = self
                .chain
                .encode(ArrayBytes::new_flen(chunk), &shape, &self.data_type, &fill, &options)
                .map_err(|e| codec_error(&e))?;
            let entry = (i * columns + j) * 2;
            index[entry] = shard.len() as u64;
            index[entry + 1] = encoded.len() as u64;
            shard.extend_from_slice(&encoded);
        }
        let index: Vec<u8> = index.iter().flat_map(|n| n.to_ne_bytes()).collect();
        let encoded = self
            .index
            .encode(
                ArrayBytes::new_flen(Cow::Owned(index)),
                &index_shape(rows, columns),
                &data_type::uint64(),
                &FillValue::from(u64::MAX),
                &options,
            )
            .map_err(|e| codec_error(&e))?;
        shard.extend_from_slice(&encoded);
        Ok(shard)
    }

    /// Shape of an inner chunk.
    pub(super) fn chunk_shape(&self) -> [NonZeroU64; 3] {
        let side = NonZeroU64::new(self.chunk as u64).expect("a chunk has pixels");
        [NonZeroU64::MIN, side, side]
    }

    /// Samples of the inner chunk whose first pixel is (`y`, `x`) of `data`, padded with NaN.
    fn padded_chunk(
        &self,
        data: &[f32],
        (height, width): (usize, usize),
        (y, x): (usize, usize),
    ) -> Result<Vec<u8>, ShardError> {
        let c = self.chunk;
        let (h, w) = (c.min(height - y), c.min(width - x));
        let line = |row: usize| &data[(y + row) * width + x..][..w];
        match self.sample {
            SampleType::F32 => {
                let mut out = self.sample.nan().repeat(c * c);
                for row in 0..h {
                    let (to, _) = out[row * c * 4..].as_chunks_mut();
                    to.iter_mut().zip(line(row)).for_each(|(to, v)| *to = v.to_ne_bytes());
                }
                Ok(out)
            }
            SampleType::F16 => {
                let mut out = self.sample.nan().repeat(c * c);
                for row in 0..h {
                    let (to, _) = out[row * c * 2..].as_chunks_mut();
                    for (k, (to, &value)) in to.iter_mut().zip(line(row)).enumerate() {
                        let v = half::f16::from_f32(value);
                        if v.is_infinite() {
                            return Err(ShardError::Overflow { row: y + row, column: x + k, value });
                        }
                        *to = v.to_ne_bytes();
                    }
                }
                Ok(out)
            }
        }
    }
}

/// Shape of the index of a shard of `rows` × `columns` inner chunks.
pub(super) fn index_shape(rows: usize, columns: usize) -> [NonZeroU64; 4] {
    [1, rows as u64, columns as u64, 2].map(|n| NonZeroU64::new(n).expect("a shard has chunks"))
}

/// An error for the first NaN or infinite value of `data` (rows of `width`).
fn check_finite(data: &[f32], width: usize) -> Result<(), ShardError> {
    // NaN and infinity have all exponent bits set. A branch-free pass, which the compiler vectorizes, precedes the search.
    if data.iter().map(|v| v.to_bits() & 0x7fff_ffff).fold(0, u32::max) < f32::INFINITY.to_bits() {
        return Ok(());
    }
    match data.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(k) => Err(ShardError::NotFinite { row: k / width, column: k % width, value: data[k] }),
    }
}

#[cfg(test)]
mod tests;
