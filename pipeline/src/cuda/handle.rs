//! What the driver hands out, each released when dropped: context, streams, events; memory is in [`super::slice`], kernels in
//! [`super::launch`].
//!
//! Nothing here orders streams: whoever uses memory on several says so by events, and keeps host memory of a copy untouched
//! until an event behind the copy has been waited for. Device memory is freed in the order of the stream that it was allocated
//! on. Errors of a release are dropped: a context that is broken reports it at its next call.

use super::driver::{self, BLOCKING_CONTEXT, DriverError, Handle, NON_BLOCKING};
use super::launch::{CudaFunction, CudaModule, DeviceRepr, Launch};
use super::slice::{CudaSlice, DeviceMemory, PinnedHostSlice};
use std::ffi::{CString, c_int};
use std::ptr;
use std::sync::Arc;

/// `CU_DEVICE_ATTRIBUTE_MEMORY_POOLS_SUPPORTED`.
const MEMORY_POOLS: c_int = 115;

/// The context of a device: the driver's own one of this process.
#[derive(Debug)]
pub struct CudaContext {
    device: c_int,
    handle: Handle,
    /// Memory is allocated and freed in the order of streams.
    pub(super) pools: bool,
}
// SAFETY: the driver's handles are for all threads; each call makes the context current first.
unsafe impl Send for CudaContext {}
// SAFETY: likewise.
unsafe impl Sync for CudaContext {}

impl CudaContext {
    /// The context of device `index`; threads that wait for it sleep.
    ///
    /// # Errors
    /// What the driver reports.
    pub(super) fn new(index: usize) -> Result<Arc<Self>, DriverError> {
        let (mut device, mut handle, mut pools) = (0, ptr::null_mut(), 0);
        // SAFETY: each writes one value; what was retained is released by `drop`.
        let context = unsafe {
            driver::device_get(&mut device, index as c_int)?;
            driver::device_get_attribute(&mut pools, MEMORY_POOLS, device)?;
            driver::primary_ctx_retain(&mut handle, device)?;
            Self { device, handle, pools: pools > 0 }
        };
        context.bind()?;
        // SAFETY: of the context just made current.
        unsafe { driver::ctx_set_flags(BLOCKING_CONTEXT)? };
        Ok(Arc::new(context))
    }

    /// Makes it current on this thread.
    pub(super) fn bind(&self) -> Result<(), DriverError> {
        // SAFETY: retained until `drop`.
        unsafe { driver::ctx_set_current(self.handle) }
    }

    /// Waits for all that was asked of the device.
    ///
    /// # Errors
    /// What the driver reports, of any of it.
    pub fn synchronize(&self) -> Result<(), DriverError> {
        self.bind()?;
        // SAFETY: of the current context.
        unsafe { driver::ctx_synchronize() }
    }

    /// (free, all) bytes of its memory.
    ///
    /// # Errors
    /// What the driver reports.
    pub fn mem_get_info(&self) -> Result<(usize, usize), DriverError> {
        self.bind()?;
        let (mut free, mut total) = (0, 0);
        // SAFETY: writes two numbers.
        unsafe { driver::mem_get_info(&mut free, &mut total)? };
        Ok((free, total))
    }

    /// A stream of its own: no other stream waits for it.
    ///
    /// # Errors
    /// What the driver reports.
    pub fn new_stream(self: &Arc<Self>) -> Result<Arc<CudaStream>, DriverError> {
        self.bind()?;
        let mut handle = ptr::null_mut();
        // SAFETY: writes one handle.
        unsafe { driver::stream_create(&mut handle, NON_BLOCKING)? };
        Ok(Arc::new(CudaStream { context: Arc::clone(self), handle }))
    }

    /// The context's own stream.
    pub fn default_stream(self: &Arc<Self>) -> Arc<CudaStream> {
        Arc::new(CudaStream { context: Arc::clone(self), handle: ptr::null_mut() })
    }

    /// `len` values of page-locked host memory, zeros.
    ///
    /// # Errors
    /// What the driver reports.
    pub fn alloc_pinned<T: DeviceRepr>(
        self: &Arc<Self>,
        len: usize,
    ) -> Result<PinnedHostSlice<T>, DriverError> {
        self.bind()?;
        let mut at = ptr::null_mut();
        // SAFETY: writes one address.
        unsafe { driver::mem_host_alloc(&mut at, len * size_of::<T>(), 0)? };
        let start: *mut T = at.cast();
        // SAFETY: `len` values from there on are ours; zeros are a value of T.
        unsafe { start.write_bytes(0, len) };
        Ok(PinnedHostSlice::new(Arc::clone(self), start, len))
    }

    /// The kernels of `ptx`, assembled.
    ///
    /// # Errors
    /// What the driver reports.
    pub(super) fn load_module(self: &Arc<Self>, ptx: &str) -> Result<Arc<CudaModule>, DriverError> {
        self.bind()?;
        let text = CString::new(ptx).expect("PTX is text");
        let mut handle = ptr::null_mut();
        // SAFETY: text that ends in 0; writes one handle.
        unsafe { driver::module_load_data(&mut handle, text.as_ptr().cast())? };
        Ok(Arc::new(CudaModule::new(Arc::clone(self), handle)))
    }
}

impl Drop for CudaContext {
    fn drop(&mut self) {
        // SAFETY: retained by `new`; all that is of this context holds it.
        let _ = unsafe { driver::primary_ctx_release(self.device) };
    }
}

/// Operations in order.
#[derive(Debug)]
pub struct CudaStream {
    pub(super) context: Arc<CudaContext>,
    /// Null: the context's own.
    pub(super) handle: Handle,
}
// SAFETY: as the context.
unsafe impl Send for CudaStream {}
// SAFETY: as the context.
unsafe impl Sync for CudaStream {}

impl CudaStream {
    /// Waits for all that was asked of it.
    ///
    /// # Errors
    /// What the driver reports, of any of it.
    pub fn synchronize(&self) -> Result<(), DriverError> {
        self.context.bind()?;
        // SAFETY: a stream of the current context.
        unsafe { driver::stream_synchronize(self.handle) }
    }

    /// An event behind all that was asked of it so far, with these `CU_EVENT_` flags.
    ///
    /// # Errors
    /// What the driver reports.
    pub fn record_event(&self, flags: u32) -> Result<CudaEvent, DriverError> {
        self.context.bind()?;
        let mut handle = ptr::null_mut();
        // SAFETY: writes one handle, of the current context as the stream is.
        unsafe { driver::event_create(&mut handle, flags)? };
        let event = CudaEvent { context: Arc::clone(&self.context), handle };
        // SAFETY: both of the current context.
        unsafe { driver::event_record(event.handle, self.handle)? };
        Ok(event)
    }

    /// What is asked of it from now on waits for `event`.
    ///
    /// # Errors
    /// What the driver reports.
    pub fn wait(&self, event: &CudaEvent) -> Result<(), DriverError> {
        self.context.bind()?;
        // SAFETY: a stream of the current context and an event.
        unsafe { driver::stream_wait_event(self.handle, event.handle, 0) }
    }

    /// What is asked of it from now on waits for what was asked of `other` so far.
    ///
    /// # Errors
    /// What the driver reports.
    pub fn join(&self, other: &Self) -> Result<(), DriverError> {
        self.wait(&other.record_event(0)?)
    }

    /// `len` values of device memory, unset, in the order of this stream.
    ///
    /// # Errors
    /// What the driver reports.
    pub fn alloc<T: DeviceRepr>(self: &Arc<Self>, len: usize) -> Result<CudaSlice<T>, DriverError> {
        self.context.bind()?;
        let (mut at, bytes) = (0, len * size_of::<T>());
        // SAFETY: writes one address.
        unsafe {
            match self.context.pools {
                true => driver::mem_alloc_async(&mut at, bytes, self.handle)?,
                false => driver::mem_alloc(&mut at, bytes)?,
            }
        }
        Ok(CudaSlice::new(Arc::clone(self), at, len))
    }

    /// `len` zeros in device memory.
    ///
    /// # Errors
    /// What the driver reports.
    pub fn alloc_zeros<T: DeviceRepr>(self: &Arc<Self>, len: usize) -> Result<CudaSlice<T>, DriverError> {
        let slice = self.alloc(len)?;
        // SAFETY: that many bytes from there on are the slice's.
        unsafe { driver::memset(slice.place().0, 0, len * size_of::<T>(), self.handle)? };
        Ok(slice)
    }

    /// Copies `from` to the first values of `to`.
    ///
    /// # Errors
    /// What the driver reports.
    ///
    /// # Panics
    /// If `to` is shorter: a fault of the caller's.
    pub fn memcpy_htod<T: DeviceRepr>(
        &self,
        from: &[T],
        to: &mut impl DeviceMemory<T>,
    ) -> Result<(), DriverError> {
        let (at, len) = to.place();
        assert!(from.len() <= len, "{} values go up to {len}", from.len());
        self.context.bind()?;
        // SAFETY: both hold that many bytes; page-locked host memory is left alone until an event (head of this file), other
        // memory the driver has taken when this returns.
        unsafe { driver::memcpy_htod(at, from.as_ptr().cast(), size_of_val(from), self.handle) }
    }

    /// Copies the first values of `from` to `to`.
    ///
    /// # Errors
    /// What the driver reports.
    ///
    /// # Panics
    /// If `from` is shorter: a fault of the caller's.
    pub fn memcpy_dtoh<T: DeviceRepr>(
        &self,
        from: &impl DeviceMemory<T>,
        to: &mut [T],
    ) -> Result<(), DriverError> {
        let (at, len) = from.place();
        assert!(to.len() <= len, "{} values come down of {len}", to.len());
        self.context.bind()?;
        // SAFETY: as above.
        unsafe { driver::memcpy_dtoh(to.as_mut_ptr().cast(), at, size_of_val(to), self.handle) }
    }

    /// Device memory with the values of `from`, which are there when this returns.
    ///
    /// # Errors
    /// What the driver reports.
    pub fn clone_htod<T: DeviceRepr>(self: &Arc<Self>, from: &[T]) -> Result<CudaSlice<T>, DriverError> {
        let mut to = self.alloc(from.len())?;
        self.memcpy_htod(from, &mut to)?;
        Ok(to)
    }

    /// The values of `from`, once this stream has come there.
    ///
    /// # Errors
    /// What the driver reports.
    pub fn clone_dtoh<T: DeviceRepr + Default>(
        &self,
        from: &impl DeviceMemory<T>,
    ) -> Result<Vec<T>, DriverError> {
        let mut to = vec![T::default(); from.place().1];
        self.memcpy_dtoh(from, &mut to)?;
        self.synchronize()?;
        Ok(to)
    }

    /// A launch of `function`, its arguments still to be given.
    pub fn launch_builder<'a>(&'a self, function: &'a CudaFunction) -> Launch<'a> {
        Launch::new(self, function)
    }
}

impl Drop for CudaStream {
    fn drop(&mut self) {
        if !self.handle.is_null() && self.context.bind().is_ok() {
            // SAFETY: made by `new_stream`; what was asked of it is done all the same.
            let _ = unsafe { driver::stream_destroy(self.handle) };
        }
    }
}

/// A point in a stream.
#[derive(Debug)]
pub struct CudaEvent {
    context: Arc<CudaContext>,
    handle: Handle,
}
// SAFETY: as the context.
unsafe impl Send for CudaEvent {}
// SAFETY: as the context.
unsafe impl Sync for CudaEvent {}

impl CudaEvent {
    /// Waits until the stream has come there.
    ///
    /// # Errors
    /// What the driver reports, of all before it as well.
    pub fn synchronize(&self) -> Result<(), DriverError> {
        self.context.bind()?;
        // SAFETY: an event of the current context.
        unsafe { driver::event_synchronize(self.handle) }
    }

    /// Milliseconds from it to `end`, which is waited for.
    ///
    /// # Errors
    /// What the driver reports.
    pub fn elapsed_ms(&self, end: &Self) -> Result<f32, DriverError> {
        self.synchronize()?;
        end.synchronize()?;
        let mut ms = 0.0;
        // SAFETY: two events of the current context; writes one number.
        unsafe { driver::event_elapsed_time(&mut ms, self.handle, end.handle)? };
        Ok(ms)
    }
}

impl Drop for CudaEvent {
    fn drop(&mut self) {
        if self.context.bind().is_ok() {
            // SAFETY: made by `record_event`.
            let _ = unsafe { driver::event_destroy(self.handle) };
        }
    }
}
