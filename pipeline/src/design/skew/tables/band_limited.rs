//! Azimuths in equal steps, and the band-limited interpolation between them.
//!
//! ```text
//! f(φ) = Σ_a D(φ − 2πa/A) f(2πa/A),      D(x) = sin(Ax/2) / (A tan(x/2)),  A even
//! ```
//! Exact for harmonics below A/2; Σ_a D = 1.

use std::f64::consts::{PI, TAU};

use crate::real;

/// Azimuth `i` of `count`, rad: the same bits for the same azimuth of other counts.
pub(super) fn azimuth_of(i: usize, count: usize) -> f64 {
    let (mut a, mut b) = (i, count);
    while b > 0 {
        (a, b) = (b, a % b);
    }
    TAU * (i / a) as f64 / (count / a) as f64
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
    fn an_azimuth_has_the_same_bits_in_all_counts() {
        for count in [8, 10, 16, 24, 96] {
            for i in 0..count {
                assert_eq!(azimuth_of(i, count).to_bits(), azimuth_of(3 * i, 3 * count).to_bits());
                assert!((azimuth_of(i, count) - TAU * i as f64 / count as f64).abs() < 4e-15);
            }
        }
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
