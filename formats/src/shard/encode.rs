//! Encoding of pixels as a shard.

use std::borrow::Cow;
use std::iter::repeat_n;
use std::num::NonZeroU64;
use std::sync::Arc;

use pipeline::geometry::Size;
use serde_json::Value;
use zarrs::array::codec::CodecChain;
use zarrs::array::codec::api::BytesToBytesCodecTraits;
use zarrs::array::{ArrayBytes, ArrayToBytesCodecTraits, DataType, FillValue, data_type};

use super::codec::{Codec, SampleType, index_metadata};
use super::mantissa::MantissaRounding;
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
    /// `None`: no compression.
    compressor: Option<Arc<dyn BytesToBytesCodecTraits>>,
    index: CodecChain,
    /// `None`: all bits of the mantissa.
    rounding: Option<MantissaRounding>,
    /// Decoder of inner chunks.
    pub(super) bounded: BoundedChain,
    /// Decoder of indexes.
    pub(super) bounded_index: BoundedChain,
    pub(crate) sample: SampleType,
    pub(super) data_type: DataType,
    /// Side of an inner chunk, px.
    pub(super) chunk: usize,
    /// Fill value of an array whose inner chunks are left out where all pixels equal it; `None`: all are stored.
    pub(super) left_out: Option<f32>,
}

impl ShardEncoder {
    /// `keep_bits`: bits of the mantissa that samples are rounded to, within [`SampleType::mantissa_bits`]; `None` for all.
    pub(crate) fn new(
        codec: Codec,
        sample: SampleType,
        chunk: usize,
        keep_bits: Option<u32>,
    ) -> Result<Self, ShardError> {
        let keep_bits = keep_bits.filter(|&bits| bits < sample.mantissa_bits());
        Self::with_codecs(codec.metadata(sample, keep_bits.is_some()), sample, chunk, keep_bits)
    }

    /// With inner chunks of codecs bytes, at most one compressor, crc32c.
    fn with_codecs(
        codecs: Value,
        sample: SampleType,
        chunk: usize,
        keep_bits: Option<u32>,
    ) -> Result<Self, ShardError> {
        let chain = |metadata: Value| {
            let metadata: Vec<_> =
                serde_json::from_value(metadata).map_err(|e| ShardError::Codec(e.to_string()))?;
            CodecChain::from_metadata(&metadata).map_err(|e| ShardError::Codec(e.to_string()))
        };
        let (chain, index) = (chain(codecs)?, chain(index_metadata())?);
        let bounded = |chain: &CodecChain| BoundedChain::new(chain).map_err(ShardError::Codec);
        Ok(Self {
            bounded: bounded(&chain)?,
            bounded_index: bounded(&index)?,
            compressor: match chain.bytes_to_bytes_codecs() {
                [_crc32c] => None,
                [compressor, _crc32c] => Some(compressor.clone()),
                other => return Err(ShardError::Codec(format!("{} codecs of bytes", other.len()))),
            },
            index,
            rounding: keep_bits.and_then(MantissaRounding::new),
            sample,
            data_type: match sample {
                SampleType::F16 => data_type::float16(),
                SampleType::F32 => data_type::float32(),
                SampleType::U16 => data_type::uint16(),
            },
            chunk,
            left_out: None,
        })
    }

    /// Leaves out inner chunks whose pixels all equal `fill`, the fill value of the array, and pads with it.
    pub(crate) fn leaving_out(self, fill: f32) -> Self {
        Self { left_out: Some(fill), ..self }
    }

    /// Inner chunks (rows, columns) of a shard of `shape` pixels.
    pub(crate) fn chunks_of(&self, shape: Size) -> (usize, usize) {
        (shape.height / self.chunk, shape.width / self.chunk)
    }

    /// Encodes a shard of `rows` × `columns` inner chunks. `data` (`height` × `width`) is the part of the shard inside the image,
    /// from the shard's first pixel on; a NaN or infinite pixel is an error.
    pub(crate) fn encode(
        &self,
        data: &[f32],
        (height, width): (usize, usize),
        (rows, columns): (usize, usize),
    ) -> Result<Vec<u8>, ShardError> {
        debug_assert_eq!(data.len(), height * width);
        self.encode_rows(&|y| &data[y * width..][..width], (height, width), (rows, columns))
    }

    /// As [`ShardEncoder::encode`], of the rows that `row` returns.
    pub(crate) fn encode_rows<'a>(
        &self,
        row: &dyn Fn(usize) -> &'a [f32],
        size: (usize, usize),
        grid: (usize, usize),
    ) -> Result<Vec<u8>, ShardError> {
        let c = self.chunk;
        let is_stored = |(y, x): (usize, usize)| {
            let (rows, columns) = (c.min(size.0 - y), c.min(size.1 - x));
            let is_fill = |fill: f32| {
                (y..y + rows).all(|y| row(y)[x..][..columns].iter().all(|v| v.to_bits() == fill.to_bits()))
            };
            !self.left_out.is_some_and(is_fill)
        };
        self.assemble(size, grid, is_stored, |first, samples| self.gather(row, true, size, first, samples))
    }

    /// As [`ShardEncoder::encode`], of any pixels.
    #[cfg(test)]
    pub(crate) fn encode_unchecked(
        &self,
        data: &[f32],
        size: (usize, usize),
        grid: (usize, usize),
    ) -> Result<Vec<u8>, ShardError> {
        let row = |y: usize| &data[y * size.1..][..size.1];
        self.assemble(size, grid, |_| true, |first, samples| self.gather(&row, false, size, first, samples))
    }

    /// As [`ShardEncoder::encode`], of digital numbers.
    pub(crate) fn encode_counts(
        &self,
        data: &[u16],
        (height, width): (usize, usize),
        grid: (usize, usize),
    ) -> Result<Vec<u8>, ShardError> {
        debug_assert_eq!(data.len(), height * width);
        let c = self.chunk;
        let is_stored = |_| true;
        self.assemble((height, width), grid, is_stored, |(y, x), samples| {
            let ChunkSamples::U16(out) = samples else {
                return Err(ShardError::Codec("expected an array of f32, found digital numbers".into()));
            };
            let (h, w) = (c.min(height - y), c.min(width - x));
            out.clear();
            for row in 0..h {
                out.extend(data[(y + row) * width + x..][..w].iter().map(|v| v.to_le_bytes()));
                out.extend(repeat_n([0; 2], c - w));
            }
            out.extend(repeat_n([0; 2], (c - h) * c));
            Ok(())
        })
    }

    /// Encodes a shard of `rows` × `columns` inner chunks, of those that are stored, whose samples `gather` writes; both by the first pixel.
    fn assemble(
        &self,
        (height, width): (usize, usize),
        (rows, columns): (usize, usize),
        is_stored: impl Fn((usize, usize)) -> bool,
        gather: impl Fn((usize, usize), &mut ChunkSamples) -> Result<(), ShardError>,
    ) -> Result<Vec<u8>, ShardError> {
        let c = self.chunk;
        let options = single_threaded();
        let codec_error = |e: &dyn std::fmt::Display| ShardError::Codec(e.to_string());
        // Pages that are not written are not resident.
        let mut shard = Vec::with_capacity(height * width * self.sample.bytes() + (1 << 16));
        let mut index = vec![u64::MAX; rows * columns * 2];
        let mut samples = ChunkSamples::new(self.sample, c * c);
        for (i, j) in (0..height.div_ceil(c)).flat_map(|i| (0..width.div_ceil(c)).map(move |j| (i, j))) {
            if !is_stored((i * c, j * c)) {
                continue;
            }
            gather((i * c, j * c), &mut samples)?;
            let start = shard.len();
            match &self.compressor {
                None => shard.extend_from_slice(samples.bytes()),
                Some(compressor) => {
                    let encoded = compressor.encode(Cow::Borrowed(samples.bytes()), &options);
                    shard.extend_from_slice(&encoded.map_err(|e| codec_error(&e))?);
                }
            }
            let checksum = crc32c::crc32c(&shard[start..]);
            shard.extend_from_slice(&checksum.to_le_bytes());
            let entry = (i * columns + j) * 2;
            index[entry] = start as u64;
            index[entry + 1] = (shard.len() - start) as u64;
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

    /// Samples of the inner chunk whose first pixel is (`y`, `x`), rounded, and padded with the fill value; `check`: NaN and
    /// infinity are errors.
    fn gather<'a>(
        &self,
        row: &dyn Fn(usize) -> &'a [f32],
        check: bool,
        (height, width): (usize, usize),
        (y, x): (usize, usize),
        out: &mut ChunkSamples,
    ) -> Result<(), ShardError> {
        let c = self.chunk;
        let (h, w) = (c.min(height - y), c.min(width - x));
        let line = |k: usize| {
            let line = &row(y + k)[x..x + w];
            if check { check_finite(line, (y + k, x)).map(|()| line) } else { Ok(line) }
        };
        match out {
            ChunkSamples::U16(_) => {
                return Err(ShardError::Codec("expected digital numbers, found f32".into()));
            }
            ChunkSamples::F32(out) => {
                let fill = self.left_out.unwrap_or(f32::NAN).to_le_bytes();
                out.clear();
                for row in 0..h {
                    match self.rounding {
                        None => out.extend(line(row)?.iter().map(|v| v.to_le_bytes())),
                        Some(r) => out.extend(line(row)?.iter().map(|&v| r.round(v).to_le_bytes())),
                    }
                    out.extend(repeat_n(fill, c - w));
                }
                out.extend(repeat_n(fill, (c - h) * c));
            }
            ChunkSamples::F16(out) => {
                let fill = self.left_out.map_or(half::f16::NAN, half::f16::from_f32).to_le_bytes();
                out.clear();
                for row in 0..h {
                    for (k, &value) in line(row)?.iter().enumerate() {
                        // Rounded in f32: an f16 of fewer bits is exact then.
                        let v = half::f16::from_f32(self.rounding.map_or(value, |r| r.round(value)));
                        if v.is_infinite() {
                            return Err(ShardError::Overflow { row: y + row, column: x + k, value });
                        }
                        out.push(v.to_le_bytes());
                    }
                    out.extend(repeat_n(fill, c - w));
                }
                out.extend(repeat_n(fill, (c - h) * c));
            }
        }
        Ok(())
    }
}

/// Little-endian samples of an inner chunk.
enum ChunkSamples {
    U16(Vec<[u8; 2]>),
    F16(Vec<[u8; 2]>),
    F32(Vec<[u8; 4]>),
}

impl ChunkSamples {
    fn new(sample: SampleType, count: usize) -> Self {
        match sample {
            SampleType::U16 => Self::U16(Vec::with_capacity(count)),
            SampleType::F16 => Self::F16(Vec::with_capacity(count)),
            SampleType::F32 => Self::F32(Vec::with_capacity(count)),
        }
    }

    fn bytes(&self) -> &[u8] {
        match self {
            Self::U16(samples) | Self::F16(samples) => samples.as_flattened(),
            Self::F32(samples) => samples.as_flattened(),
        }
    }
}

/// Shape of the index of a shard of `rows` × `columns` inner chunks.
pub(super) fn index_shape(rows: usize, columns: usize) -> [NonZeroU64; 4] {
    [1, rows as u64, columns as u64, 2].map(|n| NonZeroU64::new(n).expect("a shard has chunks"))
}

/// An error for the first NaN or infinite value of `line`, which begins at (`row`, `column`).
fn check_finite(line: &[f32], (row, column): (usize, usize)) -> Result<(), ShardError> {
    // NaN and infinity have all exponent bits set. A branch-free pass, which the compiler vectorizes, precedes the search.
    if line.iter().map(|v| v.to_bits() & 0x7fff_ffff).fold(0, u32::max) < f32::INFINITY.to_bits() {
        return Ok(());
    }
    match line.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(k) => Err(ShardError::NotFinite { row, column: column + k, value: line[k] }),
    }
}

#[cfg(test)]
mod tests;
