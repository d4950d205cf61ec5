//! Field curvature and astigmatism: where rays infinitely near the chief ray cross it.
//!
//! ```text
//! z_T = −x_p / (L/N)_p      z_S = −y_q / (M/N)_q      subscripts p, q: derivatives by the pupil coordinates along and across the meridian
//! ```
//! x, y in the film plane; z along the axis from the film. The derivatives are exact ([`crate::design::ray`]); Coddington's equations give the same.

use crate::design::prescription::error::DesignError;
use crate::design::rays::ray::Tracer;

/// Foci of a narrow bundle along a chief ray, from the film, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foci {
    /// Of rays along the meridian.
    pub tangential_mm: f64,
    /// Of rays across it.
    pub sagittal_mm: f64,
}

/// Foci of the field point at tan(field angle) `tan`.
///
/// # Errors
/// The chief ray does not reach the film.
pub fn foci(tracer: &Tracer<'_>, tan: f64) -> Result<Foci, DesignError> {
    let ray = tracer.ray(tan, 0.0, 0.0)?;
    // d(L/N) with L² + M² + N² = n² and M = 0 on the meridian.
    let square = ray.l.v * ray.l.v + ray.n * ray.n;
    Ok(Foci {
        tangential_mm: -ray.x.d[0] / (ray.l.d[0] * square / ray.n.powi(3)),
        sagittal_mm: -ray.y.d[1] / (ray.m.d[1] / ray.n),
    })
}
