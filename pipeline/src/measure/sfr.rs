//! Modulation transfer function (MTF) from an edge: e-SFR (ISO 12233).
//!
//! ```text
//! LSF(u) = dESF/du,   MTF(f) = |∫ LSF(u)·w(u)·exp(−2πi·f·u) du| / |∫ LSF(u)·w(u) du|
//! ```
//! The derivative is a central difference over 2 bins and a bin is a mean over its width Δ; both are corrected:
//! ```text
//! MTF /= sinc(2·f·Δ)·sinc(f·Δ),   sinc(x) = sin(πx)/(πx).
//! ```
//! w is 1 with a cosine taper over the outer quarter, so that a PSF inside the flat part keeps its width (a Hamming
//! window over 32 px narrows a line of σ = 1 px by 0.9 %).

use super::edge::{Esf, OVERSAMPLING};
use crate::real;
use std::f64::consts::{PI, TAU};

/// A modulation transfer function.
#[derive(Clone, Debug, PartialEq)]
pub struct Mtf {
    /// Cycles per film pixel, ascending from 0; 0.5 is the film's Nyquist frequency.
    pub frequency_cy_px: Vec<f64>,
    /// Modulation, 1 at frequency 0.
    pub modulation: Vec<f64>,
}

/// Largest frequency, cycles per pixel.
const MAX_CY_PX: f64 = 1.0;
/// Number of frequency steps.
const STEPS: usize = 200;

/// The line spread function of values 1/4 px apart: the central difference, per film pixel; the ends are 0.
pub fn line_spread(esf: &[f64]) -> Vec<f64> {
    let mut lsf = vec![0.0; esf.len()];
    for i in 1..esf.len().saturating_sub(1) {
        lsf[i] = (esf[i + 1] - esf[i - 1]) * OVERSAMPLING / 2.0;
    }
    lsf
}

impl Mtf {
    /// The MTF of an edge.
    pub fn from_esf(esf: &Esf) -> Self {
        Self::from_values(&esf.uniform())
    }

    /// The MTF of ESF values 1/4 px apart, the middle one on the edge.
    pub fn from_values(esf: &[f64]) -> Self {
        let lsf = line_spread(esf);
        let half = (lsf.len() - 1) as f64 / 2.0;
        let windowed: Vec<f64> = lsf
            .iter()
            .enumerate()
            .map(|(i, v)| {
                let distance = (i as f64 - half).abs() / half;
                v * if distance <= 0.75 { 1.0 } else { 0.5 + 0.5 * real::cos(PI * (distance - 0.75) / 0.25) }
            })
            .collect();
        let frequency_cy_px: Vec<f64> = (0..=STEPS).map(|i| MAX_CY_PX * i as f64 / STEPS as f64).collect();
        let magnitude = |f: f64| {
            let (mut re, mut im) = (0.0, 0.0);
            for (i, v) in windowed.iter().enumerate() {
                let (sin, cos) = real::sin_cos(TAU * f * (i as f64 - half) / OVERSAMPLING);
                (re, im) = (re + v * cos, im + v * sin);
            }
            real::hypot(re, im)
        };
        let total = magnitude(0.0);
        let corrected =
            |&f: &f64| magnitude(f) / total / (sinc(2.0 * f / OVERSAMPLING) * sinc(f / OVERSAMPLING));
        Self { modulation: frequency_cy_px.iter().map(corrected).collect(), frequency_cy_px }
    }

    /// The lowest frequency at which the modulation falls to 1/2, cycles per pixel; `None` if it stays above.
    pub fn mtf50_cy_px(&self) -> Option<f64> {
        mtf50_cy_px(&self.frequency_cy_px, &self.modulation)
    }
}

/// The lowest frequency at which a curve of ascending frequencies falls to 1/2, between two of them; `None` if it stays above, or begins below.
pub fn mtf50_cy_px(frequency_cy_px: &[f64], modulation: &[f64]) -> Option<f64> {
    let i = modulation.iter().position(|m| *m < 0.5)?;
    let before = i.checked_sub(1)?;
    let (a, b) = (modulation[before], modulation[i]);
    let (fa, fb) = (frequency_cy_px[before], frequency_cy_px[i]);
    Some(fa + (fb - fa) * (a - 0.5) / (a - b))
}

fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-9 { 1.0 } else { real::sin(PI * x) / (PI * x) }
}

#[cfg(test)]
mod tests {
    use super::super::edge::{EdgeLine, tests};
    use super::*;
    use crate::geometry::Rect;

    #[test]
    fn mtf_of_a_gaussian_edge_is_analytic() {
        let rect = Rect::new(0, 0, 140, 120);
        for sigma in [0.7, 1.0, 1.8] {
            let line = EdgeLine { at_px: (70.3, 60.1), normal_rad: 5f64.to_radians() };
            let pixels = tests::edge(rect, line, sigma);
            let at = |y: i64, x: i64| Some(line.distance((y as f64, x as f64)));
            let esf = Esf::new(&pixels, rect, 20.0, at).unwrap().normalised(14.0).unwrap();
            let mtf = Mtf::from_esf(&esf);
            let expected = (2f64.ln() / 2.0).sqrt() / (PI * sigma);
            let got = mtf.mtf50_cy_px().unwrap();
            assert!((got / expected - 1.0).abs() < 5e-3, "σ {sigma}: {got} for {expected}");
            assert_eq!(mtf.frequency_cy_px.len(), mtf.modulation.len());
            for (f, m) in mtf.frequency_cy_px.iter().zip(&mtf.modulation).take_while(|(f, _)| **f <= 0.5) {
                let truth = (-2.0 * (PI * sigma * f).powi(2)).exp();
                assert!((m - truth).abs() < 4e-3, "σ {sigma}, {f} cy/px: {m} for {truth}");
            }
        }
    }
}
