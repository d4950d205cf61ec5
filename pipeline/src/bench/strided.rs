//! The algorithm of the published system, as a baseline: strided multiply-accumulate.
//!
//! Every pixel's PSF is made from the four nodes around it and stamped on the film, n² taps a pixel:
//!     film[y + dy, x + dx] += remapped[y, x] · Σ_nodes w_node(y, x) · P_node[dy, dx]
//! Stamps of pixels n apart do not overlap, so all pixels of one phase (y mod n, x mod n) could be stamped at once by
//! thousands of GPU threads without a lock: n² phases. Here one thread goes through the phases with four fused
//! multiply-adds a tap, kernels of its nodes in the cache. The same sum as [`crate::psf`], in the order of the source:
//! "Lens Simulation for High Resolution and Multispectral Image using Distributed Multi-GPU Computing System".
#![allow(unsafe_code, reason = "instructions that the build does not assume")]

use crate::geometry::{Frame, Rect};
use crate::psf::grid::{Node, NodeGrid};
use crate::psf::kernel::{KernelScratch, NodeKernels};
use crate::real;
use crate::simd::{Isa, Simd};
use std::collections::HashMap;

/// The kernels that a tile needs, all made before.
pub struct Strided<'a> {
    frame: &'a Frame,
    grid: &'a NodeGrid,
    window: usize,
    kernels: HashMap<usize, Vec<f32>>,
}

impl<'a> Strided<'a> {
    /// For the film rectangle `tile`.
    pub fn new(frame: &'a Frame, grid: &'a NodeGrid, kernels: &NodeKernels, tile: Rect) -> Self {
        let window = kernels.size();
        let mut made = HashMap::new();
        let mut scratch = KernelScratch::default();
        for (y, x) in places(tile) {
            for (node, _) in nodes(frame, grid, y, x) {
                made.entry(grid.id(node)).or_insert_with(|| {
                    let mut kernel = vec![0.0; window * window];
                    kernels.kernel(grid, node, &mut scratch, &mut kernel);
                    kernel
                });
            }
        }
        Self { frame, grid, window, kernels: made }
    }

    /// Adds the light of `remapped` (row-major, on `tile`) to `film`, which is `tile` grown by half the window.
    pub fn scatter(&self, tile: Rect, remapped: &[f32], film: &mut [f32], simd: Simd) {
        match simd.isa() {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => {
                #[target_feature(enable = "avx512f")]
                fn go(s: &Strided<'_>, tile: Rect, remapped: &[f32], film: &mut [f32]) {
                    s.phases(tile, remapped, film, f32::mul_add);
                }
                // SAFETY: a choice of AVX-512F is only made where the processor has it.
                unsafe { go(self, tile, remapped, film) }
            }
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => {
                #[target_feature(enable = "avx2,fma")]
                fn go(s: &Strided<'_>, tile: Rect, remapped: &[f32], film: &mut [f32]) {
                    s.phases(tile, remapped, film, f32::mul_add);
                }
                // SAFETY: a choice of AVX2 with FMA is only made where the processor has both.
                unsafe { go(self, tile, remapped, film) }
            }
            _ => self.phases(tile, remapped, film, |a, b, c| a * b + c),
        }
    }

    #[inline(always)]
    fn phases(
        &self,
        tile: Rect,
        remapped: &[f32],
        film: &mut [f32],
        fma: impl Fn(f32, f32, f32) -> f32 + Copy,
    ) {
        let n = self.window;
        let stride = tile.width + n - 1;
        for (py, px) in (0..n * n).map(|p| (p / n, p % n)) {
            for y in (py..tile.height).step_by(n) {
                for x in (px..tile.width).step_by(n) {
                    let value = remapped[y * tile.width + x];
                    let around = nodes(self.frame, self.grid, tile.y + y as i64, tile.x + x as i64);
                    let of =
                        |(node, w): (Node, f64)| (&self.kernels[&self.grid.id(node)][..], w as f32 * value);
                    let [a, b, c, d] = around.map(of);
                    for row in 0..n {
                        let line = row * n..(row + 1) * n;
                        let to = &mut film[(y + row) * stride + x..][..n];
                        let taps = (a.0[line.clone()].iter().zip(&b.0[line.clone()]))
                            .zip(c.0[line.clone()].iter().zip(&d.0[line]));
                        for (to, ((ka, kb), (kc, kd))) in to.iter_mut().zip(taps) {
                            let sum = fma(*kb, b.1, fma(*ka, a.1, *to));
                            *to = fma(*kd, d.1, fma(*kc, c.1, sum));
                        }
                    }
                }
            }
        }
    }
}

fn places(tile: Rect) -> impl Iterator<Item = (i64, i64)> {
    (tile.y..tile.bottom()).flat_map(move |y| (tile.x..tile.right()).map(move |x| (y, x)))
}

/// The four nodes around the film pixel (y, x) and their shares, which sum to 1. A height of one azimuth has it twice.
fn nodes(frame: &Frame, grid: &NodeGrid, y: i64, x: i64) -> [(Node, f64); 4] {
    let (dy, dx) = (y as f64 - frame.axis_px.0, x as f64 - frame.axis_px.1);
    let (r, turn) =
        (real::hypot(dy, dx), real::atan2(dy, dx).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU);
    let heights = grid.heights_px();
    let outer = heights.partition_point(|h| *h <= r).clamp(1, heights.len() - 1);
    let share = ((r - heights[outer - 1]) / (heights[outer] - heights[outer - 1])).clamp(0.0, 1.0);
    let along = |k: usize, w: f64| {
        let count = grid.azimuths()[k];
        let at = turn * count as f64;
        let j = (at as usize).min(count - 1);
        let t = at - j as f64;
        [(Node { k, j }, w * (1.0 - t)), (Node { k, j: (j + 1) % count }, w * t)]
    };
    let ([a, b], [c, d]) = (along(outer - 1, 1.0 - share), along(outer, share));
    [a, b, c, d]
}
