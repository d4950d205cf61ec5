//! Page-locked ring through which lists and kernels are uploaded.
//!
//! A copy from ordinary memory may block the calling thread until its stream reaches it. Here the values are copied to the ring, and from
//! there without blocking; the calling thread waits only where the ring is full, for the oldest copy.

use super::handle::{BLOCKING_EVENT, CudaEvent, CudaStream};
use super::pool::Pinned;
use super::slice::{DeviceMemoryMut, DeviceRepr};
use super::{CudaError, Device};
use bytemuck::Pod;
use std::collections::VecDeque;
use std::ops::Range;

/// 32-bit values of the ring: the lists of a batch take up to 4 MB, its base kernels of 51 px as many; larger uploads are copied in parts.
const LEN: usize = 1 << 21;

/// Page-locked host memory of a ring, bytes.
pub const UPLOAD_RING_BYTES: usize = 4 * LEN;

/// The ring of one stream.
#[derive(Debug)]
pub(crate) struct UploadRing {
    pinned: Pinned,
    /// Where the next values begin.
    next: usize,
    /// Parts being copied, oldest first, each with the event behind its copy.
    in_flight: VecDeque<(Range<usize>, CudaEvent)>,
}

impl UploadRing {
    /// A ring for uploads to `device`.
    pub(crate) fn new(device: &Device) -> Result<Self, CudaError> {
        Ok(Self { pinned: Pinned::zeroed(device, LEN)?, next: 0, in_flight: VecDeque::new() })
    }

    /// Copies `from` to the first values of `to`, in the order of `stream`; `doing` is for the error.
    pub(crate) fn upload<T: DeviceRepr + Pod>(
        &mut self,
        device: &Device,
        stream: &CudaStream,
        from: &[T],
        to: &mut impl DeviceMemoryMut<T>,
        doing: &str,
    ) -> Result<(), CudaError> {
        assert_eq!(size_of::<T>(), 4);
        let mut done = 0;
        for part in from.chunks(LEN / 2) {
            let place = self.reserve(part.len()).map_err(device.failed(doing))?;
            let pinned = &mut self.pinned[place.clone()];
            pinned.copy_from_slice(bytemuck::cast_slice(part));
            let to = &mut to.slice_mut(done..done + part.len());
            stream.memcpy_htod(bytemuck::cast_slice(pinned), to).map_err(device.failed(doing))?;
            let copied = stream.record_event(BLOCKING_EVENT).map_err(device.failed(doing))?;
            self.in_flight.push_back((place, copied));
            done += part.len();
        }
        Ok(())
    }

    /// A free part of `len` values; waits for copies from it.
    fn reserve(&mut self, len: usize) -> Result<Range<usize>, super::driver::DriverError> {
        let start = if self.next + len > LEN { 0 } else { self.next };
        let part = start..start + len;
        let overlaps = |other: &Range<usize>| other.start < part.end && part.start < other.end;
        while self.in_flight.iter().any(|(other, _)| overlaps(other)) {
            let (_, copied) = self.in_flight.pop_front().expect("one overlaps");
            copied.synchronize()?;
        }
        self.next = part.end;
        Ok(part)
    }
}

impl Drop for UploadRing {
    fn drop(&mut self) {
        for (_, copied) in self.in_flight.drain(..) {
            // A device that failed copies no longer.
            let _ = copied.synchronize();
        }
    }
}
