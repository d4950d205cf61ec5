//! Tracing the map of a band: the grid is chosen by its error.
//!
//! Samples: I of chief rays, by Newton's method; R as in `relative_light`. The grid has 17² samples, or 33², … up to 257²: as
//! many as make the spline accurate at fixed quasi-random places, I within a length and R within 1e-5 of traced values, or within
//! 2e-4 near places where other apertures begin to limit the pupil: R has a kink there, which a spline does not follow. Halving
//! the step divides the error by 16, that at a kink by 2. Errors of R as `relative_light` has it are not diminished by a finer
//! grid.

use rayon::prelude::*;

use super::deviation::Deviation;
use super::error::SkewError;
use super::illumination::field_light;
use super::map::{FilmMap, FilmRange};
use super::relative_light::{Check, RelativeLight};
use super::system::BuiltLens;
use super::trace::SkewTracer;
use crate::lens::planar::PlanarMap;

/// Samples along a side that are tried.
const SIDES: [usize; 5] = [17, 33, 65, 129, 257];
/// Maximum error of R, and near changes of the pupil's rims.
const ILLUMINATION: f64 = 1e-5;
const AT_RIMS: f64 = 2e-4;
/// Steps of the grid around a change of rims where the larger error is allowed: the error of a spline falls by 4 from step to
/// step.
const STEPS_AT_RIMS: f64 = 3.0;

/// The map of a band with its errors.
#[derive(Clone, Debug)]
pub struct TracedMap {
    /// The map.
    pub map: FilmMap,
    /// G at the film's centre, sr.
    pub solid_angle_sr: f64,
    /// Largest error of I at the places of the check, mm.
    pub ideal_error_mm: f64,
    /// Largest error of R there, away from changes of the pupil's rims.
    pub illumination_error: f64,
    /// Largest error of R near such changes.
    pub illumination_error_at_rims: f64,
}

impl TracedMap {
    /// As the tables of a band have it.
    pub(super) fn planar(&self) -> PlanarMap {
        let [nx, ny] = self.map.counts();
        let [ideal_x_mm, ideal_y_mm, relative_illumination] = self.map.values().clone();
        PlanarMap {
            x_mm: (0..nx).map(|i| self.map.place([i, 0])[0]).collect(),
            y_mm: (0..ny).map(|j| self.map.place([0, j])[1]).collect(),
            ideal_x_mm,
            ideal_y_mm,
            relative_illumination,
        }
    }
}

/// Traces the map of `range` of the film, with I accurate to `tolerance_mm` (1e-4 of the film's pixel pitch).
///
/// # Errors
/// A place without chief ray or light; a map that folds.
pub fn trace_map(
    tracer: &SkewTracer<'_>,
    range: FilmRange,
    tolerance_mm: f64,
) -> Result<TracedMap, SkewError> {
    let slope_per_step = |side: usize| {
        let sides = [range.x_mm, range.y_mm].map(|[a, b]| (b - a) / (side - 1) as f64);
        sides[0].max(sides[1]) / tracer.ideal_focal_mm()
    };
    let finest = STEPS_AT_RIMS * slope_per_step(SIDES[SIDES.len() - 1]);
    let (light, checks) = RelativeLight::new(tracer, range, 0.5 * ILLUMINATION, finest)?;
    let mapper = Mapper { tracer, range, light };
    let mut level = mapper.first()?;
    loop {
        let near_rims = STEPS_AT_RIMS * slope_per_step(level.counts()[0]);
        let traced = mapper.with_errors(level, &checks, near_rims)?;
        let is_done = traced.ideal_error_mm <= tolerance_mm
            && traced.illumination_error <= ILLUMINATION.max(2.0 * mapper.light.error)
            && traced.illumination_error_at_rims <= AT_RIMS.max(2.0 * mapper.light.error_at_rims);
        let finer = SIDES.iter().copied().find(|side| *side > traced.map.counts()[0]);
        let Some(side) = finer.filter(|_| !is_done) else {
            traced.map.check_folds(tracer.wavelength_um)?;
            return Ok(traced);
        };
        level = mapper.refined(&traced.map, side)?;
    }
}

/// `lens` with its film shifted sideways so that the field t = 0 lands on the film's centre at the primary wavelength, and the
/// shift, mm in the film frame.
///
/// # Errors
/// No chief ray.
pub fn without_boresight(lens: &BuiltLens) -> Result<(BuiltLens, [f64; 2]), SkewError> {
    let [x, y] = SkewTracer::new(lens, lens.nominal().primary_um())?.chief([0.0; 2])?.at_mm;
    let shift = Deviation::Film { decentre_mm: [x, -y], tilt_rad: [0.0; 2], shift_mm: 0.0 };
    Ok((lens.with(&[shift])?, [x, y]))
}

/// G at the film's centre, sr: the denominator of R.
///
/// # Errors
/// No chief ray or no light there.
pub fn solid_angle_sr(tracer: &SkewTracer<'_>) -> Result<f64, SkewError> {
    Ok(field_light(tracer, tracer.field_of([0.0; 2])?)?.irradiance_sr)
}

struct Mapper<'a> {
    tracer: &'a SkewTracer<'a>,
    range: FilmRange,
    light: RelativeLight,
}

impl Mapper<'_> {
    /// The map of the slopes at each sample of a grid of `side`².
    fn map(&self, side: usize, slopes: &[[f64; 2]]) -> Result<FilmMap, SkewError> {
        let ideal = |i: usize| slopes.iter().map(|t| self.tracer.ideal_point_mm(*t)[i]).collect();
        let light = slopes.iter().enumerate().map(|(k, t)| self.light.at(self.place(k, side), *t));
        let beyond = SkewError::Beyond { x_mm: self.range.x_mm[0], y_mm: self.range.y_mm[0] };
        FilmMap::new(self.range, [side; 2], [ideal(0), ideal(1), light.collect()]).ok_or(beyond)
    }

    /// Place of sample `k` of a grid of `side`².
    fn place(&self, k: usize, side: usize) -> [f64; 2] {
        self.range.at([k % side, k / side].map(|i| i as f64 / (side - 1) as f64))
    }

    fn first(&self) -> Result<FilmMap, SkewError> {
        let side = SIDES[0];
        let slopes = (0..side * side).into_par_iter().map(|k| self.tracer.field_of(self.place(k, side)));
        self.map(side, &slopes.collect::<Result<Vec<_>, _>>()?)
    }

    /// The map on a grid of `side`², twice as fine, from the fields of `coarse`.
    fn refined(&self, coarse: &FilmMap, side: usize) -> Result<FilmMap, SkewError> {
        let [ideal_x, ideal_y, _] = coarse.values();
        let slopes = |k: usize| -> Result<[f64; 2], SkewError> {
            let (i, j) = (k % side, k / side);
            if i % 2 == 0 && j % 2 == 0 {
                let old = (j / 2) * coarse.counts()[0] + i / 2;
                return Ok(self.tracer.slopes_of_ideal([ideal_x[old], ideal_y[old]]));
            }
            let place = self.place(k, side);
            let near = self.tracer.slopes_of_ideal(coarse.at(place)?.ideal_mm);
            Ok(self.tracer.field_near(place, near)?.0)
        };
        self.map(side, &(0..side * side).into_par_iter().map(slopes).collect::<Result<Vec<_>, _>>()?)
    }

    fn with_errors(&self, map: FilmMap, checks: &[Check], near_rims: f64) -> Result<TracedMap, SkewError> {
        let (mut ideal_error_mm, mut illumination_error, mut at_rims) = (0.0_f64, 0.0_f64, 0.0_f64);
        for check in checks {
            let (found, ideal) = (map.at(check.film_mm)?, self.tracer.ideal_point_mm(check.slopes));
            for (found, ideal) in found.ideal_mm.iter().zip(ideal) {
                ideal_error_mm = ideal_error_mm.max((found - ideal).abs());
            }
            let error = (found.relative_illumination - check.relative).abs();
            match self.light.is_near_rims(check.slopes, near_rims) {
                true => at_rims = at_rims.max(error),
                false => illumination_error = illumination_error.max(error),
            }
        }
        Ok(TracedMap {
            map,
            solid_angle_sr: self.light.solid_angle_sr,
            ideal_error_mm,
            illumination_error,
            illumination_error_at_rims: at_rims,
        })
    }
}
