//! Finished shards: encoded by the workers, written by threads that do nothing else.
//!
//! The queue between them is short, so that workers wait for the disk rather than fill the memory with encoded shards.

use super::Progress;
use super::QUEUE;
use super::error::RunError;
use super::signal::Signal;
use crate::clock::Clock;
use crate::flow::FilmSink;
use crate::overlap_add::Finished;
use crate::plan::ShardId;
use crossbeam::channel::{Receiver, Sender, bounded};
use std::collections::VecDeque;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// Shards on their way to the sink; see the module.
pub(super) struct ShardWriter<'a, S: FilmSink> {
    sink: &'a S,
    clock: &'a Clock,
    signal: &'a Signal,
    finished: Mutex<VecDeque<Finished>>,
    shards: AtomicU64,
    bytes: AtomicU64,
}

/// The queue of encoded shards.
pub(super) type Encoded<S> = (ShardId, <S as FilmSink>::Encoded);

impl<'a, S: FilmSink> ShardWriter<'a, S> {
    /// Into `sink`.
    pub(super) fn new(sink: &'a S, clock: &'a Clock, signal: &'a Signal) -> Self {
        let (shards, bytes) = (AtomicU64::new(0), AtomicU64::new(0));
        Self { sink, clock, signal, finished: Mutex::default(), shards, bytes }
    }

    /// The queue from the workers to the writing threads.
    pub(super) fn queue() -> (Sender<Encoded<S>>, Receiver<Encoded<S>>) {
        bounded(QUEUE)
    }

    /// Threads that write.
    pub(super) fn threads(&self) -> usize {
        self.sink.writers().max(1)
    }

    /// Shards that nothing can reach any more, to be encoded.
    pub(super) fn push(&self, finished: Vec<Finished>) {
        if !finished.is_empty() {
            self.finished.lock().expect("no panic while held").extend(finished);
            self.signal.notify();
        }
    }

    /// The next shard to encode.
    pub(super) fn pop(&self) -> Option<Finished> {
        self.finished.lock().expect("no panic while held").pop_front()
    }

    /// Encodes a shard; its pixels come back for the next one.
    pub(super) fn encode(&self, shard: Finished) -> (Vec<f32>, Result<Encoded<S>, RunError>) {
        let Finished { id, rect, pixels } = shard;
        let encoded = self.clock.encode.time(|| self.sink.encode(id, rect, &pixels));
        let encoded = encoded.map(|e| (id, e)).map_err(|source| RunError::Write { id, source });
        (pixels, encoded)
    }

    /// Writes what comes in by `queue` until it ends; `failed` gets what goes wrong.
    pub(super) fn write(
        &self,
        queue: &Receiver<Encoded<S>>,
        progress: &dyn Progress,
        failed: &dyn Fn(RunError),
    ) {
        for (id, encoded) in queue {
            match self.clock.write.time(|| self.sink.commit(encoded)) {
                Ok(written) => {
                    self.shards.fetch_add(1, Ordering::Relaxed);
                    self.bytes.fetch_add(written, Ordering::Relaxed);
                    progress.shard(id, written);
                }
                Err(source) => failed(RunError::Write { id, source }),
            }
        }
    }

    /// Shards and bytes written.
    pub(super) fn written(&self) -> (u64, u64) {
        (self.shards.load(Ordering::Relaxed), self.bytes.load(Ordering::Relaxed))
    }
}
