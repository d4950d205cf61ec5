//! Choice of the columns and rows of PSFs: as many as kernels between them need.
//!
//! ```text
//! kernel between nodes: bilinear;    its error at the centre of a cell = C_x h_x² + C_y h_y²        (L1 of film-pixel kernels, or five times their ESF)
//! ```
//! C_x and C_y are those of the worst of 5 × 5 places, from kernels half a step to either side; each direction has half the tolerance.
//! The error is then measured at the centres of cells over the whole film, and both steps are divided by the square root of an excess.
//! Where that takes more nodes than allowed, the steps are as small as these allow, and the error is reported.

use super::super::error::SkewError;
use super::super::map::FilmRange;
use super::kernels::PlaceKernels;
use crate::design::tables::difference::{Difference, ESF_SHARE};
use crate::design::tables::refine::NodeError;
use crate::design::tables::trace::{PsfHeights, TraceOptions};
use crate::real;

/// Places along a side where C is determined.
const PROBES: usize = 5;
/// First step, of the film's side, and the longest one.
const FIRST_STEP: f64 = 1.0 / 24.0;
const LONGEST_STEP: f64 = 0.25;
/// Error over its share of the tolerance from which on a step is too long for the law of the square.
const BEYOND_SQUARE: f64 = 3.0;
/// Times that steps are measured again.
const STEP_ROUNDS: usize = 4;
/// Cells along a side whose centres are checked.
const CHECKS: usize = 4;
/// Largest error over the tolerance, and times that steps are made finer.
const EXCESS: f64 = 1.3;
const ROUNDS: usize = 3;

/// Columns and rows of PSFs.
#[derive(Clone, Debug)]
pub(super) struct Nodes {
    pub(super) x_mm: Vec<f64>,
    pub(super) y_mm: Vec<f64>,
    pub(super) error: Option<NodeError>,
}

impl Nodes {
    fn new(range: FilmRange, [nx, ny]: [usize; 2]) -> Self {
        let along = |[a, b]: [f64; 2], n: usize| -> Vec<f64> {
            (0..n).map(|i| a + (b - a) * (i as f64 / (n - 1) as f64)).collect()
        };
        Self { x_mm: along(range.x_mm, nx), y_mm: along(range.y_mm, ny), error: None }
    }

    /// Row by row.
    pub(super) fn places(&self) -> Vec<[f64; 2]> {
        self.y_mm.iter().flat_map(|y| self.x_mm.iter().map(|x| [*x, *y])).collect()
    }
}

/// The columns and rows of `range`, at most `most` nodes.
pub(super) fn choose(
    kernels: &mut PlaceKernels<'_>,
    range: FilmRange,
    (options, most): (&TraceOptions, usize),
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<Nodes, SkewError> {
    if options.heights != PsfHeights::ByError {
        return Ok(Nodes::new(range, [2, 2]));
    }
    let tolerance = options.psf_tolerance;
    let mut counts = [0, 1].map(|_| 0_usize);
    for (axis, count) in counts.iter_mut().enumerate() {
        let step = step(kernels, range, (axis, 0.5 * tolerance), report)?;
        *count = (1.0 / step).ceil() as usize + 1;
    }
    for round in 0.. {
        let limited = fit(&mut counts, most);
        let nodes = Nodes::new(range, counts);
        let error = NodeError { limited, ..measured(kernels, &nodes, report)? };
        let excess = error.over(tolerance, ESF_SHARE * tolerance);
        if excess <= EXCESS || limited || round == ROUNDS {
            let limited = excess > EXCESS;
            return Ok(Nodes { error: Some(NodeError { limited, ..error }), ..nodes });
        }
        let factor = excess.sqrt();
        counts = counts.map(|n| ((n - 1) as f64 * factor).ceil() as usize + 1);
    }
    unreachable!("the last round returns")
}

/// Makes `counts` fit `most` nodes; whether they were too many.
fn fit(counts: &mut [usize; 2], most: usize) -> bool {
    let product = counts[0] * counts[1];
    if product <= most {
        return false;
    }
    let factor = (most as f64 / product as f64).sqrt();
    *counts = counts.map(|n| ((n as f64 * factor) as usize).max(2));
    // A direction of few nodes may have been rounded up.
    while counts[0] * counts[1] > most.max(4) {
        let longer = usize::from(counts[1] > counts[0]);
        counts[longer] -= 1;
    }
    true
}

/// The step along X (`axis` 0) or Y, of the film's side, whose error is `allowed`.
fn step(
    kernels: &mut PlaceKernels<'_>,
    range: FilmRange,
    (axis, allowed): (usize, f64),
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<f64, SkewError> {
    let mut step = FIRST_STEP;
    let share = |i: usize| (i as f64 + 0.5) / PROBES as f64;
    for round in 0..STEP_ROUNDS {
        let beside = |k: usize, sign: f64| {
            let mut at = [share(k % PROBES), share(k / PROBES)];
            at[axis] += sign * 0.5 * step;
            range.at(at)
        };
        let cases: Vec<[[f64; 2]; 3]> =
            (0..PROBES * PROBES).map(|k| [-1.0, 0.0, 1.0].map(|sign| beside(k, sign))).collect();
        report("steps", kernels.fill(&cases.concat())?);
        let error = |[before, at, behind]: &[[f64; 2]; 3]| {
            let mean: Vec<f32> =
                kernels.at(*before).iter().zip(kernels.at(*behind)).map(|(a, b)| 0.5 * (a + b)).collect();
            Difference::of(&mean, kernels.at(*at)).error(1.0)
        };
        let worst = cases.iter().map(error).fold(0.0, f64::max);
        let measured = step;
        step = (step * (allowed / worst).sqrt()).min(LONGEST_STEP);
        if worst <= BEYOND_SQUARE * allowed || round + 1 == STEP_ROUNDS || step >= measured {
            break;
        }
    }
    Ok(step)
}

/// The errors at the centres of cells over the whole film.
fn measured(
    kernels: &mut PlaceKernels<'_>,
    nodes: &Nodes,
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<NodeError, SkewError> {
    let cells = |at: &[f64]| -> Vec<usize> {
        let last = at.len() - 2;
        let mut cells: Vec<usize> = (0..CHECKS).map(|i| i * last / (CHECKS - 1)).collect();
        cells.dedup();
        cells
    };
    let (columns, rows) = (cells(&nodes.x_mm), cells(&nodes.y_mm));
    let corners = |i: usize, j: usize| {
        [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[a, b]| [nodes.x_mm[i + a], nodes.y_mm[j + b]])
    };
    let cases: Vec<([[f64; 2]; 4], [f64; 2])> = rows
        .iter()
        .flat_map(|j| columns.iter().map(move |i| corners(*i, *j)))
        .map(|four| (four, [0, 1].map(|k| 0.5 * (four[0][k] + four[3][k]))))
        .collect();
    let wanted: Vec<[f64; 2]> =
        cases.iter().flat_map(|(four, at)| four.iter().chain([at])).copied().collect();
    report("checking", kernels.fill(&wanted)?);
    let error = |(four, at): &([[f64; 2]; 4], [f64; 2])| {
        let corners = four.map(|corner| kernels.at(corner));
        let truth = kernels.at(*at);
        let mean: Vec<f32> =
            (0..truth.len()).map(|i| 0.25 * corners.iter().map(|kernel| kernel[i]).sum::<f32>()).collect();
        (Difference::of(&mean, truth), real::hypot(at[0], at[1]))
    };
    Ok(NodeError::of(cases.iter().map(error).collect(), false))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_fit_the_budget() {
        let mut few = [10, 20];
        assert!(!fit(&mut few, 200) && few == [10, 20]);
        for (given, most) in [([100, 100], 900), ([3, 4000], 1000), ([2, 9], 8), ([2000, 3], 4)] {
            let mut counts = given;
            assert!(fit(&mut counts, most));
            assert!(counts[0] * counts[1] <= most && counts.iter().all(|n| *n >= 2), "{counts:?}");
        }
    }

    #[test]
    fn places_are_row_by_row_and_end_on_the_range() {
        let nodes = Nodes::new(FilmRange { x_mm: [-3.0, 1.0], y_mm: [-1.0, 1.0] }, [5, 3]);
        let places = nodes.places();
        assert_eq!((places.len(), places[0], places[14]), (15, [-3.0, -1.0], [1.0, 1.0]));
        assert_eq!((places[1], places[5]), ([-2.0, -1.0], [-3.0, 0.0]));
    }
}
