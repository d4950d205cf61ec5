//! Memory of the executor's queues, bytes.

use super::{ENCODED_QUEUE_LENGTH, MAX_TILES_AHEAD_PER_WORKER};
use crate::cuda::memory::MAX_BATCHES;
use crate::plan::FilmRegion;

/// Contributions of `contribution_bytes` computed by `threads` workers and not yet added.
pub const fn contributions_bytes(contribution_bytes: usize, threads: usize) -> usize {
    MAX_TILES_AHEAD_PER_WORKER * threads * contribution_bytes
}

/// Pixels of all shards of one band of `regions` that tiles of `tile_px`, each reaching over `reach_px` rows of the film, are added to at
/// a time: by `threads` workers, or by `gpu_queues` queues.
pub fn open_shard_pixels(
    regions: &[FilmRegion],
    (tile_px, reach_px): (usize, usize),
    threads: usize,
    gpu_queues: usize,
) -> usize {
    let open = |w: &FilmRegion| {
        // Rows of tiles that may have been added to beyond that of the oldest tile. A GPU queue adds its batches in order.
        let rows_ahead = match gpu_queues {
            0 => (MAX_TILES_AHEAD_PER_WORKER * threads.max(1) - 1) / w.rect.width.div_ceil(tile_px.max(1)),
            queues => MAX_BATCHES * (queues - 1),
        };
        let rows = ((reach_px + rows_ahead * tile_px).div_ceil(w.shard.height) + 1) * w.shard.height;
        rows.min(w.rect.height) * w.rect.width
    };
    regions.iter().map(open).sum()
}

/// Pixels of the largest shard.
pub fn max_shard_pixels(regions: &[FilmRegion]) -> usize {
    regions.iter().map(|w| w.shard_rect(0, 0).size().pixels()).max().unwrap_or(0)
}

/// Encoded shards at a time: one per worker, the queue, one per writing thread.
pub const fn encoded_shards(threads: usize, writers: usize) -> usize {
    threads + ENCODED_QUEUE_LENGTH + writers
}
