//! Choice of the heights and azimuth counts of PSF nodes by the error of the kernels interpolated between them.
//!
//! The film's kernel is linear in r between heights r_k and linear in θ between the J_k azimuths of each. Between two heights
//! the error is e_r ≈ C_r (Δr/2)², between two azimuths e_θ ≈ C_θ (π/J)², both for the L1 norm over the film's pixels and for edges ([`super::difference`]), each
//! of which has its tolerance; kernels have the sum 1.
//! The number of nodes, Σ J_k, is minimal when both have an equal part of the tolerance. So: measure C_r and C_θ at probing
//! heights, place nodes accordingly, then compare the kernel at the centre of every cell ([`super::cells`]) with the one traced
//! there; split or refine the cells above the tolerance. The maximum error at
//! cell centres is recorded as the bound.
//! Budget: if the tolerances need more than a sixth of `max_nodes` nodes, or more samples or PSFs than go with them ([`super::refine`]), spacings grow by a common
//! factor until they fit, which keeps the error equal over the field and so its maximum minimal. The factor is at most [`TraceOptions::excess`], unless that needs
//! more than `max_nodes`; edges keep their tolerance up to it, and yield first where no further nodes are allowed (lenses as built and others of many PSFs). Then
//! the cells of the largest errors are refined as far as the budget allows. Where samples or PSFs limit the heights, azimuths, which need neither, keep up to a
//! quarter of the error ([`super::relaxation`]).
//! Kernels are compared in the core of the window, or mostly in its inner part ([`super::kernels`]); where that is wide, at fewer heights and cells.
//! Neighbouring wavelengths need nearly the same nodes: [`adopt`] takes those of another one if a few cells, measured at both, agree.
//! Rotated PSFs are exact here (the pupil is rotated, not the image); the film's kernels have an additional rotation error.

use super::cells::{Ratio, cells_to_measure, check, middle, of_all_cells, ratio_of_largest, totals};
use super::difference::{Difference, ESF_SHARE};
use super::film_samples::{FilmSamples, Steps};
use super::kernels::Compared;
use super::options::{Azimuths, PsfHeights, TraceOptions};
use super::placement::Placement;
use super::probing::{azimuths_needed, spacing_allowed};
use super::refine::{ALL, CellError, MIN_PSFS, NodeError, Refinement, max_psfs, summary};
use crate::design::prescription::error::DesignError;
use crate::design::pupil::pupils::Pupils;

/// Part of the tolerance for the grid: the rest is for the rotation of kernels, and keeps the median of the error over the film at
/// half the tolerance (measured: 0.47 % for 1 %).
const GRID_SHARE: f64 = 0.8;
/// Numbers of probing heights, and how many PSFs for each the budget must allow.
const PROBES: [(usize, usize); 3] = [(12, 20), (6, 16), (3, 0)];
/// Most probing heights where the inner part of the core is wide itself.
const WIDE_PROBES: usize = 6;
/// Maximum of rounds of checking and refining.
const MAX_ROUNDS: usize = 6;

/// Cells from which on a part of them is measured, about so many at a time, and where the inner part of the core is wide itself.
const MEASURED_CELLS: usize = 24;
const WIDE_CELLS: usize = 12;
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
    let (most_probes, most_cells) = match compared.is_wide() {
        true => (WIDE_PROBES, WIDE_CELLS),
        false => (usize::MAX, MEASURED_CELLS),
    };
    let Compared { most: kernels, some } = compared;
    let allows = |(probes, each): &&(usize, usize)| max_psfs >= probes * each && *probes <= most_probes;
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
        let measured = cells_to_measure(kernels, (&heights, &azimuths), most_cells);
        let nodes = (&heights[..], &azimuths[..]);
        let found = check(kernels, pupils, nodes, &measured, report)?;
        errors = match some.as_mut() {
            None => of_all_cells(&measured, &found, heights.len() - 1),
            Some(core) => {
                let ratio = match &mut ratio {
                    Some(ratio) => ratio,
                    none => none.insert(Ratio::of_some(core, pupils, nodes, (&measured, &found), report)?),
                };
                let worst = |e: &CellError| e.total.error(l1_over_esf);
                ratio.errors(core, pupils, nodes, (&measured, &found), (&worst, goal), report)?
            }
        };
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
    let here = totals(kernels, pupils, (&other.heights, &other.azimuths), &measured, report)?;
    let ratios: Vec<f64> = here.iter().zip(&cells).map(|(e, cell)| e.l1 / known[*cell].l1).collect();
    let largest = ratios.iter().copied().fold(0.0, f64::max);
    let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
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

#[cfg(test)]
mod tests {
    use super::*;

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
