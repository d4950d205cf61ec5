//! Counts and times of a GPU queue.

use super::Device;
use super::kernel_timer::HostTimes;

/// Waiting of the thread that launches batches, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LaunchWaits {
    /// For charts to be read.
    pub chart_s: f64,
    /// For page-locked buffers of contributions: for the overlap-add.
    pub output_s: f64,
    /// For a batch on the device to end.
    pub batch_s: f64,
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
    /// Busy time of the upload stream, s.
    pub upload_s: f64,
    /// Time of the kernels, s.
    pub compute_s: f64,
    /// Work of the launching thread.
    pub host: HostTimes,
    /// Waiting of the launching thread.
    pub waits: LaunchWaits,
    /// Busy time of the download stream, s.
    pub download_s: f64,
    /// From the first upload's start to the last download's end, s.
    pub span_s: f64,
    /// Bytes of charts uploaded.
    pub bytes_up: u64,
    /// Bytes of tiles downloaded.
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
