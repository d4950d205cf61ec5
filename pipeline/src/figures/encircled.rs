//! Encircled energy of a PSF: the share of all light within a radius of its centroid.
//!
//! Samples near the centroid are interpolated to [`FINE`] points a side each (sinc under a Kaiser window of [`TAPS`] samples to either side, normalised
//! to reproduce constants), the light of the others is spread evenly over [`PARTS`]² parts. For an Airy disc the error is below 1e-3.

use super::{Direction, PsfWindow};
use crate::real;
use std::f64::consts::PI;

/// Samples to either side of the centroid that are interpolated.
const NEAR: i64 = 12;
/// Points of an interpolated sample, a side.
const FINE: i64 = 16;
/// Parts of another sample, a side.
const PARTS: i64 = 4;
/// Half-width of the interpolation, samples.
const TAPS: i64 = 8;
/// Steps of the radius per sample pitch.
const STEPS: f64 = 16.0;

/// Shares of all the light by radius.
#[derive(Clone, Debug)]
pub struct EncircledEnergy {
    step_um: f64,
    /// Shares within 0, 1, 2, … steps, up to the nearest edge of the window.
    curve: Vec<f64>,
}

impl EncircledEnergy {
    /// The share within `radius_um` of the centroid; none for a radius that reaches beyond the window.
    pub fn within(&self, radius_um: f64) -> Option<f64> {
        let place = radius_um / self.step_um;
        let next = self.curve.get(place as usize + 1)?;
        let first = self.curve[place as usize];
        Some(first + place.fract() * (next - first))
    }

    /// The radius in µm that has the share `share`; none if the window has less.
    pub fn radius_um(&self, share: f64) -> Option<f64> {
        let k = self.curve.iter().position(|v| *v >= share)?.max(1);
        let (low, high) = (self.curve[k - 1], self.curve[k]);
        Some((k as f64 - 1.0 + (share - low) / (high - low)) * self.step_um)
    }
}

impl PsfWindow {
    /// Its encircled energy.
    pub fn encircled(&self) -> EncircledEnergy {
        EncircledEnergy { step_um: self.pitch_um / STEPS, curve: self.encircled_curve() }
    }

    /// Shares within 0, 1, 2, … steps of the radius, up to the nearest edge of the window.
    fn encircled_curve(&self) -> Vec<f64> {
        let n = self.size as i64;
        let at = |i: i64| (i - n / 2) as f64;
        let line = self.line(Direction::Sagittal);
        let centre = (
            self.centroid_um() / self.pitch_um,
            line.iter().enumerate().map(|(i, v)| v * at(i as i64)).sum::<f64>(),
        );
        let edge = n as f64 / 2.0 - centre.0.abs().max(centre.1.abs());
        let mut light = vec![0.0; (edge * STEPS).max(0.0) as usize + 1];
        // A part is inside a circle by the share (step − place) of its width, one step: exact where the circle is straight.
        let mut add = |x: f64, y: f64, v: f64| {
            let (dx, dy) = (x - centre.0, y - centre.1);
            let place = ((dx * dx + dy * dy).sqrt() * STEPS - 0.5).max(0.0);
            let (step, rest) = (place as usize + 1, place.fract());
            for (step, v) in [(step, v * (1.0 - rest)), (step + 1, v * rest)] {
                if let Some(light) = light.get_mut(step) {
                    *light += v;
                }
            }
        };
        let middle = (centre.0.round() as i64 + n / 2, centre.1.round() as i64 + n / 2);
        let is_near = |i: i64, middle: i64| (i - middle).abs() <= NEAR;
        for (y, x) in (0..n).flat_map(|y| (0..n).map(move |x| (y, x))) {
            if is_near(x, middle.0) && is_near(y, middle.1) {
                continue;
            }
            let v = f64::from(self.samples[(y * n + x) as usize]) / (PARTS * PARTS) as f64;
            for (j, i) in (0..PARTS).flat_map(|j| (0..PARTS).map(move |i| (j, i))) {
                add(at(x) + within(i, PARTS), at(y) + within(j, PARTS), v);
            }
        }
        let sides = |middle: i64| (middle - NEAR).max(0)..(middle + NEAR + 1).min(n);
        let weights: Vec<Vec<f64>> = (0..FINE).map(|i| interpolation(within(i, FINE))).collect();
        // Rows first: at each fine x of each row that is needed.
        let columns = sides(middle.0);
        let fine_row = |y: i64| -> Vec<f64> {
            let sample = |x: i64| match (0..n).contains(&x) && (0..n).contains(&y) {
                true => f64::from(self.samples[(y * n + x) as usize]),
                false => 0.0,
            };
            let value = |x: i64, w: &Vec<f64>| (-TAPS..=TAPS).zip(w).map(|(k, w)| w * sample(x + k)).sum();
            columns.clone().flat_map(|x| weights.iter().map(move |w| value(x, w))).collect()
        };
        let rows = sides(middle.1);
        let first = rows.start - TAPS;
        let fine: Vec<Vec<f64>> = (first..rows.end + TAPS).map(fine_row).collect();
        for y in rows {
            for (j, w) in weights.iter().enumerate() {
                for (i, x) in
                    columns.clone().flat_map(|x| (0..FINE).map(move |i| at(x) + within(i, FINE))).enumerate()
                {
                    let taps = (-TAPS..=TAPS).zip(w);
                    let v: f64 = taps.map(|(k, w)| w * fine[(y + k - first) as usize][i]).sum();
                    add(x, at(y) + within(j as i64, FINE), v / (FINE * FINE) as f64);
                }
            }
        }
        let mut inside = 0.0;
        light
            .iter()
            .map(|v| {
                inside += v * self.energy;
                inside
            })
            .collect()
    }
}

/// Middle of part `i` of `parts` of a sample, from its middle.
fn within(i: i64, parts: i64) -> f64 {
    (i as f64 + 0.5) / parts as f64 - 0.5
}

/// Weights of the samples −TAPS to TAPS at `u` from sample 0.
fn interpolation(u: f64) -> Vec<f64> {
    let weight = |k: i64| {
        let x = u - k as f64;
        let sinc = if x == 0.0 { 1.0 } else { real::sin(PI * x) / (PI * x) };
        let inside = 1.0 - (x / (TAPS as f64 + 0.5)).powi(2);
        sinc * real::bessel_i0(6.0 * inside.max(0.0).sqrt())
    };
    let all: Vec<f64> = (-TAPS..=TAPS).map(weight).collect();
    let sum: f64 = all.iter().sum();
    all.into_iter().map(|w| w / sum).collect()
}
