//! Kernels and their launches.

use super::driver::{self, DriverError, Handle};
use super::handle::{CudaContext, CudaStream};
use super::slice::{CudaSlice, CudaView, CudaViewMut};
use std::ffi::{CString, c_void};
use std::marker::PhantomData;
use std::ptr;
use std::sync::Arc;

/// Plain numbers that a kernel takes or that lie in device memory.
///
/// # Safety
/// Any bits are a value, and the layout is C's.
pub unsafe trait DeviceRepr: Copy {}
// SAFETY: numbers.
unsafe impl DeviceRepr for f32 {}
// SAFETY: numbers.
unsafe impl DeviceRepr for i32 {}
// SAFETY: numbers.
unsafe impl DeviceRepr for u32 {}
// SAFETY: as its elements.
unsafe impl<T: DeviceRepr, const N: usize> DeviceRepr for [T; N] {}

/// Kernels on a device.
#[derive(Debug)]
pub(super) struct CudaModule {
    context: Arc<CudaContext>,
    handle: Handle,
}
// SAFETY: as the context.
unsafe impl Send for CudaModule {}
// SAFETY: as the context.
unsafe impl Sync for CudaModule {}

impl CudaModule {
    /// What the driver loaded.
    pub(super) fn new(context: Arc<CudaContext>, handle: Handle) -> Self {
        Self { context, handle }
    }

    /// The kernel `name`.
    pub(super) fn function(self: &Arc<Self>, name: &str) -> Result<CudaFunction, DriverError> {
        self.context.bind()?;
        let name = CString::new(name).expect("a kernel's name is text");
        let mut handle = ptr::null_mut();
        // SAFETY: a module of the current context, text that ends in 0; writes one handle.
        unsafe { driver::module_get_function(&mut handle, self.handle, name.as_ptr())? };
        Ok(CudaFunction { module: Arc::clone(self), handle })
    }
}

impl Drop for CudaModule {
    fn drop(&mut self) {
        if self.context.bind().is_ok() {
            // SAFETY: made by `load_module`; its functions hold it.
            let _ = unsafe { driver::module_unload(self.handle) };
        }
    }
}

/// A kernel.
#[derive(Clone, Debug)]
pub struct CudaFunction {
    module: Arc<CudaModule>,
    handle: Handle,
}
// SAFETY: as the context.
unsafe impl Send for CudaFunction {}
// SAFETY: as the context.
unsafe impl Sync for CudaFunction {}

impl CudaFunction {
    /// Sets a `CU_FUNC_ATTRIBUTE_`.
    ///
    /// # Errors
    /// What the driver reports.
    pub fn set_attribute(&self, attribute: i32, value: i32) -> Result<(), DriverError> {
        self.module.context.bind()?;
        // SAFETY: a function of a module that is loaded.
        unsafe { driver::func_set_attribute(self.handle, attribute, value) }
    }
}

/// Blocks, threads of a block, and shared memory of a block, bytes.
#[derive(Clone, Copy, Debug)]
pub struct LaunchConfig {
    /// Blocks (x, y, z).
    pub grid_dim: (u32, u32, u32),
    /// Threads (x, y, z).
    pub block_dim: (u32, u32, u32),
    /// Dynamic shared memory.
    pub shared_mem_bytes: u32,
}

/// Something that a kernel takes: numbers as they are, device memory as its address.
pub trait Argument {
    /// Where the driver reads it.
    fn address(&self) -> *const c_void;
}

impl<T: DeviceRepr> Argument for T {
    fn address(&self) -> *const c_void {
        ptr::from_ref(self).cast()
    }
}

impl<T> Argument for CudaSlice<T> {
    fn address(&self) -> *const c_void {
        ptr::from_ref(self.at()).cast()
    }
}

impl<T> Argument for CudaView<'_, T> {
    fn address(&self) -> *const c_void {
        ptr::from_ref(self.at()).cast()
    }
}

impl<T> Argument for CudaViewMut<'_, T> {
    fn address(&self) -> *const c_void {
        ptr::from_ref(self.at()).cast()
    }
}

/// A launch whose arguments are being given.
#[derive(Debug)]
pub struct Launch<'a> {
    stream: &'a CudaStream,
    function: &'a CudaFunction,
    arguments: Vec<*mut c_void>,
    borrowed: PhantomData<&'a ()>,
}

impl<'a> Launch<'a> {
    /// Without arguments.
    pub(super) fn new(stream: &'a CudaStream, function: &'a CudaFunction) -> Self {
        Self { stream, function, arguments: Vec::new(), borrowed: PhantomData }
    }

    /// The next argument.
    pub fn arg(&mut self, argument: &'a impl Argument) -> &mut Self {
        self.arguments.push(argument.address().cast_mut());
        self
    }

    /// Launches the kernel, in the order of the stream.
    ///
    /// # Errors
    /// What the driver reports.
    ///
    /// # Safety
    /// The arguments are the kernel's, and what it reads and writes lies in them.
    pub unsafe fn launch(&mut self, shape: LaunchConfig) -> Result<(), DriverError> {
        self.stream.context.bind()?;
        let ((gx, gy, gz), (bx, by, bz)) = (shape.grid_dim, shape.block_dim);
        let (function, stream, shared) = (self.function.handle, self.stream.handle, shape.shared_mem_bytes);
        let arguments = self.arguments.as_mut_ptr();
        // SAFETY: the caller's; the driver copies the arguments before this returns.
        unsafe {
            driver::launch_kernel(
                function,
                gx,
                gy,
                gz,
                bx,
                by,
                bz,
                shared,
                stream,
                arguments,
                ptr::null_mut(),
            )
        }
    }
}
