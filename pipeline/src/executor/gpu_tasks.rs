//! What workers do for the GPU queues: reading charts into page-locked memory, and copying downloaded film rows to shards.

use super::portion::Portion;
use super::signal::Signal;
use super::work::BandInFlight;
use crate::cuda::pool::Pinned;
use crate::cuda::slice::PinnedPart;
use crate::flow::SourceSinkError;
use crate::geometry::Rect;
use crossbeam::channel::Sender;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

/// A chart rectangle to read for a tile.
pub(super) struct ChartRead<B> {
    pub(super) band: Arc<BandInFlight<B>>,
    /// Index of the tile in its batch.
    pub(super) index: usize,
    pub(super) rect: Rect,
    /// Film rectangle of a later tile, whose chart is prefetched.
    pub(super) later: Option<Rect>,
    /// Its part of the page-locked buffer of the batch.
    pub(super) into: PinnedPart<f32>,
    pub(super) reply: Sender<ChartReply>,
}

/// Index of the tile in its batch, its part of the buffer, and the result of reading.
pub(super) type ChartReply = (usize, PinnedPart<f32>, Result<(), SourceSinkError>);

/// Downloaded film rows.
pub(super) struct DownloadedRows<B> {
    pub(super) portion: Arc<Portion<B>>,
    /// The film rectangle of `values`.
    pub(super) rect: Rect,
    pub(super) values: Pinned,
    /// Returns the buffer to its pool.
    pub(super) returns: Sender<Pinned>,
}

/// A queue of tasks for workers. After closing, tasks are dropped.
pub(super) struct TaskQueue<'a, T> {
    signal: &'a Signal,
    state: Mutex<(VecDeque<T>, bool)>,
}

impl<'a, T> TaskQueue<'a, T> {
    /// An empty queue.
    pub(super) fn new(signal: &'a Signal) -> Self {
        Self { signal, state: Mutex::new((VecDeque::new(), false)) }
    }

    /// Adds a task; dropped if the queue is closed.
    pub(super) fn push(&self, task: T) {
        let mut state = self.state.lock().expect("no panic while held");
        if !state.1 {
            state.0.push_back(task);
            drop(state);
            self.signal.notify_workers(1);
        }
    }

    /// The next task.
    pub(super) fn pop(&self) -> Option<T> {
        self.state.lock().expect("no panic while held").0.pop_front()
    }

    /// Drops all tasks, queued and future: the run has failed.
    pub(super) fn close(&self) {
        let dropped = {
            let mut state = self.state.lock().expect("no panic while held");
            state.1 = true;
            std::mem::take(&mut state.0)
        };
        drop(dropped);
    }
}
