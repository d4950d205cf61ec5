//! Relative illumination of a built lens at any place: that of the nominal lens times a smooth ratio.
//!
//! ```text
//! R(X, Y) = q(X, Y) · G₀(|t|) / G(film centre),      q = G(t) / G₀(|t|)       t the field of (X, Y), G₀ of the nominal lens
//! ```
//! G₀ is a table over |t| by the symmetric tracer, accurate where apertures begin to clip; q, which errors of a lens make differ
//! from 1 by less than 1 %, is a spline on a grid of film places, as fine as its error at 200 fixed quasi-random places requires.
//! Where the vignetting of the built lens begins elsewhere than that of the nominal lens, by Δt, q has a small kink: the error
//! there is below Δt times the change of slope.
//!
//! Quasi-random places: the additive recurrence of the plastic number ρ, (k/ρ, k/ρ²) mod 1, ρ³ = ρ + 1.
//! Source: M. Roberts, The unreasonable effectiveness of quasirandom sequences (2018).

use rayon::prelude::*;

use super::chief::Chief;
use super::error::SkewError;
use super::illumination::light_within;
use super::map::FilmRange;
use super::opening::Opening;
use super::trace::SkewTracer;
use crate::design::pupil::Pupil;
use crate::design::pupil::illumination::irradiance_table;
use crate::design::rays::aim::lagrange;
use crate::real;
use crate::spline::tensor::TensorSpline;

/// Samples of q along a side, doubled from the first to the last.
const FIRST_SIDE: usize = 9;
const LAST_SIDE: usize = 33;
/// Share of an error that half the step leaves, at most: a smooth function leaves 1/16, kinks more.
const LEAST_GAIN: f64 = 0.3;
/// Places where errors are determined.
const CHECKS: usize = 200;
/// 1/ρ and 1/ρ².
const STEPS: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2];
/// Intervals of the table of G₀.
const INTERVALS: usize = 1024;
/// Intervals in which changes of the pupil's rims are searched, and bisections of one.
const RIM_INTERVALS: usize = 64;
const RIM_STEPS: u32 = 6;

/// G₀ over |t|.
#[derive(Clone, Debug)]
pub(super) struct NominalLight {
    step: f64,
    /// Empty: 1 everywhere.
    table: Vec<f64>,
    /// |t| where other apertures begin to limit the pupil.
    pub(super) rims: Vec<f64>,
}

impl NominalLight {
    /// Up to the slope `last`; 1 where the nominal lens has no light up to there, and for a design that is asymmetric.
    pub(super) fn new(tracer: &SkewTracer<'_>, last: f64) -> Self {
        if tracer.lens().is_asymmetric_design() {
            return Self { step: 1.0, table: Vec::new(), rims: Vec::new() };
        }
        let nominal = &tracer.nominal;
        let step = last / INTERVALS as f64;
        let tans: Vec<f64> = (0..=INTERVALS).map(|i| step * i as f64).collect();
        let table = irradiance_table(nominal, &tans).unwrap_or_default();
        let pupil = |tan: f64| Pupil::new(nominal, tan).ok();
        let differ = |a: &Option<Pupil>, b: &Option<Pupil>| match (a, b) {
            (Some(a), Some(b)) => !a.has_rims_of(b),
            _ => a.is_some() != b.is_some(),
        };
        let change = |i: usize| {
            let [mut a, mut b] = [i, i + 1].map(|i| last * i as f64 / RIM_INTERVALS as f64);
            let (first, end) = (pupil(a), pupil(b));
            if !differ(&first, &end) {
                return None;
            }
            for _ in 0..RIM_STEPS {
                let middle = 0.5 * (a + b);
                if differ(&first, &pupil(middle)) { b = middle } else { a = middle }
            }
            Some(b)
        };
        let rims = match tracer.has_apertures() || tracer.has_obscurations() {
            true => (0..RIM_INTERVALS).into_par_iter().filter_map(change).collect(),
            false => Vec::new(),
        };
        Self { step, table, rims }
    }

    /// G₀ of the field of slopes `t`, sr: the cubic through the four nearest values.
    fn at(&self, t: [f64; 2]) -> f64 {
        if self.table.is_empty() {
            return 1.0;
        }
        let u = real::hypot(t[0], t[1]) / self.step;
        let first = (u.floor() - 1.0).clamp(0.0, (self.table.len() - 4) as f64) as usize;
        let points: [(f64, f64); 4] = std::array::from_fn(|k| ((first + k) as f64, self.table[first + k]));
        lagrange(&points, u)
    }
}

/// A place of the film with its field and R.
#[derive(Clone, Copy, Debug)]
pub(super) struct Check {
    pub(super) film_mm: [f64; 2],
    pub(super) slopes: [f64; 2],
    pub(super) relative: f64,
}

/// R at any place.
#[derive(Clone, Debug)]
pub(super) struct RelativeLight {
    nominal: NominalLight,
    range: FilmRange,
    side: usize,
    ratio: TensorSpline,
    /// G at the film's centre, sr.
    pub(super) solid_angle_sr: f64,
    /// Largest error of R at the places of the check, away from changes of rims.
    pub(super) error: f64,
    /// Largest error near them.
    pub(super) error_at_rims: f64,
}

impl RelativeLight {
    /// R over `range` within `tolerance` at traced places, except within `near_rims` (slope) of changes of the nominal pupil's
    /// rims; and these places.
    ///
    /// # Errors
    /// A place without chief ray or light.
    pub(super) fn new(
        tracer: &SkewTracer<'_>,
        range: FilmRange,
        tolerance: f64,
        near_rims: f64,
    ) -> Result<(Self, Vec<Check>), SkewError> {
        let light = |(t, chief): ([f64; 2], Chief)| -> Result<f64, SkewError> {
            Ok(light_within(tracer, t, &chief, &Opening::new(tracer, t)?)?.irradiance_sr)
        };
        let solid_angle_sr = light(tracer.field_and_chief([0.0; 2])?)?;
        let check = |k: usize| -> Result<Check, SkewError> {
            let film_mm = range.at(STEPS.map(|step| (0.5 + step * k as f64).fract()));
            let field = tracer.field_and_chief(film_mm)?;
            Ok(Check { film_mm, slopes: field.0, relative: light(field)? / solid_angle_sr })
        };
        let checks: Vec<Check> = (0..CHECKS).into_par_iter().map(check).collect::<Result<_, _>>()?;
        let mut corners = [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]].map(|at| range.at(at)).to_vec();
        corners.push([0.0; 2]);
        let slopes = |film: &[f64; 2]| tracer.field_of(*film).map(|t| real::hypot(t[0], t[1]));
        let last = corners.iter().map(slopes).try_fold(0.0, |last: f64, t| t.map(|t| last.max(t)))?;
        let nominal = NominalLight::new(tracer, 1.001 * last);
        let mut known: Vec<f64> = Vec::new();
        let (mut side, mut before) = (FIRST_SIDE, f64::INFINITY);
        loop {
            let coarse = side.div_ceil(2);
            let sample = |k: usize| -> Result<f64, SkewError> {
                let (i, j) = (k % side, k / side);
                if i % 2 == 0 && j % 2 == 0 && !known.is_empty() {
                    return Ok(known[(j / 2) * coarse + i / 2]);
                }
                let place = range.at([i, j].map(|i| i as f64 / (side - 1) as f64));
                let field = tracer.field_and_chief(place)?;
                Ok(light(field)? / nominal.at(field.0))
            };
            known = (0..side * side).into_par_iter().map(sample).collect::<Result<_, _>>()?;
            let ratio = TensorSpline::new(&known, side);
            let mut found = Self {
                nominal: nominal.clone(),
                range,
                side,
                ratio,
                solid_angle_sr,
                error: 0.0,
                error_at_rims: 0.0,
            };
            for check in &checks {
                let error = (found.at(check.film_mm, check.slopes) - check.relative).abs();
                let kind = match found.is_near_rims(check.slopes, near_rims) {
                    true => &mut found.error_at_rims,
                    false => &mut found.error,
                };
                *kind = kind.max(error);
            }
            let error = found.error;
            if error <= tolerance || error > LEAST_GAIN * before || side == LAST_SIDE {
                return Ok((found, checks));
            }
            (side, before) = (2 * side - 1, error);
        }
    }

    /// R at `film_mm`, where the field of `slopes` lands.
    pub(super) fn at(&self, film_mm: [f64; 2], slopes: [f64; 2]) -> f64 {
        let FilmRange { x_mm, y_mm } = self.range;
        let along = |v: f64, [a, b]: [f64; 2]| (v - a) / (b - a) * (self.side - 1) as f64;
        let [ratio, ..] = self.ratio.at(along(film_mm[1], y_mm), along(film_mm[0], x_mm));
        ratio * self.nominal.at(slopes) / self.solid_angle_sr
    }

    /// Whether the rims of the nominal pupil change within `distance` of the slope |t|.
    pub(super) fn is_near_rims(&self, slopes: [f64; 2], distance: f64) -> bool {
        let tan = real::hypot(slopes[0], slopes[1]);
        self.nominal.rims.iter().any(|rim| (rim - tan).abs() <= distance)
    }
}
