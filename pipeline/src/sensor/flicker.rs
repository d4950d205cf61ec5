//! Light that flickers, seen by a sensor whose rows start one after another (rolling shutter).
//!
//! The power of the light is 1 + m cos(2πf(t + t₀)) of its mean, m the modulation, f the frequency (Hz; lamps on mains of 50 Hz: 100 Hz). A row that starts at the time s and is exposed for T collects, of what it would in constant light,
//!
//! ```text
//! mean(s, T) = 1 + m·sinc(fT)·cos(2πf(s + T/2 + t₀)),   sinc(x) = sin(πx)/(πx)       the mean over the exposure
//! ```
//!
//! Row r starts at r·row time after the frame, all rows at once without a row time; the frame k starts when those before it have been exposed and read out. Exposures of whole periods see no flicker.

use crate::real;
use std::f64::consts::PI;

/// A light whose power oscillates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flicker {
    /// Frequency of the power, Hz.
    pub frequency_hz: f64,
    /// m, 0 to 1.
    pub modulation: f64,
    /// t₀: time since a maximum when the first row starts, s.
    pub start_s: f64,
}

impl Flicker {
    /// Mean power over an exposure of `seconds` that begins `start_s` after the first row, of the mean over all times.
    pub fn mean(&self, start_s: f64, seconds: f64) -> f64 {
        let x = PI * self.frequency_hz * seconds;
        let sinc = if x == 0.0 { 1.0 } else { real::sin(x) / x };
        let cycles = self.frequency_hz * (start_s + 0.5 * seconds + self.start_s);
        1.0 + self.modulation * sinc * real::cos(2.0 * PI * (cycles - cycles.floor()))
    }

    /// That of a frame that starts `seconds` later.
    #[must_use]
    pub fn after(self, seconds: f64) -> Self {
        Self { start_s: self.start_s + seconds, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_exposure_sees_the_mean_of_the_power() {
        let light = Flicker { frequency_hz: 100.0, modulation: 0.7, start_s: 0.002 };
        for (start_s, seconds) in [(0.0, 0.001), (0.0034, 0.0061), (1.0, 0.0123)] {
            let power = |k: usize| {
                let t = start_s + seconds * (k as f64 + 0.5) / 1000.0 + light.start_s;
                1.0 + 0.7 * real::cos(2.0 * PI * 100.0 * t)
            };
            let expected = (0..1000).map(power).sum::<f64>() / 1000.0;
            let got = light.mean(start_s, seconds);
            assert!((got - expected).abs() < 1e-5, "{start_s} {seconds}: {got} {expected}");
            assert!((light.after(start_s).mean(0.0, seconds) - got).abs() < 1e-12);
        }
        assert!((light.mean(0.3, 0.02) - 1.0).abs() < 1e-12);
    }
}
