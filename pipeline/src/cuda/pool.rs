//! Page-locked host buffers for copies to and from a device, and pools of them.
//!
//! Ordinary page-locked memory in both directions: write-combined memory would be a little faster to upload from, but charts
//! are checked for NaN after reading, and reading from write-combined memory is too slow.

use super::slice::{PinnedHostSlice, PinnedPart};
use super::{CudaError, Device};
use crossbeam::channel::{Receiver, Sender, unbounded};
use std::ops::{Deref, DerefMut};
use std::time::Duration;

/// A page-locked buffer. After a copy from or to it was enqueued, it must be kept and not accessed until an event behind that copy
/// has been waited for.
#[derive(Debug)]
pub(crate) struct Pinned(PinnedHostSlice<f32>);

impl Pinned {
    /// `len` zeros.
    pub(crate) fn zeroed(device: &Device, len: usize) -> Result<Self, CudaError> {
        device.allocate_pinned(len.max(1)).map(Self)
    }

    /// Consecutive parts of these lengths, which several threads fill.
    pub(crate) fn divide(self, lengths: impl Iterator<Item = usize>) -> Vec<PinnedPart<f32>> {
        self.0.divide(lengths)
    }

    /// The buffer of these parts, which are all of it.
    pub(crate) fn join(parts: Vec<PinnedPart<f32>>) -> Self {
        Self(PinnedHostSlice::join(parts).expect("all parts of one buffer"))
    }
}

impl Deref for Pinned {
    type Target = [f32];
    fn deref(&self) -> &[f32] {
        self.0.as_slice()
    }
}

impl DerefMut for Pinned {
    fn deref_mut(&mut self) -> &mut [f32] {
        self.0.as_mut_slice()
    }
}

/// A bounded number of buffers of one length, returned by a channel.
#[derive(Debug)]
pub(crate) struct PinnedPool {
    returns: Sender<Pinned>,
    free: Receiver<Pinned>,
    len: usize,
    allocated: usize,
    max: usize,
}

/// Interval between checks of `stopped` while waiting for a buffer.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

impl PinnedPool {
    /// At most `max` buffers of `len` values, allocated when they are needed.
    pub(crate) fn new(max: usize, len: usize) -> Self {
        let (returns, free) = unbounded();
        Self { returns, free, len, allocated: 0, max }
    }

    /// The channel by which buffers are returned.
    pub(crate) fn returns(&self) -> &Sender<Pinned> {
        &self.returns
    }

    /// A buffer; `None` if `stopped` while waiting for one.
    pub(crate) fn take(
        &mut self,
        device: &Device,
        stopped: &dyn Fn() -> bool,
    ) -> Result<Option<Pinned>, CudaError> {
        if let Ok(pinned) = self.free.try_recv() {
            return Ok(Some(pinned));
        }
        if self.allocated < self.max {
            let pinned = Pinned::zeroed(device, self.len)?;
            self.allocated += 1;
            return Ok(Some(pinned));
        }
        loop {
            match self.free.recv_timeout(POLL_INTERVAL) {
                Ok(pinned) => return Ok(Some(pinned)),
                Err(_) if stopped() => return Ok(None),
                Err(_) => (),
            }
        }
    }
}
