//! Probing: the azimuths and the spacing of heights that kernels need at a few heights, from the errors of kernels between two of them.
//!
//! The square law of errors holds for small errors only: a first pass at a few of the heights gives what the second one, at all of them, starts with. Where kernels are compared in the inner part of the
//! core ([`super::kernels`]), a pass in the core at some of the heights gives the ratio of what the core needs to that.

use std::f64::consts::PI;

use super::difference::{Difference, ESF_SHARE};
use super::kernels::{Kernels, mean};
use super::refine::MAX_AZIMUTHS;
use crate::design::prescription::error::DesignError;
use crate::design::pupil::pupils::Pupils;

/// Azimuths and spacing of heights, mm, that probing begins with.
const FIRST_AZIMUTHS: f64 = 96.0;
const FIRST_SPACING_MM: f64 = 0.5;
/// Heights of the first pass, and heights or cells where the core is compared with its inner part.
pub(super) const COMPARED: usize = 4;
/// Least error that is divided by.
pub(super) const LEAST_ERROR: f64 = 1e-9;

/// Kernels that are compared, and those of the core where the former are of its inner part.
pub(super) type Pair<'k, 'a> = (&'k mut Kernels<'a>, Option<&'k mut Kernels<'a>>);

/// What the L1 and the ESF of kernels ([`Difference`]) need, at each probing height.
pub(super) type Needs = [Vec<f64>; 2];

/// Azimuths needed at the heights `probes` [mm] for an L1 of `part` and an ESF of its share, not rounded.
pub(super) fn azimuths_needed(
    (kernels, core): Pair<'_, '_>,
    pupils: &mut Pupils<'_>,
    probes: &[f64],
    part: f64,
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<Needs, DesignError> {
    let rough = |some: &[f64]| {
        probe_azimuths(kernels, pupils, (some, part), vec![FIRST_AZIMUTHS; some.len()], report)
    };
    let need = of_some(probes, f64::max, rough)?;
    let need = probe_azimuths(kernels, pupils, (probes, part), need, report)?;
    corrected(probes, f64::max, need, core, |kernels, some, need| {
        probe_azimuths(kernels, pupils, (some, part), need, report)
    })
}

/// Spacing of heights [mm] allowed at the heights `probes` [mm] for an L1 of `part` and an ESF of its share.
pub(super) fn spacing_allowed(
    (kernels, core): Pair<'_, '_>,
    pupils: &mut Pupils<'_>,
    probes: &[f64],
    part: f64,
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<Needs, DesignError> {
    let first_mm = FIRST_SPACING_MM.min(0.5 * probes[0]);
    let rough =
        |some: &[f64]| probe_heights(kernels, pupils, (some, part), vec![first_mm; some.len()], report);
    let spacing = of_some(probes, f64::min, rough)?;
    let spacing = probe_heights(kernels, pupils, (probes, part), spacing, report)?;
    corrected(probes, f64::min, spacing, core, |kernels, some, spacing| {
        probe_heights(kernels, pupils, (some, part), spacing, report)
    })
}

/// Indices of about `count` of `n`, the first and the last among them.
pub(super) fn evenly(count: usize, n: usize) -> Vec<usize> {
    let mut indices: Vec<usize> = (0..count).map(|i| i * (n - 1) / (count - 1)).collect();
    indices.dedup();
    indices
}

/// The more demanding of what L1 and ESF need by `rough` at a few of `probes`, linear between those.
fn of_some(
    probes: &[f64],
    demanding: fn(f64, f64) -> f64,
    rough: impl FnOnce(&[f64]) -> Result<Needs, DesignError>,
) -> Result<Vec<f64>, DesignError> {
    let at: Vec<f64> = evenly(COMPARED, probes.len()).into_iter().map(|i| probes[i]).collect();
    let [l1, esf] = rough(&at)?;
    let need: Vec<f64> = l1.into_iter().zip(esf).map(|(l1, esf)| demanding(l1, esf)).collect();
    Ok(probes.iter().map(|h| between(&at, &need, *h)).collect())
}

/// What is `found` at `probes` in the inner part of the core, times the ratio of what `again` finds at some of them in the core, beginning with it, to it. Of ESFs,
/// some of which are next to nothing, it is one ratio of the most demanding ones, which `demanding` selects.
fn corrected<'a>(
    probes: &[f64],
    demanding: fn(f64, f64) -> f64,
    found: Needs,
    core: Option<&mut Kernels<'a>>,
    again: impl FnOnce(&mut Kernels<'a>, &[f64], Vec<f64>) -> Result<Needs, DesignError>,
) -> Result<Needs, DesignError> {
    let Some(kernels) = core else { return Ok(found) };
    let some = evenly(COMPARED, probes.len());
    let of_some = |values: &Vec<f64>| -> Vec<f64> { some.iter().map(|i| values[*i]).collect() };
    let at: Vec<f64> = some.iter().map(|i| probes[*i]).collect();
    let [l1, esf] = found.each_ref().map(of_some);
    let [core_l1, core_esf] =
        again(kernels, &at, l1.iter().zip(&esf).map(|(a, b)| demanding(*a, *b)).collect())?;
    let ratio: Vec<f64> = core_l1.iter().zip(&l1).map(|(core, inner)| core / inner).collect();
    let most = |needs: Vec<f64>| needs.into_iter().reduce(demanding).unwrap_or(1.0);
    let of_esf = most(core_esf) / most(esf);
    let [found_l1, found_esf] = found;
    let l1 = probes.iter().zip(found_l1).map(|(h, v)| v * between(&at, &ratio, *h));
    Ok([l1.collect(), found_esf.into_iter().map(|v| of_esf * v).collect()])
}

/// [`azimuths_needed`], from `need` on in one pass.
fn probe_azimuths(
    kernels: &mut Kernels<'_>,
    pupils: &mut Pupils<'_>,
    (probes, part): (&[f64], f64),
    need: Vec<f64>,
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<Needs, DesignError> {
    let requested: Vec<(f64, f64)> =
        probes.iter().zip(&need).flat_map(|(h, need)| [(*h, 0.0), (*h, PI / need)]).collect();
    report("probing", kernels.fill(pupils, &requested)?);
    let found = probes.iter().zip(&need).map(|(h, need)| {
        let between = kernels.mean_with_mirror(kernels.at(*h, PI / need));
        let shares = shares_of(Difference::of(&between, kernels.at(*h, 0.0)), part);
        shares.map(|share| (need * share.sqrt()).clamp(8.0, MAX_AZIMUTHS as f64))
    });
    Ok(both(found))
}

/// [`spacing_allowed`], from `spacing` on in one pass.
fn probe_heights(
    kernels: &mut Kernels<'_>,
    pupils: &mut Pupils<'_>,
    (probes, part): (&[f64], f64),
    spacing: Vec<f64>,
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<Needs, DesignError> {
    let last = probes[probes.len() - 1];
    // Within the field, not beyond the axis.
    let ends = |(h, spacing): (&f64, &f64)| {
        let half = 0.5 * spacing;
        let centre = h.min(last - half).max(half);
        [centre - half, centre, centre + half]
    };
    let requested: Vec<(f64, f64)> =
        probes.iter().zip(&spacing).flat_map(|at| ends(at).map(|h| (h, 0.0))).collect();
    report("probing", kernels.fill(pupils, &requested)?);
    let found = probes.iter().zip(&spacing).map(|(h, spacing)| {
        let [below, centre, above] = ends((h, spacing)).map(|h| kernels.at(h, 0.0));
        let shares = shares_of(Difference::of(&mean(below, above), centre), part);
        shares
            .map(|share| 2.0 * (0.5 * spacing / share.max(LEAST_ERROR).sqrt()).clamp(last * 1e-4, 0.2 * last))
    });
    Ok(both(found))
}

/// The L1 and the ESF of each height.
fn both(found: impl Iterator<Item = [f64; 2]>) -> Needs {
    let (l1, esf) = found.map(|[l1, esf]| (l1, esf)).unzip();
    [l1, esf]
}

/// L1 and ESF over what they may be for an L1 of `part`.
fn shares_of(difference: Difference, part: f64) -> [f64; 2] {
    [difference.l1 / part, difference.esf / (ESF_SHARE * part)]
}

/// Linear between the points, constant beyond.
pub(super) fn between(x: &[f64], y: &[f64], at: f64) -> f64 {
    let i = x.partition_point(|v| *v < at);
    match i {
        0 => y[0],
        _ if i == x.len() => y[i - 1],
        _ => y[i - 1] + (y[i] - y[i - 1]) * (at - x[i - 1]) / (x[i] - x[i - 1]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::psf::PsfGrid;

    #[test]
    fn what_the_core_needs_is_that_of_its_inner_part_times_the_ratio_at_some_probes() {
        let probes: Vec<f64> = (1..=12).map(f64::from).collect();
        let l1: Vec<f64> = probes.iter().map(|h| 10.0 * h).collect();
        let found = [l1.clone(), vec![7.0; 12]];
        let grid = PsfGrid::new(3, 1.0);
        let mut kernels = Kernels::new(&grid, 3, 2.0);
        let kernels = Some(&mut kernels);
        let of_core = corrected(&probes, f64::max, found.clone(), kernels, |_, at, first| {
            assert_eq!((at, &first[..]), (&[1.0, 4.0, 8.0, 12.0][..], &[10.0, 40.0, 80.0, 120.0][..]));
            // Ratios of 1, 2, 2 and 3; of the ESF 2, that of the largest.
            Ok([vec![10.0, 80.0, 160.0, 360.0], vec![0.1, 14.0, 3.0, 8.0]])
        });
        let [of_core, of_esf] = of_core.unwrap();
        assert_eq!(of_esf, [14.0; 12]);
        let ratios = [1.0, 4.0 / 3.0, 5.0 / 3.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.25, 2.5, 2.75, 3.0];
        for ((found, ratio), of_core) in l1.iter().zip(ratios).zip(of_core) {
            assert!((of_core - found * ratio).abs() < 1e-9, "{of_core}, {found} times {ratio}");
        }
        let alone = corrected(&probes, f64::max, found.clone(), None, |_, _, _| unreachable!());
        assert_eq!(alone.unwrap(), found);
    }

    #[test]
    fn few_probes_are_all_compared() {
        assert_eq!(evenly(4, 12), [0, 3, 7, 11]);
        assert_eq!(evenly(4, 3), [0, 1, 2]);
        assert_eq!(evenly(4, 1), [0]);
    }
}
