//! Mean of a plane over a small disc: sums along rows, from cumulative sums, and single pixels at the disc's rim.
//!
//! ```text
//! weight of the pixel at distance d:  clamp(√max(0, R² − 2/3) + 1/2 − d, 0, 1),   scaled to sum 1
//! ```

use crate::real;
use crate::simd::lanes::{Lanes, SimdOp};
use crate::simd::{Simd, UnfusedOp};

/// Variance of linear interpolation between pixels, px², of both directions, times two: that of a disc is R²/2.
const LINEAR_PX2: f64 = 2.0 / 3.0;

/// A disc about a pixel.
#[derive(Debug)]
pub(super) struct Disc {
    rows: Vec<Row>,
    reach: usize,
    norm: f64,
}

/// One row of it.
#[derive(Debug)]
struct Row {
    /// Row from the middle, from −reach on.
    dy: i64,
    /// Pixels from −inner to inner have weight 1; `None`: no pixel.
    inner: Option<usize>,
    /// The others: (column from the middle, weight).
    rim: Vec<(i64, f64)>,
}

impl Disc {
    /// Of `radius_px` together with the linear interpolation that follows.
    pub(super) fn new(radius_px: f64) -> Self {
        let soft = (radius_px * radius_px - LINEAR_PX2).max(0.0).sqrt();
        let reach = (soft + 0.5).ceil() as i64 - 1;
        let weight = |dy: i64, dx: i64| (soft + 0.5 - real::hypot(dy as f64, dx as f64)).clamp(0.0, 1.0);
        let row = |dy: i64| {
            // A single pixel has weight 1 after scaling, whatever its weight here.
            let inner = (0..=reach).take_while(|&dx| weight(dy, dx) == 1.0).count().checked_sub(1);
            let is_rim = |dx: &i64| inner.is_none_or(|inner| dx.unsigned_abs() as usize > inner);
            let rim =
                (-reach..=reach).filter(is_rim).map(|dx| (dx, weight(dy, dx))).filter(|(_, w)| *w > 0.0);
            Row { dy, inner, rim: rim.collect() }
        };
        let rows: Vec<Row> = (-reach..=reach).map(row).collect();
        let of_row = |row: &Row| {
            row.inner.map_or(0.0, |inner| 2.0 * inner as f64 + 1.0)
                + row.rim.iter().map(|(_, w)| w).sum::<f64>()
        };
        let norm = 1.0 / rows.iter().map(of_row).sum::<f64>();
        Self { rows, reach: reach as usize, norm }
    }

    /// Pixels that it reaches from its middle.
    pub(super) fn reach(&self) -> usize {
        self.reach
    }

    /// Means of `source`, rows of `width` pixels, about the pixels that are at least the reach away from its border, into `out`.
    /// The same bits with any instructions.
    pub(super) fn mean(
        &self,
        source: &[f32],
        width: usize,
        out: &mut Vec<f32>,
        s: &mut DiscScratch,
        simd: Simd,
    ) {
        out.clear();
        if self.reach == 0 {
            return out.extend_from_slice(source);
        }
        Mean { disc: self, source, width, out, s }.run_unfused(simd);
    }

    /// [`Disc::mean`] of a disc of more than a pixel.
    #[inline(always)]
    fn sum_rows(&self, source: &[f32], width: usize, out: &mut Vec<f32>, s: &mut DiscScratch) {
        let DiscScratch { sums, row: total } = s;
        let (rows, inside) = (source.len() / width, width - 2 * self.reach);
        sums.clear();
        for row in source.chunks_exact(width) {
            let mut sum = 0.0;
            sums.push(sum);
            sums.extend(row.iter().map(|v| {
                sum += f64::from(*v);
                sum
            }));
        }
        for y in self.reach..rows - self.reach {
            total.clear();
            total.resize(inside, 0.0);
            for row in &self.rows {
                let at = (y as i64 + row.dy) as usize;
                if let Some(inner) = row.inner {
                    let sums = &sums[at * (width + 1) + self.reach - inner..];
                    let ends = std::iter::zip(sums, &sums[2 * inner + 1..]);
                    std::iter::zip(&mut *total, ends).for_each(|(to, (first, last))| *to += last - first);
                }
                for (dx, weight) in &row.rim {
                    let from = &source[(at * width + self.reach).wrapping_add_signed(*dx as isize)..];
                    std::iter::zip(&mut *total, from).for_each(|(to, v)| *to += weight * f64::from(*v));
                }
            }
            out.extend(total.iter().map(|v| (v * self.norm) as f32));
        }
    }
}

/// [`Disc::mean`], compiled for the instructions that run it.
struct Mean<'a> {
    disc: &'a Disc,
    source: &'a [f32],
    width: usize,
    out: &'a mut Vec<f32>,
    s: &'a mut DiscScratch,
}

impl<V: Lanes> SimdOp<V> for Mean<'_> {
    #[inline(always)]
    fn run(self) {
        self.disc.sum_rows(self.source, self.width, self.out, self.s);
    }
}

/// Buffers of [`Disc::mean`].
#[derive(Debug, Default)]
pub(super) struct DiscScratch {
    sums: Vec<f64>,
    row: Vec<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean of one pixel of value 1 in the middle of 21 x 21 pixels.
    fn spot(radius_px: f64) -> (usize, Vec<f32>) {
        let disc = Disc::new(radius_px);
        let mut source = vec![0.0; 441];
        source[220] = 1.0;
        let (mut out, side) = (Vec::new(), 21 - 2 * disc.reach());
        disc.mean(&source, 21, &mut out, &mut DiscScratch::default(), Simd::detect());
        assert_eq!(out.len(), side * side);
        (side, out)
    }

    #[test]
    fn the_mean_over_a_disc_is_the_sum_of_its_weights() {
        for radius in [1.3, 2.0, 3.7, 5.0] {
            let ((side, found), soft) = (spot(radius), f64::sqrt(radius * radius - 2.0 / 3.0));
            let weight = |i: usize| {
                let (y, x) = ((i / side) as f64 - (side / 2) as f64, (i % side) as f64 - (side / 2) as f64);
                (soft + 0.5 - y.hypot(x)).clamp(0.0, 1.0)
            };
            let sum: f64 = (0..side * side).map(weight).sum();
            for (i, v) in found.iter().enumerate() {
                assert!((f64::from(*v) - weight(i) / sum).abs() < 1e-7, "radius {radius}, pixel {i}: {v}");
            }
        }
    }

    #[test]
    fn a_small_disc_is_its_pixel() {
        for radius in [0.0, 0.5, 0.9] {
            let (side, found) = spot(radius);
            assert_eq!((side, found[220]), (21, 1.0), "radius {radius}");
        }
    }

    /// The second moment of the disc and of linear interpolation, 1/6 px² on average in each direction, is that of a disc of the radius.
    #[test]
    fn with_linear_interpolation_the_second_moment_is_that_of_the_radius() {
        for radius in [3.0, 5.0, 8.0f64] {
            let disc = Disc::new(radius);
            let side = 2 * disc.reach() + 1;
            let mut source = vec![0.0; (2 * side - 1) * (2 * side - 1)];
            source[(side - 1) * (2 * side - 1) + side - 1] = 1.0;
            let mut out = Vec::new();
            disc.mean(&source, 2 * side - 1, &mut out, &mut DiscScratch::default(), Simd::detect());
            let moment: f64 = (0..side * side)
                .map(|i| ((i / side) as f64 - disc.reach() as f64).powi(2) * f64::from(out[i]))
                .sum();
            // The rim of one pixel and the grid add up to 0.14 px².
            let expected = radius * radius / 4.0 - 1.0 / 6.0;
            assert!((moment - expected).abs() < 0.15, "radius {radius}: {moment}, expected {expected}");
        }
    }
}
