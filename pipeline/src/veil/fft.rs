//! Discrete Fourier transforms of planes of f64, with the same bits on every host.
//!
//! ```text
//! F(v, u) = Σ_y Σ_x f(y, x) e^(−2πi (v y/H + u x/W)),   inverse with e^(+…) and without the factor 1/(H W)
//! ```
//! Sides are 2^a or 3·2^a, at least [`LANES`]. Stockham's method (radix 4, and at most one stage of radix 3 and of radix 2), [`LANES`] lines
//! at a time, which compilers turn into vector instructions without fused operations. The roots of unity are those of [`crate::real`]: rustfft's
//! come from the host's C library and differ between hosts in the last bit.
//! Source: Van Loan, Computational Frameworks for the Fast Fourier Transform (SIAM 1992), 1.7 and 2.4.

use crate::real;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Lines that are transformed together.
pub const LANES: usize = 8;

/// One value of each of [`LANES`] lines.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Values {
    re: [f64; LANES],
    im: [f64; LANES],
}

impl Values {
    #[inline(always)]
    fn map(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let mut out = Self::default();
        for i in 0..LANES {
            out.re[i] = f(self.re[i], other.re[i]);
            out.im[i] = f(self.im[i], other.im[i]);
        }
        out
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.map(other, |a, b| a + b)
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.map(other, |a, b| a - b)
    }

    #[inline(always)]
    fn times(self, w: Complex64) -> Self {
        let mut out = Self::default();
        for i in 0..LANES {
            out.re[i] = self.re[i] * w.re - self.im[i] * w.im;
            out.im[i] = self.re[i] * w.im + self.im[i] * w.re;
        }
        out
    }
}

/// Transforms of lines of one length.
#[derive(Clone, Debug)]
struct Lines {
    length: usize,
    /// e^(∓2πi k/length).
    roots: Vec<Complex64>,
    /// −1 for the forward transform, +1 for the inverse.
    sign: f64,
}

impl Lines {
    fn new(length: usize, sign: f64) -> Self {
        let root = |k: usize| {
            let (sin, cos) = real::sin_cos(TAU * k as f64 / length as f64);
            Complex64::new(cos, sign * sin)
        };
        Self { length, roots: (0..length).map(root).collect(), sign }
    }

    /// Transforms `values`; `other`, of the same length, is overwritten.
    fn transform(&self, values: &mut Vec<Values>, other: &mut Vec<Values>) {
        let (mut left, mut stride) = (self.length, 1);
        while left > 1 {
            // The step between roots of a transform of `left` values.
            let step = self.length / left;
            match left {
                _ if left.is_multiple_of(4) => self.radix4(values, other, (left / 4, stride, step)),
                _ if left.is_multiple_of(3) => self.radix3(values, other, (left / 3, stride, step)),
                _ => self.radix2(values, other, (left / 2, stride, step)),
            }
            let radix = if left.is_multiple_of(4) {
                4
            } else if left.is_multiple_of(3) {
                3
            } else {
                2
            };
            left /= radix;
            stride *= radix;
            std::mem::swap(values, other);
        }
    }

    fn radix2(&self, from: &[Values], to: &mut [Values], (m, stride, step): (usize, usize, usize)) {
        for p in 0..m {
            let w = self.roots[p * step];
            for q in 0..stride {
                let (a, b) = (from[q + stride * p], from[q + stride * (p + m)]);
                to[q + stride * 2 * p] = a.plus(b);
                to[q + stride * (2 * p + 1)] = a.minus(b).times(w);
            }
        }
    }

    fn radix3(&self, from: &[Values], to: &mut [Values], (m, stride, step): (usize, usize, usize)) {
        let third = Complex64::new(0.0, self.sign * 0.75f64.sqrt());
        for p in 0..m {
            let (w1, w2) = (self.roots[p * step], self.roots[2 * p * step]);
            for q in 0..stride {
                let [a, b, c] = [0, 1, 2].map(|k| from[q + stride * (p + k * m)]);
                let (sum, difference) = (b.plus(c), b.minus(c).times(third));
                let middle = a.minus(sum.times(Complex64::new(0.5, 0.0)));
                to[q + stride * 3 * p] = a.plus(sum);
                to[q + stride * (3 * p + 1)] = middle.plus(difference).times(w1);
                to[q + stride * (3 * p + 2)] = middle.minus(difference).times(w2);
            }
        }
    }

    fn radix4(&self, from: &[Values], to: &mut [Values], (m, stride, step): (usize, usize, usize)) {
        let quarter = Complex64::new(0.0, self.sign);
        for p in 0..m {
            let [w1, w2, w3] = [1, 2, 3].map(|k| self.roots[k * p * step]);
            for q in 0..stride {
                let [a, b, c, d] = [0, 1, 2, 3].map(|k| from[q + stride * (p + k * m)]);
                let (even, odd) = (a.plus(c), b.plus(d));
                let (even_minus, odd_minus) = (a.minus(c), b.minus(d).times(quarter));
                to[q + stride * 4 * p] = even.plus(odd);
                to[q + stride * (4 * p + 1)] = even_minus.plus(odd_minus).times(w1);
                to[q + stride * (4 * p + 2)] = even.minus(odd).times(w2);
                to[q + stride * (4 * p + 3)] = even_minus.minus(odd_minus).times(w3);
            }
        }
    }
}

/// Transforms of planes of one size.
#[derive(Clone, Debug)]
pub struct Planes {
    height: usize,
    width: usize,
}

/// The smallest side of at least `n` that [`Planes`] transform.
pub fn side(n: usize) -> usize {
    let two = n.max(LANES).next_power_of_two();
    let three = 3 * n.div_ceil(3).max(LANES).next_power_of_two();
    two.min(three)
}

impl Planes {
    /// For planes of `height` rows of `width` values.
    ///
    /// # Panics
    /// Sides that are not of [`side`].
    pub fn new(height: usize, width: usize) -> Self {
        assert!(side(height) == height && side(width) == width, "{height} x {width}");
        Self { height, width }
    }

    /// Transforms a plane, row by row, of which the rows from `rows` on are 0.
    pub fn forward(&self, plane: &mut [Complex64], rows: usize) {
        self.rows(plane, rows, -1.0);
        self.columns(plane, -1.0);
    }

    /// Transforms back; only the first `rows` rows of the result are computed. The factor 1/(height·width) is not applied.
    pub fn inverse(&self, plane: &mut [Complex64], rows: usize) {
        self.columns(plane, 1.0);
        self.rows(plane, rows, 1.0);
    }

    fn rows(&self, plane: &mut [Complex64], rows: usize, sign: f64) {
        let lines = Lines::new(self.width, sign);
        let (mut values, mut other) =
            (vec![Values::default(); self.width], vec![Values::default(); self.width]);
        for block in plane[..rows.next_multiple_of(LANES).min(self.height) * self.width]
            .chunks_exact_mut(LANES * self.width)
        {
            for (lane, row) in block.chunks_exact(self.width).enumerate() {
                for (to, from) in values.iter_mut().zip(row) {
                    (to.re[lane], to.im[lane]) = (from.re, from.im);
                }
            }
            lines.transform(&mut values, &mut other);
            for (lane, row) in block.chunks_exact_mut(self.width).enumerate() {
                for (to, from) in row.iter_mut().zip(&values) {
                    *to = Complex64::new(from.re[lane], from.im[lane]);
                }
            }
        }
    }

    fn columns(&self, plane: &mut [Complex64], sign: f64) {
        let lines = Lines::new(self.height, sign);
        let (mut values, mut other) =
            (vec![Values::default(); self.height], vec![Values::default(); self.height]);
        for column in (0..self.width).step_by(LANES) {
            for (to, row) in values.iter_mut().zip(plane.chunks_exact(self.width)) {
                for (lane, from) in row[column..][..LANES].iter().enumerate() {
                    (to.re[lane], to.im[lane]) = (from.re, from.im);
                }
            }
            lines.transform(&mut values, &mut other);
            for (from, row) in values.iter().zip(plane.chunks_exact_mut(self.width)) {
                for (lane, to) in row[column..][..LANES].iter_mut().enumerate() {
                    *to = Complex64::new(from.re[lane], from.im[lane]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(i: usize) -> f64 {
        ((i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as f64 / (1 << 24) as f64 - 0.5
    }

    #[test]
    fn sides_are_powers_of_two_or_three_times_one() {
        assert_eq!([1, 8, 9, 17, 24, 25, 700, 1028].map(side), [8, 8, 16, 24, 24, 32, 768, 1536]);
    }

    /// Tolerance: rounding of the sum of some thousand terms of 0.5 in f64.
    #[test]
    fn transform_is_its_defining_sum() {
        for (height, width) in [(8, 8), (24, 16), (16, 48), (32, 24)] {
            let plane: Vec<Complex64> =
                (0..height * width).map(|i| Complex64::new(noise(i), noise(i + 7777))).collect();
            let mut found = plane.clone();
            Planes::new(height, width).forward(&mut found, height);
            for v in 0..height {
                for u in 0..width {
                    let term = |(i, value): (usize, &Complex64)| {
                        let (y, x) = (i / width, i % width);
                        let turns = (v * y) as f64 / height as f64 + (u * x) as f64 / width as f64;
                        value * Complex64::from_polar(1.0, -TAU * turns)
                    };
                    let sum: Complex64 = plane.iter().enumerate().map(term).sum();
                    let error = (found[v * width + u] - sum).norm();
                    assert!(error < 1e-11, "{height} x {width}, {v}, {u}: {error}");
                }
            }
        }
    }

    #[test]
    fn inverse_returns_the_rows_that_are_asked_for() {
        let (height, width, rows) = (96, 64, 21);
        let mut plane = vec![Complex64::default(); height * width];
        (0..rows * width).for_each(|i| plane[i] = Complex64::new(noise(i), 0.0));
        let planes = Planes::new(height, width);
        planes.forward(&mut plane, rows);
        planes.inverse(&mut plane, rows);
        for (i, value) in plane[..rows * width].iter().enumerate() {
            let value = value / (height * width) as f64;
            assert!((value.re - noise(i)).abs() < 1e-14 && value.im.abs() < 1e-14, "{i}: {value}");
        }
    }

    /// Bits of a transform of fixed values on any host and with any compiler.
    #[test]
    fn transform_has_fixed_bits() {
        let mut plane: Vec<Complex64> = (0..24 * 16).map(|i| Complex64::new(noise(i), 0.0)).collect();
        Planes::new(24, 16).forward(&mut plane, 24);
        let digest = plane.iter().fold(0u64, |digest, value| {
            (digest.rotate_left(7) ^ value.re.to_bits()).rotate_left(7) ^ value.im.to_bits()
        });
        assert_eq!(digest, 11_292_674_467_809_180_515);
    }
}
