//! Condition variables of the scheduler: one for the workers, one for the GPU queues, with one generation counter.
//!
//! The parts of the scheduler have separate locks, and no thread waits while it holds one. A thread reads the generation, looks for work in
//! every part, and waits only if the generation is still the same: a change in between is never missed. Work that one worker can do wakes
//! one: every worker looks for all kinds of work, so as many are woken as there are things to do, whichever of them each one takes. Changes
//! that concern all threads (a band begins, the run ends) wake all.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// A generation counter that threads can wait on.
#[derive(Debug, Default)]
pub(super) struct Signal {
    state: Mutex<State>,
    workers: Condvar,
    queues: Condvar,
}

#[derive(Debug, Default)]
struct State {
    generation: u64,
    /// Workers that wait: without any, a notification needs no system call.
    waiting_workers: usize,
}

impl Signal {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The current generation, to be read before looking for work.
    pub(super) fn generation(&self) -> u64 {
        self.lock().generation
    }

    /// Begins a new generation and wakes all waiting threads.
    pub(super) fn notify_all(&self) {
        self.lock().generation += 1;
        self.workers.notify_all();
        self.queues.notify_all();
    }

    /// Begins a new generation with work for `count` workers, and wakes as many of those that wait.
    pub(super) fn notify_workers(&self, count: usize) {
        let waiting = {
            let mut state = self.lock();
            state.generation += 1;
            state.waiting_workers
        };
        for _ in 0..count.min(waiting) {
            self.workers.notify_one();
        }
    }

    /// Waits as a worker until the generation differs from `seen`.
    pub(super) fn wait_as_worker(&self, seen: u64) {
        let mut state = self.lock();
        state.waiting_workers += 1;
        let state = self.workers.wait_while(state, |now| now.generation == seen);
        state.unwrap_or_else(PoisonError::into_inner).waiting_workers -= 1;
    }

    /// Waits as a GPU queue until all threads are notified, unless the generation differs from `seen`.
    pub(super) fn wait_as_queue(&self, seen: u64) {
        drop(self.queues.wait_while(self.lock(), |now| now.generation == seen));
    }
}
