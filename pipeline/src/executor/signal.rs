//! A condition variable for the worker threads: the state of the scheduler has changed.
//!
//! The parts of the scheduler have separate locks, and no thread waits while it holds one. A worker reads the generation, looks for work in
//! every part, and waits only if the generation is still the same: a change in between is never missed.

use std::sync::{Condvar, Mutex, PoisonError};

/// A generation counter that threads can wait on.
#[derive(Debug, Default)]
pub(super) struct Signal {
    generation: Mutex<u64>,
    changed: Condvar,
}

impl Signal {
    /// The current generation, to be read before looking for work.
    pub(super) fn generation(&self) -> u64 {
        *self.generation.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins a new generation and wakes all waiting threads.
    pub(super) fn notify(&self) {
        *self.generation.lock().unwrap_or_else(PoisonError::into_inner) += 1;
        self.changed.notify_all();
    }

    /// Waits until the generation differs from `seen`.
    pub(super) fn wait(&self, seen: u64) {
        let generation = self.generation.lock().unwrap_or_else(PoisonError::into_inner);
        drop(self.changed.wait_while(generation, |now| *now == seen));
    }
}
