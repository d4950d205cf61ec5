//! Shards: Zarr v3 `sharding_indexed` chunks, one file each.
//!
//! ```text
//! shard = inner chunks in row-major order, back to back
//!       · index: (offset, length) u64 little-endian of every inner chunk of the grid, (2⁶⁴−1, 2⁶⁴−1) if not stored
//!       · crc32c of the index
//! inner chunk (1, n, n) = little-endian samples · blosc (shuffle; lz4 or zstd, level 1), unless [`Codec::None`] · crc32c
//! ```
//!
//! Samples are rounded to `keep_bits` bits of mantissa (`mantissa.rs`), if the layout has fewer than all; then their bits are shuffled,
//! else their bytes.
//! Inner chunks with at least one pixel of the image are always stored, even if all pixels equal the fill value NaN, but for arrays of scenes,
//! which leave them out (`ShardEncoder::leaving_out`); inner chunks beyond the image's edge never are. Pixels of a stored inner chunk beyond the edge have the fill value. Chunks are encoded one by one on the
//! calling thread, so the bytes of a shard depend on pixels, codec and `keep_bits` only.

mod check;
mod codec;
mod encode;
mod mantissa;

pub(crate) use check::ShardDefect;
pub use codec::{Codec, SampleType};
pub(crate) use codec::{sharding_metadata, sharding_of};
pub(crate) use encode::{ShardEncoder, ShardError};

use pipeline::geometry::{Rect, Size};
use pipeline::tiling::FilmRegion;

/// The shards of an array with the pixels `rect`: squares of `shard` px; an array smaller than a shard has shards of its size, rounded up to
/// inner chunks of `chunk` px.
pub(crate) fn shard_grid(rect: Rect, shard: usize, chunk: usize) -> FilmRegion {
    let side = |n: usize| shard.min(n.div_ceil(chunk) * chunk);
    FilmRegion { rect, shard: Size::new(side(rect.height), side(rect.width)) }
}
