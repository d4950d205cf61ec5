//! The rays along the rim of the open pupil: the outermost of a bundle.
//!
//! ```text
//! F_T = 1 / (L_max − L_min)     F_S = 1 / (2 M_max)      L, M optical direction cosines at the film
//! ```
//! are the working F-numbers for patterns that vary along the meridian and across it: 1/(λ F) is the frequency from which on the MTF is 0. On the axis
//! both are 1/(2 NA).

use super::openings::{Pupil, with_openings};
use crate::design::prescription::error::DesignError;
use crate::design::rays::aim::LastAim;
use crate::design::rays::ray::{ImageRay, Tracer};
use crate::real;

/// Intervals of the angle on each segment of the rim.
const STEPS: usize = 64;
/// Rays that may be aimed: twelve segments of a lens that needs 60 for each.
const MAX_RAYS: u32 = 60_000;

/// The rays along the rim of the upper half of a pupil.
#[derive(Clone, Debug)]
pub struct Rim {
    /// The rays.
    pub rays: Vec<ImageRay>,
}

impl Rim {
    /// Traces the rim of the field point at tan(field angle) `tan`.
    ///
    /// # Errors
    /// All rays are blocked, or one at the rim does not reach the film.
    pub fn trace(tracer: &Tracer<'_>, tan: f64) -> Result<Self, DesignError> {
        tracer.within_budget(tan, MAX_RAYS, |tracer| {
            let pupil = Pupil::new(tracer, tan)?;
            let (mut rays, last) = (Vec::new(), LastAim::default());
            with_openings(tracer, tan, |openings| {
                for segment in &pupil.segments {
                    let angle =
                        |k: usize| segment.from + (segment.to - segment.from) * k as f64 / STEPS as f64;
                    let radii = segment.radii(openings, (0..=STEPS).map(angle));
                    for (theta, b) in (0..=STEPS).map(angle).zip(radii) {
                        let (s, c) = real::sin_cos(theta);
                        rays.push(tracer.ray_from(&last, tan, segment.centre + b * c, b * s)?.0);
                    }
                }
                Ok(())
            })?;
            Ok(Self { rays })
        })
    }

    /// Working F-numbers along and across the meridian; infinite for collimated light.
    pub fn f_numbers(&self) -> [f64; 2] {
        let (mut low, mut high, mut across) = (f64::INFINITY, f64::NEG_INFINITY, 0.0_f64);
        for r in &self.rays {
            (low, high, across) = (low.min(r.l.v), high.max(r.l.v), across.max(r.m.v.abs()));
        }
        [1.0 / (high - low), 0.5 / across]
    }
}
