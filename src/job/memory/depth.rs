//! Memory of bands with a depth stage, and of the spectra of a film rectangle.

use super::MemoryInputs;
use pipeline::band::BandPlan;
use pipeline::depth::plan::{DepthPlan, NodePlan};
use pipeline::geometry::Rect;
use pipeline::psf::memory as psf;

/// Chart pixels around those under a tile that interpolation reads, a side.
const TAPS: usize = 8;

impl MemoryInputs<'_> {
    /// Scratch of one worker for the depth stage `depth` of `plan`.
    pub(super) fn depth_scratch(&self, plan: &BandPlan, depth: &DepthPlan) -> usize {
        let side = plan.tiling.tile() + 2 * depth.reach + TAPS;
        let side = side as f64 * self.stretch.range.1.max(1.0);
        let pixels = side * side / (self.frame.scale.0.min(1.0) * self.frame.scale.1.min(1.0));
        depth.scratch_bytes(&plan.tiling, self.surfaces, pixels as usize)
    }

    /// Spectra of all nodes of `plan` that the film rectangle `rect` uses.
    pub(super) fn spectra_of(&self, plan: &BandPlan, rect: Rect) -> usize {
        let axis_px = self.frame.axis_px;
        if let Some(depth) = &plan.depth {
            let rect = rect.grown(depth.margin());
            let of_node = |n: &NodePlan| psf::spectra_bytes(&n.blocks, &n.grid, rect, axis_px);
            return depth.used().map(of_node).sum();
        }
        let grid = plan.blocks.zip(plan.grid.as_ref());
        grid.map_or(0, |(blocks, grid)| psf::spectra_bytes(&blocks, grid, rect, axis_px))
    }
}
