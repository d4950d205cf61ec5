//! Clear radii that clip ghosts, and the disc over which their rays start.
//!
//! A ghost is clipped at every crossing: by the surface's aperture, else by its clear radius for drawings, else by the largest distance from the axis of image rays to the
//! film's corner. The stop has no larger radius than the aperture of the system gives it; the film none than its corner.

use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::design::rays::ray::Tracer;

/// Radii of the surfaces, mm.
#[derive(Clone, Debug, PartialEq)]
pub struct Apertures {
    /// Clear radius of each surface, the film's corner last.
    pub clear_mm: Vec<f64>,
    /// Radius within which a surface blocks light, if it does.
    pub hidden_mm: Vec<Option<f64>>,
    /// Surfaces whose radius is that of image rays.
    pub of_rays: Vec<usize>,
}

/// Parts of the field at which image rays are traced.
const FIELDS: u32 = 8;
/// Pupil heights of these rays in the meridian.
const HEIGHTS: i32 = 20;

impl Apertures {
    /// Those of `system` for a film whose corner lies at the real image height `corner_mm`.
    ///
    /// # Errors
    /// A lens without first-order properties; a film's corner that it does not reach.
    pub fn new(system: &System, corner_mm: f64) -> Result<Self, DesignError> {
        let film = system.image();
        let tracer = Tracer::new(system, system.primary_um())?;
        let given = |k: usize| {
            let s = &system.surfaces[k];
            s.aperture_mm.or(Some(s.semi_diameter_mm).filter(|r| *r > 0.0))
        };
        let unknown: Vec<usize> = (0..film).filter(|k| given(*k).is_none() && *k != system.stop).collect();
        let used = match unknown.is_empty() {
            true => Vec::new(),
            // Where the lens does not reach the corner, to its outermost field.
            false => radii_of_rays(
                &tracer,
                film,
                tracer.field_of_height(corner_mm.min(tracer.farthest_field().0))?,
            ),
        };
        let clear = |k: usize| match (given(k), k == system.stop) {
            (Some(r), true) => r.min(tracer.stop_radius_mm()),
            (None, true) => tracer.stop_radius_mm(),
            (Some(r), false) => r,
            (None, false) => used[k],
        };
        let mut clear_mm: Vec<f64> = (0..film).map(clear).collect();
        clear_mm.push(corner_mm);
        let hidden_mm = system.surfaces.iter().map(|s| s.obscuration_mm).collect();
        Ok(Self { clear_mm, hidden_mm, of_rays: unknown })
    }
}

/// Largest distance from the axis of meridional image rays at each surface up to the field `last`.
fn radii_of_rays(tracer: &Tracer<'_>, film: usize, last: f64) -> Vec<f64> {
    let mut used = vec![0.0_f64; film + 1];
    for tan in (0..=FIELDS).map(|i| last * f64::from(i) / f64::from(FIELDS)) {
        for p in (-HEIGHTS..=HEIGHTS).map(|i| f64::from(i) / f64::from(HEIGHTS)) {
            if !tracer.passes(tan, p, 0.0) {
                continue;
            }
            for (radius, [_, x, _]) in
                used.iter_mut().zip(tracer.meridional_ray(tan, p).into_iter().flatten())
            {
                *radius = radius.max(x.abs());
            }
        }
    }
    used
}
