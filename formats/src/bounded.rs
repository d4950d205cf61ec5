//! Decoding of Zarr chunks with a bound on the memory that each decompressor may allocate.
//!
//! zarrs allocates what a compressed chunk declares or decodes to: a zstd frame of 1 MB can declare 32 GB. Here the output of each
//! decompressor is limited to the size that the array's metadata imply. The first compression decodes to n bytes, the samples; one above
//! another, whose overhead depends on its encoder, to at most n + n/4 + 64 KiB, at any position: bounds of zarrs grow by 14 % with each
//! gzip. A chain has at most [`MAX_CODECS`] codecs.
//!
//! | codec | bound |
//! |---|---|
//! | zstd | the buffer's size if it is known; else reading stops one byte beyond the bound (RFC 8878) |
//! | gzip, zlib | reading stops one byte beyond the bound (RFC 1952, RFC 1950) |
//! | blosc | `nbytes` of the header, checked first (README_CHUNK_FORMAT: u32 LE at 4); the library limits its inner codecs to it |
//! | crc32c, shuffle | output not longer than the input |
//!
//! Transpose and the other array-to-array codecs keep or fix the size. Shards inside shards are not supported.

use std::borrow::Cow;
use std::io::Read;
use std::num::NonZeroU64;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use zarrs::array::codec::api::BytesToBytesCodecTraits;
use zarrs::array::codec::{
    BloscCodec, BytesCodec, CodecChain, Crc32cCodec, GzipCodec, PackBitsCodec, ShuffleCodec, ZlibCodec,
    ZstdCodec,
};
use zarrs::array::{ArrayToBytesCodecTraits, BytesRepresentation, CodecOptions, DataType, FillValue};

/// Maximum number of codecs of a chain, array codecs and checksums included; chains in use have up to 5.
pub(crate) const MAX_CODECS: usize = 16;
/// Maximum compression ratio of deflate (zlib.net/zlib_tech.html).
const MAX_DEFLATE_RATIO: usize = 1032;

/// The codecs of an array's chunks, for decoding.
#[derive(Debug)]
pub(crate) struct BoundedChain {
    /// Bytes-to-bytes codecs in the order of encoding.
    compression: Vec<(Kind, Arc<dyn BytesToBytesCodecTraits>)>,
    /// The codecs before them, which turn the array into bytes.
    array: CodecChain,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Zstd,
    Gzip,
    Zlib,
    Blosc,
    /// Output not longer than the input.
    NotExpanding,
}

/// Allowed output size of one codec.
#[derive(Clone, Copy, Debug)]
struct Bound {
    bytes: u64,
    /// Whether a smaller output is an error as well.
    exact: bool,
}

impl BoundedChain {
    /// A decoder for `chain`.
    ///
    /// # Errors
    /// A description of the first codec whose output cannot be bounded, or of a chain that is too long.
    pub(crate) fn new(chain: &CodecChain) -> Result<Self, String> {
        let codecs = chain.array_to_array_codecs().len() + 1 + chain.bytes_to_bytes_codecs().len();
        if codecs > MAX_CODECS {
            return Err(format!("a chain of {codecs} codecs, more than the maximum of {MAX_CODECS}"));
        }
        let bytes = chain.array_to_bytes_codec();
        let any = bytes.as_any();
        if !(any.is::<BytesCodec>() || any.is::<PackBitsCodec>()) {
            let name = bytes.name_v3().unwrap_or("unnamed".into());
            return Err(format!("codec `{name}` inside another codec or shard"));
        }
        let kinds = chain.bytes_to_bytes_codecs().iter().map(|codec| {
            let name = || codec.name_v3().unwrap_or("unnamed".into());
            let kind = kind(codec.as_ref()).ok_or_else(|| format!("codec `{}`", name()))?;
            Ok((kind, codec.clone()))
        });
        Ok(Self {
            compression: kinds.collect::<Result<_, String>>()?,
            array: CodecChain::new(chain.array_to_array_codecs().to_vec(), bytes.clone(), Vec::new()),
        })
    }

    /// Decodes a chunk of `shape` samples of type `t` on the calling thread, into native byte order.
    ///
    /// # Errors
    /// A description of the defect of the bytes; also if a codec panics.
    pub(crate) fn decode(
        &self,
        encoded: Cow<'_, [u8]>,
        shape: &[NonZeroU64],
        t: &DataType,
        fill: &FillValue,
    ) -> Result<Vec<u8>, String> {
        let decode = || self.decode_unguarded(encoded, shape, t, fill);
        catch_unwind(AssertUnwindSafe(decode)).unwrap_or_else(|_| Err("its codec panicked".into()))
    }

    fn decode_unguarded(
        &self,
        mut bytes: Cow<'_, [u8]>,
        shape: &[NonZeroU64],
        t: &DataType,
        fill: &FillValue,
    ) -> Result<Vec<u8>, String> {
        let mut size = self.array.encoded_representation(shape, t, fill).map_err(|e| e.to_string())?;
        let samples = size.size().ok_or("samples without a maximum size")?;
        let mut steps = Vec::with_capacity(self.compression.len());
        for (kind, codec) in &self.compression {
            steps.push((*kind, codec, size, Bound::of(&size, samples)?));
            size = codec.encoded_representation(&size);
        }
        for (kind, codec, size, bound) in steps.into_iter().rev() {
            bytes = Cow::Owned(undo_codec(kind, codec.as_ref(), bytes, &size, bound)?);
        }
        self.array
            .decode(bytes, shape, t, fill, &single_threaded())
            .and_then(|d| d.into_fixed().map_err(Into::into))
            .map(Cow::into_owned)
            .map_err(|e| e.to_string())
    }
}

fn kind(codec: &dyn BytesToBytesCodecTraits) -> Option<Kind> {
    let any = codec.as_any();
    Some(match () {
        () if any.is::<ZstdCodec>() => Kind::Zstd,
        () if any.is::<GzipCodec>() => Kind::Gzip,
        () if any.is::<ZlibCodec>() => Kind::Zlib,
        () if any.is::<BloscCodec>() => Kind::Blosc,
        () if any.is::<Crc32cCodec>() || any.is::<ShuffleCodec>() => Kind::NotExpanding,
        () => return None,
    })
}

/// zarrs options without threads: callers decode and encode on worker threads of their own.
pub(crate) fn single_threaded() -> CodecOptions {
    CodecOptions::default().with_concurrent_target(1).with_chunk_concurrent_minimum(1)
}

/// Decodes the output of one codec; `size` is the size of its encoder's input, within `bound`.
fn undo_codec(
    kind: Kind,
    codec: &dyn BytesToBytesCodecTraits,
    bytes: Cow<'_, [u8]>,
    size: &BytesRepresentation,
    bound: Bound,
) -> Result<Vec<u8>, String> {
    let limit = usize::try_from(bound.bytes).map_err(|_| format!("a chunk of {} bytes", bound.bytes))?;
    let decoded = match kind {
        Kind::Zstd if bound.exact => {
            zstd::bulk::decompress(&bytes, limit).map_err(|e| format!("{e}; {bound}"))?
        }
        Kind::Zstd => {
            let decoder = zstd::stream::read::Decoder::with_buffer(&*bytes).map_err(|e| e.to_string())?;
            read_at_most(decoder, limit, 0)?
        }
        Kind::Gzip => read_at_most(flate2::read::GzDecoder::new(&*bytes), limit, inflated_at_most(&bytes))?,
        Kind::Zlib => read_at_most(flate2::read::ZlibDecoder::new(&*bytes), limit, inflated_at_most(&bytes))?,
        Kind::Blosc => {
            let field = bytes.get(4..8).and_then(|b| b.first_chunk().copied());
            let claimed = u64::from(u32::from_le_bytes(field.ok_or("it is too short for a blosc header")?));
            bound.check(claimed)?;
            codec.decode(bytes, size, &single_threaded()).map_err(|e| e.to_string())?.into_owned()
        }
        Kind::NotExpanding => {
            codec.decode(bytes, size, &single_threaded()).map_err(|e| e.to_string())?.into_owned()
        }
    };
    bound.check(decoded.len() as u64)?;
    Ok(decoded)
}

/// The complete output of `decoder`, truncated to `limit` + 1 bytes. The buffer has `expected` bytes, at most `limit`, and grows while
/// more is read.
fn read_at_most(decoder: impl Read, limit: usize, expected: usize) -> Result<Vec<u8>, String> {
    let mut decoded = Vec::with_capacity(limit.min(expected));
    decoder.take(limit as u64 + 1).read_to_end(&mut decoded).map_err(|e| e.to_string())?;
    Ok(decoded)
}

/// Bytes that deflated data can decode to.
fn inflated_at_most(deflated: &[u8]) -> usize {
    deflated.len().saturating_mul(MAX_DEFLATE_RATIO)
}

impl Bound {
    /// Of a codec whose encoder's input has `size`, in a chain whose samples take `samples` bytes.
    fn of(size: &BytesRepresentation, samples: u64) -> Result<Self, String> {
        match *size {
            BytesRepresentation::FixedSize(bytes) => Ok(Self { bytes, exact: true }),
            // The input was another codec's output, whose overhead depends on the encoder.
            BytesRepresentation::BoundedSize(_) => {
                Ok(Self { bytes: samples.saturating_add(samples / 4).saturating_add(64 << 10), exact: false })
            }
            BytesRepresentation::UnboundedSize => Err("a codec without a maximum size".into()),
        }
    }

    fn check(&self, found: u64) -> Result<(), String> {
        match found == self.bytes || (found < self.bytes && !self.exact) {
            true => Ok(()),
            false if found > self.bytes => Err(format!("it decodes to {found} bytes or more, {self}")),
            false => Err(format!("it decodes to {found} bytes, {self}")),
        }
    }
}

impl std::fmt::Display for Bound {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "expected {}{}", if self.exact { "" } else { "at most " }, self.bytes)
    }
}

#[cfg(test)]
mod tests;
