//! Spreading of scattered points on the cells of a regular grid, the first step of a nonuniform FFT ([`super::nufft`]).
//!
//! ```text
//! φ(z) = exp(β(√(1−z²) − 1)),   |z| < 1,   W cells wide,   β = γ π W (1 − 1/(2σ)),   γ = 0.95,   σ cells per output
//! ```
//! Cell m of a point at edge + z₀ has the weight φ along x times that along y. Over each cell φ is a polynomial of the point's place in it.
//! Source: Barnett, Magland, af Klinteberg, SIAM J. Sci. Comput. 41 (2019), section 3.

use std::f64::consts::PI;

use super::nufft::{Accuracy, FINER, Point};
use crate::real::{self, WHOLE};

/// A complex plane, row by row.
#[derive(Default)]
pub(super) struct Plane {
    pub(super) width: usize,
    pub(super) re: Vec<f32>,
    pub(super) im: Vec<f32>,
}

impl Plane {
    /// Zeros.
    pub(super) fn reset(&mut self, width: usize, rows: usize) {
        self.width = width;
        for part in [&mut self.re, &mut self.im] {
            part.clear();
            part.resize(width * rows, 0.0);
        }
    }
}

/// A part of a grid with `cells` to a cycle in both directions, from the cell `first` (column, row) on.
pub(super) struct Target<'a> {
    pub(super) cells: usize,
    pub(super) first: (usize, usize),
    pub(super) grid: &'a mut Plane,
}

/// φ of an accuracy.
#[allow(clippy::large_enum_variant, reason = "a plan has one of them")]
pub(super) enum Kernel {
    /// [`Accuracy::Film`].
    Eight(Spreading<8, 6>),
    /// [`Accuracy::Comparison`].
    Four(Spreading<4, 4>),
}

/// φ of W cells by polynomials with T even and T odd powers.
pub(super) struct Spreading<const W: usize, const T: usize> {
    /// Coefficients of the even and odd powers, for the first half of the cells, twice: along x and along y. φ is even: the polynomials of the other
    /// cells are those of −z.
    phi: [[[f32; W]; T]; 2],
}

/// First cell of the kernel of a point at `cycles`, and the distance (in cells, 0..1) of that cell from the kernel's edge.
#[inline(always)]
pub(super) fn first_cell(cycles: f64, cells: usize, width: usize) -> (usize, f64) {
    let edge = (cycles + 0.5) * cells as f64 - width as f64 / 2.0;
    // The next whole number, without a conversion: the last bits of a number this large are its integer.
    let nearest = (edge + WHOLE) - WHOLE;
    let first = (nearest + if nearest < edge { 1.0 } else { 0.0 }).max(0.0);
    ((first + WHOLE).to_bits() as u32 as usize, first - edge)
}

/// φ of `width` cells at z.
fn phi(width: usize, z: f64) -> f64 {
    let beta = 0.95 * PI * width as f64 * (1.0 - 0.5 / FINER);
    if z.abs() >= 1.0 { 0.0 } else { real::exp(beta * ((1.0 - z * z).sqrt() - 1.0)) }
}

impl Kernel {
    pub(super) fn new(accuracy: Accuracy) -> Self {
        match accuracy {
            Accuracy::Film => Self::Eight(Spreading::new()),
            Accuracy::Comparison => Self::Four(Spreading::new()),
        }
    }

    /// Cells.
    pub(super) fn width(&self) -> usize {
        match self {
            Self::Eight(_) => 8,
            Self::Four(_) => 4,
        }
    }

    /// φ(z).
    pub(super) fn at(&self, z: f64) -> f64 {
        phi(self.width(), z)
    }

    /// Adds `points` to a grid that has the cells of their kernels.
    #[inline(always)]
    pub(super) fn spread(&self, points: &[Point], to: Target<'_>) {
        match self {
            Self::Eight(kernel) => kernel.spread(points, to),
            Self::Four(kernel) => kernel.spread(points, to),
        }
    }
}

impl<const W: usize, const T: usize> Spreading<W, T> {
    /// Interpolates φ over each cell of the first half as a polynomial of z = 2·inside − 1 at Chebyshev points.
    fn new() -> Self {
        let (n, half) = (2 * T, W / 2);
        let mut out = vec![[0.0_f64; W]; n];
        let node = |i: usize| real::cos(PI * (i as f64 + 0.5) / n as f64);
        for cell in 0..half {
            let value = |z: f64| phi(W, (cell as f64 + 0.5 * (z + 1.0)) * 2.0 / W as f64 - 1.0);
            // Chebyshev coefficients, then T_k as a power series.
            let (mut before, mut now) = (vec![0.0; n + 1], vec![0.0; n + 1]);
            before[0] = 1.0;
            now[1] = 1.0;
            for k in 0..n {
                let wave = |i: usize| real::cos(k as f64 * PI * (i as f64 + 0.5) / n as f64);
                let sum: f64 = (0..n).map(|i| value(node(i)) * wave(i)).sum();
                let a = sum * if k == 0 { 1.0 } else { 2.0 } / n as f64;
                for (power, c) in out.iter_mut().enumerate() {
                    c[cell] += a * before[power];
                }
                let next: Vec<f64> =
                    (0..=n).map(|i| 2.0 * if i > 0 { now[i - 1] } else { 0.0 } - before[i]).collect();
                before = now;
                now = next;
            }
        }
        let twice = |power: [f64; W]| std::array::from_fn(|i| power[i % half] as f32);
        Self { phi: [0, 1].map(|parity| std::array::from_fn(|k| twice(out[2 * k + parity]))) }
    }

    /// φ at the cells along x and along y of a point at these distances from the edges.
    #[inline(always)]
    fn weights(&self, inside: [f64; 2]) -> [[f32; W]; 2] {
        let [x, y] = inside.map(|inside| (2.0 * inside - 1.0) as f32);
        let z: [f32; W] = std::array::from_fn(|i| if i < W / 2 { x } else { y });
        let square = z.map(|z| z * z);
        let [even, odd] = &self.phi;
        let (mut e, mut o) = (even[T - 1], odd[T - 1]);
        for (even, odd) in even[..T - 1].iter().zip(&odd[..T - 1]).rev() {
            for i in 0..W {
                e[i] = e[i] * square[i] + even[i];
            }
            for i in 0..W {
                o[i] = o[i] * square[i] + odd[i];
            }
        }
        let mut v = [[0.0; W]; 2];
        for (v, first) in v.iter_mut().zip([0, W / 2]) {
            for i in 0..W / 2 {
                let (even, odd) = (e[first + i], z[first + i] * o[first + i]);
                (v[i], v[W - 1 - i]) = (even + odd, even - odd);
            }
        }
        v
    }

    #[inline(always)]
    fn spread(&self, points: &[Point], Target { cells, first, grid }: Target<'_>) {
        for p in points {
            let (x, inside_x) = first_cell(p.s, cells, W);
            let (y, inside_y) = first_cell(p.t, cells, W);
            let [row, column] = self.weights([inside_x, inside_y]);
            let (c_re, c_im) = (p.c.re as f32, p.c.im as f32);
            let (row_re, row_im) = (row.map(|w| w * c_re), row.map(|w| w * c_im));
            let start = (y - first.1) * grid.width + x - first.0;
            for (i, w) in column.into_iter().enumerate() {
                let at = start + i * grid.width;
                for (cells, row) in [(&mut grid.re[at..][..W], &row_re), (&mut grid.im[at..][..W], &row_im)] {
                    for (cell, v) in cells.iter_mut().zip(row) {
                        *cell += w * v;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn worst_error<const W: usize, const T: usize>() -> f64 {
        let kernel = Spreading::<W, T>::new();
        let inside = (0..=40).map(|i| f64::from(i) / 40.0);
        let errors = inside.flat_map(|inside| {
            let [along_x, along_y] = kernel.weights([inside, 1.0 - inside]);
            (0..W).flat_map(move |i| {
                let at = |inside: f64| phi(W, (i as f64 + inside) * 2.0 / W as f64 - 1.0);
                [f64::from(along_x[i]) - at(inside), f64::from(along_y[i]) - at(1.0 - inside)]
            })
        });
        errors.fold(0.0, |worst, error| worst.max(error.abs()))
    }

    #[test]
    fn polynomials_are_the_kernels() {
        let [eight, four] = [worst_error::<8, 6>(), worst_error::<4, 4>()];
        assert!(eight < 3e-7 && four < 6e-4, "{eight:e}, {four:e}");
    }
}
