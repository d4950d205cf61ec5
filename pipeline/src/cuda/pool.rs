//! Page-locked host memory, which a device copies from and to by itself, and pools of it.
//!
//! Ordinary page-locked memory in both directions: write-combined memory would be a little faster to upload from, but charts
//! look at what they have read (NaN), and reading from it is slow beyond use.

use super::slice::PinnedHostSlice;
use super::{CudaError, Device};
use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, unbounded};
use std::ops::{Deref, DerefMut};
use std::time::Duration;

/// A page-locked buffer. Whoever gives it to a copy keeps it, and does not look at it, until an event behind the copy has been
/// waited for.
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
    made: usize,
    most: usize,
}

/// How often one who waits for a buffer sees whether the run still goes on.
const LOOK: Duration = Duration::from_millis(50);
/// Buffers that are at most so much too long are kept for the next band: to lock pages takes its time.
const KEPT: f64 = 1.25;

impl PinnedPool {
    /// Without buffers.
    pub(crate) fn new() -> Self {
        let (returns, free) = unbounded();
        Self { returns, free, len: 0, made: 0, most: 0 }
    }

    /// From now on at most `most` buffers of at least `len` values.
    pub(crate) fn allow(&mut self, most: usize, len: usize) {
        self.most = most;
        if len > self.len || KEPT * (len as f64) < self.len as f64 {
            self.len = len;
        }
    }

    /// Where buffers are returned to.
    pub(crate) fn returns(&self) -> &Sender<Pinned> {
        &self.returns
    }

    /// A buffer; `None` when `stopped` while waiting for one. `beyond`: the bound does not hold.
    pub(crate) fn take(
        &mut self,
        device: &Device,
        beyond: bool,
        stopped: &dyn Fn() -> bool,
    ) -> Result<Option<Pinned>, CudaError> {
        loop {
            let room = self.made < self.most || beyond;
            let found = match room {
                true => self.free.try_recv().map_err(|_| RecvTimeoutError::Timeout),
                false => self.free.recv_timeout(LOOK),
            };
            match found {
                Ok(pinned) if pinned.len() == self.len && (self.made <= self.most || beyond) => {
                    return Ok(Some(pinned));
                }
                // Of another band, or more than there may be.
                Ok(_) => self.made -= 1,
                Err(_) if room => {
                    let pinned = Pinned::zeroed(device, self.len)?;
                    self.made += 1;
                    return Ok(Some(pinned));
                }
                Err(_) if stopped() => return Ok(None),
                Err(_) => (),
            }
        }
    }
}

/// A tile that a GPU computed, in a pooled buffer that is returned when this is dropped.
#[derive(Debug)]
pub(crate) struct GpuTile {
    buffer: Option<Pinned>,
    len: usize,
    /// Values from one row to the next.
    pub(crate) stride: usize,
    returns: Sender<Pinned>,
}

impl GpuTile {
    /// `len` values in rows `stride` apart, to come into `buffer`.
    pub(crate) fn new(buffer: Pinned, len: usize, stride: usize, pool: &PinnedPool) -> Self {
        Self { buffer: Some(buffer), len, stride, returns: pool.returns.clone() }
    }

    /// Row-major.
    pub(crate) fn data(&self) -> &[f32] {
        &self.buffer.as_deref().expect("there until dropped")[..self.len]
    }

    /// The same, for a copy.
    pub(crate) fn data_mut(&mut self) -> &mut [f32] {
        &mut self.buffer.as_deref_mut().expect("there until dropped")[..self.len]
    }
}

impl Drop for GpuTile {
    fn drop(&mut self) {
        if let Some(buffer) = self.buffer.take() {
            // Without a pool it is freed.
            let _ = self.returns.send(buffer);
        }
    }
}
