//! Refinement of the PSF nodes within a budget, and the report of the error that remains.
//!
//! A cell above the threshold is split in height if its error is mostly radial, else the azimuths of its two heights grow. See
//! [`super::grid`].

use super::options::{BASE_NODES, MAX_NODES, TraceOptions};
#[cfg(doc)]
use crate::design::psf::PsfGrid;

/// Maximum samples of the PSFs of a band with the default of [`MAX_NODES`] nodes, as films make kernels from them ([`crate::psf::coarse`]): 176 MB in f32.
const MAX_SAMPLES: f64 = (21_u64 << 21) as f64;
/// Maximum samples of the PSFs of a band as they are traced: that of an array of a lens pack.
const MAX_TRACED: usize = 1 << 28;
/// Maximum work for the choice of nodes with [`BASE_NODES`], in samples ([`PsfGrid::work`]): 2 to 3 s on two cores.
const MAX_WORK: f64 = 6e8;
/// Maximum side of the PSFs in samples with the default of [`MAX_NODES`] nodes.
const MAX_SIDE: f64 = 1024.0;
/// PSFs that are traced whatever their work.
pub(super) const MIN_PSFS: usize = 24;
/// Maximum of azimuths of a height.
pub(super) const MAX_AZIMUTHS: usize = 2880;

/// L1 errors of kernels at the centres of the cells between nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeError {
    /// Maximum.
    pub worst: f64,
    /// Real image height of the maximum, mm.
    pub at_mm: f64,
    /// Median.
    pub median: f64,
    /// Whether the budget ended the refinement above the tolerance, or above [`TraceOptions::excess`] times the tolerance.
    pub limited: bool,
}

/// L1 errors at the centre of a cell: in both directions, in r alone, in θ alone (the larger of its two heights).
pub(super) struct CellError {
    pub(super) total: f64,
    pub(super) radial: f64,
    pub(super) angular: f64,
}

impl CellError {
    /// Multiplies all errors by `factor`.
    pub(super) fn scale(&mut self, factor: f64) {
        self.total *= factor;
        self.radial *= factor;
        self.angular *= factor;
    }
}

/// Rounds up to a multiple of 8: seven of eight kernels of a height are then flips and transposes of the others.
pub(in crate::design) fn round_azimuths(j: f64) -> usize {
    (j.clamp(8.0, MAX_AZIMUTHS as f64) as usize).next_multiple_of(8)
}

/// Budget relative to the default.
fn scale(options: &TraceOptions) -> f64 {
    options.max_nodes as f64 / MAX_NODES as f64
}

/// Maximum samples of the PSFs of a band.
pub(super) fn max_samples(options: &TraceOptions) -> usize {
    (MAX_SAMPLES * scale(options).max(1.0)) as usize
}

/// Maximum number of PSFs of `side` samples a side, of which films use `film_side`.
pub(super) fn max_heights(options: &TraceOptions, (side, film_side): (usize, usize)) -> usize {
    (max_samples(options) / film_side.pow(2)).min(MAX_TRACED / side.pow(2))
}

/// Samples a side from which on the window of a band is limited.
pub(super) fn max_side(options: &TraceOptions) -> usize {
    (MAX_SIDE * scale(options).max(1.0).sqrt()) as usize
}

/// Number of PSFs of `work` that can be traced for the choice of nodes.
pub(super) fn max_psfs(options: &TraceOptions, work: f64) -> usize {
    ((MAX_WORK * options.max_nodes as f64 / BASE_NODES as f64 / work) as usize).max(MIN_PSFS)
}

/// Limits of the nodes of a band.
pub(super) struct Budget {
    pub(super) nodes: usize,
    pub(super) heights: usize,
}

impl Budget {
    /// Whether the nodes fit; the minimum numbers always do.
    pub(super) fn holds(&self, heights: &[f64], azimuths: &[usize], free_heights: bool) -> bool {
        self.fits(heights, azimuths, free_heights) == Fit { heights: true, nodes: true }
    }

    /// Which of the limits hold.
    pub(super) fn fits(&self, heights: &[f64], azimuths: &[usize], free_heights: bool) -> Fit {
        let nodes: usize = azimuths.iter().skip(1).sum();
        let least = azimuths.iter().skip(1).all(|j| *j <= 8);
        let few = !free_heights || heights.len() <= self.heights.max(3);
        Fit { heights: few, nodes: nodes < self.nodes || (least && heights.len() <= 3) }
    }
}

/// Which limits hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Fit {
    /// That of the heights.
    pub(super) heights: bool,
    /// That of the nodes.
    pub(super) nodes: bool,
}

/// How cells above a threshold are refined.
pub(super) struct Refinement {
    pub(super) threshold: f64,
    pub(super) free_heights: bool,
    pub(super) free_azimuths: bool,
}

impl Refinement {
    pub(super) fn apply(
        &self,
        heights: &[f64],
        azimuths: &[usize],
        errors: &[CellError],
        count: &dyn Fn(f64) -> usize,
    ) -> (Vec<f64>, Vec<usize>) {
        let (mut new_heights, mut new_azimuths) = (vec![heights[0]], vec![azimuths[0]]);
        let mut grow = vec![false; heights.len()];
        for (k, e) in errors.iter().enumerate() {
            let fails = e.total > self.threshold;
            let split = fails && self.free_heights && (e.radial >= e.angular || !self.free_azimuths);
            if fails && !split && self.free_azimuths {
                grow[k] = true;
                grow[k + 1] = true;
            }
            if split {
                let mid = 0.5 * (heights[k] + heights[k + 1]);
                new_heights.push(mid);
                new_azimuths.push(count(mid).max(azimuths[k].min(azimuths[k + 1])));
            }
            new_heights.push(heights[k + 1]);
            new_azimuths.push(azimuths[k + 1]);
        }
        for (h, j) in new_heights.iter().zip(&mut new_azimuths) {
            if heights.iter().position(|old| old == h).is_some_and(|k| grow[k]) {
                *j = round_azimuths(*j as f64 * 1.15 + 7.0);
            }
        }
        (new_heights, new_azimuths)
    }
}

/// Maximum, its height and median of the errors of the cells between `heights`.
pub(super) fn summary(errors: &[CellError], heights: &[f64], limited: bool) -> NodeError {
    let mut sorted: Vec<(f64, f64)> =
        errors.iter().enumerate().map(|(k, e)| (e.total, 0.5 * (heights[k] + heights[k + 1]))).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let median = sorted.get(sorted.len() / 2).map_or(0.0, |e| e.0);
    let (worst, at_mm) = sorted.last().copied().unwrap_or((0.0, 0.0));
    NodeError { worst, at_mm, median, limited }
}
