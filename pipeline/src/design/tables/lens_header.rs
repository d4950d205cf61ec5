//! What a [`Lens`] states of a design, without its bands.

use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::design::rays::paraxial::Paraxial;
use crate::lens::{Lens, PsfSample};

/// The lens of `system` without bands.
///
/// # Errors
/// No first-order properties.
pub fn lens_header(system: &System) -> Result<Lens, DesignError> {
    Ok(header(system, &Paraxial::new(system, system.primary_um())?))
}

pub(super) fn header(system: &System, primary: &Paraxial) -> Lens {
    Lens {
        name: system.name.clone(),
        distortion_focal_length_mm: primary.distortion_focal_length_mm.abs(),
        // An afocal relay has none.
        effective_focal_length_mm: Some(primary.effective_focal_length_mm.abs())
            .filter(|f| f.is_finite())
            .unwrap_or(primary.distortion_focal_length_mm.abs()),
        f_number: match system.is_telecentric {
            true => primary.working_f_number(),
            false => primary.image_f_number(),
        },
        primary_wavelength_nm: system.primary_um() * 1e3,
        object_distance_mm: system.object_distance_mm,
        magnification: primary.film_magnification(system.object_distance_mm),
        psf_sample: PsfSample::Point,
        bands: Vec::new(),
        depth: None,
    }
}
