//! Kernels in lanes: the spline of a PSF read at turned positions, and its integrals over film pixels.
//!
//! The same sums as [`crate::psf::kernel`]'s in f64. Positions come from one f64 anchor a register, so f32 holds them to
//! 1e-6 of a sample. The 4 × 4 coefficients of a position are four loads of four; a register holds those of every fourth
//! position, is weighed by rows, turned quad by quad, and weighed by columns.
#![allow(unsafe_code, reason = "bounds are checked once a register, not once a load")]
#![allow(clippy::needless_range_loop, reason = "lanes of several arrays at once")]

use crate::psf::kernel::{DARK, MARGIN, Weights};
use crate::real;
use crate::simd::lanes::{Lanes, WIDEST, Work};

/// Reads the spline of `coefficients` (n × n, margins of [`MARGIN`] zeros) at positions turned by −azimuth about its
/// centre: n rows of `stride` ≥ n values, what lies past the n-th of no meaning.
pub(in crate::psf) struct Turn<'a> {
    pub(in crate::psf) coefficients: &'a [f32],
    pub(in crate::psf) n: usize,
    pub(in crate::psf) azimuth_rad: f64,
    pub(in crate::psf) to: &'a mut [f32],
    pub(in crate::psf) stride: usize,
}

impl<V: Lanes> Work<V> for Turn<'_> {
    #[inline(always)]
    fn run(mut self) {
        let (sin, cos) = real::sin_cos(self.azimuth_rad);
        let c = (self.n as f64 - 1.0) / 2.0;
        let middle = (V::LANES / 2) as f64;
        let t = V::count() - V::splat(middle as f32);
        let (along, across) = (t * V::splat(cos as f32), t * V::splat(-sin as f32));
        // Farther out all coefficients of a register are 0.
        let (low, high) = (-(middle + 4.0), self.n as f64 + middle + 3.0);
        let lines = std::mem::take(&mut self.to).chunks_exact_mut(self.stride).take(self.n);
        for (row, to) in lines.enumerate() {
            let y = row as f64 - c;
            for (i, to) in to.chunks_exact_mut(V::LANES).enumerate() {
                let x = (i * V::LANES) as f64 + middle - c;
                let (u, v) = (c + x * cos + y * sin, c - x * sin + y * cos);
                let dark = u < low || u > high || v < low || v > high;
                let value = if dark { V::splat(0.0) } else { self.at((u, along), (v, across)) };
                value.zero_below(V::splat(DARK)).store(to);
            }
        }
    }
}

impl Turn<'_> {
    /// The spline at an anchor plus what the lanes depart from it.
    #[inline(always)]
    fn at<V: Lanes>(&self, u: (f64, V), v: (f64, V)) -> V {
        let width = self.n + 2 * MARGIN;
        let ((col, wu), (row, wv)) = (self.cell(u), self.cell(v));
        // The first of the 4 × 4, MARGIN and one before it; exact, for it is far below 2^24.
        let lead = V::splat((MARGIN - 1) as f32);
        let first = (row + lead).mul_add(V::splat(width as f32), col + lead).ints();
        let last = self.coefficients.len() - 3 * width - 4;
        assert!(V::within(first, last as i32));
        let mut at = [0; WIDEST];
        V::store_ints(first, &mut at);
        let mut rows = [V::splat(0.0); 4];
        for j in 0..4 {
            // SAFETY: 4 values from j ≤ 3 rows after an index that is at most `last` lie in the slice.
            let quads = unsafe {
                [
                    V::quads(self.coefficients, &at, 0, j * width),
                    V::quads(self.coefficients, &at, 1, j * width),
                    V::quads(self.coefficients, &at, 2, j * width),
                    V::quads(self.coefficients, &at, 3, j * width),
                ]
            };
            rows[0] = quads[0].mul_add(wv[j].spread::<0>(), rows[0]);
            rows[1] = quads[1].mul_add(wv[j].spread::<1>(), rows[1]);
            rows[2] = quads[2].mul_add(wv[j].spread::<2>(), rows[2]);
            rows[3] = quads[3].mul_add(wv[j].spread::<3>(), rows[3]);
        }
        let columns = V::transpose_quads(rows);
        let mut sum = columns[0] * wu[0];
        for k in 1..4 {
            sum = columns[k].mul_add(wu[k], sum);
        }
        sum
    }

    /// Cells of the positions along one direction, kept where all coefficients are 0 if they lie outside, and the spline's
    /// weights ([`crate::psf::spline::weights`]).
    #[inline(always)]
    fn cell<V: Lanes>(&self, (anchor, departs): (f64, V)) -> (V, [V; 4]) {
        let whole = anchor.floor();
        let at = departs + V::splat((anchor - whole) as f32);
        let below = at.floor();
        let f = at - below;
        let cell = (below + V::splat(whole as f32)).max(V::splat(-3.0)).min(V::splat(self.n as f32 + 1.0));
        let (half, sixth, two_thirds) = (V::splat(0.5), V::splat(1.0 / 6.0), V::splat(2.0 / 3.0));
        let g = V::splat(1.0) - f;
        let (f2, g2) = (f * f, g * g);
        (
            cell,
            [
                g2 * g * sixth,
                f2.mul_add(f.mul_sub(half, V::splat(1.0)), two_thirds),
                g2.mul_add(g.mul_sub(half, V::splat(1.0)), two_thirds),
                f2 * f * sixth,
            ],
        )
    }
}

/// Rows of `from` to film pixels: `to` gets a row of `stride` values for each of `pixels`, Σ weight · row.
pub(in crate::psf) struct Integrate<'a> {
    pub(in crate::psf) pixels: &'a [Weights],
    pub(in crate::psf) from: &'a [f32],
    pub(in crate::psf) to: &'a mut [f32],
    /// From row to row of both, whole registers.
    pub(in crate::psf) stride: usize,
}

impl<V: Lanes> Work<V> for Integrate<'_> {
    #[inline(always)]
    fn run(self) {
        for (pixel, to) in self.pixels.iter().zip(self.to.chunks_exact_mut(self.stride)) {
            let (first, weights) = &pixel.narrow;
            let rows = &self.from[first * self.stride..][..weights.len() * self.stride];
            let mut x = 0;
            while x < self.stride {
                // Four sums at a time hide what an addition waits for.
                let wide = x + 4 * V::LANES <= self.stride;
                let count = if wide { 4 } else { 1 };
                let mut sums = [V::splat(0.0); 4];
                for (w, row) in weights.iter().zip(rows.chunks_exact(self.stride)) {
                    let w = V::splat(*w);
                    if wide {
                        let row = &row[x..x + 4 * V::LANES];
                        for i in 0..4 {
                            sums[i] = V::load(&row[i * V::LANES..]).mul_add(w, sums[i]);
                        }
                    } else {
                        sums[0] = V::load(&row[x..]).mul_add(w, sums[0]);
                    }
                }
                for i in 0..count {
                    sums[i].store(&mut to[x + i * V::LANES..]);
                }
                x += count * V::LANES;
            }
        }
    }
}

/// Rows to columns: `rows` rows of `from_stride` values to columns of `to`, whole registers both ways.
pub(in crate::psf) struct Transpose<'a> {
    pub(in crate::psf) from: &'a [f32],
    pub(in crate::psf) from_stride: usize,
    pub(in crate::psf) to: &'a mut [f32],
    pub(in crate::psf) to_stride: usize,
}

impl<V: Lanes> Work<V> for Transpose<'_> {
    #[inline(always)]
    fn run(self) {
        for y in (0..self.to_stride).step_by(V::LANES) {
            for x in (0..self.from_stride).step_by(V::LANES) {
                let mut rows = [V::splat(0.0); WIDEST];
                let rows = &mut rows[..V::LANES];
                for i in 0..V::LANES {
                    rows[i] = V::load(&self.from[(y + i) * self.from_stride + x..]);
                }
                V::transpose(rows);
                for i in 0..V::LANES {
                    rows[i].store(&mut self.to[(x + i) * self.to_stride + y..]);
                }
            }
        }
    }
}
