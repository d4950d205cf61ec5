//! The inner loops of cells, on registers that round products: the same bits with any instructions.
#![allow(unsafe_code, reason = "quads of cells are loaded after one check of all of them")]

use super::axis::{CellGrid, Places};
use super::curve::Curve;
use crate::simd::lanes::{Lanes, MAX_LANES, SimdOp};

/// The light at places between cells: four-tap cubic Lagrange polynomials down and across. Nothing where not all places have their cells without folding.
pub(super) struct Interpolate<'a> {
    pub(super) grid: &'a CellGrid,
    pub(super) cells: &'a [f32],
    pub(super) curve: &'a Curve,
    pub(super) has_all: &'a mut bool,
    pub(super) out: &'a mut [f32; MAX_LANES],
}

impl<V: Lanes> SimdOp<V> for Interpolate<'_> {
    #[inline(always)]
    fn run(self) {
        let (places, has_all) = self.grid.places(self.curve);
        *self.has_all = has_all;
        if !has_all {
            return;
        }
        let (cells, width) = (self.cells, self.grid.columns.cells());
        let Places { first, down, across, gain } = &places;
        let (mut least, mut last) = (i32::MAX, i32::MIN);
        for at in first {
            (least, last) = (least.min(*at), last.max(*at));
        }
        assert!(least >= 0 && last as usize + 3 * width + 4 <= cells.len(), "cells {least} to {last}");
        for from in (0..MAX_LANES).step_by(V::LANES) {
            let (wy, wx) = (weights::<V>(V::load(&down[from..])), weights::<V>(V::load(&across[from..])));
            let mut sum = V::splat(0.0);
            for (row, w) in wy.into_iter().enumerate() {
                let mut quads = [V::splat(0.0); 4];
                for (i, quad) in quads.iter_mut().enumerate() {
                    // SAFETY: the four cells from each place's first on in this row, one of four, lie in `cells`, as checked.
                    *quad = unsafe { V::load_quads(cells, first, from + i, row * width) };
                }
                let [a, b, c, d] = V::transpose_quads(quads);
                sum = sum + ((a * wx[0] + b * wx[1]) + (c * wx[2] + d * wx[3])) * w;
            }
            (sum * V::load(&gain[from..])).store(&mut self.out[from..]);
        }
    }
}

/// Lagrange weights of four cells at fraction `f`.
#[inline(always)]
fn weights<V: Lanes>(f: V) -> [V; 4] {
    let (sixth, third, half, one) = (V::splat(1.0 / 6.0), V::splat(1.0 / 3.0), V::splat(0.5), V::splat(1.0));
    let square = f * f;
    [
        f * ((half - f * sixth) * f - third),
        (f * half - one) * square + (one - f * half),
        f * ((one - f) * half * f + one),
        f * (square - one) * sixth,
    ]
}

/// Adds the weighted sum of rows of pixels, each as long as `to`, to `to`.
pub(super) struct AddRows<'a> {
    pub(super) to: &'a mut [f32],
    pub(super) pixels: &'a [f32],
    pub(super) weights: &'a [f32],
}

impl<V: Lanes> SimdOp<V> for AddRows<'_> {
    #[inline(always)]
    fn run(mut self) {
        let width = self.to.len();
        let mut x = 0;
        while x + 4 * V::LANES <= width {
            self.add::<V, 4>(x);
            x += 4 * V::LANES;
        }
        while x + V::LANES <= width {
            self.add::<V, 1>(x);
            x += V::LANES;
        }
        for (x, to) in self.to.iter_mut().enumerate().skip(x) {
            let mut sum = 0.0;
            for (row, w) in self.pixels.chunks_exact(width).zip(self.weights) {
                sum += row[x] * w;
            }
            *to += sum;
        }
    }
}

impl AddRows<'_> {
    /// `N` registers from column `x` on, whose sums do not wait for each other.
    #[inline(always)]
    fn add<V: Lanes, const N: usize>(&mut self, x: usize) {
        let mut sums = [V::splat(0.0); N];
        for (row, w) in self.pixels.chunks_exact(self.to.len()).zip(self.weights) {
            let (row, w) = (&row[x..][..N * V::LANES], V::splat(*w));
            for (i, sum) in sums.iter_mut().enumerate() {
                *sum = *sum + V::load(&row[i * V::LANES..]) * w;
            }
        }
        for (i, sum) in sums.into_iter().enumerate() {
            let to = &mut self.to[x + i * V::LANES..];
            (V::load(to) + sum).store(to);
        }
    }
}

/// Adds to each of the cells `to` the weighted sum of its pixels, as [`dot`] has it: cell k has those from k `side` on.
pub(super) struct AddAcross<'a> {
    pub(super) to: &'a mut [f32],
    pub(super) pixels: &'a [f32],
    pub(super) side: usize,
    pub(super) weights: &'a [[f32; 4]],
}

impl<V: Lanes> SimdOp<V> for AddAcross<'_> {
    #[inline(always)]
    fn run(self) {
        let Self { to, pixels, side, weights } = self;
        let at: [i32; MAX_LANES] = std::array::from_fn(|cell| (cell * side) as i32);
        let ends = to.len() / V::LANES * V::LANES;
        for cell in (0..ends).step_by(V::LANES) {
            let pixels = &pixels[cell * side..];
            assert!((V::LANES - 1) * side + 4 * weights.len() <= pixels.len(), "the last cell's pixels");
            let mut quads = [V::splat(0.0); 4];
            for (i, w) in weights.iter().enumerate() {
                let w = V::load(bytemuck::cast_slice(&[*w; MAX_LANES / 4]));
                for (first, quad) in quads.iter_mut().enumerate() {
                    // SAFETY: four pixels of each of `LANES` cells, which there are, as checked.
                    *quad = *quad + unsafe { V::load_quads(pixels, &at, first, 4 * i) } * w;
                }
            }
            let [a, b, c, d] = V::transpose_quads(quads);
            let to = &mut to[cell..];
            (V::load(to) + ((a + c) + (b + d))).store(to);
        }
        for (cell, to) in to.iter_mut().enumerate().skip(ends) {
            *to += dot(&pixels[cell * side..][..4 * weights.len()], weights.as_flattened());
        }
    }
}

/// Σ a b: four sums side by side, then these.
#[inline(always)]
pub(super) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    let mut sum = [0.0; 4];
    for (a, b) in a.iter().zip(b) {
        for (sum, (a, b)) in sum.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    (sum[0] + sum[2]) + (sum[1] + sum[3]) + rest
}
