//! What a GPU can be refused for, and what can become of it.
//!
//! Codes are those of the CUDA driver API (`CUresult`). Some leave a context unusable for the rest of the process: a kernel's own
//! fault (it would fail on any GPU) and a device that is gone, whose work other devices can take over. `LAUNCH_FAILED` is
//! reported for either; it counts as a lost device.

use cudarc::driver::DriverError;
use cudarc::driver::sys::CUresult;
use thiserror::Error;

/// A version or a compute capability.
pub type Version = (i32, i32);

/// The oldest driver: the first to know the PTX of the program's kernels (8.2).
pub const OLDEST_DRIVER: Version = (12, 2);
/// The oldest GPUs: what the kernels are compiled for.
pub const OLDEST_CAPABILITY: Version = (8, 0);

/// Why a GPU does not do what was asked.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum CudaError {
    /// No driver library.
    #[error(
        "looking for GPUs: no NVIDIA driver on this machine (libcuda.so.1 is not found); install one, {} or newer, or compute on the CPU",
        dotted(&OLDEST_DRIVER)
    )]
    NoDriver,
    /// A driver that cannot read the kernels.
    #[error(
        "looking for GPUs: the NVIDIA driver supports CUDA {}, {} or newer is needed; update the driver, or compute on the CPU",
        dotted(.found),
        dotted(&OLDEST_DRIVER)
    )]
    DriverTooOld {
        /// The CUDA version that it supports.
        found: Version,
    },
    /// A driver without a GPU.
    #[error(
        "looking for GPUs: there is an NVIDIA driver, but no GPU that this process may use (CUDA_VISIBLE_DEVICES, cgroups and containers can hide them)"
    )]
    NoDevice,
    /// An index beyond the last.
    #[error("opening GPU {index}: this process sees {count} ({}); indices count from 0, as `nvidia-smi -L` lists them", indices(*.count))]
    NoSuchDevice {
        /// What was asked for.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// A GPU that cannot run the kernels.
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
        "GPU {device}: out of memory for {what}: {asked_bytes} bytes asked for, {free_bytes} of {total_bytes} free; end what else uses this GPU, or use one with more memory"
    )]
    OutOfMemory {
        /// Which GPU.
        device: usize,
        /// What the memory is for.
        what: String,
        /// How much of it.
        asked_bytes: u64,
        /// How much there was.
        free_bytes: u64,
        /// The device's memory.
        total_bytes: u64,
    },
    /// A device, or the host's memory for it, that is too small for the job's tiles.
    #[error(
        "GPU {device} ({name}): a tile at a time needs {} of its memory and {} of page-locked host memory; {} and {} can be used; end what else uses this GPU, raise --memory, use another GPU or `--device cpu`",
        mib(.needed_bytes), mib(.host_needed_bytes), mib(.usable_bytes), mib(.host_usable_bytes)
    )]
    TooSmall {
        /// Which GPU.
        device: usize,
        /// Its name.
        name: String,
        /// The least of its memory.
        needed_bytes: u64,
        /// What can be used of it.
        usable_bytes: u64,
        /// The least of the host's.
        host_needed_bytes: u64,
        /// What can be used of it.
        host_usable_bytes: u64,
    },
    /// A kernel did what it must not: a fault of this program.
    #[error(
        "GPU {device}, {doing}: a kernel failed ({code}); what was computed since is discarded; this is a fault of the program, `compute-sanitizer` finds the place"
    )]
    Kernel {
        /// Which GPU.
        device: usize,
        /// What was being done.
        doing: String,
        /// The driver's code.
        code: String,
    },
    /// The device is gone for this process.
    #[error(
        "GPU {device}, {doing}: the device is lost ({code}); the kernel log (`dmesg`, Xid) may tell why; the same command goes on where the film ends"
    )]
    Lost {
        /// Which GPU.
        device: usize,
        /// What was being done.
        doing: String,
        /// The driver's code.
        code: String,
    },
    /// Any other refusal of the driver.
    #[error("GPU {device}, {doing}: the driver reports {code}")]
    Driver {
        /// Which GPU.
        device: usize,
        /// What was being done.
        doing: String,
        /// The driver's code.
        code: String,
    },
    /// The driver refuses before any GPU.
    #[error("looking for GPUs: the NVIDIA driver reports {code}; see whether `nvidia-smi` works")]
    Start {
        /// The driver's code.
        code: String,
    },
}

impl CudaError {
    /// What `error` of the driver means for `device` while `doing`.
    pub fn new(device: usize, doing: &str, error: DriverError) -> Self {
        use CUresult as C;
        let (doing, code) = (doing.to_owned(), code(error));
        match error.0 {
            C::CUDA_ERROR_ILLEGAL_ADDRESS
            | C::CUDA_ERROR_LAUNCH_TIMEOUT
            | C::CUDA_ERROR_ASSERT
            | C::CUDA_ERROR_HARDWARE_STACK_ERROR
            | C::CUDA_ERROR_ILLEGAL_INSTRUCTION
            | C::CUDA_ERROR_MISALIGNED_ADDRESS
            | C::CUDA_ERROR_INVALID_ADDRESS_SPACE
            | C::CUDA_ERROR_INVALID_PC => Self::Kernel { device, doing, code },
            C::CUDA_ERROR_LAUNCH_FAILED
            | C::CUDA_ERROR_DEVICE_UNAVAILABLE
            | C::CUDA_ERROR_DEINITIALIZED
            | C::CUDA_ERROR_CONTEXT_IS_DESTROYED
            | C::CUDA_ERROR_ECC_UNCORRECTABLE
            | C::CUDA_ERROR_NVLINK_UNCORRECTABLE
            | C::CUDA_ERROR_UNKNOWN => Self::Lost { device, doing, code },
            _ => Self::Driver { device, doing, code },
        }
    }

    /// For `map_err`: [`CudaError::new`] of whatever comes.
    pub fn on(device: usize, doing: &str) -> impl FnOnce(DriverError) -> Self {
        move |error| Self::new(device, doing, error)
    }

    /// Whether the same command may succeed later.
    pub fn retryable(&self) -> bool {
        self.lost() || self.out_of_memory()
    }

    /// Whether it may do with less memory.
    pub fn out_of_memory(&self) -> bool {
        matches!(self, Self::OutOfMemory { .. })
    }

    /// Whether the device is gone for this process, so that its work goes back to the others.
    pub fn lost(&self) -> bool {
        matches!(self, Self::Lost { .. })
    }
}

/// The driver's name and number of an error.
pub(super) fn code(error: DriverError) -> String {
    format!("{:?}, {}", error.0, error.0 as u32)
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
