//! Discrete Fourier transforms of planes of real values in f64, with the same bits on every host.
//!
//! ```text
//! F(v, u) = Σ_y Σ_x f(y, x) e^(−2πi (v y/H + u x/W)),   inverse with e^(+…) and without the factor 1/(H W)
//! ```
//! F(−v, −u) is the conjugate of F(v, u): only u = 0 … W/2 are kept. Two real rows are one complex line. Sides are 2^a or 3·2^a, at least 16. Stockham's method (radix 4, and at most one stage of radix 3 and of radix 2), [`LANES`] lines
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

/// Rows that are transformed together: two in each line.
const ROWS: usize = 2 * LANES;

/// The smallest side of at least `n` that [`Planes`] transform.
pub fn side(n: usize) -> usize {
    let two = n.max(ROWS).next_power_of_two();
    let three = 3 * n.div_ceil(3).max(ROWS).next_power_of_two();
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

    /// Values of a row of a spectrum: W/2 + 1, and zeros up to a multiple of [`LANES`].
    pub fn stride(&self) -> usize {
        (self.width / 2 + 1).next_multiple_of(LANES)
    }

    /// The spectrum of the plane whose first rows and columns are `values`, rows `columns` wide, and 0 elsewhere.
    pub fn forward(&self, values: &[f64], columns: usize) -> Vec<Complex64> {
        let (stride, lines) = (self.stride(), Lines::new(self.width, -1.0));
        let mut spectrum = vec![Complex64::default(); self.height * stride];
        let mut line = vec![Values::default(); self.width];
        let mut other = line.clone();
        for (rows, to) in values.chunks(ROWS * columns).zip(spectrum.chunks_exact_mut(ROWS * stride)) {
            line.fill(Values::default());
            for (row, values) in rows.chunks_exact(columns).enumerate() {
                let lane = row / 2;
                for (to, value) in line.iter_mut().zip(values) {
                    *(if row % 2 == 0 { &mut to.re[lane] } else { &mut to.im[lane] }) = *value;
                }
            }
            lines.transform(&mut line, &mut other);
            for u in 0..=self.width / 2 {
                let (a, b) = (&line[u], &line[(self.width - u) % self.width]);
                for lane in 0..LANES {
                    // The even part of a + ib is that of the first row, the odd part i times that of the second.
                    let (sum, difference) = (a.re[lane] + b.re[lane], a.re[lane] - b.re[lane]);
                    let (im_sum, im_difference) = (a.im[lane] + b.im[lane], a.im[lane] - b.im[lane]);
                    to[2 * lane * stride + u] = Complex64::new(0.5 * sum, 0.5 * im_difference);
                    to[(2 * lane + 1) * stride + u] = Complex64::new(0.5 * im_sum, -0.5 * difference);
                }
            }
        }
        self.columns(&mut spectrum, -1.0);
        spectrum
    }

    /// The first `rows` rows of the plane of `spectrum`, which is overwritten, each complete. The factor 1/(H W) is not applied.
    pub fn inverse(&self, spectrum: &mut [Complex64], rows: usize) -> Vec<f64> {
        self.columns(spectrum, 1.0);
        let (stride, lines) = (self.stride(), Lines::new(self.width, 1.0));
        let blocks = rows.div_ceil(ROWS);
        let mut plane = vec![0.0; blocks * ROWS * self.width];
        let mut line = vec![Values::default(); self.width];
        let mut other = line.clone();
        for (from, to) in spectrum.chunks_exact(ROWS * stride).zip(plane.chunks_exact_mut(ROWS * self.width))
        {
            for u in 0..=self.width / 2 {
                for lane in 0..LANES {
                    let (a, b) = (from[2 * lane * stride + u], from[(2 * lane + 1) * stride + u]);
                    (line[u].re[lane], line[u].im[lane]) = (a.re - b.im, a.im + b.re);
                    let mirrored = &mut line[(self.width - u) % self.width];
                    if u > 0 && 2 * u < self.width {
                        (mirrored.re[lane], mirrored.im[lane]) = (a.re + b.im, b.re - a.im);
                    }
                }
            }
            lines.transform(&mut line, &mut other);
            for (row, to) in to.chunks_exact_mut(self.width).enumerate() {
                let lane = row / 2;
                for (to, value) in to.iter_mut().zip(&line) {
                    *to = if row % 2 == 0 { value.re[lane] } else { value.im[lane] };
                }
            }
        }
        plane.truncate(rows * self.width);
        plane
    }

    fn columns(&self, spectrum: &mut [Complex64], sign: f64) {
        let (stride, lines) = (self.stride(), Lines::new(self.height, sign));
        let mut line = vec![Values::default(); self.height];
        let mut other = line.clone();
        for column in (0..stride).step_by(LANES) {
            for (to, row) in line.iter_mut().zip(spectrum.chunks_exact(stride)) {
                for (lane, from) in row[column..][..LANES].iter().enumerate() {
                    (to.re[lane], to.im[lane]) = (from.re, from.im);
                }
            }
            lines.transform(&mut line, &mut other);
            for (from, row) in line.iter().zip(spectrum.chunks_exact_mut(stride)) {
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
        assert_eq!([1, 16, 17, 33, 48, 49, 700, 1028].map(side), [16, 16, 32, 48, 48, 64, 768, 1536]);
    }

    /// Tolerance: rounding of the sum of some thousand terms of 0.5 in f64.
    #[test]
    fn transform_is_its_defining_sum() {
        for (height, width, rows, columns) in
            [(16, 16, 16, 16), (48, 16, 37, 9), (16, 48, 3, 48), (32, 96, 32, 50)]
        {
            let values: Vec<f64> = (0..rows * columns).map(noise).collect();
            let planes = Planes::new(height, width);
            let found = planes.forward(&values, columns);
            for (v, u) in (0..height).flat_map(|v| (0..=width / 2).map(move |u| (v, u))) {
                let term = |(i, value): (usize, &f64)| {
                    let (y, x) = (i / columns, i % columns);
                    let turns = (v * y) as f64 / height as f64 + (u * x) as f64 / width as f64;
                    Complex64::from_polar(*value, -TAU * turns)
                };
                let sum: Complex64 = values.iter().enumerate().map(term).sum();
                let error = (found[v * planes.stride() + u] - sum).norm();
                assert!(error < 1e-11, "{height} x {width}, {v}, {u}: {error}");
            }
        }
    }

    #[test]
    fn inverse_returns_the_rows_that_are_asked_for() {
        for (height, width, rows) in [(96, 64, 21), (16, 48, 16), (48, 16, 40)] {
            let values: Vec<f64> = (0..height * width).map(noise).collect();
            let planes = Planes::new(height, width);
            let found = planes.inverse(&mut planes.forward(&values, width), rows);
            assert_eq!(found.len(), rows * width);
            for (i, value) in found.iter().enumerate() {
                assert!((value / (height * width) as f64 - noise(i)).abs() < 1e-14, "{i}: {value}");
            }
        }
    }

    /// Bits of a transform of fixed values on any host and with any compiler.
    #[test]
    fn transform_has_fixed_bits() {
        let values: Vec<f64> = (0..48 * 16).map(noise).collect();
        let spectrum = Planes::new(48, 16).forward(&values, 16);
        let digest = spectrum.iter().fold(0u64, |digest, value| {
            (digest.rotate_left(7) ^ value.re.to_bits()).rotate_left(7) ^ value.im.to_bits()
        });
        assert_eq!(digest, 2_418_275_646_323_361_036);
    }
}
