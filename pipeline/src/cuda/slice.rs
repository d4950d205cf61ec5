//! Device memory, page-locked host memory and copies between them. The rules of [`super::handle`] apply.

use super::driver::{self, Address, DriverError};
use super::handle::{CudaContext, CudaStream};
use std::marker::PhantomData;
use std::ops::{Bound, Range, RangeBounds};
use std::ptr;
use std::sync::Arc;

/// Plain numbers that a kernel takes as an argument or that are stored in device memory.
///
/// # Safety
/// Every bit pattern is a value, and the layout is C's.
pub unsafe trait DeviceRepr: Copy {}
// SAFETY: a number.
unsafe impl DeviceRepr for f32 {}
// SAFETY: a number.
unsafe impl DeviceRepr for i32 {}
// SAFETY: a number.
unsafe impl DeviceRepr for u32 {}
// SAFETY: as its elements.
unsafe impl<T: DeviceRepr, const N: usize> DeviceRepr for [T; N] {}

/// Values in device memory.
#[derive(Debug)]
pub struct CudaSlice<T> {
    /// Freed in the order of this stream.
    stream: Arc<CudaStream>,
    address: Address,
    len: usize,
    values: PhantomData<T>,
}
// SAFETY: an address for the driver, and the stream, which is Send and Sync.
unsafe impl<T: DeviceRepr + Send> Send for CudaSlice<T> {}
// SAFETY: likewise.
unsafe impl<T: DeviceRepr + Sync> Sync for CudaSlice<T> {}

impl<T> Drop for CudaSlice<T> {
    fn drop(&mut self) {
        let context = &self.stream.context;
        if context.bind().is_err() {
            return;
        }
        // SAFETY: allocated by `alloc` in the same way. Work of other streams on it has been waited for (head of `handle`).
        let _ = unsafe {
            match context.pools {
                true => driver::mem_free_async(self.address, self.stream.handle),
                false => self.stream.synchronize().and(driver::mem_free(self.address)),
            }
        };
    }
}

/// View of a part of device memory.
#[derive(Debug)]
pub struct CudaView<'a, T> {
    address: Address,
    len: usize,
    borrowed: PhantomData<&'a T>,
}

/// Exclusive view of a part of device memory.
#[derive(Debug)]
pub struct CudaViewMut<'a, T> {
    address: Address,
    len: usize,
    borrowed: PhantomData<&'a mut T>,
}

/// Device memory, or a view of it.
pub trait DeviceMemory<T> {
    /// Address of the first value; a kernel's argument is read from this reference.
    fn address(&self) -> &Address;

    /// Number of values.
    fn len(&self) -> usize;

    /// Whether there are no values.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// View of a range of values.
    fn slice(&self, range: impl RangeBounds<usize>) -> CudaView<'_, T> {
        let (address, len) = subrange::<T>(*self.address(), self.len(), range);
        CudaView { address, len, borrowed: PhantomData }
    }
}

/// Device memory that may be written.
pub trait DeviceMemoryMut<T>: DeviceMemory<T> {
    /// Exclusive view of a range of values.
    fn slice_mut(&mut self, range: impl RangeBounds<usize>) -> CudaViewMut<'_, T> {
        let (address, len) = subrange::<T>(*self.address(), self.len(), range);
        CudaViewMut { address, len, borrowed: PhantomData }
    }

    /// The first `n` values and the others.
    fn split_at_mut(&mut self, n: usize) -> (CudaViewMut<'_, T>, CudaViewMut<'_, T>) {
        let part = |(address, len)| CudaViewMut { address, len, borrowed: PhantomData };
        let (address, len) = (*self.address(), self.len());
        (part(subrange::<T>(address, len, ..n)), part(subrange::<T>(address, len, n..)))
    }
}

macro_rules! device_memory {
    ($($memory:ty),*) => {
        $(impl<T> DeviceMemory<T> for $memory {
            fn address(&self) -> &Address {
                &self.address
            }
            fn len(&self) -> usize {
                self.len
            }
        })*
    };
}
device_memory!(CudaSlice<T>, CudaView<'_, T>, CudaViewMut<'_, T>);
impl<T> DeviceMemoryMut<T> for CudaSlice<T> {}
impl<T> DeviceMemoryMut<T> for CudaViewMut<'_, T> {}

/// Address and length of `range` of the `len` values at `address`.
fn subrange<T>(address: Address, len: usize, range: impl RangeBounds<usize>) -> (Address, usize) {
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
    (address + (first * size_of::<T>()) as Address, end - first)
}

/// Allocation and copies.
impl CudaStream {
    /// `len` uninitialised values of device memory, in the order of this stream.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn alloc<T: DeviceRepr>(self: &Arc<Self>, len: usize) -> Result<CudaSlice<T>, DriverError> {
        self.context.bind()?;
        let (mut address, bytes) = (0, len * size_of::<T>());
        // SAFETY: writes one address.
        unsafe {
            match self.context.pools {
                true => driver::mem_alloc_async(&mut address, bytes, self.handle)?,
                false => driver::mem_alloc(&mut address, bytes)?,
            }
        }
        Ok(CudaSlice { stream: Arc::clone(self), address, len, values: PhantomData })
    }

    /// `len` zeros in device memory.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn alloc_zeros<T: DeviceRepr>(self: &Arc<Self>, len: usize) -> Result<CudaSlice<T>, DriverError> {
        let slice = self.alloc(len)?;
        // SAFETY: the slice has that many bytes.
        unsafe { driver::memset(slice.address, 0, len * size_of::<T>(), self.handle)? };
        Ok(slice)
    }

    /// Sets `to` to zeros.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn fill_zeros<T: DeviceRepr>(&self, to: &mut impl DeviceMemoryMut<T>) -> Result<(), DriverError> {
        self.context.bind()?;
        // SAFETY: it has that many bytes; zeros are a value of T.
        unsafe { driver::memset(*to.address(), 0, to.len() * size_of::<T>(), self.handle) }
    }

    /// Copies `from` to the first values of `to`.
    ///
    /// # Errors
    /// An error of the driver.
    ///
    /// # Panics
    /// If `to` is shorter.
    pub fn memcpy_htod<T: DeviceRepr>(
        &self,
        from: &[T],
        to: &mut impl DeviceMemoryMut<T>,
    ) -> Result<(), DriverError> {
        assert!(from.len() <= to.len(), "upload of {} values to {}", from.len(), to.len());
        self.context.bind()?;
        // SAFETY: both have that many bytes. Page-locked host memory is not touched until an event (head of `handle`); other
        // memory has been copied by the driver when this returns.
        unsafe { driver::memcpy_htod(*to.address(), from.as_ptr().cast(), size_of_val(from), self.handle) }
    }

    /// Copies the first values of `from` to `to`.
    ///
    /// # Errors
    /// An error of the driver.
    ///
    /// # Panics
    /// If `from` is shorter.
    pub fn memcpy_dtoh<T: DeviceRepr>(
        &self,
        from: &impl DeviceMemory<T>,
        to: &mut [T],
    ) -> Result<(), DriverError> {
        assert!(to.len() <= from.len(), "download of {} values from {}", to.len(), from.len());
        self.context.bind()?;
        // SAFETY: as in `memcpy_htod`.
        unsafe { driver::memcpy_dtoh(to.as_mut_ptr().cast(), *from.address(), size_of_val(to), self.handle) }
    }

    /// Device memory with the values of `from`, in the order of this stream.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn clone_htod<T: DeviceRepr>(self: &Arc<Self>, from: &[T]) -> Result<CudaSlice<T>, DriverError> {
        let mut to = self.alloc(from.len())?;
        self.memcpy_htod(from, &mut to)?;
        Ok(to)
    }

    /// The values of `from`; waits for the stream.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn clone_dtoh<T: DeviceRepr + Default>(
        &self,
        from: &impl DeviceMemory<T>,
    ) -> Result<Vec<T>, DriverError> {
        let mut to = vec![T::default(); from.len()];
        self.memcpy_dtoh(from, &mut to)?;
        self.synchronize()?;
        Ok(to)
    }
}

/// Page-locked host memory: copies from and to it run asynchronously.
#[derive(Debug)]
pub struct PinnedHostSlice<T> {
    context: Arc<CudaContext>,
    start: *mut T,
    len: usize,
}
// SAFETY: the memory belongs to this value alone and has the same address on all threads.
unsafe impl<T: Send> Send for PinnedHostSlice<T> {}
// SAFETY: shared, it is only read.
unsafe impl<T: Sync> Sync for PinnedHostSlice<T> {}

impl CudaContext {
    /// `len` zeros in page-locked host memory.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn alloc_pinned<T: DeviceRepr>(
        self: &Arc<Self>,
        len: usize,
    ) -> Result<PinnedHostSlice<T>, DriverError> {
        self.bind()?;
        let mut start = ptr::null_mut();
        // SAFETY: writes one address.
        unsafe { driver::mem_host_alloc(&mut start, len * size_of::<T>(), 0)? };
        let start: *mut T = start.cast();
        // SAFETY: `len` values were allocated there; zeros are a value of T.
        unsafe { start.write_bytes(0, len) };
        Ok(PinnedHostSlice { context: Arc::clone(self), start, len })
    }
}

impl<T> PinnedHostSlice<T> {
    /// Pointer to the first value.
    pub fn as_mut_ptr(&mut self) -> *mut T {
        self.start
    }

    /// The values.
    pub fn as_slice(&self) -> &[T] {
        // SAFETY: initialised values that live as long as `self`; the owner waits for copies in flight (head of `handle`).
        unsafe { std::slice::from_raw_parts(self.start, self.len) }
    }

    /// The values.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        // SAFETY: as above, and borrowed exclusively.
        unsafe { std::slice::from_raw_parts_mut(self.start, self.len) }
    }
}

/// A part of page-locked host memory that was divided.
#[derive(Debug)]
pub struct PinnedPart<T> {
    memory: Arc<PinnedHostSlice<T>>,
    range: Range<usize>,
}

impl<T> PinnedHostSlice<T> {
    /// Consecutive parts of these lengths, from the first value on.
    ///
    /// # Panics
    /// If they are longer than the memory.
    pub fn divide(self, lengths: impl Iterator<Item = usize>) -> Vec<PinnedPart<T>> {
        let (memory, mut end) = (Arc::new(self), 0);
        let part = |length| {
            let range = end..end + length;
            end = range.end;
            assert!(end <= memory.len, "parts of {end} of {} values", memory.len);
            PinnedPart { memory: Arc::clone(&memory), range }
        };
        lengths.map(part).collect()
    }

    /// The memory of these parts; `None` if a part of it is elsewhere.
    pub fn join(parts: Vec<PinnedPart<T>>) -> Option<Self> {
        let memory = parts.first().map(|part| Arc::clone(&part.memory));
        drop(parts);
        memory.and_then(Arc::into_inner)
    }
}

impl<T> PinnedPart<T> {
    /// The values.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        // SAFETY: initialised values; `divide` made disjoint parts, and the whole is not accessible before `join`, which takes all of them.
        unsafe { std::slice::from_raw_parts_mut(self.memory.start.add(self.range.start), self.range.len()) }
    }
}

impl<T> Drop for PinnedHostSlice<T> {
    fn drop(&mut self) {
        let _ = self.context.bind();
        // SAFETY: allocated by `alloc_pinned`; copies from and to it have been waited for (head of `handle`).
        let _ = unsafe { driver::mem_free_host(self.start.cast()) };
    }
}
