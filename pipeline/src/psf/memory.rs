//! Memory of the PSF stage, bytes.

use super::blocks::{BATCH_BYTES, Blocks};
use super::grid::{CartesianNodes, NodeGrid, PolarNodes, Positions};
use super::kernel::BaseGroup;
use crate::geometry::Rect;
use crate::real;
use std::collections::BTreeSet;
use std::f64::consts::TAU;

/// Radii per node at which its region of weight is sampled.
const RADII: u32 = 8;

/// Scratch of one worker for kernels of `blocks` made from PSFs of `samples` × `samples`: the engine's buffers, once for blocks and
/// once for spectra, and one kernel being computed.
pub fn scratch_bytes(blocks: &Blocks, samples: usize) -> usize {
    if blocks.fft == 0 {
        return 0;
    }
    // Three complex planes, or one of them a batch of copies of a block; radius and azimuth of each pixel of a block.
    let engine = 3 * blocks.spectrum_bytes() + BATCH_BYTES + 8 * blocks.block * blocks.block;
    // Spectra of a batch, which are in use when the cache evicts them: blocks fill at least half of a transform.
    let spectra = 2 * BATCH_BYTES;
    let window = blocks.window;
    // To prepare a PSF: two planes of samples and the film window, f64. To rotate it: samples, samples integrated along one axis and
    // their transpose, the film window and the kernel, f32.
    let kernel = 20 * samples * samples + 8 * samples * window + 16 * window * window;
    2 * engine + spectra + kernel
}

/// `psfs` PSFs of one band, ready for kernels: spline coefficients with margins, and kernels at azimuth 0. Before they are
/// ready, their samples, which are fewer.
pub fn kernels_bytes(blocks: &Blocks, psfs: usize, samples: usize) -> usize {
    4 * psfs * ((samples + 8) * (samples + 8) + blocks.window * blocks.window)
}

/// Coefficients of PSFs between azimuths, of the kernels that one worker computes together: 0 if every height of `grid` has one PSF.
pub fn interpolation_bytes(grid: &NodeGrid, samples: usize) -> usize {
    let depends_on_azimuth = (0..grid.psf_sets()).any(|set| grid.psf_rows(set).len() > 1);
    if depends_on_azimuth { 4 * BaseGroup::MAX_COUNT * (samples + 8) * (samples + 8) } else { 0 }
}

/// Base kernels of all nodes of `grid`, one for each.
pub fn all_kernels_bytes(blocks: &Blocks, grid: &NodeGrid) -> usize {
    4 * grid.len() * blocks.window * blocks.window
}

/// Spectra of the nodes of `grid` that have a weight at a pixel of `rect` or within a block of it, and their base kernels: one for each
/// azimuth of a quadrant where a height has one PSF, else one for each node; the optical axis is at `axis_px` (row, column).
pub fn spectra_bytes(blocks: &Blocks, grid: &NodeGrid, rect: Rect, axis_px: (f64, f64)) -> usize {
    let rect = rect.grown(blocks.block);
    let (nodes, base_kernels) = match grid {
        NodeGrid::Polar(polar) => near_polar_nodes(polar, rect, axis_px),
        NodeGrid::Cartesian(cartesian) => {
            let count = near_cartesian_nodes(cartesian, rect, axis_px);
            (count, count)
        }
    };
    nodes * blocks.spectrum_bytes() + base_kernels * 4 * blocks.window * blocks.window
}

/// Nodes that have a weight in `rect`, and their base kernels.
fn near_polar_nodes(grid: &PolarNodes, rect: Rect, axis_px: (f64, f64)) -> (usize, usize) {
    let (rows, cols) = (rect.y as f64..rect.bottom() as f64, rect.x as f64..rect.right() as f64);
    let heights = grid.heights_px();
    let (mut nodes, mut base_kernels) = (0, 0);
    for (k, &count) in grid.azimuths().iter().enumerate() {
        // A node has a weight between the neighbouring heights.
        let (inner, outer) = (heights[k.saturating_sub(1)], heights[(k + 1).min(heights.len() - 1)]);
        let is_near = |j: &usize| {
            let (sin, cos) = real::sin_cos(TAU * *j as f64 / count as f64);
            (0..=RADII).any(|i| {
                let r = inner + (outer - inner) * f64::from(i) / f64::from(RADII);
                rows.contains(&(axis_px.0 + r * sin)) && cols.contains(&(axis_px.1 + r * cos))
            })
        };
        let near: Vec<usize> = (0..count).filter(is_near).collect();
        let quadrant: BTreeSet<usize> = near.iter().map(|j| j % (count / 4).max(1)).collect();
        nodes += near.len();
        base_kernels += if grid.psf_rows(k).len() == 1 { quadrant.len() } else { near.len() };
    }
    (nodes, base_kernels)
}

/// Nodes that have a weight in `rect`.
fn near_cartesian_nodes(grid: &CartesianNodes, rect: Rect, axis_px: (f64, f64)) -> usize {
    let near = |nodes: &Positions, first: i64, end: i64, axis_px: f64| {
        let (first, end) = (first as f64 - axis_px, end as f64 - axis_px);
        // Those of either end have a weight anywhere beyond it.
        let last = nodes.count() - 1;
        let is_near = |i: &usize| {
            let at_px = nodes.at_px(*i as i64);
            (*i == 0 || at_px - nodes.step_px() < end) && (*i == last || at_px + nodes.step_px() > first)
        };
        (0..=last).filter(is_near).count()
    };
    near(grid.x(), rect.x, rect.right(), axis_px.1) * near(grid.y(), rect.y, rect.bottom(), axis_px.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_near_a_rectangle_are_those_with_a_weight() {
        let blocks = Blocks { window: 5, fft: 64, block: 60, tile: 480 };
        let at: Vec<f64> = (0..9).map(|i| f64::from(i) - 4.0).collect();
        let grid = NodeGrid::cartesian(&at, &at[..5], 0.01);
        let count = |rect| {
            let bytes = spectra_bytes(&blocks, &grid, rect, (400.0, 400.0));
            bytes / (blocks.spectrum_bytes() + 4 * 25)
        };
        // Columns 0..=800 by 100 px, rows 0..=400. 80 px, grown by 60: 320 to 520 meets columns 300 to 600, rows 300 and 400.
        assert_eq!(count(Rect::new(380, 380, 80, 80)), 4 * 2);
        assert_eq!(count(Rect::new(2000, -900, 80, 80)), 1);
        assert_eq!(count(Rect::new(0, 0, 400, 800)), 45);
    }

    #[test]
    fn heights_with_several_psfs_have_a_base_kernel_for_each_node() {
        let blocks = Blocks { window: 5, fft: 64, block: 60, tile: 480 };
        let bytes = |samples: &[usize]| {
            let grid = NodeGrid::polar(&[0.0, 1.0], &[1, 72], samples, 0.01);
            assert_eq!(interpolation_bytes(&grid, 41) > 0, samples[1] > 1);
            spectra_bytes(&blocks, &grid, Rect::new(0, 0, 400, 400), (200.0, 200.0))
        };
        let kernel = 4 * 25;
        assert_eq!(bytes(&[1, 1]), 73 * blocks.spectrum_bytes() + 19 * kernel);
        assert_eq!(bytes(&[1, 8]), 73 * blocks.spectrum_bytes() + 73 * kernel);
    }
}
