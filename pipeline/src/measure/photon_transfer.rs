//! Gain of a camera from the noise of its grey patches (photon transfer).
//!
//! ```text
//! σ² = σ₀² + K·v + p·v²
//! ```
//! v mean value above black, DN; K gain, DN per electron, since the variance of n electrons of light is n; σ₀ noise in the dark; p the fixed pattern of
//! gains (and texture of the chart), which one picture does not tell from noise. Least squares of relative residuals, since the error of a variance is in proportion to it;
//! σ₀² and p that come out below 0 are left out. Source: EMVA 1288 release 4.0, sections 2 and 6 (there from differences of two pictures, p then is none).
//! Companding, denoising and compression with loss change the noise, and K with it.

use super::tones::Patch;
use crate::least_squares::Qr;

/// Patches, at least.
const MIN_PATCHES: usize = 5;
/// Ratio of the lightest to the darkest mean, at least.
const MIN_RATIO: f64 = 8.0;

/// Figures of a camera that follow from the noise of patches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotonTransfer {
    /// K, DN per electron.
    pub gain_dn_per_e: f64,
    /// σ₀, DN; 0 if it is too small to be seen.
    pub dark_noise_dn: f64,
    /// √p; 0 if it is too small to be seen.
    pub fixed_pattern: f64,
    /// Root mean square of the relative residuals of σ².
    pub residual: f64,
}

/// The photon transfer of patches whose share of clipped pixels is at most `max_clipped`; `None` if they are too few or too much alike, or noise does not
/// grow with light.
pub fn photon_transfer(patches: &[Patch], max_clipped: f64) -> Option<PhotonTransfer> {
    let own: Vec<(f64, f64)> = patches
        .iter()
        .filter(|p| p.clipped <= max_clipped && p.mean > 0.0 && p.sigma > 0.0)
        .map(|p| (p.mean, p.sigma * p.sigma))
        .collect();
    let least = own.iter().map(|p| p.0).fold(f64::INFINITY, f64::min);
    let most = own.iter().map(|p| p.0).fold(0.0, f64::max);
    if own.len() < MIN_PATCHES || most < MIN_RATIO * least {
        return None;
    }
    // Powers of v, without those whose coefficients come out below 0.
    let mut powers = vec![1, 0, 2];
    loop {
        let column = |power: &i32| own.iter().map(|(v, var)| v.powi(*power) / var).collect::<Vec<f64>>();
        let found = Qr::new(powers.iter().map(column).collect())?.solve(&vec![1.0; own.len()]);
        if let Some(k) = (1..powers.len()).find(|k| found[*k] < 0.0) {
            powers.remove(k);
            continue;
        }
        let of = |power: i32| powers.iter().position(|p| *p == power).map_or(0.0, |k| found[k]);
        let error = |(v, var): &(f64, f64)| ((of(0) + of(1) * v + of(2) * v * v) / var - 1.0).powi(2);
        let residual = (own.iter().map(error).sum::<f64>() / own.len() as f64).sqrt();
        return (of(1) > 0.0).then(|| PhotonTransfer {
            gain_dn_per_e: of(1),
            dark_noise_dn: of(0).sqrt(),
            fixed_pattern: of(2).sqrt(),
            residual,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patches(dark: f64, gain: f64, pattern: f64) -> Vec<Patch> {
        let of = |k: i32| {
            let mean = 20.0 * 1.7f64.powi(k);
            let sigma = (dark * dark + gain * mean + (pattern * mean).powi(2)).sqrt();
            Patch { reflectance: 0.01 * mean, mean, sigma, clipped: 0.0 }
        };
        (0..10).map(of).collect()
    }

    #[test]
    fn terms_of_noise_are_told_apart() {
        for (dark, gain, pattern) in [(3.0, 0.25, 0.01), (0.0, 2.0, 0.0), (5.0, 0.1, 0.0)] {
            let found = photon_transfer(&patches(dark, gain, pattern), 1e-3).unwrap();
            assert!((found.gain_dn_per_e / gain - 1.0).abs() < 1e-6, "{found:?}");
            assert!((found.dark_noise_dn - dark).abs() < 1e-2, "{found:?}");
            assert!((found.fixed_pattern - pattern).abs() < 1e-3, "{found:?}");
            assert!(found.residual < 1e-6);
        }
    }

    #[test]
    fn few_or_equal_patches_and_noise_that_does_not_grow_have_no_gain() {
        let all = patches(3.0, 0.25, 0.0);
        assert_eq!(photon_transfer(&all[..4], 1e-3), None);
        assert_eq!(photon_transfer(&[all[3]; 9], 1e-3), None);
        let clipped: Vec<Patch> = all.iter().map(|p| Patch { clipped: 0.5, ..*p }).collect();
        assert_eq!(photon_transfer(&clipped, 1e-3), None);
        let falling: Vec<Patch> = all.iter().map(|p| Patch { sigma: 1.0 / p.mean, ..*p }).collect();
        assert_eq!(photon_transfer(&falling, 1e-3), None);
    }
}
