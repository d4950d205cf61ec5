//! Complex numbers, one per lane.
#![allow(unsafe_code, reason = "plain data of two registers")]

use crate::simd::lanes::Lanes;
use bytemuck::{Pod, Zeroable, cast_slice};
use std::ops::{Add, Sub};

/// `LANES` complex numbers.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct Complex<V> {
    pub(super) re: V,
    pub(super) im: V,
}

// SAFETY: all zeros are zeros of both parts.
unsafe impl<V: Zeroable> Zeroable for Complex<V> {}
// SAFETY: two values of one plain type in C's order leave no padding.
unsafe impl<V: Pod> Pod for Complex<V> {}

impl<V: Lanes> Complex<V> {
    /// Transposes `LANES` elements.
    #[inline(always)]
    pub(super) fn transpose(from: &[Self], to: &mut [Self]) {
        let (from, to) = (&from[..V::LANES], &mut to[..V::LANES]);
        let values: &[f32] = cast_slice(from);
        for first in (0..V::LANES).step_by(4) {
            let re = V::transposed_quads(&values[first..], 2 * V::LANES);
            let im = V::transposed_quads(&values[V::LANES + first..], 2 * V::LANES);
            for i in 0..4 {
                to[first + i] = Self { re: re[i], im: im[i] };
            }
        }
    }

    /// self·w, the same `w` for all lanes.
    #[inline(always)]
    pub(super) fn times(self, w: [f32; 2]) -> Self {
        let (re, im) = (V::splat(w[0]), V::splat(w[1]));
        Self { re: self.re.mul_sub(re, self.im * im), im: self.re.mul_add(im, self.im * re) }
    }

    /// self·w̄, the same `w` for all lanes.
    #[inline(always)]
    pub(super) fn times_conjugate(self, w: [f32; 2]) -> Self {
        let (re, im) = (V::splat(w[0]), V::splat(w[1]));
        Self { re: self.re.mul_add(re, self.im * im), im: self.im.mul_sub(re, self.re * im) }
    }
}

impl<V: Lanes> Add for Complex<V> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self { re: self.re + b.re, im: self.im + b.im }
    }
}

impl<V: Lanes> Sub for Complex<V> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self { re: self.re - b.re, im: self.im - b.im }
    }
}
