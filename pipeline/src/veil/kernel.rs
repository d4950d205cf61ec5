//! The scatter kernel on the bins of a layer; its equation is at the head of [`super`].

use crate::design::quadrature::unit_interval;
use crate::real;
use std::f64::consts::{FRAC_PI_4, PI};

/// Bins around the centre whose integrals are sums over Gauss points.
const NEAR_BINS: usize = 4;
/// Gauss points of a side.
const POINTS: usize = 16;
/// Slopes closer to 2 than this have the limit of the equations there.
const LIMIT: f64 = 1e-12;

/// Shape of scattered light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScatterKernel {
    /// Shoulder r₀, mm on the film.
    pub shoulder_mm: f64,
    /// Slope s.
    pub slope: f64,
    /// Largest distance r_max, mm on the film.
    pub reach_mm: f64,
}

impl ScatterKernel {
    /// ∫ (1 + (r/r₀)²)^(−s/2) over the disc of radius `r_mm`, mm².
    fn mass(&self, r_mm: f64) -> f64 {
        let log = real::log1p((r_mm / self.shoulder_mm) * (r_mm / self.shoulder_mm));
        let power = 1.0 - self.slope / 2.0;
        let value = if power.abs() < LIMIT { log } else { real::expm1(power * log) / power };
        PI * self.shoulder_mm * self.shoulder_mm * value
    }

    /// Share of the light within `r_mm` of its place.
    pub fn share_within(&self, r_mm: f64) -> f64 {
        self.mass(r_mm.min(self.reach_mm)) / self.mass(self.reach_mm)
    }

    /// Scattered light per mm² at the distance (`x_mm`, `y_mm`), times the mass of the kernel.
    fn value(&self, x_mm: f64, y_mm: f64) -> f64 {
        let r2 = x_mm * x_mm + y_mm * y_mm;
        if r2 > self.reach_mm * self.reach_mm {
            return 0.0;
        }
        real::exp(-self.slope / 2.0 * real::log1p(r2 / (self.shoulder_mm * self.shoulder_mm)))
    }

    /// Bins of `bin_mm` from the centre to the last that has light.
    pub fn reach_bins(&self, bin_mm: f64) -> usize {
        (self.reach_mm / bin_mm).ceil() as usize
    }

    /// The kernel's integrals over the bins (i, j) from (0, 0) to the reach, row by row, scaled so that all bins, of negative i and j too, sum to 1.
    ///
    /// Central bin: mean over the azimuth of the closed form at the bin's rim. Those within 4 bins: Gauss points. Others: the value at the
    /// centre times the area.
    pub fn quadrant(&self, bin_mm: f64) -> Vec<f64> {
        let side = self.reach_bins(bin_mm) + 1;
        let rule = unit_interval(POINTS);
        let area = bin_mm * bin_mm;
        let near = |i: usize, j: usize| {
            let at = |k: usize, place: f64| (k as f64 + place - 0.5) * bin_mm;
            let row = |(y, wy): &(f64, f64)| {
                let line = rule.iter().map(|(x, wx)| wx * self.value(at(j, *x), at(i, *y)));
                wy * line.sum::<f64>()
            };
            rule.iter().map(row).sum::<f64>() * area
        };
        let mut bins = Vec::with_capacity(side * side);
        for (i, j) in (0..side).flat_map(|i| (0..side).map(move |j| (i, j))) {
            bins.push(match i.max(j) {
                0 => {
                    // Of the square, over an eighth of the turn.
                    let rim = |turn: f64| bin_mm / 2.0 / real::cos(FRAC_PI_4 * turn);
                    rule.iter().map(|(turn, weight)| weight * self.mass(rim(*turn))).sum()
                }
                1..=NEAR_BINS => near(i, j),
                _ => self.value(j as f64 * bin_mm, i as f64 * bin_mm) * area,
            });
        }
        let copies = |k: usize| if k == 0 { 1.0 } else { 2.0 };
        let all = bins.iter().enumerate().map(|(k, value)| copies(k / side) * copies(k % side) * value);
        let sum: f64 = all.sum();
        bins.iter_mut().for_each(|value| *value /= sum);
        bins
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kernel(slope: f64) -> ScatterKernel {
        ScatterKernel { shoulder_mm: 0.05, slope, reach_mm: 20.0 }
    }

    /// The mass against the trapezoidal rule on 200,000 distances.
    #[test]
    fn mass_is_the_integral_over_the_disc() {
        for slope in [1.5, 2.0, 2.5, 3.0] {
            let (kernel, n) = (kernel(slope), 200_000);
            let r = |k: usize| 1e-5 * real::pow(20.0 / 1e-5, k as f64 / n as f64);
            let f = |r: f64| 2.0 * PI * r * kernel.value(r, 0.0);
            let step = |k: usize| (r(k + 1).min(20.0) - r(k)) * (f(r(k)) + f(r(k + 1).min(20.0))) / 2.0;
            let sum: f64 = (0..n).map(step).sum();
            assert!((sum / kernel.mass(20.0) - 1.0).abs() < 1e-6, "{slope}: {}", sum / kernel.mass(20.0));
        }
        let (at, near) = (kernel(2.0).mass(20.0), kernel(2.0 + 1e-9).mass(20.0));
        assert!((near / at - 1.0).abs() < 1e-6);
    }

    #[test]
    fn all_bins_sum_to_one_and_none_is_negative() {
        let kernel = ScatterKernel { shoulder_mm: 0.02, slope: 2.5, reach_mm: 0.64 };
        let (bins, side) = (kernel.quadrant(0.032), 21);
        let copies = |k: usize| if k == 0 { 1.0 } else { 2.0 };
        let sum: f64 = bins.iter().enumerate().map(|(k, v)| copies(k / side) * copies(k % side) * v).sum();
        assert!((sum - 1.0).abs() < 1e-14 && bins.iter().all(|v| *v >= 0.0) && bins.len() == side * side);
        // Symmetric, and 0 beyond the reach.
        assert!((bins[side + 2] - bins[2 * side + 1]).abs() < 1e-17 && bins[side * side - 1] == 0.0);
    }

    /// Values of the NumPy reference, `cell_kernel(20, 0.032, 0.02, 2.5, 0.64)` of light_reference.py: the bins (0, 0), (0, 1), (1, 1), (4, 4), (0, 5),
    /// (12, 7).
    #[test]
    fn bins_equal_the_reference() {
        let kernel = ScatterKernel { shoulder_mm: 0.02, slope: 2.5, reach_mm: 0.64 };
        let bins = kernel.quadrant(0.032);
        for ((i, j), expected) in REFERENCE {
            let found = bins[i * 21 + j];
            assert!((found / expected - 1.0).abs() < 1e-12, "({i}, {j}): {found} {expected}");
        }
    }

    const REFERENCE: [((usize, usize), f64); 6] = [
        ((0, 0), 0.1668270503131078),
        ((0, 1), 0.05443878123798839),
        ((1, 1), 0.027973433793229863),
        ((4, 4), 0.0009976820905378179),
        ((0, 5), 0.0013419002955332745),
        ((12, 7), 0.00010605171999763522),
    ];
}
