//! Workers, queues, back-pressure; no optics.
//!
//! Bands come one after the other from a thread that prepares the next while the present one runs. Workers take, in this
//! order: a finished shard to encode; the next tile. What a tile's light adds up to is added in tile order by whichever
//! worker holds the turn. Encoded shards go through a short queue to threads that only write. No queue is unbounded: a
//! tile may start only [`AHEAD`] tiles a worker before the oldest one not yet added.
//!
//! Where GPUs compute ([`Work::queues`]), they take the tiles off the same sequence, a batch at a time ([`crate::cuda::queue`]),
//! and workers take the charts that batches wait for instead of tiles.

pub(crate) mod devices;
mod error;
pub(crate) mod feed;
pub(crate) mod turn;
mod worker;

use crate::clock::{Clock, StageTimes};
use crate::cuda::DeviceFigures;
use crate::cuda::memory::DeviceQueue;
use crate::cuda::queue::serve;
use crate::flow::{ChartSource, DoorError, FilmSink, Progress};
use crate::geometry::Frame;
use crate::overlap_add::OverlapAdd;
use crate::plan::{ShardId, Tiling, Window};
use crate::psf::BandPsf;
use crate::psf::spectra::SpectrumCache;
use crate::scene::Scene;
use crossbeam::channel::bounded;
pub use error::RunError;
use feed::{Running, Shared, State, Timed};
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Condvar, Mutex};
use std::time::Instant;

/// Tiles in flight or waiting for their turn, per worker.
pub const AHEAD: usize = 3;
/// Encoded shards that wait to be written.
pub const QUEUE: usize = 2;

/// The stages of one band, ready to run.
#[derive(Debug)]
pub struct BandStages {
    /// Stages 1-2.
    pub scene: Scene,
    /// Stage 3, if on.
    pub psf: Option<BandPsf>,
}

/// What is to be made.
pub struct Work<'a> {
    /// Film, axis, chart.
    pub frame: Frame,
    /// Outputs.
    pub windows: &'a [Window],
    /// Per position of the job: band of the chart, tiling, and the shards still to make.
    pub bands: Vec<BandWork>,
    /// Worker threads.
    pub threads: usize,
    /// GPUs that compute the tiles; none: the workers do.
    pub queues: &'a [DeviceQueue],
    /// Bytes for node spectra.
    pub spectra_bytes: usize,
    /// Set from outside to stop early: tiles in flight end, what they finish is committed.
    pub cancel: &'a AtomicBool,
}

/// One band of the job.
#[derive(Clone, Debug)]
pub struct BandWork {
    /// Band of the chart.
    pub chart_band: usize,
    /// Its cut.
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
    /// What each device did.
    pub devices: Vec<DeviceFigures>,
    /// Stopped early by `cancel`.
    pub interrupted: bool,
}

/// Runs `work` from `chart` to `sink`; `prepare` makes the stages of the band at a position of the job.
///
/// # Errors
/// The first [`RunError`] that [`Progress::fault`] does not pass over; shards committed before it stay.
pub fn run<S: FilmSink>(
    work: &Work<'_>,
    chart: &dyn ChartSource,
    sink: &S,
    prepare: &(dyn Fn(usize) -> Result<BandStages, DoorError> + Sync),
    progress: &dyn Progress,
) -> Result<Summary, RunError> {
    let start = Instant::now();
    let clock = Clock::default();
    let shared = Shared {
        work,
        chart: Timed(chart, &clock.read),
        sink,
        progress,
        spectra: SpectrumCache::new(work.spectra_bytes),
        clock: &clock,
        state: Mutex::new(State { queues: work.queues.len(), ..State::default() }),
        changed: Condvar::new(),
        overlap: Mutex::new(OverlapAdd::new(work.windows)),
    };
    let (shards, bytes) = (AtomicU64::new(0), AtomicU64::new(0));
    let named = |queue: &DeviceQueue| {
        let (index, name) = (queue.device.index(), queue.device.info.name.clone());
        Mutex::new(DeviceFigures { index, name, ..DeviceFigures::default() })
    };
    let figures: Vec<_> = work.queues.iter().map(named).collect();
    std::thread::scope(|scope| {
        let (bands_out, bands_in) = bounded::<Running>(0);
        let (encoded_out, encoded_in) = bounded::<(ShardId, S::Encoded)>(QUEUE);
        let shared = &shared;
        scope.spawn(move || shared.prepare_bands(prepare, &bands_out));
        for _ in 0..sink.writers().max(1) {
            let (inbox, shards, bytes) = (encoded_in.clone(), &shards, &bytes);
            scope.spawn(move || shared.write(&inbox, shards, bytes));
        }
        for (queue, figures) in work.queues.iter().zip(&figures) {
            let bands = bands_in.clone();
            scope.spawn(move || serve(shared, &bands, queue, figures));
        }
        for _ in 0..work.threads.max(1) {
            let (bands, encoded) = (bands_in.clone(), encoded_out.clone());
            scope.spawn(move || shared.compute(&bands, &encoded));
        }
    });
    let state = shared.state.into_inner().expect("workers do not panic");
    if let Some(error) = state.error {
        return Err(error);
    }
    Ok(Summary {
        times: clock.wall(),
        core: clock.core(),
        wall_s: start.elapsed().as_secs_f64(),
        tiles: state.tiles,
        pixels: state.pixels,
        spectra: shared.spectra.built(),
        shards: shards.into_inner(),
        bytes_written: bytes.into_inner(),
        devices: figures.into_iter().map(|f| f.into_inner().expect("workers do not panic")).collect(),
        interrupted: work.cancel.load(Ordering::Relaxed),
    })
}
