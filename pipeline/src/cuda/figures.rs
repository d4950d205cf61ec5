//! Counts and times of a GPU queue.

use super::device::Device;
use super::kernel_timer::HostTimes;

/// Time of the thread that launches batches, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LaunchTimes {
    /// CPU time.
    pub core_s: f64,
    /// Waiting for a plan.
    pub plan_s: f64,
    /// Waiting for charts to be read.
    pub chart_s: f64,
    /// Waiting for page-locked strips of film rows: for workers to copy them to shards.
    pub strip_s: f64,
    /// Waiting for a batch on the device to end.
    pub batch_s: f64,
}

impl LaunchTimes {
    /// Adds those of `other`.
    pub(crate) fn add(&mut self, other: &Self) {
        self.core_s += other.core_s;
        self.plan_s += other.plan_s;
        self.chart_s += other.chart_s;
        self.strip_s += other.strip_s;
        self.batch_s += other.batch_s;
    }
}

/// Counts and times of one GPU queue in a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GpuFigures {
    /// Index of the device.
    pub index: usize,
    /// Name of the device.
    pub name: String,
    /// Tiles computed.
    pub tiles: u64,
    /// Batches computed.
    pub batches: u64,
    /// Remapped pixels of those tiles.
    pub pixels: u64,
    /// Spectra of kernel parts built.
    pub spectra: u64,
    /// Busy time of the upload stream, s.
    pub upload_s: f64,
    /// Time of the kernels, s.
    pub compute_s: f64,
    /// Planning of batches.
    pub host: HostTimes,
    /// The launching thread.
    pub launch: LaunchTimes,
    /// Busy time of the download stream, s.
    pub download_s: f64,
    /// From the first upload's start to the last download's end, s.
    pub span_s: f64,
    /// Bytes of charts uploaded.
    pub bytes_up: u64,
    /// Bytes of film rows downloaded.
    pub bytes_down: u64,
    /// Why the queue was removed before the end of the run.
    pub removed: Option<String>,
}

impl GpuFigures {
    /// Zeros for `device`.
    pub fn new(device: &Device) -> Self {
        Self { index: device.index(), name: device.info.name.clone(), ..Self::default() }
    }
}
