//! The transposes of the light of bins, from the bins to places of the film.

use super::super::light::{FIRST, PLACES, SAMPLES, TAPS, of_row_place};
use super::super::transposed;
use crate::geometry::Size;
use crate::layer::BinGrid;

/// The transpose of [`Light`](crate::tails::light::Light).
pub(super) trait LightSum {
    /// Adds `values` at places `step` film pixels apart, from `x` on, of row `y`.
    fn add_along(&mut self, y: f64, x: f64, step: f64, values: &[f32]);
}

/// The transpose of [`of_bins`](crate::tails::light::of_bins): `values`, row by row.
pub(super) fn add_bins(light: &mut dyn LightSum, bins: &BinGrid, values: &[f32]) {
    let Size { height: rows, width: columns } = bins.size();
    let (step, weights): (f64, [f64; TAPS]) = (bins.bin_px as f64 / SAMPLES as f64, transposed());
    let place = |i: i64| (i as f64 + 0.5) * step - 0.5;
    let first = FIRST - (SAMPLES * bins.margin) as i64;
    let mut line = vec![0.0; columns];
    let (mut sums, mut samples) =
        (vec![0.0; SAMPLES * columns + TAPS - SAMPLES], vec![0f32; SAMPLES * columns + TAPS - SAMPLES]);
    for row in 0..SAMPLES * (rows - 1) + TAPS {
        line.fill(0.0);
        let from = (row + SAMPLES).saturating_sub(TAPS) / SAMPLES;
        for bin in from..rows.min(row / SAMPLES + 1) {
            let Some(weight) = weights.get(row - SAMPLES * bin) else { continue };
            let values = &values[bin * columns..][..columns];
            line.iter_mut().zip(values).for_each(|(to, v)| *to += weight * f64::from(*v));
        }
        sums.fill(0.0);
        for (k, v) in line.iter().enumerate() {
            let to = sums[SAMPLES * k..][..TAPS].iter_mut();
            to.zip(&weights).for_each(|(to, w)| *to += w * v);
        }
        samples.iter_mut().zip(&sums).for_each(|(to, v)| *to = *v as f32);
        light.add_along(place(first + row as i64), place(first), step, &samples);
    }
}

/// The transpose of [`of_row`](crate::tails::light::of_row): `values` of the bins of columns `first` on of a row of bins.
pub(super) fn add_row(light: &mut dyn LightSum, bins: &BinGrid, row: usize, first: usize, values: &[f32]) {
    let part = |v: &f32| (f64::from(*v) / (PLACES * PLACES) as f64) as f32;
    let samples: Vec<f32> = values.iter().flat_map(|v| [part(v); PLACES]).collect();
    for part in 0..PLACES {
        let (y, x) = (of_row_place(bins, row, part), of_row_place(bins, first, 0));
        light.add_along(y, x, bins.bin_px as f64 / PLACES as f64, &samples);
    }
}
