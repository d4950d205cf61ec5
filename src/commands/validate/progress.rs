//! Progress of a validation: one bar over all films and comparisons.

use crate::progress::counting;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Counter of the steps of a validation, shown as a bar.
pub struct Steps {
    done: AtomicU64,
    all: u64,
    bar: indicatif::ProgressBar,
    update: Box<dyn Fn(u64, u64) + Sync>,
}

impl Steps {
    /// A bar of `all` steps.
    pub fn new(all: u64) -> Self {
        let (bar, update) = counting("validating");
        update(0, all);
        Self { done: AtomicU64::new(0), all, bar, update: Box::new(update) }
    }

    /// Counts a step.
    pub fn step(&self) {
        (self.update)(self.done.fetch_add(1, Relaxed) + 1, self.all);
    }

    /// Removes the bar.
    pub fn clear(&self) {
        self.bar.finish_and_clear();
    }
}
