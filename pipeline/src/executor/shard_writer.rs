//! Finished shards: encoded by the workers, written by separate threads.
//!
//! The number of encoded shards is limited: workers wait for the disk instead of filling the memory with them.

use super::error::RunError;
use super::overlap_add::FinishedShard;
use super::progress::Progress;
use super::signal::Signal;
use crate::buffer::ShardPixels;
use crate::clock::{Clock, Phase};
use crate::flow::FilmSink;
use crate::tiling::ShardId;
use crossbeam::channel::{Receiver, Sender, bounded, unbounded};
use std::collections::VecDeque;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// Encodes and writes shards; see the module.
pub(super) struct ShardWriter<'a, S: FilmSink> {
    sink: &'a S,
    clock: &'a Clock,
    signal: &'a Signal,
    finished: Mutex<VecDeque<FinishedShard>>,
    /// As many entries as encoded shards; full at the limit.
    encoded: (Sender<()>, Receiver<()>),
    shards: AtomicU64,
    bytes: AtomicU64,
}

/// An encoded shard.
pub(super) type Encoded<S> = (ShardId, <S as FilmSink>::Encoded);

impl<'a, S: FilmSink> ShardWriter<'a, S> {
    /// For `sink`, with `max_encoded` encoded shards at most.
    pub(super) fn new(sink: &'a S, max_encoded: usize, clock: &'a Clock, signal: &'a Signal) -> Self {
        let (shards, bytes) = (AtomicU64::new(0), AtomicU64::new(0));
        let encoded = bounded(max_encoded.max(1));
        Self { sink, clock, signal, finished: Mutex::default(), encoded, shards, bytes }
    }

    /// The queue from the workers to the writing threads.
    pub(super) fn queue() -> (Sender<Encoded<S>>, Receiver<Encoded<S>>) {
        unbounded()
    }

    /// Number of writing threads.
    pub(super) fn threads(&self) -> usize {
        self.sink.writers().max(1)
    }

    /// Adds a shard to be encoded.
    pub(super) fn push(&self, finished: FinishedShard) {
        self.finished.lock().expect("no panic while held").push_back(finished);
        self.signal.notify_workers(1);
    }

    /// The next shard to encode.
    pub(super) fn pop(&self) -> Option<FinishedShard> {
        self.finished.lock().expect("no panic while held").pop_front()
    }

    /// Encodes a shard, once there are fewer encoded ones than the limit; also returns its buffers, to be recycled.
    pub(super) fn encode(&self, shard: FinishedShard) -> (ShardPixels, Result<Encoded<S>, RunError>) {
        let FinishedShard { id, rect, pixels } = shard;
        self.encoded.0.send(()).expect("its receiver is part of this");
        let encoded = self.clock.of(Phase::Encode).time(|| self.sink.encode(id, rect, &pixels));
        let encoded = encoded.map(|e| (id, e)).map_err(|source| {
            self.release();
            RunError::Write { id, source }
        });
        (pixels, encoded)
    }

    /// Makes way for another encoded shard.
    fn release(&self) {
        self.encoded.1.recv().expect("its sender is part of this");
    }

    /// Writes the shards of `queue` until it is closed; `failed` receives errors.
    pub(super) fn write(
        &self,
        queue: &Receiver<Encoded<S>>,
        progress: &dyn Progress,
        failed: &dyn Fn(RunError),
    ) {
        for (id, encoded) in queue {
            let committed = {
                let _released = Released(self);
                self.clock.of(Phase::Write).time(|| self.sink.commit(encoded))
            };
            match committed {
                Ok(written) => {
                    self.shards.fetch_add(1, Ordering::Relaxed);
                    self.bytes.fetch_add(written, Ordering::Relaxed);
                    progress.shard(id, written);
                }
                Err(source) => failed(RunError::Write { id, source }),
            }
        }
    }

    /// Takes the rest of `queue` when it is dropped: what a panic has left there, as workers wait for others to be written.
    pub(super) fn drained_at_end(&'a self, queue: &'a Receiver<Encoded<S>>) -> impl Drop {
        Drained(self, queue)
    }

    /// Shards and bytes written.
    pub(super) fn written(&self) -> (u64, u64) {
        (self.shards.load(Ordering::Relaxed), self.bytes.load(Ordering::Relaxed))
    }
}

/// Makes way for another encoded shard when it is dropped, also by a panic.
struct Released<'a, 'b, S: FilmSink>(&'a ShardWriter<'b, S>);

impl<S: FilmSink> Drop for Released<'_, '_, S> {
    fn drop(&mut self) {
        self.0.release();
    }
}

/// See [`ShardWriter::drained_at_end`].
struct Drained<'a, S: FilmSink>(&'a ShardWriter<'a, S>, &'a Receiver<Encoded<S>>);

impl<S: FilmSink> Drop for Drained<'_, S> {
    fn drop(&mut self) {
        self.1.iter().for_each(|_| self.0.release());
    }
}
