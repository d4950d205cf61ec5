//! Kernels and their launches.

use super::driver::{self, DriverError, Handle};
use super::handle::{CudaContext, CudaStream};
use super::slice::{CudaSlice, CudaView, CudaViewMut, DeviceMemory, DeviceRepr};
use std::ffi::{CString, c_void};
use std::marker::PhantomData;
use std::ptr;
use std::sync::Arc;

/// Kernels loaded on a device.
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
    /// Assembles the kernels of `ptx`.
    pub(super) fn assemble(context: &Arc<CudaContext>, ptx: &str) -> Result<Arc<Self>, DriverError> {
        let text = CString::new(ptx).expect("PTX has no NUL");
        // SAFETY: NUL-terminated text.
        unsafe { Self::load(context, text.as_ptr().cast()) }
    }

    /// Loads the kernels of a cubin of this program, which `scripts/ptx` made.
    pub(super) fn load_cubin(
        context: &Arc<CudaContext>,
        cubin: &'static [u8],
    ) -> Result<Arc<Self>, DriverError> {
        // SAFETY: a complete ELF file, whose headers give its size.
        unsafe { Self::load(context, cubin.as_ptr().cast()) }
    }

    /// # Safety
    /// `image` is NUL-terminated PTX or a complete cubin.
    unsafe fn load(context: &Arc<CudaContext>, image: *const c_void) -> Result<Arc<Self>, DriverError> {
        context.bind()?;
        let mut handle = ptr::null_mut();
        // SAFETY: as the caller guarantees; writes one handle.
        unsafe { driver::module_load_data(&mut handle, image)? };
        Ok(Arc::new(Self { context: Arc::clone(context), handle }))
    }

    /// The kernel `name`.
    pub(super) fn function(self: &Arc<Self>, name: &str) -> Result<CudaFunction, DriverError> {
        self.context.bind()?;
        let name = CString::new(name).expect("a kernel's name has no NUL");
        let mut handle = ptr::null_mut();
        // SAFETY: a module of the current context, NUL-terminated text; writes one handle.
        unsafe { driver::module_get_function(&mut handle, self.handle, name.as_ptr())? };
        Ok(CudaFunction { module: Arc::clone(self), handle })
    }
}

impl Drop for CudaModule {
    fn drop(&mut self) {
        if self.context.bind().is_ok() {
            // SAFETY: loaded by `load`; its functions hold it.
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
    /// Value of a `CU_FUNC_ATTRIBUTE_`.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn attribute(&self, attribute: i32) -> Result<i32, DriverError> {
        self.module.context.bind()?;
        let mut value = 0;
        // SAFETY: a function of a loaded module; writes one number.
        unsafe { driver::func_get_attribute(&mut value, attribute, self.handle)? };
        Ok(value)
    }

    /// Sets a `CU_FUNC_ATTRIBUTE_`.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn set_attribute(&self, attribute: i32, value: i32) -> Result<(), DriverError> {
        self.module.context.bind()?;
        // SAFETY: a function of a loaded module.
        unsafe { driver::func_set_attribute(self.handle, attribute, value) }
    }
}

/// Shape of a launch.
#[derive(Clone, Copy, Debug)]
pub struct LaunchConfig {
    /// Thread blocks (x, y, z).
    pub grid_dim: (u32, u32, u32),
    /// Threads of a block (x, y, z).
    pub block_dim: (u32, u32, u32),
    /// Dynamic shared memory of a block, bytes.
    pub shared_mem_bytes: u32,
}

/// A kernel's argument: numbers by value, device memory by its address.
pub trait Argument {
    /// Host address from which the driver reads it.
    fn address(&self) -> *const c_void;
}

impl<T: DeviceRepr> Argument for T {
    fn address(&self) -> *const c_void {
        ptr::from_ref(self).cast()
    }
}

macro_rules! memory_arguments {
    ($($memory:ty),*) => {
        $(impl<T> Argument for $memory {
            fn address(&self) -> *const c_void {
                ptr::from_ref(DeviceMemory::<T>::address(self)).cast()
            }
        })*
    };
}
memory_arguments!(CudaSlice<T>, CudaView<'_, T>, CudaViewMut<'_, T>);

/// Builder of a launch.
#[derive(Debug)]
pub struct Launch<'a> {
    stream: &'a CudaStream,
    function: &'a CudaFunction,
    arguments: Vec<*mut c_void>,
    borrowed: PhantomData<&'a ()>,
}

impl CudaStream {
    /// A launch of `function`, still without arguments.
    pub fn launch_builder<'a>(&'a self, function: &'a CudaFunction) -> Launch<'a> {
        Launch { stream: self, function, arguments: Vec::new(), borrowed: PhantomData }
    }
}

impl<'a> Launch<'a> {
    /// Appends an argument.
    pub fn arg(&mut self, argument: &'a impl Argument) -> &mut Self {
        self.arguments.push(argument.address().cast_mut());
        self
    }

    /// Launches the kernel, in the order of the stream.
    ///
    /// # Errors
    /// An error of the driver.
    ///
    /// # Safety
    /// The arguments match the kernel's parameters, and the kernel accesses only memory within them.
    pub unsafe fn launch(&mut self, shape: LaunchConfig) -> Result<(), DriverError> {
        self.stream.context.bind()?;
        let ((gx, gy, gz), (bx, by, bz)) = (shape.grid_dim, shape.block_dim);
        let (function, stream, shared) = (self.function.handle, self.stream.handle, shape.shared_mem_bytes);
        let arguments = self.arguments.as_mut_ptr();
        // SAFETY: guaranteed by the caller; the driver copies the arguments before this returns.
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
