//! `--device` resolved: which GPUs compute, opened; or why the processor does.
//!
//! Whoever asks for GPUs gets them or an error. `auto` takes what works, and says what it took and why.

use crate::args::Device;
use crate::failure::usage;
use anyhow::Result;
use pipeline::cuda::memory::{BandNeeds, DeviceQueue};
use pipeline::cuda::{self, CudaError};
use std::sync::Arc;

/// Share of a GPU's free memory that is used: the rest is for what the driver takes as it goes.
const SHARE: f64 = 0.9;

/// What computes.
pub struct Choice {
    /// GPUs, a queue each; none: the processor.
    pub devices: Vec<Arc<cuda::Device>>,
    /// For the log.
    pub why: String,
}

impl Choice {
    /// Opens what `asked` names.
    ///
    /// # Errors
    /// A GPU that was asked for cannot be had.
    pub fn new(asked: &Device) -> Result<Self> {
        match asked {
            Device::Cpu => Ok(Self::cpu("as asked")),
            Device::Cuda(all) => match open(all) {
                Ok(devices) => Ok(Self::gpus(devices)),
                Err(error) => Err(refused(asked, error)),
            },
            Device::Auto => Ok(open(&[]).map_or_else(|e| Self::cpu(&e.to_string()), Self::gpus)),
        }
    }

    /// The processor.
    pub fn cpu(why: &str) -> Self {
        Self { devices: Vec::new(), why: format!("device: cpu ({why})") }
    }

    fn gpus(devices: Vec<Arc<cuda::Device>>) -> Self {
        let name = |d: &Arc<cuda::Device>| format!("GPU {} ({})", d.index(), d.info.name);
        let names: Vec<String> = devices.iter().map(name).collect();
        Self { why: format!("device: {}", names.join(", ")), devices }
    }

    /// The queues, each with its part of its GPU's memory and `host_bytes` of page-locked memory, if all `bands` fit.
    ///
    /// # Errors
    /// A GPU is too small, or does not answer.
    pub fn queues(&self, asked: &Device, bands: &[BandNeeds], host_bytes: usize) -> Result<Vec<DeviceQueue>> {
        plan(&self.devices, bands, host_bytes).map_err(|error| refused(asked, error))
    }
}

/// The GPUs of `asked`; all where it names none.
fn open(asked: &[usize]) -> Result<Vec<Arc<cuda::Device>>, CudaError> {
    let all: Vec<usize> = cuda::devices()?.iter().map(|d| d.index).collect();
    let wanted = if asked.is_empty() { &all } else { asked };
    wanted.iter().map(|&index| cuda::Device::open(index)).collect()
}

fn plan(
    devices: &[Arc<cuda::Device>],
    needs: &[BandNeeds],
    host_bytes: usize,
) -> Result<Vec<DeviceQueue>, CudaError> {
    let mut queues = Vec::new();
    for device in devices {
        let sharing = devices.iter().filter(|d| d.index() == device.index()).count();
        let (free, _) = device.memory()?;
        let device_bytes = (free as f64 * SHARE) as usize / sharing;
        let queue = DeviceQueue { device: Arc::clone(device), device_bytes, host_bytes };
        needs.iter().try_for_each(|needs| queue.plan(needs, 0).map(|_| ()))?;
        queues.push(queue);
    }
    Ok(queues)
}

/// What was asked for cannot be: by the command line where that could have known, else by what the machine is like now.
fn refused(asked: &Device, error: CudaError) -> anyhow::Error {
    match error {
        CudaError::NoDriver
        | CudaError::DriverTooOld { .. }
        | CudaError::NoDevice
        | CudaError::NoSuchDevice { .. }
        | CudaError::DeviceTooOld { .. } => {
            usage(format!("--device {asked}: {error}; `--device cpu` needs none"))
        }
        error => anyhow::Error::from(error).context(format!("--device {asked}")),
    }
}
