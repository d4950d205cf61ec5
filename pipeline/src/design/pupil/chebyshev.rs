//! Interpolation of smooth functions through Chebyshev points.

use std::borrow::Cow;
use std::f64::consts::PI;
use std::sync::OnceLock;

use crate::real;

/// Points of fewer are computed once.
const KEPT: usize = 257;

/// Chebyshev points of the first kind on [−1, 1], ascending, and the scales of their barycentric weights.
fn points(n: usize) -> Cow<'static, [(f64, f64)]> {
    static POINTS: [OnceLock<Vec<(f64, f64)>>; KEPT] = [const { OnceLock::new() }; KEPT];
    let point = |i: usize| {
        let angle = PI * (i as f64 + 0.5) / n as f64;
        let sign = if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        (-real::cos(angle), sign * real::sin(angle))
    };
    let compute = || (0..n).map(point).collect();
    match POINTS.get(n) {
        Some(points) => Cow::Borrowed(points.get_or_init(compute)),
        None => Cow::Owned(compute()),
    }
}

/// Chebyshev points of the first kind on [a, b], ascending.
pub(in crate::design) fn chebyshev(n: usize, a: f64, b: f64) -> Vec<f64> {
    points(n).iter().map(|(x, _)| a + (b - a) * 0.5 * (1.0 + x)).collect()
}

/// Interpolation through Chebyshev points, in barycentric form (Berrut & Trefethen, SIAM Review 46, 2004).
pub(in crate::design) struct Lagrange {
    points: Vec<f64>,
    scales: Vec<f64>,
}

/// Interpolation through `n` Chebyshev points on [a, b].
pub(in crate::design) fn lagrange(n: usize, a: f64, b: f64) -> Lagrange {
    Lagrange { points: chebyshev(n, a, b), scales: points(n).iter().map(|(_, scale)| *scale).collect() }
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
