//! Page-locked host buffers for copies to and from a device, and pools of them.
//!
//! Ordinary page-locked memory in both directions: write-combined memory would be a little faster to upload from, but charts
//! are checked for NaN after reading, and reading from write-combined memory is too slow.

use super::slice::PinnedHostSlice;
use super::{CudaError, Device};
use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, unbounded};
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
/// Buffers up to this many times too long are kept for the next band: locking pages is slow.
const MAX_EXCESS: f64 = 1.25;

impl PinnedPool {
    /// Without buffers.
    pub(crate) fn new() -> Self {
        let (returns, free) = unbounded();
        Self { returns, free, len: 0, allocated: 0, max: 0 }
    }

    /// Limits the pool to `max` buffers of at least `len` values.
    pub(crate) fn resize(&mut self, max: usize, len: usize) {
        self.max = max;
        if len > self.len || MAX_EXCESS * (len as f64) < self.len as f64 {
            self.len = len;
        }
    }

    /// Frees the buffers that are not in use.
    pub(crate) fn free_unused(&mut self) {
        while self.free.try_recv().is_ok() {
            self.allocated -= 1;
        }
    }

    /// The channel by which buffers are returned.
    pub(crate) fn returns(&self) -> &Sender<Pinned> {
        &self.returns
    }

    /// A buffer; `None` if `stopped` while waiting for one. `unbounded` ignores the limit.
    pub(crate) fn take(
        &mut self,
        device: &Device,
        unbounded: bool,
        stopped: &dyn Fn() -> bool,
    ) -> Result<Option<Pinned>, CudaError> {
        loop {
            let may_allocate = self.allocated < self.max || unbounded;
            let found = match may_allocate {
                true => self.free.try_recv().map_err(|_| RecvTimeoutError::Timeout),
                false => self.free.recv_timeout(POLL_INTERVAL),
            };
            match found {
                Ok(pinned) if pinned.len() == self.len && (self.allocated <= self.max || unbounded) => {
                    return Ok(Some(pinned));
                }
                // Of another length, or beyond the limit: freed.
                Ok(_) => self.allocated -= 1,
                Err(_) if may_allocate => {
                    let pinned = Pinned::zeroed(device, self.len)?;
                    self.allocated += 1;
                    return Ok(Some(pinned));
                }
                Err(_) if stopped() => return Ok(None),
                Err(_) => (),
            }
        }
    }
}

/// A tile computed by a GPU, in a pooled buffer that is returned on drop.
#[derive(Debug)]
pub(crate) struct GpuTile {
    buffer: Option<Pinned>,
    len: usize,
    /// Values from one row to the next.
    pub(crate) stride: usize,
    returns: Sender<Pinned>,
}

impl GpuTile {
    /// `len` values in rows of `stride`, to be downloaded to `buffer`.
    pub(crate) fn new(buffer: Pinned, len: usize, stride: usize, pool: &PinnedPool) -> Self {
        Self { buffer: Some(buffer), len, stride, returns: pool.returns.clone() }
    }

    /// The values, row-major.
    pub(crate) fn data(&self) -> &[f32] {
        &self.buffer.as_deref().expect("present until drop")[..self.len]
    }

    /// The values, row-major.
    pub(crate) fn data_mut(&mut self) -> &mut [f32] {
        &mut self.buffer.as_deref_mut().expect("present until drop")[..self.len]
    }
}

impl Drop for GpuTile {
    fn drop(&mut self) {
        if let Some(buffer) = self.buffer.take() {
            // Freed if the pool no longer exists.
            let _ = self.returns.send(buffer);
        }
    }
}
