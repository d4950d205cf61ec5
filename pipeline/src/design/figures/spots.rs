//! Spot diagrams and best focus.
//!
//! ```text
//! RMS² = Σ w |ρ − ρ̄|² / Σ w      GEO = max |ρ − reference|      w = flux through the pupil, ρ in the image plane [mm]
//! Strehl = |Σ a e^{ikΦ}|² / (Σ a)²      at the chief ray (no tilt removed), Φ the optical path less its value on the chief ray
//! ```
//! Pupil: polar Gauss-Legendre, with the vignetting of the PSF; [`polychromatic_spot`] uses the hexapolar rays of design programs instead.
//! Source: Welford, chapters 6 and 13; Born & Wolf 9.1.

use rayon::prelude::*;

use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::design::pupil::bundle::Bundle;
use crate::design::rays::ray::{ImageRay, Tracer};
use crate::real;

/// Rings and spokes of rays over half the pupil.
const RAYS: (usize, usize) = (24, 32);

/// Rays that may be aimed for each point of a hexapolar pattern; real lenses need 3 to 8 where light passes.
const RAYS_PER_POINT: u32 = 60;

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
    Ok(spot_of(&Bundle::trace(tracer, tan, RAYS.0, RAYS.1)?))
}

/// Spot of a bundle.
pub(super) fn spot_of(bundle: &Bundle) -> Spot {
    let (rays, chief) = (&bundle.rays, &bundle.chief);
    let total: f64 = rays.iter().map(|(w, r)| w * r.flux).sum();
    let centroid = rays.iter().map(|(w, r)| w * r.flux * (r.x.v - chief.x.v)).sum::<f64>() / total;
    let about =
        |x0: f64| rays.iter().map(move |(w, r)| (w * r.flux, real::hypot(r.x.v - chief.x.v - x0, r.y.v)));
    let rms = |x0: f64| (about(x0).map(|(w, d)| w * d * d).sum::<f64>() / total).sqrt() * 1e3;
    let seen = || rays.iter().zip(&bundle.is_hidden).filter(|(_, is_hidden)| !**is_hidden).map(|(r, _)| &r.1);
    let geo = |x0: f64| seen().map(|r| real::hypot(r.x.v - chief.x.v - x0, r.y.v)).fold(0.0, f64::max) * 1e3;
    Spot {
        rms_um: rms(centroid),
        rms_chief_um: rms(0.0),
        geo_um: geo(centroid),
        geo_chief_um: geo(0.0),
        centroid_um: centroid * 1e3,
        strehl: strehl(bundle.wavelength_um, rays, chief, 0.0),
    }
}

/// Tracers of all wavelengths of the design that have a weight, with it.
///
/// # Errors
/// As [`Tracer::new`].
pub fn weighted_tracers(system: &System) -> Result<Vec<(Tracer<'_>, f64)>, DesignError> {
    let wavelengths = system.wavelengths_um.iter().filter(|w| w.1 > 0.0);
    wavelengths.map(|(um, weight)| Ok((Tracer::new(system, *um)?, *weight))).collect()
}

/// RMS and GEO spot radius about the centroid, µm, of `tracers` with their weights, on a hexapolar pattern of
/// `rings` (6 k equal rays on ring k, one in the middle), as in design programs, for the field point at `tan`.
///
/// # Errors
/// [`DesignError::Search`]; [`DesignError::Ray`] if no ray reaches the film.
pub fn polychromatic_spot(
    tracers: &[(Tracer<'_>, f64)],
    tan: f64,
    rings: usize,
) -> Result<(f64, f64), DesignError> {
    let mut points = hexapolar(tracers, tan, rings)?;
    // Behind a wide obscuration the coarse pattern may have no ray at all.
    let is_obscured = tracers.iter().any(|(tracer, _)| tracer.has_obscurations());
    for finer in [4 * rings, 16 * rings].into_iter().filter(|_| is_obscured) {
        if points.is_empty() {
            points = hexapolar(tracers, tan, finer)?;
        }
    }
    if let (true, Some((tracer, _))) = (points.is_empty(), tracers.first()) {
        return Err(tracer.ray_error(tan, 0.0, 0.0, "and all others are blocked".to_owned()));
    }
    let total: f64 = points.iter().map(|p| p.0).sum();
    let mean = |of: fn(&(f64, f64, f64)) -> f64| points.iter().map(|p| p.0 * of(p)).sum::<f64>() / total;
    let (x0, y0) = (mean(|p| p.1), mean(|p| p.2));
    let off = |p: &(f64, f64, f64)| real::hypot(p.1 - x0, p.2 - y0);
    let square = points.iter().map(|p| p.0 * off(p).powi(2)).sum::<f64>() / total;
    Ok((1e3 * square.sqrt(), 1e3 * points.iter().map(off).fold(0.0, f64::max)))
}

/// Weight and intersection with the film of the rays of a hexapolar pattern that reach it.
fn hexapolar(
    tracers: &[(Tracer<'_>, f64)],
    tan: f64,
    rings: usize,
) -> Result<Vec<(f64, f64, f64)>, DesignError> {
    let one = |(tracer, weight): &(Tracer<'_>, f64)| {
        tracer.within_budget(tan, RAYS_PER_POINT * (3 * rings * (rings + 1) + 1) as u32, |tracer| {
            let mut points = Vec::new();
            points.extend(tracer.landing(tan, 0.0, 0.0).map(|(x, y)| (*weight, x, y)));
            // Rays k, of 6 k on ring k, from the one perpendicular to the meridian; those of the other half of the pupil are their mirror images.
            for ring in 1..=rings as i32 {
                let rho = f64::from(ring) / rings as f64;
                for k in -(3 * ring / 2)..=3 * ring / 2 {
                    let (s, c) = real::sin_cos(std::f64::consts::PI * f64::from(k) / f64::from(3 * ring));
                    let Some((x, y)) = tracer.landing(tan, rho * s, rho * c) else { continue };
                    points.push((*weight, x, y));
                    if 2 * k.abs() != 3 * ring {
                        points.push((*weight, x, -y));
                    }
                }
            }
            Ok(points)
        })
    };
    Ok(tracers.par_iter().map(one).collect::<Result<Vec<_>, _>>()?.concat())
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
