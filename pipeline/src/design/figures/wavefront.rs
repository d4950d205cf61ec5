//! Wavefront error of a field point on a square grid of the pupil, as lens design programs print it.
//!
//! ```text
//! W = ([chief ray] − [ray]) / λ       [·] optical path from the object to the reference sphere
//! centre: the chief ray's intersection with the film      radius: R = −z / cos θ'
//! rms² = mean (W − mean W)²           Strehl ratio of the variance = exp(−(2π rms)²)
//! grid: x, y = (i − n/2) / (n/2 − 1),  i = 0 … n − 1, where x² + y² ≤ 1 and the ray reaches the film
//! ```
//! z is the position of the paraxial exit pupil of the primary wavelength from the film, θ' the angle of the real chief ray in image space: the
//! sphere meets the chief ray in the plane of the pupil. W is positive where the wavefront is ahead of the sphere (Welford's sign). Each ray
//! has the same weight. Wavelengths have their own chief ray. The path from the film back to the sphere, of a ray at q from its centre with
//! the direction e, is computed without the difference of two radii, so that a pupil at infinity (R = ∞) gives plane waves:
//! ```text
//! s + R = −b + (q² − b²) / (R ± √(R² + b² − q²)),   b = q·e
//! ```
//! Grid, sphere and sign are those of OpticStudio: its printed figures of a biconvex lens, on the axis and at 22 degrees, are met to all digits.
//! Source: Welford, chapter 7; Mahajan, J. Opt. Soc. Am. 73, 860 (1983) (Strehl ratio).

use crate::design::prescription::error::DesignError;
use crate::design::rays::aim::LastAim;
use crate::design::rays::ray::{ImageRay, Tracer};
use crate::real;
use std::f64::consts::TAU;

/// Minimum and maximum of the side of the grid.
pub const SAMPLES: (usize, usize) = (8, 1024);
/// Rays that may be aimed for each point of the grid; real lenses need 3 to 8.
const RAYS_PER_POINT: u32 = 60;

/// The reference sphere of a field point.
#[derive(Clone, Copy, Debug)]
pub struct ReferenceSphere {
    chief: ImageRay,
    /// Radius, mm: positive for an exit pupil before the film, infinite for a telecentric image space.
    pub radius_mm: f64,
    wavelength_um: f64,
}

impl ReferenceSphere {
    /// That of the field point at tan(field angle) `tan`.
    ///
    /// # Errors
    /// The chief ray does not reach the film.
    pub fn new(tracer: &Tracer<'_>, tan: f64) -> Result<Self, DesignError> {
        let chief = tracer.ray(tan, 0.0, 0.0)?;
        let cos = chief.n / chief.index();
        let radius_mm = -tracer.primary.exit_pupil_mm / cos;
        Ok(Self { chief, radius_mm, wavelength_um: tracer.wavelength_um })
    }

    /// W of `ray`, in wavelengths.
    pub fn waves(&self, ray: &ImageRay) -> f64 {
        1e3 * (self.path(&self.chief) - self.path(ray)) / self.wavelength_um
    }

    /// Optical path to the sphere, plus index times radius.
    fn path(&self, ray: &ImageRay) -> f64 {
        let index = ray.index();
        let (x, y, r) = (ray.x.v - self.chief.x.v, ray.y.v - self.chief.y.v, self.radius_mm);
        let along = (x * ray.l.v + y * ray.m.v) / index;
        let across = x * x + y * y - along * along;
        let bent = across / (r + r.signum() * (r * r - across).sqrt());
        ray.path.v + index * (bent - along)
    }
}

/// A sample of the wavefront.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WavefrontSample {
    /// Pupil coordinate along x of the film.
    pub x: f64,
    /// Pupil coordinate along y of the film.
    pub y: f64,
    /// W, wavelengths.
    pub waves: f64,
}

/// The wavefront of a field point at one wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct Wavefront {
    /// Radius of the reference sphere, mm.
    pub radius_mm: f64,
    /// The samples that reach the film, row by row.
    pub samples: Vec<WavefrontSample>,
}

impl Wavefront {
    /// Traces `side`² rays of the field point at tan(field angle) `tan`, whose meridian is at `azimuth_rad` from the x axis of the grid.
    ///
    /// # Errors
    /// [`DesignError::Option`] if `side` is odd or not within [`SAMPLES`]; the chief ray does not reach the film; [`DesignError::Search`].
    pub fn trace(tracer: &Tracer<'_>, tan: f64, side: usize, azimuth_rad: f64) -> Result<Self, DesignError> {
        if side % 2 == 1 || !(SAMPLES.0..=SAMPLES.1).contains(&side) {
            return Err(DesignError::Option {
                option: "wavefront samples",
                value: side.to_string(),
                expected: "an even number from 8 to 1024",
            });
        }
        let (sin, cos) = real::sin_cos(azimuth_rad);
        let sphere = ReferenceSphere::new(tracer, tan)?;
        let at = |i: usize| (i as f64 - side as f64 / 2.0) / (side as f64 / 2.0 - 1.0);
        let samples = tracer.within_budget(tan, RAYS_PER_POINT * (side * side) as u32, |tracer| {
            let (mut samples, last) = (Vec::with_capacity(side * side), LastAim::default());
            for (x, y) in (0..side * side).map(|i| (at(i % side), at(i / side))) {
                // Points on the circle are in it, whatever the rounding.
                if x * x + y * y > 1.0 + 1e-12 {
                    continue;
                }
                let (p, q) = (x * cos + y * sin, y * cos - x * sin);
                let Ok((ray, clip)) = tracer.ray_from(&last, tan, p, q) else { continue };
                if clip.passes() {
                    samples.push(WavefrontSample { x, y, waves: sphere.waves(&ray) });
                }
            }
            Ok(samples)
        })?;
        if samples.is_empty() {
            return Err(tracer.ray_error(tan, 0.0, 0.0, "and all others are blocked".to_owned()));
        }
        Ok(Self { radius_mm: sphere.radius_mm, samples })
    }

    /// RMS about the mean, wavelengths.
    pub fn rms_waves(&self) -> f64 {
        self.rms(|_| 0.0)
    }

    /// RMS about the plane of least squares: that of a reference sphere at the centroid of the light. None for fewer than three samples, or if all
    /// are on a line.
    pub fn rms_without_tilt_waves(&self) -> Option<f64> {
        let [_, x, y] = super::zernike::fit(&self.samples, super::zernike::noll, 3)?[..] else { return None };
        Some(self.rms(|s| 2.0 * (x * s.x + y * s.y)))
    }

    fn rms(&self, tilt: impl Fn(&WavefrontSample) -> f64) -> f64 {
        let count = self.samples.len() as f64;
        let values = || self.samples.iter().map(|s| s.waves - tilt(s));
        let mean = values().sum::<f64>() / count;
        (values().map(|w| (w - mean) * (w - mean)).sum::<f64>() / count).sqrt()
    }

    /// Maximum minus minimum, wavelengths.
    pub fn peak_to_valley_waves(&self) -> f64 {
        let values = || self.samples.iter().map(|s| s.waves);
        values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
    }
}

/// Strehl ratio of a wavefront of this RMS: exp(−(2π rms)²), good below 0.1 wavelengths.
pub fn strehl_of_rms(rms_waves: f64) -> f64 {
    real::exp(-(TAU * rms_waves) * (TAU * rms_waves))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::figures::zernike::{fit, noll};
    use crate::design::prescription::system::System;

    /// A wavefront is perpendicular to its rays: ∂W/∂p = (∂e/∂p)·(displacement) on a plane reference, with R → ∞.
    #[test]
    fn slope_of_the_wavefront_is_the_ray_error() {
        let system = System::double_gauss_28();
        let tracer = Tracer::new(&system, 0.5876).unwrap();
        let tan = tracer.field_of_height(20.0).unwrap();
        let plane =
            ReferenceSphere { radius_mm: f64::INFINITY, ..ReferenceSphere::new(&tracer, tan).unwrap() };
        let waves = |p: f64| plane.waves(&tracer.ray(tan, p, 0.0).unwrap());
        let h = 1e-4;
        for p in [-0.9, -0.3, 0.2, 0.8] {
            let ray = tracer.ray(tan, p, 0.0).unwrap();
            let expected = 1e3 * (ray.x.v - plane.chief.x.v) * ray.l.d[0] / 0.5876;
            let slope = (waves(p + h) - waves(p - h)) / (2.0 * h);
            assert!((slope - expected).abs() < 1e-4 * expected.abs().max(1.0), "{p}: {slope} {expected}");
        }
    }

    #[test]
    fn defocus_of_a_parabolic_mirror_has_the_wavefront_of_two_spheres() {
        // All axial rays of a parabola meet in its focus, f before which the mirror is: the wavefront there is a sphere about the focus, and W at
        // the sphere of radius R about the film, dz from the focus, is the distance between the two along each ray.
        let (f, dz) = (100.0, 0.05);
        let mut system = super::super::tests::parabolic_mirror(f, 25.0);
        system.surfaces[0].thickness_mm += dz;
        let tracer = Tracer::new(&system, 0.5).unwrap();
        let wavefront = Wavefront::trace(&tracer, 0.0, 32, 0.7).unwrap();
        let r = wavefront.radius_mm;
        assert!((r - (f + dz)).abs() < 1e-9, "the pupil is the mirror: {r}");
        for s in &wavefront.samples {
            let rho = 12.5 * s.x.hypot(s.y);
            // Direction of the ray at height rho of the parabola; its distance from the focus is f + rho²/4f.
            let cos = (f - rho * rho / (4.0 * f)) / (f + rho * rho / (4.0 * f));
            // From the focus back to the sphere about the film: |t e + dz| = R.
            let t = (r * r - dz * dz * (1.0 - cos * cos)).sqrt() - dz * cos;
            let expected = 1e3 * (t - f) / 0.5;
            assert!((s.waves - expected).abs() < 1e-6, "{} {expected}", s.waves);
        }
        let coefficients = fit(&wavefront.samples, noll, 11).unwrap();
        // W020 = dz NA²/2 in first order: Z4 = W020 / 2√3.
        let expected = 1e3 * dz * 0.125 * 0.125 / 2.0 / 0.5 / (2.0 * 3.0_f64.sqrt());
        assert!((coefficients[3] / expected - 1.0).abs() < 0.02, "{} {expected}", coefficients[3]);
        let (rms, free) = (wavefront.rms_waves(), wavefront.rms_without_tilt_waves().unwrap());
        assert!((free - rms).abs() < 1e-3 * rms, "{rms} {free}");
    }

    #[test]
    fn sides_of_the_grid_are_checked() {
        let system = System::double_gauss_28();
        let tracer = Tracer::new(&system, 0.5876).unwrap();
        for side in [0, 6, 33, 1026] {
            let error = Wavefront::trace(&tracer, 0.0, side, 0.0).unwrap_err().to_string();
            assert!(error.contains("wavefront samples") && error.contains("8 to 1024"), "{error}");
        }
        assert!((strehl_of_rms(0.00684787) - 0.99815044).abs() < 5e-9);
    }
}
