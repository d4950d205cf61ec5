//! 8 lanes: AVX2 with fused multiply-add.
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
    #[target_feature(enable = "avx2,fma")]
    fn run(map: Map<'_>, strip: Rect, to: &mut Points) -> ((i64, i64), (i64, i64)) {
        map.strip(strip, to);
        (ends(&to.row), ends(&to.col))
    }
    assert_eq!(simd.isa(), Isa::Avx2);
    // SAFETY: a choice of AVX2 with fused multiply-add is only made where the processor has it.
    unsafe { run(map, strip, to) }
}

/// The taps of `t` into `out`.
pub(super) fn taps(simd: Simd, t: &Taps<'_>, interp: Interp, out: &mut [f32]) {
    #[target_feature(enable = "avx2,fma")]
    fn run(t: &Taps<'_>, interp: Interp, out: &mut [f32]) {
        match interp {
            Interp::Bicubic => lines::<Avx2, Cubic, 4>(t, out),
            Interp::Bilinear => lines::<Avx2, Linear, 2>(t, out),
        }
    }
    assert_eq!(simd.isa(), Isa::Avx2);
    // SAFETY: as in `map`.
    unsafe { run(t, interp, out) }
}

/// 8 f32.
#[derive(Clone, Copy, Debug)]
struct Avx2(__m256);

/// Intrinsics of AVX2 with fused multiply-add.
macro_rules! avx2 {
    ($e:expr) => {
        // SAFETY: values of `Avx2` are made under `taps` only, which the processor was asked for.
        unsafe { $e }
    };
}

impl Add for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self(avx2!(_mm256_add_ps(self.0, b.0)))
    }
}

impl Sub for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self(avx2!(_mm256_sub_ps(self.0, b.0)))
    }
}

impl Mul for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self(avx2!(_mm256_mul_ps(self.0, b.0)))
    }
}

impl Lanes for Avx2 {
    const LANES: usize = 8;
    type Mask = __m256;
    type Index = __m256i;

    #[inline(always)]
    fn splat(v: f32) -> Self {
        Self(avx2!(_mm256_set1_ps(v)))
    }

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        let from = &from[..Self::LANES];
        // SAFETY: as in `avx2!`; 8 values lie there.
        Self(unsafe { _mm256_loadu_ps(from.as_ptr()) })
    }

    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        let to = &mut to[..Self::LANES];
        // SAFETY: as in `avx2!`; there is room for 8 values.
        unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self(avx2!(_mm256_fmadd_ps(self.0, b.0, c.0)))
    }

    #[inline(always)]
    fn or(self, mask: Self::Mask, b: Self) -> Self {
        Self(avx2!(_mm256_blendv_ps(b.0, self.0, mask)))
    }

    #[inline(always)]
    fn index(cells: &[i32], base: i32, limit: i32) -> (Self::Index, bool) {
        let index = avx2!(_mm256_sub_epi32(load(cells), _mm256_set1_epi32(base)));
        let outside = avx2!({
            let below = _mm256_cmpgt_epi32(_mm256_setzero_si256(), index);
            let above = _mm256_cmpgt_epi32(index, _mm256_set1_epi32(limit));
            _mm256_movemask_epi8(_mm256_or_si256(below, above))
        });
        (index, outside == 0)
    }

    #[inline(always)]
    fn equal(cells: &[i32], at: i32) -> Self::Mask {
        avx2!(_mm256_castsi256_ps(_mm256_cmpeq_epi32(load(cells), _mm256_set1_epi32(at))))
    }

    #[inline(always)]
    fn pick(from: &[f32], index: Self::Index) -> Self {
        let (low, high) = (Self::load(from), Self::load(&from[Self::LANES..]));
        // The permutation reads three bits of the index; the fourth tells the halves, moved to where the blend looks.
        Self(avx2!({
            let upper = _mm256_castsi256_ps(_mm256_slli_epi32::<28>(index));
            let low = _mm256_permutevar8x32_ps(low.0, index);
            _mm256_blendv_ps(low, _mm256_permutevar8x32_ps(high.0, index), upper)
        }))
    }
}

#[inline(always)]
fn load(from: &[i32]) -> __m256i {
    let from = &from[..Avx2::LANES];
    // SAFETY: as in `avx2!`; 8 values lie there.
    unsafe { _mm256_loadu_si256(from.as_ptr().cast()) }
}
