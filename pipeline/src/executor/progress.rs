//! Progress of a run, reported to the caller.

use super::error::RunError;
use crate::cuda::CudaError;
use crate::tiling::ShardId;

/// Receives the events of a run; called from many threads.
pub trait Progress: Sync {
    /// A band's first tile is about to start: its position in the job and the film pixels of its tiles.
    fn band(&self, _position: usize, _pixels: u64) {}
    /// A tile of `pixels` film pixels has been added.
    fn tile(&self, _position: usize, _pixels: usize) {}
    /// A shard of `bytes` has been committed.
    fn shard(&self, _id: ShardId, _bytes: u64) {}
    /// A GPU failed and was removed; its tiles are requeued for the `left` others.
    fn gpu_removed(&self, _device: &str, _error: &CudaError, _left: usize) {}
    /// A GPU ran out of memory and continues with half of its share.
    fn gpu_short_of_memory(&self, _device: &str, _error: &CudaError) {}
    /// After `error`: `true` continues with all shards that do not depend on it; `false` stops the run.
    fn continue_after(&self, _error: &RunError) -> bool {
        false
    }
}

/// Reports nothing.
impl Progress for () {}
