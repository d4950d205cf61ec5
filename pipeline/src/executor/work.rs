//! What is to be made, and what a run did.

use crate::clock::StageTimes;
use crate::cuda::GpuFigures;
use crate::cuda::memory::DeviceQueue;
use crate::geometry::Size;
use crate::plan::{ShardId, Tiling, Window};
use std::collections::BTreeSet;
use std::sync::atomic::AtomicBool;

/// What is to be made.
pub struct Work<'a> {
    /// Film size in pixels.
    pub film: Size,
    /// Outputs.
    pub windows: &'a [Window],
    /// Per position of the job: band of the chart, tiling, and the shards still to make.
    pub bands: Vec<BandWork>,
    /// Worker threads.
    pub threads: usize,
    /// GPUs that compute the tiles; none: the workers do.
    pub gpus: &'a [DeviceQueue],
    /// Set from outside to stop early: tiles in flight end, the shards that they finish are committed.
    pub cancel: &'a AtomicBool,
}

/// One band of the job.
#[derive(Clone, Debug)]
pub struct BandWork {
    /// Band of the chart.
    pub chart_band: usize,
    /// Its tiles.
    pub tiling: Tiling,
    /// Shards to make; their `band` is the position in the job.
    pub wanted: BTreeSet<ShardId>,
}

/// What a run did.
#[derive(Clone, Debug, Default)]
pub struct Summary {
    /// Thread seconds per stage, waiting included.
    pub times: StageTimes,
    /// Core seconds per stage.
    pub core: StageTimes,
    /// Wall time, s.
    pub wall_s: f64,
    /// Tiles computed.
    pub tiles: u64,
    /// Film pixels of those tiles.
    pub pixels: u64,
    /// Node spectra built.
    pub spectra: u64,
    /// Shards written.
    pub shards: u64,
    /// Bytes written.
    pub bytes_written: u64,
    /// What each GPU queue did.
    pub gpus: Vec<GpuFigures>,
    /// Stopped early by `cancel`.
    pub interrupted: bool,
}

/// A prepared band and the tiles of it that are needed.
pub(super) struct BandInFlight<B> {
    pub(super) position: usize,
    pub(super) stages: B,
    pub(super) tiles: Vec<(usize, usize)>,
}
