//! Inks: reflectance spectra under one light, as radiance per band.

use super::picture::Ink;
use crate::colour::{Illuminant, checker_reflectance};
use crate::real;

/// Unit of chart values: spectral radiance.
pub const UNITS: &str = "W m-2 sr-1 nm-1";

/// Illuminance of every chart, lux: typical of test-chart lighting.
const ILLUMINANCE_LX: f64 = 1000.0;

/// The reflectance spectra of a chart and its illuminant.
pub(super) struct Inks {
    wavelengths_nm: Vec<f64>,
    /// Radiance of a perfect reflecting diffuser, per band.
    white: Vec<f64>,
    bands: Vec<Vec<f32>>,
    count: usize,
}

impl Inks {
    pub(super) fn new(light: Illuminant, wavelengths_nm: Vec<f64>) -> Self {
        let scale = light.irradiance_scale(ILLUMINANCE_LX) / std::f64::consts::PI;
        let white = wavelengths_nm.iter().map(|&nm| scale * light.relative_power(nm)).collect();
        let bands = vec![Vec::new(); wavelengths_nm.len()];
        Self { wavelengths_nm, white, bands, count: 0 }
    }

    /// The same radiance in every band, independent of the illuminant.
    pub(super) fn radiance(&mut self, value: f64) -> Ink {
        self.push(|_, _| value)
    }

    /// A neutral grey.
    pub(super) fn grey(&mut self, reflectance: f64) -> Ink {
        self.push(|_, white| reflectance * white)
    }

    /// A ColorChecker patch.
    pub(super) fn checker(&mut self, patch: usize) -> Ink {
        self.push(|nm, white| checker_reflectance(patch, nm) * white)
    }

    /// A narrow-band colour: a Gaussian about `centre_nm` on black.
    pub(super) fn narrow(&mut self, centre_nm: f64, fwhm_nm: f64) -> Ink {
        // FWHM = 2√(2 ln 2)·σ, so exp(−4 ln 2·(Δ/FWHM)²).
        let at =
            move |nm: f64| real::exp(-4.0 * std::f64::consts::LN_2 * ((nm - centre_nm) / fwhm_nm).powi(2));
        self.push(|nm, white| (0.02 + 0.9 * at(nm)) * white)
    }

    fn push(&mut self, radiance: impl Fn(f64, f64) -> f64) -> Ink {
        for ((band, &nm), &white) in self.bands.iter_mut().zip(&self.wavelengths_nm).zip(&self.white) {
            band.push(radiance(nm, white) as f32);
        }
        self.count += 1;
        self.count - 1
    }

    /// Radiance of every ink, per band.
    pub(super) fn into_bands(self) -> Vec<Vec<f32>> {
        self.bands
    }
}
