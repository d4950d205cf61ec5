//! λ by the discrepancy principle: as smooth as the noise allows, so that film and film of the restored chart differ by the noise.
//!
//! ```text
//! predicted mean square residual   ρ(λ) = Σ_f |Y(f)|² (λ|D|²/(N + λ|D|²))² / Σ w²          Y = F[w (film − mean)], w: a raised cosine over the film part
//! λ:  ρ(λ) = τ σ²                  increases with λ
//! ```
//! The prediction takes the lens to be the same over the part ([`super::local`]). Parts are then restored with the true lens, the mean square residual m is measured, and λ is that of
//! ρ(λ) = τ σ² · ρ/m, until m is within [`CLOSE`] of τ σ². Where pixels have weights λ is found from measured residuals alone ([`next`]).
//!
//! Source: Hansen, Discrete Inverse Problems (SIAM 2010), 5.2 (Morozov's discrepancy principle).

use super::local::LocalSpectrum;
use crate::geometry::Size;
use crate::real;
use std::f64::consts::TAU;

/// Relative difference of the mean square residual from its aim that is left.
pub const CLOSE: f64 = 0.05;
/// λ over the square of the gain: the least, and the most.
pub const LAMBDA: [f64; 2] = [1e-7, 1e3];
/// Power of λ that a residual is taken for where none is known on the other side of its aim, and the largest step of log λ.
const POWER: f64 = 0.3;
const MOST: f64 = 3.5;
/// Halvings of the interval of log λ: to 1e-6 of its value.
const HALVINGS: usize = 26;

/// Powers of a part of a film at the frequencies of a local spectrum.
#[derive(Clone, Debug)]
pub struct PartPower {
    /// N, |D|², and power per pixel of each frequency.
    terms: Vec<[f64; 3]>,
    square_of_gain: f64,
}

impl PartPower {
    /// Of `film` of `size`, which is not larger than the transform of `spectrum`.
    pub fn new(spectrum: &LocalSpectrum, film: &[f32], size: Size) -> Self {
        let mean = film.iter().map(|v| f64::from(*v)).sum::<f64>() / film.len() as f64;
        let window = |k: usize, n: usize| 0.5 - 0.5 * real::cos(TAU * (k as f64 + 0.5) / n as f64);
        let across: Vec<f64> = (0..size.width).map(|x| window(x, size.width)).collect();
        let mut squares = 0.0;
        let mut weighted = Vec::with_capacity(film.len());
        for (y, row) in film.chunks_exact(size.width).enumerate() {
            let down = window(y, size.height);
            for (value, across) in row.iter().zip(&across) {
                let w = down * across;
                squares += w * w;
                weighted.push(w * (f64::from(*value) - mean));
            }
        }
        let (planes, sides) = spectrum.planes();
        let transform = planes.forward(&weighted, size.width);
        let scale = 1.0 / (sides.pixels() as f64 * squares);
        let term = |(i, n, d, count): (usize, f64, f64, f64)| [n, d, count * scale * transform[i].norm_sqr()];
        Self { terms: spectrum.frequencies().map(term).collect(), square_of_gain: spectrum.square_of_gain() }
    }

    /// ρ(λ).
    pub fn residual(&self, lambda: f64) -> f64 {
        let of = |[n, d, power]: &[f64; 3]| power * (lambda * d / (n + lambda * d)).powi(2);
        self.terms.iter().map(of).sum()
    }
}

/// λ at which the mean of ρ over `parts` is `aim`, within [`LAMBDA`] times the square of their gain.
pub fn lambda(parts: &[PartPower], aim: f64) -> f64 {
    let gain2 = parts.iter().map(|part| part.square_of_gain).sum::<f64>() / parts.len() as f64;
    let mean = |lambda: f64| parts.iter().map(|part| part.residual(lambda)).sum::<f64>() / parts.len() as f64;
    let [mut low, mut high] = LAMBDA.map(|lambda| real::log(lambda * gain2));
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        match mean(real::exp(middle)) < aim {
            true => low = middle,
            false => high = middle,
        }
    }
    real::exp(0.5 * (low + high))
}

/// The next λ to try, of residuals (λ, mean square residual over its aim) that were `measured`, which increase with λ: between the nearest two around 1 by interpolation of their logarithms; beyond all by a
/// power of the last.
///
/// # Panics
/// Nothing measured.
pub fn next(measured: &[(f64, f64)]) -> f64 {
    let log = |(lambda, residual): (f64, f64)| (real::log(lambda), real::log(residual.max(1e-12)));
    let logs = || measured.iter().copied().map(log);
    let below = logs().filter(|(_, r)| *r < 0.0).max_by(|a, b| a.0.total_cmp(&b.0));
    let above = logs().filter(|(_, r)| *r >= 0.0).min_by(|a, b| a.0.total_cmp(&b.0));
    real::exp(match (below, above) {
        (Some((low, below)), Some((high, above))) => {
            let share = (-below / (above - below)).clamp(0.1, 0.9);
            low + share * (high - low)
        }
        _ => {
            let (last, residual) = logs().next_back().expect("a residual was measured");
            last - (residual / POWER).clamp(-MOST, MOST)
        }
    })
}
