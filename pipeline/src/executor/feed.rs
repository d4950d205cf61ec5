//! What comes next: bands one ahead of the workers, tiles in order, shards to encode as they get finished.

use super::devices::{Batch, Fetch};
use super::turn::Light;
use super::{AHEAD, BandStages, RunError, Work};
use crate::clock::{Clock, Stage};
use crate::flow::{ChartSource, DoorError, FilmSink, Progress};
use crate::geometry::Rect;
use crate::overlap_add::{Finished, OverlapAdd, tiles_needed};
use crate::psf::Scattered;
use crate::psf::spectra::SpectrumCache;
use crossbeam::channel::{Receiver, Sender};
use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Condvar, Mutex};

/// A chart whose reading time is counted apart from resampling.
pub(super) struct Timed<'a>(pub(super) &'a dyn ChartSource, pub(super) &'a Stage);

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
pub(crate) struct Running {
    pub(crate) position: usize,
    pub(crate) stages: BandStages,
    pub(crate) tiles: Vec<(usize, usize)>,
}

#[derive(Default)]
pub(super) struct State {
    pub(super) band: Option<Arc<Running>>,
    pub(super) next_tile: usize,
    pub(super) sequence: usize,
    pub(super) bands_over: bool,
    pub(super) fetching: bool,
    pub(super) added: usize,
    pub(super) adding: bool,
    pub(super) waiting: BTreeMap<usize, Light>,
    pub(super) finished: VecDeque<Finished>,
    /// Charts that devices wait for, in order.
    pub(super) fetches: VecDeque<Fetch>,
    /// What devices could not do, by its first tile's place in the sequence.
    pub(super) returned: BTreeMap<usize, Batch>,
    /// Devices that are left.
    pub(super) queues: usize,
    pub(super) spare: Vec<Scattered>,
    pub(super) error: Option<RunError>,
    pub(super) tiles: u64,
    pub(super) pixels: u64,
}

pub(super) enum Task {
    Tile { sequence: usize, band: Arc<Running>, index: usize, light: Scattered },
    Encode(Finished),
    Fetch(Fetch),
    Over,
}

pub(crate) struct Shared<'a, S: FilmSink> {
    pub(crate) work: &'a Work<'a>,
    pub(super) chart: Timed<'a>,
    pub(super) sink: &'a S,
    pub(crate) progress: &'a dyn Progress,
    pub(super) spectra: SpectrumCache,
    pub(super) clock: &'a Clock,
    pub(super) state: Mutex<State>,
    pub(super) changed: Condvar,
    pub(super) overlap: Mutex<OverlapAdd>,
}

impl<S: FilmSink> Shared<'_, S> {
    pub(super) fn lock(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().expect("workers do not panic")
    }

    /// Stops the run, unless whoever follows it would rather go on without what `error` spoils.
    pub(super) fn fail(&self, error: RunError) {
        if !self.progress.fault(&error) {
            let mut state = self.lock();
            state.error.get_or_insert(error);
            // Whoever waits for one of them learns that it will not come.
            state.fetches.clear();
            self.changed.notify_all();
        }
    }

    fn stopping(&self, state: &State) -> bool {
        state.error.is_some() || self.work.cancel.load(Ordering::Relaxed)
    }

    /// Makes bands one ahead of the workers, who take them from `out`.
    pub(super) fn prepare_bands(
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

    /// What this worker should do next; waits where it must. Tiles are for workers only where there is no device.
    pub(super) fn next(&self, bands: &Receiver<Running>) -> Task {
        let ahead = AHEAD * self.work.threads.max(1);
        let computes = self.work.queues.is_empty();
        let mut state = self.lock();
        loop {
            if state.error.is_some() {
                return Task::Over;
            }
            if let Some(shard) = state.finished.pop_front() {
                return Task::Encode(shard);
            }
            if let Some(fetch) = state.fetches.pop_front() {
                return Task::Fetch(fetch);
            }
            let cancelled = self.work.cancel.load(Ordering::Relaxed);
            if computes && state.tiles_left() > 0 && !cancelled && state.sequence < state.added + ahead {
                let light = state.spare.pop().unwrap_or_default();
                let Batch { band, first, sequence, .. } = state.take(1);
                return Task::Tile { sequence, band, index: first, light };
            }
            if self.is_over(&state) {
                self.changed.notify_all();
                return Task::Over;
            }
            if computes && state.wants_band() && !cancelled {
                state.fetching = true;
                drop(state);
                let band = bands.recv();
                state = self.lock();
                self.begin(&mut state, band.ok());
                continue;
            }
            state = self.changed.wait(state).expect("workers do not panic");
        }
    }

    /// All tiles there will be are added.
    pub(super) fn is_over(&self, state: &State) -> bool {
        let cancelled = self.work.cancel.load(Ordering::Relaxed);
        let no_more = cancelled || state.bands_over && state.tiles_left() == 0;
        no_more && state.added == state.sequence && !state.adding
    }

    /// The next band is there (`None`: there is none).
    pub(super) fn begin(&self, state: &mut State, band: Option<Running>) {
        state.fetching = false;
        match band {
            Some(band) => {
                let tiling = &self.work.bands[band.position].tiling;
                let film = self.work.frame.film.rect();
                let on_film = |&t: &(usize, usize)| tiling.rect(t).intersect(film).size().pixels() as u64;
                self.progress.band(band.position, band.tiles.iter().map(on_film).sum());
                state.band = Some(Arc::new(band));
                state.next_tile = 0;
            }
            None => state.bands_over = true,
        }
        self.changed.notify_all();
    }
}

impl State {
    /// Tiles of the present band that nobody has taken.
    pub(super) fn tiles_left(&self) -> usize {
        self.band.as_ref().map_or(0, |b| b.tiles.len() - self.next_tile)
    }

    /// Somebody must get the next band.
    pub(super) fn wants_band(&self) -> bool {
        self.tiles_left() == 0 && !self.bands_over && !self.fetching
    }

    /// The next `count` tiles of the present band, which has them.
    pub(super) fn take(&mut self, count: usize) -> Batch {
        let band = Arc::clone(self.band.as_ref().expect("it has tiles"));
        let (sequence, first) = (self.sequence, self.next_tile);
        self.sequence += count;
        self.next_tile += count;
        Batch { band, first, count, sequence, returned: false }
    }
}
