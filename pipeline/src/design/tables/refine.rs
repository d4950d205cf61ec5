//! Refinement of the PSF nodes within a budget, and the report of the error that remains.
//!
//! A cell above the threshold is split in height if its error is mostly radial, else the azimuths of its two heights grow. See
//! [`super::grid`].

use super::difference::{Difference, ESF_SHARE};
use super::options::{BASE_NODES, MAX_NODES, TraceOptions};
#[cfg(doc)]
use crate::design::psf::PsfGrid;

/// Maximum samples of the PSFs of a band, as films make kernels from them ([`super::film_samples`]): 176 MB in f32.
pub(super) const MAX_SAMPLES: usize = 21 << 21;
/// Maximum work for the choice of nodes with [`BASE_NODES`], in samples ([`PsfGrid::work`]): 2 to 3 s on two cores.
const MAX_WORK: f64 = 6e8;
/// Maximum side of the PSFs in samples with the default of [`MAX_NODES`] nodes.
const MAX_SIDE: f64 = 1024.0;
/// PSFs that are traced whatever their work.
pub(super) const MIN_PSFS: usize = 24;
/// Maximum of azimuths of a height.
pub(super) const MAX_AZIMUTHS: usize = 2880;

/// Errors of kernels at the centres of the cells between nodes: L1, but for [`NodeError::edge`]; what fewer samples of films lose (`film_samples`) is not among them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeError {
    /// Maximum.
    pub worst: f64,
    /// Real image height of the maximum, mm.
    pub at_mm: f64,
    /// Median.
    pub median: f64,
    /// Maximum of what an edge differs by in a film, of white.
    pub edge: f64,
    /// Whether the budget ended the refinement above the tolerance, or above [`TraceOptions::excess`] times the tolerance.
    pub limited: bool,
}

impl NodeError {
    /// That of the differences at some heights, mm.
    pub(in crate::design) fn of(mut differences: Vec<(Difference, f64)>, limited: bool) -> Self {
        differences.sort_by(|a, b| a.0.l1.total_cmp(&b.0.l1));
        let median = differences.get(differences.len() / 2).map_or(0.0, |e| e.0.l1);
        let (Difference { l1: worst, .. }, at_mm) = differences.last().copied().unwrap_or_default();
        let edge = differences.iter().map(|e| e.0.esf).fold(0.0, f64::max);
        Self { worst, at_mm, median, edge, limited }
    }

    /// Its maxima over an L1 and an ESF: the larger ratio.
    pub(in crate::design) fn over(&self, l1: f64, esf: f64) -> f64 {
        (self.worst / l1).max(self.edge / esf)
    }

    /// Whether an error is above what `options` allow where `max_nodes` suffices.
    pub(super) fn is_above(&self, options: &TraceOptions) -> bool {
        let tolerance = options.psf_tolerance;
        self.over(options.excess * tolerance, ESF_SHARE * tolerance) > 1.0
    }
}

/// Errors at the centre of a cell: in both directions, in r alone, in θ alone (the larger of its two heights).
#[derive(Clone, Copy, Debug)]
pub(super) struct CellError {
    pub(super) total: Difference,
    pub(super) radial: Difference,
    pub(super) angular: Difference,
}

impl CellError {
    /// `combine` of each of its numbers, L1 with that of `other` and ESF with that of `other`.
    pub(super) fn with(self, other: Difference, combine: impl Fn(f64, f64) -> f64) -> Self {
        let one = |a: Difference| a.with(other, &combine);
        Self { total: one(self.total), radial: one(self.radial), angular: one(self.angular) }
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

/// [`MAX_SAMPLES`], or more with more than the default of [`MAX_NODES`].
pub(super) fn max_samples(options: &TraceOptions) -> usize {
    (MAX_SAMPLES as f64 * scale(options).max(1.0)) as usize
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
#[derive(Clone, Copy, Debug)]
pub(super) struct Budget {
    pub(super) nodes: usize,
    pub(super) heights: usize,
}

impl Budget {
    /// Which of the limits hold; for the minimum numbers all do.
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

/// All limits hold.
pub(super) const ALL: Fit = Fit { heights: true, nodes: true };

/// How cells above a threshold are refined.
pub(super) struct Refinement {
    pub(super) threshold: f64,
    /// Largest L1 over its tolerance where the largest ESF is its own, which [`Difference::error`] takes.
    pub(super) l1_over_esf: f64,
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
            let [total, radial, angular] =
                [e.total, e.radial, e.angular].map(|difference| difference.error(self.l1_over_esf));
            let fails = total > self.threshold;
            let split = fails && self.free_heights && (radial >= angular || !self.free_azimuths);
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
    let middle = |k: usize| 0.5 * (heights[k] + heights[k + 1]);
    NodeError::of(errors.iter().enumerate().map(|(k, e)| (e.total, middle(k))).collect(), limited)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: Difference = Difference { l1: 0.0, esf: 0.0 };

    #[test]
    fn errors_of_cells_are_summarised_with_the_place_of_the_largest_l1() {
        let of = |l1, esf| Difference { l1, esf };
        let found =
            NodeError::of(vec![(of(0.02, 1e-3), 1.0), (of(0.01, 3e-3), 2.0), (of(0.005, 0.0), 3.0)], false);
        let expected = NodeError { worst: 0.02, at_mm: 1.0, median: 0.01, edge: 3e-3, limited: false };
        assert_eq!(found, expected);
        assert_eq!(found.over(0.01, 1e-3), 3.0);
        assert_eq!(
            NodeError::of(Vec::new(), true),
            NodeError { worst: 0.0, at_mm: 0.0, median: 0.0, edge: 0.0, limited: true }
        );
    }

    #[test]
    fn a_cell_is_refined_for_its_edges_as_well() {
        // The ESF of a cell, mostly by its azimuths, is a fifth of 0.012; its L1 is small.
        let error = CellError {
            total: Difference { l1: 0.005, esf: 0.0024 },
            radial: NONE,
            angular: Difference { l1: 0.004, esf: 0.0022 },
        };
        let refined = |threshold, l1_over_esf| {
            let refinement = Refinement { threshold, l1_over_esf, free_heights: true, free_azimuths: true };
            refinement.apply(&[0.0, 1.0], &[8, 16], &[error], &|_| 8)
        };
        assert_eq!(refined(0.013, 1.0), (vec![0.0, 1.0], vec![8, 16]));
        // 1.15 times and 7 more, in eights; the L1 may be twice its tolerance, the ESF not.
        assert_eq!(refined(0.011, 1.0), (vec![0.0, 1.0], vec![16, 32]));
        assert_eq!(refined(0.02, 2.0), (vec![0.0, 1.0], vec![16, 32]));
    }
}
