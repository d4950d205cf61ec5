//! The chart of the least total variation that agrees with a film: plateaus and edges rather than slopes; by alternating directions.
//!
//! ```text
//! minimise over the free pixels of x      ½ Σ w (A x − film)² + μ Σ |∇x|        |∇x|: root of the squares of the differences to the next row and the next column
//! x ← argmin ½ Σ w (A x − film)² + ρ/2 ‖D x − z + u‖²       (AᵀwA + ρ DᵀD) x = Aᵀw film + ρ Dᵀ(z − u), a few conjugate gradients from the x before
//! z ← v max(0, 1 − κ/|v|),  u ← v − z                       v = α D x + (1 − α) z + u,  κ = μ/ρ
//! ```
//! μ has the unit of film value squared per chart value. κ, a difference of chart values, and α only decide how fast it converges: κ begins at 0.1 of the largest start value, with which plateaus
//! are found in fewer steps, and is halved three times, with which their values are; y = ρ u stays as it is. A x and AᵀwA x are kept, so that a step costs as many A and Aᵀ as conjugate gradients, and the residual nothing.
//!
//! Left out: differences of second order; small details of low contrast become plateaus. Source: Rudin, Osher and Fatemi, Physica D 60, 259 (1992); Boyd et al., Foundations and Trends in
//! Machine Learning 3, 1 (2011), 3, 3.4.3 (relaxation) and 4.3 (alternating direction method of multipliers, solved inexactly).

use super::local::LocalSpectrum;
use super::tikhonov::{Stop, add_smoothness, dot, largest};
use super::{Part, Restored};
use crate::flow::SourceSinkError;
use crate::geometry::{Rect, Size};

/// κ over the largest start value; how often it is halved, and after how many steps.
const STEP: f64 = 0.1;
const HALVINGS: usize = 3;
const HALVED_AFTER: usize = 100;
/// Conjugate gradients of a step: with more, as many steps are needed.
const GRADIENTS: usize = 2;
/// α: with 1, twice as many steps are needed.
const RELAXATION: f64 = 1.8;
/// Steps with changes below the tolerance that end it.
const STILL: usize = 2;

/// The state between two steps.
#[derive(Clone, Debug)]
pub struct Iteration {
    chart: Vec<f64>,
    /// A x.
    image: Vec<f32>,
    /// Aᵀw film − AᵀwA x, at the free pixels.
    residual: Vec<f64>,
    /// z and u: down, then across.
    target: [Vec<f64>; 2],
    scaled: [Vec<f64>; 2],
    mu: f64,
    kappa: f64,
    iterations: usize,
}

impl Iteration {
    /// Begins to restore `part` with the weight `mu`.
    ///
    /// # Errors
    /// Those of the operator.
    pub fn new(part: &Part<'_>, mu: f64) -> Result<Self, SourceSinkError> {
        let image = part.film_of(part.start)?;
        let mut difference: Vec<f32> = part.film.iter().zip(&image).map(|(film, of)| film - of).collect();
        part.weigh(&mut difference);
        let residual = part.back(&difference)?;
        let zero = || [vec![0.0; part.start.len()], vec![0.0; part.start.len()]];
        let kappa = (STEP * part.start.iter().fold(0.0, |m: f64, v| m.max(*v))).max(f64::MIN_POSITIVE);
        let mut first = Self {
            chart: part.start.to_vec(),
            image,
            residual,
            target: zero(),
            scaled: zero(),
            mu,
            kappa,
            iterations: 0,
        };
        first.shrink(part.operator.chart());
        Ok(first)
    }

    /// Another weight from here on.
    pub fn set_mu(&mut self, mu: f64) {
        let ratio = self.mu / mu;
        self.scaled.iter_mut().flatten().for_each(|u| *u *= ratio);
        self.mu = mu;
    }

    /// One step; the largest change of a pixel.
    ///
    /// # Errors
    /// Those of the operator.
    pub fn step(&mut self, part: &Part<'_>, spectrum: &LocalSpectrum) -> Result<f64, SourceSinkError> {
        let (size, rho) = (part.operator.chart(), self.mu / self.kappa);
        // The residual of the equation of x: −ρ Dᵀ(D x − z + u) in addition.
        let mut residual = self.residual.clone();
        add_smoothness(part, -rho, &self.chart, &mut residual);
        let pull: [Vec<f64>; 2] = std::array::from_fn(|axis| {
            self.target[axis].iter().zip(&self.scaled[axis]).map(|(z, u)| z - u).collect()
        });
        for (i, to) in residual.iter_mut().enumerate().filter(|(i, _)| part.free[*i]) {
            *to += rho * transposed_differences(&pull, size, i);
        }
        let precondition = |r: &[f64]| spectrum.inverse_at(rho, r, part.free);
        let before = self.chart.clone();
        let mut along = precondition(&residual);
        let mut power = dot(&residual, &along);
        for k in 0..GRADIENTS {
            if power <= 0.0 {
                break;
            }
            let mut film = part.film_of(&along)?;
            let image = film.clone();
            part.weigh(&mut film);
            let mut normal = part.back(&film)?;
            let of_film = normal.clone();
            add_smoothness(part, rho, &along, &mut normal);
            let length = power / dot(&along, &normal);
            self.chart.iter_mut().zip(&along).for_each(|(x, p)| *x += length * p);
            self.image.iter_mut().zip(&image).for_each(|(x, p)| *x += length as f32 * p);
            self.residual.iter_mut().zip(&of_film).for_each(|(r, q)| *r -= length * q);
            residual.iter_mut().zip(&normal).for_each(|(r, q)| *r -= length * q);
            if k + 1 < GRADIENTS {
                let z = precondition(&residual);
                let next = dot(&residual, &z);
                along.iter_mut().zip(&z).for_each(|(p, z)| *p = z + next / power * *p);
                power = next;
            }
        }
        self.shrink(size);
        self.iterations += 1;
        if self.iterations.is_multiple_of(HALVED_AFTER) && self.iterations <= HALVINGS * HALVED_AFTER {
            self.kappa *= 0.5;
            self.scaled.iter_mut().flatten().for_each(|u| *u *= 0.5);
        }
        let changes: Vec<f64> = self.chart.iter().zip(&before).map(|(now, before)| now - before).collect();
        Ok(largest(&changes))
    }

    /// z and u of x.
    fn shrink(&mut self, size: Size) {
        for i in 0..self.chart.len() {
            let next = differences(&self.chart, size, i);
            let v: [f64; 2] = std::array::from_fn(|axis| {
                RELAXATION * next[axis] + (1.0 - RELAXATION) * self.target[axis][i] + self.scaled[axis][i]
            });
            let length = (v[0] * v[0] + v[1] * v[1]).sqrt();
            let keep = (1.0 - self.kappa / length.max(self.kappa)).max(0.0);
            for (v, (z, u)) in v.into_iter().zip(self.target.iter_mut().zip(&mut self.scaled)) {
                z[i] = keep * v;
                u[i] = v - keep * v;
            }
        }
    }

    /// Σ w (A x − film)² over the film pixels of `rect`, and the number of them that are measured.
    pub fn square_residual(&self, part: &Part<'_>, rect: Rect) -> (f64, usize) {
        part.square_difference(&self.image, rect)
    }

    /// The chart so far.
    pub fn chart(&self) -> &[f64] {
        &self.chart
    }
}

/// Restores `part` with the weight `mu`; `stop.tolerance`: the change of a pixel in a step.
///
/// # Errors
/// Those of the operator.
pub fn restore(
    part: &Part<'_>,
    spectrum: &LocalSpectrum,
    mu: f64,
    stop: Stop,
) -> Result<Restored, SourceSinkError> {
    let mut iteration = Iteration::new(part, mu)?;
    let mut still = 0;
    while still < STILL && iteration.iterations < stop.max_iterations {
        let change = iteration.step(part, spectrum)?;
        still = if change <= stop.tolerance { still + 1 } else { 0 };
    }
    Ok(Restored { converged: still == STILL, iterations: iteration.iterations, chart: iteration.chart })
}

/// Differences from pixel `i` to the next row and the next column; 0 at the border.
fn differences(chart: &[f64], Size { height, width }: Size, i: usize) -> [f64; 2] {
    let down = if i / width + 1 < height { chart[i + width] - chart[i] } else { 0.0 };
    let across = if i % width + 1 < width { chart[i + 1] - chart[i] } else { 0.0 };
    [down, across]
}

/// Dᵀ of differences (down, across) at pixel `i`.
fn transposed_differences([down, across]: &[Vec<f64>; 2], Size { height, width }: Size, i: usize) -> f64 {
    let (y, x) = (i / width, i % width);
    let mut sum = 0.0;
    if y > 0 {
        sum += down[i - width];
    }
    if y + 1 < height {
        sum -= down[i];
    }
    if x > 0 {
        sum += across[i - 1];
    }
    if x + 1 < width {
        sum -= across[i];
    }
    sum
}
