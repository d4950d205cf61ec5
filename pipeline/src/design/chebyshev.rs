//! Interpolation of smooth functions through Chebyshev points.

use std::f64::consts::PI;

use crate::real;

/// Chebyshev points of the first kind on [a, b], ascending.
pub(super) fn chebyshev(n: usize, a: f64, b: f64) -> Vec<f64> {
    let x = |i: usize| -real::cos(PI * (i as f64 + 0.5) / n as f64);
    (0..n).map(|i| a + (b - a) * 0.5 * (1.0 + x(i))).collect()
}

/// Interpolation through Chebyshev points, in barycentric form (Berrut & Trefethen, SIAM Review 46, 2004).
pub(super) struct Lagrange {
    points: Vec<f64>,
}

/// Interpolation through `n` Chebyshev points on [a, b].
pub(super) fn lagrange(n: usize, a: f64, b: f64) -> Lagrange {
    Lagrange { points: chebyshev(n, a, b) }
}

impl Lagrange {
    /// Weights of the values at the points for the value at `x`.
    pub(super) fn weights(&self, x: f64) -> Vec<f64> {
        let n = self.points.len();
        if let Some(hit) = self.points.iter().position(|p| *p == x) {
            return (0..n).map(|i| if i == hit { 1.0 } else { 0.0 }).collect();
        }
        let mut sum = 0.0;
        let mut w: Vec<f64> = (0..n)
            .map(|i| {
                let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
                let v = sign * real::sin(PI * (i as f64 + 0.5) / n as f64) / (x - self.points[i]);
                sum += v;
                v
            })
            .collect();
        w.iter_mut().for_each(|v| *v /= sum);
        w
    }
}
