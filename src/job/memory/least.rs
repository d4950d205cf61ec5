//! Memory that a run needs whatever its lens: a limit below it is refused before the lens is traced.

use super::{FRAGMENTATION_SHARE, PROCESS_BYTES, WORKER_BYTES};
use crate::machine::MemoryLimit;
use crate::progress::mib;
use anyhow::Result;
use formats::chart::ChunkMemory;
use formats::film::FilmSpec;
use pipeline::executor::memory::{MIN_ENCODED_SHARDS, max_shard_pixels};
use pipeline::tiling::FilmRegion;

/// Fails if `limit` is below what the program, the shards of `bands` bands of the `regions` of `film` and the `chunks` of its chart take on `threads` threads.
///
/// # Errors
/// Usage: it is.
pub fn check(
    limit: MemoryLimit,
    (film, bands, regions): (&FilmSpec, usize, &[FilmRegion]),
    chunks: ChunkMemory,
    threads: usize,
) -> Result<()> {
    let pixels: usize = regions.iter().map(|region| region.rect.size().pixels()).sum();
    let (all, largest) = (pixels * bands, max_shard_pixels(regions));
    let shards = 4 * (threads * largest).min(all)
        + film.encoded_bytes((MIN_ENCODED_SHARDS * largest).min(all))
        + threads * (film.encode_scratch_bytes() + WORKER_BYTES);
    let of_chunk = chunks.decoding.saturating_add(chunks.values);
    let of_chart = of_chunk.saturating_mul(threads.min(chunks.count)).saturating_add(chunks.read_ahead);
    let least = (PROCESS_BYTES + shards).saturating_add(of_chart);
    let least = (least as f64 / (1.0 - FRAGMENTATION_SHARE)) as usize;
    if limit.bytes >= least as u64 {
        return Ok(());
    }
    Err(limit.too_small(format!(
        "{threads} threads, the shards of this film and the chunks of its chart require {}, and the tables and PSFs of its lens more; raise the limit, use fewer --threads, a smaller --shard, or smaller chunks of the chart",
        mib(least)
    )))
}
