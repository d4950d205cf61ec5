//! Errors of the cells between PSF nodes: of the kernel at the centre of each, half-way in r and half-way in θ on both heights, where it is the largest.
//!
//! Of many cells a part is measured; those of the others are linear between them. Where most kernels are compared in the inner part of the core ([`super::kernels`]), some cells are
//! measured in the core as well, among them those of the largest errors; the ratio is linear between their heights.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::difference::Difference;
use super::kernels::{Kernels, mean};
use super::probing::{COMPARED, LEAST_ERROR, between, evenly};
use super::refine::CellError;
use crate::design::prescription::error::DesignError;
use crate::design::pupil::pupils::Pupils;

/// Cells in which the core is compared with its inner part, at most.
const MAX_COMPARED: usize = 2 * COMPARED;

/// The kernels that the total error of cell `k` needs: at its centre, and at either height half-way to the next azimuth.
fn kernels_of_total((heights, azimuths): (&[f64], &[usize]), k: usize) -> [(f64, f64); 3] {
    let at = |k: usize| (heights[k], half_step(azimuths, k));
    [(middle(heights, k), 0.0), at(k - 1), at(k)]
}

/// The kernels that its parts need as well: at either height unrotated.
fn kernels_of_cell(nodes: (&[f64], &[usize]), k: usize) -> impl Iterator<Item = (f64, f64)> {
    kernels_of_total(nodes, k).into_iter().chain([k - 1, k].map(|k| (nodes.0[k], 0.0)))
}

/// Half the step between the azimuths of height `k`, rad.
fn half_step(azimuths: &[usize], k: usize) -> f64 {
    if k == 0 { 0.0 } else { PI / azimuths[k] as f64 }
}

/// The cells whose errors are measured, ascending: those whose kernels are known, and of the others about `most`, the outermost included.
pub(super) fn cells_to_measure(kernels: &Kernels<'_>, nodes: (&[f64], &[usize]), most: usize) -> Vec<usize> {
    let is_known = |k: &usize| kernels_of_cell(nodes, *k).all(|(h, a)| kernels.has(h, a));
    let (mut cells, others): (Vec<usize>, Vec<usize>) = (1..nodes.0.len()).partition(is_known);
    let step = others.len().div_ceil(most).max(1);
    cells.extend(others.iter().rev().step_by(step));
    cells.sort_unstable();
    cells
}

/// Errors of all `count` cells, from those `found` of the cells `measured`.
pub(super) fn of_all_cells(measured: &[usize], found: &[CellError], count: usize) -> Vec<CellError> {
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
pub(super) fn check(
    kernels: &mut Kernels<'_>,
    pupils: &mut Pupils<'_>,
    nodes: (&[f64], &[usize]),
    cells: &[usize],
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<Vec<CellError>, DesignError> {
    fill(kernels, pupils, cells.iter().flat_map(|k| kernels_of_cell(nodes, *k)), report)?;
    let kernels = &*kernels;
    let unrotated = |k: usize| kernels.at(nodes.0[k], 0.0);
    Ok(cells
        .par_iter()
        .map(|&k| {
            let truth = kernels.at(middle(nodes.0, k), 0.0);
            let [a, b] = [k - 1, k].map(|k| half_way(kernels, nodes, k));
            let angular = |k: usize, between: &[f32]| Difference::of(between, unrotated(k));
            CellError {
                total: Difference::of(&mean(&a, &b), truth),
                radial: Difference::of(&mean(unrotated(k - 1), unrotated(k)), truth),
                angular: angular(k - 1, &a).with(angular(k, &b), f64::max),
            }
        })
        .collect())
}

/// Their total errors alone, for which three fifths of the kernels are enough.
pub(super) fn totals(
    kernels: &mut Kernels<'_>,
    pupils: &mut Pupils<'_>,
    nodes: (&[f64], &[usize]),
    cells: &[usize],
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<Vec<Difference>, DesignError> {
    fill(kernels, pupils, cells.iter().flat_map(|k| kernels_of_total(nodes, *k)), report)?;
    let kernels = &*kernels;
    let total = |k: &usize| {
        let [a, b] = [k - 1, *k].map(|k| half_way(kernels, nodes, k));
        Difference::of(&mean(&a, &b), kernels.at(middle(nodes.0, *k), 0.0))
    };
    Ok(cells.par_iter().map(total).collect())
}

/// Computes the kernels `requested` that are missing.
fn fill(
    kernels: &mut Kernels<'_>,
    pupils: &mut Pupils<'_>,
    requested: impl Iterator<Item = (f64, f64)>,
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<(), DesignError> {
    report("checking", 0);
    report("checking", kernels.fill(pupils, &requested.collect::<Vec<_>>())?);
    Ok(())
}

/// What is interpolated at height `k` half-way between two azimuths, which have been computed.
fn half_way(kernels: &Kernels<'_>, (heights, azimuths): (&[f64], &[usize]), k: usize) -> Vec<f32> {
    kernels.mean_with_mirror(kernels.at(heights[k], half_step(azimuths, k)))
}

/// The middle between the heights of cell `k`, mm.
pub(super) fn middle(heights: &[f64], k: usize) -> f64 {
    0.5 * (heights[k - 1] + heights[k])
}

/// Errors in the core over those in its inner part, at some heights, mm, ascending.
pub(super) struct Ratio {
    l1: Vec<(f64, f64)>,
    /// That of the largest ones: some ESFs are next to nothing.
    esf: f64,
}

impl Ratio {
    /// That of [`COMPARED`] of the cells `measured`, whose errors in the inner part are `found`; kernels of `core` are compared.
    pub(super) fn of_some(
        core: &mut Kernels<'_>,
        pupils: &mut Pupils<'_>,
        nodes: (&[f64], &[usize]),
        (measured, found): (&[usize], &[CellError]),
        report: &mut dyn FnMut(&'static str, usize),
    ) -> Result<Self, DesignError> {
        let some = evenly(COMPARED, measured.len());
        let cells: Vec<usize> = some.iter().map(|i| measured[*i]).collect();
        let of_core = totals(core, pupils, nodes, &cells, report)?;
        let inner: Vec<Difference> = some.iter().map(|i| found[*i].total).collect();
        let esf = ratio_of_largest(&of_core, &inner);
        let mut ratio = Self { l1: Vec::new(), esf };
        for (cell, (of_core, inner)) in cells.iter().zip(of_core.iter().zip(&inner)) {
            ratio.insert(middle(nodes.0, *cell), of_core, inner);
        }
        Ok(ratio)
    }

    /// Errors in the core of all cells, from those in its inner part. Where the `worst` error is above `goal`, it is measured in the core, some times in all.
    pub(super) fn errors(
        &mut self,
        core: &mut Kernels<'_>,
        pupils: &mut Pupils<'_>,
        nodes: (&[f64], &[usize]),
        (measured, found): (&[usize], &[CellError]),
        (worst, goal): (&dyn Fn(&CellError) -> f64, f64),
        report: &mut dyn FnMut(&'static str, usize),
    ) -> Result<Vec<CellError>, DesignError> {
        loop {
            let at = |k: usize| middle(nodes.0, k);
            let of_core: Vec<CellError> = found
                .iter()
                .zip(measured)
                .map(|(e, k)| e.with(self.at(at(*k)), |inner, ratio| inner * ratio))
                .collect();
            let errors = of_all_cells(measured, &of_core, nodes.0.len() - 1);
            let largest =
                (0..measured.len()).max_by(|a, b| worst(&of_core[*a]).total_cmp(&worst(&of_core[*b])));
            let Some(i) = largest.filter(|i| worst(&of_core[*i]) > goal) else { return Ok(errors) };
            let height_mm = at(measured[i]);
            if self.l1.len() >= MAX_COMPARED || self.l1.iter().any(|(h, _)| *h == height_mm) {
                return Ok(errors);
            }
            let there = totals(core, pupils, nodes, &[measured[i]], report)?;
            self.insert(height_mm, &there[0], &found[i].total);
        }
    }

    fn insert(&mut self, height_mm: f64, core: &Difference, inner: &Difference) {
        let at = self.l1.partition_point(|(h, _)| *h < height_mm);
        self.l1.insert(at, (height_mm, core.l1 / inner.l1.max(LEAST_ERROR)));
    }

    /// At `height_mm`, of the L1 between the two next heights.
    pub(super) fn at(&self, height_mm: f64) -> Difference {
        let (heights_mm, l1): (Vec<f64>, Vec<f64>) = self.l1.iter().copied().unzip();
        Difference { l1: between(&heights_mm, &l1, height_mm), esf: self.esf }
    }
}

/// The largest ESF of `some` over that of `others`.
pub(super) fn ratio_of_largest(some: &[Difference], others: &[Difference]) -> f64 {
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
}
