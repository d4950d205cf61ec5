//! Zernike polynomials of a wavefront, in the two orders in use, fitted to samples by least squares.
//!
//! ```text
//! W(x, y) = Σ c_j Z_j(ρ, φ),   x = ρ cos φ, y = ρ sin φ
//! Z = N R_n^|m|(ρ) · cos mφ (m ≥ 0) or sin |m|φ (m < 0)
//! R_n^m(ρ) = Σ_s (−1)^s (n − s)! / (s! ((n + m)/2 − s)! ((n − m)/2 − s)!) ρ^(n − 2s)
//! ```
//! *Standard* (Noll): N = √(n + 1) for m = 0, else √(2n + 2): RMS 1 over the disc, so that the RMS of W is the root of the sum of squares of c_j
//! from j = 2 on; even j have cos. *Fringe* (University of Arizona): N = 1, 37 terms by rising n + |m|, the last is R_12^0.
//! The fit is by QR (modified Gram-Schmidt), with equal weight for each sample; over a pupil that is not a full disc the terms are not independent.
//! Source: Noll, J. Opt. Soc. Am. 66, 207 (1976); Wyant & Creath, Applied Optics and Optical Engineering XI, chapter 1, table III;
//! Björck, BIT 7, 1 (1967).

use super::wavefront::WavefrontSample;
use crate::real;

/// Terms of a fit: all of the Fringe polynomials.
pub const TERMS: usize = 37;
/// Part of a column that must remain where the others are subtracted.
const INDEPENDENT: f64 = 1e-9;

/// A polynomial.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Zernike {
    /// Radial order.
    pub n: u32,
    /// Azimuthal order: cos for positive ones, sin for negative ones.
    pub m: i32,
    /// Its factor.
    pub norm: f64,
}

/// The standard polynomial `j`, from 1 on.
pub fn noll(j: usize) -> Zernike {
    let (mut n, mut rest) = (0, j as u32 - 1);
    while rest > n {
        n += 1;
        rest -= n;
    }
    let size = n % 2 + 2 * ((rest + (n + 1) % 2) / 2);
    let m = if j.is_multiple_of(2) { size as i32 } else { -(size as i32) };
    let norm = f64::from(if size == 0 { n + 1 } else { 2 * n + 2 }).sqrt();
    Zernike { n, m, norm }
}

/// The Fringe polynomial `j`, from 1 to [`TERMS`].
pub fn fringe(j: usize) -> Zernike {
    match j < TERMS {
        true => by_rising_orders(j),
        false => Zernike { n: 12, m: 0, norm: 1.0 },
    }
}

/// The polynomial `j`, from 1 on, by rising n + |m|: up to 36 that of Fringe.
pub fn by_rising_orders(j: usize) -> Zernike {
    // Group k has the 2k + 1 polynomials with (n + |m|)/2 = k, from |m| = k down to 0.
    let j = j as u32 - 1;
    let k = j.isqrt();
    let place = j - k * k;
    let size = k - place / 2;
    let m = if place.is_multiple_of(2) { size as i32 } else { -(size as i32) };
    Zernike { n: 2 * k - size, m, norm: 1.0 }
}

impl Zernike {
    /// Its value at (x, y).
    pub fn at(&self, x: f64, y: f64) -> f64 {
        let size = self.m.unsigned_abs();
        let square = x * x + y * y;
        // R/ρ^|m| by Horner's rule in ρ², from the highest power on; each coefficient from the one before.
        let (n, half) = (f64::from(self.n), (self.n - size) / 2);
        let (plus, minus) = (f64::from(self.n + size) / 2.0, f64::from(half));
        let mut coefficient = (0..half).fold(1.0, |c, i| c * (n - f64::from(i)) / (f64::from(i) + 1.0));
        let mut radial = coefficient;
        for s in (0..half).map(f64::from) {
            coefficient *= -(plus - s) * (minus - s) / ((s + 1.0) * (n - s));
            radial = radial * square + coefficient;
        }
        // ρ^|m| e^{i|m|φ} = (x + iy)^|m|.
        let (re, im) = (0..size).fold((1.0, 0.0), |(a, b), _| (a * x - b * y, a * y + b * x));
        self.norm * radial * if self.m < 0 { im } else { re }
    }
}

/// Coefficients of the first `terms` polynomials of `order`, in the unit of the samples; none if the samples do not determine them.
pub fn fit(samples: &[WavefrontSample], order: fn(usize) -> Zernike, terms: usize) -> Option<Vec<f64>> {
    if samples.len() < terms {
        return None;
    }
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut columns: Vec<Vec<f64>> = (1..=terms)
        .map(|j| {
            let polynomial = order(j);
            samples.iter().map(|s| polynomial.at(s.x, s.y)).collect()
        })
        .collect();
    let mut rest: Vec<f64> = samples.iter().map(|s| s.waves).collect();
    // Columns become orthonormal; `upper` and `right` are R and Qᵀ W.
    let (mut upper, mut right) = (vec![vec![0.0; terms]; terms], vec![0.0; terms]);
    for k in 0..terms {
        let (done, open) = columns.split_at_mut(k + 1);
        let column = &mut done[k];
        let length = dot(column, column).sqrt();
        let whole = (0..k).map(|i| upper[i][k] * upper[i][k]).sum::<f64>() + length * length;
        if length <= INDEPENDENT * whole.sqrt() {
            return None;
        }
        column.iter_mut().for_each(|v| *v /= length);
        upper[k][k] = length;
        let take = |from: &mut Vec<f64>| {
            let part = dot(column, from);
            from.iter_mut().zip(column.iter()).for_each(|(v, q)| *v -= part * q);
            part
        };
        for (i, next) in open.iter_mut().enumerate() {
            upper[k][k + 1 + i] = take(next);
        }
        right[k] = take(&mut rest);
    }
    for k in (0..terms).rev() {
        let known: f64 = (k + 1..terms).map(|i| upper[k][i] * right[i]).sum();
        right[k] = (right[k] - known) / upper[k][k];
    }
    Some(right)
}

/// RMS of a wavefront with these standard coefficients: without its mean, and without its mean and tilt.
pub fn rms_of_standard(coefficients: &[f64]) -> [f64; 2] {
    [1, 3].map(|from| coefficients.iter().skip(from).fold(0.0, |a, c| real::hypot(a, *c)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::pupil::quadrature::unit_interval;
    use std::f64::consts::TAU;

    #[test]
    fn orders_are_those_of_the_tables() {
        // Noll's table I.
        let noll: Vec<(u32, i32)> = (1..=15).map(|j| (noll(j).n, noll(j).m)).collect();
        assert_eq!(
            noll,
            [
                (0, 0),
                (1, 1),
                (1, -1),
                (2, 0),
                (2, -2),
                (2, 2),
                (3, -1),
                (3, 1),
                (3, -3),
                (3, 3),
                (4, 0),
                (4, 2),
                (4, -2),
                (4, 4),
                (4, -4),
            ]
        );
        // Wyant & Creath, table III, counted from 1.
        let fringe_of = |j: usize| (fringe(j).n, fringe(j).m);
        let first: Vec<(u32, i32)> = (1..=16).map(fringe_of).collect();
        assert_eq!(
            first,
            [
                (0, 0),
                (1, 1),
                (1, -1),
                (2, 0),
                (2, 2),
                (2, -2),
                (3, 1),
                (3, -1),
                (4, 0),
                (3, 3),
                (3, -3),
                (4, 2),
                (4, -2),
                (5, 1),
                (5, -1),
                (6, 0),
            ]
        );
        assert_eq!([25, 36, 37].map(fringe_of), [(8, 0), (10, 0), (12, 0)]);
    }

    #[test]
    fn closed_forms_and_orthogonality() {
        let (x, y): (f64, f64) = (0.6, -0.5);
        let (r2, phi) = (x * x + y * y, y.atan2(x));
        let r = r2.sqrt();
        for (j, expected) in [
            (4, 2.0 * r2 - 1.0),
            (8, (3.0 * r * r2 - 2.0 * r) * phi.sin()),
            (9, 6.0 * r2 * r2 - 6.0 * r2 + 1.0),
            (16, 20.0 * r2.powi(3) - 30.0 * r2 * r2 + 12.0 * r2 - 1.0),
        ] {
            assert!((fringe(j).at(x, y) - expected).abs() < 1e-14, "{j}");
        }
        // ∫∫ Z_i Z_j / π = δ_ij of the standard polynomials.
        let radial = unit_interval(16);
        for (i, j) in (1..=TERMS).flat_map(|i| (1..=TERMS).map(move |j| (i, j))) {
            let sum: f64 = (0..32)
                .flat_map(|k| radial.iter().map(move |(r, w)| (r, w, TAU * (f64::from(k) + 0.5) / 32.0)))
                .map(|(r, w, t)| {
                    2.0 * w * r / 32.0
                        * noll(i).at(r * t.cos(), r * t.sin())
                        * noll(j).at(r * t.cos(), r * t.sin())
                })
                .sum();
            assert!((sum - f64::from(i == j)).abs() < 1e-12, "{i} {j}: {sum}");
        }
    }

    #[test]
    fn fit_returns_the_coefficients_of_a_known_wavefront_on_any_pupil() {
        for order in [noll, fringe] {
            let known: Vec<f64> = (1..=TERMS).map(|j| (j as f64 * 1.7).sin() / j as f64).collect();
            let wave =
                |x: f64, y: f64| known.iter().enumerate().map(|(i, c)| c * order(i + 1).at(x, y)).sum();
            // A disc with two sides cut off.
            let grid = (0..64 * 64).map(|i| (f64::from(i % 64) / 31.5 - 1.0, f64::from(i / 64) / 31.5 - 1.0));
            let samples: Vec<WavefrontSample> = grid
                .filter(|(x, y)| x * x + y * y <= 1.0 && (-0.6..0.8).contains(x))
                .map(|(x, y)| WavefrontSample { x, y, waves: wave(x, y) })
                .collect();
            let found = fit(&samples, order, TERMS).unwrap();
            assert!(found.iter().zip(&known).all(|(a, b)| (a - b).abs() < 1e-8), "{found:?}");
            // Samples on a line do not determine both tilts.
            let line: Vec<WavefrontSample> =
                samples.iter().map(|s| WavefrontSample { y: 0.0, ..*s }).collect();
            assert_eq!(fit(&line, order, 3), None);
            assert_eq!(fit(&samples[..10], order, TERMS), None);
        }
    }

    #[test]
    fn rms_of_coefficients_is_that_of_the_disc() {
        let rms = rms_of_standard(&[9.0, 3.0, 4.0, 12.0]);
        assert_eq!(rms, [13.0, 12.0]);
    }
}
