//! Light that the roughness of polished surfaces scatters: total integrated scatter (TIS).
//!
//! ```text
//! a = 1 − Π (1 − TIS_k)      TIS = 1 − exp(−(2π Δ σ/λ)²)
//! ```
//! over the surfaces of a design: σ the RMS roughness within the band of spatial frequencies that scatters out of the image, λ the wavelength in air, Δ the
//! step of the optical path per height of a surface: n₂ − n₁ where it refracts, 2 n₁ at a mirror. Normal incidence.
//!
//! Left out: the angle of incidence (its cosine multiplies Δ), what coatings change, subsurface damage and dust, and that light scattered at one surface is
//! blocked before the film. Ideal thin lenses do not scatter.
//! Source: J. E. Harvey, Understanding Surface Scatter (SPIE 2019), chapter 2; H. E. Bennett and J. O. Porteus, J. Opt. Soc. Am. 51 (1961) 123.

use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::real;
use std::f64::consts::PI;

/// The share of the light at `nm` that surfaces of the RMS roughness `rms_nm` scatter.
///
/// ```
/// use lenscube_pipeline::design::System;
/// use lenscube_pipeline::design::roughness::scattered_share;
///
/// let lens = System::double_gauss_28();
/// // Ten surfaces with air.
/// let share = scattered_share(&lens, 1.0, 550.0).unwrap();
/// assert!((3e-4..7e-4).contains(&share), "{share}");
/// // Of shorter waves more.
/// assert!(scattered_share(&lens, 1.0, 400.0).unwrap() > share);
/// ```
///
/// # Errors
/// A wavelength outside the range of a glass.
pub fn scattered_share(system: &System, rms_nm: f64, nm: f64) -> Result<f64, DesignError> {
    let (mut before, mut remaining) = (1.0, 1.0);
    for surface in system.surfaces.iter().take(system.image()) {
        let behind = surface.medium.index(nm / 1e3)?;
        if surface.ideal_focal_mm.is_none() {
            remaining *= 1.0 - total_integrated_scatter(rms_nm, nm, (before, behind), surface.is_mirror);
        }
        before = behind;
    }
    Ok(1.0 - remaining)
}

/// Share of the light that a polished surface of roughness `rms_nm` (root mean square) scatters at `nm`, from index `before` to `behind`.
pub fn total_integrated_scatter(rms_nm: f64, nm: f64, (before, behind): (f64, f64), is_mirror: bool) -> f64 {
    let step = if is_mirror { 2.0 * before } else { behind - before };
    let phase = 2.0 * PI * step * rms_nm / nm;
    -real::expm1(-phase * phase)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::prescription::glass::{Dispersion, Glass};
    use crate::design::prescription::system::{Medium, Surface};

    /// Surfaces of a design with a film behind them.
    fn system(surfaces: Vec<Surface>) -> System {
        let mut system = System::double_gauss_28();
        let film = system.surfaces.pop().expect("an image plane");
        system.surfaces = surfaces;
        system.surfaces.push(film);
        system
    }

    /// 1 − exp(−(2π · 0.5 · 1/500)²) per surface of index 1.5, of mirrors 16 times that exponent.
    #[test]
    fn share_of_plates_and_mirrors_has_its_closed_form() {
        let glass = Medium::Glass(Glass::new("glass".into(), Dispersion::constant(1.5), (0.3, 1.0)));
        let plate = || vec![Surface::new(0.0, 1.0, glass.clone()), Surface::new(0.0, 1.0, Medium::Air)];
        let exponent = (PI / 500.0).powi(2);
        let near =
            |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 1e-10, "{found} {expected}");
        near(scattered_share(&system(plate()), 1.0, 500.0).unwrap(), -(-2.0 * exponent).exp_m1());
        let ten = (0..10).flat_map(|_| plate()).collect();
        let share = scattered_share(&system(ten), 1.0, 550.0).unwrap();
        near(share, 1.0 - (-(PI / 550.0).powi(2)).exp().powi(20));
        let mut mirror = Surface::new(0.0, 1.0, Medium::Air);
        mirror.is_mirror = true;
        near(scattered_share(&system(vec![mirror]), 2.0, 500.0).unwrap(), -(-64.0 * exponent).exp_m1());
        let mut ideal = Surface::new(0.0, 1.0, Medium::Air);
        ideal.ideal_focal_mm = Some(50.0);
        assert_eq!(scattered_share(&system(vec![ideal]), 1.0, 500.0), Ok(0.0));
    }
}
