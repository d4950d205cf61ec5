//! Relative illumination: how bright a uniform remap's image is against its centre.
//!
//!     R(h) = Ω(h) / Ω(0),      Ω = ∫∫ |d(L, M)/d(p, q)| dp dq over the open pupil      [projected solid angle, sr]
//! Radiance is kept along rays, so the irradiance at an image point is π-free: E = L·τ·Ω, Ω the pupil's area in direction cosines
//! seen from there. On the axis Ω = π NA². Holds vignetting and pupil aberration; cos⁴ comes out where the stop stands alone.
//! Source: Rimmer, Relative illumination calculations, Proc. SPIE 655 (1986). Left out: transmission's change with field.

use std::f64::consts::PI;

use super::error::DesignError;
use super::pupil::Pupil;
use super::ray::Tracer;

/// Projected solid angle of the pupil from the image of the field point at tan(field angle) `tan`, sr.
///
/// # Errors
/// What keeps the pupil's rays from the image.
pub fn solid_angle_sr(tracer: &Tracer<'_>, tan: f64) -> Result<f64, DesignError> {
    let pupil = Pupil::new(tracer, tan)?;
    let mut half = 0.0;
    // The Jacobian is a smooth function: 7 × 9 nodes hold it to 1e-9 even at F/1.8.
    for node in pupil.nodes(tracer, tan, 7, 9) {
        half += node.weight * tracer.ray(tan, node.p, node.q)?.solid_angle();
    }
    Ok(2.0 * half)
}

/// Numerical aperture on the axis: the sine of the marginal ray's angle.
///
/// # Errors
/// What keeps the pupil's rays from the image.
pub fn numerical_aperture(tracer: &Tracer<'_>) -> Result<f64, DesignError> {
    solid_angle_sr(tracer, 0.0).map(|omega| (omega / PI).sqrt())
}
