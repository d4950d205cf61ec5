//! Memory of the PSF stage, bytes.

use super::blocks::Blocks;
use super::grid::NodeGrid;
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
    // Three complex planes; radius and azimuth of each pixel of a block.
    let engine = 3 * blocks.spectrum_bytes() + 8 * blocks.block * blocks.block;
    let window = blocks.window;
    // To prepare a PSF: two planes of samples and the film window, f64. To rotate it: samples, samples integrated along one axis and
    // their transpose, the film window and the kernel, f32.
    let kernel = 20 * samples * samples + 8 * samples * window + 16 * window * window;
    2 * engine + kernel
}

/// PSFs of one band at `heights` field heights, ready for kernels: spline coefficients with margins, and kernels at azimuth 0. Before they are
/// ready, their samples, which are fewer.
pub fn kernels_bytes(blocks: &Blocks, heights: usize, samples: usize) -> usize {
    4 * heights * ((samples + 8) * (samples + 8) + blocks.window * blocks.window)
}

/// Spectra of the nodes of `grid` that have a weight at a pixel of `rect` or within a block of it, and their base kernels, one for each
/// azimuth of a quadrant; the optical axis is at `axis_px` (row, column).
pub fn spectra_bytes(blocks: &Blocks, grid: &NodeGrid, rect: Rect, axis_px: (f64, f64)) -> usize {
    let rect = rect.grown(blocks.block);
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
        base_kernels += quadrant.len();
    }
    nodes * blocks.spectrum_bytes() + base_kernels * 4 * blocks.window * blocks.window
}
