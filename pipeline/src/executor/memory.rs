//! Memory of the executor's queues, bytes.

pub use super::walk::Walk;
use crate::cuda::memory::STRIP_ROWS;
use crate::tiling::FilmRegion;

/// Tiles per worker in progress or waiting to be added, beyond those that one worker has.
pub const MAX_TILES_AHEAD_PER_WORKER: usize = 3;

/// Contributions of `contribution_bytes` computed by `threads` workers and not yet added.
pub const fn contributions_bytes(walk: &Walk, contribution_bytes: usize, threads: usize) -> usize {
    (walk.waiting + MAX_TILES_AHEAD_PER_WORKER * threads) * contribution_bytes
}

/// Pixels of all shards of one band that `threads` workers add to at a time.
pub fn open_shard_pixels(walk: &Walk, threads: usize) -> usize {
    walk.open_pixels(MAX_TILES_AHEAD_PER_WORKER * threads)
}

/// Pixels of all shards of `regions` that `threads` workers copy the film rows of `gpu_queues` queues to at a time.
pub fn open_shard_pixels_of_gpus(regions: &[FilmRegion], threads: usize, gpu_queues: usize) -> usize {
    let open = |w: &FilmRegion| {
        // The strips that are copied at a time follow one another; the rows of shards that they begin in and end in are incomplete.
        let rows = ((threads * STRIP_ROWS).div_ceil(w.shard.height) + 1) * w.shard.height;
        rows.min(w.rect.height) * w.rect.width
    };
    gpu_queues * regions.iter().map(open).sum::<usize>()
}

/// Pixels of the largest shard.
pub fn max_shard_pixels(regions: &[FilmRegion]) -> usize {
    regions.iter().map(|w| w.shard_rect(0, 0).size().pixels()).max().unwrap_or(0)
}

/// Encoded shards at a time with which workers hardly wait for the disk: one per worker, one per writing thread, and some between them.
pub const fn useful_encoded_shards(threads: usize, writers: usize) -> usize {
    const BETWEEN: usize = 2;
    threads + BETWEEN + writers
}

/// Encoded shards at a time at least: one is encoded while another is written.
pub const MIN_ENCODED_SHARDS: usize = 2;
