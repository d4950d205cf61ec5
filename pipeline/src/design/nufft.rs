//! Fourier sum of scattered points on a regular grid: a two-dimensional nonuniform FFT of type 1.
//!
//!     U(j, k) = Σ c_i e^{i (j s_i + k t_i)}        j, k = −h..h,   |s|, |t| < π
//! Each point is spread on a fine grid (twice as many cells as outputs) with the kernel φ(z) = exp(β(√(1−z²) − 1)), w = 8 cells
//! wide, transformed by an FFT, and divided by the spectrum of φ. Error about 1e-7 of Σ|c|. Rows without points and columns outside
//! the output are not transformed. One thread, fixed order: the same bits in every run.
//! Source: Barnett, Magland, af Klinteberg, A parallel nonuniform FFT library based on an "exponential of semicircle" kernel,
//! SIAM J. Sci. Comput. 41 (2019), sections 2-3. Signs: j runs with x, k with y; a factor (−1)^(j+k) is not removed.

use crate::real;
use std::f64::consts::PI;
use std::sync::Arc;

use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlanner};

use super::pupil::unit_interval;

/// Kernel width in cells.
const WIDTH: usize = 8;
/// Shape parameter for twice oversampled grids (2.30 per cell of width).
const BETA: f64 = 2.30 * WIDTH as f64;
/// Degree of the polynomials that approximate φ, one per cell of its width: error below 1e-9.
const DEGREE: usize = 13;
/// Columns transformed together, to use complete cache lines.
const BLOCK: usize = 8;

/// A point of the sum: s and t in cycles, and its coefficient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// s / 2π.
    pub s: f64,
    /// t / 2π.
    pub t: f64,
    /// Coefficient.
    pub c: Complex<f64>,
}

/// A plan for sums of one size.
pub struct Nufft {
    half: usize,
    cells: usize,
    fft: Arc<dyn Fft<f64>>,
    phi: [[f64; WIDTH]; DEGREE + 1],
    deconvolve: Vec<f64>,
}

/// Buffers of one worker.
#[derive(Default)]
pub struct NufftScratch {
    grid: Vec<Complex<f64>>,
    columns: Vec<Complex<f64>>,
    fft: Vec<Complex<f64>>,
}

impl std::fmt::Debug for Nufft {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Nufft").field("half", &self.half).field("cells", &self.cells).finish_non_exhaustive()
    }
}

fn kernel(z: f64) -> f64 {
    if z.abs() >= 1.0 { 0.0 } else { real::exp(BETA * ((1.0 - z * z).sqrt() - 1.0)) }
}

impl Nufft {
    /// A plan for outputs −half..=half in both directions.
    pub fn new(half: usize) -> Self {
        let cells = good_size(2 * (2 * half + 1).max(4 * WIDTH));
        let nodes = unit_interval(100);
        let spectrum = |j: usize| {
            let w = WIDTH as f64 / 2.0;
            let f = 2.0 * PI * j as f64 / cells as f64;
            2.0 * w * nodes.iter().map(|(z, g)| g * kernel(*z) * real::cos(f * w * z)).sum::<f64>()
        };
        Self {
            half,
            cells,
            fft: FftPlanner::new().plan_fft_inverse(cells),
            phi: kernel_polynomials(),
            deconvolve: (0..=half).map(|j| 1.0 / spectrum(j)).collect(),
        }
    }

    /// Number of outputs per direction.
    pub fn size(&self) -> usize {
        2 * self.half + 1
    }

    /// The sum over `points`, row by row (k slow), into `out`. |s| and |t| must be below half a cycle by a
    /// margin of half the kernel width.
    pub fn sum(&self, points: &[Point], scratch: &mut NufftScratch, out: &mut Vec<Complex<f64>>) {
        let zero = Complex::new(0.0, 0.0);
        let cells = self.cells;
        let (low, high) = points.iter().fold((0.0_f64, 0.0_f64), |(a, b), p| (a.min(p.t), b.max(p.t)));
        let first = self.cell(low).0;
        let rows = self.cell(high).0 + WIDTH - first;
        scratch.grid.clear();
        scratch.grid.resize(rows * cells, zero);
        for p in points {
            self.spread(p, first, &mut scratch.grid);
        }
        scratch.fft.resize(self.fft.get_inplace_scratch_len(), zero);
        for row in scratch.grid.chunks_exact_mut(cells) {
            self.fft.process_with_scratch(row, &mut scratch.fft);
        }
        let n = self.size();
        out.clear();
        out.resize(n * n, zero);
        // Columns are in FFT order after the row transform: j = 0..half, then −half..−1.
        let runs = [(0, self.half + 1), (cells - self.half, self.half)];
        for (start, count) in runs {
            for at in (0..count).step_by(BLOCK) {
                self.columns(start + at, BLOCK.min(count - at), first, rows, scratch, out);
            }
        }
    }

    fn columns(
        &self,
        start: usize,
        count: usize,
        first: usize,
        rows: usize,
        scratch: &mut NufftScratch,
        out: &mut [Complex<f64>],
    ) {
        let (cells, n, half) = (self.cells, self.size(), self.half);
        scratch.columns.clear();
        scratch.columns.resize(count * cells, Complex::new(0.0, 0.0));
        for r in 0..rows {
            let row = &scratch.grid[r * cells + start..][..count];
            for (c, v) in row.iter().enumerate() {
                scratch.columns[c * cells + first + r] = *v;
            }
        }
        for (c, column) in scratch.columns.chunks_exact_mut(cells).enumerate() {
            self.fft.process_with_scratch(column, &mut scratch.fft);
            let j = start + c;
            let (x, jx) = if j <= half { (half + j, j) } else { (half + j - cells, cells - j) };
            for y in 0..n {
                let k = y.abs_diff(half);
                let from = if y >= half { k } else { cells - k };
                out[y * n + x] = column[from % cells] * (self.deconvolve[jx] * self.deconvolve[k]);
            }
        }
    }

    /// First cell of a point's kernel, and the distance (in cells, 0..1) of that cell from the kernel's edge.
    fn cell(&self, cycles: f64) -> (usize, f64) {
        let edge = (cycles + 0.5) * self.cells as f64 - WIDTH as f64 / 2.0;
        let first = edge.ceil();
        (first as usize, first - edge)
    }

    #[inline]
    fn weights(&self, inside: f64) -> [f64; WIDTH] {
        let z = 2.0 * inside - 1.0;
        let mut v = self.phi[DEGREE];
        for coefficients in self.phi[..DEGREE].iter().rev() {
            for (v, c) in v.iter_mut().zip(coefficients) {
                *v = *v * z + c;
            }
        }
        v
    }

    #[inline]
    fn spread(&self, p: &Point, first_row: usize, grid: &mut [Complex<f64>]) {
        let (x, inside_x) = self.cell(p.s);
        let (y, inside_y) = self.cell(p.t);
        let row = self.weights(inside_x).map(|w| p.c * w);
        for (i, w) in self.weights(inside_y).into_iter().enumerate() {
            let cells = &mut grid[(y - first_row + i) * self.cells + x..][..WIDTH];
            for (cell, v) in cells.iter_mut().zip(&row) {
                cell.re += w * v.re;
                cell.im += w * v.im;
            }
        }
    }
}

/// φ over each cell of its width as a polynomial of z = 2·inside − 1, by interpolation at Chebyshev points.
fn kernel_polynomials() -> [[f64; WIDTH]; DEGREE + 1] {
    let n = DEGREE + 1;
    let mut out = [[0.0; WIDTH]; DEGREE + 1];
    let node = |i: usize| real::cos(PI * (i as f64 + 0.5) / n as f64);
    for cell in 0..WIDTH {
        let value = |z: f64| kernel((cell as f64 + 0.5 * (z + 1.0)) * 2.0 / WIDTH as f64 - 1.0);
        // Chebyshev coefficients, then T_k as a power series.
        let (mut before, mut now) = (vec![0.0; n + 1], vec![0.0; n + 1]);
        before[0] = 1.0;
        now[1] = 1.0;
        for k in 0..n {
            let sum: f64 =
                (0..n).map(|i| value(node(i)) * real::cos(k as f64 * PI * (i as f64 + 0.5) / n as f64)).sum();
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
    out
}

/// The next even number with factors 2, 3, 5 only.
fn good_size(min: usize) -> usize {
    let smooth = |mut n: usize| {
        for p in [2, 3, 5] {
            while n.is_multiple_of(p) {
                n /= p;
            }
        }
        n == 1
    };
    (min.next_multiple_of(2)..).step_by(2).find(|n| smooth(*n)).expect("there is always a larger one")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sum_equals_the_direct_sum() {
        let mut seed = 7_u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let points: Vec<Point> = (0..300)
            .map(|_| Point { s: 0.7 * random(), t: 0.6 * random(), c: Complex::new(random(), random()) })
            .collect();
        let norm: f64 = points.iter().map(|p| p.c.norm()).sum();
        for half in [3_usize, 20, 33] {
            let plan = Nufft::new(half);
            let mut out = Vec::new();
            plan.sum(&points, &mut NufftScratch::default(), &mut out);
            let n = plan.size();
            for y in 0..n {
                for x in 0..n {
                    let (j, k) = (x as f64 - half as f64, y as f64 - half as f64);
                    let expected: Complex<f64> = points
                        .iter()
                        .map(|p| p.c * Complex::from_polar(1.0, 2.0 * PI * (j * p.s + k * p.t)))
                        .sum();
                    let sign = if (x + y + 2 * half) % 2 == 0 { 1.0 } else { -1.0 };
                    let error = (out[y * n + x] * sign - expected).norm() / norm;
                    assert!(error < 1e-7, "half {half} ({j}, {k}): {error:e}");
                }
            }
        }
    }
}
