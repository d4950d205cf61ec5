//! Light as it is requested, in lux, candela and degrees, and as a file describes it.

use super::environment::Environment;
use super::{Cone, Lighting, Source, cosine_directions};
use crate::real;
use crate::scene::description::{Light, LightKind};
use crate::scene::horizon::{Horizon, placed, rotated};
use crate::scene::pose::Pose;
use crate::scene::vector::{scaled, unit};
use crate::scene::weights::LightSpectrum;
use std::f64::consts::FRAC_PI_2;

/// A distant source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Degrees clockwise from north; see [`Horizon`].
    pub azimuth_deg: f64,
    /// Degrees above the horizon, −90 to 90.
    pub elevation_deg: f64,
    /// Illuminance on a plane perpendicular to its rays, lx.
    pub illuminance_lx: f64,
}

/// What lights a scene; without sun, sky and lights it is the illuminant, the same everywhere.
pub struct LightRequest<'a> {
    /// Illuminance of the scene, to which weights are relative, lx.
    pub illuminance_lx: f64,
    /// Sun.
    pub sun: Option<Sun>,
    /// Illuminance below an open sky, lx.
    pub sky_lx: Option<f64>,
    /// Lights of the file.
    pub lights: &'a [Light],
    /// Length of a unit of the file's coordinates, m.
    pub unit_m: f64,
    /// A map of the light from all directions.
    pub environment: Option<Environment>,
    /// Directions in which the sky and the map are sampled: 1, 4, 16 or 64.
    pub sky_samples: usize,
}

/// Light that cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LightError {
    /// A quantity out of range.
    #[error("{what} is {found}; expected {expected}")]
    Value {
        /// The quantity and its unit.
        what: String,
        /// As given.
        found: f64,
        /// Allowed values.
        expected: &'static str,
    },
    /// A light of the file.
    #[error("light `{name}`: {what}")]
    OfFile {
        /// Its name.
        name: String,
        /// What is wrong.
        what: &'static str,
    },
}

impl Lighting {
    /// Light for a camera.
    ///
    /// # Errors
    /// [`LightError`] for numbers out of range, a light of the file without direction or of negative intensity.
    pub fn new(request: LightRequest<'_>, pose: &Pose, horizon: &Horizon) -> Result<Self, LightError> {
        let e_v = at_least_zero("the illuminance in lx", request.illuminance_lx)?;
        if e_v == 0.0 {
            let what = "the illuminance in lx".into();
            return Err(LightError::Value { what, found: e_v, expected: "a positive number" });
        }
        let mut all = Self::even(e_v);
        if let Some(sun) = request.sun {
            let lx = at_least_zero("the illuminance of the sun in lx", sun.illuminance_lx)?;
            for (what, found, limit, expected) in [
                ("the azimuth of the sun in degrees", sun.azimuth_deg, 360.0, "−360 to 360"),
                ("the elevation of the sun in degrees", sun.elevation_deg, 90.0, "−90 to 90"),
            ] {
                if !(-limit..=limit).contains(&found) {
                    return Err(LightError::Value { what: what.into(), found, expected });
                }
            }
            let to_source = horizon.direction(sun.azimuth_deg, sun.elevation_deg);
            all.sources.push((Source::Distant { to_source, relative: lx / e_v }, 0));
        }
        for light in request.lights {
            let (source, colour, largest) = of_file(light, request.unit_m, e_v, pose)?;
            if largest > 0.0 {
                let spectrum = all.spectrum_of(colour);
                all.sources.push((source, spectrum));
            }
        }
        if let Some(lx) = request.sky_lx {
            all.sky = at_least_zero("the illuminance of the sky in lx", lx)? / e_v;
        }
        let has_sky = request.sky_lx.is_some() || request.environment.is_some();
        if let Some(map) = request.environment {
            let primaries = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            all.environment = Some((map, primaries.map(|colour| all.spectrum_of(colour))));
        }
        all.is_even = !has_sky && request.sun.is_none() && request.lights.is_empty();
        if has_sky {
            let error = || LightError::Value {
                what: "the number of directions of the sky".into(),
                found: request.sky_samples as f64,
                expected: "1, 4, 16 or 64",
            };
            all.directions = cosine_directions(request.sky_samples).ok_or_else(error)?;
        }
        Ok(all)
    }

    /// Number of the spectrum of a light of this linear colour, whose largest component is 1.
    fn spectrum_of(&mut self, colour: [f64; 3]) -> usize {
        let spectrum =
            if colour == [1.0; 3] { LightSpectrum::Illuminant } else { LightSpectrum::Colour(colour) };
        self.spectra.iter().position(|s| *s == spectrum).unwrap_or_else(|| {
            self.spectra.push(spectrum);
            self.spectra.len() - 1
        })
    }
}

fn at_least_zero(what: &str, found: f64) -> Result<f64, LightError> {
    if found >= 0.0 && found.is_finite() {
        return Ok(found);
    }
    Err(LightError::Value { what: what.into(), found, expected: "0 or a positive number" })
}

/// A light of the file; its colour divided by the largest component, which its intensity is multiplied by; and that component.
fn of_file(light: &Light, unit_m: f64, e_v: f64, pose: &Pose) -> Result<(Source, [f64; 3], f64), LightError> {
    let error = |what| LightError::OfFile { name: light.name.clone(), what };
    let colour = light.colour.map(f64::from);
    if !(light.intensity >= 0.0
        && light.intensity.is_finite()
        && colour.iter().all(|c| (0.0..=1.0).contains(c)))
    {
        return Err(error("intensity and colour must be numbers, 0 or more, the colour at most 1"));
    }
    let largest = colour.iter().copied().fold(0.0, f64::max);
    let relative = light.intensity * largest / e_v;
    let column = |c: usize| [light.to_world[0][c], light.to_world[1][c], light.to_world[2][c]];
    // It shines along −Z.
    let backward = || unit(rotated(pose, column(2))).ok_or_else(|| error("its matrix gives it no direction"));
    let near = |range_m: Option<f64>, cone| {
        if range_m.is_some_and(|r| r.is_nan() || r <= 0.0) {
            return Err(error("its range must be positive"));
        }
        let place = placed(pose, scaled(column(3), unit_m));
        Ok(Source::Near { place, relative, range_m, cone })
    };
    let source = match light.kind {
        LightKind::Directional => Source::Distant { to_source: backward()?, relative },
        LightKind::Point(range_m) => near(range_m, None)?,
        LightKind::Spot(inner, outer, range_m) => {
            if !(0.0 <= inner && inner < outer && outer <= FRAC_PI_2) {
                return Err(error("the half angles of its cone must increase, from 0 to 90 degrees"));
            }
            let (cos_inner, cos_outer) = (real::cos(inner), real::cos(outer));
            let scale = 1.0 / (cos_inner - cos_outer).max(0.001);
            let axis = scaled(backward()?, -1.0);
            near(range_m, Some(Cone { axis, scale, offset: -cos_outer * scale }))?
        }
    };
    Ok((source, colour.map(|c| if largest > 0.0 { c / largest } else { 0.0 }), largest))
}
