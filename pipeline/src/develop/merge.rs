//! Frames of several exposure times as one frame of a wider range: the light of each pixel from all frames in which it is not full.
//!
//! Of the frame k with the time t_k, shortest first, n_k = (raw_k − black)/(g·K) electrons; σ_k² (e-²) the variance over frames of a pixel without light, r the rate (e-/s):
//!
//! ```text
//! u_k      = 1 for the shortest frame; of others 1 up to r₍k₋₁₎·t_k = limit/2, falling to 0 at 0.95 limit, and 0 where raw_k is above 0.98 limit
//! r₍k₎     = Σ u_i n_i / Σ u_i t_i                                           frames up to k: maximum likelihood of Poisson numbers
//! r        = Σ w_k n_k/t_k / Σ w_k,    w_k = u_k t_k²/(max(r₍last₎, 0)·t_k + σ_k²)   inverse variances
//! merged   = black + g·K·r·t                                                 DN; t: time of the frame whose brightness the picture has
//! ```
//!
//! Of two conversion gains σ_k² is that of the one that the charge r₍last₎·t_k is read with, and in their transition (1 − w)²·σ_high² + w²·σ_low² ([`crate::sensor::dual_gain`]); rounding is that of whole numbers of each gain.
//!
//! limit: saturation, or the knee of the full well, above which charge is not that of the light. The share u of a frame follows from shorter frames and falls slowly: a choice by the frame's own noise, or at a step, would bias the mean
//! (here by less than 1.5·10⁻³ where the shorter frame has a noise of 2 %). After M. Granados et al., "Optimal HDR reconstruction with linear digital cameras", CVPR 2010, in one step. Dark charge is part of the rate, as in a single frame.

use crate::sensor::dual_gain::share;

/// Predicted shares of the limit between which a frame's own share falls; found one above which it is not used.
const PREDICTED: (f64, f64) = (0.5, 0.95);
const FOUND: f64 = 0.98;

/// What the frames of a bracket have in common, and their times.
#[derive(Clone, Debug, PartialEq)]
pub struct Bracket {
    /// Exposure times, s, shortest first.
    pub times_s: Vec<f64>,
    /// Time of the frame whose brightness the merged one has, s.
    pub reference_s: f64,
    /// Digital number of no light.
    pub black_dn: f64,
    /// Digital numbers per electron.
    pub dn_per_e: f64,
    /// Charge up to which digital numbers are those of the light, e-.
    pub limit_e: f64,
    /// Variance over frames of a dark pixel, e-².
    pub dark_variance_e2: f64,
    /// The low conversion gain of pixels that are read with two.
    pub low_gain: Option<LowGain>,
}

/// Pixels that the low one of two conversion gains is used for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LowGain {
    /// Digital numbers between which its share rises from 0 to 1.
    pub transition_dn: (f64, f64),
    /// Variance over frames without light, e-².
    pub dark_variance_e2: f64,
}

impl Bracket {
    /// Ratio of the range of the merged frame to that of a single one of the reference's time.
    pub fn range(&self) -> f64 {
        let shortest_s = self.times_s.first().copied().unwrap_or(self.reference_s);
        (self.reference_s / shortest_s).max(1.0)
    }

    /// Digital numbers of the merged frame from those of the frames, shortest first.
    ///
    /// # Panics
    /// If there is not a frame for each time, or they differ in length.
    pub fn merged(&self, frames: &[Vec<f32>]) -> Vec<f32> {
        assert!(frames.len() == self.times_s.len() && !frames.is_empty());
        assert!(frames.iter().all(|frame| frame.len() == frames[0].len()));
        let mut electrons = vec![0.0; frames.len()];
        let of = |pixel: usize| {
            for (n, frame) in electrons.iter_mut().zip(frames) {
                *n = (f64::from(frame[pixel]) - self.black_dn) / self.dn_per_e;
            }
            (self.black_dn + self.dn_per_e * self.rate_e_per_s(&electrons) * self.reference_s) as f32
        };
        (0..frames[0].len()).map(of).collect()
    }

    /// σ_k² of a number of so many electrons.
    fn variance_without_light_e2(&self, electrons: f64) -> f64 {
        let Some(low) = self.low_gain else { return self.dark_variance_e2 };
        let w = share(low.transition_dn, self.black_dn + self.dn_per_e * electrons);
        (1.0 - w) * (1.0 - w) * self.dark_variance_e2 + w * w * low.dark_variance_e2
    }

    /// r of the electrons of each frame.
    fn rate_e_per_s(&self, electrons: &[f64]) -> f64 {
        let (mut sum_e, mut sum_s) = (electrons[0], self.times_s[0]);
        let mut shares = vec![1.0];
        for (n, seconds) in electrons.iter().zip(&self.times_s).skip(1) {
            let predicted = sum_e / sum_s * seconds / self.limit_e;
            let share = ((PREDICTED.1 - predicted) / (PREDICTED.1 - PREDICTED.0)).min(1.0);
            if share <= 0.0 || *n >= FOUND * self.limit_e {
                // Longer ones are full as well.
                break;
            }
            (sum_e, sum_s) = (sum_e + share * n, sum_s + share * seconds);
            shares.push(share);
        }
        let rate = (sum_e / sum_s).max(0.0);
        let frames = electrons.iter().zip(&self.times_s).zip(&shares);
        let (value, weight) = frames.fold((0.0, 0.0), |(value, weight), ((n, seconds), share)| {
            let variance =
                (rate * seconds + self.variance_without_light_e2(rate * seconds)).max(f64::MIN_POSITIVE);
            let w = share * seconds * seconds / variance;
            (value + w * n / seconds, weight + w)
        });
        value / weight
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bracket(times_s: &[f64]) -> Bracket {
        Bracket {
            times_s: times_s.into(),
            reference_s: times_s[times_s.len() - 1],
            black_dn: 64.0,
            dn_per_e: 0.5,
            limit_e: 10_000.0,
            dark_variance_e2: 9.0,
            low_gain: None,
        }
    }

    /// Digital numbers of a rate without noise.
    fn frames(of: &Bracket, rate: f64) -> Vec<Vec<f32>> {
        let dn = |t: &f64| of.black_dn + of.dn_per_e * (rate * t).min(of.limit_e);
        of.times_s.iter().map(|t| vec![dn(t) as f32]).collect()
    }

    #[test]
    fn rates_beyond_the_range_of_one_frame_are_found() {
        let of = bracket(&[0.001, 0.004, 0.016, 0.064]);
        assert_eq!(of.range(), 64.0);
        for rate in [0.0, 10.0, 1e4, 1.5e5, 6e5, 2.4e6, 9.9e6] {
            let merged = f64::from(of.merged(&frames(&of, rate))[0]);
            let expected = of.black_dn + of.dn_per_e * rate * 0.064;
            assert!((merged / expected - 1.0).abs() < 1e-6, "{rate}: {merged} {expected}");
        }
        // Full in all frames: the limit of the shortest.
        let merged = f64::from(of.merged(&frames(&of, 1e9))[0]);
        assert!((merged - (64.0 + 0.5 * 1e4 * 64.0)).abs() < 0.1);
    }

    #[test]
    fn weights_are_inverse_variances() {
        let of = bracket(&[0.01, 0.04]);
        // Bright: as if both were one frame of 50 ms; dark: by the squares of the times.
        let rate = of.rate_e_per_s(&[1000.0, 3900.0]);
        assert!((rate - 4900.0 / 0.05).abs() < 30.0, "{rate}");
        let dark = Bracket { dark_variance_e2: 1e9, ..of };
        let rate = dark.rate_e_per_s(&[10.0, 20.0]);
        assert!((rate - (1.0 * 1000.0 + 16.0 * 500.0) / 17.0).abs() < 0.1, "{rate}");
    }

    /// A dark variance that makes the shorter frame worthless where it is read with the low gain, and counts it where not.
    #[test]
    fn frames_are_weighed_by_the_gain_that_they_were_read_with() {
        // 1064 DN are 2000 e-.
        let low_gain = LowGain { transition_dn: (1064.0, 1164.0), dark_variance_e2: 1e9 };
        let of = Bracket { dark_variance_e2: 0.0, low_gain: Some(low_gain), ..bracket(&[0.01, 0.02]) };
        // Both below: as one frame of 30 ms. The longer one above: the shorter one alone.
        for (electrons, expected) in [([900.0, 1980.0], 2880.0 / 0.03), ([1500.0, 3300.0], 150_000.0)] {
            let rate = of.rate_e_per_s(&electrons);
            assert!((rate / expected - 1.0).abs() < 1e-4, "{electrons:?}: {rate} {expected}");
        }
        // In the middle of the transition a quarter of the variance, beside which the other's is nothing.
        assert_eq!(of.variance_without_light_e2(2100.0), 0.25e9);
        assert_eq!([1999.0, 2201.0].map(|n| of.variance_without_light_e2(n)), [0.0, 1e9]);
    }

    /// The mean over noise is that of the light, also where a frame ends.
    #[test]
    fn the_choice_of_frames_does_not_bias_the_mean() {
        let step = LowGain { transition_dn: (1064.0, 1064.0), dark_variance_e2: 1e4 };
        let mut state = 1u64;
        let mut normal = || {
            let uniform = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1u64 << 53) as f64
            };
            std::iter::repeat_with(uniform).take(12).sum::<f64>() - 6.0
        };
        const N: usize = 40_000;
        let none = [3e4, 1.2e5, 1.8e5, 2.2e5, 2.4e5, 2.6e5, 4e5].map(|rate| (None, rate));
        // Two gains that change at 2000 e-.
        let two = [4.9e4, 5e4, 5.1e4, 1.9e5, 2e5].map(|rate| (Some(step), rate));
        for (low_gain, rate) in none.into_iter().chain(two) {
            let of = Bracket { low_gain, ..bracket(&[0.01, 0.04]) };
            let mut sum = 0.0;
            for _ in 0..N {
                let electrons = of.times_s.clone().into_iter().map(|t| {
                    let n: f64 = rate * t;
                    (n + n.sqrt() * normal()).min(1e4)
                });
                sum += of.rate_e_per_s(&electrons.collect::<Vec<_>>());
            }
            // The standard error is at most 3e-4.
            let ratio = sum / N as f64 / rate;
            assert!((ratio - 1.0).abs() < 1.5e-3, "{rate}: {ratio}");
        }
    }
}
