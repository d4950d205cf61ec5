//! One condition for the worker threads: something has changed, look again.
//!
//! Each part of the scheduler has a lock of its own and none of them waits while it is held. A worker reads the generation, asks
//! every part for work, and sleeps only if the generation is still the same: a change in between is never missed.

use std::sync::{Condvar, Mutex, PoisonError};

/// A generation counter that threads can wait on.
#[derive(Debug, Default)]
pub(super) struct Signal {
    generation: Mutex<u64>,
    changed: Condvar,
}

impl Signal {
    /// The present generation, to be read before looking for work.
    pub(super) fn generation(&self) -> u64 {
        *self.generation.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins a new generation and wakes all who wait.
    pub(super) fn notify(&self) {
        *self.generation.lock().unwrap_or_else(PoisonError::into_inner) += 1;
        self.changed.notify_all();
    }

    /// Waits until the generation is another one than `seen`.
    pub(super) fn wait(&self, seen: u64) {
        let generation = self.generation.lock().unwrap_or_else(PoisonError::into_inner);
        drop(self.changed.wait_while(generation, |now| *now == seen));
    }
}
