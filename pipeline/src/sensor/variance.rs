//! Variance of a pixel's charge by its sources of noise: what signal-to-noise ratios, thresholds and dynamic range are computed from.
//!
//! Of a mean charge N (e-, of which the dark charge is D) and the conversion gK (DN/e-) at the gain of the exposure:
//!
//! ```text
//! shot (e-²)      = N
//! frames (e-²)    = read² + reset² + row² + (adc/gK)²
//! rounding (e-²)  = 1/12/(gK)²
//! fixed (e-²)     = DSNU² + column offset² + (PRNU·(N − D))² + (DCNU·D)² + (column gain·N)²
//! ```
//!
//! A companded number has rounding²/12 of the linear numbers of a coded one; of two conversion gains, read and adc are those of the reading at the mean charge, and mixed in its transition:
//!
//! ```text
//! frames   = reset² + row² + (1 − w)²·(read² + (adc/gK)²) + w²·(read_low² + (ρ·adc/gK)²)      w: share of the low gain at the mean
//! rounding = (q² + s² − gcd(q, s)²)/12/(gK)²,   q² = (1 − w)² + w²ρ²                          s: linear numbers of a coded one (1 without a curve); gcd 0 if one is not whole
//! ```
//!
//! The first three differ between frames, the last between pixels of a die; 1/12 DN² is the rounding to whole DN. A noise that is off has no share.
//! The terms are the rows of [`NoiseFigures::TABLE`](super::figures::NoiseFigures::TABLE).
//! Source: EMVA 1288 Release 4.0 Linear, section 2, with the terms of rows and columns that this sensor has.
//! Left out: saturation, which reduces the variance near white; the dependence of w on the noise of the reading, within a transition and next to it.

use super::figures::{NoiseSet, Over, Quantity};
use super::model::Sensor;

/// Variance of a pixel's charge, e-².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseVariance {
    /// Photons and dark charge over frames.
    pub shot_e2: f64,
    /// Over frames by the electronics.
    pub frames_e2: f64,
    /// Rounding to whole DN.
    pub rounding_e2: f64,
    /// Over the pixels of a die: the fixed patterns.
    pub fixed_e2: f64,
}

impl NoiseVariance {
    /// Over frames, rounding included.
    pub fn temporal_e2(self) -> f64 {
        self.shot_e2 + self.frames_e2 + self.rounding_e2
    }

    /// Over frames and pixels.
    pub fn total_e2(self) -> f64 {
        self.temporal_e2() + self.fixed_e2
    }
}

impl Sensor {
    /// Variance at a mean charge of `charge_e`, of which `dark_e` is dark charge, by the noises that are `on`.
    pub fn noise_variance(&self, on: NoiseSet, gain: f64, charge_e: f64, dark_e: f64) -> NoiseVariance {
        let dn_per_e = gain * self.adc.gain_dn_per_e;
        let sum_e2 = |over: Over| -> f64 {
            let rows = self.noise.switched(on).rows().filter(|(row, _)| row.over == over);
            let sigma_e = rows.map(|(row, value)| match row.quantity {
                Quantity::Charge => value,
                Quantity::Number => value / dn_per_e,
                Quantity::LightShare => value * (charge_e - dark_e).max(0.0),
                Quantity::DarkShare => value * dark_e,
                Quantity::ChargeShare => value * charge_e,
            });
            sigma_e.map(|sigma| sigma * sigma).sum()
        };
        let noiseless_dn = self.adc.black_dn + dn_per_e * charge_e;
        let (excess_e2, reading_dn2) = match &self.adc.dual_gain {
            None => (0.0, None),
            Some(dual) => {
                let w = dual.share(noiseless_dn);
                let (high_share, low_share) = ((1.0 - w) * (1.0 - w), w * w);
                let sigma = self.noise.switched(on);
                let of = |read_e: f64, adc_e: f64| read_e * read_e + adc_e * adc_e;
                let high_e2 = of(sigma.read_noise_e, sigma.adc_noise_dn / dn_per_e);
                let low_e2 =
                    of(on.on(NoiseSet::READ, dual.read_noise_e), dual.ratio * sigma.adc_noise_dn / dn_per_e);
                let excess_e2 = (high_share - 1.0) * high_e2 + low_share * low_e2;
                (excess_e2, Some(high_share + low_share * dual.ratio * dual.ratio))
            }
        };
        let step_dn = self.adc.companding.as_ref().map(|curve| curve.step_dn(noiseless_dn));
        let rounding_dn2 = match (reading_dn2, step_dn) {
            (None, step) => step.map_or(1.0, |step| step * step),
            (Some(reading), step) => {
                let (reading_step, step) = (reading.sqrt(), step.unwrap_or(1.0));
                let common = common_divisor(reading_step, step);
                reading + step * step - common * common
            }
        };
        NoiseVariance {
            shot_e2: on.on(NoiseSet::SHOT, charge_e),
            frames_e2: sum_e2(Over::Frames) + excess_e2,
            rounding_e2: rounding_dn2 / 12.0 / (dn_per_e * dn_per_e),
            fixed_e2: sum_e2(Over::Die),
        }
    }
}

/// Greatest common divisor of two whole numbers; 0 if one is not whole.
fn common_divisor(a: f64, b: f64) -> f64 {
    if a.fract() != 0.0 || b.fract() != 0.0 {
        return 0.0;
    }
    let (mut a, mut b) = (a as u64, b as u64);
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a as f64
}
