//! Spot diagrams and best focus.
//!
//! ```text
//! RMS² = Σ w |ρ − ρ̄|² / Σ w      GEO = max |ρ − reference|      w = flux through the pupil, ρ in the image plane [mm]
//! Strehl = |Σ a e^{ikΦ}|² / (Σ a)²      at the chief ray (no tilt removed), Φ the optical path less its value on the chief ray
//! ```
//! Pupil: polar Gauss-Legendre, with the vignetting of the PSF, and the rays along its rim for GEO; [`super::pattern_spot`] has the hexapolar rays of
//! design programs instead.
//! Source: Welford, chapters 6 and 13; Born & Wolf 9.1.

use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::design::pupil::bundle::Bundle;
use crate::design::pupil::rim::Rim;
use crate::design::rays::ray::{ImageRay, Tracer};
use crate::real;

/// Rings and spokes of rays over half the pupil.
const RAYS: (usize, usize) = (24, 32);

/// Spot size of one field point at one wavelength, µm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// RMS radius about the centroid.
    pub rms_um: f64,
    /// RMS radius about the chief ray.
    pub rms_chief_um: f64,
    /// Maximum distance from the centroid.
    pub geo_um: f64,
    /// Maximum distance from the chief ray.
    pub geo_chief_um: f64,
    /// Centroid relative to the chief ray, along the meridian.
    pub centroid_um: f64,
    /// Strehl ratio at the chief ray.
    pub strehl: f64,
}

/// Spot of the field point at tan(field angle) `tan`.
///
/// # Errors
/// A ray that does not reach the image.
pub fn spot(tracer: &Tracer<'_>, tan: f64) -> Result<Spot, DesignError> {
    Ok(spot_of(&Bundle::trace(tracer, tan, RAYS.0, RAYS.1)?, &Rim::trace(tracer, tan)?))
}

/// Spot of a bundle with its rim.
pub(super) fn spot_of(bundle: &Bundle, rim: &Rim) -> Spot {
    let (rays, chief) = (&bundle.rays, &bundle.chief);
    let total: f64 = rays.iter().map(|(w, r)| w * r.flux).sum();
    let centroid = rays.iter().map(|(w, r)| w * r.flux * (r.x.v - chief.x.v)).sum::<f64>() / total;
    let about =
        |x0: f64| rays.iter().map(move |(w, r)| (w * r.flux, real::hypot(r.x.v - chief.x.v - x0, r.y.v)));
    let rms = |x0: f64| (about(x0).map(|(w, d)| w * d * d).sum::<f64>() / total).sqrt() * 1e3;
    let seen = || rays.iter().zip(&bundle.is_hidden).filter(|(_, is_hidden)| !**is_hidden).map(|(r, _)| &r.1);
    let outermost = || seen().chain(&rim.rays);
    let geo =
        |x0: f64| outermost().map(|r| real::hypot(r.x.v - chief.x.v - x0, r.y.v)).fold(0.0, f64::max) * 1e3;
    Spot {
        rms_um: rms(centroid),
        rms_chief_um: rms(0.0),
        geo_um: geo(centroid),
        geo_chief_um: geo(0.0),
        centroid_um: centroid * 1e3,
        strehl: strehl(bundle.wavelength_um, rays, chief, 0.0),
    }
}

/// Strehl ratio at the chief ray, the film moved back by `shift` mm.
fn strehl(um: f64, rays: &[(f64, ImageRay)], chief: &ImageRay, shift: f64) -> f64 {
    let k = 2e3 * std::f64::consts::PI / um;
    let (mut re, mut im, mut sum) = (0.0, 0.0, 0.0);
    // The reference point moves along the chief ray.
    let x0 = chief.x.v + shift * chief.l.v / chief.n;
    for (w, r) in rays {
        let amplitude = w * (r.flux * r.solid_angle() / r.n).sqrt();
        let path = r.path.v - chief.path.v + shift * r.n + r.l.v * (x0 - r.x.v) - r.m.v * r.y.v;
        re += amplitude * real::cos(k * path);
        im += amplitude * real::sin(k * path);
        sum += amplitude;
    }
    (re * re + im * im) / (sum * sum)
}

/// Shift of the film, away from the lens, to the minimum RMS spot on the axis, mm.
pub(crate) fn best_rms_shift_mm(system: &System, um: f64) -> Result<f64, DesignError> {
    let tracer = Tracer::new(system, um)?;
    let rays = Bundle::trace(&tracer, 0.0, RAYS.0, RAYS.1)?.rays;
    // On the axis the centroid is 0: minimise Σ w |ρ + z s|².
    let (mut cross, mut square) = (0.0, 0.0);
    for (w, r) in &rays {
        let (sx, sy) = (r.l.v / r.n, r.m.v / r.n);
        let w = w * r.flux;
        cross += w * (r.x.v * sx + r.y.v * sy);
        square += w * (sx * sx + sy * sy);
    }
    Ok(-cross / square)
}

/// Shift of the film, away from the lens, to the maximum Strehl ratio on the axis, mm.
pub(crate) fn best_strehl_shift_mm(system: &System, um: f64) -> Result<f64, DesignError> {
    let tracer = Tracer::new(system, um)?;
    let Bundle { rays, chief, .. } = Bundle::trace(&tracer, 0.0, RAYS.0, RAYS.1)?;
    let around = best_rms_shift_mm(system, um)?;
    // Depth of focus λ/NA²: scan ±8 of them, then refine around the maximum.
    let na2 = rays.iter().map(|(_, r)| r.l.v * r.l.v + r.m.v * r.m.v).fold(0.0, f64::max);
    let depth = 1e-3 * um / na2;
    let value = |z: f64| strehl(um, &rays, &chief, z);
    let scan = (-160..=160).map(|i| around + depth * 0.05 * f64::from(i));
    let mut best =
        scan.fold((f64::NEG_INFINITY, around), |b, z| if value(z) > b.0 { (value(z), z) } else { b }).1;
    let mut step = 0.05 * depth;
    for _ in 0..60 {
        best = [best - step, best, best + step]
            .into_iter()
            .fold((f64::NEG_INFINITY, best), |b, z| if value(z) > b.0 { (value(z), z) } else { b })
            .1;
        step *= 0.7;
    }
    Ok(best)
}
