//! Queue of chart rectangles that workers read into page-locked memory for the GPU queues.

use super::signal::Signal;
use super::work::BandInFlight;
use crate::cuda::pool::Pinned;
use crate::flow::SourceSinkError;
use crate::geometry::Rect;
use crossbeam::channel::Sender;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

/// A chart rectangle to read for a tile.
pub(super) struct ChartRead<B> {
    pub(super) band: Arc<BandInFlight<B>>,
    /// Index of the tile in the band.
    pub(super) index: usize,
    pub(super) rect: Rect,
    pub(super) into: Pinned,
    pub(super) reply: Sender<ChartReply>,
}

/// Index of the tile in the band, its buffer, and the result of reading.
pub(super) type ChartReply = (usize, Pinned, Result<(), SourceSinkError>);

/// Queue of reads. After closing, reads are dropped together with their reply channels.
pub(super) struct ChartReads<'a, B> {
    signal: &'a Signal,
    state: Mutex<(VecDeque<ChartRead<B>>, bool)>,
}

impl<'a, B> ChartReads<'a, B> {
    /// An empty queue.
    pub(super) fn new(signal: &'a Signal) -> Self {
        Self { signal, state: Mutex::new((VecDeque::new(), false)) }
    }

    /// Adds a read; dropped if the queue is closed.
    pub(super) fn push(&self, read: ChartRead<B>) {
        let mut state = self.state.lock().expect("no panic while held");
        if !state.1 {
            state.0.push_back(read);
            drop(state);
            self.signal.notify_workers(1);
        }
    }

    /// The next read.
    pub(super) fn pop(&self) -> Option<ChartRead<B>> {
        self.state.lock().expect("no panic while held").0.pop_front()
    }

    /// Drops all reads, queued and future: the run has failed.
    pub(super) fn close(&self) {
        let dropped = {
            let mut state = self.state.lock().expect("no panic while held");
            state.1 = true;
            std::mem::take(&mut state.0)
        };
        drop(dropped);
    }
}
