//! Figures that `lens show` prints: of a pack from its tables and PSFs, of a design from rays.

use crate::job::lens::samples::{FieldFigures, LensData, LensSamples};
use anyhow::{Context, Result};
use pipeline::bounds::TRANSMISSION;
use pipeline::design::field_figures::{RayFigures, field_figures};
use pipeline::design::illumination::axial_transmission;
use pipeline::design::trace::lens_header;
use pipeline::design::{DesignError, System};
use pipeline::lens::Lens;

/// Share of the light that the window of a design is estimated for, and the film pitch, as in `lens trace`.
const ENERGY: f64 = 0.99;
const FILM_PITCH_UM: f64 = 2.0;

/// Figures by wavelength and height.
pub struct Shown {
    /// The lens without bands.
    pub lens: Lens,
    /// Reference wavelength of lateral colour.
    pub primary_nm: f64,
    pub fields: Vec<FieldFigures>,
    /// Field points whose rays do not reach the image, with the reason.
    pub missing: Vec<String>,
}

impl Shown {
    pub fn new(lens: &LensData, nm: &[f64], heights_mm: &[f64]) -> Result<Self> {
        match lens {
            LensData::Pack(_) => Ok(of_samples(&lens.sample(nm, heights_mm)?)),
            LensData::Design(system, _) => {
                of_design(system, nm, heights_mm).with_context(|| format!("tracing {}", system.name))
            }
        }
    }
}

fn of_samples(samples: &LensSamples) -> Shown {
    let band = |b: usize| (0..samples.fields[b].len()).map(move |k| samples.figures(b, k));
    Shown {
        lens: Lens { bands: Vec::new(), ..samples.lens.clone() },
        primary_nm: samples.primary.wavelength_nm,
        fields: (0..samples.fields.len()).flat_map(band).collect(),
        missing: Vec::new(),
    }
}

fn of_design(system: &System, nm: &[f64], heights_mm: &[f64]) -> Result<Shown> {
    let um: Vec<f64> = nm.iter().map(|nm| nm / 1e3).collect();
    // Of a lens that passes no light all figures are quotients of nothing.
    for &wavelength_um in &um {
        if !TRANSMISSION.contains(axial_transmission(system, wavelength_um)?) {
            return Err(DesignError::Dark { wavelength_um }.into());
        }
    }
    let traced = field_figures(system, &um, heights_mm, ENERGY, FILM_PITCH_UM)?;
    let places = nm.iter().flat_map(|nm| heights_mm.iter().map(move |mm| (nm, mm)));
    let (mut fields, mut missing, mut first) = (Vec::new(), Vec::new(), None);
    for ((nm, mm), figures) in places.zip(traced) {
        match figures {
            Ok(f) => fields.push(figures_of(&f, *nm)),
            Err(e) => {
                missing.push(format!("{mm:.4} mm at {nm} nm: {e}"));
                first.get_or_insert(e);
            }
        }
    }
    match first {
        Some(e) if fields.is_empty() => Err(e.into()),
        _ => Ok(Shown { lens: lens_header(system)?, primary_nm: system.primary_um() * 1e3, fields, missing }),
    }
}

fn figures_of(f: &RayFigures, wavelength_nm: f64) -> FieldFigures {
    FieldFigures {
        wavelength_nm,
        height_mm: f.height_mm,
        ideal_height_mm: f.ideal_height_mm,
        illumination: f.light.irradiance_sr / f.axis.irradiance_sr,
        // Undefined for collimated light.
        relative_projected_solid_angle: Some(f.light.solid_angle_sr / f.axis.solid_angle_sr)
            .filter(|v| v.is_finite()),
        distortion_percent: 100.0 * f.distortion,
        lateral_colour_um: f.lateral_colour_um,
        rms_um: f.spot.rms_um,
        geo_um: Some(f.spot.geo_um),
        f_numbers: Some(f.f_numbers),
        strehl: Some(f.spot.strehl).filter(|v| v.is_finite()),
        window_um: f.window_px.map_or(f64::INFINITY, |px| px as f64 * FILM_PITCH_UM),
        energy: f.light_inside,
    }
}
