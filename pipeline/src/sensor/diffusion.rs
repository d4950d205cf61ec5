//! Diffusion of charge between the pixels of a sensor that is lit from its front: shares of the charge of a pixel's light that other pixels collect.
//!
//! Light of the absorption coefficient α (µm⁻¹) is absorbed over the depth z below the surface as α e^(−αz). Charge of the depleted layer, z < W, stays in its pixel. Charge from below it
//! spreads in field-free silicon of the diffusion length L (µm), without a back, and what reaches the layer is collected. For a light pattern of the frequency f (1/µm):
//!
//! ```text
//! η(f) = 1 − e^(−αW)/(1 + α L(f)),  1/L(f)² = 1/L² + (2πf)²        collected share;  MTF = η(f)/η(0)
//! ```
//!
//! (M. H. Crowell, E. F. Labuda, Bell System Technical Journal 48, 1969; D. H. Seib, IEEE Transactions on Electron Devices 21, 1974.) η(0) belongs to the quantum efficiency of the sensor's
//! table; only the shares are new. Over the time τ = D·t of the diffusion (µm²) the charge spreads as a Gaussian of the variance 2τ along each axis, and with u = α√τ
//!
//! ```text
//! αL(f)/(1 + αL(f)) = ∫ p(τ) e^(−τ(2πf)²) dτ,   p(τ) = α/√(πτ) · (1 − √π u e^(u²) erfc u) · e^(−τ/L²)
//! share(i, j) = e^(−αW) ∫ p(τ) g_i(τ) g_j(τ) dτ / η(0)              of the pixel i rows down and j columns right
//! ```
//!
//! g_i is the share of a uniform line of the aperture's side that a pixel i pitches away holds after τ. Light is uniform over the aperture: the film knows no less. Numbers: the rule of trapezoids over
//! ln τ, exact to 1e-9; what spreads farther than 3 pixels is stated.

use crate::real;
use std::f64::consts::PI;

/// Pixels on each side whose shares are computed, and in a row of them.
pub const RADIUS: usize = 3;
const SIDE: usize = 2 * RADIUS + 1;
/// Step of ln τ.
const STEP: f64 = 0.25;
/// Shortest time, in squares of the pitch; longest, in squares of the diffusion length, after which e⁻⁴⁰ of the charge is left.
const TIMES: (f64, f64) = (1e-20, 40.0);
/// Terms of the continued fraction of erfc.
const TERMS: u32 = 64;

/// Silicon under pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Silicon {
    /// Diffusion length of its minority carriers, µm.
    pub diffusion_length_um: f64,
    /// Depth of the depleted layer, µm.
    pub depletion_um: f64,
}

impl Silicon {
    /// Shares of the charge of one pixel that the pixels from [`RADIUS`] above to as many below collect, row by row, at an absorption coefficient (1/µm); and the share that spreads farther.
    pub fn shares(&self, absorption_per_um: f64, pitch_um: f64, aperture_um: f64) -> (Vec<f64>, f64) {
        let (alpha, length) = (absorption_per_um, self.diffusion_length_um);
        let below = real::exp(-alpha * self.depletion_um);
        let collected = 1.0 - below / (1.0 + alpha * length);
        let first = real::log(TIMES.0 * pitch_um * pitch_um);
        let last = real::log(TIMES.1 * length * length);
        let steps = ((last - first) / STEP).ceil().max(1.0) as usize;
        let mut quadrant = [[0.0; RADIUS + 1]; RADIUS + 1];
        for k in 0..=steps {
            let tau = real::exp(first + STEP * k as f64);
            let weight = STEP * tau * density(alpha, length, tau);
            let g: [f64; RADIUS + 1] = std::array::from_fn(|i| line_share(i, tau, pitch_um, aperture_um));
            for (row, gi) in quadrant.iter_mut().zip(g) {
                row.iter_mut().zip(g).for_each(|(share, gj)| *share += weight * gi * gj);
            }
        }
        let at = |i: usize, j: usize| below / collected * quadrant[i.abs_diff(RADIUS)][j.abs_diff(RADIUS)];
        let mut shares: Vec<f64> = (0..SIDE * SIDE).map(|k| at(k / SIDE, k % SIDE)).collect();
        shares[SIDE * SIDE / 2] += (1.0 - below) / collected;
        let farther = 1.0 - shares.iter().sum::<f64>();
        (shares, farther)
    }
}

/// p(τ).
fn density(alpha: f64, length: f64, tau: f64) -> f64 {
    let root = tau.sqrt();
    alpha / (PI.sqrt() * root) * beside_erfc(alpha * root) * real::exp(-tau / (length * length))
}

/// 1 − √π u e^(u²) erfc u.
fn beside_erfc(u: f64) -> f64 {
    if u < 2.0 {
        return 1.0 - PI.sqrt() * u * real::exp(u * u) * real::erfc(u);
    }
    // √π u e^(u²) erfc u = 1/(1 + v/(1 + 2v/(1 + 3v/…))) with v = 1/(2u²): without a difference of nearly equal numbers.
    let v = 0.5 / (u * u);
    let tail = (2..=TERMS).rev().fold(0.0, |tail, k| f64::from(k) * v / (1.0 + tail));
    let tail = v / (1.0 + tail);
    tail / (1.0 + tail)
}

/// Share of a uniform line of the length `aperture` that lies `i` pitches away on a pixel's length after τ.
fn line_share(i: usize, tau: f64, pitch: f64, aperture: f64) -> f64 {
    let sigma = (2.0 * tau).sqrt();
    // The second integral of the Gaussian, less that of a point: only what has spread.
    let spread = |x: f64| {
        let z = x.abs() / sigma;
        let density = real::exp(-0.5 * z * z) / (2.0 * PI).sqrt();
        sigma * (density - 0.5 * z * real::erfc(z / std::f64::consts::SQRT_2))
    };
    let (middle, half, edge) = (i as f64 * pitch, 0.5 * aperture, 0.5 * pitch);
    let out = (spread(middle + edge + half) - spread(middle + edge - half))
        - (spread(middle - edge + half) - spread(middle - edge - half));
    f64::from(u8::from(i == 0)) + out / aperture
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The transfer function that the module's head states, from shares of pixels that are small beside the spread: Σ share·cos(2πfi).
    #[test]
    fn density_of_times_has_the_stated_transfer_function() {
        for (alpha, length) in [(0.6, 10.0), (0.05, 40.0), (4.0, 3.0)] {
            for f in [0.0, 0.01, 0.1, 1.0] {
                let k = 2.0 * PI * f;
                let l = 1.0 / (1.0 / (length * length) + k * k).sqrt();
                let at = |n: i32| {
                    let tau = real::exp(0.1 * f64::from(n));
                    0.1 * tau * density(alpha, length, tau) * real::exp(-tau * k * k)
                };
                let sum: f64 = (-500..=120).map(at).sum();
                let expected = alpha * l / (1.0 + alpha * l);
                assert!((sum - expected).abs() < 1e-9, "{alpha} {length} {f}: {sum} {expected}");
            }
        }
    }

    #[test]
    fn shares_add_up_and_grow_with_depth_and_length() {
        let silicon = Silicon { diffusion_length_um: 5.0, depletion_um: 1.0 };
        let (shares, farther) = silicon.shares(0.5, 3.0, 3.0);
        assert!((shares.iter().sum::<f64>() + farther - 1.0).abs() < 1e-12 && farther > 0.0);
        let own = |silicon: Silicon, alpha: f64| silicon.shares(alpha, 3.0, 3.0).0[SIDE * SIDE / 2];
        assert!(own(silicon, 0.1) < own(silicon, 0.5));
        assert!(own(Silicon { diffusion_length_um: 20.0, ..silicon }, 0.5) < own(silicon, 0.5));
        assert!(own(Silicon { depletion_um: 4.0, ..silicon }, 0.5) > own(silicon, 0.5));
        // All light absorbed in the depleted layer.
        assert!((own(Silicon { depletion_um: 100.0, ..silicon }, 0.5) - 1.0).abs() < 1e-12);
        for (k, share) in shares.iter().enumerate() {
            let transposed = shares[k % SIDE * SIDE + k / SIDE];
            assert!(
                *share > 0.0
                    && (share - transposed).abs() < 1e-15
                    && (share - shares[SIDE * SIDE - 1 - k]).abs() < 1e-15
            );
        }
    }

    #[test]
    fn branches_of_erfc_meet() {
        let (below, above) = (beside_erfc(2.0 - 1e-12), beside_erfc(2.0));
        assert!((below - above).abs() < 1e-10, "{below} {above}");
    }
}
