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
    fn run(self) {
        let width = self.to.len();
        let ends = width / MAX_LANES * MAX_LANES;
        for x in (0..ends).step_by(V::LANES) {
            let mut sum = V::splat(0.0);
            for (row, w) in self.pixels.chunks_exact(width).zip(self.weights) {
                sum = sum + V::load(&row[x..]) * V::splat(*w);
            }
            let to = &mut self.to[x..];
            (V::load(to) + sum).store(to);
        }
        for (x, to) in self.to.iter_mut().enumerate().skip(ends) {
            let mut sum = 0.0;
            for (row, w) in self.pixels.chunks_exact(width).zip(self.weights) {
                sum += row[x] * w;
            }
            *to += sum;
        }
    }
}
