//! Rotation and integration of PSFs with SIMD: the same sums as [`super::rotation`] and [`super::integration`], in f32.
//!
//! Positions are taken relative to one f64 anchor per register, so f32 holds them to 1e-6 of a sample. The 4 × 4 coefficients of a
//! position are four loads of four; one register holds those of every fourth position. They are weighted by rows, transposed
//! quad by quad, and weighted by columns.
#![allow(unsafe_code, reason = "bounds are checked once per register, not once per load")]
#![allow(clippy::needless_range_loop, reason = "lanes of several arrays at once")]

use super::integration::PixelWeights;
use super::rotation::{MARGIN, NEGLIGIBLE_SAMPLE};
use crate::real;
use crate::simd::Simd;
use crate::simd::lanes::{Dispatch, Lanes, MAX_LANES, SimdOp};

/// Buffers of one worker: rotated samples; rows integrated; transposed; film pixels column by column.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    rotated: Vec<f32>,
    half: Vec<f32>,
    transposed: Vec<f32>,
    columns: Vec<f32>,
}

/// A kernel to compute: the PSF of `coefficients` (`samples`², margins of [`MARGIN`]) rotated by `azimuth_rad` and integrated over
/// `size`² film pixels, or cropped to them without `pixels`.
pub(super) struct RotatedKernel<'a> {
    pub(super) coefficients: &'a [f32],
    pub(super) samples: usize,
    pub(super) azimuth_rad: f64,
    pub(super) pixels: Option<&'a [PixelWeights]>,
    pub(super) size: usize,
}

impl RotatedKernel<'_> {
    /// The kernel, sum 1, into `out`; `simd` selects the instructions of `V`.
    pub(super) fn compute<V: Lanes>(&self, simd: Simd, s: &mut Buffers, out: &mut Vec<f32>) {
        let (n, size, dispatch) = (self.samples, self.size, Dispatch::<V>::new(simd));
        let (sample_stride, film_stride) = (n.next_multiple_of(MAX_LANES), size.next_multiple_of(MAX_LANES));
        let Buffers { rotated, half, transposed, columns } = s;
        rotated.resize(n * sample_stride, 0.0);
        let (coefficients, azimuth_rad) = (self.coefficients, self.azimuth_rad);
        dispatch.run(Rotate { coefficients, n, azimuth_rad, to: rotated, stride: sample_stride });
        out.clear();
        match self.pixels {
            None => {
                let edge = (n - size) / 2;
                for y in 0..size {
                    out.extend_from_slice(&rotated[(y + edge) * sample_stride + edge..][..size]);
                }
            }
            Some(pixels) => {
                half.resize(film_stride * sample_stride, 0.0);
                transposed.resize(sample_stride * film_stride, 0.0);
                columns.resize(size * film_stride, 0.0);
                dispatch.run(IntegrateRows { pixels, from: rotated, to: half, stride: sample_stride });
                dispatch.run(Transpose {
                    from: half,
                    from_stride: sample_stride,
                    to: transposed,
                    to_stride: film_stride,
                });
                dispatch.run(IntegrateRows { pixels, from: transposed, to: columns, stride: film_stride });
                for y in 0..size {
                    out.extend(columns.chunks_exact(film_stride).map(|column| column[y]));
                }
            }
        }
        let sum: f64 = out.iter().map(|&v| f64::from(v)).sum();
        let per_sum = (1.0 / sum) as f32;
        out.iter_mut().for_each(|v| *v *= per_sum);
    }
}

/// The sums of [`super::azimuth::weighted_sums`]; `simd` selects the instructions of `V`.
pub(super) fn weighted_sums<V: Lanes>(simd: Simd, weights: &[&[f64]], terms: &[&[f32]], to: &mut [f32]) {
    let weights: Vec<f32> = weights.iter().flat_map(|weights| weights.iter().map(|w| *w as f32)).collect();
    Dispatch::<V>::new(simd).run(WeightedSums { weights: &weights, terms, to });
}

/// Several sums of the same terms, which are read once for all.
struct WeightedSums<'a> {
    /// Those of one sum after another.
    weights: &'a [f32],
    terms: &'a [&'a [f32]],
    to: &'a mut [f32],
}

impl<V: Lanes> SimdOp<V> for WeightedSums<'_> {
    #[inline(always)]
    fn run(self) {
        // Independent sums hide the latency of the additions.
        const SUMS: usize = 8;
        let (length, step) = (self.terms[0].len(), SUMS * V::LANES);
        let weights = self.weights.chunks_exact(self.terms.len());
        let wide = length / step * step;
        for first in (0..wide).step_by(step) {
            for (weights, to) in weights.clone().zip(self.to.chunks_exact_mut(length)) {
                let mut sums = [V::splat(0.0); SUMS];
                for (w, term) in weights.iter().zip(self.terms) {
                    let (w, from) = (V::splat(*w), &term[first..first + step]);
                    for i in 0..SUMS {
                        sums[i] = V::load(&from[i * V::LANES..]).mul_add(w, sums[i]);
                    }
                }
                let to = &mut to[first..first + step];
                for i in 0..SUMS {
                    sums[i].store(&mut to[i * V::LANES..]);
                }
            }
        }
        for (weights, to) in weights.zip(self.to.chunks_exact_mut(length)) {
            for (i, to) in to.iter_mut().enumerate().skip(wide) {
                *to = weights.iter().zip(self.terms).map(|(w, term)| w * term[i]).sum();
            }
        }
    }
}

/// Evaluates the spline of `coefficients` (n × n with margins) at positions rotated by −azimuth about its centre: n rows of
/// `stride` ≥ n values; those past the n-th are undefined.
struct Rotate<'a> {
    coefficients: &'a [f32],
    n: usize,
    azimuth_rad: f64,
    to: &'a mut [f32],
    stride: usize,
}

impl<V: Lanes> SimdOp<V> for Rotate<'_> {
    #[inline(always)]
    fn run(mut self) {
        let (sin, cos) = real::sin_cos(self.azimuth_rad);
        let c = (self.n as f64 - 1.0) / 2.0;
        let middle = (V::LANES / 2) as f64;
        let t = V::iota() - V::splat(middle as f32);
        let (along, across) = (t * V::splat(cos as f32), t * V::splat(-sin as f32));
        // Farther out all coefficients of a register are 0.
        let (low, high) = (-(middle + 4.0), self.n as f64 + middle + 3.0);
        let lines = std::mem::take(&mut self.to).chunks_exact_mut(self.stride).take(self.n);
        for (row, to) in lines.enumerate() {
            let y = row as f64 - c;
            for (i, to) in to.chunks_exact_mut(V::LANES).enumerate() {
                let x = (i * V::LANES) as f64 + middle - c;
                let (u, v) = (c + x * cos + y * sin, c - x * sin + y * cos);
                let outside = u < low || u > high || v < low || v > high;
                let value = if outside { V::splat(0.0) } else { self.spline((u, along), (v, across)) };
                value.zero_below(V::splat(NEGLIGIBLE_SAMPLE)).store(to);
            }
        }
    }
}

impl Rotate<'_> {
    /// The spline at an f64 anchor plus the offset of each lane, (column, row).
    #[inline(always)]
    fn spline<V: Lanes>(&self, u: (f64, V), v: (f64, V)) -> V {
        let width = self.n + 2 * MARGIN;
        let ((col, wu), (row, wv)) = (self.cell(u), self.cell(v));
        // Index of the first of the 4 × 4; exact, as it is far below 2^24.
        let lead = V::splat((MARGIN - 1) as f32);
        let first = (row + lead).mul_add(V::splat(width as f32), col + lead).to_i32();
        let last = self.coefficients.len() - 3 * width - 4;
        assert!(V::all_within(first, last as i32));
        let mut at = [0; MAX_LANES];
        V::store_i32(first, &mut at);
        let mut rows = [V::splat(0.0); 4];
        for j in 0..4 {
            // SAFETY: 4 values from j ≤ 3 rows after an index that is at most `last` lie in the slice.
            let quads = unsafe {
                [
                    V::load_quads(self.coefficients, &at, 0, j * width),
                    V::load_quads(self.coefficients, &at, 1, j * width),
                    V::load_quads(self.coefficients, &at, 2, j * width),
                    V::load_quads(self.coefficients, &at, 3, j * width),
                ]
            };
            rows[0] = quads[0].mul_add(wv[j].broadcast_in_quads::<0>(), rows[0]);
            rows[1] = quads[1].mul_add(wv[j].broadcast_in_quads::<1>(), rows[1]);
            rows[2] = quads[2].mul_add(wv[j].broadcast_in_quads::<2>(), rows[2]);
            rows[3] = quads[3].mul_add(wv[j].broadcast_in_quads::<3>(), rows[3]);
        }
        let columns = V::transpose_quads(rows);
        let mut sum = columns[0] * wu[0];
        for k in 1..4 {
            sum = columns[k].mul_add(wu[k], sum);
        }
        sum
    }

    /// Cells of the positions along one direction and the spline's weights ([`crate::spline::weights`]). Cells outside the
    /// PSF are clamped to the margin, where all coefficients are 0.
    #[inline(always)]
    fn cell<V: Lanes>(&self, (anchor, offset): (f64, V)) -> (V, [V; 4]) {
        let anchor_cell = anchor.floor();
        let at = offset + V::splat((anchor - anchor_cell) as f32);
        let below = at.floor();
        let f = at - below;
        let cell =
            (below + V::splat(anchor_cell as f32)).max(V::splat(-3.0)).min(V::splat(self.n as f32 + 1.0));
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

/// Integrates along columns: row i of `to` = Σ weight · row of `from`, over the weights of pixel i.
struct IntegrateRows<'a> {
    pixels: &'a [PixelWeights],
    from: &'a [f32],
    to: &'a mut [f32],
    /// Values per row of both, a multiple of the lanes.
    stride: usize,
}

impl<V: Lanes> SimdOp<V> for IntegrateRows<'_> {
    #[inline(always)]
    fn run(self) {
        for (pixel, to) in self.pixels.iter().zip(self.to.chunks_exact_mut(self.stride)) {
            let (first, weights) = &pixel.weights_f32;
            let rows = &self.from[first * self.stride..][..weights.len() * self.stride];
            let mut x = 0;
            while x < self.stride {
                // Four sums at a time hide the latency of the additions.
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

/// Transposes `to_stride` rows of `from_stride` values; both are multiples of the lanes.
struct Transpose<'a> {
    from: &'a [f32],
    from_stride: usize,
    to: &'a mut [f32],
    to_stride: usize,
}

impl<V: Lanes> SimdOp<V> for Transpose<'_> {
    #[inline(always)]
    fn run(self) {
        for y in (0..self.to_stride).step_by(V::LANES) {
            for x in (0..self.from_stride).step_by(V::LANES) {
                for first in (x..x + V::LANES).step_by(4) {
                    let columns =
                        V::transposed_quads(&self.from[y * self.from_stride + first..], self.from_stride);
                    for (i, column) in columns.into_iter().enumerate() {
                        column.store(&mut self.to[(first + i) * self.to_stride + y..]);
                    }
                }
            }
        }
    }
}
