//! The light of the bins of level 0, from samples at half bins.
//!
//! ```text
//! L_0(k) = Σ_i v_i f(2k + i)        v = Uᵀ of halves, along each axis
//! ```
//! f is the remapped image at the centres of half bins, read from the chart on cells of about that size (`cells`). Four-tap interpolation between such
//! cells, sampled at their own spacing g, has the light of a point wherever it lies: where film and cells differ by a factor 1 + δ, as by distortion, its share
//! is wrong by about 40 δ⁴ (0.9 % at δ = 1/8). An even image stays even.
//! Samples in f32, their sums in f64; each bin is summed by rows, the same for any number of threads.

use super::{first_part, transposed};
use crate::geometry::Size;
use crate::layer::BinGrid;
use crate::parts::for_each_part;
use std::convert::Infallible;

/// Samples of a bin along each axis.
pub(super) const SAMPLES: usize = 2;
/// Samples that a bin reads: from FIRST + 2k on, along each axis.
pub(super) const TAPS: usize = 4 * SAMPLES;
pub(super) const FIRST: i64 = first_part(TAPS);

/// Light at places of the film, pixel centres at integers.
pub trait Light: Sync {
    /// The remapped image along row `y`, at `out.len()` places `step` film pixels apart from `x` on, whether on the film or beyond.
    fn along(&self, y: f64, x: f64, step: f64, out: &mut [f32]);
}

/// Mean light of the bins, row by row, on `threads` threads.
pub fn of_bins(light: &dyn Light, bins: &BinGrid, threads: usize) -> Vec<f32> {
    let Size { width: columns, .. } = bins.size();
    let mut out = vec![0f32; bins.size().pixels()];
    /// Rows of bins that a thread computes at a time.
    const ROWS: usize = 32;
    let parts = out.chunks_mut(ROWS * columns).enumerate();
    let done: Result<(), Infallible> = for_each_part(
        threads,
        parts,
        || Scratch::new(bins),
        |scratch, (part, rows)| {
            scratch.rows(light, bins, part * ROWS, rows);
            Ok(())
        },
    );
    let Ok(()) = done;
    out
}

/// Buffers of one thread.
struct Scratch {
    step: f64,
    weights: [f64; TAPS],
    /// Samples of a row.
    samples: Vec<f32>,
    /// The bins of that row.
    line: Vec<f64>,
    /// Sums of the rows of bins that are being computed.
    sums: Vec<f64>,
}

impl Scratch {
    fn new(bins: &BinGrid) -> Self {
        let columns = bins.size().width;
        Self {
            step: bins.bin_px as f64 / SAMPLES as f64,
            weights: transposed(),
            samples: vec![0.0; SAMPLES * columns + TAPS - SAMPLES],
            line: vec![0.0; columns],
            sums: Vec::new(),
        }
    }

    /// Rows of bins from row `first` of the grid on.
    fn rows(&mut self, light: &dyn Light, bins: &BinGrid, first: usize, out: &mut [f32]) {
        let columns = self.line.len();
        let count = out.len() / columns;
        self.sums.clear();
        self.sums.resize(out.len(), 0.0);
        // Place of sample i of the bin of film pixel 0.
        let place = |i: i64| (i as f64 + 0.5) * self.step - 0.5;
        let (top, left) = (
            SAMPLES as i64 * (first as i64 - bins.margin as i64) + FIRST,
            FIRST - (SAMPLES * bins.margin) as i64,
        );
        for row in 0..SAMPLES * (count - 1) + TAPS {
            let y = place(top + row as i64);
            light.along(y, place(left), self.step, &mut self.samples);
            for (k, v) in self.line.iter_mut().enumerate() {
                let samples = &self.samples[SAMPLES * k..][..TAPS];
                *v = samples.iter().zip(&self.weights).map(|(s, w)| f64::from(*s) * w).sum();
            }
            // Bins whose tap `row − 2 bin` there is.
            let from = (row + SAMPLES).saturating_sub(TAPS) / SAMPLES;
            for bin in from..count.min(row / SAMPLES + 1) {
                let Some(weight) = self.weights.get(row - SAMPLES * bin) else { continue };
                let to = &mut self.sums[bin * columns..][..columns];
                to.iter_mut().zip(&self.line).for_each(|(to, v)| *to += weight * v);
            }
        }
        out.iter_mut().zip(&self.sums).for_each(|(to, v)| *to = *v as f32);
    }
}

/// Places of a bin along each axis of [`of_row`].
pub(super) const PLACES: usize = 4;

/// Film coordinate, along an axis, of place `part` of the `index`-th bin of [`of_row`].
pub(super) fn of_row_place(bins: &BinGrid, index: usize, part: usize) -> f64 {
    (index as f64 - bins.margin as f64 + (part as f64 + 0.5) / PLACES as f64) * bins.bin_px as f64 - 0.5
}

/// Mean of the light over the bins of columns `first` on of a row of bins, from 4 × 4 places of each: of surroundings that no finer bins reach.
pub(super) fn of_row(light: &dyn Light, bins: &BinGrid, row: usize, first: usize, out: &mut [f32]) {
    let place = |index, part| of_row_place(bins, index, part);
    let mut samples = vec![0f32; PLACES * out.len()];
    let mut sums = vec![0f64; out.len()];
    for part in 0..PLACES {
        light.along(place(row, part), place(first, 0), bins.bin_px as f64 / PLACES as f64, &mut samples);
        for (sum, samples) in sums.iter_mut().zip(samples.as_chunks::<PLACES>().0) {
            *sum += samples.iter().map(|v| f64::from(*v)).sum::<f64>();
        }
    }
    out.iter_mut().zip(sums).for_each(|(to, sum)| *to = (sum / (PLACES * PLACES) as f64) as f32);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn taps_keep_moments_up_to_the_third() {
        let w = transposed::<TAPS>();
        // Light of sample parity p of unit strength: its bins sum to half of 1, at its place, in units of samples.
        for parity in [0_i64, 1] {
            let moment = |n: i32| -> f64 {
                (-6..=6_i64)
                    .filter_map(|bin| {
                        let tap = usize::try_from(parity - SAMPLES as i64 * bin - FIRST).ok()?;
                        let at = SAMPLES as f64 * bin as f64 + 0.5 - parity as f64;
                        w.get(tap).map(|w| w * SAMPLES as f64 * at.powi(n))
                    })
                    .sum()
            };
            for (n, expected) in [1.0, 0.0, 0.0, 0.0].into_iter().enumerate() {
                let found = moment(n as i32);
                assert!((found - expected).abs() < 1e-13, "{parity} {n}: {found}");
            }
        }
        assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-15);
    }

    struct Wave;
    impl Wave {
        fn at(y: f64, x: f64) -> f64 {
            1.0 + 0.02 * y - 0.01 * x + 1e-4 * x * y
        }
    }
    impl Light for Wave {
        fn along(&self, y: f64, x: f64, step: f64, out: &mut [f32]) {
            out.iter_mut().enumerate().for_each(|(i, to)| *to = Self::at(y, x + i as f64 * step) as f32);
        }
    }

    #[test]
    fn bins_of_a_smooth_field_have_its_values_at_their_centres_with_any_threads() {
        let bins = BinGrid::new(Size::new(557, 360), 8, 5);
        let one = of_bins(&Wave, &bins, 1);
        assert_eq!(one, of_bins(&Wave, &bins, 3));
        let Size { height: rows, width: columns } = bins.size();
        for (row, column) in [(0, 0), (33, 7), (rows - 1, columns - 1), (31, 54), (32, 0)] {
            let centre = |i: usize| (i as f64 - 5.0 + 0.5) * 8.0 - 0.5;
            let expected = Wave::at(centre(row), centre(column));
            let found = f64::from(one[row * columns + column]);
            assert!(
                (found - expected).abs() < 1e-6 * expected.abs().max(1.0),
                "{row} {column}: {found} {expected}"
            );
            let mut direct = [0.0];
            of_row(&Wave, &bins, row, column, &mut direct);
            assert!((f64::from(direct[0]) - expected).abs() < 1e-6 * expected.abs().max(1.0));
        }
    }
}
