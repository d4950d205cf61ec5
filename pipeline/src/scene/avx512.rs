//! 16 lanes: AVX-512F.
#![allow(unsafe_code, reason = "intrinsics of instructions that the build does not assume")]

use super::Taps;
use super::lanes::{Cubic, Lanes, Linear, lines};
use super::map::{Map, Points, ends};
use crate::geometry::Rect;
use crate::resample::Interp;
use crate::simd::{Isa, Simd};
use std::arch::x86_64::*;
use std::ops::{Add, Mul, Sub};

/// [`Map::strip`] and the ends of the chart's rows and columns.
pub(super) fn map(simd: Simd, map: Map<'_>, strip: Rect, to: &mut Points) -> ((i64, i64), (i64, i64)) {
    #[target_feature(enable = "avx512f")]
    fn run(map: Map<'_>, strip: Rect, to: &mut Points) -> ((i64, i64), (i64, i64)) {
        map.strip(strip, to);
        (ends(&to.row), ends(&to.col))
    }
    assert_eq!(simd.isa(), Isa::Avx512);
    // SAFETY: a choice of AVX-512F is only made where the processor has it.
    unsafe { run(map, strip, to) }
}

/// The taps of `t` into `out`.
pub(super) fn taps(simd: Simd, t: &Taps<'_>, interp: Interp, out: &mut [f32]) {
    #[target_feature(enable = "avx512f")]
    fn run(t: &Taps<'_>, interp: Interp, out: &mut [f32]) {
        match interp {
            Interp::Bicubic => lines::<Avx512, Cubic, 4>(t, out),
            Interp::Bilinear => lines::<Avx512, Linear, 2>(t, out),
        }
    }
    assert_eq!(simd.isa(), Isa::Avx512);
    // SAFETY: as in `map`.
    unsafe { run(t, interp, out) }
}

/// 16 f32.
#[derive(Clone, Copy, Debug)]
struct Avx512(__m512);

/// Intrinsics of AVX-512F.
macro_rules! avx512 {
    ($e:expr) => {
        // SAFETY: values of `Avx512` are made under `taps` only, which the processor was asked for.
        unsafe { $e }
    };
}

impl Add for Avx512 {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self(avx512!(_mm512_add_ps(self.0, b.0)))
    }
}

impl Sub for Avx512 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self(avx512!(_mm512_sub_ps(self.0, b.0)))
    }
}

impl Mul for Avx512 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self(avx512!(_mm512_mul_ps(self.0, b.0)))
    }
}

impl Lanes for Avx512 {
    const LANES: usize = 16;
    type Mask = __mmask16;
    type Index = __m512i;

    #[inline(always)]
    fn splat(v: f32) -> Self {
        Self(avx512!(_mm512_set1_ps(v)))
    }

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        let from = &from[..Self::LANES];
        // SAFETY: as in `avx512!`; 16 values lie there.
        Self(unsafe { _mm512_loadu_ps(from.as_ptr()) })
    }

    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        let to = &mut to[..Self::LANES];
        // SAFETY: as in `avx512!`; there is room for 16 values.
        unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self(avx512!(_mm512_fmadd_ps(self.0, b.0, c.0)))
    }

    #[inline(always)]
    fn or(self, mask: Self::Mask, b: Self) -> Self {
        Self(avx512!(_mm512_mask_blend_ps(mask, b.0, self.0)))
    }

    #[inline(always)]
    fn index(cells: &[i32], base: i32, limit: i32) -> (Self::Index, bool) {
        let index = avx512!(_mm512_sub_epi32(load(cells), _mm512_set1_epi32(base)));
        let inside = avx512!(_mm512_cmple_epu32_mask(index, _mm512_set1_epi32(limit)));
        (index, inside == u16::MAX)
    }

    #[inline(always)]
    fn equal(cells: &[i32], at: i32) -> Self::Mask {
        avx512!(_mm512_cmpeq_epi32_mask(load(cells), _mm512_set1_epi32(at)))
    }

    #[inline(always)]
    fn pick(from: &[f32], index: Self::Index) -> Self {
        let (low, high) = (Self::load(from), Self::load(&from[Self::LANES..]));
        Self(avx512!(_mm512_permutex2var_ps(low.0, index, high.0)))
    }
}

#[inline(always)]
fn load(from: &[i32]) -> __m512i {
    let from = &from[..Avx512::LANES];
    // SAFETY: as in `avx512!`; 16 values lie there.
    unsafe { _mm512_loadu_si512(from.as_ptr().cast()) }
}
