//! GPU errors, classified by what can be done about them.
//!
//! Codes are those of the CUDA driver API (`CUresult`); newer drivers return some that are not listed here. Some leave a context
//! unusable for the rest of the process: an error of a kernel, which would fail on any GPU, and a lost device or destroyed
//! context, whose work is requeued for other devices. `LAUNCH_FAILED` is reported for either and counts as a lost device.

pub use super::driver::Version;
use super::driver::{DriverError, LoadError, OLDEST_DRIVER};
use thiserror::Error;

/// `CUDA_ERROR_OUT_OF_MEMORY`.
pub(super) const OUT_OF_MEMORY: i32 = 2;
/// `CUDA_ERROR_NO_DEVICE`.
pub(super) const NO_DEVICE: i32 = 100;
/// An error of a kernel: ILLEGAL_ADDRESS, LAUNCH_TIMEOUT, ASSERT, HARDWARE_STACK_ERROR, ILLEGAL_INSTRUCTION,
/// MISALIGNED_ADDRESS, INVALID_ADDRESS_SPACE, INVALID_PC.
const KERNEL: [i32; 8] = [700, 702, 710, 714, 715, 716, 717, 718];
/// The device or its context is lost: DEINITIALIZED, INVALID_CONTEXT, ECC_UNCORRECTABLE, NVLINK_UNCORRECTABLE,
/// CONTAINED, CONTEXT_IS_DESTROYED, LAUNCH_FAILED, TENSOR_MEMORY_LEAK, MPS_RPC_FAILURE, MPS_CLIENT_TERMINATED, UNKNOWN.
const LOST: [i32; 11] = [4, 201, 214, 220, 226, 709, 719, 721, 806, 810, 999];
/// The device is in use by other processes: DEVICE_UNAVAILABLE (exclusive compute mode), CONTEXT_ALREADY_IN_USE, MPS_SERVER_NOT_READY,
/// MPS_MAX_CLIENTS_REACHED, MPS_MAX_CONNECTIONS_REACHED.
const IN_USE: [i32; 5] = [46, 216, 807, 808, 809];

/// Minimum of compute capability: the target of the compiled kernels.
pub const OLDEST_CAPABILITY: Version = (8, 0);

/// An error of a GPU or its driver.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum CudaError {
    /// There is no driver library.
    #[error(
        "looking for GPUs: no NVIDIA driver on this machine (libcuda.so.1 is not found); install one, {} or newer, or compute on the CPU",
        dotted(&OLDEST_DRIVER)
    )]
    NoDriver,
    /// This build has no functions of the driver.
    #[error(
        "looking for GPUs: this build of lenscube lacks the feature `cuda`; build it by `cargo install --path .`, or compute on the CPU"
    )]
    NotBuilt,
    /// The driver does not accept the PTX version of the kernels.
    #[error(
        "looking for GPUs: the NVIDIA driver supports CUDA {}, {} or newer is needed; update the driver, or compute on the CPU",
        dotted(.found),
        dotted(&OLDEST_DRIVER)
    )]
    DriverTooOld {
        /// CUDA version of the driver.
        found: Version,
    },
    /// There is a driver, but no GPU.
    #[error(
        "looking for GPUs: there is an NVIDIA driver, but no GPU that this process may use (CUDA_VISIBLE_DEVICES, cgroups and containers can hide them)"
    )]
    NoDevice,
    /// The index is beyond the last GPU.
    #[error("opening GPU {index}: {count} GPUs are visible to this process (indices {}), numbered from 0 as `lenscube device list` lists them", indices(*.count))]
    NoSuchDevice {
        /// The requested index.
        index: usize,
        /// Number of GPUs.
        count: usize,
    },
    /// The compute capability is below [`OLDEST_CAPABILITY`].
    #[error(
        "opening GPU {index} ({name}): its compute capability is {}, {} or newer is needed (Ampere and later)",
        dotted(.found),
        dotted(&OLDEST_CAPABILITY)
    )]
    DeviceTooOld {
        /// Which GPU.
        index: usize,
        /// Its name.
        name: String,
        /// Its compute capability.
        found: Version,
    },
    /// Not enough device memory.
    #[error(
        "GPU {device}: out of memory for {what}: {requested_bytes} bytes requested, {free_bytes} of {total_bytes} free; end other processes that use this GPU, or use one with more memory"
    )]
    OutOfMemory {
        /// Which GPU.
        device: usize,
        /// What the memory is for.
        what: String,
        /// Requested memory.
        requested_bytes: u64,
        /// Free memory.
        free_bytes: u64,
        /// Total memory of the device.
        total_bytes: u64,
    },
    /// The limit on device memory or on page-locked host memory is too small for one tile at a time.
    #[error(
        "GPU {device} ({name}): one tile needs {} of GPU memory and {} of page-locked host memory; available: {} and {}; end other processes that use this GPU, raise --memory, use another GPU or `--device cpu`",
        mib(.needed_bytes), mib(.host_needed_bytes), mib(.usable_bytes), mib(.host_usable_bytes)
    )]
    TooSmall {
        /// Which GPU.
        device: usize,
        /// Its name.
        name: String,
        /// Minimum of device memory.
        needed_bytes: u64,
        /// Usable device memory.
        usable_bytes: u64,
        /// Minimum of page-locked host memory.
        host_needed_bytes: u64,
        /// Usable page-locked host memory.
        host_usable_bytes: u64,
    },
    /// A kernel failed: an error of this program.
    #[error(
        "GPU {device}, {doing}: a kernel failed ({code}); results since then are discarded; this is a program error: please report it with the output of `compute-sanitizer`"
    )]
    Kernel {
        /// Which GPU.
        device: usize,
        /// What was being done.
        doing: String,
        /// The driver's code.
        code: String,
    },
    /// The device is lost for this process.
    #[error(
        "GPU {device}, {doing}: the device is lost ({code}); see the kernel log (`dmesg`, Xid); the same command resumes the film"
    )]
    Lost {
        /// Which GPU.
        device: usize,
        /// What was being done.
        doing: String,
        /// The driver's code.
        code: String,
    },
    /// The device is in use by another process.
    #[error(
        "GPU {device}, {doing}: the device is in use by another process ({code}); wait until that process ends, or check the compute mode of the GPU (`nvidia-smi -q -d COMPUTE`)"
    )]
    InUse {
        /// Which GPU.
        device: usize,
        /// What was being done.
        doing: String,
        /// The driver's code.
        code: String,
    },
    /// Not enough page-locked host memory.
    #[error(
        "GPU {device}: out of page-locked host memory: {requested_bytes} bytes requested; lower --memory, end other programs, or raise the limit on locked memory (`ulimit -l`, the container's)"
    )]
    OutOfHostMemory {
        /// The GPU that the memory is for.
        device: usize,
        /// Requested memory.
        requested_bytes: u64,
    },
    /// Any other error of the driver.
    #[error("GPU {device}, {doing}: the driver reports {code}")]
    Driver {
        /// Which GPU.
        device: usize,
        /// What was being done.
        doing: String,
        /// The driver's code.
        code: String,
    },
    /// The driver failed before any GPU was opened.
    #[error("looking for GPUs: the NVIDIA driver reports {code}; see whether `nvidia-smi` works")]
    Start {
        /// The driver's code.
        code: String,
    },
}

impl CudaError {
    /// Error of loading the driver.
    pub(super) fn load(error: LoadError) -> Self {
        match error {
            #[cfg(feature = "cuda")]
            LoadError::NoLibrary => Self::NoDriver,
            #[cfg(not(feature = "cuda"))]
            LoadError::NotBuilt => Self::NotBuilt,
            LoadError::TooOld(found) => Self::DriverTooOld { found },
            LoadError::Function(code) => Self::Start { code },
        }
    }

    /// Classifies `error`, reported for `device` while `doing`.
    pub fn new(device: usize, doing: &str, error: DriverError) -> Self {
        let (doing, code) = (doing.to_owned(), error.to_string());
        match error.0 {
            n if KERNEL.contains(&n) => Self::Kernel { device, doing, code },
            n if LOST.contains(&n) => Self::Lost { device, doing, code },
            n if IN_USE.contains(&n) => Self::InUse { device, doing, code },
            _ => Self::Driver { device, doing, code },
        }
    }

    /// [`CudaError::new`] for `map_err`.
    pub fn during(device: usize, doing: &str) -> impl FnOnce(DriverError) -> Self {
        move |error| Self::new(device, doing, error)
    }

    /// Whether the same command may succeed later.
    pub fn retryable(&self) -> bool {
        matches!(self, Self::InUse { .. }) || self.is_lost() || self.is_out_of_memory()
    }

    /// Whether the queue may succeed with less memory of the device, or of the host if it is [`Self::OutOfHostMemory`].
    pub fn is_out_of_memory(&self) -> bool {
        matches!(self, Self::OutOfMemory { .. } | Self::OutOfHostMemory { .. })
    }

    /// Whether the device is lost for this process, so that its work is requeued for other devices.
    pub fn is_lost(&self) -> bool {
        matches!(self, Self::Lost { .. })
    }
}

fn mib(bytes: &u64) -> String {
    format!("{} MiB", bytes.div_ceil(1 << 20))
}

fn dotted((major, minor): &Version) -> String {
    format!("{major}.{minor}")
}

fn indices(count: usize) -> String {
    match count {
        1 => "0".into(),
        n => format!("0 to {}", n - 1),
    }
}
