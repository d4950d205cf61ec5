//! Memory: of a device, and of the host where it is page-locked. The rules of [`super::handle`] hold.

use super::driver::{self, Address};
use super::handle::{CudaContext, CudaStream};
use super::launch::DeviceRepr;
use std::marker::PhantomData;
use std::ops::{Bound, RangeBounds};
use std::sync::Arc;

/// Values in device memory.
#[derive(Debug)]
pub struct CudaSlice<T> {
    /// In whose order it is freed.
    stream: Arc<CudaStream>,
    at: Address,
    len: usize,
    kind: PhantomData<T>,
}
// SAFETY: an address for the driver, with all that it needs.
unsafe impl<T: DeviceRepr + Send> Send for CudaSlice<T> {}
// SAFETY: likewise.
unsafe impl<T: DeviceRepr + Sync> Sync for CudaSlice<T> {}

impl<T> CudaSlice<T> {
    /// `len` values from `at` on, allocated in the order of `stream`.
    pub(super) fn new(stream: Arc<CudaStream>, at: Address, len: usize) -> Self {
        Self { stream, at, len, kind: PhantomData }
    }
}

impl<T> Drop for CudaSlice<T> {
    fn drop(&mut self) {
        let context = &self.stream.context;
        if context.bind().is_err() {
            return;
        }
        // SAFETY: allocated by `alloc` in the same way. What other streams do with it has been waited for (head of this file).
        let _ = unsafe {
            match context.pools {
                true => driver::mem_free_async(self.at, self.stream.handle),
                false => self.stream.synchronize().and(driver::mem_free(self.at)),
            }
        };
    }
}

/// Part of some device memory.
#[derive(Debug)]
pub struct CudaView<'a, T> {
    at: Address,
    len: usize,
    of: PhantomData<&'a T>,
}

/// Exclusive view of a part of device memory.
#[derive(Debug)]
pub struct CudaViewMut<'a, T> {
    at: Address,
    len: usize,
    of: PhantomData<&'a mut T>,
}

/// Device memory, or part of it: where it lies, and how many values.
pub trait DeviceMemory<T> {
    /// Address and values.
    fn place(&self) -> (Address, usize);
}

impl<T> DeviceMemory<T> for CudaSlice<T> {
    fn place(&self) -> (Address, usize) {
        (self.at, self.len)
    }
}

impl<T> DeviceMemory<T> for CudaView<'_, T> {
    fn place(&self) -> (Address, usize) {
        (self.at, self.len)
    }
}

impl<T> DeviceMemory<T> for CudaViewMut<'_, T> {
    fn place(&self) -> (Address, usize) {
        (self.at, self.len)
    }
}

/// Address and values of `range` of `(at, len)`.
fn part<T>((at, len): (Address, usize), range: impl RangeBounds<usize>) -> (Address, usize) {
    let first = match range.start_bound() {
        Bound::Included(&n) => n,
        Bound::Excluded(&n) => n + 1,
        Bound::Unbounded => 0,
    };
    let end = match range.end_bound() {
        Bound::Included(&n) => n + 1,
        Bound::Excluded(&n) => n,
        Bound::Unbounded => len,
    };
    assert!(first <= end && end <= len, "{first}..{end} of {len} values");
    (at + (first * size_of::<T>()) as Address, end - first)
}

impl<T> CudaSlice<T> {
    /// Values.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Some of it.
    pub fn slice(&self, range: impl RangeBounds<usize>) -> CudaView<'_, T> {
        let (at, len) = part::<T>(self.place(), range);
        CudaView { at, len, of: PhantomData }
    }

    /// Some of it, to write.
    pub fn slice_mut(&mut self, range: impl RangeBounds<usize>) -> CudaViewMut<'_, T> {
        let (at, len) = part::<T>(self.place(), range);
        CudaViewMut { at, len, of: PhantomData }
    }

    /// The first `n` values and the others.
    pub fn split_at_mut(&mut self, n: usize) -> (CudaViewMut<'_, T>, CudaViewMut<'_, T>) {
        let ((a, first), (b, rest)) = (part::<T>(self.place(), ..n), part::<T>(self.place(), n..));
        (
            CudaViewMut { at: a, len: first, of: PhantomData },
            CudaViewMut { at: b, len: rest, of: PhantomData },
        )
    }
}

impl<T> CudaViewMut<'_, T> {
    /// Some of it.
    pub fn slice(&self, range: impl RangeBounds<usize>) -> CudaView<'_, T> {
        let (at, len) = part::<T>(self.place(), range);
        CudaView { at, len, of: PhantomData }
    }

    /// Some of it, to write.
    pub fn slice_mut(&mut self, range: impl RangeBounds<usize>) -> CudaViewMut<'_, T> {
        let (at, len) = part::<T>(self.place(), range);
        CudaViewMut { at, len, of: PhantomData }
    }

    /// The first `n` values and the others.
    pub fn split_at_mut(&mut self, n: usize) -> (CudaViewMut<'_, T>, CudaViewMut<'_, T>) {
        let ((a, first), (b, rest)) = (part::<T>(self.place(), ..n), part::<T>(self.place(), n..));
        (
            CudaViewMut { at: a, len: first, of: PhantomData },
            CudaViewMut { at: b, len: rest, of: PhantomData },
        )
    }

    /// All of it, to read.
    pub fn as_view(&self) -> CudaView<'_, T> {
        self.slice(..)
    }
}

/// Page-locked host memory, which a device copies from and to by itself.
#[derive(Debug)]
pub struct PinnedHostSlice<T> {
    context: Arc<CudaContext>,
    start: *mut T,
    len: usize,
}
// SAFETY: the memory belongs to this value alone and lies at one place for all threads.
unsafe impl<T: Send> Send for PinnedHostSlice<T> {}
// SAFETY: shared, it is only read.
unsafe impl<T: Sync> Sync for PinnedHostSlice<T> {}

impl<T> PinnedHostSlice<T> {
    /// `len` set values from `start` on, allocated by the driver.
    pub(super) fn new(context: Arc<CudaContext>, start: *mut T, len: usize) -> Self {
        Self { context, start, len }
    }

    /// Where it starts.
    pub fn as_mut_ptr(&mut self) -> *mut T {
        self.start
    }

    /// Its values.
    pub fn as_slice(&self) -> &[T] {
        // SAFETY: set values of this buffer, which lives as long as `self`; copies in flight are the owner's concern.
        unsafe { std::slice::from_raw_parts(self.start, self.len) }
    }

    /// Its values, to write.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        // SAFETY: as above, and borrowed exclusively.
        unsafe { std::slice::from_raw_parts_mut(self.start, self.len) }
    }
}

impl<T> Drop for PinnedHostSlice<T> {
    fn drop(&mut self) {
        let _ = self.context.bind();
        // SAFETY: allocated by `alloc_pinned`; copies from and to it have been waited for (head of this file).
        let _ = unsafe { driver::mem_free_host(self.start.cast()) };
    }
}

/// Where the driver reads an address that is an argument of a launch.
macro_rules! addresses {
    ($($memory:ty),*) => {
        $(impl<T> $memory {
            pub(super) fn at(&self) -> &Address {
                &self.at
            }
        })*
    };
}
addresses!(CudaSlice<T>, CudaView<'_, T>, CudaViewMut<'_, T>);
