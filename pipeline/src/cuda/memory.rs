//! Memory of a queue, planned for each band: as many tiles a batch and batches in flight as fit, the rest for the PSF stage.
//!
//! A batch in flight holds its tiles' charts (page-locked, and on the device), remapped tiles and contributions. With two batches,
//! copies and kernels overlap; a third lets the workers read for the next batch meanwhile. Downloads go to a pool of
//! page-locked buffers, larger by one batch than the batches in flight, for tiles that wait until it is their turn in the
//! overlap-add. None of this changes any sum.

use super::upload_ring::UPLOAD_RING_BYTES;
use super::{CudaError, Device};
use std::sync::Arc;

/// How often the limits of a queue were halved because an allocation failed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Halvings {
    /// Of device memory.
    pub device: u32,
    /// Of page-locked host memory.
    pub host: u32,
}

/// A device with the memory limits of a queue.
#[derive(Clone, Debug)]
pub struct DeviceQueue {
    /// The device, opened for this queue.
    pub device: Arc<Device>,
    /// Limit on device memory, bytes.
    pub device_bytes: usize,
    /// Limit on page-locked host memory, bytes.
    pub host_bytes: usize,
}

impl DeviceQueue {
    /// For logs.
    pub fn name(&self) -> String {
        format!("GPU {} ({})", self.device.index(), self.device.info.name)
    }

    /// The plan for a band, with the limits halved `halvings` times.
    ///
    /// # Errors
    /// [`CudaError::TooSmall`].
    pub fn plan(&self, needs: &BandNeeds, halvings: Halvings) -> Result<BandMemory, CudaError> {
        let (device_bytes, host_bytes) =
            (self.device_bytes >> halvings.device, self.host_bytes >> halvings.host);
        needs.plan(device_bytes, host_bytes).map_err(|min| CudaError::TooSmall {
            device: self.device.index(),
            name: self.device.info.name.clone(),
            needed_bytes: min.device_bytes as u64,
            usable_bytes: device_bytes as u64,
            host_needed_bytes: min.host_bytes as u64,
            host_usable_bytes: host_bytes as u64,
        })
    }
}

/// Maximum of tiles in a batch: a 426-px tile is 36 thread blocks, an H200 holds several hundred at once.
pub const MAX_TILES: usize = 32;
/// Maximum of batches in flight.
pub const MAX_BATCHES: usize = 3;
/// Minimum of batches in flight.
const MIN_BATCHES: usize = 2;
/// Share of a queue's device memory for batches beyond the minimum; the PSF stage uses the rest.
const BATCHES_SHARE: f64 = 0.5;

/// Memory needs of a band: the maximum over its tiles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BandNeeds {
    /// Chart pixels of a tile.
    pub chart_px: usize,
    /// Remapped pixels of a tile.
    pub remapped_px: usize,
    /// Pixels of a tile's contribution; 0 without a PSF stage.
    pub contribution_px: usize,
    /// Minimum of device memory for the PSF stage, bytes.
    pub min_psf_bytes: usize,
}

/// Memory plan of a band.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BandMemory {
    /// Tiles of a batch.
    pub tiles: usize,
    /// Batches in flight.
    pub batches: usize,
    /// Device memory for the PSF stage, bytes.
    pub psf_bytes: usize,
}

/// Minimum of memory that a band needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MinimumMemory {
    /// Device memory, bytes.
    pub device_bytes: usize,
    /// Page-locked host memory, bytes.
    pub host_bytes: usize,
}

impl BandNeeds {
    /// Device memory of the batches, bytes.
    fn device_bytes(&self, batches: usize, tiles: usize) -> usize {
        4 * batches * tiles * (self.chart_px + self.remapped_px + self.contribution_px)
    }

    /// Host memory of the batches, of the downloaded tiles and of the ring of the PSF stage, bytes.
    fn host_bytes(&self, batches: usize, tiles: usize) -> usize {
        let ring = if self.contribution_px > 0 { UPLOAD_RING_BYTES } else { 0 };
        let outputs = (batches + 1) * self.contribution_px.max(self.remapped_px);
        ring + 4 * tiles * (batches * self.chart_px + outputs)
    }

    /// The plan within limits.
    ///
    /// # Errors
    /// The minimum that is needed.
    pub fn plan(&self, device_bytes: usize, host_bytes: usize) -> Result<BandMemory, MinimumMemory> {
        let fits = |batches, tiles| {
            let batch_bytes = self.device_bytes(batches, tiles);
            let device = match (batches, tiles) {
                (MIN_BATCHES, 1) => batch_bytes + self.min_psf_bytes <= device_bytes,
                _ => batch_bytes.max(self.min_psf_bytes) as f64 <= BATCHES_SHARE * device_bytes as f64,
            };
            device && self.host_bytes(batches, tiles) <= host_bytes
        };
        // A third batch gains more than doubling the tiles, from a few tiles on.
        let orders = [
            (MAX_TILES, MAX_BATCHES),
            (16, 3),
            (8, 3),
            (8, 2),
            (4, 3),
            (4, 2),
            (2, 3),
            (2, 2),
            (1, 3),
            (1, 2),
        ];
        match orders.into_iter().find(|&(tiles, batches)| fits(batches, tiles)) {
            Some((tiles, batches)) => {
                let psf_bytes = device_bytes - self.device_bytes(batches, tiles);
                Ok(BandMemory { tiles, batches, psf_bytes })
            }
            None => Err(MinimumMemory {
                device_bytes: self.device_bytes(MIN_BATCHES, 1) + self.min_psf_bytes,
                host_bytes: self.min_host_bytes(),
            }),
        }
    }

    /// Page-locked host memory beyond which more has no effect, bytes.
    pub fn max_host_bytes(&self) -> usize {
        self.host_bytes(MAX_BATCHES, MAX_TILES)
    }

    /// Minimum of page-locked host memory, bytes.
    pub fn min_host_bytes(&self) -> usize {
        self.host_bytes(MIN_BATCHES, 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NEEDS: BandNeeds = BandNeeds {
        chart_px: 200_000,
        remapped_px: 180_000,
        contribution_px: 220_000,
        min_psf_bytes: 1 << 20,
    };

    #[test]
    fn plans_stay_within_limits_and_grow_with_them() {
        let mut last = 0;
        for mib in [9, 12, 16, 24, 50, 100, 200, 400, 4000] {
            let bytes = mib << 20;
            let plan = NEEDS.plan(bytes, usize::MAX).unwrap();
            assert!(
                NEEDS.device_bytes(plan.batches, plan.tiles) + plan.psf_bytes <= bytes
                    && plan.psf_bytes >= NEEDS.min_psf_bytes
            );
            assert!(plan.tiles >= last && plan.batches >= 2, "{mib} MiB: {plan:?}");
            last = plan.tiles;
            let host = NEEDS.plan(usize::MAX / 4, bytes + UPLOAD_RING_BYTES).unwrap();
            assert!(NEEDS.host_bytes(host.batches, host.tiles) <= bytes + UPLOAD_RING_BYTES);
        }
        assert_eq!(last, MAX_TILES);
    }

    #[test]
    fn reported_minimum_suffices_and_one_byte_less_does_not() {
        let min = NEEDS.plan(1 << 20, 1 << 20).unwrap_err();
        assert!(NEEDS.plan(min.device_bytes, min.host_bytes).is_ok());
        assert!(NEEDS.plan(min.device_bytes - 1, min.host_bytes).is_err());
        assert!(NEEDS.plan(min.device_bytes, min.host_bytes - 1).is_err());
    }
}
