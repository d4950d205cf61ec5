//! NVIDIA GPUs through the CUDA driver: devices, memory, streams, launches, errors. No optics: one band on a device is [`crate::stages::cuda`].
//!
//! At run time only the driver library is needed (`libcuda.so.1`, 12.2 or newer). It is loaded at the first use of a GPU, so the
//! program also starts without it. Kernels are CUDA C beside the CPU stages that they mirror (`remap/remap.cu`,
//! `psf/psf.cu`); `scripts/ptx` compiles them to PTX for compute capability 8.0 and assembles that to cubins for several capabilities. Both are
//! kept in `pipeline/ptx` and embedded in the program; a GPU without a cubin has the PTX assembled by its driver. So any machine builds
//! this, and tests run the same `.cu` source on the CPU.
#![allow(unsafe_code)]

pub mod device;
pub mod driver;
pub mod error;
mod figures;
pub mod handle;
pub mod kernel_timer;
pub mod launch;
pub mod memory;
pub(crate) mod pool;
pub mod ptx;
pub mod slice;
pub(crate) mod upload_ring;

pub use device::{Device, DeviceInfo, devices, listed_devices};
pub use error::CudaError;
pub use figures::{GpuFigures, LaunchTimes};
