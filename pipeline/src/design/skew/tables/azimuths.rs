//! Choice of the azimuths at which the PSFs of a height are stored.
//!
//! ```text
//! Q(φ) = Σ_a D(φ − 2πa/A) Q_a,      D(x) = sin(Ax/2) / (A tan(x/2)),  A even
//! ```
//! Q(φ): the PSF of the film place (r, φ) in the frame that is turned by φ. D is the band-limited interpolation: exact for harmonics below A/2, so
//! its error falls faster than any power of 1/A once A exceeds twice the harmonics that the errors of a lens have. A is the least even number from
//! 8 on whose error at eight azimuths half-way between samples is within a fifth of the tolerance, as an L1 norm of film-pixel kernels.
//! Kernels are computed at 16, 24, 32, 48, … azimuths and at eight between them, until the error there is small enough. Smaller numbers are
//! then examined with kernels interpolated from those: their errors are differences to these, plus the error of these. So there is a sum of the
//! computed kernels for each:
//! ```text
//! Q(φ) − Σ_b D_A(φ − φ_b) Q(φ_b) = Σ_a [D(φ − φ_a) − Σ_b D_A(φ − φ_b) D(φ_b − φ_a)] Q_a
//! ```
//! It is determined at a few heights; between two of them the larger number holds. At A = J, the number of nodes of a height, every node is
//! a sample. A lens whose kernels are the same at all azimuths has A = 1.

use rayon::prelude::*;

use super::super::error::SkewError;
use super::band_limited::{azimuth_of, dirichlet};
use super::functions::Functions;
use super::kernels::{View, Views};
use crate::design::tables::difference::Difference;

/// Heights at which A is determined.
pub(super) const PROBES: usize = 6;
/// Azimuths half-way between samples at which the error is determined.
const BETWEEN: usize = 8;
/// Least number of azimuths.
const LEAST: usize = 8;
/// Part of the tolerance that the interpolation in azimuth may use.
const SHARE: f64 = 0.2;
/// L1 difference of kernels that are the same but for rounding and the interpolation of pupil functions.
const SAME: f64 = 2e-4;

/// The numbers of azimuths A_k of `heights` (mm, from 0) with J_k = `nodes`, and the largest error of the interpolation at the probing heights.
pub(super) fn choose(
    views: &mut Views<'_>,
    functions: &mut Functions<'_>,
    (heights, nodes): (&[f64], &[usize]),
    tolerance: f64,
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<(Vec<usize>, f64), SkewError> {
    let last = heights[heights.len() - 1];
    let probes: Vec<f64> = (1..=PROBES).map(|i| last * i as f64 / PROBES as f64).collect();
    if is_symmetric(views, functions, &probes, report)? {
        return Ok((vec![1; heights.len()], 0.0));
    }
    let most = nodes.iter().copied().max().unwrap_or(1);
    let bound = SHARE * tolerance;
    let (mut needed, mut worst) = (vec![most; PROBES], 0.0_f64);
    let mut open: Vec<usize> = (0..PROBES).collect();
    let mut failed = 0;
    for count in levels(most) {
        if open.is_empty() {
            break;
        }
        let probed: Vec<Probe> = open.iter().map(|i| Probe::new(probes[*i], count)).collect();
        let requested: Vec<View> = probed.iter().flat_map(Probe::views).collect();
        report("azimuths", views.fill(functions, &requested)?);
        let views = &*views;
        let found: Vec<Option<(usize, f64)>> =
            probed.par_iter().map(|probe| probe.least(views, failed, bound)).collect();
        for (i, found) in std::mem::take(&mut open).into_iter().zip(found) {
            match found {
                Some((count, error)) => (needed[i], worst) = (count, worst.max(error)),
                None => open.push(i),
            }
        }
        failed = count;
    }
    let of_height = |(h, nodes): (&f64, &usize)| {
        let above = probes.partition_point(|p| p < h).min(PROBES - 1);
        let below = above.saturating_sub(1);
        needed[above].max(needed[below]).min(*nodes)
    };
    Ok((heights.iter().zip(nodes).map(of_height).collect(), worst))
}

/// 16, 24, 32, …, the first and those below `most`.
fn levels(most: usize) -> impl Iterator<Item = usize> {
    (4..).flat_map(|power| [1 << power, 3 << (power - 1)]).take_while(move |n| *n == 2 * LEAST || *n < most)
}

/// Whether the kernels of each of `heights` are the same at eight azimuths, and mirror images of themselves.
fn is_symmetric(
    views: &mut Views<'_>,
    functions: &mut Functions<'_>,
    heights: &[f64],
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<bool, SkewError> {
    let views_of = |h: f64| (0..BETWEEN).map(move |i| View::own((h, azimuth_of(i, BETWEEN))));
    // The outermost height differs most.
    for h in heights.iter().rev() {
        let all: Vec<View> = views_of(*h).collect();
        report("azimuths", views.fill(functions, &all)?);
        let first = views.at(&all[0]);
        let n = first.len().isqrt();
        let mirrored: Vec<f32> = (0..n * n).map(|i| first[(n - 1 - i / n) * n + i % n]).collect();
        let is_other = |view: &View, kernel: &[f32]| Difference::of(views.at(view), kernel).l1 > SAME;
        let differs = |view: &View| is_other(view, first) || is_other(view, &mirrored);
        if all.iter().any(differs) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Kernels of a height at `count` azimuths, and at azimuths half-way between some of them.
struct Probe {
    count: usize,
    samples: Vec<View>,
    truths: Vec<View>,
}

impl Probe {
    fn new(height_mm: f64, count: usize) -> Self {
        let view = |i: usize, count: usize| View::own((height_mm, azimuth_of(i, count)));
        Self {
            count,
            samples: (0..count).map(|a| view(a, count)).collect(),
            truths: (0..BETWEEN).map(|i| view(between(i, count), 2 * count)).collect(),
        }
    }

    fn views(&self) -> Vec<View> {
        [&self.samples[..], &self.truths].concat()
    }

    /// The least even number of azimuths above `failed` with an error within `bound`, and that error; none if it exceeds the bound with all.
    fn least(&self, views: &Views<'_>, failed: usize, bound: f64) -> Option<(usize, f64)> {
        let kernels: Vec<&[f32]> = self.samples.iter().map(|view| views.at(view)).collect();
        let error = |i: usize| {
            let at = azimuth_of(between(i, self.count), 2 * self.count);
            let weights: Vec<f64> = (0..self.count).map(|a| self.weight(a, at)).collect();
            norm(&kernels, &weights, Some(views.at(&self.truths[i])))
        };
        let own = (0..BETWEEN).map(error).fold(0.0, f64::max);
        if own > bound {
            return None;
        }
        let of_fewer = |count: usize| (count, own + self.error_of_fewer(&kernels, count));
        let mut fewer = ((failed + 2).max(LEAST)..self.count).step_by(2).map(of_fewer);
        Some(fewer.find(|(_, error)| *error <= bound).unwrap_or((self.count, own)))
    }

    /// Weight of kernel `a` for that at an azimuth.
    fn weight(&self, a: usize, azimuth_rad: f64) -> f64 {
        dirichlet(azimuth_rad - azimuth_of(a, self.count), self.count)
    }

    /// L1 error of the interpolation between `count` azimuths, fewer than those of `kernels`, if these have none.
    fn error_of_fewer(&self, kernels: &[&[f32]], count: usize) -> f64 {
        let error = |i: usize| {
            let at = azimuth_of(between(i, count), 2 * count);
            let mut weights: Vec<f64> = (0..self.count).map(|a| self.weight(a, at)).collect();
            for b in 0..count {
                let sample = azimuth_of(b, count);
                let share = dirichlet(at - sample, count);
                weights.iter_mut().enumerate().for_each(|(a, w)| *w -= share * self.weight(a, sample));
            }
            norm(kernels, &weights, None)
        };
        (0..BETWEEN).map(error).fold(0.0, f64::max)
    }
}

/// The azimuth half-way between two of `count`, of twice as many: the first after an i-th part of the circle.
fn between(i: usize, count: usize) -> usize {
    2 * (i * count / BETWEEN) + 1
}

/// L1 norm of the sum of `kernels` by weight, less `truth`.
fn norm(kernels: &[&[f32]], weights: &[f64], truth: Option<&[f32]>) -> f64 {
    let mut sum = vec![0.0_f64; kernels[0].len()];
    for (kernel, weight) in kernels.iter().zip(weights) {
        sum.iter_mut().zip(*kernel).for_each(|(to, v)| *to += weight * f64::from(*v));
    }
    if let Some(truth) = truth {
        sum.iter_mut().zip(truth).for_each(|(to, v)| *to -= f64::from(*v));
    }
    sum.iter().map(|v| v.abs()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_grow_by_a_third_or_a_half() {
        assert_eq!(levels(100).collect::<Vec<_>>(), [16, 24, 32, 48, 64, 96]);
        assert_eq!(levels(8).collect::<Vec<_>>(), [16]);
    }

    /// The error of fewer azimuths from the kernels of more is the one of their own kernels, here of harmonics up to 6.
    #[test]
    fn errors_of_fewer_azimuths_are_those_of_their_own_kernels() {
        let value =
            |x: f64| [1.0 + 0.3 * (6.0 * x + 0.2).cos(), 0.4 * (5.0 * x).sin() - 0.2 * (3.0 * x).cos()];
        let probe = Probe::new(1.0, 16);
        let kernels: Vec<[f32; 2]> = (0..16).map(|a| value(azimuth_of(a, 16)).map(|v| v as f32)).collect();
        let kernels: Vec<&[f32]> = kernels.iter().map(|k| &k[..]).collect();
        for count in [8, 10, 12, 14] {
            let expected = (0..BETWEEN).map(|i| {
                let at = azimuth_of(between(i, count), 2 * count);
                let sum = (0..count).fold([0.0; 2], |sum, b| {
                    let x = azimuth_of(b, count);
                    [0, 1].map(|p| sum[p] + dirichlet(at - x, count) * value(x)[p])
                });
                [0, 1].iter().map(|p| (sum[*p] - value(at)[*p]).abs()).sum::<f64>()
            });
            let expected = expected.fold(0.0, f64::max);
            let found = probe.error_of_fewer(&kernels, count);
            assert!((found - expected).abs() < 1e-6, "{count}: {found} {expected}");
            assert_eq!(found > 0.01, count < 14, "{count}: {found}");
        }
    }
}
