//! Workers, queues, back-pressure; no optics.
//!
//! Bands come one after the other from a thread that prepares the next while the present one runs. Workers take, in this
//! order: a finished shard to encode; the next tile. What a tile's light adds up to is added in tile order by whichever
//! worker holds the turn. Encoded shards go through a short queue to threads that only write. No queue is unbounded: a
//! tile may start only [`AHEAD`] tiles a worker before the oldest one not yet added.

use crate::clock::{Clock, Stage, StageTimes};
use crate::flow::{ChartSource, DoorError, FilmSink, Progress};
use crate::geometry::{Frame, Rect};
use crate::overlap_add::{Finished, OverlapAdd, tiles_needed};
use crate::plan::{ShardId, Tiling, Window};
use crate::psf::spectra::SpectrumCache;
use crate::psf::{BandPsf, PsfScratch, Scattered};
use crate::scene::{Scene, SceneScratch};
use crossbeam::channel::{Receiver, Sender, bounded};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Instant;
use thiserror::Error;

/// Tiles in flight or waiting for their turn, per worker.
pub const AHEAD: usize = 3;
/// Tiles, per worker, between the one that is computed and the one whose chart is fetched: some tens of milliseconds.
const READ_AHEAD: usize = 4;
/// Threads that write encoded shards; each waits on the disk most of the time.
const WRITERS: usize = 2;

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
    /// Stopped early by `cancel`.
    pub interrupted: bool,
}

/// Why a run stopped.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RunError {
    /// A band's stages could not be made.
    #[error("preparing its stages: {source}")]
    Prepare {
        /// Position in the job.
        position: usize,
        /// What went wrong.
        source: DoorError,
    },
    /// The chart could not be read.
    #[error("reading the chart for film rows {}..{}, columns {}..{}: {source}", .rect.y, .rect.bottom(), .rect.x, .rect.right())]
    Read {
        /// Position in the job.
        position: usize,
        /// Film rectangle being made.
        rect: Rect,
        /// Shards that its light reaches and that cannot be made without it.
        shards: Vec<ShardId>,
        /// What went wrong.
        source: DoorError,
    },
    /// A shard could not be encoded or written.
    #[error("making shard row {}, column {}: {source}", .id.row, .id.col)]
    Write {
        /// Which shard.
        id: ShardId,
        /// What went wrong.
        source: DoorError,
    },
}

impl RunError {
    /// The band's position in the job.
    pub fn position(&self) -> usize {
        match self {
            Self::Prepare { position, .. } | Self::Read { position, .. } => *position,
            Self::Write { id, .. } => id.band,
        }
    }

    /// What the source or the sink said.
    pub fn door(&self) -> &DoorError {
        match self {
            Self::Prepare { source, .. } | Self::Read { source, .. } | Self::Write { source, .. } => source,
        }
    }
}

/// A chart whose reading time is counted apart from resampling.
struct Timed<'a>(&'a dyn ChartSource, &'a Stage);

impl ChartSource for Timed<'_> {
    fn size(&self) -> crate::geometry::Size {
        self.0.size()
    }
    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), DoorError> {
        self.1.time(|| self.0.read(band, rect, out))
    }
    fn expect(&self, band: usize, rect: Rect) {
        self.1.time(|| self.0.expect(band, rect));
    }
}

/// A band on its way, and its tiles.
struct Running {
    position: usize,
    stages: BandStages,
    tiles: Vec<(usize, usize)>,
}

struct Light {
    band: Arc<Running>,
    tile: (usize, usize),
    light: Scattered,
    /// The chart could not be read: the shards it reaches cannot be made.
    lost: bool,
}

#[derive(Default)]
struct State {
    band: Option<Arc<Running>>,
    next_tile: usize,
    sequence: usize,
    bands_over: bool,
    fetching: bool,
    added: usize,
    adding: bool,
    waiting: BTreeMap<usize, Light>,
    finished: VecDeque<Finished>,
    spare: Vec<Scattered>,
    error: Option<RunError>,
    tiles: u64,
    pixels: u64,
}

enum Task {
    Tile { sequence: usize, band: Arc<Running>, index: usize, light: Scattered },
    Encode(Finished),
    Over,
}

struct Shared<'a, S: FilmSink> {
    work: &'a Work<'a>,
    chart: Timed<'a>,
    sink: &'a S,
    progress: &'a dyn Progress,
    spectra: SpectrumCache,
    clock: &'a Clock,
    state: Mutex<State>,
    changed: Condvar,
    overlap: Mutex<OverlapAdd>,
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
        state: Mutex::default(),
        changed: Condvar::new(),
        overlap: Mutex::new(OverlapAdd::new(work.windows)),
    };
    let (shards, bytes) = (AtomicU64::new(0), AtomicU64::new(0));
    std::thread::scope(|scope| {
        let (bands_out, bands_in) = bounded::<Running>(0);
        let (encoded_out, encoded_in) = bounded::<(ShardId, S::Encoded)>(WRITERS);
        let shared = &shared;
        scope.spawn(move || shared.prepare_bands(prepare, &bands_out));
        for _ in 0..WRITERS {
            let (inbox, shards, bytes) = (encoded_in.clone(), &shards, &bytes);
            scope.spawn(move || shared.write(&inbox, shards, bytes));
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
        interrupted: work.cancel.load(Ordering::Relaxed),
    })
}

impl<S: FilmSink> Shared<'_, S> {
    fn lock(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().expect("workers do not panic")
    }

    /// Stops the run, unless whoever follows it would rather go on without what `error` spoils.
    fn fail(&self, error: RunError) {
        if !self.progress.fault(&error) {
            self.lock().error.get_or_insert(error);
            self.changed.notify_all();
        }
    }

    fn stopping(&self, state: &State) -> bool {
        state.error.is_some() || self.work.cancel.load(Ordering::Relaxed)
    }

    /// Makes bands one ahead of the workers, who take them from `out`.
    fn prepare_bands(
        &self,
        prepare: &(dyn Fn(usize) -> Result<BandStages, DoorError> + Sync),
        out: &Sender<Running>,
    ) {
        for (position, band) in self.work.bands.iter().enumerate() {
            let tiles = tiles_needed(&band.tiling, self.work.windows, &band.wanted);
            if tiles.is_empty() || self.stopping(&self.lock()) {
                continue;
            }
            match self.clock.prepare.time(|| prepare(position)) {
                Ok(stages) => {
                    if out.send(Running { position, stages, tiles }).is_err() {
                        return;
                    }
                }
                Err(source) => self.fail(RunError::Prepare { position, source }),
            }
        }
    }

    /// What this worker should do next; waits where it must.
    fn next(&self, bands: &Receiver<Running>) -> Task {
        let ahead = AHEAD * self.work.threads.max(1);
        let mut state = self.lock();
        loop {
            if state.error.is_some() {
                return Task::Over;
            }
            if let Some(shard) = state.finished.pop_front() {
                return Task::Encode(shard);
            }
            let cancelled = self.work.cancel.load(Ordering::Relaxed);
            let over = state.bands_over || cancelled;
            let tiles_left = state.band.as_ref().map_or(0, |b| b.tiles.len() - state.next_tile);
            if tiles_left > 0 && !cancelled && state.sequence < state.added + ahead {
                let band = Arc::clone(state.band.as_ref().expect("it has tiles"));
                let (sequence, index) = (state.sequence, state.next_tile);
                state.sequence += 1;
                state.next_tile += 1;
                return Task::Tile { sequence, band, index, light: state.spare.pop().unwrap_or_default() };
            }
            if over && (tiles_left == 0 || cancelled) && state.added == state.sequence && !state.adding {
                self.changed.notify_all();
                return Task::Over;
            }
            if tiles_left == 0 && !over && !state.fetching {
                state.fetching = true;
                drop(state);
                let band = bands.recv();
                state = self.lock();
                state.fetching = false;
                match band {
                    Ok(band) => {
                        let tiling = &self.work.bands[band.position].tiling;
                        let film = self.work.frame.film.rect();
                        let on_film =
                            |&t: &(usize, usize)| tiling.rect(t).intersect(film).size().pixels() as u64;
                        self.progress.band(band.position, band.tiles.iter().map(on_film).sum());
                        state.band = Some(Arc::new(band));
                        state.next_tile = 0;
                    }
                    Err(_) => state.bands_over = true,
                }
                self.changed.notify_all();
                continue;
            }
            state = self.changed.wait(state).expect("workers do not panic");
        }
    }

    fn compute(&self, bands: &Receiver<Running>, encoded: &Sender<(ShardId, S::Encoded)>) {
        let (mut scene, mut scratch, mut psf) = (Vec::new(), SceneScratch::default(), PsfScratch::default());
        loop {
            match self.next(bands) {
                Task::Over => return,
                Task::Encode(shard) => {
                    let done =
                        self.clock.encode.time(|| self.sink.encode(shard.id, shard.rect, &shard.pixels));
                    self.overlap.lock().expect("workers do not panic").recycle(shard.pixels);
                    match done {
                        Ok(bytes) => {
                            // Writers are gone only after an error, which is told elsewhere.
                            let _ = encoded.send((shard.id, bytes));
                        }
                        Err(source) => self.fail(RunError::Write { id: shard.id, source }),
                    }
                }
                Task::Tile { sequence, band, index, mut light } => {
                    let work = &self.work.bands[band.position];
                    let (tile, stages) = (band.tiles[index], &band.stages);
                    let rect = work.tiling.rect(tile);
                    scene.resize(rect.size().pixels(), 0.0);
                    self.expect(&band, index + READ_AHEAD * self.work.threads.max(1));
                    let read = self.clock.scene.time(|| {
                        stages.scene.apply(&self.chart, work.chart_band, rect, &mut scene, &mut scratch)
                    });
                    let lost = read.is_err();
                    if let Err(source) = read {
                        let shards = self.shards(&band, tile);
                        self.fail(RunError::Read { position: band.position, rect, shards, source });
                    }
                    self.clock.svpsf.time(|| match &stages.psf {
                        _ if lost => (),
                        Some(stage) => {
                            stage.scatter(
                                &self.work.frame,
                                rect,
                                &scene,
                                &self.spectra,
                                &mut light,
                                &mut psf,
                            );
                        }
                        None => light.copy(&scene, rect.width),
                    });
                    self.add(sequence, Light { band, tile, light, lost });
                }
            }
        }
    }

    /// Lets the chart fetch what a later tile of the band will ask for.
    fn expect(&self, band: &Running, index: usize) {
        let work = &self.work.bands[band.position];
        if let Some(&tile) = band.tiles.get(index) {
            let rect = band.stages.scene.about(self.chart.size(), work.tiling.rect(tile));
            self.clock.scene.time(|| self.chart.expect(work.chart_band, rect));
        }
    }

    /// The wanted shards that the light of `tile` reaches.
    fn shards(&self, band: &Running, tile: (usize, usize)) -> Vec<ShardId> {
        let work = &self.work.bands[band.position];
        let reach = work.tiling.reach(tile);
        let of = |(window, w): (usize, &Window)| {
            let id = move |(row, col)| ShardId { band: band.position, window, row, col };
            w.touched(reach).map(id).filter(|id| work.wanted.contains(id)).collect::<Vec<_>>()
        };
        self.work.windows.iter().enumerate().flat_map(of).collect()
    }

    /// Hands in a tile's light; if it is this worker's turn, adds all that are next in order.
    fn add(&self, sequence: usize, light: Light) {
        let mut state = self.lock();
        state.waiting.insert(sequence, light);
        if state.adding {
            return;
        }
        state.adding = true;
        loop {
            let turn = state.added;
            let Some(Light { band, tile, light, lost }) = state.waiting.remove(&turn) else { break };
            drop(state);
            let work = &self.work.bands[band.position];
            let reach = work.tiling.reach(tile);
            let finished = self.clock.add.time(|| {
                let mut overlap = self.overlap.lock().expect("workers do not panic");
                if lost {
                    overlap.lose(&self.shards(&band, tile));
                    return Vec::new();
                }
                overlap.add(band.position, &work.tiling, &work.wanted, reach, &light)
            });
            let pixels = work.tiling.rect(tile).intersect(self.work.frame.film.rect()).size().pixels();
            self.progress.tile(band.position, pixels);
            state = self.lock();
            state.added += 1;
            state.tiles += 1;
            state.pixels += pixels as u64;
            state.spare.push(light);
            state.finished.extend(finished);
            self.changed.notify_all();
        }
        state.adding = false;
        self.changed.notify_all();
    }

    fn write(&self, inbox: &Receiver<(ShardId, S::Encoded)>, shards: &AtomicU64, bytes: &AtomicU64) {
        for (id, encoded) in inbox {
            match self.clock.write.time(|| self.sink.commit(encoded)) {
                Ok(written) => {
                    shards.fetch_add(1, Ordering::Relaxed);
                    bytes.fetch_add(written, Ordering::Relaxed);
                    self.progress.shard(id, written);
                }
                Err(source) => self.fail(RunError::Write { id, source }),
            }
        }
    }
}
