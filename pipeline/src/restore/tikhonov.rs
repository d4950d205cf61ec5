//! The smoothest chart that agrees with a film: Tikhonov's regularisation, solved by conjugate gradients with a preconditioner.
//!
//! ```text
//! minimise over the free pixels d of x = start + d        Σ w (A x − film)² + λ ‖D x‖²
//! (AᵀwA + λ DᵀD) d = Aᵀw(film − A start) − λ DᵀD start       D: first differences of rows and columns inside the chart, px⁻¹
//! ```
//! λ has the unit of the square of film values per chart value. The solver ends when the largest |P⁻¹ r| is at most the tolerance: r is the residual of the equation and P⁻¹ nearly
//! the inverse of its matrix ([`super::local`]), so that this is nearly the largest error of a pixel.
//!
//! Left out: bounds of the values; restored pixels may be negative. Source: Saad, Iterative Methods for Sparse Linear Systems (SIAM 2003), 9.2.

use super::local::LocalSpectrum;
use super::{Part, Restored};
use crate::flow::SourceSinkError;
use crate::geometry::Size;

/// How exactly it is solved.
#[derive(Clone, Copy, Debug)]
pub struct Stop {
    /// Estimated error of a pixel.
    pub tolerance: f64,
    /// Iterations, at most.
    pub max_iterations: usize,
}

/// Restores `part` with `lambda`.
///
/// # Errors
/// Those of the operator.
pub fn restore(
    part: &Part<'_>,
    spectrum: &LocalSpectrum,
    lambda: f64,
    stop: Stop,
) -> Result<Restored, SourceSinkError> {
    let matrix = |x: &[f64]| -> Result<Vec<f64>, SourceSinkError> {
        let mut film = part.film_of(x)?;
        part.weigh(&mut film);
        let mut out = part.back(&film)?;
        add_smoothness(part, lambda, x, &mut out);
        Ok(out)
    };
    let precondition = |r: &[f64]| spectrum.inverse_at(lambda, r, part.free);
    let mut residual = {
        let mut film = part.film_of(part.start)?;
        film.iter_mut().zip(part.film).for_each(|(found, film)| *found = film - *found);
        part.weigh(&mut film);
        let mut r = part.back(&film)?;
        add_smoothness(part, -lambda, part.start, &mut r);
        r
    };
    let mut z = precondition(&residual);
    let mut along = z.clone();
    let mut power = dot(&residual, &z);
    let mut d = vec![0.0; residual.len()];
    let (mut iterations, mut converged) = (0, largest(&z) <= stop.tolerance);
    while !converged && iterations < stop.max_iterations && power > 0.0 {
        let image = matrix(&along)?;
        let step = power / dot(&along, &image);
        d.iter_mut().zip(&along).for_each(|(d, p)| *d += step * p);
        residual.iter_mut().zip(&image).for_each(|(r, q)| *r -= step * q);
        z = precondition(&residual);
        iterations += 1;
        converged = largest(&z) <= stop.tolerance;
        let next = dot(&residual, &z);
        along.iter_mut().zip(&z).for_each(|(p, z)| *p = z + next / power * *p);
        power = next;
    }
    let chart = part.start.iter().zip(&d).map(|(start, d)| start + d).collect();
    Ok(Restored { chart, iterations, converged })
}

/// Adds λ DᵀD `chart` at the free pixels.
pub(super) fn add_smoothness(part: &Part<'_>, lambda: f64, chart: &[f64], out: &mut [f64]) {
    let Size { height, width } = part.operator.chart();
    for (i, to) in out.iter_mut().enumerate().filter(|(i, _)| part.free[*i]) {
        let (y, x, here) = (i / width, i % width, chart[i]);
        let mut sum = 0.0;
        if x > 0 {
            sum += here - chart[i - 1];
        }
        if x + 1 < width {
            sum += here - chart[i + 1];
        }
        if y > 0 {
            sum += here - chart[i - width];
        }
        if y + 1 < height {
            sum += here - chart[i + width];
        }
        *to += lambda * sum;
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub(super) fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m, v| m.max(v.abs()))
}
