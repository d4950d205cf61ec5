//! Input and result of a run.

use crate::clock::PhaseTimes;
use crate::cuda::GpuFigures;
use crate::cuda::memory::DeviceQueue;
use crate::geometry::Size;
use crate::tiling::{FilmRegion, ShardId, Tiling};
use std::collections::BTreeSet;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

/// Tiles and shards to compute, and the threads and GPUs that compute them.
pub struct Work<'a> {
    /// Film size in pixels.
    pub film: Size,
    /// Regions of the film to compute.
    pub regions: &'a [FilmRegion],
    /// Bands, by position in the job.
    pub bands: Vec<BandWork>,
    /// Worker threads.
    pub threads: usize,
    /// Shards that are encoded, or being encoded, and not yet written, at most.
    pub max_encoded_shards: usize,
    /// Queues of the GPUs that compute the tiles; empty: the workers compute them.
    pub gpus: &'a [DeviceQueue],
    /// Set by the caller to stop early: tiles in flight are completed, and the shards that they finish are committed.
    pub cancel: &'a AtomicBool,
}

/// One band of the job.
#[derive(Clone, Debug)]
pub struct BandWork {
    /// Band of the chart.
    pub chart_band: usize,
    /// Its division into tiles.
    pub tiling: Tiling,
    /// Shards to compute; their `band` is the position in the job.
    pub shards: BTreeSet<ShardId>,
}

/// Result of a run.
#[derive(Clone, Debug, Default)]
pub struct Summary {
    /// Thread time per stage, waiting included.
    pub times: PhaseTimes,
    /// CPU time per stage.
    pub core: PhaseTimes,
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
    /// Figures of each GPU queue.
    pub gpus: Vec<GpuFigures>,
    /// Stopped early by `cancel`.
    pub interrupted: bool,
}

/// A prepared band and its work.
pub(super) struct BandInFlight<B> {
    pub(super) position: usize,
    pub(super) stages: B,
    /// In the order in which they are claimed: tiles (row, column); for GPUs rows of shards (region, row).
    pub(super) items: Vec<(usize, usize)>,
    /// Tiles that GPUs have added.
    pub(super) counted: Mutex<BTreeSet<(usize, usize)>>,
    /// Number of bands after this one.
    pub(super) bands_after: usize,
    /// Limits of [`super::walk::Walk`]: distance of the claimed tile to the oldest one not yet added, and tiles not yet added.
    pub(super) distance: usize,
    pub(super) waiting: usize,
}
