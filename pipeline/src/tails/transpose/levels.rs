//! The transposes of the levels: from a layer to the light of each level, and from there to the remapped image.

use super::super::levels::{COARSE_TAPS, TailKernels, coarse_taps, first_fine, out_size};
use super::super::plan::TailPlan;
use super::super::{OUT_MARGIN, transposed};
use super::light::{LightSum, add_bins, add_row};
use crate::geometry::{Frame, Size};
use crate::layer::BinGrid;

/// The transpose of [`layer`](crate::tails::levels::layer): the lights of the levels, of `values` on the bins of level 0 with a margin of `margin` bins.
pub(super) fn lights_of_layer(
    plan: &TailPlan,
    kernels: &TailKernels,
    frame: &Frame,
    values: &[f32],
    margin: usize,
    threads: usize,
) -> Vec<Vec<f32>> {
    let mut results = vec![padded(&plan.bins(0), values, margin)];
    for level in 1..plan.levels {
        let coarse = interpolated(&plan.bins(level), &plan.bins(level - 1), &results[level - 1]);
        results.push(coarse);
    }
    let rest: f64 = results[plan.levels - 1].iter().map(|v| f64::from(*v)).sum();
    let mut lights = kernels.convolve.lights(frame, results, threads);
    let last = &mut lights[plan.levels - 1];
    let mean = (rest * kernels.rest / last.len() as f64) as f32;
    last.iter_mut().for_each(|v| *v += mean);
    lights
}

/// The transpose of [`lights`](crate::tails::levels::lights): adds the lights of the levels to `light`.
pub(super) fn add_lights(plan: &TailPlan, light: &mut dyn LightSum, mut lights: Vec<Vec<f32>>) {
    for level in (1..plan.levels).rev() {
        let coarse = lights.pop().expect("one of each level");
        let finer = lights.last_mut().expect("one of each level");
        add_coarser(light, (&plan.bins(level - 1), finer), (&plan.bins(level), &coarse));
    }
    add_bins(light, &plan.bins(0), &lights[0]);
}

/// The transpose of [`coarser`](crate::tails::levels::coarser): adds `coarse` to the fine bins, and to `light` where there are none.
fn add_coarser(
    light: &mut dyn LightSum,
    (fine, to): (&BinGrid, &mut [f32]),
    (coarse, values): (&BinGrid, &[f32]),
) {
    let taps = transposed::<COARSE_TAPS>();
    let Size { width: columns, .. } = coarse.size();
    let Size { height: fine_rows, width: fine_columns } = fine.size();
    let first = |index: usize, count: usize| first_fine((coarse, fine), index, count);
    let inner = (0..columns).find(|column| first(*column, fine_columns).is_some()).unwrap_or(columns);
    let lines: Vec<usize> = (inner..columns).map_while(|column| first(column, fine_columns)).collect();
    let end = inner + lines.len();
    let mut across = vec![0.0; fine_rows * lines.len()];
    for (row, values) in values.chunks_exact(columns).enumerate() {
        let Some(from) = first(row, fine_rows) else {
            add_row(light, coarse, row, 0, values);
            continue;
        };
        add_row(light, coarse, row, 0, &values[..inner]);
        add_row(light, coarse, row, end, &values[end..]);
        for (to, w) in across[from * lines.len()..].chunks_exact_mut(lines.len().max(1)).zip(&taps) {
            to.iter_mut().zip(&values[inner..end]).for_each(|(to, v)| *to += w * f64::from(*v));
        }
    }
    let mut sums = vec![0.0; fine_columns];
    for (to, across) in to.chunks_exact_mut(fine_columns).zip(across.chunks_exact(lines.len().max(1))) {
        sums.fill(0.0);
        for (v, at) in across.iter().zip(&lines) {
            sums[*at..][..taps.len()].iter_mut().zip(&taps).for_each(|(sum, w)| *sum += w * v);
        }
        to.iter_mut().zip(&sums).for_each(|(to, sum)| *to = (f64::from(*to) + sum) as f32);
    }
}

/// The transpose of the interpolation of [`add_interpolated`](crate::tails::levels::add_interpolated): the result of the coarse bins, of that of the fine ones.
fn interpolated(coarse_bins: &BinGrid, fine_bins: &BinGrid, fine: &[f32]) -> Vec<f32> {
    let (coarse, columns) = (out_size(coarse_bins), out_size(fine_bins).width);
    let across: Vec<(usize, [f64; 4])> = (0..columns).map(coarse_taps).collect();
    let mut sums = vec![0.0; coarse.pixels()];
    let mut line = vec![0.0; coarse.width];
    for (row, fine) in fine.chunks_exact(columns).enumerate() {
        line.fill(0.0);
        for (v, (left, weights)) in fine.iter().zip(&across) {
            line[*left..][..4].iter_mut().zip(weights).for_each(|(to, w)| *to += w * f64::from(*v));
        }
        let (top, down) = coarse_taps(row);
        for (to, w) in sums[top * coarse.width..].chunks_exact_mut(coarse.width).zip(down) {
            to.iter_mut().zip(&line).for_each(|(to, v)| *to += w * v);
        }
    }
    sums.into_iter().map(|v| v as f32).collect()
}

/// The transpose of [`cropped`](crate::tails::levels::cropped): `values` with a larger margin, of zeros.
fn padded(bins: &BinGrid, values: &[f32], margin: usize) -> Vec<f32> {
    let (Size { height: rows, width: columns }, off) = (out_size(bins), OUT_MARGIN - margin);
    let mut out = vec![0.0; rows * columns];
    let lines = out.chunks_exact_mut(columns).skip(off);
    for (to, from) in lines.zip(values.chunks_exact(columns - 2 * off)) {
        to[off..columns - off].copy_from_slice(from);
    }
    out
}
