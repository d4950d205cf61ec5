//! Variance of a pixel's charge by its sources of noise: what signal-to-noise ratios, thresholds and dynamic range are computed from.
//!
//! Of a mean charge N (e-, of which the dark charge is D) and the conversion gK (DN/e-) at the gain of the exposure:
//!
//! ```text
//! temporal (e-²)  = N + read² + reset² + row² + (adc² + 1/12)/(gK)²
//! fixed (e-²)     = DSNU² + column offset² + (PRNU·(N − D))² + (DCNU·D)² + (column gain·N)²
//! ```
//!
//! The first differs between frames, the second between pixels of a die; 1/12 DN² is the rounding to whole DN. A noise that is off has no share.
//! Source: EMVA 1288 Release 4.0 Linear, section 2, with the terms of rows and columns that this sensor has.
//! Left out: saturation, which reduces the variance near white.

use super::{NoiseSet, Sensor};

/// Variance of a pixel's charge, e-².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseVariance {
    /// Over frames, rounding included.
    pub temporal_e2: f64,
    /// Over the pixels of a die: the fixed patterns.
    pub fixed_e2: f64,
}

impl NoiseVariance {
    /// Over frames and pixels.
    pub fn total_e2(self) -> f64 {
        self.temporal_e2 + self.fixed_e2
    }
}

impl Sensor {
    /// Variance at a mean charge of `charge_e`, of which `dark_e` is dark charge, by the noises that are `on`.
    pub fn noise_variance(&self, on: NoiseSet, gain: f64, charge_e: f64, dark_e: f64) -> NoiseVariance {
        let (n, dn_per_e) = (&self.noise, gain * self.adc.gain_dn_per_e);
        let square = |noise: NoiseSet, sigma: f64| on.on(noise, sigma).powi(2);
        let shot = on.on(NoiseSet::SHOT, charge_e);
        let converter = square(NoiseSet::ADC, n.adc_noise_dn) + 1.0 / 12.0;
        NoiseVariance {
            temporal_e2: shot
                + square(NoiseSet::READ, n.read_noise_e)
                + square(NoiseSet::RESET, n.reset_noise_e)
                + square(NoiseSet::ROW, n.row_noise_e)
                + converter / (dn_per_e * dn_per_e),
            fixed_e2: square(NoiseSet::DSNU, n.dsnu_e)
                + square(NoiseSet::COLUMN, n.column_offset_e)
                + square(NoiseSet::PRNU, n.prnu * (charge_e - dark_e).max(0.0))
                + square(NoiseSet::DARK, n.dark_nonuniformity * dark_e)
                + square(NoiseSet::COLUMN, n.column_gain * charge_e),
        }
    }
}
