//! Choice of the heights and azimuth counts of PSF nodes by the error of the kernels interpolated between them.
//!
//! The film's kernel is linear in r between heights r_k and linear in θ between the J_k azimuths of each. Between two heights
//! the error is e_r ≈ C_r (Δr/2)², between two azimuths e_θ ≈ C_θ (π/J)², both for the L1 norm over the film's pixels and for edges ([`super::difference`]), each
//! of which has its tolerance; kernels have the sum 1.
//! The number of nodes, Σ J_k, is minimal when both have an equal part of the tolerance. So: measure C_r and C_θ at probing
//! heights, place nodes accordingly, then compare the kernel at the centre of every cell (half-way in r, and half-way in θ on both
//! heights: the worst place) with the one traced there; split or refine the cells above the tolerance. The maximum error at
//! cell centres is recorded as the bound. Of many cells a part is measured: errors change slowly with height, and are linear between the measured cells.
//! Budget: if the tolerances need more than a sixth of `max_nodes` nodes, or more samples or PSFs than go with them ([`super::refine`]), spacings grow by a common
//! factor until they fit, which keeps the error equal over the field and so its maximum minimal. The factor is at most [`TraceOptions::excess`], unless that needs
//! more than `max_nodes`; edges keep their tolerance up to it, and yield first where no further nodes are allowed (lenses as built and others of many PSFs). Then
//! the cells of the largest errors are refined as far as the budget allows. Where samples or PSFs limit the heights, azimuths, which need neither, keep up to a
//! quarter of the error ([`super::relaxation`]).
//! Kernels are compared in the core of the window, or mostly in its inner part ([`super::kernels`]).
//! Neighbouring wavelengths need nearly the same nodes: [`adopt`] takes those of another one if a few cells, measured at both, agree.
//! Rotated PSFs are exact here (the pupil is rotated, not the image); the film's kernels have an additional rotation error.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::difference::{Difference, ESF_SHARE};
use super::film_samples::{FilmSamples, Steps};
use super::kernels::{Compared, Kernels, mean};
use super::options::{Azimuths, PsfHeights, TraceOptions};
use super::placement::Placement;
use super::probing::{COMPARED, LEAST_ERROR, azimuths_needed, between, evenly, spacing_allowed};
use super::refine::{ALL, CellError, MIN_PSFS, NodeError, Refinement, max_psfs, summary};
use crate::design::prescription::error::DesignError;
use crate::design::pupil::pupils::Pupils;

/// Part of the tolerance for the grid: the rest is for the rotation of kernels, and keeps the median of the error over the film at
/// half the tolerance (measured: 0.47 % for 1 %).
const GRID_SHARE: f64 = 0.8;
/// Numbers of probing heights, and how many PSFs for each the budget must allow.
const PROBES: [(usize, usize); 3] = [(12, 20), (6, 16), (3, 0)];
/// Maximum of rounds of checking and refining.
const MAX_ROUNDS: usize = 6;

/// Cells from which on a part of them is measured, about so many at a time.
const MEASURED_CELLS: usize = 24;
/// Kernels of a check of so many cells.
const CHECKED: usize = 5 * MEASURED_CELLS;

/// Cells that are measured before nodes of another wavelength are taken.
const ADOPTED_CELLS: usize = 4;
/// Largest error of nodes of another wavelength where the budget limits them, over their error there.
const ADOPTED_ERROR: f64 = 1.3;
/// Heights that samples allow, over those where nodes were chosen, from which on a band with larger errors than requested chooses its own.
const MORE_HEIGHTS: f64 = 1.3;

/// Chosen heights and azimuth counts, the errors of the cells between them, and the error bound, if checked.
#[derive(Clone, Debug)]
pub(crate) struct Chosen {
    pub(crate) heights: Vec<f64>,
    pub(crate) azimuths: Vec<usize>,
    pub(crate) error: Option<NodeError>,
    cells: Vec<Difference>,
    /// Those in the inner part of the core, if kernels were compared there.
    inner_cells: Option<Vec<Difference>>,
    /// Heights that the samples of PSFs allow, if they are chosen.
    allowed_heights: Option<usize>,
}

impl Chosen {
    /// Whether `allowed_heights` of another band are so many more that its own nodes may have smaller errors, which here are above those of `options`.
    pub(super) fn is_limited_beside(&self, allowed_heights: usize, options: &TraceOptions) -> bool {
        let is_more = |here: usize| allowed_heights as f64 > MORE_HEIGHTS * here as f64;
        self.allowed_heights.is_some_and(is_more) && self.error.is_some_and(|e| e.is_above(options))
    }
}

/// Chooses heights from 0 to `last_mm` and their azimuth counts, for PSFs of which films have some `samples`.
pub(super) fn choose(
    compared: &mut Compared<'_>,
    pupils: &mut Pupils<'_>,
    options: &TraceOptions,
    (last_mm, samples): (f64, &FilmSamples),
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<Chosen, DesignError> {
    let given = match &options.heights {
        PsfHeights::Given(h) => Some(h.clone()),
        PsfHeights::ByError => None,
    };
    let with_axis = |heights: Vec<f64>, azimuths: Vec<usize>, error, (cells, inner_cells)| {
        let azimuths = azimuths.into_iter().enumerate().map(|(k, j)| if k == 0 { 1 } else { j }).collect();
        let allowed_heights = given.is_none().then(|| samples.most(options));
        Chosen { heights, azimuths, error, cells, inner_cells, allowed_heights }
    };
    if let (Some(heights), Azimuths::Given(j)) = (&given, options.azimuths) {
        return Ok(with_axis(heights.clone(), vec![j; heights.len()], None, (Vec::new(), None)));
    }
    let tolerance = GRID_SHARE * options.psf_tolerance;
    let part = 0.5 * tolerance;
    let max_psfs = max_psfs(options, pupils.mean(|f| compared.grid().work(f)));
    let Compared { most: kernels, some } = compared;
    let allows = |(probes, each): &&(usize, usize)| max_psfs >= probes * each;
    let probe_count = PROBES.iter().find(allows).map_or(3, |(probes, _)| *probes);
    let probes: Vec<f64> = (1..=probe_count).map(|i| last_mm * i as f64 / probe_count as f64).collect();
    report("probing", 0);
    let azimuths = match options.azimuths {
        Azimuths::Given(j) => [vec![j as f64; probe_count], vec![0.0; probe_count]],
        Azimuths::ByError => azimuths_needed((kernels, some.as_mut()), pupils, &probes, part, report)?,
    };
    let spacing = match &given {
        Some(_) => None,
        None => Some(spacing_allowed((kernels, some.as_mut()), pupils, &probes, part, report)?),
    };
    let left = max_psfs.saturating_sub(kernels.len()).max(MIN_PSFS / 2);
    let placement = Placement { options, last_mm, probes, azimuths, spacing };
    // A check of K heights traces about 3 K PSFs, or a part of them, the result K.
    let of_checks = if left >= CHECKED { usize::MAX } else { left / 4 };
    let mut steps = Steps::new(samples, last_mm, options, of_checks);
    let relaxed = steps.least_error(&placement, tolerance, pupils, report)?;
    let mut budget = relaxed.budget;
    let (free_heights, free_azimuths) = (placement.has_free_heights(), placement.has_free_azimuths());
    let (mut heights, count) = (placement.heights(&relaxed), placement.count(&relaxed));
    let mut azimuths: Vec<usize> = heights.iter().map(|h| count(*h)).collect();
    let mut limited = relaxed.by.radial > options.excess;
    let (goal, l1_over_esf) = (tolerance * relaxed.by.mean(), relaxed.l1_over_esf());
    kernels.clear();
    if let Some(kernels) = some {
        kernels.clear();
    }
    pupils.keep(&[]);
    let mut errors: Vec<CellError> = Vec::new();
    let mut ratio: Option<Ratio> = None;
    for round in 0..MAX_ROUNDS {
        let measured = cells_to_measure(kernels, (&heights, &azimuths));
        let nodes = (&heights[..], &azimuths[..]);
        let mut found = check(kernels, pupils, nodes, &measured, report)?;
        if let (Some(kernels), None) = (some.as_mut(), &ratio) {
            ratio = Some(ratio_to(kernels, pupils, nodes, (&measured, &found), report)?);
        }
        if let Some(ratio) = &ratio {
            for (error, k) in found.iter_mut().zip(&measured) {
                *error = error.with(ratio.at(middle(&heights, *k)), |inner, ratio| inner * ratio);
            }
        }
        errors = of_all_cells(&measured, &found, heights.len() - 1);
        let worst = errors.iter().map(|e| e.total.error(l1_over_esf)).fold(0.0, f64::max);
        if worst <= goal || round + 1 == MAX_ROUNDS {
            break;
        }
        if kernels.len() >= left {
            limited = true;
            break;
        }
        // The largest errors first, if the budget does not allow all.
        let mut threshold = goal;
        let refined = loop {
            let refine = Refinement { threshold, l1_over_esf, free_heights, free_azimuths };
            let refined = refine.apply(&heights, &azimuths, &errors, &count);
            if refined.0 == heights && refined.1 == azimuths {
                break None;
            }
            let fit = budget.fits(&refined.0, &refined.1, free_heights);
            if fit == ALL {
                break Some(refined);
            }
            if !fit.heights
                && worst > options.excess * options.psf_tolerance
                && let Some(more) = steps.further(worst - goal, pupils, report)?
            {
                budget.heights = more;
                continue;
            }
            limited = true;
            threshold = (1.1 * threshold).max(threshold + 0.02 * worst);
        };
        let Some(refined) = refined else { break };
        (heights, azimuths) = refined;
    }
    let mut error = summary(&errors, &heights, limited);
    error.limited &= error.is_above(options);
    let cells: Vec<Difference> = errors.iter().map(|e| e.total).collect();
    let inner_cells = ratio.map(|ratio| {
        let inner = |(i, e): (usize, &Difference)| {
            e.with(ratio.at(middle(&heights, i + 1)), |core, ratio| core / ratio)
        };
        cells.iter().enumerate().map(inner).collect()
    });
    Ok(with_axis(heights, azimuths, Some(error), (cells, inner_cells)))
}

/// The nodes `other` of a neighbouring wavelength with their error here, estimated from a few cells; none if it exceeds the tolerance and the
/// error there by too much.
pub(super) fn adopt(
    Compared { most, some }: &mut Compared<'_>,
    pupils: &mut Pupils<'_>,
    (tolerance, excess): (f64, f64),
    other: &Chosen,
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<Option<Chosen>, DesignError> {
    let Some(there) = other.error else { return Ok(None) };
    // Both in the inner part of the core, or both in the core.
    let (kernels, known) = match (some, &other.inner_cells) {
        (Some(_), Some(inner)) => (most, inner),
        (Some(core), None) => (core, &other.cells),
        (None, _) => (most, &other.cells),
    };
    let count = known.len();
    // Those of the largest L1 and ESF, and others over the whole field.
    let largest = |number: fn(Difference) -> f64| {
        let of = |cell: &usize| number(other.cells[*cell]);
        (0..count).max_by(|a, b| of(a).total_cmp(&of(b))).unwrap_or(0)
    };
    let mut cells: Vec<usize> = (1..ADOPTED_CELLS).map(|i| i * (count - 1) / (ADOPTED_CELLS - 1)).collect();
    cells.extend([largest(|d| d.l1), largest(|d| d.esf)]);
    cells.sort_unstable();
    cells.dedup();
    let measured: Vec<usize> = cells.iter().map(|cell| cell + 1).collect();
    let errors = check(kernels, pupils, (&other.heights, &other.azimuths), &measured, report)?;
    let ratios: Vec<f64> = errors.iter().zip(&cells).map(|(e, cell)| e.total.l1 / known[*cell].l1).collect();
    let largest = ratios.iter().copied().fold(0.0, f64::max);
    let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
    let here: Vec<Difference> = errors.iter().map(|e| e.total).collect();
    let known: Vec<Difference> = cells.iter().map(|cell| known[*cell]).collect();
    let edge = there.edge * ratio_of_largest(&here, &known);
    let error = NodeError { worst: largest * there.worst, median: mean * there.median, edge, ..there };
    let is_adopted = are_good_enough((tolerance, excess), there.worst, error.worst)
        && are_good_enough((ESF_SHARE * tolerance, 1.0), there.edge, edge);
    Ok(is_adopted.then(|| Chosen { error: Some(error), ..other.clone() }))
}

/// Whether nodes with the L1 error, or ESF, `there` at the wavelength where they were chosen are taken where it is `here`: within the tolerance, or about as
/// large as there where the budget did not allow the tolerance, but not above `excess` times it where it was within that.
fn are_good_enough((tolerance, excess): (f64, f64), there: f64, here: f64) -> bool {
    let is_alike = there > tolerance && here <= ADOPTED_ERROR * there;
    here <= tolerance || (is_alike && (here <= excess * tolerance || there > excess * tolerance))
}

/// The kernels that the error of cell `k` needs: at its centre, and at either height unrotated and half-way to the next azimuth.
fn kernels_of_cell((heights, azimuths): (&[f64], &[usize]), k: usize) -> [(f64, f64); 5] {
    let (a, b) = (heights[k - 1], heights[k]);
    let half = |k: usize| half_step(azimuths, k);
    [(0.5 * (a + b), 0.0), (a, 0.0), (a, half(k - 1)), (b, 0.0), (b, half(k))]
}

/// Half the step between the azimuths of height `k`, rad.
fn half_step(azimuths: &[usize], k: usize) -> f64 {
    if k == 0 { 0.0 } else { PI / azimuths[k] as f64 }
}

/// The cells whose errors are measured, ascending: those whose kernels are known, and of the others every so many, the outermost included.
fn cells_to_measure(kernels: &Kernels<'_>, nodes: (&[f64], &[usize])) -> Vec<usize> {
    let is_known = |k: &usize| kernels_of_cell(nodes, *k).iter().all(|(h, a)| kernels.has(*h, *a));
    let (mut cells, others): (Vec<usize>, Vec<usize>) = (1..nodes.0.len()).partition(is_known);
    let step = others.len().div_ceil(MEASURED_CELLS).max(1);
    cells.extend(others.iter().rev().step_by(step));
    cells.sort_unstable();
    cells
}

/// Errors of all `count` cells, from those `found` of the cells `measured`.
fn of_all_cells(measured: &[usize], found: &[CellError], count: usize) -> Vec<CellError> {
    let x: Vec<f64> = measured.iter().map(|k| *k as f64).collect();
    let of = |part: fn(&CellError) -> Difference| {
        let [l1, esf]: [Vec<f64>; 2] = [|d: Difference| d.l1, |d: Difference| d.esf]
            .map(|number| found.iter().map(|error| number(part(error))).collect());
        let at = |k: usize, y: &[f64]| between(&x, y, k as f64);
        (1..=count).map(|k| Difference { l1: at(k, &l1), esf: at(k, &esf) }).collect::<Vec<_>>()
    };
    let (total, radial, angular) = (of(|e| e.total), of(|e| e.radial), of(|e| e.angular));
    let cells = total.iter().zip(&radial).zip(&angular);
    cells
        .map(|((total, radial), angular)| CellError { total: *total, radial: *radial, angular: *angular })
        .collect()
}

/// Errors of `cells`, each by the index of its upper height.
fn check(
    kernels: &mut Kernels<'_>,
    pupils: &mut Pupils<'_>,
    (heights, azimuths): (&[f64], &[usize]),
    cells: &[usize],
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<Vec<CellError>, DesignError> {
    let requested: Vec<(f64, f64)> =
        cells.iter().flat_map(|k| kernels_of_cell((heights, azimuths), *k)).collect();
    report("checking", 0);
    report("checking", kernels.fill(pupils, &requested)?);
    let kernels = &*kernels;
    let between = |k: usize| kernels.mean_with_mirror(kernels.at(heights[k], half_step(azimuths, k)));
    let angular = |k: usize, mean: &[f32]| Difference::of(mean, kernels.at(heights[k], 0.0));
    Ok(cells
        .par_iter()
        .map(|&k| {
            let truth = kernels.at(0.5 * (heights[k - 1] + heights[k]), 0.0);
            let (a, b) = (between(k - 1), between(k));
            let unrotated = mean(kernels.at(heights[k - 1], 0.0), kernels.at(heights[k], 0.0));
            CellError {
                total: Difference::of(&mean(&a, &b), truth),
                radial: Difference::of(&unrotated, truth),
                angular: angular(k - 1, &a).with(angular(k, &b), f64::max),
            }
        })
        .collect())
}

/// The middle between the heights of cell `k`, mm.
fn middle(heights: &[f64], k: usize) -> f64 {
    0.5 * (heights[k - 1] + heights[k])
}

/// Errors in the core over those in its inner part, at some heights, mm.
struct Ratio {
    heights_mm: Vec<f64>,
    l1: Vec<f64>,
    /// That of the largest ones: some ESFs are next to nothing.
    esf: f64,
}

impl Ratio {
    /// At `height_mm`, of the L1 between the two next heights.
    fn at(&self, height_mm: f64) -> Difference {
        Difference { l1: between(&self.heights_mm, &self.l1, height_mm), esf: self.esf }
    }
}

/// Errors in the core, whose `kernels` are compared, over those `found` in its inner part, in [`COMPARED`] of the cells `measured`.
fn ratio_to(
    kernels: &mut Kernels<'_>,
    pupils: &mut Pupils<'_>,
    nodes: (&[f64], &[usize]),
    (measured, found): (&[usize], &[CellError]),
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<Ratio, DesignError> {
    let some = evenly(COMPARED, measured.len());
    let cells: Vec<usize> = some.iter().map(|i| measured[*i]).collect();
    let errors = check(kernels, pupils, nodes, &cells, report)?;
    let of_core: Vec<Difference> = errors.iter().map(|e| e.total).collect();
    let inner: Vec<Difference> = some.iter().map(|i| found[*i].total).collect();
    let l1 = of_core.iter().zip(&inner).map(|(core, inner)| core.l1 / inner.l1.max(LEAST_ERROR)).collect();
    let heights_mm = cells.iter().map(|k| middle(nodes.0, *k)).collect();
    Ok(Ratio { heights_mm, l1, esf: ratio_of_largest(&of_core, &inner) })
}

/// The largest ESF of `some` over that of `others`.
fn ratio_of_largest(some: &[Difference], others: &[Difference]) -> f64 {
    let largest = |all: &[Difference]| all.iter().map(|d| d.esf).fold(LEAST_ERROR, f64::max);
    largest(some) / largest(others)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_linear_between_the_measured_cells() {
        let difference = |l1: f64| Difference { l1, esf: 0.1 * l1 };
        let error = |total: f64| CellError {
            total: difference(total),
            radial: difference(0.5 * total),
            angular: Difference::default(),
        };
        let all = of_all_cells(&[2, 4, 5], &[error(0.1), error(0.3), error(0.2)], 6);
        let expected = [0.1, 0.1, 0.2, 0.3, 0.2, 0.2];
        assert_eq!(all.len(), expected.len());
        for (found, expected) in all.iter().zip(expected) {
            let Difference { l1, esf } = found.total;
            assert!((l1 - expected).abs() < 1e-12 && (esf - 0.1 * expected).abs() < 1e-12);
            assert!((found.radial.l1 - 0.5 * expected).abs() < 1e-12);
        }
    }

    #[test]
    fn nodes_of_another_wavelength_stay_within_the_tolerance_that_they_had() {
        let are_good_enough = |there, here| are_good_enough((0.01, 2.0), there, here);
        assert!(are_good_enough(0.008, 0.01));
        assert!(!are_good_enough(0.008, 0.0101), "less than 1.3 times the error there");
        assert!(are_good_enough(0.016, 0.02) && !are_good_enough(0.016, 0.0201), "within the excess");
        assert!(are_good_enough(0.021, 0.027) && !are_good_enough(0.021, 0.028));
    }

    #[test]
    fn a_band_whose_samples_allow_more_heights_chooses_its_own_nodes_where_errors_are_large() {
        let options = TraceOptions::new(vec![550.0], 10.0);
        let nodes = |worst: f64, allowed_heights| Chosen {
            heights: vec![0.0, 1.0],
            azimuths: vec![1, 8],
            error: Some(NodeError { worst, at_mm: 0.5, median: worst, edge: 0.0, limited: true }),
            cells: vec![Difference { l1: worst, esf: 0.0 }],
            inner_cells: None,
            allowed_heights,
        };
        assert!(nodes(0.03, Some(65)).is_limited_beside(88, &options));
        assert!(!nodes(0.03, Some(65)).is_limited_beside(80, &options), "hardly more heights");
        assert!(!nodes(0.015, Some(65)).is_limited_beside(88, &options), "small errors");
        assert!(!nodes(0.03, None).is_limited_beside(88, &options), "heights are given");
        let mut of_edges = nodes(0.015, Some(65));
        of_edges.error.as_mut().unwrap().edge = 0.0021;
        assert!(of_edges.is_limited_beside(88, &options), "errors of edges above a fifth of the tolerance");
    }
}
