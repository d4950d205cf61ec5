//! Power of a Fourier sum of scattered points on a regular grid: a two-dimensional nonuniform FFT of type 1, in f32.
//!
//! ```text
//! U(j, k) = Σ c_i e^{i (j s_i + k t_i)}        j, k = −h..h,   |s|, |t| < π
//! ```
//! Each point is spread on a fine grid (1.5 times as many cells as outputs) with a kernel φ (`spreading`), transformed by an FFT
//! (`fourier`), and divided by the spectrum of φ. Errors: [`Accuracy`]. They are what U has beyond the grid, of which φ lets that part pass: of a
//! PSF there is next to nothing.
//! Only the cells that the points cover are stored, and columns and rows without points or outputs are not transformed.
//! Of points symmetric about t = 0 one half is given: U is then even in k, and half of the rows are transformed.
//! One thread, fixed order, no fused products: the same bits in every run and on every machine, whatever instructions the loops are compiled for.
//! Source: Barnett, Magland, af Klinteberg, A parallel nonuniform FFT library based on an "exponential of semicircle" kernel,
//! SIAM J. Sci. Comput. 41 (2019), sections 2-3. Signs: j runs with x, k with y.

use std::f64::consts::TAU;

use rustfft::num_complex::Complex;

use super::fourier::{Block, Fft, LANES, good_size};
use super::spreading::{Kernel, Plane, Target, first_cell};
use crate::design::pupil::quadrature::unit_interval;
use crate::real;
use crate::simd::lanes::{Lanes, SimdOp};
use crate::simd::{Simd, UnfusedOp};

/// Cells per output.
pub(super) const FINER: f64 = 1.5;
/// Points that are spread by one operation.
const POINTS: usize = 256;
/// Minimum number of cells: points up to 0.4 cycles have half a kernel's width of cells around them.
const MIN_CELLS: usize = 64;

/// How exact a sum is: the error of U relative to √(Σ|c|²).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Accuracy {
    /// Of PSFs that films use: 2e-6 (rms), at the edge of the outputs at most 2e-5; a kernel of eight cells.
    Film,
    /// Of PSFs whose light or kernels are compared: 2e-3 (rms), at the edge of the outputs at most 2e-2; a kernel of four cells.
    Comparison,
}

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
    kernel: Kernel,
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

impl Nufft {
    /// A plan for outputs −half..=half in both directions.
    pub fn new(half: usize, accuracy: Accuracy) -> Self {
        let n = 2 * half + 1;
        let cells = good_size(((FINER * n as f64) as usize).max(MIN_CELLS));
        let kernel = Kernel::new(accuracy);
        let nodes = unit_interval(100);
        let spectrum = |j: usize| {
            let w = kernel.width() as f64 / 2.0;
            let f = TAU * j as f64 / cells as f64;
            2.0 * w * nodes.iter().map(|(z, g)| g * kernel.at(*z) * real::cos(f * w * z)).sum::<f64>()
        };
        let deconvolve = (0..=half).map(|j| (1.0 / spectrum(j)) as f32).collect();
        Self { half, cells, fft: Fft::new(cells), kernel, deconvolve }
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
        let (across, down) = self.spans(points.clone());
        scratch.grid.reset(across.count, down.count);
        let NufftScratch { grid, some, .. } = scratch;
        let first = (across.first, down.first);
        let mut spread = |points: &[Point]| {
            let grid = &mut *grid;
            Spread { kernel: &self.kernel, points, to: Target { cells: self.cells, first, grid } }
                .run_unfused(simd);
        };
        some.clear();
        points.for_each(|point| {
            some.push(point);
            if some.len() == POINTS {
                spread(some);
                some.clear();
            }
        });
        spread(some);
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

    /// Cells across and down that `points` are spread on.
    fn spans(&self, points: impl Iterator<Item = Point>) -> (Span, Span) {
        let none = [(f64::INFINITY, f64::NEG_INFINITY); 2];
        let [s, t] =
            points.fold(none, |[s, t], p| [(s.0.min(p.s), s.1.max(p.s)), (t.0.min(p.t), t.1.max(p.t))]);
        let width = self.kernel.width();
        let span = |(low, high): (f64, f64)| {
            if low > high {
                return Span { first: 0, count: width };
            }
            let [first, last] = [low, high].map(|cycles| first_cell(cycles, self.cells, width).0);
            Span { first, count: last + width - first }
        };
        (span(s), span(t))
    }
}

/// Spreads points.
struct Spread<'a> {
    kernel: &'a Kernel,
    points: &'a [Point],
    to: Target<'a>,
}

impl<V: Lanes> SimdOp<V> for Spread<'_> {
    #[inline(always)]
    fn run(self) {
        self.kernel.spread(self.points, self.to);
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
        use Accuracy::{Comparison, Film};
        let cases = [
            (3_usize, false, Film),
            (20, true, Film),
            (20, false, Film),
            (33, true, Film),
            (20, true, Comparison),
            (33, false, Comparison),
        ];
        for (half, mirrored, accuracy) in cases {
            let points: Vec<Point> = (0..300)
                .map(|_| {
                    let t = 0.4 * random(&mut seed);
                    let c = Complex::new(random(&mut seed), random(&mut seed));
                    Point { s: 0.5 * random(&mut seed), t: if mirrored { t.abs() } else { t }, c }
                })
                .collect();
            let norm: f64 = points.iter().map(|p| p.c.norm_sqr()).sum();
            let plan = Nufft::new(half, accuracy);
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
            let (most, most_rms) = match accuracy {
                Film => (1e-4, 5e-6),
                Comparison => (4e-2, 5e-3),
            };
            assert!(
                worst < most && rms < most_rms,
                "half {half}, mirrored {mirrored}, {accuracy:?}: {worst:e}, rms {rms:e}"
            );
        }
    }
}
