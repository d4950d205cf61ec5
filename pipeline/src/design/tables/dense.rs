//! Heights and light of a band at many field points, evenly spaced in ideal height.

use rayon::prelude::*;

use super::trace::LensTrace;
use crate::bounds::TRANSMISSION;
use crate::design::prescription::error::DesignError;
use crate::design::pupil::illumination::{irradiance_sr, irradiance_table};
use crate::design::rays::ray::Tracer;

impl LensTrace<'_> {
    /// Ideal heights, real heights and G of [`crate::design::illumination`], evenly spaced in ideal height.
    pub(super) fn dense(&self, tracer: &Tracer<'_>) -> Result<[Vec<f64>; 3], DesignError> {
        let tans = self.tans(tracer)?;
        let real: Result<Vec<f64>, DesignError> =
            tans.par_iter().map(|t| tracer.chief_height_mm(*t)).collect();
        let mut real = real?;
        real[0] = 0.0;
        if let Some(i) = real.windows(2).position(|w| w[1] <= w[0]) {
            return Err(DesignError::Height {
                requested_mm: self.options.max_height_mm,
                reached_mm: real[i],
                wavelength_um: tracer.wavelength_um,
                problem: "the real image height folds back".to_owned(),
            });
        }
        let light = irradiance_table(tracer, &tans)?;
        Ok([tans.iter().map(|t| t * tracer.ideal_scale_mm()).collect(), real, light])
    }

    /// The tangents of the field angles of the dense tables.
    pub(super) fn tans(&self, tracer: &Tracer<'_>) -> Result<Vec<f64>, DesignError> {
        let last = tracer.field_of_height(self.options.max_height_mm)?;
        let points = self.options.field_points;
        Ok((0..points).map(|i| last * i as f64 / (points - 1) as f64).collect())
    }
}

/// Transmission on the axis, whose light G with its losses is `light`: flux-weighted mean over the pupil; 1 without coatings.
///
/// # Errors
/// A ray of the pupil that does not reach the image; [`DesignError::Dark`].
pub(super) fn transmission(tracer: &Tracer<'_>, light: f64) -> Result<f64, DesignError> {
    if !tracer.has_losses() {
        return Ok(1.0);
    }
    within_dark(tracer, light / irradiance_sr(&tracer.without_losses(), 0.0)?)
}

/// `transmission`, unless the lens is dark.
pub(super) fn within_dark(tracer: &Tracer<'_>, transmission: f64) -> Result<f64, DesignError> {
    match transmission >= TRANSMISSION.min {
        true => Ok(transmission),
        false => Err(DesignError::Dark { wavelength_um: tracer.wavelength_um }),
    }
}
