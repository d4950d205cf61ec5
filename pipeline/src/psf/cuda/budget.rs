//! Device memory of the PSF stage, computed without a device: blocks, images and lists of a round, and the pools of spectra and base
//! kernels.

use super::PsfTile;
use super::partition::Partition;
use super::round::{MAX_GROUP_NODES, Round};
use crate::geometry::{Frame, Rect, Size};
use crate::psf::grid::NodeGrid;

/// Limits of the stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Budget {
    /// Bytes of blocks, images and lists.
    pub(super) scratch: usize,
    /// Spectra of nodes in their pool.
    pub(super) spectra: usize,
    /// Base kernels in their pool.
    pub(super) base_kernels: usize,
}

impl Budget {
    /// Minimum for one tile of `tile_side`, anywhere on the film.
    pub(super) fn min(partition: &Partition, grid: &NodeGrid, tile_side: usize) -> Self {
        let spectra = MAX_GROUP_NODES.min(grid.len());
        Self { scratch: max_tile_scratch(partition, grid, tile_side), spectra, base_kernels: 1 }
    }

    pub(super) fn bytes(&self, partition: &Partition) -> usize {
        let base_kernel_bytes = partition.window * partition.window * 4;
        self.scratch + self.spectra * partition.spectrum_len() * 4 + self.base_kernels * base_kernel_bytes
    }

    /// The minimum plus the rest of `bytes`: a half for blocks and images, up to three eighths for spectra, up to an eighth for base
    /// kernels.
    ///
    /// # Errors
    /// The minimum, if `bytes` is less.
    pub(super) fn within(
        bytes: usize,
        partition: &Partition,
        grid: &NodeGrid,
        tile_side: usize,
    ) -> Result<Self, Self> {
        let min = Self::min(partition, grid, tile_side);
        let Some(rest) = bytes.checked_sub(min.bytes(partition)) else { return Err(min) };
        let (spectrum, base_kernel) = (partition.spectrum_len() * 4, partition.window * partition.window * 4);
        Ok(Self {
            scratch: min.scratch + rest / 2,
            spectra: (min.spectra + rest * 3 / 8 / spectrum.max(1)).min(grid.len()),
            base_kernels: (min.base_kernels + rest / 8 / base_kernel).min(grid.len()),
        })
    }
}

/// Scratch memory of the most demanding tile, bytes: at the axis, where the most nodes meet, or at one of the sampled places
/// farther out; plus a tenth for places in between.
fn max_tile_scratch(partition: &Partition, grid: &NodeGrid, tile_side: usize) -> usize {
    let heights = grid.heights_px();
    let film = Size::new(tile_side, tile_side);
    let frame = Frame { axis_px: (0.0, 0.0), ..Frame::centred(film, film, 1.0) };
    let bytes = |y: i64, x: i64| {
        let rect = Rect::new(y, x, tile_side, tile_side);
        let tile =
            PsfTile { rect, remapped_offset: 0, contribution_offset: 0, contribution_stride: tile_side };
        let mut round = Round::default();
        round.add(&tile, &frame, grid, partition);
        round.bytes(partition)
    };
    let half = tile_side as i64 / 2;
    let steps = (heights[heights.len() - 1] / tile_side as f64) as i64 + 1;
    let along = (0..=steps).flat_map(|i| {
        let out = i * tile_side as i64;
        [bytes(-half, out - half), bytes(-half, out), bytes(out, out), bytes(out - half, out - half)]
    });
    along.max().unwrap_or(0) / 10 * 11
}
