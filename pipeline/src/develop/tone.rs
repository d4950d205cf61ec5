//! Linear values to the integers of a picture.
//!
//!   code = ⌊n·T(min(max(v, 0), 1)) + ½⌋,   n = 2^depth − 1,   T = sRGB (IEC 61966-2-1) or the identity
//! T uses the exponential and logarithm of [`crate::sensor::quantile`], so codes are the same on every machine. Codes are looked up: the
//! smallest f32 of each code is found by bisection of the formula, which is monotone, so the table gives exactly the formula's code.

use crate::sensor::quantile::{exp, ln};

/// From linear light to the values of the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// The transfer function of sRGB.
    Srgb,
    /// Proportional to light.
    Linear,
}

impl Tone {
    /// The value of the picture, 0 to 1, of a linear value.
    pub fn encode(self, v: f64) -> f64 {
        let v = if v > 0.0 { v.min(1.0) } else { 0.0 };
        match self {
            Self::Linear => v,
            Self::Srgb if v <= 0.003_130_8 => 12.92 * v,
            Self::Srgb => 1.055 * exp(ln(v) / 2.4) - 0.055,
        }
    }
}

/// Linear values to codes of 8 or 16 bits.
#[derive(Clone, Debug)]
pub struct Quantizer {
    /// Smallest value of each code.
    smallest: Vec<f32>,
    /// Code of the lower end of each of equal intervals of 0 to 1.
    codes: Vec<u16>,
    intervals: f32,
}

impl Quantizer {
    /// For codes of `bits` bits, 8 or 16.
    pub fn new(tone: Tone, bits: u32) -> Self {
        let (last, intervals) = if bits == 8 { (255u32, 1 << 12) } else { (65535, 1 << 18) };
        let code = |v: f32| (f64::from(last) * tone.encode(v.into()) + 0.5).floor() as u32;
        let mut smallest = vec![0f32];
        for k in 1..=last {
            // Bits of positive floats ascend with their values.
            let (mut below, mut above) = (smallest[k as usize - 1].to_bits(), 1f32.to_bits());
            while below + 1 < above {
                let middle = below.midpoint(above);
                if code(f32::from_bits(middle)) >= k {
                    above = middle;
                } else {
                    below = middle;
                }
            }
            smallest.push(f32::from_bits(above));
        }
        let codes = (0..=intervals).map(|i| code(i as f32 / intervals as f32) as u16).collect();
        Self { smallest, codes, intervals: intervals as f32 }
    }

    /// The codes of linear values.
    pub fn codes(&self, values: &[f32]) -> Vec<u16> {
        values.iter().map(|v| self.code(*v)).collect()
    }

    /// The code of a linear value; that of 0 for NaN.
    #[inline]
    pub fn code(&self, v: f32) -> u16 {
        let v = if v > 0.0 { v.min(1.0) } else { 0.0 };
        let mut k = usize::from(self.codes[(v * self.intervals) as usize]);
        while k + 1 < self.smallest.len() && v >= self.smallest[k + 1] {
            k += 1;
        }
        k as u16
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_those_of_the_formula() {
        for (tone, bits) in [(Tone::Srgb, 8), (Tone::Srgb, 16), (Tone::Linear, 8), (Tone::Linear, 16)] {
            let (table, last) = (Quantizer::new(tone, bits), f64::from((1u32 << bits) - 1));
            let steps = (0..200_001u32).map(|i| (i as f32 - 1000.0) / 198_000.0);
            let edges = table.smallest.iter().step_by(97).flat_map(|v| {
                [-1i32, 0, 1].map(|step| f32::from_bits(v.to_bits().saturating_add_signed(step)))
            });
            for v in steps.chain(edges).chain([0.0, 1.0, 2.0, -1.0]) {
                let expected = (last * tone.encode(v.into()) + 0.5).floor();
                assert_eq!(f64::from(table.code(v)), expected, "{tone:?} {bits} {v}");
            }
            assert_eq!(table.code(f32::NAN), 0);
        }
    }

    #[test]
    fn srgb_has_the_values_of_the_standard() {
        for (linear, encoded) in [(0.0, 0.0), (0.001, 0.01292), (0.5, 0.735_356_983_052_449_5), (1.0, 1.0)] {
            assert!((Tone::Srgb.encode(linear) - encoded).abs() < 2e-15, "{linear}");
        }
    }
}
