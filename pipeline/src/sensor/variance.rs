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
//! The first three differ between frames, the last between pixels of a die; 1/12 DN² is the rounding to whole DN. A noise that is off has no share.
//! The terms are the rows of [`NoiseFigures::TABLE`](super::figures::NoiseFigures::TABLE).
//! Source: EMVA 1288 Release 4.0 Linear, section 2, with the terms of rows and columns that this sensor has.
//! Left out: saturation, which reduces the variance near white.

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
        NoiseVariance {
            shot_e2: on.on(NoiseSet::SHOT, charge_e),
            frames_e2: sum_e2(Over::Frames),
            rounding_e2: 1.0 / 12.0 / (dn_per_e * dn_per_e),
            fixed_e2: sum_e2(Over::Die),
        }
    }
}
