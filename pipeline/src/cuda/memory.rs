//! Memory of a queue, planned for each band: batches and slots as large as there is room for, the rest for the PSF stage.
//!
//! A *slot* is what one batch needs on its way: its tiles' charts (page-locked, and on the device), remap and light. Two slots let
//! copies and kernels overlap; a third lets the workers read for the next batch meanwhile. Light comes down into a pool of
//! page-locked buffers, a batch's worth more than the slots hold, for tiles that wait for their turn to be added. None of this has
//! an influence on any sum.

use super::{CudaError, Device};
use std::sync::Arc;

/// A device and a bound on what a queue may take of it.
#[derive(Clone, Debug)]
pub struct DeviceQueue {
    /// The device, opened for this queue.
    pub device: Arc<Device>,
    /// Of its memory, for this queue.
    pub device_bytes: usize,
    /// Of page-locked host memory.
    pub host_bytes: usize,
}

impl DeviceQueue {
    /// For logs.
    pub fn name(&self) -> String {
        format!("GPU {} ({})", self.device.index(), self.device.info.name)
    }

    /// The plan for a band, the device's part halved `halved` times.
    ///
    /// # Errors
    /// [`CudaError::TooSmall`].
    pub fn plan(&self, needs: &BandNeeds, halved: u32) -> Result<BandMemory, CudaError> {
        needs.plan(self.device_bytes >> halved, self.host_bytes).map_err(|least| CudaError::TooSmall {
            device: self.device.index(),
            name: self.device.info.name.clone(),
            needed_bytes: least.device_bytes as u64,
            usable_bytes: (self.device_bytes >> halved) as u64,
            host_needed_bytes: least.host_bytes as u64,
            host_usable_bytes: self.host_bytes as u64,
        })
    }
}

/// Tiles of a batch where there is room: a 426-px tile is 36 thread blocks, an H200 holds several hundred at once.
pub const MAX_TILES: usize = 32;
/// Slots where there is room, and the least.
const SLOTS: [usize; 2] = [3, 2];
/// Share of a queue's device memory that slots may take, unless they are the least; the PSF stage makes use of the rest.
const SLOTS_SHARE: f64 = 0.5;

/// What the largest tile of a band needs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BandNeeds {
    /// Pixels of chart.
    pub chart_px: usize,
    /// Pixels of remap.
    pub remapped_px: usize,
    /// Pixels of light; 0 without a PSF stage, whose light is the remap.
    pub light_px: usize,
    /// Device memory without which the PSF stage cannot work, bytes.
    pub least_psf: usize,
}

/// How a band is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BandMemory {
    /// Tiles at once.
    pub tiles: usize,
    /// Batches on their way.
    pub slots: usize,
    /// For the PSF stage, bytes.
    pub psf_bytes: usize,
}

/// What even the least takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooSmall {
    /// Device memory that is needed, bytes.
    pub device_bytes: usize,
    /// Page-locked host memory that is needed, bytes.
    pub host_bytes: usize,
}

impl BandNeeds {
    /// Device memory of slots.
    fn device_bytes(&self, slots: usize, tiles: usize) -> usize {
        4 * slots * tiles * (self.chart_px + self.remapped_px + self.light_px)
    }

    /// Host memory of slots and of the light that waits.
    fn host_bytes(&self, slots: usize, tiles: usize) -> usize {
        4 * tiles * (slots * self.chart_px + (slots + 1) * self.light_px.max(self.remapped_px))
    }

    /// The plan within bounds.
    ///
    /// # Errors
    /// What the least needs.
    pub fn plan(&self, device_bytes: usize, host_bytes: usize) -> Result<BandMemory, TooSmall> {
        let fits = |slots, tiles| {
            let slots_bytes = self.device_bytes(slots, tiles);
            let device = match (slots, tiles) {
                (2, 1) => slots_bytes + self.least_psf <= device_bytes,
                _ => slots_bytes.max(self.least_psf) as f64 <= SLOTS_SHARE * device_bytes as f64,
            };
            device && self.host_bytes(slots, tiles) <= host_bytes
        };
        // A third slot is worth more than half the tiles once there are some.
        let orders =
            [(MAX_TILES, SLOTS[0]), (16, 3), (8, 3), (8, 2), (4, 3), (4, 2), (2, 3), (2, 2), (1, 3), (1, 2)];
        match orders.into_iter().find(|&(tiles, slots)| fits(slots, tiles)) {
            Some((tiles, slots)) => {
                Ok(BandMemory { tiles, slots, psf_bytes: device_bytes - self.device_bytes(slots, tiles) })
            }
            None => Err(TooSmall {
                device_bytes: self.device_bytes(2, 1) + self.least_psf,
                host_bytes: self.host_bytes(2, 1),
            }),
        }
    }

    /// Page-locked host memory that is of use.
    pub fn useful_host_bytes(&self) -> usize {
        self.host_bytes(SLOTS[0], MAX_TILES)
    }

    /// The least of it.
    pub fn least_host_bytes(&self) -> usize {
        self.host_bytes(2, 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NEEDS: BandNeeds =
        BandNeeds { chart_px: 200_000, remapped_px: 180_000, light_px: 220_000, least_psf: 1 << 20 };

    #[test]
    fn plans_stay_within_bounds_and_grow_with_them() {
        let mut last = 0;
        for mib in [9, 12, 16, 24, 50, 100, 200, 400, 4000] {
            let bytes = mib << 20;
            let plan = NEEDS.plan(bytes, usize::MAX).unwrap();
            assert!(
                NEEDS.device_bytes(plan.slots, plan.tiles) + plan.psf_bytes <= bytes
                    && plan.psf_bytes >= NEEDS.least_psf
            );
            assert!(plan.tiles >= last && plan.slots >= 2, "{mib} MiB: {plan:?}");
            last = plan.tiles;
            let host = NEEDS.plan(usize::MAX / 4, bytes).unwrap();
            assert!(NEEDS.host_bytes(host.slots, host.tiles) <= bytes);
        }
        assert_eq!(last, MAX_TILES);
    }

    #[test]
    fn what_is_missing_is_enough() {
        let least = NEEDS.plan(1 << 20, 1 << 20).unwrap_err();
        assert!(NEEDS.plan(least.device_bytes, least.host_bytes).is_ok());
        assert!(NEEDS.plan(least.device_bytes - 1, least.host_bytes).is_err());
        assert!(NEEDS.plan(least.device_bytes, least.host_bytes - 1).is_err());
    }
}
