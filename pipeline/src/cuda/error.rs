//! What a GPU can be refused for, and what can become of it.
//!
//! Codes are those of the CUDA driver API (`CUresult`), integers: newer drivers return some that are not listed here. Some leave
//! a context unusable for the rest of the process: a kernel's own fault (it would fail on any GPU), and a device that is lost or
//! a context that is destroyed, whose work other devices can take over. `LAUNCH_FAILED` is reported for either; it counts as a
//! lost device.

use super::driver::DriverError;
use thiserror::Error;

/// `CUDA_ERROR_OUT_OF_MEMORY`.
pub(super) const OUT_OF_MEMORY: i32 = 2;
/// `CUDA_ERROR_NO_DEVICE`.
pub(super) const NO_DEVICE: i32 = 100;
/// A kernel did what it must not: ILLEGAL_ADDRESS, LAUNCH_TIMEOUT, ASSERT, HARDWARE_STACK_ERROR, ILLEGAL_INSTRUCTION,
/// MISALIGNED_ADDRESS, INVALID_ADDRESS_SPACE, INVALID_PC.
const KERNEL: [i32; 8] = [700, 702, 710, 714, 715, 716, 717, 718];
/// The device or its context cannot be used any more: DEINITIALIZED, INVALID_CONTEXT, ECC_UNCORRECTABLE, NVLINK_UNCORRECTABLE,
/// CONTAINED, CONTEXT_IS_DESTROYED, LAUNCH_FAILED, TENSOR_MEMORY_LEAK, MPS_RPC_FAILURE, MPS_CLIENT_TERMINATED, UNKNOWN.
const LOST: [i32; 11] = [4, 201, 214, 220, 226, 709, 719, 721, 806, 810, 999];
/// Other processes use the device: DEVICE_UNAVAILABLE (exclusive compute mode), CONTEXT_ALREADY_IN_USE, MPS_SERVER_NOT_READY,
/// MPS_MAX_CLIENTS_REACHED, MPS_MAX_CONNECTIONS_REACHED.
const IN_USE: [i32; 5] = [46, 216, 807, 808, 809];

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
    /// The device is in use by others.
    #[error(
        "GPU {device}, {doing}: the device is in use by another process ({code}); wait for its end, or see its compute mode (`nvidia-smi -q -d COMPUTE`)"
    )]
    InUse {
        /// Which GPU.
        device: usize,
        /// What was being done.
        doing: String,
        /// The driver's code.
        code: String,
    },
    /// Not enough page-locked host memory, whatever the device has.
    #[error(
        "GPU {device}: out of page-locked host memory: {asked_bytes} bytes asked for; lower --memory, end other programs, or raise the limit on locked memory (`ulimit -l`, the container's)"
    )]
    OutOfHostMemory {
        /// For which GPU.
        device: usize,
        /// How much was asked for.
        asked_bytes: u64,
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
        let (doing, code) = (doing.to_owned(), error.to_string());
        match error.0 {
            n if KERNEL.contains(&n) => Self::Kernel { device, doing, code },
            n if LOST.contains(&n) => Self::Lost { device, doing, code },
            n if IN_USE.contains(&n) => Self::InUse { device, doing, code },
            _ => Self::Driver { device, doing, code },
        }
    }

    /// For `map_err`: [`CudaError::new`] of whatever comes.
    pub fn on(device: usize, doing: &str) -> impl FnOnce(DriverError) -> Self {
        move |error| Self::new(device, doing, error)
    }

    /// Whether the same command may succeed later.
    pub fn retryable(&self) -> bool {
        let passes = matches!(self, Self::InUse { .. } | Self::OutOfHostMemory { .. });
        passes || self.lost() || self.out_of_memory()
    }

    /// Whether it may do with less of its memory.
    pub fn out_of_memory(&self) -> bool {
        matches!(self, Self::OutOfMemory { .. })
    }

    /// Whether the device is gone for this process, so that its work goes back to the others.
    pub fn lost(&self) -> bool {
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
