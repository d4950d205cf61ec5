//! The algorithm of the published system, as a baseline: strided multiply-accumulate.
//!
//! Every pixel's PSF is interpolated from the four nodes around it and added to the film, n² taps per pixel:
//! ```text
//! film[y + dy, x + dx] += remapped[y, x] · Σ_nodes w_node(y, x) · P_node[dy, dx]
//! ```
//! PSFs of pixels n apart do not overlap, so all pixels of one phase (y mod n, x mod n) can be added in parallel without locks: n² phases.
//! Here one thread computes all phases with four fused multiply-adds per tap, kernels in the cache. The sum is that of [`crate::psf`], in
//! the order of the source:
//! "Lens Simulation for High Resolution and Multispectral Image using Distributed Multi-GPU Computing System".

use crate::geometry::{Frame, Rect};
use crate::psf::grid::{Node, NodeGrid};
use crate::psf::kernel::{KernelScratch, NodeKernels};
use crate::real;
#[cfg(target_arch = "x86_64")]
use crate::simd::lanes::{Dispatch, Lanes, SimdOp};
#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512};
use crate::simd::{Isa, Simd};
use std::collections::HashMap;

/// The kernels of a tile, computed in advance.
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
        let mut kernel_of = HashMap::new();
        let mut scratch = KernelScratch::default();
        for (y, x) in places(tile) {
            for (node, _) in nodes(frame, grid, y, x) {
                kernel_of.entry(grid.id(node)).or_insert_with(|| {
                    let mut kernel = vec![0.0; window * window];
                    kernels.kernel(grid, node, &mut scratch, &mut kernel);
                    kernel
                });
            }
        }
        Self { frame, grid, window, kernels: kernel_of }
    }

    /// Adds the contribution of `remapped` (row-major, on `tile`) to `film`, on `tile` grown by half the window.
    pub fn scatter(&self, tile: Rect, remapped: &[f32], film: &mut [f32], simd: Simd) {
        match simd.isa() {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => Dispatch::<Avx512>::new(simd).run(Phases { strided: self, tile, remapped, film }),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => Dispatch::<Avx2>::new(simd).run(Phases { strided: self, tile, remapped, film }),
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

#[cfg(target_arch = "x86_64")]
struct Phases<'a> {
    strided: &'a Strided<'a>,
    tile: Rect,
    remapped: &'a [f32],
    film: &'a mut [f32],
}

#[cfg(target_arch = "x86_64")]
impl<V: Lanes> SimdOp<V> for Phases<'_> {
    #[inline(always)]
    fn run(self) {
        self.strided.phases(self.tile, self.remapped, self.film, f32::mul_add);
    }
}

fn places(tile: Rect) -> impl Iterator<Item = (i64, i64)> {
    (tile.y..tile.bottom()).flat_map(move |y| (tile.x..tile.right()).map(move |x| (y, x)))
}

/// The four nodes around the film pixel (y, x) and their weights, which sum to 1. At a height of one azimuth its node appears twice.
fn nodes(frame: &Frame, grid: &NodeGrid, y: i64, x: i64) -> [(Node, f64); 4] {
    let (dy, dx) = (y as f64 - frame.axis_px.0, x as f64 - frame.axis_px.1);
    let (r, revolution) =
        (real::hypot(dy, dx), real::atan2(dy, dx).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU);
    let heights = grid.heights_px();
    let outer = heights.partition_point(|h| *h <= r).clamp(1, heights.len() - 1);
    let share = ((r - heights[outer - 1]) / (heights[outer] - heights[outer - 1])).clamp(0.0, 1.0);
    let along = |k: usize, w: f64| {
        let count = grid.azimuths()[k];
        let at = revolution * count as f64;
        let j = (at as usize).min(count - 1);
        let t = at - j as f64;
        [(Node { k, j }, w * (1.0 - t)), (Node { k, j: (j + 1) % count }, w * t)]
    };
    let ([a, b], [c, d]) = (along(outer - 1, 1.0 - share), along(outer, share));
    [a, b, c, d]
}
