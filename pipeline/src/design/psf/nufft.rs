//! Power of a Fourier sum of scattered points on a regular grid: a two-dimensional nonuniform FFT of type 1, in f32.
//!
//! ```text
//! U(j, k) = Σ c_i e^{i (j s_i + k t_i)}        j, k = −h..h,   |s|, |t| < π
//! ```
//! Each point is spread on a fine grid (1.5 times as many cells as outputs) with the kernel φ(z) = exp(β(√(1−z²) − 1)), w = 8 cells
//! wide, transformed by an FFT (`fourier`), and divided by the spectrum of φ. Error of U relative to √(Σ|c|²): 2e-6 (rms), at the edge of
//! the outputs at most 2e-5.
//! Only the cells that the points cover are stored, and columns and rows without points or outputs are not transformed.
//! Of points symmetric about t = 0 one half is given: U is then even in k, and half of the rows are transformed.
//! One thread, fixed order, no fused products: the same bits in every run and on every machine, whatever instructions the loops are compiled for.
//! Source: Barnett, Magland, af Klinteberg, A parallel nonuniform FFT library based on an "exponential of semicircle" kernel,
//! SIAM J. Sci. Comput. 41 (2019), sections 2-3. Signs: j runs with x, k with y.

use std::f64::consts::{PI, TAU};

use rustfft::num_complex::Complex;

use super::fourier::{Block, Fft, LANES, good_size};
use crate::design::pupil::quadrature::unit_interval;
use crate::real::{self, WHOLE};
use crate::simd::lanes::{Lanes, SimdOp};
use crate::simd::{Simd, UnfusedOp};

/// Kernel width in cells.
const WIDTH: usize = 8;
/// Cells per output.
const FINER: f64 = 1.5;
/// Points that are spread by one operation.
const POINTS: usize = 256;
/// Minimum number of cells: points up to 0.4 cycles have half a kernel's width of cells around them.
const MIN_CELLS: usize = 64;
/// Shape parameter γ π w (1 − 1/(2σ)) for σ cells per output (section 3 of the source), γ = 0.95.
const BETA: f64 = 0.95 * PI * WIDTH as f64 * (1.0 - 0.5 / FINER);
/// Degree of the polynomials that approximate φ, one per cell of its width: error below 1e-7.
const DEGREE: usize = 11;
/// Half of the cells of φ, which is even: the polynomials of the other half are those of −z.
const HALF: usize = WIDTH / 2;
/// Coefficients of one parity.
const TERMS: usize = DEGREE.div_ceil(2);

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
    fft: Fft,
    /// Coefficients of the even and odd powers of z, for the first half of the cells, twice: along x and along y.
    phi: [[[f32; 2 * HALF]; TERMS]; 2],
    deconvolve: Vec<f32>,
}

/// Buffers of one worker.
#[derive(Default)]
pub struct NufftScratch {
    some: Vec<Point>,
    grid: Plane,
    columns: Plane,
    block: Block,
    buffer: Block,
}

/// A complex plane, row by row.
#[derive(Default)]
struct Plane {
    width: usize,
    re: Vec<f32>,
    im: Vec<f32>,
}

/// Cells that points cover along one direction.
#[derive(Clone, Copy)]
struct Span {
    first: usize,
    count: usize,
}

impl std::fmt::Debug for Nufft {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Nufft").field("half", &self.half).field("cells", &self.cells).finish_non_exhaustive()
    }
}

impl Plane {
    /// Zeros.
    fn reset(&mut self, width: usize, rows: usize) {
        self.width = width;
        for part in [&mut self.re, &mut self.im] {
            part.clear();
            part.resize(width * rows, 0.0);
        }
    }
}

fn kernel(z: f64) -> f64 {
    if z.abs() >= 1.0 { 0.0 } else { real::exp(BETA * ((1.0 - z * z).sqrt() - 1.0)) }
}

impl Nufft {
    /// A plan for outputs −half..=half in both directions.
    pub fn new(half: usize) -> Self {
        let n = 2 * half + 1;
        let cells = good_size(((FINER * n as f64) as usize).max(MIN_CELLS));
        let nodes = unit_interval(100);
        let spectrum = |j: usize| {
            let w = WIDTH as f64 / 2.0;
            let f = TAU * j as f64 / cells as f64;
            2.0 * w * nodes.iter().map(|(z, g)| g * kernel(*z) * real::cos(f * w * z)).sum::<f64>()
        };
        Self {
            half,
            cells,
            fft: Fft::new(cells),
            phi: kernel_polynomials(),
            deconvolve: (0..=half).map(|j| (1.0 / spectrum(j)) as f32).collect(),
        }
    }

    /// Number of outputs per direction.
    pub fn size(&self) -> usize {
        2 * self.half + 1
    }

    /// |U|² · `scale` for every output, row by row (k slow), into `out`. `mirrored`: each point counts at −t
    /// as well. |s| and |t| must be below half a cycle by a margin of half the kernel width.
    pub fn power(
        &self,
        points: impl Iterator<Item = Point> + Clone,
        mirrored: bool,
        scale: f64,
        scratch: &mut NufftScratch,
        out: &mut Vec<f32>,
    ) {
        self.power_with(Simd::detect(), points, mirrored, scale, scratch, out);
    }

    /// [`Nufft::power`] with the instructions of `simd`.
    fn power_with(
        &self,
        simd: Simd,
        points: impl Iterator<Item = Point> + Clone,
        mirrored: bool,
        scale: f64,
        scratch: &mut NufftScratch,
        out: &mut Vec<f32>,
    ) {
        let (across, down) = (self.span(points.clone().map(|p| p.s)), self.span(points.clone().map(|p| p.t)));
        scratch.grid.reset(across.count, down.count);
        let NufftScratch { grid, some, .. } = scratch;
        let first = (across.first, down.first);
        some.clear();
        points.for_each(|point| {
            some.push(point);
            if some.len() == POINTS {
                Spread { plan: self, points: some, first, grid }.run_unfused(simd);
                some.clear();
            }
        });
        Spread { plan: self, points: some, first, grid }.run_unfused(simd);
        Transform { plan: self, spans: (across, down), mirrored, scale, scratch, out }.run_unfused(simd);
    }

    /// Columns from `first` on of the grid to the outputs along y, of k ≥ 0 only if `mirrored`.
    #[inline(always)]
    fn transform_columns(&self, first: usize, down: Span, mirrored: bool, scratch: &mut NufftScratch) {
        let NufftScratch { grid, columns, block, buffer, .. } = scratch;
        let width = grid.width;
        let count = LANES.min(width - first);
        for (to, from) in [(&mut block.re, &grid.re), (&mut block.im, &grid.im)] {
            to.clear();
            to.resize(down.count * LANES, 0.0);
            for (to, from) in to.as_chunks_mut::<LANES>().0.iter_mut().zip(from.chunks_exact(width)) {
                let from = &from[first..first + count];
                match from.try_into() {
                    Ok(all) => *to = all,
                    Err(_) => to[..count].copy_from_slice(from),
                }
            }
        }
        self.fft.process(block, down.count, buffer);
        let rows = columns.re.chunks_exact_mut(width).zip(columns.im.chunks_exact_mut(width));
        let lanes = |k: usize| (&block.re[k * LANES..][..count], &block.im[k * LANES..][..count]);
        // Row 0 of the block is t = down.first / cells − 1/2 cycles.
        let origin = down.first as f64 - 0.5 * self.cells as f64;
        for (y, (re, im)) in rows.enumerate() {
            let (re, im) = (&mut re[first..first + count], &mut im[first..first + count]);
            if mirrored {
                let (sin, cos) = real::sin_cos(TAU * origin * y as f64 / self.cells as f64);
                let (c, s) = (cos as f32 * self.deconvolve[y], sin as f32 * self.deconvolve[y]);
                let ((a_re, a_im), (b_re, b_im)) = (lanes(y), lanes((self.cells - y) % self.cells));
                for i in 0..count {
                    re[i] = c * (a_re[i] + b_re[i]) - s * (a_im[i] - b_im[i]);
                    im[i] = c * (a_im[i] + b_im[i]) + s * (a_re[i] - b_re[i]);
                }
            } else {
                // The phase of the origin has no effect on the power.
                let (a_re, a_im) = lanes((y + self.cells - self.half) % self.cells);
                let d = self.deconvolve[y.abs_diff(self.half)];
                for i in 0..count {
                    (re[i], im[i]) = (d * a_re[i], d * a_im[i]);
                }
            }
        }
    }

    /// Rows from `first` on of the output; `first_row` is the output row of row 0 of the columns.
    #[inline(always)]
    fn transform_rows(
        &self,
        first: usize,
        first_row: usize,
        scale: f32,
        scratch: &mut NufftScratch,
        out: &mut [f32],
    ) {
        let NufftScratch { columns, block, buffer, .. } = scratch;
        let (n, width) = (self.size(), columns.width);
        let count = LANES.min(n - first);
        for (to, from) in [(&mut block.re, &columns.re), (&mut block.im, &columns.im)] {
            to.clear();
            to.resize(width * LANES, 0.0);
            let rows = &from[(first - first_row) * width..];
            for (i, to) in to.chunks_exact_mut(LANES).enumerate() {
                for (lane, to) in to[..count].iter_mut().enumerate() {
                    *to = rows[lane * width + i];
                }
            }
        }
        self.fft.process(block, width, buffer);
        let rows = &mut out[first * n..(first + count) * n];
        for x in 0..n {
            let from = (x + self.cells - self.half) % self.cells * LANES;
            let d = self.deconvolve[x.abs_diff(self.half)];
            let d = d * d * scale;
            let (re, im) = (&block.re[from..][..LANES], &block.im[from..][..LANES]);
            for lane in 0..count {
                rows[lane * n + x] = d * (re[lane] * re[lane] + im[lane] * im[lane]);
            }
        }
    }

    /// Cells that points at `cycles` are spread on.
    fn span(&self, cycles: impl Iterator<Item = f64>) -> Span {
        let (low, high) = cycles.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        if low > high {
            return Span { first: 0, count: WIDTH };
        }
        let first = self.cell(low).0;
        Span { first, count: self.cell(high).0 + WIDTH - first }
    }

    /// First cell of a point's kernel, and the distance (in cells, 0..1) of that cell from the kernel's edge.
    #[inline(always)]
    fn cell(&self, cycles: f64) -> (usize, f64) {
        let edge = (cycles + 0.5) * self.cells as f64 - WIDTH as f64 / 2.0;
        // The next whole number, without a conversion: the last bits of a number this large are its integer.
        let nearest = (edge + WHOLE) - WHOLE;
        let first = (nearest + if nearest < edge { 1.0 } else { 0.0 }).max(0.0);
        ((first + WHOLE).to_bits() as u32 as usize, first - edge)
    }

    /// The kernel at the cells along x and along y of a point at these distances.
    #[inline(always)]
    fn weights(&self, inside: [f64; 2]) -> [[f32; WIDTH]; 2] {
        let [x, y] = inside.map(|inside| (2.0 * inside - 1.0) as f32);
        let z = [x, x, x, x, y, y, y, y];
        let square = z.map(|z| z * z);
        let [even, odd] = &self.phi;
        let (mut e, mut o) = (even[TERMS - 1], odd[TERMS - 1]);
        for (even, odd) in even[..TERMS - 1].iter().zip(&odd[..TERMS - 1]).rev() {
            for i in 0..2 * HALF {
                e[i] = e[i] * square[i] + even[i];
            }
            for i in 0..2 * HALF {
                o[i] = o[i] * square[i] + odd[i];
            }
        }
        let mut v = [[0.0; WIDTH]; 2];
        for (v, first) in v.iter_mut().zip([0, HALF]) {
            for i in 0..HALF {
                let (even, odd) = (e[first + i], z[first + i] * o[first + i]);
                (v[i], v[WIDTH - 1 - i]) = (even + odd, even - odd);
            }
        }
        v
    }

    #[inline(always)]
    fn spread(&self, p: &Point, first: (usize, usize), grid: &mut Plane) {
        let (x, inside_x) = self.cell(p.s);
        let (y, inside_y) = self.cell(p.t);
        let [row, column] = self.weights([inside_x, inside_y]);
        let (c_re, c_im) = (p.c.re as f32, p.c.im as f32);
        let (row_re, row_im) = (row.map(|w| w * c_re), row.map(|w| w * c_im));
        let start = (y - first.1) * grid.width + x - first.0;
        for (i, w) in column.into_iter().enumerate() {
            let at = start + i * grid.width;
            for (cells, row) in
                [(&mut grid.re[at..][..WIDTH], &row_re), (&mut grid.im[at..][..WIDTH], &row_im)]
            {
                for (cell, v) in cells.iter_mut().zip(row) {
                    *cell += w * v;
                }
            }
        }
    }
}

/// Spreads points on the grid, whose first cell is `first`.
struct Spread<'a> {
    plan: &'a Nufft,
    points: &'a [Point],
    first: (usize, usize),
    grid: &'a mut Plane,
}

impl<V: Lanes> SimdOp<V> for Spread<'_> {
    #[inline(always)]
    fn run(self) {
        for point in self.points {
            self.plan.spread(point, self.first, self.grid);
        }
    }
}

/// From the grid, which has the cells `spans` across and down, to the power.
struct Transform<'a> {
    plan: &'a Nufft,
    spans: (Span, Span),
    mirrored: bool,
    scale: f64,
    scratch: &'a mut NufftScratch,
    out: &'a mut Vec<f32>,
}

impl<V: Lanes> SimdOp<V> for Transform<'_> {
    #[inline(always)]
    fn run(self) {
        let Self { plan, spans: (across, down), mirrored, scale, scratch, out } = self;
        let n = plan.size();
        scratch.columns.reset(across.count, if mirrored { plan.half + 1 } else { n });
        for first in (0..across.count).step_by(LANES) {
            plan.transform_columns(first, down, mirrored, scratch);
        }
        out.clear();
        out.resize(n * n, 0.0);
        let first_row = if mirrored { plan.half } else { 0 };
        for first in (first_row..n).step_by(LANES) {
            plan.transform_rows(first, first_row, scale as f32, scratch, out);
        }
        if mirrored {
            let (upper, lower) = out.split_at_mut(plan.half * n);
            for (to, from) in upper.chunks_exact_mut(n).rev().zip(lower[n..].chunks_exact(n)) {
                to.copy_from_slice(from);
            }
        }
    }
}

/// φ over each cell of the first half of its width as a polynomial of z = 2·inside − 1, by interpolation at Chebyshev points.
fn kernel_polynomials() -> [[[f32; 2 * HALF]; TERMS]; 2] {
    let n = DEGREE + 1;
    let mut out = [[0.0_f64; HALF]; DEGREE + 1];
    let node = |i: usize| real::cos(PI * (i as f64 + 0.5) / n as f64);
    for cell in 0..HALF {
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
    let twice = |power: [f64; HALF]| std::array::from_fn(|i| power[i % HALF] as f32);
    [0, 1].map(|parity| std::array::from_fn(|k| twice(out[2 * k + parity])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Isa;

    fn random(seed: &mut u64) -> f64 {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    }

    #[test]
    fn power_equals_that_of_the_direct_sum() {
        let mut seed = 7;
        for (half, mirrored) in [(3_usize, false), (20, true), (20, false), (33, true)] {
            let points: Vec<Point> = (0..300)
                .map(|_| {
                    let t = 0.4 * random(&mut seed);
                    let c = Complex::new(random(&mut seed), random(&mut seed));
                    Point { s: 0.5 * random(&mut seed), t: if mirrored { t.abs() } else { t }, c }
                })
                .collect();
            let norm: f64 = points.iter().map(|p| p.c.norm_sqr()).sum();
            let plan = Nufft::new(half);
            let mut out = Vec::new();
            plan.power(points.iter().copied(), mirrored, 0.5, &mut NufftScratch::default(), &mut out);
            for simd in Isa::ALL.into_iter().filter_map(|isa| Simd::require(isa).ok()) {
                let (points, mut same) = (points.iter().copied(), Vec::new());
                plan.power_with(simd, points, mirrored, 0.5, &mut NufftScratch::default(), &mut same);
                assert!(out == same, "{simd:?}: other bits");
            }
            let n = plan.size();
            let (mut worst, mut squares) = (0.0_f64, 0.0);
            for (i, power) in out.iter().enumerate().take(n * n) {
                let (j, k) = ((i % n) as f64 - half as f64, (i / n) as f64 - half as f64);
                let wave = |p: &Point, t: f64| p.c * Complex::from_polar(1.0, TAU * (j * p.s + k * t));
                let lower = |p: &Point| if mirrored { wave(p, -p.t) } else { Complex::default() };
                let u: Complex<f64> = points.iter().map(|p| wave(p, p.t) + lower(p)).sum();
                let error = (f64::from(*power) - 0.5 * u.norm_sqr()) / norm;
                worst = worst.max(error.abs());
                squares += error * error / (n * n) as f64;
            }
            let rms = squares.sqrt();
            assert!(worst < 1e-4 && rms < 5e-6, "half {half}, mirrored {mirrored}: {worst:e}, rms {rms:e}");
        }
    }
}
