//! The sequence of all work items, bands one after the other: tiles that workers claim, or rows of shards that GPU queues claim.
//!
//! A thread prepares bands one ahead and offers them here. A worker claims a tile within the limits of the band's
//! [`Walk`](super::walk::Walk), plus [`super::MAX_TILES_AHEAD_PER_WORKER`] tiles per worker, which bounds memory. A GPU queue claims all
//! rows of shards of a band, so that each spectrum is built by one GPU, and parts of a band where fewer bands are left than GPUs: two GPUs
//! then build the spectra of the nodes at the border of their parts. Rows that a GPU could not compute are requeued and claimed first.

use super::signal::Signal;
use super::work::BandInFlight;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Consecutive items of a band.
pub(super) struct Batch<B> {
    pub(super) band: Arc<BandInFlight<B>>,
    /// Index of its first item in the band.
    pub(super) first: usize,
    pub(super) count: usize,
    /// Sequence number of its first item among all items of the job.
    pub(super) sequence: usize,
}

impl<B> Batch<B> {
    /// Its items with their sequence numbers.
    pub(super) fn items(&self) -> impl Iterator<Item = (usize, (usize, usize))> + '_ {
        (self.sequence..).zip(self.band.items[self.first..][..self.count].iter().copied())
    }

    /// The `count` items from index `first` of the batch.
    pub(super) fn part(&self, first: usize, count: usize) -> Self {
        let band = Arc::clone(&self.band);
        Self { band, first: self.first + first, count, sequence: self.sequence + first }
    }
}

/// Result of a claim.
pub(super) enum Claim<B> {
    /// Items to compute.
    Batch(Batch<B>),
    /// None now; the [`Signal`] is notified when there may be some.
    None,
    /// All items are done.
    Over,
}

/// Items in order; see the module.
pub(super) struct TileSource<'a, B> {
    signal: &'a Signal,
    cancel: &'a AtomicBool,
    state: Mutex<State<B>>,
    /// Notified when the offered band is taken or the source is closed.
    taken: Condvar,
}

struct State<B> {
    band: Option<Arc<BandInFlight<B>>>,
    next_item: usize,
    /// Items claimed so far.
    sequence: usize,
    /// Items done so far without a gap: the sequence number of the oldest item not yet done. A tile is done when it is added.
    added: usize,
    /// Items done beyond it.
    added_beyond: BTreeSet<usize>,
    /// Tiles that workers have computed and submitted so far.
    submitted: usize,
    offered: Option<BandInFlight<B>>,
    last_band_offered: bool,
    requeued: BTreeMap<usize, Batch<B>>,
    gpus: usize,
    closed: bool,
}

impl<B> State<B> {
    fn items_left(&self) -> usize {
        self.band.as_ref().map_or(0, |b| b.items.len() - self.next_item)
    }

    /// Whether the next tile is less than `ahead` tiles beyond the limits of its band.
    fn is_within(&self, ahead: usize) -> bool {
        let Some(band) = &self.band else { return false };
        let distance = self.sequence - self.added;
        distance < band.distance + ahead && distance - self.added_beyond.len() < band.waiting + ahead
    }

    fn take(&mut self, count: usize) -> Batch<B> {
        let band = Arc::clone(self.band.as_ref().expect("it has items"));
        let (sequence, first) = (self.sequence, self.next_item);
        self.sequence += count;
        self.next_item += count;
        Batch { band, first, count, sequence }
    }

    /// Whether all items are done. Of a cancelled run all claimed tiles need only be submitted: a tile may wait for others of its shards
    /// that are claimed after it, and those no longer are.
    fn is_over(&self, cancelled: bool) -> bool {
        let all_claimed = self.last_band_offered && self.offered.is_none() && self.items_left() == 0;
        (cancelled || all_claimed) && self.added == self.sequence
            || cancelled && self.submitted == self.sequence
    }
}

impl<'a, B> TileSource<'a, B> {
    /// Without bands, for `gpus` GPU queues; `cancel` ends it early.
    pub(super) fn new(signal: &'a Signal, cancel: &'a AtomicBool, gpus: usize) -> Self {
        let state = State {
            band: None,
            next_item: 0,
            sequence: 0,
            added: 0,
            added_beyond: BTreeSet::new(),
            submitted: 0,
            offered: None,
            last_band_offered: false,
            requeued: BTreeMap::new(),
            gpus,
            closed: false,
        };
        Self { signal, cancel, state: Mutex::new(state), taken: Condvar::new() }
    }

    fn lock(&self) -> MutexGuard<'_, State<B>> {
        self.state.lock().expect("no panic while held")
    }

    fn cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }

    /// Whether further bands are accepted.
    pub(super) fn is_open(&self) -> bool {
        !self.cancelled() && !self.lock().closed
    }

    /// Offers the next band and waits until its items are next; `false`: no further bands are accepted.
    pub(super) fn offer(&self, band: BandInFlight<B>) -> bool {
        let mut state = self.lock();
        state.offered = Some(band);
        self.signal.notify_all();
        let state = self.taken.wait_while(state, |s| s.offered.is_some() && !s.closed);
        !state.expect("no panic while held").closed
    }

    /// Marks the last offered band as the last of the job.
    pub(super) fn end_of_bands(&self) {
        self.lock().last_band_offered = true;
        self.signal.notify_all();
    }

    /// Accepts no further bands: the run has ended, failed or panicked.
    pub(super) fn close(&self) {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).closed = true;
        self.taken.notify_all();
    }

    /// Claims one tile for a worker, at most `ahead` tiles beyond the limits of the band's walk; `begun` is called with each new band.
    pub(super) fn claim_tile(&self, ahead: usize, begun: &dyn Fn(&BandInFlight<B>)) -> Claim<B> {
        let mut state = self.lock();
        self.next_band(&mut state, begun);
        if state.is_over(self.cancelled()) {
            return Claim::Over;
        }
        let free = !self.cancelled() && state.items_left() > 0 && state.is_within(ahead);
        if free { Claim::Batch(state.take(1)) } else { Claim::None }
    }

    /// Whether all items are done.
    pub(super) fn is_over(&self) -> bool {
        self.lock().is_over(self.cancelled())
    }

    /// Claims rows of shards for a GPU: requeued ones first, then the next ones.
    pub(super) fn claim_portion(&self, begun: &dyn Fn(&BandInFlight<B>)) -> Claim<B> {
        let mut state = self.lock();
        if let Some((_, batch)) = state.requeued.pop_first() {
            return Claim::Batch(batch);
        }
        self.next_band(&mut state, begun);
        if state.is_over(self.cancelled()) {
            return Claim::Over;
        }
        if state.items_left() == 0 || self.cancelled() {
            return Claim::None;
        }
        let count = portion_rows(&state);
        Claim::Batch(state.take(count))
    }

    /// Begins the offered band once all items of the present one are claimed.
    fn next_band(&self, state: &mut State<B>, begun: &dyn Fn(&BandInFlight<B>)) {
        if state.items_left() > 0 || self.cancelled() {
            return;
        }
        if let Some(band) = state.offered.take() {
            begun(&band);
            state.band = Some(Arc::new(band));
            state.next_item = 0;
            self.taken.notify_all();
            self.signal.notify_all();
        }
    }

    /// Requeues a batch that a GPU could not compute.
    pub(super) fn requeue(&self, batch: Batch<B>) {
        self.lock().requeued.insert(batch.sequence, batch);
        self.signal.notify_all();
    }

    /// Counts the item with number `sequence` as done.
    pub(super) fn item_done(&self, sequence: usize) {
        let (is_over, claimable) = {
            let mut state = self.lock();
            let before = state.added;
            if sequence >= state.added {
                state.added_beyond.insert(sequence);
            }
            while state.added_beyond.first() == Some(&state.added) {
                state.added_beyond.pop_first();
                state.added += 1;
            }
            // A tile that is added beyond the oldest one lets one more be claimed.
            (state.is_over(self.cancelled()), (state.added - before).max(1))
        };
        // As many more tiles are within the limits.
        if is_over { self.signal.notify_all() } else { self.signal.notify_workers(claimable) }
    }

    /// Counts a tile that a worker has submitted.
    pub(super) fn tile_submitted(&self) {
        let is_over = {
            let mut state = self.lock();
            state.submitted += 1;
            state.is_over(self.cancelled())
        };
        if is_over {
            self.signal.notify_all();
        }
    }

    /// Removes a GPU queue; returns the number of queues left and the position of the band in flight.
    pub(super) fn remove_gpu(&self) -> (usize, usize) {
        let mut state = self.lock();
        state.gpus -= 1;
        let found = (state.gpus, state.band.as_ref().map_or(0, |b| b.position));
        drop(state);
        self.signal.notify_all();
        found
    }
}

/// Rows of shards of the next portion: all, or fewer and fewer where the GPUs share the last bands, so that GPUs of unequal speed finish together.
fn portion_rows<B>(state: &State<B>) -> usize {
    let (left, bands_after) = (state.items_left(), state.band.as_ref().map_or(0, |band| band.bands_after));
    match state.gpus {
        gpus if bands_after + 1 >= gpus => left,
        gpus => left.div_ceil(2 * gpus),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of shards of each portion of `bands` bands of `rows` rows.
    fn portions(gpus: usize, bands: usize, rows: usize) -> Vec<usize> {
        let (signal, cancel) = (Signal::default(), AtomicBool::new(false));
        let source = TileSource::<()>::new(&signal, &cancel, gpus);
        let mut counts = Vec::new();
        for position in 0..bands {
            let items = (0..rows).map(|row| (0, row)).collect();
            let bands_after = bands - 1 - position;
            let band = BandInFlight {
                position,
                stages: (),
                items,
                counted: Mutex::default(),
                bands_after,
                distance: 0,
                waiting: 0,
            };
            source.lock().offered = Some(band);
            let first = counts.len();
            while counts[first..].iter().sum::<usize>() < rows {
                let Claim::Batch(batch) = source.claim_portion(&|_| ()) else { panic!("no portion") };
                assert_eq!(batch.band.position, position);
                counts.push(batch.count);
            }
        }
        counts
    }

    #[test]
    fn bands_are_divided_only_where_fewer_are_left_than_gpus() {
        assert_eq!(portions(1, 2, 7), [7, 7]);
        assert_eq!(portions(2, 3, 7), [7, 7, 2, 2, 1, 1, 1]);
        assert_eq!(portions(3, 3, 4), [4, 1, 1, 1, 1, 1, 1, 1, 1]);
    }
}
