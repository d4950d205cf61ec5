//! What a GPU queue did in a run.

use super::Device;

/// Counts and times of one GPU queue.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GpuFigures {
    /// Index of the device.
    pub index: usize,
    /// Its name.
    pub name: String,
    /// Tiles computed.
    pub tiles: u64,
    /// Batches computed.
    pub batches: u64,
    /// Remapped pixels of those tiles.
    pub pixels: u64,
    /// The upload stream was busy, s.
    pub upload_s: f64,
    /// The compute stream, s.
    pub compute_s: f64,
    /// The download stream, s.
    pub download_s: f64,
    /// From the first upload's start to the last download's end, s.
    pub span_s: f64,
    /// Bytes of charts uploaded.
    pub bytes_up: u64,
    /// Bytes of tiles downloaded.
    pub bytes_down: u64,
    /// Why it was removed before the end.
    pub removed: Option<String>,
}

impl GpuFigures {
    /// Nothing done yet on `device`.
    pub fn of(device: &Device) -> Self {
        Self { index: device.index(), name: device.info.name.clone(), ..Self::default() }
    }
}
