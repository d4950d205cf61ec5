//! The levels of a band's tails, and their sum on the bins of level 0.
//!
//! Light and results are means per film pixel. The light of a level comes from that of the finer one where all bins that it reads are there, and
//! from the remapped image beyond.

use super::convolution::{ConvolveLevels, kernels};
use super::light::{self, Light};
use super::plan::TailPlan;
use super::{GROWTH, OUT_MARGIN, first_part, transposed};
use crate::geometry::{Frame, Size};
use crate::layer::{BinGrid, Taps};
use crate::simd::Simd;

/// `light`, the remapped image, on the bins of each level.
pub fn lights(plan: &TailPlan, light: &dyn Light, threads: usize) -> Vec<Vec<f32>> {
    let mut lights = vec![light::of_bins(light, &plan.bins(0), threads)];
    for level in 1..plan.levels {
        let finer = (&plan.bins(level - 1), &lights[level - 1][..]);
        lights.push(coarser(light, finer, &plan.bins(level)));
    }
    lights
}

/// The kernels of a band's tails, for films of the size and scale of its plan.
pub struct TailKernels {
    /// Share of the light beyond the last level.
    pub(super) rest: f64,
    pub(super) convolve: Box<dyn ConvolveLevels>,
}

impl std::fmt::Debug for TailKernels {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TailKernels").field("rest", &self.rest).finish_non_exhaustive()
    }
}

impl TailKernels {
    /// Those of `plan`.
    pub fn new(plan: &TailPlan, simd: Simd) -> Self {
        Self { rest: plan.rest(), convolve: kernels(plan, simd) }
    }
}

/// The tails of a band of the light `lights` on the bins of each level, on the bins of level 0 with a margin of `margin` bins (at most 3), row by row: the values
/// of a layer that is interpolated by four-tap cubic Lagrange polynomials. The same bits for any number of `threads` and any `simd`.
///
/// # Panics
/// Too large a margin.
pub fn layer(
    plan: &TailPlan,
    kernels: &TailKernels,
    frame: &Frame,
    lights: Vec<Vec<f32>>,
    margin: usize,
    threads: usize,
) -> Vec<f32> {
    assert!(margin <= OUT_MARGIN);
    // What no level has, evenly.
    let last = &lights[plan.levels - 1];
    let mean = last.iter().map(|v| f64::from(*v)).sum::<f64>() / last.len() as f64;
    let rest = (mean * kernels.rest) as f32;
    let mut results = kernels.convolve.levels(frame, lights, threads);
    let mut sum = results.pop().expect("at least one level");
    sum.iter_mut().for_each(|v| *v += rest);
    for level in (0..results.len()).rev() {
        let finer = results.pop().expect("one of each level");
        sum = add_interpolated(&plan.bins(level + 1), &sum, &plan.bins(level), finer);
    }
    cropped(&plan.bins(0), &sum, margin)
}

/// Rows and columns of a result.
pub(super) fn out_size(bins: &BinGrid) -> Size {
    BinGrid { margin: OUT_MARGIN, ..*bins }.size()
}

/// The light of `coarse` bins: from the `fine` ones of which [`GROWTH`] make a side, where all that a bin reads are there, else directly.
fn coarser(light: &dyn Light, (fine, values): (&BinGrid, &[f32]), coarse: &BinGrid) -> Vec<f32> {
    let taps = transposed::<COARSE_TAPS>();
    let Size { width: columns, .. } = coarse.size();
    let Size { height: fine_rows, width: fine_columns } = fine.size();
    let first = |index: usize, count: usize| first_fine((coarse, fine), index, count);
    // Columns of bins whose fine bins are there, and the first of these of each.
    let has = |column: &usize| first(*column, fine_columns).is_some();
    let inner = (0..columns).find(has).unwrap_or(columns);
    let lines: Vec<usize> = (inner..columns).map_while(|column| first(column, fine_columns)).collect();
    let end = inner + lines.len();
    // Along the rows, then down.
    let mut across = vec![0.0; fine_rows * lines.len()];
    for (to, from) in across.chunks_exact_mut(lines.len().max(1)).zip(values.chunks_exact(fine_columns)) {
        for (to, at) in to.iter_mut().zip(&lines) {
            *to = from[*at..][..taps.len()].iter().zip(&taps).map(|(v, w)| w * f64::from(*v)).sum();
        }
    }
    let mut out = vec![0f32; coarse.size().pixels()];
    let mut sums = vec![0.0; lines.len()];
    for (row, to) in out.chunks_exact_mut(columns).enumerate() {
        let Some(from) = first(row, fine_rows) else {
            light::of_row(light, coarse, row, 0, to);
            continue;
        };
        sums.fill(0.0);
        for (from, w) in across[from * lines.len()..].chunks_exact(lines.len().max(1)).zip(&taps) {
            sums.iter_mut().zip(from).for_each(|(sum, v)| *sum += w * v);
        }
        light::of_row(light, coarse, row, 0, &mut to[..inner]);
        to[inner..end].iter_mut().zip(&sums).for_each(|(to, sum)| *to = *sum as f32);
        light::of_row(light, coarse, row, end, &mut to[end..]);
    }
    out
}

/// First of the `count` fine bins along an axis that the `index`-th coarse one reads, if it reads only bins that there are.
pub(super) fn first_fine((coarse, fine): (&BinGrid, &BinGrid), index: usize, count: usize) -> Option<usize> {
    let bin = index as i64 - coarse.margin as i64;
    let at = bin * GROWTH as i64 + first_part(COARSE_TAPS) + fine.margin as i64;
    let at = usize::try_from(at).ok()?;
    (at + COARSE_TAPS <= count).then_some(at)
}

/// Fine bins that a coarse one reads.
pub(super) const COARSE_TAPS: usize = 4 * GROWTH;

/// First of the four coarse values of the `index`-th fine bin of a result, and their weights.
pub(super) fn coarse_taps(index: usize) -> (usize, [f64; 4]) {
    let bin = index as f64 - OUT_MARGIN as f64;
    let u = (bin + 0.5) / GROWTH as f64 - 0.5;
    let cell = u.floor();
    ((cell as i64 - 1 + OUT_MARGIN as i64) as usize, Taps::Lagrange.weights(u - cell))
}

/// `finer` + U `coarse`, results on their grids.
fn add_interpolated(coarse_bins: &BinGrid, coarse: &[f32], fine_bins: &BinGrid, finer: Vec<f32>) -> Vec<f32> {
    let coarse_columns = out_size(coarse_bins).width;
    let Size { height: rows, width: columns } = out_size(fine_bins);
    let across: Vec<(usize, [f64; 4])> = (0..columns).map(coarse_taps).collect();
    let mut out = finer;
    for (row, to) in out.chunks_exact_mut(columns).enumerate().take(rows) {
        let (top, down) = coarse_taps(row);
        let line: Vec<f64> = (0..coarse_columns)
            .map(|x| (0..4).map(|i| down[i] * f64::from(coarse[(top + i) * coarse_columns + x])).sum())
            .collect();
        for (to, (left, weights)) in to.iter_mut().zip(&across) {
            let value: f64 = line[*left..][..4].iter().zip(weights).map(|(v, w)| v * w).sum();
            *to = (f64::from(*to) + value) as f32;
        }
    }
    out
}

/// A result with a smaller margin.
fn cropped(bins: &BinGrid, values: &[f32], margin: usize) -> Vec<f32> {
    let (Size { height, width }, off) = (out_size(bins), OUT_MARGIN - margin);
    part((values, width), off, Size::new(height - 2 * off, width - 2 * off))
}

/// The rectangle of `size` from row and column `first` on of `values`, which have `stride` to a row.
pub(super) fn part((values, stride): (&[f32], usize), first: usize, size: Size) -> Vec<f32> {
    let mut out = Vec::with_capacity(size.pixels());
    for line in values.chunks_exact(stride).skip(first).take(size.height) {
        out.extend_from_slice(&line[first..first + size.width]);
    }
    out
}

#[cfg(test)]
mod tests;
