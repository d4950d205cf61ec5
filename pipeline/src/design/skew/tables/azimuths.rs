//! Choice of the azimuths at which the PSFs of a height are stored.
//!
//! ```text
//! Q(φ) = Σ_a D(φ − 2πa/A) Q_a,      D(x) = sin(Ax/2) / (A tan(x/2)),  A even
//! ```
//! Q(φ): the PSF of the film place (r, φ) in the frame that is turned by φ. D is the band-limited interpolation: exact for harmonics below A/2, so
//! its error falls faster than any power of 1/A once A exceeds twice the harmonics that the errors of a lens have. A is the least of 8,
//! 12, 16, 24, 32, … whose error at eight azimuths half-way between samples is within a fifth of the tolerance, as an L1 norm of film-pixel
//! kernels. It is determined at a few heights; between two of them the larger one holds. At A = J, the number of nodes of a height, every node is
//! a sample. A lens whose kernels are the same at all azimuths has A = 1.

use std::f64::consts::{PI, TAU};

use super::super::error::SkewError;
use super::functions::Functions;
use super::kernels::{View, Views};
use crate::design::tables::kernels::l1;
use crate::real;

/// Heights at which A is determined.
pub(super) const PROBES: usize = 6;
/// Azimuths half-way between samples at which the error is determined.
const BETWEEN: usize = 8;
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
    let (mut needed, mut worst) = (Vec::with_capacity(PROBES), 0.0_f64);
    for height in &probes {
        let mut found = most;
        for count in candidates(most) {
            let error = error(views, functions, (*height, count), report)?;
            if error <= SHARE * tolerance {
                worst = worst.max(error);
                found = count;
                break;
            }
        }
        needed.push(found);
    }
    let of_height = |(h, nodes): (&f64, &usize)| {
        let above = probes.partition_point(|p| p < h).min(PROBES - 1);
        let below = above.saturating_sub(1);
        needed[above].max(needed[below]).min(*nodes)
    };
    Ok((heights.iter().zip(nodes).map(of_height).collect(), worst))
}

/// 8, 12, 16, 24, …, below `most`.
fn candidates(most: usize) -> impl Iterator<Item = usize> {
    (3..).flat_map(|power| [1 << power, 3 << (power - 1)]).take_while(move |count| *count < most)
}

/// Whether the kernels of each of `heights` are the same at eight azimuths, and mirror images of themselves.
fn is_symmetric(
    views: &mut Views<'_>,
    functions: &mut Functions<'_>,
    heights: &[f64],
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<bool, SkewError> {
    let azimuth = |i: usize| TAU * i as f64 / BETWEEN as f64;
    let views_of = |h: f64| (0..BETWEEN).map(move |i| View::own((h, azimuth(i))));
    // The outermost height differs most.
    for h in heights.iter().rev() {
        let all: Vec<View> = views_of(*h).collect();
        report("azimuths", views.fill(functions, &all)?);
        let first = views.at(&all[0]);
        let n = first.len().isqrt();
        let mirrored: Vec<f32> = (0..n * n).map(|i| first[(n - 1 - i / n) * n + i % n]).collect();
        let differs = |view: &View| l1(views.at(view), first) > SAME || l1(views.at(view), &mirrored) > SAME;
        if all.iter().any(differs) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// L1 error of the interpolation between `count` azimuths of the height `height_mm`.
fn error(
    views: &mut Views<'_>,
    functions: &mut Functions<'_>,
    (height_mm, count): (f64, usize),
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<f64, SkewError> {
    let step = TAU / count as f64;
    let sample = |a: usize| TAU * a as f64 / count as f64;
    let between = |i: usize| sample(i * count / BETWEEN) + 0.5 * step;
    let samples: Vec<View> = (0..count).map(|a| View::own((height_mm, sample(a)))).collect();
    let truths: Vec<View> = (0..BETWEEN).map(|i| View::own((height_mm, between(i)))).collect();
    report("azimuths", views.fill(functions, &[&samples[..], &truths].concat())?);
    let error = |i: usize| {
        let truth = views.at(&truths[i]);
        let mut found = vec![0.0_f64; truth.len()];
        for (a, view) in samples.iter().enumerate() {
            let weight = dirichlet(between(i) - sample(a), count);
            found.iter_mut().zip(views.at(view)).for_each(|(to, v)| *to += weight * f64::from(*v));
        }
        let sum: f64 = found.iter().sum();
        found.iter().zip(truth).map(|(f, t)| (f / sum - f64::from(*t)).abs()).sum::<f64>()
    };
    Ok((0..BETWEEN).map(error).fold(0.0, f64::max))
}

/// D(x) of an even number of samples.
pub(super) fn dirichlet(x: f64, count: usize) -> f64 {
    let half = 0.5 * ((x + PI).rem_euclid(TAU) - PI);
    if real::sin(half).abs() < 1e-14 {
        return 1.0;
    }
    real::sin(count as f64 * half) / (count as f64 * real::tan(half))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn candidates_grow_by_a_third_or_a_half() {
        assert_eq!(candidates(100).collect::<Vec<_>>(), [8, 12, 16, 24, 32, 48, 64, 96]);
        assert_eq!(candidates(8).count(), 0);
    }

    #[test]
    fn harmonics_below_half_the_samples_are_exact() {
        for count in [8, 12, 16] {
            for harmonic in 0..count / 2 {
                let f = |x: f64| (harmonic as f64 * x + 0.3).cos();
                for x in [0.1, 1.7, 3.0, 5.9, TAU / count as f64] {
                    let sample = |a: usize| TAU * a as f64 / count as f64;
                    let found: f64 = (0..count).map(|a| dirichlet(x - sample(a), count) * f(sample(a))).sum();
                    assert!((found - f(x)).abs() < 1e-13, "{count} {harmonic} {x}");
                }
            }
        }
    }
}
