//! Rounding of samples to fewer bits of mantissa, so that they compress better.
//!
//! ```text
//! x = ±1.b₁b₂…b₂₃ · 2^e  →  the nearest ±1.b₁…b_N · 2^e',  of two equally near ones that with b_N = 0
//! ```
//! (roundTiesToEven, IEEE 754-2019, 4.3.1). For normal numbers |rounded − x| ≤ 2^−(N+1)·|x|; subnormal ones are rounded at the same
//! absolute step as the smallest normal. Zero, sign, NaN and infinity are kept; a finite value stays finite: where rounding would carry
//! beyond the largest value, the excess bits are cut off instead. Rounding twice equals rounding once.
//!
//! Source: R. Kouznetsov, *A note on precision-preserving compression of scientific data*, Geosci. Model Dev. 14, 2021, "bit rounding".

use super::codec::SampleType;

const F32_MANTISSA_BITS: u32 = 23;
const ABS: u32 = 0x7fff_ffff;
const INFINITY: u32 = f32::INFINITY.to_bits();

impl SampleType {
    /// Explicit bits of the mantissa.
    pub const fn mantissa_bits(self) -> u32 {
        match self {
            Self::F16 => 10,
            Self::F32 => F32_MANTISSA_BITS,
            // Whole numbers: no rounding.
            Self::U16 => 0,
        }
    }
}

/// Rounding to a number of mantissa bits.
#[derive(Clone, Copy, Debug)]
pub(super) struct MantissaRounding {
    /// Bits of an f32 that become zero.
    drop: u32,
}

impl MantissaRounding {
    /// Keeps `keep_bits` (1 to 23) of an f32's bits; `None` for all.
    pub(super) const fn new(keep_bits: u32) -> Option<Self> {
        match F32_MANTISSA_BITS - keep_bits {
            0 => None,
            drop => Some(Self { drop }),
        }
    }

    /// `value`, rounded. Without branches, so that loops over it are vectorized.
    pub(super) const fn round(self, value: f32) -> f32 {
        let bits = value.to_bits();
        let excess = (1_u32 << self.drop) - 1;
        let odd = (bits >> self.drop) & 1;
        let nearest = bits.wrapping_add((excess >> 1) + odd) & !excess;
        let finite = if nearest & ABS < INFINITY { nearest } else { bits & !excess };
        f32::from_bits(if bits & ABS < INFINITY { finite } else { bits })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn round(keep_bits: u32, value: f32) -> f32 {
        MantissaRounding::new(keep_bits).map_or(value, |r| r.round(value))
    }

    fn keep_bits() -> impl Strategy<Value = u32> {
        1..=23_u32
    }

    proptest! {
        #[test]
        fn relative_error_of_normal_numbers_is_at_most_half_a_step(n in keep_bits(), x in prop::num::f32::NORMAL) {
            // Where rounding would reach infinity the excess is cut off: one step.
            let steps = if x.abs() < f32::MAX / 2.0 { 0.5 } else { 1.0 };
            let (rounded, x) = (f64::from(round(n, x)), f64::from(x));
            prop_assert!((rounded - x).abs() <= steps * 0.5_f64.powi(n as i32) * x.abs(), "{x} -> {rounded}");
        }

        #[test]
        fn the_nearest_value_of_n_bits_is_chosen(n in keep_bits(), x in -1e30_f32..1e30) {
            let step = |up: bool| {
                let cut = x.to_bits() & !((1 << (23 - n)) - 1);
                f64::from(f32::from_bits(cut + if up { 1 << (23 - n) } else { 0 }))
            };
            let (below, above) = (step(false), step(true));
            let (rounded, x) = (f64::from(round(n, x)), f64::from(x));
            let nearest = (x - below).abs().min((x - above).abs());
            prop_assert_eq!((rounded - x).abs(), nearest);
        }

        #[test]
        fn rounding_twice_equals_rounding_once(n in keep_bits(), bits: u32) {
            let once = round(n, f32::from_bits(bits));
            prop_assert_eq!(round(n, once).to_bits(), once.to_bits());
        }

        #[test]
        fn sign_is_kept_and_finite_values_stay_finite(n in keep_bits(), bits: u32) {
            let x = f32::from_bits(bits);
            let rounded = round(n, x);
            prop_assert_eq!(rounded.is_sign_negative(), x.is_sign_negative());
            prop_assert_eq!((rounded.is_finite(), rounded.is_nan()), (x.is_finite(), x.is_nan()));
        }

        #[test]
        fn ties_go_to_the_even_neighbour(n in 1..=22_u32, bits in 0..=0x7f00_0000_u32) {
            // A value of n bits plus half a step.
            let drop = 23 - n;
            let low = bits & !((1 << drop) - 1);
            let tie = f32::from_bits(low | 1 << (drop - 1));
            let rounded = round(n, tie).to_bits();
            prop_assert_eq!(rounded >> drop & 1, 0);
            prop_assert!(rounded == low || rounded == low + (1 << drop));
        }
    }

    #[test]
    fn zeros_infinities_and_nan_are_kept_bit_for_bit() {
        let nan = f32::from_bits(0x7fff_ffff);
        for x in [0.0, -0.0, f32::INFINITY, f32::NEG_INFINITY, f32::NAN, nan, -nan] {
            for n in 1..=23 {
                assert_eq!(round(n, x).to_bits(), x.to_bits(), "{x} to {n} bits");
            }
        }
    }

    #[test]
    fn all_23_bits_keep_every_value() {
        assert!(MantissaRounding::new(23).is_none());
    }
}
