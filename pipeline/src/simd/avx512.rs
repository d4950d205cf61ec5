//! 16 lanes: AVX-512F.
#![allow(unsafe_code, reason = "intrinsics of instructions that the build does not assume")]

use super::isa::Isa;
use super::lanes::{Lanes, MAX_LANES, SimdOp, operators};
use bytemuck::{Pod, Zeroable};
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Sub};

/// 16 f32.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(crate) struct Avx512(__m512);

// SAFETY: 16 f32 and nothing else; any bits are valid.
unsafe impl Zeroable for Avx512 {}
// SAFETY: as above.
unsafe impl Pod for Avx512 {}

/// Intrinsics of AVX-512F.
macro_rules! avx512 {
    ($e:expr) => {
        // SAFETY: values of `Avx512` are made under `Lanes::run` only, whose caller guarantees AVX-512F.
        unsafe { $e }
    };
}

operators!(Avx512, avx512, Add add _mm512_add_ps, Sub sub _mm512_sub_ps, Mul mul _mm512_mul_ps, Div div _mm512_div_ps);

impl Lanes for Avx512 {
    const ISA: Isa = Isa::Avx512;
    const LANES: usize = 16;
    type I32 = __m512i;
    type Mask = __mmask16;

    #[target_feature(enable = "avx512f")]
    unsafe fn run<O: SimdOp<Self>>(op: O) {
        op.run();
    }

    #[inline(always)]
    fn splat(v: f32) -> Self {
        Self(avx512!(_mm512_set1_ps(v)))
    }

    #[inline(always)]
    fn iota() -> Self {
        Self::load(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0])
    }

    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self(avx512!(_mm512_fmadd_ps(self.0, b.0, c.0)))
    }

    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        Self(avx512!(_mm512_fmsub_ps(self.0, b.0, c.0)))
    }

    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        Self(avx512!(_mm512_fnmadd_ps(self.0, b.0, c.0)))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(avx512!(_mm512_abs_ps(self.0)))
    }

    #[inline(always)]
    fn min(self, b: Self) -> Self {
        Self(avx512!(_mm512_min_ps(self.0, b.0)))
    }

    #[inline(always)]
    fn max(self, b: Self) -> Self {
        Self(avx512!(_mm512_max_ps(self.0, b.0)))
    }

    #[inline(always)]
    fn zero_below(self, limit: Self) -> Self {
        Self(avx512!({
            let keep = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(_mm512_abs_ps(self.0), limit.0);
            _mm512_maskz_mov_ps(keep, self.0)
        }))
    }

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        let from = &from[..Self::LANES];
        // SAFETY: as in `avx512!`; 16 values lie there.
        Self(unsafe { _mm512_loadu_ps(from.as_ptr()) })
    }

    #[inline(always)]
    fn load_first(from: &[f32], n: usize) -> Self {
        let from = &from[..n];
        // SAFETY: as in `avx512!`; masked lanes are not read, and the others lie in the slice.
        Self(unsafe { _mm512_maskz_loadu_ps((1u16 << n) - 1, from.as_ptr()) })
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
        // SAFETY: as in `avx512!`; the slice holds 16 values.
        unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn reduce_min(self) -> f32 {
        avx512!(_mm512_reduce_min_ps(self.0))
    }

    #[inline(always)]
    fn reduce_max(self) -> f32 {
        avx512!(_mm512_reduce_max_ps(self.0))
    }

    #[inline(always)]
    fn permute(low: Self, high: Self, index: Self::I32) -> Self {
        Self(avx512!(_mm512_permutex2var_ps(low.0, index, high.0)))
    }

    #[inline(always)]
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self {
        Self(avx512!(_mm512_mask_blend_ps(mask, b.0, a.0)))
    }

    #[inline(always)]
    fn broadcast_in_quads<const I: i32>(self) -> Self {
        Self(match I {
            0 => avx512!(_mm512_permute_ps::<0x00>(self.0)),
            1 => avx512!(_mm512_permute_ps::<0x55>(self.0)),
            2 => avx512!(_mm512_permute_ps::<0xaa>(self.0)),
            _ => avx512!(_mm512_permute_ps::<0xff>(self.0)),
        })
    }

    #[inline(always)]
    fn transpose_quads([a, b, c, d]: [Self; 4]) -> [Self; 4] {
        avx512!({
            let (ab, cd) = (_mm512_unpacklo_ps(a.0, b.0), _mm512_unpacklo_ps(c.0, d.0));
            let (ab2, cd2) = (_mm512_unpackhi_ps(a.0, b.0), _mm512_unpackhi_ps(c.0, d.0));
            [
                Self(_mm512_shuffle_ps::<0x44>(ab, cd)),
                Self(_mm512_shuffle_ps::<0xee>(ab, cd)),
                Self(_mm512_shuffle_ps::<0x44>(ab2, cd2)),
                Self(_mm512_shuffle_ps::<0xee>(ab2, cd2)),
            ]
        })
    }

    #[inline(always)]
    unsafe fn load_quads(from: &[f32], at: &[i32; MAX_LANES], first: usize, offset: usize) -> Self {
        // SAFETY: the caller guarantees all four.
        unsafe {
            let from = from.as_ptr().add(offset);
            let quad = _mm512_castps128_ps512(_mm_loadu_ps(from.add(at[first] as usize)));
            let quad = _mm512_insertf32x4::<1>(quad, _mm_loadu_ps(from.add(at[first + 4] as usize)));
            let quad = _mm512_insertf32x4::<2>(quad, _mm_loadu_ps(from.add(at[first + 8] as usize)));
            Self(_mm512_insertf32x4::<3>(quad, _mm_loadu_ps(from.add(at[first + 12] as usize))))
        }
    }

    #[inline(always)]
    fn floor(self) -> Self {
        Self(avx512!(_mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(self.0)))
    }

    #[inline(always)]
    fn to_i32(self) -> Self::I32 {
        avx512!(_mm512_cvtps_epi32(self.0))
    }

    #[inline(always)]
    fn store_i32(a: Self::I32, to: &mut [i32]) {
        let to = &mut to[..Self::LANES];
        // SAFETY: as in `avx512!`; the slice holds 16 values.
        unsafe { _mm512_storeu_si512(to.as_mut_ptr().cast(), a) }
    }

    #[inline(always)]
    fn load_i32(from: &[i32]) -> Self::I32 {
        let from = &from[..Self::LANES];
        // SAFETY: as in `avx512!`; 16 values lie there.
        unsafe { _mm512_loadu_si512(from.as_ptr().cast()) }
    }

    #[inline(always)]
    fn add_i32(a: Self::I32, b: i32) -> Self::I32 {
        avx512!(_mm512_add_epi32(a, _mm512_set1_epi32(b)))
    }

    #[inline(always)]
    fn all_within(a: Self::I32, limit: i32) -> bool {
        avx512!(_mm512_cmple_epu32_mask(a, _mm512_set1_epi32(limit))) == u16::MAX
    }

    #[inline(always)]
    fn equals(a: Self::I32, b: i32) -> Self::Mask {
        avx512!(_mm512_cmpeq_epi32_mask(a, _mm512_set1_epi32(b)))
    }
}
