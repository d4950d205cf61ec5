//! Interpolation of smooth functions through Chebyshev points.

use std::f64::consts::PI;

use crate::real;

/// Chebyshev points of the first kind on [a, b], ascending.
pub(in crate::design) fn chebyshev(n: usize, a: f64, b: f64) -> Vec<f64> {
    let x = |i: usize| -real::cos(PI * (i as f64 + 0.5) / n as f64);
    (0..n).map(|i| a + (b - a) * 0.5 * (1.0 + x(i))).collect()
}

/// Interpolation through Chebyshev points, in barycentric form (Berrut & Trefethen, SIAM Review 46, 2004).
pub(in crate::design) struct Lagrange {
    points: Vec<f64>,
    scales: Vec<f64>,
}

/// Interpolation through `n` Chebyshev points on [a, b].
pub(in crate::design) fn lagrange(n: usize, a: f64, b: f64) -> Lagrange {
    let sign = |i: usize| if i.is_multiple_of(2) { 1.0 } else { -1.0 };
    let scale = |i: usize| sign(i) * real::sin(PI * (i as f64 + 0.5) / n as f64);
    Lagrange { points: chebyshev(n, a, b), scales: (0..n).map(scale).collect() }
}

impl Lagrange {
    /// Weights of the values at the points for the value at `x`.
    pub(in crate::design) fn weights(&self, x: f64) -> Vec<f64> {
        if let Some(hit) = self.points.iter().position(|p| *p == x) {
            return (0..self.points.len()).map(|i| if i == hit { 1.0 } else { 0.0 }).collect();
        }
        let mut w: Vec<f64> = self.scales.iter().zip(&self.points).map(|(s, p)| s / (x - p)).collect();
        let sum: f64 = w.iter().sum();
        w.iter_mut().for_each(|v| *v /= sum);
        w
    }
}
