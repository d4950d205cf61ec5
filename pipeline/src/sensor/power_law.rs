//! Noise of rows or columns whose spectrum is a power law: of the offsets of neighbours that the same slow noise of the readout makes.
//!
//! Of independent standard normal numbers z of rows (or columns), the exponent a and the length L = [`LENGTH`]:
//!
//! ```text
//! n(r)  = σ·Σ_j h_j·z(r − j)/√(Σ_j h_j²),   j = 0 … L − 1
//! h_j   = g_j·(1 − (j/L)²)²,   g_0 = 1,   g_j = g_(j−1)·(j − 1 + a/2)/j
//! S(f)  = σ²·|Σ_j h_j·e^(−2πi·f·j)|²/Σ_j h_j²    ∝ (2·sin(πf))^(−a),  f in cycles a row
//! ```
//!
//! So n has the variance σ² of white noise, and its spectrum follows 1/f^a down to about 1/L: from 4/L on (10⁻³ cycles a row) within 4 % for every a up to 2, from 8/L on within 1 %; below 1/L it is flat. a = 1 is the flicker noise of transistors, a = 2 a
//! random walk. A value depends on the numbers z of L rows alone, which are functions of seed, frame and row: any window has the bits of the whole. The noise of a frame of fewer than L rows is partly an offset of all its rows, new in each frame. Frames are independent.
//! Source: N. J. Kasdin, "Discrete simulation of colored noise and stochastic processes and 1/f^α power law noise generation", Proc. IEEE 83 (5), 1995 (g_j); the factor of j/L, which replaces its cut at L, is ours.

use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Numbers that a value is made of.
pub const LENGTH: usize = 4096;

/// Exponents a of the spectra; 0: white.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct NoiseSpectrum {
    /// Of the row noise along the rows of a frame.
    pub row_exponent: f64,
    /// Of the column offset along the columns of a die.
    pub column_exponent: f64,
}

/// h_j of an exponent, the sum of their squares 1.
fn weights(exponent: f64) -> Vec<f64> {
    let mut weights = Vec::with_capacity(LENGTH);
    let mut g = 1.0;
    for j in 0..LENGTH {
        if j > 0 {
            g *= (j as f64 - 1.0 + 0.5 * exponent) / j as f64;
        }
        let share = j as f64 / LENGTH as f64;
        let taper = 1.0 - share * share;
        weights.push(g * taper * taper);
    }
    let norm = weights.iter().map(|h| h * h).sum::<f64>().sqrt();
    weights.iter_mut().for_each(|h| *h /= norm);
    weights
}

/// n/σ of the places `range`, from z of a place; those before the first place have numbers of their own.
pub fn values(exponent: f64, range: Range<u32>, z: impl Fn(u32) -> f64) -> Vec<f64> {
    if exponent == 0.0 {
        return range.map(z).collect();
    }
    let (before, count) = (LENGTH - 1, range.len());
    let white: Vec<f64> = (0..before + count)
        .map(|k| z(range.start.wrapping_add(k as u32).wrapping_sub(before as u32)))
        .collect();
    let mut sums = vec![0.0; count];
    for (j, h) in weights(exponent).iter().enumerate() {
        // Each sum runs over j ascending, for any range.
        std::iter::zip(&mut sums, &white[before - j..]).for_each(|(sum, z)| *sum += h * z);
    }
    sums
}

/// Mean and standard deviation over dies (or frames) of the variance within `count` neighbouring places, the mean of the squares of their distances from their own mean, of noise of the variance 1:
/// of the correlations R and the matrix H that subtracts the mean, tr(HR)/count and √(2·tr(HRHR))/count.
pub fn variance_within(exponent: f64, count: usize) -> (f64, f64) {
    let h = if exponent == 0.0 { vec![1.0] } else { weights(exponent) };
    let lag = |m: usize| h.iter().zip(h.get(m..).unwrap_or_default()).map(|(a, b)| a * b).sum::<f64>();
    let lags: Vec<f64> = (0..count).map(lag).collect();
    let mean_of = |j: usize| (0..count).map(|i| lags[i.abs_diff(j)]).sum::<f64>() / count as f64;
    let means: Vec<f64> = (0..count).map(mean_of).collect();
    let centred = |i: usize, j: usize| lags[i.abs_diff(j)] - means[j];
    let mean = (0..count).map(|i| centred(i, i)).sum::<f64>() / count as f64;
    let squares = (0..count).map(|i| (0..count).map(|j| centred(i, j) * centred(j, i)).sum::<f64>());
    (mean, (2.0 * squares.sum::<f64>()).sqrt() / count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::real;
    use crate::sensor::quantile::normal_quantile;
    use crate::sensor::random::{Stream, uniform_pair};
    use std::f64::consts::PI;

    fn z(seed: u64) -> impl Fn(u32) -> f64 {
        move |row| normal_quantile(uniform_pair(Stream::Row, row, 0, 0, seed)[0])
    }

    #[test]
    fn a_part_has_the_bits_of_the_whole_and_white_noise_is_the_numbers_themselves() {
        let whole = values(1.0, 0..3000, z(1));
        assert_eq!(values(1.0, 1234..1300, z(1)), whole[1234..1300]);
        assert_eq!(values(0.0, 5..8, z(1)), [5, 6, 7].map(z(1)));
        assert_ne!(values(1.0, 0..3, z(2)), whole[..3]);
    }

    /// Of fractional noise without an end, J. R. M. Hosking, "Fractional differencing", Biometrika 68 (1981): correlation d/(1 − d) of neighbours, d = a/2.
    #[test]
    fn variance_and_correlation_are_those_of_fractional_noise() {
        for exponent in [0.2, 0.5] {
            let h = weights(exponent);
            let lag = |m: usize| h.iter().zip(&h[m..]).map(|(a, b)| a * b).sum::<f64>();
            let d = 0.5 * exponent;
            assert!((lag(0) - 1.0).abs() < 1e-12 && (lag(1) - d / (1.0 - d)).abs() < 4e-3, "{}", lag(1));
        }
        for exponent in [1.0, 2.0] {
            // Places that share no number.
            let of = |k: u32| values(exponent, 5000 * k..5000 * k + 1, z(7))[0];
            let variance = (0..4000).map(|k| of(k) * of(k)).sum::<f64>() / 4000.0;
            assert!((variance - 1.0).abs() < 5.0 * (2.0f64 / 4000.0).sqrt(), "{exponent}: {variance}");
        }
    }

    /// Against 400 frames: four standard errors of their mean; their own deviation to 15 %, four standard errors of about normal ones.
    #[test]
    fn the_variance_within_a_part_is_that_of_many_frames() {
        assert!((variance_within(0.0, 64).0 - 63.0 / 64.0).abs() < 1e-12);
        const FRAMES: u64 = 400;
        for exponent in [0.5, 1.0, 2.0] {
            let (expected, deviation) = variance_within(exponent, 64);
            let of = |frame: u64| {
                let rows = values(exponent, 0..64, z(1000 + frame));
                let mean = rows.iter().sum::<f64>() / 64.0;
                rows.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / 64.0
            };
            let all: Vec<f64> = (0..FRAMES).map(of).collect();
            let n = FRAMES as f64;
            let mean = all.iter().sum::<f64>() / n;
            let spread = (all.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0)).sqrt();
            assert!((mean - expected).abs() < 4.0 * deviation / n.sqrt(), "{exponent}: {mean} {expected}");
            // The tails of a sum of few squares (exponent 2) are wider than normal ones.
            let tolerance = if exponent < 2.0 { 0.15 } else { 0.35 };
            assert!((spread / deviation - 1.0).abs() < tolerance, "{exponent}: {spread} {deviation}");
        }
    }

    /// Mean power in octaves of 128 frames of 1024 rows behind Hann's window, of the power law: standard error 3 %, the window's own error below 3 %.
    #[test]
    fn the_spectrum_is_a_power_law() {
        const N: usize = 1024;
        let window: Vec<f64> =
            (0..N).map(|r| 0.5 - 0.5 * real::cos(2.0 * PI * (r as f64 + 0.5) / N as f64)).collect();
        let wave: Vec<(f64, f64)> = (0..N)
            .map(|k| 2.0 * PI * k as f64 / N as f64)
            .map(|phase| (real::cos(phase), real::sin(phase)))
            .collect();
        for exponent in [0.5, 1.0, 1.5] {
            let norm: f64 = weights(exponent)[0].powi(2) * window.iter().map(|w| w * w).sum::<f64>();
            let mut octaves = [(0.0, 0.0); 6];
            for frame in 0..128 {
                let rows = values(exponent, 0..N as u32, z(100 + frame));
                for (octave, of) in octaves.iter_mut().enumerate() {
                    // Eight frequencies of each octave from 8/N on.
                    for step in 0..8 {
                        let k = (8 + step) << octave;
                        let f = k as f64 / N as f64;
                        let (mut re, mut im) = (0.0, 0.0);
                        for (r, v) in rows.iter().enumerate() {
                            let (cos, sin) = wave[k * r % N];
                            re += window[r] * v * cos;
                            im += window[r] * v * sin;
                        }
                        of.0 += re * re + im * im;
                        of.1 += norm * real::pow(2.0 * real::sin(PI * f), -exponent);
                    }
                }
            }
            for (octave, (got, expected)) in octaves.iter().enumerate() {
                let ratio = got / expected;
                assert!((ratio - 1.0).abs() < 0.13, "1/f^{exponent}, octave {octave}: {ratio}");
            }
        }
    }
}
