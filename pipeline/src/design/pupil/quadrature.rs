//! Gauss-Legendre quadrature on [0, 1].
//!
//! ```text
//! ∫₀¹ f dx = Σ w_i f(x_i),   x_i = (1 − z_i)/2,   w_i = 1/((1 − z_i²) P_n'(z_i)²),   z_i the zeros of the Legendre polynomial P_n
//! ```
//! exact for polynomials up to the degree 2n − 1. The zeros by Newton's method from cos(π (i − 1/4)/(n + 1/2)).
//! Their density grows towards both ends, so an oscillating integrand needs π/2 nodes per period of its middle. The map
//!
//! ```text
//! x = ½ + asin(α t) / (2 asin α),   α = 1/cosh(c/n),   t ∈ [−1, 1]
//! ```
//! makes their density even, and about one node per period is enough (`oscillating`).
//! Source: Davis & Rabinowitz, Methods of Numerical Integration, 2.7; the map: Kosloff & Tal-Ezer, J. Comput. Phys. 104 (1993), section 2;
//! in quadrature: Hale & Trefethen, SIAM J. Numer. Anal. 46 (2008).

use std::borrow::Cow;
use std::f64::consts::{PI, TAU};
use std::sync::OnceLock;

use crate::real;

/// Rules of fewer nodes are computed once.
const KEPT: usize = 4096;
/// The constant c of the map: more makes the density more even and the error of few nodes larger.
const EVENNESS: f64 = 13.8;

/// Nodes and weights on [0, 1], ascending.
pub fn unit_interval(n: usize) -> Cow<'static, [(f64, f64)]> {
    static RULES: [OnceLock<Vec<(f64, f64)>>; KEPT] = [const { OnceLock::new() }; KEPT];
    match RULES.get(n) {
        Some(rule) => Cow::Borrowed(rule.get_or_init(|| gauss_legendre(n))),
        None => Cow::Owned(gauss_legendre(n)),
    }
}

/// Nodes and weights on [0, 1], ascending, for an integrand whose phase changes by at most `change` rad: the error is below 1e-6 of the
/// integral of its modulus.
pub(in crate::design) fn oscillating(change: f64) -> Cow<'static, [(f64, f64)]> {
    static RULES: [OnceLock<Vec<(f64, f64)>>; KEPT] = [const { OnceLock::new() }; KEPT];
    // The additional nodes were determined for changes from 1 to 3000 (test below).
    let n = rounded((change / TAU + 0.8 * change.sqrt() + 6.0) as usize);
    match RULES.get(n) {
        Some(rule) => Cow::Borrowed(rule.get_or_init(|| even_density(n))),
        None => Cow::Owned(even_density(n)),
    }
}

/// The Gauss-Legendre rule of `n` nodes through the map.
fn even_density(n: usize) -> Vec<(f64, f64)> {
    let c = EVENNESS / n as f64;
    let alpha = 2.0 / (real::exp(c) + real::exp(-c));
    let whole = real::asin(alpha);
    let map = |(x, w): &(f64, f64)| {
        let t = 2.0 * x - 1.0;
        let density = whole * (1.0 - alpha * alpha * t * t).sqrt() / alpha;
        (0.5 + 0.5 * real::asin(alpha * t) / whole, w / density)
    };
    unit_interval(n).iter().map(map).collect()
}

/// A number of nodes, rounded up to one of few.
pub(super) fn rounded(nodes: usize) -> usize {
    nodes.next_multiple_of(if nodes < 128 { 4 } else { 16 })
}

/// Zeros that are searched together.
const ZEROS: usize = 8;

fn gauss_legendre(n: usize) -> Vec<(f64, f64)> {
    let mut out = vec![(0.5, 1.0); n];
    // P_{k+1} = a_k x P_k − b_k P_{k−1}
    let recurrence: Vec<[f64; 2]> =
        (0..n).map(|k| k as f64).map(|k| [(2.0 * k + 1.0) / (k + 1.0), k / (k + 1.0)]).collect();
    for first in (0..n.div_ceil(2)).step_by(ZEROS) {
        let mut x: [f64; ZEROS] = std::array::from_fn(|i| {
            real::cos(PI * ((first + i).min(n / 2) as f64 + 0.75) / (n as f64 + 0.5))
        });
        let mut slope = [1.0; ZEROS];
        for _ in 0..100 {
            let (mut p, mut before) = ([1.0; ZEROS], [0.0; ZEROS]);
            for [a, b] in &recurrence {
                for i in 0..ZEROS {
                    (p[i], before[i]) = (a * x[i] * p[i] - b * before[i], p[i]);
                }
            }
            let mut largest = 0.0_f64;
            for i in 0..ZEROS {
                slope[i] = n as f64 * (x[i] * p[i] - before[i]) / (x[i] * x[i] - 1.0);
                let step = p[i] / slope[i];
                x[i] -= step;
                largest = largest.max(step.abs());
            }
            if largest < 1e-15 {
                break;
            }
        }
        for (i, (x, slope)) in (first..n.div_ceil(2)).zip(x.into_iter().zip(slope)) {
            let w = 1.0 / ((1.0 - x * x) * slope * slope);
            out[i] = (0.5 - 0.5 * x, w);
            out[n - 1 - i] = (0.5 + 0.5 * x, w);
        }
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

    #[test]
    fn oscillating_integrands_are_integrated_to_1e_6() {
        for most in [1.0_f64, 5.0, 20.0, 60.0, 150.0, 400.0, 1000.0, 3000.0] {
            let nodes = oscillating(most);
            for change in (1..=40).map(|i| most * f64::from(i) / 40.0) {
                // ∫ x e^{i change x} dx
                let (mut re, mut im) = (0.0, 0.0);
                for (x, w) in nodes.iter() {
                    let (s, c) = real::sin_cos(change * x);
                    re += w * x * c;
                    im += w * x * s;
                }
                let (s, c) = real::sin_cos(change);
                let squared = change * change;
                let error =
                    real::hypot(re - (s / change + (c - 1.0) / squared), im - (s / squared - c / change));
                assert!(error < 5e-7, "{most}, {change}: {error:e} with {} nodes", nodes.len());
            }
        }
    }
}
