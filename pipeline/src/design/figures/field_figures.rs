//! Figures of field points from rays alone, without PSFs: light, distortion, lateral colour, spots, and the window that PSFs need.

use rayon::prelude::*;

use super::spots::{Spot, spot_of};
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::design::pupil::bundle::Bundle;
use crate::design::pupil::illumination::FieldLight;
use crate::design::pupil::rim::Rim;
use crate::design::rays::ray::Tracer;

/// Maximum window, film pixels.
const MAX_WINDOW_PX: usize = 20_001;
/// Rings and spokes of rays.
const RAYS: (usize, usize) = (24, 32);

/// Figures of one field point at one wavelength.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayFigures {
    /// Wavelength, µm.
    pub wavelength_um: f64,
    /// Real image height, mm.
    pub height_mm: f64,
    /// Ideal image height, mm.
    pub ideal_height_mm: f64,
    /// Tangent of the field angle.
    pub tan: f64,
    /// Light of the field point.
    pub light: FieldLight,
    /// Light of the axis.
    pub axis: FieldLight,
    /// Real over ideal height less 1; on the axis its limit.
    pub distortion: f64,
    /// Real height minus that of the same field point at the primary wavelength, µm.
    pub lateral_colour_um: f64,
    /// Spot diagram.
    pub spot: Spot,
    /// Working F-numbers along and across the meridian.
    pub f_numbers: [f64; 2],
    /// Estimated side of the window that holds the share `energy` of the light, film pixels; none above 20,001.
    pub window_px: Option<usize>,
    /// Estimated share of the light inside the largest window of the wavelength.
    pub light_inside: f64,
}

/// Figures of the field points at real heights `heights_mm` for the wavelengths `um`, by wavelength, then height. The window is estimated
/// for the share `energy` of the light and film pixels of `film_pitch_um`.
pub fn field_figures(
    system: &System,
    um: &[f64],
    heights_mm: &[f64],
    energy: f64,
    film_pitch_um: f64,
) -> Result<Vec<Result<RayFigures, DesignError>>, DesignError> {
    let primary = Tracer::new(system, system.primary_um())?;
    let tracers: Vec<Tracer<'_>> =
        um.iter().map(|um| Tracer::new(system, *um)).collect::<Result<_, DesignError>>()?;
    let axes: Vec<FieldLight> = tracers
        .par_iter()
        .map(|t| Bundle::trace(t, 0.0, 7, 9)?.light(t))
        .collect::<Result<_, DesignError>>()?;
    let places: Vec<(usize, f64)> =
        (0..um.len()).flat_map(|b| heights_mm.iter().map(move |h| (b, *h))).collect();
    let one = |b: usize, height_mm: f64| -> Result<(RayFigures, Bundle), DesignError> {
        let tracer = &tracers[b];
        let tan = tracer.field_of_height(height_mm)?;
        let bundle = Bundle::trace(tracer, tan, RAYS.0, RAYS.1)?;
        let rim = Rim::trace(tracer, tan)?;
        let (_, slope) = tracer.chief_height_and_slope(tan)?;
        let ideal_height_mm = tan * tracer.ideal_scale_mm();
        let ratio = if tan == 0.0 { slope / tracer.ideal_scale_mm() } else { height_mm / ideal_height_mm };
        let figures = RayFigures {
            wavelength_um: tracer.wavelength_um,
            height_mm,
            ideal_height_mm,
            tan,
            light: bundle.light(tracer)?,
            axis: axes[b],
            distortion: ratio - 1.0,
            lateral_colour_um: 1e3 * (height_mm - primary.chief_height_mm(tan)?),
            spot: spot_of(&bundle, &rim),
            f_numbers: rim.f_numbers(),
            window_px: bundle.window_px(energy, film_pitch_um, MAX_WINDOW_PX),
            light_inside: 0.0,
        };
        Ok((figures, bundle))
    };
    let mut found: Vec<Result<(RayFigures, Bundle), DesignError>> =
        places.par_iter().map(|(b, h)| one(*b, *h)).collect();
    for wavelength in found.chunks_mut(heights_mm.len().max(1)) {
        let windows = wavelength.iter().flatten().map(|(f, _)| f.window_px);
        let window_px = windows.max_by_key(|w| w.unwrap_or(usize::MAX)).flatten();
        for (figures, bundle) in wavelength.iter_mut().flatten() {
            figures.window_px = window_px;
            let half_um = 0.5 * film_pitch_um * window_px.unwrap_or(MAX_WINDOW_PX) as f64;
            figures.light_inside = 1.0 - bundle.light_outside(half_um);
        }
    }
    Ok(found.into_iter().map(|f| f.map(|(figures, _)| figures)).collect())
}
