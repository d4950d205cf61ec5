//! Contexts, streams and events of the driver, released on drop. Memory is in [`super::slice`], kernels in [`super::launch`].
//!
//! Nothing here orders streams: a caller that uses memory on several streams orders them by events, and does not touch the host
//! memory of a copy until an event behind the copy has been waited for. Device memory is freed in the order of the stream that it
//! was allocated on. Errors of a release are ignored: a broken context reports its error at the next call.

use super::driver::{self, BLOCKING_CONTEXT, DriverError, Handle, NON_BLOCKING};
use std::ffi::c_int;
use std::ptr;
use std::sync::Arc;

/// `CU_EVENT_BLOCKING_SYNC`: the thread that waits for the event blocks.
pub(crate) const BLOCKING_EVENT: u32 = 1;
/// `CU_DEVICE_ATTRIBUTE_MEMORY_POOLS_SUPPORTED`.
const MEMORY_POOLS: c_int = 115;
/// `CU_MEMPOOL_ATTR_RELEASE_THRESHOLD`.
const RELEASE_THRESHOLD: c_int = 4;

/// The primary context of a device in this process.
#[derive(Debug)]
pub struct CudaContext {
    device: c_int,
    handle: Handle,
    /// The device allocates and frees memory in stream order.
    pub(super) pools: bool,
}
// SAFETY: the driver's handles may be used by all threads; each call makes the context current first.
unsafe impl Send for CudaContext {}
// SAFETY: likewise.
unsafe impl Sync for CudaContext {}

impl CudaContext {
    /// The context of device `index`; threads that wait for it sleep.
    ///
    /// # Errors
    /// An error of the driver.
    pub(super) fn new(index: usize) -> Result<Arc<Self>, DriverError> {
        let (mut device, mut handle, mut pools) = (0, ptr::null_mut(), 0);
        // SAFETY: each writes one value; `drop` releases what is retained.
        let context = unsafe {
            driver::device_get(&mut device, index as c_int)?;
            driver::device_get_attribute(&mut pools, MEMORY_POOLS, device)?;
            driver::primary_ctx_retain(&mut handle, device)?;
            Self { device, handle, pools: pools > 0 }
        };
        context.bind()?;
        // SAFETY: applies to the context just made current.
        unsafe { driver::ctx_set_flags(BLOCKING_CONTEXT)? };
        if context.pools {
            context.keep_freed_memory()?;
        }
        Ok(Arc::new(context))
    }

    /// Lets the device's pool keep what is freed for later allocations: otherwise each wait for a stream returns it to the system, and the
    /// tables of the next band are allocated anew.
    fn keep_freed_memory(&self) -> Result<(), DriverError> {
        let (mut pool, mut all) = (ptr::null_mut(), u64::MAX);
        // SAFETY: the first writes one handle; the second reads one 64-bit number.
        unsafe {
            driver::device_get_default_mem_pool(&mut pool, self.device)?;
            driver::mem_pool_set_attribute(pool, RELEASE_THRESHOLD, ptr::from_mut(&mut all).cast())
        }
    }

    /// Makes it current on this thread.
    pub(super) fn bind(&self) -> Result<(), DriverError> {
        // SAFETY: retained until `drop`.
        unsafe { driver::ctx_set_current(self.handle) }
    }

    /// Waits until all enqueued work of the context is done.
    ///
    /// # Errors
    /// An error of the driver, also of earlier work.
    pub fn synchronize(&self) -> Result<(), DriverError> {
        self.bind()?;
        // SAFETY: applies to the current context.
        unsafe { driver::ctx_synchronize() }
    }

    /// (free, total) bytes of device memory.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn mem_get_info(&self) -> Result<(usize, usize), DriverError> {
        self.bind()?;
        let (mut free, mut total) = (0, 0);
        // SAFETY: writes two numbers.
        unsafe { driver::mem_get_info(&mut free, &mut total)? };
        Ok((free, total))
    }

    /// A new stream that is independent of all others.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn new_stream(self: &Arc<Self>) -> Result<Arc<CudaStream>, DriverError> {
        self.bind()?;
        let mut handle = ptr::null_mut();
        // SAFETY: writes one handle.
        unsafe { driver::stream_create(&mut handle, NON_BLOCKING)? };
        Ok(Arc::new(CudaStream { context: Arc::clone(self), handle }))
    }

    /// The default stream of the context.
    pub fn default_stream(self: &Arc<Self>) -> Arc<CudaStream> {
        Arc::new(CudaStream { context: Arc::clone(self), handle: ptr::null_mut() })
    }
}

impl Drop for CudaContext {
    fn drop(&mut self) {
        // SAFETY: retained by `new`; every object of this context holds it.
        let _ = unsafe { driver::primary_ctx_release(self.device) };
    }
}

/// A stream: operations that run in order.
#[derive(Debug)]
pub struct CudaStream {
    pub(super) context: Arc<CudaContext>,
    /// Null: the default stream of the context.
    pub(super) handle: Handle,
}
// SAFETY: as the context.
unsafe impl Send for CudaStream {}
// SAFETY: as the context.
unsafe impl Sync for CudaStream {}

impl CudaStream {
    /// Waits until all enqueued work of the stream is done.
    ///
    /// # Errors
    /// An error of the driver, also of earlier work.
    pub fn synchronize(&self) -> Result<(), DriverError> {
        self.context.bind()?;
        // SAFETY: a stream of the current context.
        unsafe { driver::stream_synchronize(self.handle) }
    }

    /// Records an event behind all enqueued work, with these `CU_EVENT_` flags.
    ///
    /// # Errors
    /// An error of the driver.
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

    /// Makes later work of this stream wait for `event`.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn wait(&self, event: &CudaEvent) -> Result<(), DriverError> {
        self.context.bind()?;
        // SAFETY: a stream of the current context and an event.
        unsafe { driver::stream_wait_event(self.handle, event.handle, 0) }
    }

    /// Makes later work of this stream wait for all work enqueued on `other` so far.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn join(&self, other: &Self) -> Result<(), DriverError> {
        self.wait(&other.record_event(0)?)
    }
}

impl Drop for CudaStream {
    fn drop(&mut self) {
        if !self.handle.is_null() && self.context.bind().is_ok() {
            // SAFETY: created by `new_stream`; enqueued work is still completed.
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
    /// Waits until the stream has reached it.
    ///
    /// # Errors
    /// An error of the driver, also of earlier work.
    pub fn synchronize(&self) -> Result<(), DriverError> {
        self.context.bind()?;
        // SAFETY: an event of the current context.
        unsafe { driver::event_synchronize(self.handle) }
    }

    /// Milliseconds from it to `end`; waits for both.
    ///
    /// # Errors
    /// An error of the driver.
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
            // SAFETY: created by `record_event`.
            let _ = unsafe { driver::event_destroy(self.handle) };
        }
    }
}
