//! What a lens leaves of the light: transmission over wavelength, and the reflectance of each surface.
//!
//! Transmission is the flux-weighted mean over the axial pupil ([`axial_transmission`]); without the absorption of the glasses it is what the surfaces leave.
//! A reflectance is that at normal incidence.

use crate::design::prescription::coating::Coating;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::{Medium, System};
use crate::design::pupil::illumination::{axial_transmission, irradiance_sr};
use crate::design::rays::ray::Tracer;

/// Light of one wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct LightFigures {
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// Transmission on the axis.
    pub transmission: f64,
    /// That of the surfaces alone.
    pub surfaces: f64,
    /// Relative illumination at the largest field over that of the lens without losses.
    pub edge_ratio: f64,
}

/// A surface that refracts, reflects or has a coating.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceLight {
    /// Number from 1.
    pub number: usize,
    /// Index before and behind it.
    pub indices: (f64, f64),
    /// In words: `ideal`, `bare`, `films`, `reflectance`, `table`.
    pub coating: &'static str,
    /// Reflectance at normal incidence.
    pub reflectance: f64,
    /// Transmittance at normal incidence.
    pub transmittance: f64,
}

/// Light of `system` at `nm`, and at the field of the tangent `edge_tan` against the axis.
///
/// # Errors
/// A wavelength outside the tables of a glass or a coating; a ray that does not reach the image.
pub fn light_figures(system: &System, nm: f64, edge_tan: f64) -> Result<LightFigures, DesignError> {
    let um = nm / 1e3;
    let mut clear = system.clone();
    for s in &mut clear.surfaces {
        if let Medium::Glass(glass) = &mut s.medium {
            glass.absorption = None;
        }
    }
    let tracer = Tracer::new(system, um)?;
    let fall_off =
        |t: &Tracer<'_>| Ok::<_, DesignError>(irradiance_sr(t, edge_tan)? / irradiance_sr(t, 0.0)?);
    Ok(LightFigures {
        wavelength_nm: nm,
        transmission: axial_transmission(system, um)?,
        surfaces: axial_transmission(&clear, um)?,
        edge_ratio: fall_off(&tracer)? / fall_off(&tracer.without_losses())?,
    })
}

/// The surfaces of `system` that refract, reflect or have a coating, at `nm`.
///
/// # Errors
/// A wavelength outside the tables of a glass or a coating.
pub fn surface_light(system: &System, nm: f64) -> Result<Vec<SurfaceLight>, DesignError> {
    let um = nm / 1e3;
    let mut before = 1.0;
    let mut found = Vec::new();
    for (i, s) in system.surfaces.iter().enumerate().take(system.image()) {
        let behind = s.medium.index(um)?;
        if s.is_mirror || system.is_boundary(i).0 || s.coating.is_some() {
            let (coating, (reflectance, transmittance)) = match &s.coating {
                None => ("ideal", if s.is_mirror { (1.0, 0.0) } else { (0.0, 1.0) }),
                Some(coating) => (word(coating), coating.at(um)?.amplitudes(before, behind, 1.0).powers()),
            };
            let indices = (before, behind);
            found.push(SurfaceLight { number: i + 1, indices, coating, reflectance, transmittance });
        }
        before = behind;
    }
    Ok(found)
}

fn word(coating: &Coating) -> &'static str {
    match coating {
        Coating::Bare => "bare",
        Coating::Films(_) => "films",
        Coating::Reflectance(_) => "reflectance",
        Coating::Table(_) => "table",
    }
}
