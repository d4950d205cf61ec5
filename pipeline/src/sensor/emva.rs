//! What a laboratory would measure of a sensor: EMVA Standard 1288, Release 4.0 Linear, on frames of uniform light.
//!
//! Temporal variance from the difference of two frames; K (DN/e-) the slope of variance over mean, both above the dark, and the responsivity
//! R [DN/photon] the slope of the mean over photons, fitted through 0 up to 70 % of saturation; QE = R/K. Saturation is the exposure of the
//! greatest variance. Spatial variances are those of the mean of many frames, less the remaining temporal noise. Rounding counts as
//! 1/12 DN², which holds from about 0.5 DN of noise on; below, the standard ends (minimum variance 0.24 DN²) and K is judged more widely.
//! The frames have no row noise, which is not a property of a pixel.
//!
//! Offsets of columns with a spectrum vary less within the frames' columns than over a die: the stated DSNU is that of so many columns, with the standard deviation of it over dies.
//!
//! Raws of companding converters are linearized first. Where rounding and noise of the electronics at a mean are not those of the dark (companding, two conversion gains), the variance of the fit is less by what the description states of the difference:
//! K and QE are measured, the noise of the low gain is not.

use super::figures::Quantity;
use super::noise::Exposer;
use super::power_law::variance_within;
use super::{Exposure, NoiseSet, Sensor};
use crate::geometry::Size;
use rayon::prelude::*;

/// Sides of the frames.
pub const FRAME: Size = Size::new(512, 512);
/// Noises of the frames.
const NOISES: NoiseSet = NoiseSet::ALL.without(NoiseSet::ROW);
/// Exposures of the photon transfer curve.
pub const EXPOSURES: usize = 50;
/// Frames of each spatial measurement.
pub const SPATIAL_FRAMES: u32 = 32;
/// Minimum temporal noise (DN) at which rounding is noise of 1/12 DN².
pub const DITHERED_DN: f64 = 0.49;
/// Minimum variance in the scope of the standard, DN².
const MIN_VARIANCE: f64 = 0.24;
/// First and last exposure as shares of saturation.
const RANGE: (f64, f64) = (0.03, 1.2);
/// Share of saturation up to which lines are fitted.
const FIT: f64 = 0.7;
/// Frame numbers of dark pairs, and the first of the spatial measurements.
const DARK_PAIR: u32 = 0;
const HALF_FRAMES: u32 = 1000;
const DARK_FRAMES: u32 = 2000;

/// One exposure of the photon transfer curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Photons per pixel.
    pub photons: f64,
    /// Mean, DN.
    pub mean_dn: f64,
    /// Temporal variance, DN².
    pub variance_dn2: f64,
}

/// What was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// The photon transfer curve.
    pub points: Vec<Point>,
    /// The same in the dark.
    pub dark: Point,
    /// Conversion, DN/e-.
    pub dn_per_e: f64,
    /// Electrons per photon on a pixel.
    pub quantum_efficiency: f64,
    /// Temporal noise in the dark, e-.
    pub dark_noise_e: f64,
    /// Photons at saturation.
    pub saturation_photons: f64,
    /// Photons that give a signal-to-noise ratio of 1.
    pub threshold_photons: f64,
    /// Dark signal non-uniformity, e-.
    pub dsnu_e: f64,
    /// Photo response non-uniformity.
    pub prnu: f64,
    /// Mean of the spatial frames in the dark, DN, row by row.
    pub dark_mean_frame: Vec<f64>,
    /// Mean of the spatial frames at half saturation, DN.
    pub half_mean_frame: Vec<f64>,
}

/// The same quantities by the sensor's description.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stated {
    /// Conversion, DN/e-.
    pub dn_per_e: f64,
    /// Electrons per photon on a pixel.
    pub quantum_efficiency: f64,
    /// Temporal noise in the dark, e-.
    pub dark_noise_e: f64,
    /// Saturation, e-.
    pub saturation_e: f64,
    /// Dark signal non-uniformity within the frames, e-.
    pub dsnu_e: f64,
    /// Its standard deviation over dies by column offsets with a spectrum, e-; 0 where they are independent.
    pub dsnu_deviation_e: f64,
    /// Photo response non-uniformity.
    pub prnu: f64,
}

/// A sensor under light of one wavelength.
#[derive(Clone, Copy, Debug)]
pub struct Bench<'a> {
    /// The sensor.
    pub sensor: &'a Sensor,
    /// Electrons per photon on a pixel.
    pub quantum_efficiency: f64,
    /// Exposure time, s.
    pub seconds: f64,
    /// Key of frames.
    pub seed: u64,
    /// Key of the die.
    pub die: u64,
}

/// Mean and temporal variance [DN, DN²] of two frames of one scene.
pub fn temporal(a: &[f32], b: &[f32]) -> (f64, f64) {
    let n = a.len() as f64;
    let (mut sums, mut squares) = ([0.0; 2], 0.0);
    for (a, b) in std::iter::zip(a, b) {
        let (a, b) = (f64::from(*a), f64::from(*b));
        sums[0] += a;
        sums[1] += b;
        squares += (a - b) * (a - b);
    }
    let [a, b] = sums.map(|s| s / n);
    ((a + b) / 2.0, squares / n / 2.0 - (a - b) * (a - b) / 2.0)
}

/// Mean frame and spatial variance (DN²) of frames of one scene, less the remaining temporal noise.
pub fn spatial(frames: &[Vec<f32>]) -> (Vec<f64>, f64) {
    let (count, pixels) = (frames.len() as f64, frames[0].len());
    let (mut mean, mut temporal) = (Vec::with_capacity(pixels), 0.0);
    for k in 0..pixels {
        let values = || frames.iter().map(|f| f64::from(f[k]));
        let own = values().sum::<f64>() / count;
        temporal += values().map(|v| (v - own) * (v - own)).sum::<f64>() / (count - 1.0);
        mean.push(own);
    }
    let n = pixels as f64;
    let middle = mean.iter().sum::<f64>() / n;
    let variance = mean.iter().map(|v| (v - middle) * (v - middle)).sum::<f64>() / (n - 1.0);
    (mean, variance - temporal / n / count)
}

impl Bench<'_> {
    /// Linear numbers of a frame.
    fn frame(&self, photons: f64, frame: u32) -> Vec<f32> {
        let exposure = Exposure {
            seconds: self.seconds,
            gain: 1.0,
            scale: 1.0,
            seed: self.seed,
            die: self.die,
            frame,
            noise: NOISES,
            temperature_c: None,
            flicker: None,
        };
        let signal = vec![(photons * self.quantum_efficiency / self.seconds) as f32; FRAME.pixels()];
        let mut raw = vec![0; FRAME.pixels()];
        Exposer::new(self.sensor, &exposure).expose(&signal, FRAME.rect(), &mut raw);
        match self.sensor.adc.linear_table() {
            None => raw.into_iter().map(f32::from).collect(),
            Some(table) => raw.into_iter().map(|v| table[usize::from(v)]).collect(),
        }
    }

    /// Variance by electronics and rounding at an exposure beyond that of the dark, as the description states them, DN².
    fn beyond_dark_dn2(&self, photons: f64) -> f64 {
        let s = self.sensor;
        let dark_e = s.dark_current_e_per_s(None) * self.seconds;
        let of = |charge_e: f64| {
            let variance = s.noise_variance(NOISES, 1.0, charge_e, dark_e);
            variance.frames_e2 + variance.rounding_e2
        };
        let dn_per_e = s.adc.gain_dn_per_e;
        (of(dark_e + photons * self.quantum_efficiency) - of(dark_e)) * dn_per_e * dn_per_e
    }

    fn pair(&self, photons: f64, first: u32) -> Point {
        let (mean_dn, variance_dn2) = temporal(&self.frame(photons, first), &self.frame(photons, first + 1));
        Point { photons, mean_dn, variance_dn2 }
    }

    fn stack(&self, photons: f64, first: u32) -> (Vec<f64>, f64) {
        let frames: Vec<_> =
            (first..first + SPATIAL_FRAMES).into_par_iter().map(|f| self.frame(photons, f)).collect();
        spatial(&frames)
    }

    /// Photons per pixel at saturation by the description.
    fn full_photons(&self) -> f64 {
        self.sensor.saturation_e(1.0) / self.quantum_efficiency
    }

    /// Photons between two exposures.
    pub fn step_photons(&self) -> f64 {
        (RANGE.1 - RANGE.0) / (EXPOSURES - 1) as f64 * self.full_photons()
    }

    /// Distance of the measured saturation from the description's, photons, that shot noise explains: the variance has its greatest value
    /// at the last exposure whose distribution the well does not cut, up to three standard deviations below it, and in steps.
    pub fn saturation_tolerance_photons(&self) -> f64 {
        self.step_photons() + 3.0 * self.sensor.saturation_e(1.0).sqrt() / self.quantum_efficiency
    }

    /// Takes all frames and evaluates them.
    pub fn measure(&self) -> Measured {
        let share = |i: usize| RANGE.0 + (RANGE.1 - RANGE.0) * i as f64 / (EXPOSURES - 1) as f64;
        let points: Vec<Point> = (0..EXPOSURES)
            .into_par_iter()
            .map(|i| self.pair(share(i) * self.full_photons(), 2 * i as u32 + 2))
            .collect();
        let dark = self.pair(0.0, DARK_PAIR);
        let last = (0..EXPOSURES)
            .fold(0, |m, i| if points[i].variance_dn2 > points[m].variance_dn2 { i } else { m });
        let above = |p: &Point| p.mean_dn - dark.mean_dn;
        let fitted: Vec<&Point> =
            points[..=last].iter().filter(|p| above(p) <= FIT * above(&points[last])).collect();
        let slope = |x: &dyn Fn(&Point) -> f64, y: &dyn Fn(&Point) -> f64| {
            let (xy, xx) = fitted.iter().fold((0.0, 0.0), |(xy, xx), p| (xy + x(p) * y(p), xx + x(p) * x(p)));
            xy / xx
        };
        let dn_per_e =
            slope(&above, &|p| p.variance_dn2 - dark.variance_dn2 - self.beyond_dark_dn2(p.photons));
        let quantum_efficiency = slope(&|p| p.photons, &above) / dn_per_e;
        let variance = dark.variance_dn2.max(MIN_VARIANCE);
        let (half_mean_frame, at_half) = self.stack(0.5 * self.full_photons(), HALF_FRAMES);
        let (dark_mean_frame, in_dark) = self.stack(0.0, DARK_FRAMES);
        let mean = |frame: &[f64]| frame.iter().sum::<f64>() / frame.len() as f64;
        Measured {
            dn_per_e,
            quantum_efficiency,
            dark_noise_e: (variance - 1.0 / 12.0).sqrt() / dn_per_e,
            saturation_photons: points[last].photons,
            threshold_photons: (variance.sqrt() / dn_per_e + 0.5) / quantum_efficiency,
            dsnu_e: in_dark.max(0.0).sqrt() / dn_per_e,
            prnu: (at_half - in_dark).max(0.0).sqrt() / (mean(&half_mean_frame) - mean(&dark_mean_frame)),
            points,
            dark,
            dark_mean_frame,
            half_mean_frame,
        }
    }

    /// The quantities by the description.
    pub fn stated(&self) -> Stated {
        let s = self.sensor;
        let dark = s.dark_current_e_per_s(None) * self.seconds;
        let in_dark = s.noise_variance(NOISES, 1.0, dark, dark);
        let exponent = s.noise_spectrum.column_exponent;
        let column_e2 = s.noise.column_offset_e * s.noise.column_offset_e;
        let (share, deviation) = if exponent > 0.0 && column_e2 > 0.0 {
            variance_within(exponent, FRAME.width)
        } else {
            (1.0, 0.0)
        };
        let dsnu_e = (in_dark.fixed_e2 - (1.0 - share) * column_e2).max(0.0).sqrt();
        // Of a charge of light of 1 e-, of which only shares differ between pixels.
        let shares = s
            .noise
            .rows()
            .filter(|(row, _)| matches!(row.quantity, Quantity::LightShare | Quantity::ChargeShare));
        Stated {
            dn_per_e: s.adc.gain_dn_per_e,
            quantum_efficiency: self.quantum_efficiency,
            dark_noise_e: (in_dark.shot_e2 + in_dark.frames_e2).sqrt(),
            saturation_e: s.saturation_e(1.0),
            dsnu_e,
            dsnu_deviation_e: if dsnu_e > 0.0 { 0.5 * deviation * column_e2 / dsnu_e } else { 0.0 },
            prnu: shares.map(|(_, value)| value * value).sum::<f64>().sqrt(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::NoiseFigures;
    use crate::sensor::noise::tests::example;

    /// 1000 e-/s over 10 ms are 10 e-, of which a column gain of 0.1 makes 1 e-.
    #[test]
    fn stated_pattern_in_the_dark_has_the_column_gain_of_the_dark_charge() {
        let mut sensor = example();
        sensor.noise = NoiseFigures { column_gain: 0.1, ..NoiseFigures::default() };
        sensor.pixel.dark_current_e_per_s = 1000.0;
        let stated =
            Bench { sensor: &sensor, quantum_efficiency: 0.5, seconds: 0.01, seed: 1, die: 1 }.stated();
        assert!((stated.dsnu_e - 1.0).abs() < 1e-12 && stated.prnu == 0.1, "{stated:?}");
    }

    /// Offsets of columns of 5 e- with a spectrum, of which a part is the same in all of them: within the stated deviation of the dies.
    #[test]
    fn dsnu_of_columns_with_a_spectrum_is_that_of_so_many_columns() {
        for column_exponent in [0.5, 1.0, 2.0] {
            let mut sensor = example();
            sensor.noise.column_offset_e = 5.0;
            sensor.noise_spectrum.column_exponent = column_exponent;
            let mut deviations = Vec::new();
            for die in 1..=2 {
                let bench = Bench { sensor: &sensor, quantum_efficiency: 0.5, seconds: 0.01, seed: 1, die };
                let stated = bench.stated();
                assert!(stated.dsnu_deviation_e > 0.02 * stated.dsnu_e);
                let got = bench.stack(0.0, DARK_FRAMES).1.sqrt() / sensor.adc.gain_dn_per_e;
                deviations.push((got - stated.dsnu_e) / stated.dsnu_deviation_e);
            }
            assert!(deviations.iter().all(|d| d.abs() < 4.0), "{column_exponent}: {deviations:?}");
        }
    }

    /// Standard errors: a variance of 512² pixels √(2/N) = 0.28 %, over some thirty exposures 0.1 % of K.
    #[test]
    fn what_the_sensor_is_made_of_is_measured() {
        let sensor = example();
        let bench = Bench { sensor: &sensor, quantum_efficiency: 0.5, seconds: 0.01, seed: 1, die: 1 };
        let (got, stated) = (bench.measure(), bench.stated());
        let near = |got: f64, stated: f64, share: f64, what: &str| {
            assert!((got / stated - 1.0).abs() < share, "{what}: {got}, stated {stated}");
        };
        near(got.dn_per_e, stated.dn_per_e, 0.005, "K");
        near(got.quantum_efficiency, 0.5, 0.005, "QE");
        near(got.dark_noise_e, stated.dark_noise_e, 0.01, "dark noise");
        near(got.prnu, stated.prnu, 0.01, "PRNU");
        assert!((got.saturation_photons - 13600.0 / 0.5).abs() <= bench.saturation_tolerance_photons());
    }
}
