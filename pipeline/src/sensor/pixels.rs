//! Where sensor pixels lie on the film: weights of the film's pixels in the mean over a sensor pixel's aperture, along one axis.
//!
//! A film pixel is the mean over its square, so the running integral of the film is known exactly at its pixels' edges. Between edges it is
//! cubic Hermite with slopes from the mean of the two neighbouring pixels, or linear ("area": the film constant over a pixel). Both keep
//! the light. Where edges coincide the weights are those of the plain mean, and of a sensor with the film's pitch the film itself: the aperture
//! of a film pixel is never applied twice.

use crate::real;
use std::f64::consts::PI;
use thiserror::Error;

/// How the running integral is interpolated between the film's pixel edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Resample {
    /// Cubic Hermite.
    #[default]
    Cubic,
    /// Linear.
    Area,
}

/// Distances below this share of a film pixel are rounding.
const SAME_EDGE: f64 = 1e-9;

/// A sensor that the film does not hold.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("the sensor reaches from {from_mm:.4} to {to_mm:.4} mm, the film from 0 to {film_mm:.4} mm")]
pub struct BeyondFilm {
    /// First edge of the sensor from the film's first edge, mm.
    pub from_mm: f64,
    /// Its last edge.
    pub to_mm: f64,
    /// Length of the film.
    pub film_mm: f64,
}

/// Along one axis: the film and the sensor on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Film pixels.
    pub film_px: usize,
    /// Film pitch, µm.
    pub film_pitch_um: f64,
    /// Sensor pixels.
    pub sensor_px: usize,
    /// Sensor pitch, µm.
    pub pitch_um: f64,
    /// Side of a sensor pixel's aperture, µm.
    pub aperture_um: f64,
    /// Middle of the sensor from the middle of the film, µm.
    pub centre_um: f64,
}

impl Axis {
    /// Film pixels per sensor pixel.
    pub fn ratio(&self) -> f64 {
        self.pitch_um / self.film_pitch_um
    }

    /// Whether that is a whole number.
    pub fn is_whole(&self) -> bool {
        (self.ratio() - self.ratio().round()).abs() <= SAME_EDGE
    }

    /// The same axis with the centre moved by at most half a film pixel so that pixel edges coincide, where the ratio is whole.
    #[must_use]
    pub fn snapped(self) -> Self {
        if !self.is_whole() {
            return self;
        }
        let edge = (self.centre_um - self.sensor_px as f64 * self.pitch_um / 2.0) / self.film_pitch_um
            + self.film_px as f64 / 2.0;
        Self { centre_um: self.centre_um + ((edge + 0.5).floor() - edge) * self.film_pitch_um, ..self }
    }

    /// Weights of the film's pixels in each sensor pixel of `sensor`.
    ///
    /// # Errors
    /// The whole sensor's apertures reach beyond the film.
    pub fn taps(&self, sensor: std::ops::Range<usize>, resample: Resample) -> Result<Taps, BeyondFilm> {
        let n = self.film_px as f64;
        let half = self.aperture_um / self.film_pitch_um / 2.0;
        let middle = |i: usize| {
            ((i as f64 - (self.sensor_px as f64 - 1.0) / 2.0) * self.pitch_um + self.centre_um)
                / self.film_pitch_um
                + n / 2.0
        };
        let (from, to) = (middle(0) - half, middle(self.sensor_px - 1) + half);
        if from < -SAME_EDGE || to > n + SAME_EDGE {
            let mm = self.film_pitch_um * 1e-3;
            return Err(BeyondFilm { from_mm: from * mm, to_mm: to * mm, film_mm: n * mm });
        }
        let mut taps = Taps { first: Vec::new(), start: vec![0], weights: Vec::new() };
        for i in sensor {
            let ends = [middle(i) - half, middle(i) + half].map(|x| Edge::new(x, self.film_px));
            let low = ends[0].pixel.saturating_sub(1);
            let high = (ends[1].pixel + 1).min(self.film_px - 1);
            let weight = |j| (ends[1].below(j, resample) - ends[0].below(j, resample)) / (2.0 * half);
            let all: Vec<f64> = (low..=high).map(weight).collect();
            let skip = all.iter().take_while(|w| **w == 0.0).count().min(all.len() - 1);
            let end = all.len() - all[skip + 1..].iter().rev().take_while(|w| **w == 0.0).count();
            taps.first.push(low + skip);
            taps.weights.extend(&all[skip..end]);
            taps.start.push(taps.weights.len());
        }
        Ok(taps)
    }
}

/// A position on the film's axis: a pixel and the share of it before the position.
struct Edge {
    pixel: usize,
    share: f64,
    pixels: usize,
}

impl Edge {
    fn new(x: f64, pixels: usize) -> Self {
        let whole = x.round();
        let x = if (x - whole).abs() < SAME_EDGE { whole } else { x };
        let x = x.clamp(0.0, pixels as f64);
        let pixel = (x.floor() as usize).min(pixels - 1);
        Self { pixel, share: x - pixel as f64, pixels }
    }

    /// Weight of film pixel `j` in the integral from the film's first edge to here.
    fn below(&self, j: usize, resample: Resample) -> f64 {
        let is = |k: usize| f64::from(u8::from(j == k));
        let (t, own) = (self.share, is(self.pixel));
        let whole = f64::from(u8::from(j < self.pixel));
        if resample == Resample::Area {
            return whole + own * t;
        }
        let left = is(self.pixel.saturating_sub(1));
        let right = is((self.pixel + 1).min(self.pixels - 1));
        let rise = (3.0 - 2.0 * t) * t * t;
        let (first, last) = (((t - 2.0) * t + 1.0) * t, (t - 1.0) * t * t);
        whole + own * rise + (left * 0.5 + own * 0.5) * first + (own * 0.5 + right * 0.5) * last
    }
}

/// Weights of consecutive film pixels for each of some sensor pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Taps {
    first: Vec<usize>,
    start: Vec<usize>,
    weights: Vec<f64>,
}

impl Taps {
    /// Sensor pixels.
    pub fn len(&self) -> usize {
        self.first.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.first.is_empty()
    }

    /// First film pixel and weights of sensor pixel `i`.
    pub fn of(&self, i: usize) -> (usize, &[f64]) {
        (self.first[i], &self.weights[self.start[i]..self.start[i + 1]])
    }

    /// Film pixels of sensor pixel `i`.
    pub fn range(&self, i: usize) -> std::ops::Range<usize> {
        self.first[i]..self.first[i] + self.start[i + 1] - self.start[i]
    }

    /// Film pixels of the sensor pixels `of`.
    pub fn span(&self, of: std::ops::Range<usize>) -> std::ops::Range<usize> {
        if of.is_empty() {
            return 0..0;
        }
        let end = of.clone().map(|i| self.range(i).end).max().unwrap_or(0);
        self.first[of.start]..end
    }

    /// Whether every sensor pixel is one film pixel, in a row.
    pub fn is_copy(&self) -> bool {
        self.weights.len() == self.len() && self.weights.iter().all(|w| *w == 1.0)
    }
}

/// Places of the sensor's first edge between two film edges that [`nyquist_error`] looks at.
const SHIFTS: usize = 16;

/// Largest error of a cosine of full modulation at the sensor's Nyquist frequency, `ratio` film pixels a sensor pixel, of any phase and any
/// place of the sensor: the distance of its mean over the aperture from the true one. Where all edges coincide there is none.
pub fn nyquist_error(ratio: f64, resample: Resample) -> f64 {
    let shifts = (0..SHIFTS).map(|k| k as f64 / SHIFTS as f64);
    shifts.map(|shift| nyquist_error_at(ratio, shift, resample)).fold(0.0, f64::max)
}

fn nyquist_error_at(ratio: f64, shift: f64, resample: Resample) -> f64 {
    const SENSOR_PX: usize = 32;
    let film_px = ((SENSOR_PX as f64 + 10.0) * ratio).ceil() as usize;
    let edge = (4.0 * ratio).ceil() + shift;
    let axis = Axis {
        film_px,
        film_pitch_um: 1.0,
        sensor_px: SENSOR_PX,
        pitch_um: ratio,
        aperture_um: ratio,
        centre_um: edge + SENSOR_PX as f64 * ratio / 2.0 - film_px as f64 / 2.0,
    };
    let Ok(taps) = axis.taps(0..SENSOR_PX, resample) else { return f64::NAN };
    let sinc = |x: f64| real::sin(PI * x) / (PI * x);
    let step = PI / ratio;
    let worst = (8..SENSOR_PX - 8).map(|i| {
        let middle = edge + (i as f64 + 0.5) * ratio;
        let (first, weights) = taps.of(i);
        let part = |phase: f64| {
            let film = |j: usize| sinc(0.5 / ratio) * real::cos(step * (j as f64 + 0.5 - middle) + phase);
            let got: f64 = weights.iter().enumerate().map(|(k, w)| w * film(first + k)).sum();
            got - sinc(0.5) * real::cos(phase)
        };
        real::hypot(part(0.0), part(PI / 2.0))
    });
    worst.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests;
