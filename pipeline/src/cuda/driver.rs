//! Functions of the CUDA driver library, which is loaded at the first use of a GPU: the driver's own `libcuda.so.1`, else what cudarc
//! finds. `libcuda.so` alone may be the library of a development kit that only serves for linking.
//!
//! Results are integers: newer drivers return codes that are not listed here, and an integer outside the list of a Rust enum (such
//! as cudarc's result type) is undefined behaviour. Signatures and constants are those of `cuda.h` 12.2.

#[cfg(feature = "cuda")]
use cudarc::driver::sys;
#[cfg(feature = "cuda")]
use libloading::Library;
use std::ffi::{CStr, c_char, c_int, c_uint, c_void};
use std::fmt;
use std::sync::OnceLock;

/// A version or a compute capability: (major, minor).
pub type Version = (i32, i32);

/// The oldest supported driver: the first that accepts the PTX version of the kernels (8.2).
pub const OLDEST_DRIVER: Version = (12, 2);

/// An error code of the driver (`CUresult`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DriverError(pub c_int);

/// The driver library cannot be used.
#[derive(Clone, Debug)]
pub(super) enum LoadError {
    /// This build has no functions of the driver.
    #[cfg(not(feature = "cuda"))]
    NotBuilt,
    /// There is no driver library.
    #[cfg(feature = "cuda")]
    NoLibrary,
    /// Older than [`OLDEST_DRIVER`].
    TooOld(Version),
    /// A function is missing or fails.
    Function(String),
}

/// Opaque handle of a context, stream, event, module or function.
pub(super) type Handle = *mut c_void;
/// Device address.
pub(super) type Address = u64;

/// `CU_CTX_SCHED_BLOCKING_SYNC`.
pub(super) const BLOCKING_CONTEXT: c_uint = 4;
/// `CU_STREAM_NON_BLOCKING`.
pub(super) const NON_BLOCKING: c_uint = 1;

/// A field and a checked function for each function of the driver.
macro_rules! functions {
    ($($name:ident = $symbol:literal ($($arg:ident: $kind:ty),*);)*) => {
        #[derive(Debug)]
        struct Functions {
            $($name: unsafe extern "C" fn($($kind),*) -> c_int,)*
        }

        impl Functions {
            /// The functions of the library.
            fn find(library: &'static Library) -> Result<Self, LoadError> {
                // SAFETY: the library stays loaded, and its symbols have these types in the driver's header.
                unsafe {
                    $(let $name = *library.get(concat!($symbol, "\0").as_bytes()).map_err(missing)?;)*
                    Ok(Self { $($name,)* })
                }
            }
        }

        $(
            /// The driver's function of this name.
            ///
            /// # Safety
            /// The conditions of the driver's manual.
            #[allow(clippy::too_many_arguments, reason = "the driver's signatures")]
            pub(super) unsafe fn $name($($arg: $kind),*) -> Result<(), DriverError> {
                let functions = functions().map_err(|_| NOT_INITIALIZED)?;
                // SAFETY: guaranteed by the caller.
                check(unsafe { (functions.$name)($($arg),*) })
            }
        )*
    };
}

functions! {
    init = "cuInit"(flags: c_uint);
    device_get_count = "cuDeviceGetCount"(count: *mut c_int);
    device_get = "cuDeviceGet"(device: *mut c_int, index: c_int);
    device_get_name = "cuDeviceGetName"(name: *mut c_char, len: c_int, device: c_int);
    device_get_uuid = "cuDeviceGetUuid_v2"(uuid: *mut u8, device: c_int);
    device_total_mem = "cuDeviceTotalMem_v2"(bytes: *mut usize, device: c_int);
    device_get_attribute = "cuDeviceGetAttribute"(value: *mut c_int, attribute: c_int, device: c_int);
    primary_ctx_retain = "cuDevicePrimaryCtxRetain"(context: *mut Handle, device: c_int);
    primary_ctx_release = "cuDevicePrimaryCtxRelease_v2"(device: c_int);
    ctx_set_current = "cuCtxSetCurrent"(context: Handle);
    ctx_set_flags = "cuCtxSetFlags"(flags: c_uint);
    ctx_synchronize = "cuCtxSynchronize"();
    device_get_default_mem_pool = "cuDeviceGetDefaultMemPool"(pool: *mut Handle, device: c_int);
    mem_pool_set_attribute = "cuMemPoolSetAttribute"(pool: Handle, attribute: c_int, value: *mut c_void);
    mem_get_info = "cuMemGetInfo_v2"(free: *mut usize, total: *mut usize);
    mem_alloc = "cuMemAlloc_v2"(at: *mut Address, bytes: usize);
    mem_alloc_async = "cuMemAllocAsync"(at: *mut Address, bytes: usize, stream: Handle);
    mem_free = "cuMemFree_v2"(at: Address);
    mem_free_async = "cuMemFreeAsync"(at: Address, stream: Handle);
    mem_host_alloc = "cuMemHostAlloc"(at: *mut *mut c_void, bytes: usize, flags: c_uint);
    mem_free_host = "cuMemFreeHost"(at: *mut c_void);
    memcpy_htod = "cuMemcpyHtoDAsync_v2"(to: Address, from: *const c_void, bytes: usize, stream: Handle);
    memcpy_dtoh = "cuMemcpyDtoHAsync_v2"(to: *mut c_void, from: Address, bytes: usize, stream: Handle);
    memset = "cuMemsetD8Async"(to: Address, value: u8, bytes: usize, stream: Handle);
    stream_create = "cuStreamCreate"(stream: *mut Handle, flags: c_uint);
    stream_destroy = "cuStreamDestroy_v2"(stream: Handle);
    stream_synchronize = "cuStreamSynchronize"(stream: Handle);
    stream_wait_event = "cuStreamWaitEvent"(stream: Handle, event: Handle, flags: c_uint);
    event_create = "cuEventCreate"(event: *mut Handle, flags: c_uint);
    event_destroy = "cuEventDestroy_v2"(event: Handle);
    event_record = "cuEventRecord"(event: Handle, stream: Handle);
    event_synchronize = "cuEventSynchronize"(event: Handle);
    event_elapsed_time = "cuEventElapsedTime"(ms: *mut f32, from: Handle, to: Handle);
    module_load_data = "cuModuleLoadData"(module: *mut Handle, image: *const c_void);
    module_unload = "cuModuleUnload"(module: Handle);
    module_get_function = "cuModuleGetFunction"(function: *mut Handle, module: Handle, name: *const c_char);
    func_get_attribute = "cuFuncGetAttribute"(value: *mut c_int, attribute: c_int, function: Handle);
    func_set_attribute = "cuFuncSetAttribute"(function: Handle, attribute: c_int, value: c_int);
    launch_kernel = "cuLaunchKernel"(function: Handle, grid_x: c_uint, grid_y: c_uint, grid_z: c_uint, block_x: c_uint,
        block_y: c_uint, block_z: c_uint, shared_bytes: c_uint, stream: Handle, arguments: *mut *mut c_void,
        extra: *mut *mut c_void);
    get_error_name = "cuGetErrorName"(code: c_int, name: *mut *const c_char);
}

/// `CUDA_ERROR_NOT_INITIALIZED`.
const NOT_INITIALIZED: DriverError = DriverError(3);

fn check(code: c_int) -> Result<(), DriverError> {
    if code == 0 { Ok(()) } else { Err(DriverError(code)) }
}

/// The library, loaded once in the process.
fn library() -> Result<&'static (Functions, Version), LoadError> {
    static LIBRARY: OnceLock<Result<(Functions, Version), LoadError>> = OnceLock::new();
    LIBRARY.get_or_init(load).as_ref().map_err(Clone::clone)
}

fn functions() -> Result<&'static Functions, LoadError> {
    library().map(|(functions, _)| functions)
}

/// The library lacks a function.
fn missing(error: impl fmt::Display) -> LoadError {
    LoadError::Function(error.to_string())
}

/// The library; called once.
#[cfg(feature = "cuda")]
fn open() -> Result<&'static Library, LoadError> {
    // SAFETY: loads the library, whose initialisation runs no code of this program. Checked first: `culib` panics without it. `libcuda.so` is the first
    // name that cudarc tries; its sixteen others, of other systems and versions, take 10 ms on a machine without a GPU.
    unsafe {
        match Library::new("libcuda.so.1") {
            Ok(library) => Ok(Box::leak(Box::new(library))),
            Err(_) if Library::new("libcuda.so").is_ok() => Ok(sys::culib()),
            Err(_) => Err(LoadError::NoLibrary),
        }
    }
}

/// None: this build loads no library.
#[cfg(not(feature = "cuda"))]
#[derive(Debug)]
enum Library {}

#[cfg(not(feature = "cuda"))]
impl Library {
    /// # Safety
    /// Cannot be called.
    unsafe fn get<T>(&self, _symbol: &[u8]) -> Result<&T, String> {
        match *self {}
    }
}

#[cfg(not(feature = "cuda"))]
fn open() -> Result<&'static Library, LoadError> {
    Err(LoadError::NotBuilt)
}

fn load() -> Result<(Functions, Version), LoadError> {
    let library = open()?;
    let mut version = 0;
    {
        // SAFETY: the library is loaded, and this is the type of the function in the driver's header.
        let get_version =
            unsafe { library.get::<unsafe extern "C" fn(*mut c_int) -> c_int>(b"cuDriverGetVersion\0") };
        // SAFETY: needs no initialised driver and writes one integer.
        let result = check(unsafe { get_version.map_err(missing)?(&mut version) });
        result.map_err(|e| LoadError::Function(format!("error {}", e.0)))?;
    }
    // Reported as 1000 major + 10 minor.
    let version = (version / 1000, version % 1000 / 10);
    if version < OLDEST_DRIVER {
        return Err(LoadError::TooOld(version));
    }
    Ok((Functions::find(library)?, version))
}

/// The CUDA version that the driver supports.
///
/// # Errors
/// No driver, or one older than [`OLDEST_DRIVER`].
pub(super) fn version() -> Result<Version, LoadError> {
    library().map(|(_, version)| *version)
}

impl fmt::Display for DriverError {
    /// The driver's name of the error, and its code.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut name = std::ptr::null();
        // SAFETY: writes one pointer: null, or to a constant of the library.
        let known = unsafe { get_error_name(self.0, &mut name) };
        if known.is_err() || name.is_null() {
            return write!(f, "unknown error, {}", self.0);
        }
        // SAFETY: a string of the library, which stays loaded.
        write!(f, "{}, {}", unsafe { CStr::from_ptr(name) }.to_string_lossy(), self.0)
    }
}
