//! Restoration: from a film back to the chart that its lens made it of, tile by tile, with the lens's own linear map.
//!
//! ```text
//! film = A chart + noise          A: remap (relative illumination, distortion), PSFs of every place of the field; noise of RMS σ, independent from pixel to pixel
//! Tikhonov          chart = argmin  Σ w (A x − film)² + λ Σ (∂x/∂row)² + (∂x/∂column)²                      [`tikhonov`]
//! total variation   chart = argmin  ½ Σ w (A x − film)² + μ Σ |∇x|                                          [`total_variation`]
//! Richardson-Lucy   x ← x · Aᵀ(w film/(A x)) / Aᵀw,   x ≥ 0                                                 [`richardson_lucy`]
//! ```
//! over the *free* pixels of a tile; the pixels around them keep their start values, an estimate such as the film itself without distortion, so that light from outside a tile is
//! accounted for before the tile is restored. w is 1 at film pixels that show free pixels, else 0; of a raw, σ² over the variance of the pixel there, and 0 at pixels behind other filters and at
//! saturated ones: what is not measured is what agrees with the rest.
//!
//! λ is one for all tiles of a band, and is what makes the residual that of the noise, Σ (A x − film)² = τ n σ² ([`discrepancy`]). [`local`] has the spectrum of AᵀA near
//! a place, which preconditions the solver and predicts the residual; [`noise`] estimates σ of a film; [`mosaic`] has the picture behind one filter of a mosaic; [`places`] has the start values; [`blend`] puts tiles together; [`response`] measures what the
//! complete map from a chart by its film to the restored chart does to a point.
//!
//! A and Aᵀ are those of an [`Operator`], in memory: the film of a small chart ([`crate::stages`]) and its transpose ([`crate::adjoint`]).
//!
//! Conventions: arrays row-major; charts on the ideal image plane with the film's pitch. Vectors of solvers in f64, arrays of operators in f32.
//!
//! Left out: noise of films that depends on the signal, several bands together, priors other than smoothness, surfaces at several distances, unknown or wrong PSFs. Sources: Hansen,
//! Discrete Inverse Problems (SIAM 2010), 4.3 and 5.2 (Tikhonov, discrepancy principle); Bertero and Boccacci, Introduction to Inverse Problems in Imaging (IOP 1998), 7.3
//! (Richardson-Lucy).

pub mod blend;
pub mod discrepancy;
pub mod local;
pub mod mosaic;
pub mod noise;
pub mod places;
pub mod response;
pub mod richardson_lucy;
pub mod tikhonov;
pub mod total_variation;

#[cfg(test)]
mod tests;

use crate::flow::SourceSinkError;
use crate::geometry::{Rect, Size};

/// The linear map from a chart to its film, and its transpose.
pub trait Operator {
    /// Size of its charts.
    fn chart(&self) -> Size;

    /// Size of its films.
    fn film(&self) -> Size;

    /// The film of `chart`, which overwrites `film`.
    ///
    /// # Errors
    /// It cannot be computed, or was cancelled.
    fn apply(&self, chart: &[f32], film: &mut [f32]) -> Result<(), SourceSinkError>;

    /// The transpose of `film`, which overwrites `chart`.
    ///
    /// # Errors
    /// As [`Operator::apply`].
    fn transpose(&self, film: &[f32], chart: &mut [f32]) -> Result<(), SourceSinkError>;
}

/// A part of a film to be restored.
#[derive(Clone, Copy)]
pub struct Part<'a> {
    /// Its linear map.
    pub operator: &'a dyn Operator,
    /// Pixels of the film.
    pub film: &'a [f32],
    /// Film pixels whose residual counts.
    pub used: Rect,
    /// w of each film pixel, where it is not 1 for all used ones: the reference variance over the pixel's; 0: not measured.
    pub weights: Option<&'a [f32]>,
    /// Variance of the noise that does not depend on the light, over the film value of an electron: of films of photons with such noise.
    pub background: f32,
    /// Start values of the chart; pixels that are not free keep them.
    pub start: &'a [f64],
    /// Chart pixels that are free.
    pub free: &'a [bool],
}

/// A restored part.
#[derive(Clone, Debug)]
pub struct Restored {
    /// Pixels of the chart.
    pub chart: Vec<f64>,
    /// Iterations that it took.
    pub iterations: usize,
    /// Whether the tolerance was reached, if there is one.
    pub converged: bool,
}

impl Part<'_> {
    /// A x.
    ///
    /// # Errors
    /// Those of the operator.
    pub fn film_of(&self, chart: &[f64]) -> Result<Vec<f32>, SourceSinkError> {
        let chart: Vec<f32> = chart.iter().map(|v| *v as f32).collect();
        let mut film = vec![0.0; self.operator.film().pixels()];
        self.operator.apply(&chart, &mut film)?;
        Ok(film)
    }

    /// Aᵀ of `film`, at the free pixels, 0 elsewhere.
    fn back(&self, film: &[f32]) -> Result<Vec<f64>, SourceSinkError> {
        let mut chart = vec![0.0; self.operator.chart().pixels()];
        self.operator.transpose(film, &mut chart)?;
        Ok(chart.iter().zip(self.free).map(|(v, free)| if *free { f64::from(*v) } else { 0.0 }).collect())
    }

    /// w times `film`: 0 outside the used pixels.
    fn weigh(&self, film: &mut [f32]) {
        let (width, used) = (self.operator.film().width, self.used);
        for (row, y) in film.chunks_exact_mut(width).zip(0..) {
            if (used.y..used.bottom()).contains(&y) {
                row[..used.x as usize].fill(0.0);
                row[used.right() as usize..].fill(0.0);
            } else {
                row.fill(0.0);
            }
        }
        for (value, weight) in film.iter_mut().zip(self.weights.into_iter().flatten()) {
            *value *= weight;
        }
    }

    /// As [`Part::weigh`], with 1 for every weight that is not 0.
    fn mask(&self, film: &mut [f32]) {
        Part { weights: None, ..*self }.weigh(film);
        for (value, weight) in film.iter_mut().zip(self.weights.into_iter().flatten()) {
            *value *= f32::from(u8::from(*weight > 0.0));
        }
    }

    /// Σ w (A x − film)² over the film pixels of `rect`, and the number of them that are measured.
    ///
    /// # Errors
    /// Those of the operator.
    pub fn square_residual(&self, chart: &[f64], rect: Rect) -> Result<(f64, usize), SourceSinkError> {
        Ok(self.square_difference(&self.film_of(chart)?, rect))
    }

    /// [`Part::square_residual`] of `found` in place of A x.
    fn square_difference(&self, found: &[f32], rect: Rect) -> (f64, usize) {
        let width = self.operator.film().width;
        let (mut sum, mut measured) = (0.0, 0);
        for y in rect.y..rect.bottom() {
            let first = y as usize * width + rect.x as usize;
            let of_row = |i: usize| {
                let weight = self.weights.map_or(1.0, |weights| f64::from(weights[i]));
                (weight, weight * (f64::from(found[i]) - f64::from(self.film[i])).powi(2))
            };
            let row = (first..first + rect.width).map(of_row);
            let (of_sum, of_count) =
                row.fold((0.0, 0), |(sum, n), (w, square)| (sum + square, n + usize::from(w > 0.0)));
            sum += of_sum;
            measured += of_count;
        }
        (sum, measured)
    }
}
