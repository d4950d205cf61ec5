//! The executor as devices see it: tiles a batch at a time off the one sequence, their charts read by the workers, and the
//! way back for what a device could not do.

use super::RunError;
use super::feed::{Running, Shared, State};
use super::turn::{Light, Thrown};
use super::worker::READ_AHEAD;
use crate::cuda::CudaError;
use crate::cuda::pool::Pinned;
use crate::flow::{DoorError, FilmSink};
use crate::geometry::Rect;
use crate::scene::SceneScratch;
use crossbeam::channel::{Receiver, Sender, TryRecvError};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Consecutive tiles of a band, all of one row.
pub(crate) struct Batch {
    pub(crate) band: Arc<Running>,
    /// Its first tile among the band's.
    pub(crate) first: usize,
    pub(crate) count: usize,
    /// The first tile's place in the sequence of all.
    pub(crate) sequence: usize,
    /// A device could not do it.
    pub(crate) returned: bool,
}

impl Batch {
    /// Its tiles with their places in the sequence.
    pub(crate) fn tiles(&self) -> impl Iterator<Item = (usize, (usize, usize))> + '_ {
        (self.sequence..).zip(self.band.tiles[self.first..][..self.count].iter().copied())
    }

    /// Cuts it after `count` tiles; what is left, if any.
    pub(crate) fn cut(&mut self, count: usize) -> Option<Self> {
        let left = self.count.saturating_sub(count);
        self.count -= left;
        let (by, returned) = (self.count, self.returned);
        let rest =
            |band| Self { band, first: self.first + by, count: left, sequence: self.sequence + by, returned };
        (left > 0).then(|| rest(Arc::clone(&self.band)))
    }
}

/// A chart rectangle that a device waits for.
pub(crate) struct Fetch {
    pub(crate) band: Arc<Running>,
    /// Which tile of the band.
    pub(crate) index: usize,
    pub(crate) rect: Rect,
    pub(crate) into: Pinned,
    pub(crate) back: Sender<Fetched>,
}

/// The answer: the tile of the band, its buffer, and how reading went.
pub(crate) type Fetched = (usize, Pinned, Result<(), DoorError>);

/// What a device gets when it asks for work.
pub(crate) enum Claim {
    Batch(Batch),
    /// Nothing now; only said to those who do not want to wait.
    Wait,
    Over,
}

/// How a device asks for work.
pub(crate) struct Asking<'a> {
    /// Tiles that it takes of a band at once.
    pub(crate) most: &'a dyn Fn(&Running) -> usize,
    /// The device has failed: it gets nothing more.
    pub(crate) gone: &'a AtomicBool,
    /// Waits for work.
    pub(crate) wait: bool,
}

impl<S: FilmSink> Shared<'_, S> {
    /// The next batch: first what other devices have returned, then the next tiles of the sequence.
    pub(crate) fn claim(&self, bands: &Receiver<Running>, asking: &Asking<'_>) -> Claim {
        let mut state = self.lock();
        loop {
            if state.error.is_some() || asking.gone.load(Ordering::SeqCst) {
                return Claim::Over;
            }
            if let Some((_, mut batch)) = state.returned.pop_first() {
                if let Some(rest) = batch.cut((asking.most)(&batch.band).max(1)) {
                    state.returned.insert(rest.sequence, rest);
                }
                return Claim::Batch(batch);
            }
            let cancelled = self.work.cancel.load(Ordering::Relaxed);
            if state.tiles_left() > 0 && !cancelled {
                let count = self.share(&state, asking.most);
                return Claim::Batch(state.take(count));
            }
            if self.is_over(&state) {
                self.changed.notify_all();
                return Claim::Over;
            }
            if state.wants_band() && !cancelled {
                state.fetching = true;
                drop(state);
                let band = match asking.wait {
                    true => bands.recv().map_err(|_| TryRecvError::Disconnected),
                    false => bands.try_recv(),
                };
                state = self.lock();
                match band {
                    Err(TryRecvError::Empty) => {
                        state.fetching = false;
                        self.changed.notify_all();
                    }
                    band => {
                        self.begin(&mut state, band.ok());
                        continue;
                    }
                }
            }
            if !asking.wait {
                return Claim::Wait;
            }
            state = self.changed.wait(state).expect("workers do not panic");
        }
    }

    /// How many of the next tiles to take at once: equal parts of a row, and less towards the end of a band where devices
    /// share it, so that unequal ones end together.
    fn share(&self, state: &State, most: &dyn Fn(&Running) -> usize) -> usize {
        let band = state.band.as_ref().expect("it has tiles");
        let left = &band.tiles[state.next_tile..];
        let row = left.iter().take_while(|tile| tile.0 == left[0].0).count();
        let most = most(band).max(1);
        let part = row.div_ceil(row.div_ceil(most));
        match state.queues {
            0 | 1 => part,
            queues => part.min(left.len().div_ceil(2 * queues)),
        }
    }

    /// A device could not do `batch`: others will.
    pub(crate) fn give_back(&self, batch: Batch) {
        let batch = Batch { returned: true, ..batch };
        self.lock().returned.insert(batch.sequence, batch);
        self.changed.notify_all();
    }

    /// A device leaves because of `error`. The run ends with the last one.
    pub(crate) fn leave(&self, device: &str, error: CudaError) {
        let (left, position) = {
            let mut state = self.lock();
            state.queues -= 1;
            (state.queues, state.band.as_ref().map_or(0, |b| b.position))
        };
        self.changed.notify_all();
        self.progress.device_left(device, &error, left);
        if left == 0 {
            self.fail(RunError::Device { position, source: Box::new(error) });
        }
    }

    /// Has the workers read the chart for a tile.
    pub(crate) fn ask(&self, fetch: Fetch) {
        let mut state = self.lock();
        if state.error.is_none() {
            state.fetches.push_back(fetch);
            self.changed.notify_all();
        }
    }

    /// Whether the run has failed.
    pub(crate) fn failed(&self) -> bool {
        self.lock().error.is_some()
    }

    /// Reads what a device waits for.
    pub(super) fn fetch(&self, fetch: Fetch, scratch: &mut SceneScratch) {
        let Fetch { band, index, rect, mut into, back } = fetch;
        self.expect(&band, index + READ_AHEAD * self.work.threads.max(1));
        let chart_band = self.work.bands[band.position].chart_band;
        let out = &mut into[..rect.size().pixels()];
        let read =
            self.clock.scene.time(|| band.stages.scene.fill(&self.chart, chart_band, rect, out, scratch));
        // A device that has left wants no answer.
        let _ = back.send((index, into, read));
    }

    /// Hands in a tile that a device has done, or whose chart could not be read.
    pub(crate) fn hand_in(&self, batch: &Batch, sequence: usize, light: Thrown) {
        let tile = batch.band.tiles[batch.first + sequence - batch.sequence];
        self.add(sequence, Light { band: Arc::clone(&batch.band), tile, light });
    }
}
