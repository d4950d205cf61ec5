//! Memory of a queue, planned once for all bands of a job: as many tiles a batch and batches in flight as fit, the rest for the PSF stage.
//!
//! A batch in flight holds its tiles' charts, page-locked and on the device; remapped tiles and contributions are those of one batch, as the
//! kernels of batches follow one another. With two batches, copies and kernels overlap; a third lets the workers read for the next batch
//! meanwhile. Film rows on the device ([`crate::stages::cuda::film_rows`]) are those of the batches in flight and a tail; their downloads go to page-locked
//! strips of [`STRIP_ROWS`] rows, from which workers copy them to shards. None of this changes any sum.

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
    /// What the bands of the job need.
    pub needs: BandNeeds,
}

impl DeviceQueue {
    /// For logs.
    pub fn name(&self) -> String {
        format!("GPU {} ({})", self.device.index(), self.device.info.name)
    }

    /// The plan for `needs`, with the limits halved `halvings` times.
    ///
    /// # Errors
    /// [`CudaError::TooSmall`].
    pub fn plan(&self, needs: &BandNeeds, halvings: Halvings) -> Result<QueueMemory, CudaError> {
        let min = needs.minimum();
        let device_bytes = halved(self.device_bytes, min.device_bytes, halvings.device);
        let host_bytes = halved(self.host_bytes, min.host_bytes, halvings.host);
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

/// `bytes` halved `times` times, but first to the minimum where less than that would be left; less than the minimum after that.
fn halved(bytes: usize, min: usize, times: u32) -> usize {
    (0..times).fold(bytes, |left, _| if left > min { (left / 2).max(min) } else { left / 2 })
}

/// Maximum of tiles in a batch: a 426-px tile is 36 thread blocks, an H200 runs 132 at once, one on each multiprocessor as
/// registers allow; 128 tiles are 35 times as many.
pub const MAX_TILES: usize = 128;
/// Film rows of a strip, the unit of downloads.
pub const STRIP_ROWS: usize = 64;
/// Maximum of batches in flight.
pub const MAX_BATCHES: usize = 3;
/// Minimum of batches in flight.
const MIN_BATCHES: usize = 2;
/// Share of a queue's device memory for batches beyond the minimum; the PSF stage uses the rest.
const BATCHES_SHARE: f64 = 0.5;

/// Memory needs of a band: the maximum over its tiles; or of several bands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BandNeeds {
    /// Number of tiles, and of tiles in a row.
    pub tiles: usize,
    /// Tiles in a row.
    pub tile_columns: usize,
    /// Side of a tile, px.
    pub tile_rows: usize,
    /// Film rows beyond those of the tiles of a row that their contributions reach.
    pub tail_rows: usize,
    /// Film columns to compute.
    pub film_columns: usize,
    /// Chart pixels of a tile.
    pub chart_px: usize,
    /// Remapped pixels of a tile.
    pub remapped_px: usize,
    /// Pixels of a tile's contribution; 0 without a PSF stage.
    pub contribution_px: usize,
    /// Minimum of device memory for the PSF stage, bytes.
    pub min_psf_bytes: usize,
    /// Device memory of the PSF stage beyond which more has no effect, bytes.
    pub max_psf_bytes: usize,
}

/// Memory plan of a queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QueueMemory {
    /// Tiles of a batch.
    pub tiles: usize,
    /// Tile rows of a batch.
    pub tile_rows: usize,
    /// Batches in flight.
    pub batches: usize,
    /// Film rows on the device.
    pub film_rows: usize,
    /// Strips of film rows in page-locked memory.
    pub strips: usize,
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
    /// The needs of two bands.
    pub fn max(self, other: Self) -> Self {
        Self {
            tiles: self.tiles.max(other.tiles),
            // Fewer tiles in a row are more rows in a batch.
            tile_columns: match (self.tile_columns, other.tile_columns) {
                (0, n) | (n, 0) => n,
                (a, b) => a.min(b),
            },
            tile_rows: self.tile_rows.max(other.tile_rows),
            tail_rows: self.tail_rows.max(other.tail_rows),
            film_columns: self.film_columns.max(other.film_columns),
            chart_px: self.chart_px.max(other.chart_px),
            remapped_px: self.remapped_px.max(other.remapped_px),
            contribution_px: self.contribution_px.max(other.contribution_px),
            min_psf_bytes: self.min_psf_bytes.max(other.min_psf_bytes),
            max_psf_bytes: self.max_psf_bytes.max(other.max_psf_bytes),
        }
    }

    /// Tile rows of a batch of `tiles` tiles at most.
    fn batch_rows(&self, tiles: usize) -> usize {
        (tiles / self.tile_columns.max(1)).max(1)
    }

    /// Film rows on the device: those of the batches, and the tail that later tiles add to.
    fn film_rows(&self, batches: usize, tiles: usize) -> usize {
        batches * self.batch_rows(tiles) * self.tile_rows + self.tail_rows
    }

    /// Strips of the downloads of `batches` batches.
    fn strips(&self, batches: usize, tiles: usize) -> usize {
        batches * ((self.batch_rows(tiles) * self.tile_rows + self.tail_rows).div_ceil(STRIP_ROWS))
    }

    /// Device memory of the batches, bytes.
    fn device_bytes(&self, batches: usize, tiles: usize) -> usize {
        let per_tile = batches * self.chart_px + self.remapped_px + self.contribution_px;
        4 * (tiles * per_tile + self.film_rows(batches, tiles) * self.film_columns)
    }

    /// Host memory of the batches, of the film rows and of the ring of the lists, bytes.
    fn host_bytes(&self, batches: usize, tiles: usize) -> usize {
        let strips = self.strips(batches, tiles) * STRIP_ROWS * self.film_columns;
        UPLOAD_RING_BYTES + 4 * (tiles * batches * self.chart_px + strips)
    }

    /// The plan within limits.
    ///
    /// # Errors
    /// The minimum that is needed.
    pub fn plan(&self, device_bytes: usize, host_bytes: usize) -> Result<QueueMemory, MinimumMemory> {
        let fits = |batches, tiles| {
            let batch_bytes = self.device_bytes(batches, tiles);
            let device = match (batches, tiles) {
                (MIN_BATCHES, 1) => batch_bytes + self.min_psf_bytes <= device_bytes,
                _ => batch_bytes.max(self.min_psf_bytes) as f64 <= BATCHES_SHARE * device_bytes as f64,
            };
            device && self.host_bytes(batches, tiles) <= host_bytes
        };
        // A third batch gains more than doubling the tiles, from a few tiles on.
        let orders = [128, 64, 32, 16].map(|tiles| (tiles, MAX_BATCHES)).into_iter();
        let small = [(8, 3), (8, 2), (4, 3), (4, 2), (2, 3), (2, 2), (1, 3), (1, 2)];
        match orders.chain(small).map(|(t, b)| (t.min(self.tiles.max(1)), b)).find(|&(t, b)| fits(b, t)) {
            Some((tiles, batches)) => Ok(QueueMemory {
                tiles,
                tile_rows: self.batch_rows(tiles),
                batches,
                film_rows: self.film_rows(batches, tiles),
                strips: self.strips(batches, tiles),
                psf_bytes: (device_bytes - self.device_bytes(batches, tiles))
                    .min(self.max_psf_bytes.max(self.min_psf_bytes)),
            }),
            None => Err(self.minimum()),
        }
    }

    /// The minimum for one tile at a time.
    fn minimum(&self) -> MinimumMemory {
        let device_bytes = self.device_bytes(MIN_BATCHES, 1) + self.min_psf_bytes;
        MinimumMemory { device_bytes, host_bytes: self.min_host_bytes() }
    }

    /// Page-locked host memory beyond which more has no effect, bytes.
    pub fn max_host_bytes(&self) -> usize {
        self.host_bytes(MAX_BATCHES, MAX_TILES.min(self.tiles.max(1)))
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
        tiles: 400,
        tile_columns: 20,
        tile_rows: 426,
        tail_rows: 50,
        film_columns: 8500,
        chart_px: 200_000,
        remapped_px: 180_000,
        contribution_px: 220_000,
        min_psf_bytes: 1 << 20,
        max_psf_bytes: 1 << 40,
    };

    #[test]
    fn plans_stay_within_limits_and_grow_with_them() {
        let (mut last, smallest) = (0, NEEDS.plan(1, 1).unwrap_err());
        for mib in [0, 4, 8, 16, 40, 100, 200, 400, 4000] {
            let bytes = smallest.device_bytes + (mib << 20);
            let plan = NEEDS.plan(bytes, usize::MAX).unwrap();
            assert!(
                NEEDS.device_bytes(plan.batches, plan.tiles) + plan.psf_bytes <= bytes
                    && plan.psf_bytes >= NEEDS.min_psf_bytes
            );
            assert!(plan.tiles >= last && plan.batches >= 2, "{mib} MiB: {plan:?}");
            last = plan.tiles;
            let bytes = smallest.host_bytes + (mib << 20);
            let host = NEEDS.plan(usize::MAX / 4, bytes).unwrap();
            assert!(NEEDS.host_bytes(host.batches, host.tiles) <= bytes);
        }
        assert_eq!(last, MAX_TILES);
        let few = BandNeeds { tiles: 3, max_psf_bytes: 2 << 20, ..NEEDS };
        let plan = few.plan(usize::MAX / 4, usize::MAX).unwrap();
        assert_eq!((plan.tiles, plan.psf_bytes), (3, 2 << 20));
    }

    #[test]
    fn a_batch_of_several_rows_has_their_film_rows() {
        let plan = NEEDS.plan(usize::MAX / 4, usize::MAX).unwrap();
        assert_eq!((plan.tiles, plan.batches, plan.tile_rows), (128, 3, 6));
        assert_eq!((plan.film_rows, plan.strips), (3 * 6 * 426 + 50, 3 * (6usize * 426 + 50).div_ceil(64)));
    }

    #[test]
    fn halving_stops_once_at_the_minimum() {
        assert_eq!([0, 1, 2, 3].map(|times| halved(100, 40, times)), [100, 50, 40, 20]);
        assert_eq!([1, 2].map(|times| halved(40, 40, times)), [20, 10]);
    }

    #[test]
    fn reported_minimum_suffices_and_one_byte_less_does_not() {
        let min = NEEDS.plan(1 << 20, 1 << 20).unwrap_err();
        assert!(NEEDS.plan(min.device_bytes, min.host_bytes).is_ok());
        assert!(NEEDS.plan(min.device_bytes - 1, min.host_bytes).is_err());
        assert!(NEEDS.plan(min.device_bytes, min.host_bytes - 1).is_err());
    }
}
