//! Lenses of a batch: each is built from drawn values, adjusted, and compared with the nominal lens, adjusted alike.
//!
//! ```text
//! boresight   C(0) − C₀(0)                          C(t), C₀(t): chief ray of the built and of the nominal lens on the film, t slopes
//! beyond it   max |C(t_k) − C₀(t_k) − boresight|    t_k: the fields of the criterion's places in the nominal lens
//! light       max |R(X_k) − R₀(X_k)|                R at the places themselves
//! ```
//! All at the primary wavelength. A lens fails if a field has no chief ray, or less than a hundredth of the nominal lens's light.

use super::compensate::{Compensated, compensate};
use super::fields::{Colours, Field, in_parallel};
use super::figures::LensFigures;
use super::set::Tolerances;
use super::settings::{Compensation, Criterion};
use crate::design::prescription::system::System;
use crate::design::skew::error::SkewError;
use crate::design::skew::illumination::light_within;
use crate::design::skew::system::BuiltLens;
use crate::design::skew::trace::SkewTracer;
use crate::design::skew::trace_map::solid_angle_sr;
use crate::real;

/// Least light of a field, of that of the nominal lens.
const LEAST_LIGHT: f64 = 0.01;

/// Why a lens has no figures.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum LensFailure {
    /// A field that the lens does not image.
    #[error(transparent)]
    Skew(#[from] SkewError),
    /// A field whose light is lost.
    #[error("more than 99 % of the light at ({x_mm:.4}, {y_mm:.4}) mm of the film is lost")]
    Dark {
        /// Film place, mm.
        x_mm: f64,
        /// Film place, mm.
        y_mm: f64,
    },
}

/// What all lenses of a batch share.
pub struct Batch<'a> {
    system: &'a System,
    tolerances: &'a Tolerances,
    compensation: Compensation,
    criterion: &'a Criterion,
    corner_mm: f64,
    nominal: Nominal,
}

/// The nominal lens after its adjustment.
struct Nominal {
    places: Vec<[f64; 2]>,
    slopes: Vec<[f64; 2]>,
    /// Chief ray of t = 0, mm.
    centre_mm: [f64; 2],
    /// G of the film's centre, sr, and of the places over it.
    light_sr: f64,
    relative_illumination: Vec<f64>,
}

/// A lens with its figures.
#[derive(Clone, Debug)]
pub struct AssessedLens {
    /// The lens after its adjustment.
    pub compensated: Compensated,
    /// Spots, wavefronts, MTF.
    pub figures: LensFigures,
    /// Boresight, mm in the film frame.
    pub boresight_mm: [f64; 2],
    /// Largest shift of an image point beyond the boresight, mm.
    pub shift_mm: f64,
    /// Largest change of the relative illumination.
    pub illumination_change: f64,
}

impl<'a> Batch<'a> {
    /// Lenses of `system` with `tolerances`, on a film whose corner is `corner_mm` from its centre.
    ///
    /// # Errors
    /// The nominal lens does not image a place of the criterion.
    pub fn new(
        system: &'a System,
        tolerances: &'a Tolerances,
        compensation: Compensation,
        criterion: &'a Criterion,
        corner_mm: f64,
    ) -> Result<Self, SkewError> {
        let adjusted = compensate(&BuiltLens::new(system, &[])?, &compensation, criterion, corner_mm)?;
        let places = criterion.fields.places(corner_mm);
        let colours = Colours::new(&adjusted.lens)?;
        let tracer = colours.primary();
        let light_sr = solid_angle_sr(tracer)?;
        let fields = colours.fields(&places)?;
        let light = in_parallel(&fields, |field| light_of(tracer, field))?;
        let nominal = Nominal {
            places,
            slopes: fields.iter().map(|f| f.t).collect(),
            centre_mm: tracer.chief([0.0; 2])?.at_mm,
            light_sr,
            relative_illumination: light.iter().map(|sr| sr / light_sr).collect(),
        };
        Ok(Self { system, tolerances, compensation, criterion, corner_mm, nominal })
    }

    /// The places of the criterion, mm.
    pub fn places(&self) -> &[[f64; 2]] {
        &self.nominal.places
    }

    /// The lens of these values, one a parameter, adjusted, with its figures.
    ///
    /// # Errors
    /// A field without chief ray or light.
    pub fn assess(&self, values: &[f64]) -> Result<AssessedLens, LensFailure> {
        let drawn = BuiltLens::new(self.system, &self.tolerances.deviations(values))?;
        let compensated = compensate(&drawn, &self.compensation, self.criterion, self.corner_mm)?;
        let colours = Colours::new(&compensated.lens)?;
        let fields = colours.fields(&self.nominal.places)?;
        let illumination_change = self.illumination_change(colours.primary(), &fields)?;
        let figures = self.criterion.figures_of(&colours, &fields)?;
        let (boresight_mm, shift_mm) = self.shift(colours.primary())?;
        drop(colours);
        Ok(AssessedLens { compensated, figures, boresight_mm, shift_mm, illumination_change })
    }

    /// Boresight, and the largest shift beyond it, mm.
    fn shift(&self, tracer: &SkewTracer<'_>) -> Result<([f64; 2], f64), SkewError> {
        let nominal = &self.nominal;
        let difference = |t: [f64; 2], [x, y]: [f64; 2]| -> Result<[f64; 2], SkewError> {
            let at = tracer.chief(t)?.at_mm;
            Ok([at[0] - x, at[1] - y])
        };
        let boresight = difference([0.0; 2], nominal.centre_mm)?;
        let mut largest = 0.0_f64;
        for (t, place) in std::iter::zip(&nominal.slopes, &nominal.places) {
            let [x, y] = difference(*t, *place)?;
            largest = largest.max(real::hypot(x - boresight[0], y - boresight[1]));
        }
        Ok((boresight, largest))
    }

    fn illumination_change(&self, tracer: &SkewTracer<'_>, fields: &[Field]) -> Result<f64, LensFailure> {
        let nominal = &self.nominal;
        let centre_sr = solid_angle_sr(tracer)?;
        let light = in_parallel(fields, |field| light_of(tracer, field))?;
        let mut largest = 0.0_f64;
        for ((sr, before), [x_mm, y_mm]) in
            light.iter().zip(&nominal.relative_illumination).zip(nominal.places.iter().copied())
        {
            if *sr < LEAST_LIGHT * before * nominal.light_sr {
                return Err(LensFailure::Dark { x_mm, y_mm });
            }
            largest = largest.max((sr / centre_sr - before).abs());
        }
        Ok(largest)
    }
}

/// G of a field, sr.
fn light_of(tracer: &SkewTracer<'_>, field: &Field) -> Result<f64, SkewError> {
    Ok(light_within(tracer, field.t, &tracer.chief(field.t)?, &field.opening)?.irradiance_sr)
}
