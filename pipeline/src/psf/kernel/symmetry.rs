//! Symmetry of the kernels of one height: a base kernel expands to four kernels, or eight, by exact permutations of its pixels.
//!
//! kernel(j + J/4) is kernel(j) rotated by 90°, bit for bit. Where the PSFs are their own mirror images about the meridian and J
//! is a multiple of 8, kernel(J/4 − j) is kernel(j) with rows and columns exchanged.
//!
//! Where PSFs depend on the azimuth no kernel follows from that of another node: the base kernel is that of the node, rotated within the first
//! quadrant, and the quarter turns complete its rotation. Kernels of a Cartesian grid are not rotated.

use super::lane_sum;
use crate::psf::grid::{Node, NodeGrid};

/// Share of the light by which a PSF may differ from its mirror image and still count as symmetric. A film differs by as much,
/// relative to its peak, and the tolerance of films is 2e-6.
pub(super) const MIRROR_TOLERANCE: f64 = 5e-7;

/// How the kernel of a node follows from a base kernel: exchange rows and columns first, then rotate by quarter turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KernelSymmetry {
    /// Node of the base kernel. Of a height with one PSF its azimuth index lies in the first quadrant (or octant); else it is the node itself.
    pub base: Node,
    /// Whether rows and columns are exchanged.
    pub transposed: bool,
    /// Rotation in units of 90°, +x to +y.
    pub quarter_turns: usize,
}

impl KernelSymmetry {
    /// The symmetry of `node`; `mirrored` if the PSFs are symmetric about the meridian.
    pub(super) fn new(grid: &NodeGrid, node: Node, mirrored: bool) -> Self {
        let Some(per_quadrant) = azimuths_per_quadrant(grid, node) else {
            return Self { base: node, transposed: false, quarter_turns: 0 };
        };
        let (quarter_turns, j) = (node.j / per_quadrant, node.j % per_quadrant);
        if !grid.is_symmetric_at(node) {
            return Self { base: node, transposed: false, quarter_turns };
        }
        let count = 4 * per_quadrant;
        // The kernel at azimuth π/2 − θ is the mirror image of the kernel at θ.
        let transposed = mirrored && count.is_multiple_of(8) && j > count / 8;
        let j = if transposed { count / 4 - j } else { j };
        Self { base: Node { k: node.k, j }, transposed, quarter_turns }
    }

    /// Permutes the `n` × `n` pixels of the base kernel into `out`: exact.
    pub(in crate::psf) fn expand(&self, base: &[f32], n: usize, out: &mut [f32]) {
        let last = n - 1;
        for (y, to) in out.chunks_exact_mut(n).enumerate() {
            for (x, to) in to.iter_mut().enumerate() {
                let (sy, sx) = match self.quarter_turns {
                    0 => (y, x),
                    1 => (last - x, y),
                    2 => (last - y, last - x),
                    _ => (x, last - y),
                };
                *to = base[if self.transposed { sx * n + sy } else { sy * n + sx }];
            }
        }
    }
}

/// Angle in rad by which the PSF of the base kernel `base` is rotated, in the first quadrant; at 0 the kernel is the PSF itself.
pub(super) fn base_rotation_rad(grid: &NodeGrid, base: Node) -> f64 {
    let azimuth_rad = |per_quadrant| grid.azimuth_rad(Node { j: base.j % per_quadrant, ..base });
    azimuths_per_quadrant(grid, base).map_or(0.0, azimuth_rad)
}

/// Azimuths of the height of `node` in a quadrant; `None` for a node that has no azimuth.
fn azimuths_per_quadrant(grid: &NodeGrid, node: Node) -> Option<usize> {
    let count = grid.azimuths().get(node.k).copied().filter(|count| *count > 1)?;
    assert!(count.is_multiple_of(4), "LensBand::check admits multiples of 4 only");
    Some(count / 4)
}

/// Σ |difference| of an n × n PSF and its image mirrored about the meridian.
pub(super) fn asymmetry(psf: &[f32], n: usize) -> f64 {
    // Each pair of rows counts twice.
    let rows = psf.chunks_exact(n).zip(psf.chunks_exact(n).rev()).take(n / 2);
    rows.map(|(a, b)| 2.0 * lane_sum(a, b, |a, b| f64::from((a - b).abs()))).sum()
}
