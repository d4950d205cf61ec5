//! Four f64 that are computed together: AVX2 registers, or arrays on any processor, with the same bits.
//!
//! Masks have all bits of a lane set or none. Functions that use AVX2 are inlined into `engine::avx2`, which is compiled for it.
#![allow(unsafe_code, reason = "instructions that the build does not assume, used after they were detected")]

/// Number of lanes.
pub(crate) const LANES: usize = 4;

/// A register of [`LANES`] f64.
pub(super) trait Lanes: Copy {
    /// `v` in all lanes.
    fn splat(v: f64) -> Self;
    /// From memory.
    fn load(from: &[f64; LANES]) -> Self;
    /// To memory.
    fn store(self, to: &mut [f64; LANES]);
    /// Sum.
    fn plus(self, b: Self) -> Self;
    /// Product.
    fn times(self, b: Self) -> Self;
    /// Quotient.
    fn over(self, b: Self) -> Self;
    /// Mask of self ≥ b.
    fn at_least(self, b: Self) -> Self;
    /// Mask of self > b.
    fn above(self, b: Self) -> Self;
    /// Bits of both.
    fn and(self, b: Self) -> Self;
    /// Bits of either.
    fn or(self, b: Self) -> Self;
    /// Bits of self that `b` has not.
    fn without(self, b: Self) -> Self;
    /// `b` where `mask` is set, else self.
    fn replaced(self, mask: Self, b: Self) -> Self;
    /// Bit k: lane k of a mask.
    fn bits(self) -> u32;
}

impl Lanes for [f64; LANES] {
    #[inline(always)]
    fn splat(v: f64) -> Self {
        [v; LANES]
    }
    #[inline(always)]
    fn load(from: &[f64; LANES]) -> Self {
        *from
    }
    #[inline(always)]
    fn store(self, to: &mut [f64; LANES]) {
        *to = self;
    }
    #[inline(always)]
    fn plus(self, b: Self) -> Self {
        std::array::from_fn(|k| self[k] + b[k])
    }
    #[inline(always)]
    fn times(self, b: Self) -> Self {
        std::array::from_fn(|k| self[k] * b[k])
    }
    #[inline(always)]
    fn over(self, b: Self) -> Self {
        std::array::from_fn(|k| self[k] / b[k])
    }
    #[inline(always)]
    fn at_least(self, b: Self) -> Self {
        std::array::from_fn(|k| mask(self[k] >= b[k]))
    }
    #[inline(always)]
    fn above(self, b: Self) -> Self {
        std::array::from_fn(|k| mask(self[k] > b[k]))
    }
    #[inline(always)]
    fn and(self, b: Self) -> Self {
        std::array::from_fn(|k| f64::from_bits(self[k].to_bits() & b[k].to_bits()))
    }
    #[inline(always)]
    fn or(self, b: Self) -> Self {
        std::array::from_fn(|k| f64::from_bits(self[k].to_bits() | b[k].to_bits()))
    }
    #[inline(always)]
    fn without(self, b: Self) -> Self {
        std::array::from_fn(|k| f64::from_bits(self[k].to_bits() & !b[k].to_bits()))
    }
    #[inline(always)]
    fn replaced(self, mask: Self, b: Self) -> Self {
        self.without(mask).or(b.and(mask))
    }
    #[inline(always)]
    fn bits(self) -> u32 {
        (0..LANES).map(|k| ((self[k].to_bits() >> 63) as u32) << k).sum()
    }
}

fn mask(is_set: bool) -> f64 {
    f64::from_bits(if is_set { u64::MAX } else { 0 })
}

#[cfg(target_arch = "x86_64")]
pub(super) use avx2::Avx2;

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{LANES, Lanes};
    use std::arch::x86_64::*;

    /// A register of AVX2. Values are only created where the instructions were detected, so that operations on them are safe.
    #[derive(Clone, Copy)]
    pub(in super::super) struct Avx2(__m256d);

    macro_rules! binary {
        ($($method:ident: $of:expr;)*) => {
            $(
                #[inline(always)]
                fn $method(self, b: Self) -> Self {
                    // SAFETY: AVX2 was detected before a value of the type existed.
                    Self(unsafe { $of(self.0, b.0) })
                }
            )*
        };
    }

    impl Lanes for Avx2 {
        #[inline(always)]
        fn splat(v: f64) -> Self {
            // SAFETY: called by the function that is compiled for AVX2 only.
            Self(unsafe { _mm256_set1_pd(v) })
        }
        #[inline(always)]
        fn load(from: &[f64; LANES]) -> Self {
            // SAFETY: as above; four values are there.
            Self(unsafe { _mm256_loadu_pd(from.as_ptr()) })
        }
        #[inline(always)]
        fn store(self, to: &mut [f64; LANES]) {
            // SAFETY: as above.
            unsafe { _mm256_storeu_pd(to.as_mut_ptr(), self.0) }
        }
        binary! {
            plus: _mm256_add_pd;
            times: _mm256_mul_pd;
            over: _mm256_div_pd;
            at_least: _mm256_cmp_pd::<_CMP_GE_OQ>;
            above: _mm256_cmp_pd::<_CMP_GT_OQ>;
            and: _mm256_and_pd;
            or: _mm256_or_pd;
            without: |a, b| _mm256_andnot_pd(b, a);
        }
        #[inline(always)]
        fn replaced(self, mask: Self, b: Self) -> Self {
            // SAFETY: as above.
            Self(unsafe { _mm256_blendv_pd(self.0, b.0, mask.0) })
        }
        #[inline(always)]
        fn bits(self) -> u32 {
            // SAFETY: as above.
            unsafe { _mm256_movemask_pd(self.0) as u32 }
        }
    }
}
