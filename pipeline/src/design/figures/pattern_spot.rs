//! Spots on the hexapolar pattern of lens design programs.
//!
//! ```text
//! ring k of K: 6 k rays at ρ = k/K, one ray in the middle; all have the weight of their wavelength
//! RMS² = Σ w |ρ − ρ₀|² / Σ w      GEO = max |ρ − ρ₀|      ρ₀ the centroid, or the intersection of the chief ray
//! ```
//! Six rings of a Double Gauss give the figures that OpticStudio prints to 2e-6 µm. Rays on the rim have more weight than light has there: the RMS of
//! [`super::spots`] is that of an evenly lit pupil.

use rayon::prelude::*;

use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::design::rays::ray::Tracer;
use crate::real;

/// Rays that may be aimed for each point of a hexapolar pattern; real lenses need 3 to 8 where light passes.
const RAYS_PER_POINT: u32 = 60;
/// Rings of the default of lens design programs.
pub const RINGS: usize = 6;

/// Radii of a spot, µm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatternSpot {
    /// RMS radius about the centroid.
    pub rms_um: f64,
    /// Maximum distance from the centroid.
    pub geo_um: f64,
    /// RMS radius about the chief ray.
    pub rms_chief_um: f64,
    /// Maximum distance from the chief ray.
    pub geo_chief_um: f64,
    /// Centroid relative to the chief ray, along the meridian.
    pub centroid_um: f64,
    /// Rays that reach the film.
    pub rays: usize,
}

/// Tracers of all wavelengths of the design that have a weight, with it.
///
/// # Errors
/// As [`Tracer::new`].
pub fn weighted_tracers(system: &System) -> Result<Vec<(Tracer<'_>, f64)>, DesignError> {
    let wavelengths = system.wavelengths_um.iter().filter(|w| w.1 > 0.0);
    wavelengths.map(|(um, weight)| Ok((Tracer::new(system, *um)?, *weight))).collect()
}

/// The spot of `tracers` with their weights for the field point at `tan`, on a pattern of `rings`; `chief_mm` is the height of the chief ray
/// that it refers to.
///
/// # Errors
/// [`DesignError::Search`]; [`DesignError::Ray`] if no ray reaches the film.
pub fn pattern_spot(
    tracers: &[(Tracer<'_>, f64)],
    tan: f64,
    rings: usize,
    chief_mm: f64,
) -> Result<PatternSpot, DesignError> {
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
    let radii = |x: f64, y: f64| {
        let off = |p: &(f64, f64, f64)| real::hypot(p.1 - x, p.2 - y);
        let square = points.iter().map(|p| p.0 * off(p).powi(2)).sum::<f64>() / total;
        (1e3 * square.sqrt(), 1e3 * points.iter().map(off).fold(0.0, f64::max))
    };
    let ((rms_um, geo_um), (rms_chief_um, geo_chief_um)) = (radii(x0, y0), radii(chief_mm, 0.0));
    Ok(PatternSpot {
        rms_um,
        geo_um,
        rms_chief_um,
        geo_chief_um,
        centroid_um: 1e3 * (x0 - chief_mm),
        rays: points.len(),
    })
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
