//! 8 lanes: AVX2 with fused multiply-add.
#![allow(unsafe_code, reason = "intrinsics of instructions that the build does not assume")]

use super::isa::Isa;
use super::lanes::{Lanes, MAX_LANES, SimdOp, operators};
use bytemuck::{Pod, Zeroable};
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Sub};

/// 8 f32.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(crate) struct Avx2(__m256);

// SAFETY: 8 f32 and nothing else; any bits are valid.
unsafe impl Zeroable for Avx2 {}
// SAFETY: as above.
unsafe impl Pod for Avx2 {}

/// Intrinsics of AVX2 and FMA.
macro_rules! avx2 {
    ($e:expr) => {
        // SAFETY: values of `Avx2` are made under `Lanes::run` only, whose caller guarantees AVX2 and FMA.
        unsafe { $e }
    };
}

operators!(Avx2, avx2, Add add _mm256_add_ps, Sub sub _mm256_sub_ps, Mul mul _mm256_mul_ps, Div div _mm256_div_ps);

impl Lanes for Avx2 {
    const ISA: Isa = Isa::Avx2;
    const LANES: usize = 8;
    type I32 = __m256i;
    type Mask = __m256;

    #[target_feature(enable = "avx2,fma")]
    unsafe fn run<O: SimdOp<Self>>(op: O) {
        op.run();
    }

    #[inline(always)]
    fn splat(v: f32) -> Self {
        Self(avx2!(_mm256_set1_ps(v)))
    }

    #[inline(always)]
    fn iota() -> Self {
        Self::load(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0])
    }

    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self(avx2!(_mm256_fmadd_ps(self.0, b.0, c.0)))
    }

    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        Self(avx2!(_mm256_fmsub_ps(self.0, b.0, c.0)))
    }

    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        Self(avx2!(_mm256_fnmadd_ps(self.0, b.0, c.0)))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(avx2!(_mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0)))
    }

    #[inline(always)]
    fn min(self, b: Self) -> Self {
        Self(avx2!(_mm256_min_ps(self.0, b.0)))
    }

    #[inline(always)]
    fn max(self, b: Self) -> Self {
        Self(avx2!(_mm256_max_ps(self.0, b.0)))
    }

    #[inline(always)]
    fn zero_below(self, limit: Self) -> Self {
        let magnitude = self.abs();
        Self(avx2!(_mm256_and_ps(self.0, _mm256_cmp_ps::<_CMP_GE_OQ>(magnitude.0, limit.0))))
    }

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        let from = &from[..Self::LANES];
        // SAFETY: as in `avx2!`; 8 values lie there.
        Self(unsafe { _mm256_loadu_ps(from.as_ptr()) })
    }

    #[inline(always)]
    fn load_first(from: &[f32], n: usize) -> Self {
        let from = &from[..n];
        // SAFETY: as in `avx2!`; masked lanes are not read, and the others lie in the slice.
        Self(unsafe {
            let mask =
                _mm256_cmpgt_epi32(_mm256_set1_epi32(n as i32), _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
            _mm256_maskload_ps(from.as_ptr(), mask)
        })
    }

    #[inline(always)]
    fn prefetch(from: &[f32], at: usize) {
        if let Some(value) = from.get(at) {
            // SAFETY: a hint on every x86-64 processor, of an address in the slice.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(value).cast()) }
        }
    }

    #[inline(always)]
    fn prefetch_l2(from: &[f32], at: usize) {
        // SAFETY: a hint on every x86-64 processor, of any address.
        unsafe { _mm_prefetch::<_MM_HINT_T1>(from.as_ptr().wrapping_add(at).cast()) }
    }

    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        let to = &mut to[..Self::LANES];
        // SAFETY: as in `avx2!`; the slice holds 8 values.
        unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn reduce_min(self) -> f32 {
        bytemuck::cast::<_, [f32; 8]>(self).into_iter().fold(f32::INFINITY, f32::min)
    }

    #[inline(always)]
    fn reduce_max(self) -> f32 {
        bytemuck::cast::<_, [f32; 8]>(self).into_iter().fold(f32::NEG_INFINITY, f32::max)
    }

    #[inline(always)]
    fn permute(low: Self, high: Self, index: Self::I32) -> Self {
        // The permutation uses three bits of the index; the fourth selects the half and is shifted to the sign bit for the blend.
        Self(avx2!({
            let upper = _mm256_castsi256_ps(_mm256_slli_epi32::<28>(index));
            let low = _mm256_permutevar8x32_ps(low.0, index);
            _mm256_blendv_ps(low, _mm256_permutevar8x32_ps(high.0, index), upper)
        }))
    }

    #[inline(always)]
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self {
        Self(avx2!(_mm256_blendv_ps(b.0, a.0, mask)))
    }

    #[inline(always)]
    fn broadcast_in_quads<const I: i32>(self) -> Self {
        Self(match I {
            0 => avx2!(_mm256_permute_ps::<0x00>(self.0)),
            1 => avx2!(_mm256_permute_ps::<0x55>(self.0)),
            2 => avx2!(_mm256_permute_ps::<0xaa>(self.0)),
            _ => avx2!(_mm256_permute_ps::<0xff>(self.0)),
        })
    }

    #[inline(always)]
    fn transpose_quads([a, b, c, d]: [Self; 4]) -> [Self; 4] {
        avx2!({
            let (ab, cd) = (_mm256_unpacklo_ps(a.0, b.0), _mm256_unpacklo_ps(c.0, d.0));
            let (ab2, cd2) = (_mm256_unpackhi_ps(a.0, b.0), _mm256_unpackhi_ps(c.0, d.0));
            [
                Self(_mm256_shuffle_ps::<0x44>(ab, cd)),
                Self(_mm256_shuffle_ps::<0xee>(ab, cd)),
                Self(_mm256_shuffle_ps::<0x44>(ab2, cd2)),
                Self(_mm256_shuffle_ps::<0xee>(ab2, cd2)),
            ]
        })
    }

    #[inline(always)]
    unsafe fn load_quads(from: &[f32], at: &[i32; MAX_LANES], first: usize, offset: usize) -> Self {
        // SAFETY: the caller guarantees both.
        unsafe {
            let from = from.as_ptr().add(offset);
            let quad = _mm256_castps128_ps256(_mm_loadu_ps(from.add(at[first] as usize)));
            Self(_mm256_insertf128_ps::<1>(quad, _mm_loadu_ps(from.add(at[first + 4] as usize))))
        }
    }

    #[inline(always)]
    fn floor(self) -> Self {
        Self(avx2!(_mm256_floor_ps(self.0)))
    }

    #[inline(always)]
    fn to_i32(self) -> Self::I32 {
        avx2!(_mm256_cvtps_epi32(self.0))
    }

    #[inline(always)]
    fn store_i32(a: Self::I32, to: &mut [i32]) {
        let to = &mut to[..Self::LANES];
        // SAFETY: as in `avx2!`; the slice holds 8 values.
        unsafe { _mm256_storeu_si256(to.as_mut_ptr().cast(), a) }
    }

    #[inline(always)]
    fn load_i32(from: &[i32]) -> Self::I32 {
        let from = &from[..Self::LANES];
        // SAFETY: as in `avx2!`; 8 values lie there.
        unsafe { _mm256_loadu_si256(from.as_ptr().cast()) }
    }

    #[inline(always)]
    fn add_i32(a: Self::I32, b: i32) -> Self::I32 {
        avx2!(_mm256_add_epi32(a, _mm256_set1_epi32(b)))
    }

    #[inline(always)]
    fn all_within(a: Self::I32, limit: i32) -> bool {
        let outside = avx2!({
            let below = _mm256_cmpgt_epi32(_mm256_setzero_si256(), a);
            let above = _mm256_cmpgt_epi32(a, _mm256_set1_epi32(limit));
            _mm256_movemask_epi8(_mm256_or_si256(below, above))
        });
        outside == 0
    }

    #[inline(always)]
    fn equals(a: Self::I32, b: i32) -> Self::Mask {
        avx2!(_mm256_castsi256_ps(_mm256_cmpeq_epi32(a, _mm256_set1_epi32(b))))
    }
}
