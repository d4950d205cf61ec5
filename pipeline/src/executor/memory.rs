//! Memory of the executor's queues, bytes.

use super::MAX_TILES_AHEAD_PER_WORKER;
pub use super::walk::Walk;
use crate::cuda::memory::MAX_BATCHES;
use crate::plan::FilmRegion;

/// Contributions of `contribution_bytes` computed by `threads` workers and not yet added.
pub const fn contributions_bytes(walk: &Walk, contribution_bytes: usize, threads: usize) -> usize {
    (walk.waiting + MAX_TILES_AHEAD_PER_WORKER * threads) * contribution_bytes
}

/// Pixels of all shards of one band that `threads` workers add to at a time.
pub fn open_shard_pixels(walk: &Walk, threads: usize) -> usize {
    walk.open_pixels(MAX_TILES_AHEAD_PER_WORKER * threads)
}

/// Pixels of all shards of one band of `regions` that the tiles of `gpu_queues` queues, of `tile_px`, each reaching over `reach_px` rows of
/// the film, are added to at a time.
pub fn open_shard_pixels_of_gpus(
    regions: &[FilmRegion],
    (tile_px, reach_px): (usize, usize),
    gpu_queues: usize,
) -> usize {
    let open = |w: &FilmRegion| {
        // Rows of tiles that may have been added to beyond that of the oldest tile. A GPU queue adds its batches in order.
        let rows_ahead = MAX_BATCHES * gpu_queues.saturating_sub(1);
        let rows = ((reach_px + rows_ahead * tile_px).div_ceil(w.shard.height) + 1) * w.shard.height;
        rows.min(w.rect.height) * w.rect.width
    };
    regions.iter().map(open).sum()
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
