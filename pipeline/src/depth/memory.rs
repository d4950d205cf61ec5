//! Memory of the depth stage, bytes.

use super::pieces::{cell, edges};
use super::plan::{DepthPlan, NodePlan};
use crate::psf::memory;
use crate::tiling::Tiling;

/// Planes of a tile beside those of its slabs: what is uncovered, shares behind, opened; the source and result of a convolution.
const OTHER_PLANES: usize = 6;
/// Tile-sized planes: light, K, M, T, the film, e of two nodes, the rest of the pupil, spare.
const TILE_PLANES: usize = 12;
/// Of a pixel that surfaces are extrapolated from: its slabs, edges, what is known there, the present level of the extrapolation and a plane of it.
const BYTES_PER_SOURCE_PIXEL: usize = 33;
/// Of a pixel of a tile with its margin: whether an edge is near, what lies behind it, what is hidden there, sums of the extrapolation.
const BYTES_PER_HIDDEN_PIXEL: usize = 25;
/// Slab, position, share and chart of a chart pixel, per sheet; open share and what is read, of all.
const BYTES_PER_SHEET_PIXEL: usize = 14;

impl DepthPlan {
    /// Scratch of one worker for tiles of `tiling` and `sheets` sheets of which `chart_px` pixels lie under a tile with its margin.
    pub fn scratch_bytes(&self, tiling: &Tiling, sheets: usize, chart_px: usize) -> usize {
        let slabs = self.max_slabs;
        let tile = tiling.tile();
        let read = (tile + 2 * self.reach).pow(2);
        let grown = (tile + 2 * self.margin()).pow(2);
        let psf = self.used().map(|n| memory::scratch_bytes(&n.blocks, n.samples)).max().unwrap_or(0);
        // Of the slabs their rows; one slab at a time is computed on all rows. Shares of slabs are kept while others near them follow.
        let of_slabs = 12 * (tile + 2 * self.reach) * self.max_slab_rows + 12 * read;
        let tile_planes = TILE_PLANES + slabs.min(self.max_near + 1);
        // The correction of surfaces out of focus keeps what it needs of all slabs.
        let corrected = 4 * tile * tile * slabs
            + cell::bytes(self.max_near, self.margin())
            + edges::BYTES_PER_PIXEL * grown;
        let planes = 4 * grown * OTHER_PLANES + of_slabs + 4 * tile * tile * tile_planes + corrected;
        let hidden = match self.reach > self.margin() {
            true => BYTES_PER_SOURCE_PIXEL * read + grown * (BYTES_PER_HIDDEN_PIXEL + 16 * slabs),
            false => 0,
        };
        // Coordinates of the map, as in the remap stage.
        let map = 44 * read;
        planes + hidden + map + psf + chart_px.saturating_mul(BYTES_PER_SHEET_PIXEL * sheets + 12)
    }

    /// PSFs of all nodes up to the first height from `radius_px` on, ready for kernels.
    pub fn kernels_bytes(&self, radius_px: f64) -> usize {
        let heights = |n: &NodePlan| n.grid.heights_px().partition_point(|h| *h < radius_px) + 1;
        let of_node = |n: &NodePlan| memory::kernels_bytes(&n.blocks, heights(n).min(n.heights), n.samples);
        self.used().map(of_node).sum()
    }

    /// The largest PSF, ready for kernels.
    pub fn max_psf_bytes(&self) -> usize {
        self.used().map(|n| memory::kernels_bytes(&n.blocks, 1, n.samples)).max().unwrap_or(0)
    }

    /// Samples of the largest PSF.
    pub fn max_samples(&self) -> usize {
        self.used().map(|n| n.samples * n.samples).max().unwrap_or(0)
    }
}
