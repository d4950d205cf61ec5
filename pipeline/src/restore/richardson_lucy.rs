//! Richardson and Lucy's iteration: the non-negative chart that photons of a film are most likely from, stopped before it follows their noise.
//!
//! ```text
//! x ← x · Aᵀ(w film⁺/(A x + b)) / Aᵀw        at the free pixels;   film⁺ = max(film + b, 0);   w: 1, or 0 where nothing is measured
//! ```
//! b is the variance of the noise that does not depend on the light over the film value of an electron: n electrons with read noise σ have, with σ² added, nearly the mean and variance of
//! Poisson numbers (Snyder, Hammoud and White, J. Opt. Soc. Am. A 10, 1014 (1993)). Once a pixel is not negative it stays so. With A of a PSF whose light sums to 1, w = 1, b = 0 and all pixels free, Σ A x is Σ film after every step. The number of steps regularises: more of
//! them resolve finer detail, with more noise and rings beside edges.
//!
//! Left out: a known background, acceleration. Source: Richardson, J. Opt. Soc. Am. 62, 55 (1972); Lucy, Astron. J. 79, 745 (1974).

use super::{Part, Restored};
use crate::flow::SourceSinkError;

/// The least start value and divisor, of the largest: a pixel at 0 would stay there.
const LEAST: f64 = 1e-6;

/// The start, and w's transpose: what all steps share.
#[derive(Clone, Debug)]
pub struct Iteration {
    chart: Vec<f64>,
    /// Aᵀw.
    weights: Vec<f64>,
    least: f64,
    iterations: usize,
}

impl Iteration {
    /// Begins to restore `part`.
    ///
    /// # Errors
    /// Those of the operator.
    pub fn new(part: &Part<'_>) -> Result<Self, SourceSinkError> {
        let least = LEAST * part.start.iter().fold(0.0, |m: f64, v| m.max(*v));
        let mut ones = vec![1.0; part.film.len()];
        part.mask(&mut ones);
        let weights = part.back(&ones)?;
        let chart = part.start.iter().map(|v| v.max(least)).collect();
        Ok(Self { chart, weights, least, iterations: 0 })
    }

    /// One step.
    ///
    /// # Errors
    /// Those of the operator.
    pub fn step(&mut self, part: &Part<'_>) -> Result<(), SourceSinkError> {
        let mut ratio = part.film_of(&self.chart)?;
        let least = (self.least as f32).max(f32::MIN_POSITIVE);
        let b = part.background;
        ratio
            .iter_mut()
            .zip(part.film)
            .for_each(|(found, film)| *found = (film + b).max(0.0) / (*found + b).max(least));
        part.mask(&mut ratio);
        let back = part.back(&ratio)?;
        let heaviest = self.weights.iter().fold(0.0, |m: f64, v| m.max(*v));
        for (i, x) in self.chart.iter_mut().enumerate().filter(|(i, _)| part.free[*i]) {
            // A pixel that no used film pixel shows keeps its value.
            if self.weights[i] > LEAST * heaviest {
                *x *= (back[i] / self.weights[i]).max(0.0);
            }
        }
        self.iterations += 1;
        Ok(())
    }

    /// The chart so far.
    pub fn chart(&self) -> &[f64] {
        &self.chart
    }

    /// Steps so far.
    pub fn iterations(&self) -> usize {
        self.iterations
    }
}

/// Restores `part` in `iterations` steps.
///
/// # Errors
/// Those of the operator.
pub fn restore(part: &Part<'_>, iterations: usize) -> Result<Restored, SourceSinkError> {
    let mut iteration = Iteration::new(part)?;
    for _ in 0..iterations {
        iteration.step(part)?;
    }
    Ok(Restored { chart: iteration.chart, iterations, converged: true })
}
