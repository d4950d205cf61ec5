//! What one frame is taken with, and the time that a percentile of its pixels fits.

use super::figures::NoiseSet;
use super::flicker::Flicker;
use super::model::Sensor;

/// What one frame is taken with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Time, s.
    pub seconds: f64,
    /// Gain of the converter.
    pub gain: f64,
    /// Scale κ of a relative film.
    pub scale: f64,
    /// Key of the frame's noises.
    pub seed: u64,
    /// Key of the die's noises.
    pub die: u64,
    /// Number of the frame.
    pub frame: u32,
    /// Noises that are on.
    pub noise: NoiseSet,
    /// Temperature, °C; the reference's if none.
    pub temperature_c: Option<f64>,
    /// Flicker of the light, from the start of the frame's first row on; none: it is constant.
    pub flicker: Option<Flicker>,
}

/// Bits of an f32 that name its bin: sign, exponent and 11 bits of the fraction.
const BIN_SHIFT: u32 = 12;

/// Counts of a signal's values by the first 20 bits of their f32: sums of counts do not depend on an order.
#[derive(Clone, Debug)]
pub struct SignalHistogram {
    counts: Vec<u64>,
    all: u64,
}

impl Default for SignalHistogram {
    fn default() -> Self {
        Self { counts: vec![0; 1 << (32 - BIN_SHIFT - 1)], all: 0 }
    }
}

impl SignalHistogram {
    /// Counts values; those below 0 count as 0.
    pub fn add(&mut self, signal: &[f32]) {
        for value in signal {
            let value = if *value > 0.0 { *value } else { 0.0 };
            self.counts[(value.to_bits() >> BIN_SHIFT) as usize] += 1;
        }
        self.all += signal.len() as u64;
    }

    /// Adds the counts of another.
    pub fn merge(&mut self, other: &Self) {
        std::iter::zip(&mut self.counts, &other.counts).for_each(|(own, n)| *own += n);
        self.all += other.all;
    }

    /// Bin of the value at a percentile: nearest rank, upwards.
    fn bin(&self, percentile: f64) -> u32 {
        let rank = ((percentile / 100.0 * self.all as f64).ceil() as u64).min(self.all).max(1);
        let mut below = 0;
        let found = self.counts.iter().position(|n| {
            below += n;
            below >= rank
        });
        found.unwrap_or(0) as u32
    }

    /// Upper edge of the bin at a percentile, e-/s; 0 in the dark.
    pub fn value_at(&self, percentile: f64) -> f64 {
        match self.bin(percentile) {
            0 => 0.0,
            bin => f32::from_bits((bin + 1) << BIN_SHIFT).into(),
        }
    }

    /// Seconds for which `percentile` of the pixels stay below `fill` of saturation; `None` in the dark.
    pub fn seconds(&self, sensor: &Sensor, gain: f64, scale: f64, fill: f64, percentile: f64) -> Option<f64> {
        let top = self.value_at(percentile) * scale;
        (top > 0.0).then(|| fill * sensor.saturation_e(gain) / top)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_of_nearest_rank_and_in_any_order() {
        let values: Vec<f32> = (1..=1000).map(|i| i as f32).collect();
        let (mut whole, mut parts) = (SignalHistogram::default(), SignalHistogram::default());
        whole.add(&values);
        for part in values.chunks(37).rev() {
            let mut one = SignalHistogram::default();
            one.add(part);
            parts.merge(&one);
        }
        for p in [0.1, 50.0, 99.9, 100.0] {
            assert_eq!(whole.value_at(p), parts.value_at(p));
            let exact = (p / 100.0 * 1000.0f64).ceil();
            assert!(whole.value_at(p) > exact && whole.value_at(p) <= exact * (1.0 + 2f64.powi(-10)), "{p}");
        }
        let mut dark = SignalHistogram::default();
        dark.add(&[0.0, -1.0]);
        assert_eq!(dark.value_at(99.9), 0.0);
    }
}
