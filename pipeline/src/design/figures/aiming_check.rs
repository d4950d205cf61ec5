//! Choice of ray aiming for a design that aims at the paraxial entrance pupil.
//!
//! With rays aimed at the paraxial pupil, the bundle of a field point off the axis does not fill the stop that the lens has: pupil aberration
//! makes it too small or too large. The size of the effect is the change of relative illumination at the edge of the field. Where it exceeds
//! [`TOLERANCE`], or where the paraxial chief ray does not even reach the image, rays are aimed at the real stop.

use super::describe::field_tan;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::{RayAiming, System};
use crate::design::pupil::illumination::irradiance_sr;
use crate::design::rays::ray::Tracer;
use crate::real;

/// Maximum relative change of the illumination at the edge of the field by ray aiming.
const TOLERANCE: f64 = 0.005;

impl System {
    /// The same system, with real ray aiming and a note if paraxial aiming changes the relative illumination at the edge of
    /// the field by more than 0.5 %.
    ///
    /// # Errors
    /// No first-order properties.
    pub fn with_checked_aiming(mut self) -> Result<Self, DesignError> {
        if self.aiming == RayAiming::Real || self.is_telecentric {
            return Ok(self);
        }
        let real = Self { aiming: RayAiming::Real, ..self.clone() };
        let Ok(aimed) = Tracer::new(&real, real.primary_um()) else { return Ok(self) };
        let primary = &aimed.primary;
        let edge = self.fields.iter().map(|f| field_tan(&real, primary, *f).abs()).fold(0.0, f64::max);
        // Within the field that real rays reach.
        let edge = edge.min(aimed.farthest_field().1);
        if edge == 0.0 {
            return Ok(self);
        }
        let Ok(expected) = relative(&aimed, edge) else { return Ok(self) };
        let found = relative(&Tracer::new(&self, self.primary_um())?, edge);
        let degrees = real::atan(edge).to_degrees();
        let effect = match found {
            Ok(found) if (found - expected).abs() <= TOLERANCE * expected => return Ok(self),
            Ok(found) => {
                format!("{found:.3} with rays aimed at the paraxial pupil, {expected:.3} with real rays")
            }
            Err(e) => format!("{expected:.3} with real rays, while {e}"),
        };
        self.aiming = RayAiming::Real;
        self.notes.push(format!(
            "ray aiming is off in the design; the relative illumination at {degrees:.1} degrees is {effect}: rays are aimed at the \
             stop (`--aiming paraxial` for the setting of the design)"
        ));
        Ok(self)
    }
}

fn relative(tracer: &Tracer<'_>, tan: f64) -> Result<f64, DesignError> {
    Ok(irradiance_sr(tracer, tan)? / irradiance_sr(tracer, 0.0)?)
}
