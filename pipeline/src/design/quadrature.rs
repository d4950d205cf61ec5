//! Gauss-Legendre quadrature on [0, 1].
//!
//!     ∫₀¹ f dx = Σ w_i f(x_i),   x_i = (1 − z_i)/2,   w_i = 1/((1 − z_i²) P_n'(z_i)²),   z_i the zeros of the Legendre polynomial P_n
//! exact for polynomials up to the degree 2n − 1. The zeros by Newton's method from cos(π (i − 1/4)/(n + 1/2)).
//! Source: Davis & Rabinowitz, Methods of Numerical Integration, 2.7.

use std::borrow::Cow;
use std::f64::consts::PI;
use std::sync::OnceLock;

use crate::real;

/// Rules of fewer nodes are computed once.
const KEPT: usize = 1024;

/// Nodes and weights on [0, 1], ascending.
pub fn unit_interval(n: usize) -> Cow<'static, [(f64, f64)]> {
    static RULES: [OnceLock<Vec<(f64, f64)>>; KEPT] = [const { OnceLock::new() }; KEPT];
    match RULES.get(n) {
        Some(rule) => Cow::Borrowed(rule.get_or_init(|| gauss_legendre(n))),
        None => Cow::Owned(gauss_legendre(n)),
    }
}

/// A number of nodes, rounded up to one of few.
pub(super) fn rounded(nodes: usize) -> usize {
    nodes.next_multiple_of(if nodes < 128 { 4 } else { 16 })
}

fn gauss_legendre(n: usize) -> Vec<(f64, f64)> {
    let mut out = vec![(0.5, 1.0); n];
    for i in 0..n.div_ceil(2) {
        let mut x = real::cos(PI * (i as f64 + 0.75) / (n as f64 + 0.5));
        let mut slope = 1.0;
        for _ in 0..100 {
            let (mut p, mut before) = (1.0, 0.0);
            for k in 0..n {
                let k = k as f64;
                (p, before) = (((2.0 * k + 1.0) * x * p - k * before) / (k + 1.0), p);
            }
            slope = n as f64 * (x * p - before) / (x * x - 1.0);
            let step = p / slope;
            x -= step;
            if step.abs() < 1e-15 {
                break;
            }
        }
        let w = 1.0 / ((1.0 - x * x) * slope * slope);
        out[i] = (0.5 - 0.5 * x, w);
        out[n - 1 - i] = (0.5 + 0.5 * x, w);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gauss_legendre_is_exact_up_to_its_degree() {
        for n in [1_usize, 2, 5, 24, 300] {
            let nodes = unit_interval(n);
            for power in [0, 1, 2 * n - 1] {
                let sum: f64 = nodes.iter().map(|(x, w)| w * x.powi(power as i32)).sum();
                assert!((sum - 1.0 / (power as f64 + 1.0)).abs() < 1e-13, "n {n} power {power}");
            }
        }
    }
}
