//! The PSF of one field point of a design, in a window chosen by its light.
//!
//! Samples are at 0.9 of the Nyquist pitch; the window is the smallest square for 99.8 % of the light, estimated from rays and diffraction at the edge
//! of the pupil ([`crate::design::bundle`]), of 129 to 1025 samples a side. [`crate::figures`] has its MTF and encircled energy.

use super::{PsfGrid, PsfScratch, PupilFunction};
use crate::design::prescription::error::DesignError;
use crate::design::pupil::bundle::Bundle;
use crate::design::rays::ray::Tracer;
use crate::figures::PsfWindow;
use crate::lens::PsfSample;

/// Share of the light in the window.
const ENERGY: f64 = 0.998;
/// Minimum and maximum of half a side, samples.
const HALF: (usize, usize) = (64, 512);
/// Pitch over the Nyquist pitch.
const PITCH: f64 = 0.9;
/// Rings and spokes of rays of the estimate.
const RAYS: (usize, usize) = (12, 16);

/// The PSF of the field point at tan(field angle) `tan` about its chief ray.
///
/// # Errors
/// [`DesignError::Ray`] if a ray within the apertures does not reach the film.
pub fn field_psf(tracer: &Tracer<'_>, tan: f64) -> Result<PsfWindow, DesignError> {
    let function = PupilFunction::trace(tracer, tan)?;
    let pitch_um = PITCH * function.nyquist_um();
    let bundle = Bundle::trace(tracer, tan, RAYS.0, RAYS.1)?;
    let size = bundle.window_px(ENERGY, pitch_um, 2 * HALF.1 + 1).unwrap_or(2 * HALF.1 + 1);
    Ok(psf_window(&function, &PsfGrid::new((size / 2).max(HALF.0), pitch_um)))
}

/// The PSF of `function` on `grid`.
pub fn psf_window(function: &PupilFunction, grid: &PsfGrid) -> PsfWindow {
    let samples = grid.psf(function, 0.0, &mut PsfScratch::default());
    let energy: f64 = samples.iter().sum();
    PsfWindow {
        size: grid.size(),
        pitch_um: grid.pitch_um(),
        sample: PsfSample::Point,
        energy,
        samples: samples.iter().map(|v| (v / energy) as f32).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::figures::tests::parabolic_mirror;
    use crate::figures::{Direction, polychromatic_mtf};
    use std::f64::consts::PI;

    const UM: f64 = 0.5;
    /// Sine of the marginal ray's angle at the focus of a parabola of focal length 100 mm with a pupil of 12.5 mm: h/(f + h²/4f).
    const NA: f64 = 6.25 / (100.0 + 6.25 * 6.25 / 400.0);

    fn airy() -> PsfWindow {
        let system = parabolic_mirror(100.0, 12.5);
        field_psf(&Tracer::new(&system, UM).unwrap(), 0.0).unwrap()
    }

    /// (2/π) (arccos ν − ν √(1 − ν²)), ν = λ f / 2 NA.
    #[test]
    fn perfect_lens_has_the_mtf_of_a_round_pupil() {
        let psf = airy();
        for lp_mm in [10.0, 25.0, 50.0, 100.0, 150.0, 200.0, 240.0] {
            let nu: f64 = lp_mm * UM * 1e-3 / (2.0 * NA);
            let expected = 2.0 / PI * (nu.acos() - nu * (1.0 - nu * nu).sqrt());
            for direction in [Direction::Tangential, Direction::Sagittal] {
                let found = psf.mtf(lp_mm, direction);
                assert!((found - expected).abs() < 5e-4, "{lp_mm}: {found} {expected}");
            }
        }
        assert!(psf.mtf(2000.0 * NA / UM * 1.02, Direction::Tangential) < 1e-4, "beyond the limit");
    }

    /// 1 − J0²(v) − J1²(v), v = 2π NA r / λ (Rayleigh).
    #[test]
    fn perfect_lens_has_the_encircled_energy_of_an_airy_disc() {
        // 83.8 %, 91.0 % and 93.8 % within the first three dark rings (Born & Wolf, 8.5.2).
        let bessel = |order: i32, v: f64| -> f64 {
            (0..2000)
                .map(|i| PI * (f64::from(i) + 0.5) / 2000.0)
                .map(|t| (f64::from(order) * t - v * t.sin()).cos())
                .sum::<f64>()
                / 2000.0
        };
        let radii: Vec<f64> = [0.5, 1.0, 2.0, 3.0, 3.8317, 5.0, 7.0156, 10.1735, 20.0, 40.0]
            .iter()
            .map(|v| v * UM / (2.0 * PI * NA))
            .collect();
        let curve = airy().encircled();
        for r in &radii {
            let v = 2.0 * PI * NA * r / UM;
            let expected = 1.0 - bessel(0, v).powi(2) - bessel(1, v).powi(2);
            let found = curve.within(*r).unwrap();
            assert!((found - expected).abs() < 1e-3, "{v}: {found} {expected}");
        }
        assert_eq!(curve.within(1e6), None);
        for share in [0.3, 0.6, 0.9, 0.95] {
            let back = curve.within(curve.radius_um(share).unwrap()).unwrap();
            assert!((back - share).abs() < 1e-9, "{share}: {back}");
        }
        assert_eq!(curve.radius_um(0.9999), None);
    }

    #[test]
    fn polychromatic_mtf_is_the_mean_of_shifted_transfer_functions() {
        let psf = airy();
        let mono = psf.mtf(50.0, Direction::Tangential);
        let same = polychromatic_mtf(&[(1.0, 0.0, &psf), (3.0, 0.0, &psf)], 50.0, Direction::Tangential);
        assert!((same - mono).abs() < 1e-12);
        // Two equal PSFs d apart: |cos π f d| of one.
        let apart = [(1.0, -2.0, &psf), (1.0, 2.0, &psf)];
        let expected = mono * (PI * 0.05 * 4.0).cos();
        assert!((polychromatic_mtf(&apart, 50.0, Direction::Tangential) - expected).abs() < 1e-9);
        let across = psf.mtf(50.0, Direction::Sagittal);
        assert!((polychromatic_mtf(&apart, 50.0, Direction::Sagittal) - across).abs() < 1e-12);
    }
}
