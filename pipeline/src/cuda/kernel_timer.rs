//! Events around kernels, so that their time excludes the work of the host that launches them.

use super::device::Device;
use super::error::CudaError;
use super::handle::{BLOCKING_EVENT, CudaEvent, CudaStream};
use std::time::Instant;

/// Time of the host in planning one batch, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HostTimes {
    /// Descriptors and their order.
    pub descriptors_s: f64,
    /// Base kernels of the PSFs.
    pub base_kernels_s: f64,
}

/// Records an event before and one after each sequence of kernels of a stream.
#[derive(Debug)]
pub struct KernelTimer<'a> {
    device: &'a Device,
    stream: &'a CudaStream,
    started: Option<CudaEvent>,
    /// First and last event of each sequence.
    pub spans: Vec<[CudaEvent; 2]>,
}

impl<'a> KernelTimer<'a> {
    /// For kernels of `stream`.
    pub fn new(device: &'a Device, stream: &'a CudaStream) -> Self {
        Self { device, stream, started: None, spans: Vec::new() }
    }

    /// Begins a sequence.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn start(&mut self) -> Result<(), CudaError> {
        self.started = Some(self.event()?);
        Ok(())
    }

    /// Ends the sequence.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn stop(&mut self) -> Result<(), CudaError> {
        if let Some(start) = self.started.take() {
            let end = self.event()?;
            self.spans.push([start, end]);
        }
        Ok(())
    }

    fn event(&self) -> Result<CudaEvent, CudaError> {
        self.stream.record_event(BLOCKING_EVENT).map_err(self.device.failed("timing"))
    }
}

/// Adds the time of `work` to `seconds`.
pub fn timed<T>(seconds: &mut f64, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let value = work();
    *seconds += start.elapsed().as_secs_f64();
    value
}
