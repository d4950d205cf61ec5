//! What comes next: bands one ahead of the workers, tiles in order, shards to encode as they get finished.

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
pub(super) struct Running {
    pub(super) position: usize,
    pub(super) stages: BandStages,
    pub(super) tiles: Vec<(usize, usize)>,
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
    pub(super) spare: Vec<Scattered>,
    pub(super) error: Option<RunError>,
    pub(super) tiles: u64,
    pub(super) pixels: u64,
}

pub(super) enum Task {
    Tile { sequence: usize, band: Arc<Running>, index: usize, light: Scattered },
    Encode(Finished),
    Over,
}

pub(super) struct Shared<'a, S: FilmSink> {
    pub(super) work: &'a Work<'a>,
    pub(super) chart: Timed<'a>,
    pub(super) sink: &'a S,
    pub(super) progress: &'a dyn Progress,
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
            self.lock().error.get_or_insert(error);
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

    /// What this worker should do next; waits where it must.
    pub(super) fn next(&self, bands: &Receiver<Running>) -> Task {
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
}
