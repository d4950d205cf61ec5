//! How pixels become a shard: inner chunks, each encoded on its own, in row order, then their index.
//!
//! A shard is a Zarr v3 `sharding_indexed` chunk: encoded inner chunks, then (offset, length) u64 pairs for the whole
//! grid of inner chunks, then the crc32c of those. It is put together here, inner chunk by inner chunk on the calling
//! thread, so its bytes depend on pixels and codec only, and no padded copy of the whole shard is made. Inner chunks
//! that hold at least one pixel of the image are always stored, also when they equal the fill value; those that lie
//! wholly beyond its edge never are.

mod check;

use std::borrow::Cow;
use std::num::NonZeroU64;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use zarrs::array::codec::CodecChain;
use zarrs::array::{ArrayBytes, ArrayToBytesCodecTraits, CodecOptions, DataType, FillValue, data_type};

use crate::bounded::BoundedChain;

/// Compression of a store's chunks; each chunk ends with its crc32c, whatever the compression.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Codec {
    /// As they are.
    None,
    /// blosc: byte shuffle, lz4.
    Lz4,
    /// blosc: byte shuffle, zstd level 1.
    #[default]
    Zstd,
}

/// Sample type of a film.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub enum SampleType {
    /// IEEE binary16; what does not fit is an error.
    #[serde(rename = "float16")]
    F16,
    /// IEEE binary32.
    #[default]
    #[serde(rename = "float32")]
    F32,
}

impl SampleType {
    /// Bytes of one sample.
    pub const fn bytes(self) -> usize {
        match self {
            Self::F16 => 2,
            Self::F32 => 4,
        }
    }

    /// Its name in Zarr.
    pub const fn name(self) -> &'static str {
        match self {
            Self::F16 => "float16",
            Self::F32 => "float32",
        }
    }
}

impl Codec {
    /// The codecs of one inner chunk, as Zarr v3 metadata.
    pub(crate) fn metadata(self, sample: SampleType) -> Value {
        let bytes = json!({"name": "bytes", "configuration": {"endian": "little"}});
        let crc = json!({"name": "crc32c"});
        let cname = match self {
            Self::None => return json!([bytes, crc]),
            Self::Lz4 => "lz4",
            Self::Zstd => "zstd",
        };
        let blosc = json!({"name": "blosc", "configuration": {
            "cname": cname, "clevel": 1, "shuffle": "shuffle", "typesize": sample.bytes(), "blocksize": 0
        }});
        json!([bytes, blosc, crc])
    }
}

fn index_metadata() -> Value {
    json!([{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "crc32c"}])
}

/// The codecs of a whole shard (1, …) of inner chunks (1, `chunk`, `chunk`), as Zarr v3 metadata.
pub(crate) fn sharding_metadata(codec: Codec, sample: SampleType, chunk: usize) -> Value {
    json!([{"name": "sharding_indexed", "configuration": {
        "chunk_shape": [1, chunk, chunk],
        "codecs": codec.metadata(sample),
        "index_codecs": index_metadata(),
        "index_location": "end"
    }}])
}

/// Zarr's options for us: our own workers are the parallelism.
pub(crate) fn single_threaded() -> CodecOptions {
    CodecOptions::default().with_concurrent_target(1).with_chunk_concurrent_minimum(1)
}

pub(crate) use check::Flaw;

/// A sample that the film's type cannot hold or that is no number, at (row, column) of the data given.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ShardError {
    #[error("{value} at row {row}, column {column}")]
    NotFinite { row: usize, column: usize, value: f32 },
    #[error("{value} at row {row}, column {column} does not fit float16")]
    Overflow { row: usize, column: usize, value: f32 },
    #[error("{0}")]
    Codec(String),
}

/// Encodes shards of one array.
#[derive(Debug)]
pub(crate) struct ShardEncoder {
    chain: CodecChain,
    index: CodecChain,
    /// The same, for decoding.
    bounded: BoundedChain,
    bounded_index: BoundedChain,
    sample: SampleType,
    data_type: DataType,
    chunk: usize,
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

    /// The bytes of a shard of `rows` × `columns` inner chunks, of which `data` (`height` × `width`, from the shard's
    /// first pixel on) is the part inside the image; the rest of an inner chunk is NaN. A pixel of the image that is NaN or
    /// infinite is an error.
    pub(crate) fn encode(
        &self,
        data: &[f32],
        (height, width): (usize, usize),
        (rows, columns): (usize, usize),
    ) -> Result<Vec<u8>, ShardError> {
        all_finite(data, width)?;
        self.encode_pixels(data, (height, width), (rows, columns))
    }

    /// As [`ShardEncoder::encode`], of any pixels.
    pub(crate) fn encode_pixels(
        &self,
        data: &[f32],
        (height, width): (usize, usize),
        (rows, columns): (usize, usize),
    ) -> Result<Vec<u8>, ShardError> {
        debug_assert_eq!(data.len(), height * width);
        let c = self.chunk;
        let shape = [1, c as u64, c as u64].map(|n| NonZeroU64::new(n).expect("a chunk has pixels"));
        let fill = FillValue::new(match self.sample {
            SampleType::F16 => half::f16::NAN.to_ne_bytes().to_vec(),
            SampleType::F32 => f32::NAN.to_ne_bytes().to_vec(),
        });
        let options = single_threaded();
        let failed = |e: &dyn std::fmt::Display| ShardError::Codec(e.to_string());
        let mut shard = Vec::with_capacity(height * width * self.sample.bytes() / 2);
        let mut index = vec![u64::MAX; rows * columns * 2];
        for (i, j) in (0..height.div_ceil(c)).flat_map(|i| (0..width.div_ceil(c)).map(move |j| (i, j))) {
            let chunk = self.gather(data, (height, width), (i * c, j * c))?;
            let encoded = self
                .chain
                .encode(ArrayBytes::new_flen(chunk), &shape, &self.data_type, &fill, &options)
                .map_err(|e| failed(&e))?;
            let slot = (i * columns + j) * 2;
            index[slot] = shard.len() as u64;
            index[slot + 1] = encoded.len() as u64;
            shard.extend_from_slice(&encoded);
        }
        let index: Vec<u8> = index.iter().flat_map(|n| n.to_ne_bytes()).collect();
        let shape = [rows as u64, columns as u64, 2].map(|n| NonZeroU64::new(n).expect("a shard has chunks"));
        let shape = [NonZeroU64::MIN, shape[0], shape[1], shape[2]];
        let encoded = self
            .index
            .encode(
                ArrayBytes::new_flen(Cow::Owned(index)),
                &shape,
                &data_type::uint64(),
                &FillValue::from(u64::MAX),
                &options,
            )
            .map_err(|e| failed(&e))?;
        shard.extend_from_slice(&encoded);
        Ok(shard)
    }

    /// The inner chunk whose first pixel is (`y`, `x`) of `data`, padded with NaN, in the film's sample type.
    fn gather(
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
                let mut out = f32::NAN.to_ne_bytes().repeat(c * c);
                for row in 0..h {
                    let (to, _) = out[row * c * 4..].as_chunks_mut();
                    to.iter_mut().zip(line(row)).for_each(|(to, v)| *to = v.to_ne_bytes());
                }
                Ok(out)
            }
            SampleType::F16 => {
                let mut out = half::f16::NAN.to_ne_bytes().repeat(c * c);
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

/// Fails at the first of `data`, rows of `width`, that is NaN or infinite.
fn all_finite(data: &[f32], width: usize) -> Result<(), ShardError> {
    // Exponent all ones. One pass without branches, which the compiler vectorizes; the place only where there is one.
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
