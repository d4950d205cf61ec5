//! NVIDIA GPUs: which there are, how one is opened, what can go wrong.
//!
//! Of CUDA, only the driver is needed at run time (`libcuda.so.1`, 12.2 or newer; it is looked for when a GPU is asked for, so the
//! program starts without one). Kernels are CUDA C beside the CPU stages that they mirror (`remap/remap.cu`,
//! `psf/psf.cu`); `scripts/ptx` compiles them to PTX for compute capability 8.0, which lies in the tree and in the program, and
//! the driver assembles it for its GPU. So any machine builds this, and tests run the same `.cu` text on the CPU.
#![allow(unsafe_code)]

pub mod band;
pub mod bench;
pub mod device;
pub mod driver;
pub mod error;
mod figures;
pub mod handle;
pub mod launch;
pub mod memory;
pub(crate) mod pool;
pub mod slice;

pub use band::needs;
pub use device::{Device, DeviceInfo, devices};
pub use error::CudaError;
pub use figures::GpuFigures;
