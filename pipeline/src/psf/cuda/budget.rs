//! Device memory of the PSF stage, computed without a device: blocks, images and lists of a round, and the pools of spectra and base
//! kernels.

use super::partition::Partition;
use super::round::{MAX_GROUP_NODES, Round};
use super::tile::PsfTile;
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

    /// 32-bit words of the pool of spectra.
    pub(super) fn spectra_words(&self, partition: &Partition) -> usize {
        self.spectra * partition.spectrum_len()
    }

    /// 32-bit words of the pool of base kernels: what follows begins at a multiple of 256 bytes.
    pub(super) fn base_kernel_words(&self, partition: &Partition) -> usize {
        (self.base_kernels * partition.window * partition.window).next_multiple_of(64)
    }

    pub(super) fn bytes(&self, partition: &Partition) -> usize {
        self.scratch + 4 * (self.spectra_words(partition) + self.base_kernel_words(partition))
    }

    /// Bytes with which all spectra and base kernels, and batches of `tiles` tiles, are in memory.
    pub(super) fn max_bytes(partition: &Partition, grid: &NodeGrid, tile_side: usize, tiles: usize) -> usize {
        let min = Self::min(partition, grid, tile_side);
        let (spectra, base_kernels) =
            (grid.len() * partition.spectrum_len(), grid.len() * partition.window.pow(2));
        // So much that the shares of `within` suffice.
        let pools = (32 * spectra / 3).max(32 * base_kernels + 8 * 256);
        let of_tiles = tile_scratch(partition, grid, tile_side);
        let mean = of_tiles.iter().sum::<usize>() / of_tiles.len().max(1);
        let rest = pools.max(mean * tiles + 4 * (spectra + base_kernels));
        min.bytes(partition) + rest
    }

    /// The minimum plus the rest of `bytes`: up to three eighths for spectra, up to an eighth for base kernels, all else for blocks and
    /// images.
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
        let pools = Self {
            scratch: 0,
            spectra: (min.spectra + rest * 3 / 8 / spectrum.max(1)).min(grid.len()),
            base_kernels: (min.base_kernels + (rest / 8).saturating_sub(256) / base_kernel).min(grid.len()),
        };
        // What the pools do not need is for blocks and images.
        Ok(Self { scratch: bytes - pools.bytes(partition), ..pools })
    }
}

/// Scratch memory of a tile at the axis, where the most nodes meet, and at sampled places farther out, bytes.
fn tile_scratch(partition: &Partition, grid: &NodeGrid, tile_side: usize) -> Vec<usize> {
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
    along.collect()
}

/// Scratch memory of the most demanding tile, bytes: of those sampled, plus a tenth for places in between.
fn max_tile_scratch(partition: &Partition, grid: &NodeGrid, tile_side: usize) -> usize {
    tile_scratch(partition, grid, tile_side).into_iter().max().unwrap_or(0) / 10 * 11
}
