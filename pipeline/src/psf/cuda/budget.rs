//! How much device memory the stage takes, told without a device: blocks, their images and lists for the tiles of a round, and the
//! two pools.

use super::PsfTile;
use super::cut::Cut;
use super::work::{PIECE, Work};
use crate::geometry::{Frame, Rect, Size};
use crate::psf::grid::NodeGrid;

/// What the stage may hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Budget {
    /// Bytes of blocks, images and lists.
    pub(super) scratch: usize,
    /// Spectra of nodes.
    pub(super) spectra: usize,
    /// Seeds of kernels.
    pub(super) seeds: usize,
}

impl Budget {
    /// What one tile of `tile_side` cannot do without, wherever it lies.
    pub(super) fn least(cut: &Cut, grid: &NodeGrid, tile_side: usize) -> Self {
        Self { scratch: scratch_of_a_tile(cut, grid, tile_side), spectra: PIECE.min(grid.len()), seeds: 1 }
    }

    pub(super) fn bytes(&self, cut: &Cut) -> usize {
        self.scratch + self.spectra * cut.spectrum_len() * 4 + self.seeds * cut.window * cut.window * 4
    }

    /// The least, and of what `bytes` leaves half for blocks and images, up to three eighths for spectra, an eighth for seeds.
    pub(super) fn within(bytes: usize, cut: &Cut, grid: &NodeGrid, tile_side: usize) -> Result<Self, Self> {
        let least = Self::least(cut, grid, tile_side);
        let Some(more) = bytes.checked_sub(least.bytes(cut)) else { return Err(least) };
        let (spectrum, seed) = (cut.spectrum_len() * 4, cut.window * cut.window * 4);
        Ok(Self {
            scratch: least.scratch + more / 2,
            spectra: (least.spectra + more * 3 / 8 / spectrum.max(1)).min(grid.len()),
            seeds: (least.seeds + more / 8 / seed).min(grid.len()),
        })
    }
}

/// Scratch of the most demanding tile: at the axis, where the most nodes meet, or farther out. A tenth more for tiles that lie
/// otherwise than those looked at.
fn scratch_of_a_tile(cut: &Cut, grid: &NodeGrid, tile_side: usize) -> usize {
    let heights = grid.heights_px();
    let film = Size::new(tile_side, tile_side);
    let frame = Frame { axis_px: (0.0, 0.0), ..Frame::centred(film, film, 1.0) };
    let bytes = |y: i64, x: i64| {
        let rect = Rect::new(y, x, tile_side, tile_side);
        let tile = PsfTile { rect, remapped_offset: 0, light_offset: 0, light_stride: tile_side };
        let mut work = Work::default();
        work.add(&tile, &frame, grid, cut);
        work.bytes(cut)
    };
    let half = tile_side as i64 / 2;
    let steps = (heights[heights.len() - 1] / tile_side as f64) as i64 + 1;
    let along = (0..=steps).flat_map(|i| {
        let out = i * tile_side as i64;
        [bytes(-half, out - half), bytes(-half, out), bytes(out, out), bytes(out - half, out - half)]
    });
    along.max().unwrap_or(0) / 10 * 11
}
