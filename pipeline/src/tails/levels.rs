//! The convolutions of the levels of a band's tails, and their sum on the bins of level 0.
//!
//! Light and results are means per film pixel, so the kernel between two bins is b_l² T_l. The kernel of a node at the azimuth θ is
//!
//! ```text
//! Σ_j 4^{(2 − q)(l − 1)} Σ_m c_mj (C_mj cos mθ + S_mj sin mθ)       C_mj, S_mj: b² [B_mj(r; R_l) − B_mj(r; R_{l+1})] times cos mφ, sin mφ at the bins of
//!                                                                   level 1; level 0 has its own and no factor
//! ```
//! and its spectrum the sum over j of spectra that all levels from 1 on share.

use super::light::{self, Light};
use super::plan::TailPlan;
use super::{GROWTH, OUT_MARGIN, first_part, transposed};
use crate::buffer::AlignedBuf;
use crate::geometry::{Frame, Rect, Size};
use crate::layer::{BinGrid, Taps};
use crate::lens::tail::{Coefficients, ORDERS, TERMS};
use crate::psf::blocks::Blocks;
use crate::psf::grid::{Node, NodeGrid};
use crate::psf::polar::BlockPlace;
use crate::psf::portable::{Portable, Scratch};
use crate::psf::{BlockView, Spectra};
use crate::real;
use std::cell::RefCell;
use std::ops::Range;
use std::sync::Arc;

/// Spectra of the nodes at level 1, one of each power law.
type TermSpectra = RefCell<Vec<Option<[Vec<f32>; TERMS]>>>;

/// Images C_mj and S_mj of the kernels, by power law.
struct Harmonics([Vec<[Vec<f64>; 2]>; TERMS]);

impl Harmonics {
    fn new(plan: &TailPlan, level: usize) -> Self {
        let (half, b) = (plan.half() as i64, plan.bins(level).bin_px as f64);
        let places: Vec<(f64, f64)> =
            (-half..=half).flat_map(|y| (-half..=half).map(move |x| (b * y as f64, b * x as f64))).collect();
        Self(std::array::from_fn(|j| {
            let of = |m: usize| {
                let (mut even, mut odd) =
                    (Vec::with_capacity(places.len()), Vec::with_capacity(places.len()));
                for (y, x) in &places {
                    let r = (y * y + x * x).sqrt();
                    let (sin, cos) = if r > 0.0 { (y / r, x / r) } else { (0.0, 1.0) };
                    // (cos + i sin)^m
                    let (mut re, mut im) = (1.0, 0.0);
                    for _ in 0..m {
                        (re, im) = (re * cos - im * sin, re * sin + im * cos);
                    }
                    let value = b * b * plan.compact(level, r, m, j);
                    even.push(value * re);
                    odd.push(value * im);
                }
                // A harmonic has no light; its sum over square bins has, of m = 4.
                if m > 0 {
                    let centre = places.len() / 2;
                    for all in [&mut even, &mut odd] {
                        all[centre] -= all.iter().sum::<f64>();
                    }
                }
                [even, odd]
            };
            (0..ORDERS).map(of).collect()
        }))
    }

    /// The power laws `terms` of the kernel of coefficients `c` at azimuth `theta`.
    fn kernel(&self, c: &Coefficients, terms: Range<usize>, theta: f64) -> Vec<f32> {
        let mut sum = vec![0.0; self.0[0][0][0].len()];
        for (j, (m, [even, odd])) in terms.flat_map(|j| self.0[j].iter().enumerate().map(move |of| (j, of))) {
            let (sin, cos) = real::sin_cos(m as f64 * theta);
            let (a, b) = (c[m][j] * cos, c[m][j] * sin);
            for ((to, even), odd) in sum.iter_mut().zip(even).zip(odd) {
                *to += a * even + b * odd;
            }
        }
        sum.into_iter().map(|v| v as f32).collect()
    }
}

/// The engine of a band's tails.
struct TailEngine<'a> {
    plan: &'a TailPlan,
    /// Of levels 0 and 1.
    harmonics: [Harmonics; 2],
    blocks: Blocks,
    engine: Portable,
    of_terms: TermSpectra,
}

/// Spectra of one level.
struct LevelSpectra<'a, 'p> {
    engine: &'a TailEngine<'p>,
    grid: &'a NodeGrid,
    /// Heights of the grid in the table of coefficients.
    heights: Vec<usize>,
    level: usize,
    scratch: RefCell<Scratch>,
    made: RefCell<Vec<Option<Arc<AlignedBuf>>>>,
}

impl LevelSpectra<'_, '_> {
    /// The spectrum of the power laws `terms` of `node`, at level 0 or 1.
    fn spectrum(&self, node: Node, terms: Range<usize>) -> AlignedBuf {
        let c = &self.engine.plan.coefficients[self.heights[node.k]];
        let kernel = self.engine.harmonics[self.level.min(1)].kernel(c, terms, self.grid.azimuth_rad(node));
        self.engine.engine.spectrum(&kernel, &mut self.scratch.borrow_mut(), AlignedBuf::default())
    }

    /// The spectrum of `node` at a level from 1 on, from those of its power laws.
    fn of_terms(&self, node: Node, id: usize) -> AlignedBuf {
        let mut all = self.engine.of_terms.borrow_mut();
        let parts =
            all[id].get_or_insert_with(|| std::array::from_fn(|j| self.spectrum(node, j..j + 1).to_vec()));
        let factors: [f32; TERMS] = std::array::from_fn(|j| TailPlan::factor(self.level, j) as f32);
        let mut sum = AlignedBuf::default();
        sum.reset(parts[0].len());
        for (i, to) in sum.iter_mut().enumerate() {
            *to = factors[0] * parts[0][i] + factors[1] * parts[1][i];
        }
        sum
    }
}

impl Spectra for LevelSpectra<'_, '_> {
    fn get(&self, node: Node) -> Arc<AlignedBuf> {
        let id = self.grid.id(node);
        if let Some(known) = &self.made.borrow()[id] {
            return Arc::clone(known);
        }
        let made = Arc::new(match self.level {
            0 => self.spectrum(node, 0..TERMS),
            _ => self.of_terms(node, id),
        });
        self.made.borrow_mut()[id] = Some(Arc::clone(&made));
        made
    }
}

/// The tails of a band, on the bins of level 0 with a margin of `margin` bins (at most 3), row by row: the values of a layer that is interpolated
/// by four-tap cubic Lagrange polynomials. `light` is the remapped image; the same bits for any number of `threads`.
///
/// # Panics
/// Too large a margin.
pub fn layer(plan: &TailPlan, frame: &Frame, light: &dyn Light, margin: usize, threads: usize) -> Vec<f32> {
    assert!(margin <= OUT_MARGIN);
    let blocks = plan.blocks();
    let engine = TailEngine {
        plan,
        harmonics: [0, 1].map(|level| Harmonics::new(plan, level)),
        engine: Portable::new(&blocks),
        blocks,
        of_terms: RefCell::new(vec![None; plan.grid(1).len()]),
    };
    let mut results = Vec::with_capacity(plan.levels);
    let mut of_level = light::of_bins(light, &plan.bins(0), threads);
    for level in 0..plan.levels {
        if level > 0 {
            of_level = coarser(light, (&plan.bins(level - 1), &of_level), &plan.bins(level));
        }
        results.push(engine.convolve(frame, level, &of_level));
    }
    // What no level has, evenly.
    let mean = of_level.iter().map(|v| f64::from(*v)).sum::<f64>() / of_level.len() as f64;
    let rest = (mean * plan.rest()) as f32;
    let mut sum = results.pop().expect("at least one level");
    sum.iter_mut().for_each(|v| *v += rest);
    for level in (0..results.len()).rev() {
        let finer = results.pop().expect("one of each level");
        sum = add_interpolated(&plan.bins(level + 1), &sum, &plan.bins(level), finer);
    }
    cropped(&plan.bins(0), &sum, margin)
}

impl TailEngine<'_> {
    /// T_l ∗ `light` on the film's bins of `level` and [`OUT_MARGIN`] around.
    fn convolve(&self, frame: &Frame, level: usize, light: &[f32]) -> Vec<f32> {
        let plan = self.plan;
        let bins = plan.bins(level);
        let (Size { height: rows, width: columns }, half, margin) =
            (bins.size(), plan.half(), bins.margin as i64);
        let grid = plan.grid(level);
        let spectra = LevelSpectra {
            engine: self,
            grid: &grid,
            heights: plan.heights(level),
            level,
            scratch: RefCell::new(self.engine.scratch()),
            made: RefCell::new(vec![None; grid.len()]),
        };
        let axis = |px: f64| (px + 0.5) / bins.bin_px as f64 - 0.5;
        let axis = (axis(frame.axis_px.0), axis(frame.axis_px.1));
        let stride = columns + 2 * half;
        let mut sum = vec![0f32; stride * (rows + 2 * half)];
        let mut scratch = self.engine.scratch();
        let all = Rect::new(0, 0, rows, columns);
        for block in all.tiles(self.blocks.block, self.blocks.block) {
            let (y, x) = (block.y as usize, block.x as usize);
            let lines = light.chunks(columns).skip(y).take(block.height);
            if lines.clone().all(|row| row[x..x + block.width].iter().all(|v| *v == 0.0)) {
                continue;
            }
            let place = BlockPlace {
                dy_px: (block.y - margin) as f64 - axis.0,
                dx_px: (block.x - margin) as f64 - axis.1,
                rows: block.height,
                cols: block.width,
            };
            let view = BlockView { pixels: &light[y * columns + x..], stride: columns, place };
            self.engine.scatter(&view, &grid, &spectra, &mut sum[y * stride + x..], stride, &mut scratch);
        }
        // The first value is `half` bins before the first bin of the grid.
        let first = half + bins.margin - OUT_MARGIN;
        let Size { height: out_rows, width: out_columns } = out_size(&bins);
        let lines = sum.chunks_exact(stride).skip(first).take(out_rows);
        lines.flat_map(|line| &line[first..first + out_columns]).copied().collect()
    }
}

/// Rows and columns of a result.
fn out_size(bins: &BinGrid) -> Size {
    BinGrid { margin: OUT_MARGIN, ..*bins }.size()
}

/// The light of `coarse` bins: from the `fine` ones of which [`GROWTH`] make a side, where all that a bin reads are there, else directly.
fn coarser(light: &dyn Light, (fine, values): (&BinGrid, &[f32]), coarse: &BinGrid) -> Vec<f32> {
    let taps = transposed::<COARSE_TAPS>();
    let Size { height: rows, width: columns } = coarse.size();
    let Size { height: fine_rows, width: fine_columns } = fine.size();
    // First fine bin that a coarse one reads, if it reads only bins that there are.
    let first = |index: usize, count: usize| -> Option<usize> {
        let bin = index as i64 - coarse.margin as i64;
        let at = bin * GROWTH as i64 + first_part(COARSE_TAPS) + fine.margin as i64;
        let at = usize::try_from(at).ok()?;
        (at + taps.len() <= count).then_some(at)
    };
    let lines: Vec<Option<usize>> = (0..columns).map(|column| first(column, fine_columns)).collect();
    // Along the rows, then down.
    let mut across = vec![0.0; fine_rows * columns];
    for (to, from) in across.chunks_exact_mut(columns).zip(values.chunks_exact(fine_columns)) {
        for (to, at) in to.iter_mut().zip(&lines) {
            if let Some(at) = at {
                *to = from[*at..][..taps.len()].iter().zip(&taps).map(|(v, w)| w * f64::from(*v)).sum();
            }
        }
    }
    let mut out = Vec::with_capacity(coarse.size().pixels());
    for row in 0..rows {
        let from = first(row, fine_rows);
        for (column, line) in lines.iter().enumerate() {
            out.push(match (from, line) {
                (Some(from), Some(_)) => taps
                    .iter()
                    .enumerate()
                    .map(|(i, w)| w * across[(from + i) * columns + column])
                    .sum::<f64>() as f32,
                _ => light::of_bin(light, coarse, row, column) as f32,
            });
        }
    }
    out
}

/// Fine bins that a coarse one reads.
const COARSE_TAPS: usize = 4 * GROWTH;

/// `finer` + U `coarse`, results on their grids.
fn add_interpolated(coarse_bins: &BinGrid, coarse: &[f32], fine_bins: &BinGrid, finer: Vec<f32>) -> Vec<f32> {
    let coarse_columns = out_size(coarse_bins).width;
    let Size { height: rows, width: columns } = out_size(fine_bins);
    // First of the four coarse values of a fine bin, and their weights.
    let at = |index: usize| {
        let bin = index as f64 - OUT_MARGIN as f64;
        let u = (bin + 0.5) / GROWTH as f64 - 0.5;
        let cell = u.floor();
        ((cell as i64 - 1 + OUT_MARGIN as i64) as usize, Taps::Lagrange.weights(u - cell))
    };
    let across: Vec<(usize, [f64; 4])> = (0..columns).map(at).collect();
    let mut out = finer;
    for (row, to) in out.chunks_exact_mut(columns).enumerate().take(rows) {
        let (top, down) = at(row);
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
    let (Size { height: rows, width: columns }, off) = (out_size(bins), OUT_MARGIN - margin);
    let lines = values.chunks_exact(columns).skip(off).take(rows - 2 * off);
    lines.flat_map(|line| &line[off..columns - off]).copied().collect()
}

#[cfg(test)]
mod tests;
