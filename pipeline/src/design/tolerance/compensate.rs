//! Adjustment of a built lens: its film is focused, tilted if asked for, and moved sideways if asked for.
//!
//! With ρ the places of rays on the film, s their slopes behind the lens, means over a field's light of all wavelengths, and the
//! film moved by δ along its normal where the field lands, the mean square radius of the spots is
//!
//! ```text
//! Σ w |ρ − ρ̄ + (s − s̄) δ|²,   δ = dz,  or  δ = dz + αx y − αy x  with the tilt of the film,   y = −Y
//! ```
//! least at dz = −Σ w (ρ − ρ̄)·(s − s̄)/Σ w |s − s̄|², or at the solution of the normal equations in (dz, αx, αy). Real rays are
//! straight there, and the second of two such steps accounts for the fields having moved. For an MTF as criterion its mean is then
//! maximised by golden section within ± 2 λ N² of that focus (λ the primary wavelength, N the working F-number of the nominal
//! lens), and again around an end of that range if it is greatest there.
//!
//! Errors of the film's place along the light are those of its mount AFTER focusing: the shift of a film error is left out when the
//! lens is focused, and acts on the result. Its tilt and decentre are there from the beginning. The lens without errors is focused
//! like any other: its shift is that from the film of the design to the focus of the criterion.

use super::fields::{Colours, Field, FilmBundle, in_parallel};
use super::focus_mtf::FocusMtf;
use super::settings::{Boresight, Compensation, Criterion, CriterionKind};
use crate::design::skew::deviation::Deviation;
use crate::design::skew::error::SkewError;
use crate::design::skew::system::BuiltLens;
use crate::design::skew::trace_map::without_boresight;

/// Rings and spokes of the rays of a spot that focus it.
const FOCUS_RAYS: [usize; 3] = [6, 16, 0];
/// Steps of least squares.
const STEPS: usize = 2;
/// A pivot below this, of the greatest, is that of a tilt which no field determines.
const PIVOT: f64 = 1e-9;
/// Range of the search for the greatest MTF, of λ N², and its accuracy.
const SEARCH: f64 = 2.0;
const SEARCH_ACCURACY: f64 = 0.01;
/// Ranges that are searched, each around the greatest MTF of the one before, if that is at an end.
const SEARCHES: usize = 4;

/// A built lens after its adjustment.
#[derive(Clone, Debug)]
pub struct Compensated {
    /// The lens with its film as adjusted.
    pub lens: BuiltLens,
    /// Shift of the film along the light, mm.
    pub film_shift_mm: f64,
    /// Tilt of the film about x and y of the lens frame, right-handed, rad.
    pub film_tilt_rad: [f64; 2],
    /// Shift of the film sideways that removes the boresight, mm, film frame; 0 if it is kept.
    pub boresight_mm: [f64; 2],
    /// Whether the shift is at its limit.
    pub at_limit: bool,
    /// What the user may want to know.
    pub notes: Vec<String>,
}

/// Adjusts `lens`, drawn but not compensated, for the criterion's fields on a film whose corner is `corner_mm` from its centre.
///
/// # Errors
/// A field without chief ray or light.
pub fn compensate(
    lens: &BuiltLens,
    compensation: &Compensation,
    criterion: &Criterion,
    corner_mm: f64,
) -> Result<Compensated, SkewError> {
    let places = criterion.fields.places(corner_mm);
    let mut focus = Focus::new(lens, compensation)?;
    let mut fields = Colours::new(&focus.lens)?.fields(&places)?;
    for _ in 0..STEPS {
        focus.step(&mut fields)?;
    }
    if let (Some(_), CriterionKind::Mtf { frequency_per_mm }) = (focus.limits_mm, criterion.kind) {
        focus.search(&mut fields, frequency_per_mm)?;
    }
    let mut built = lens.with(&focus.film())?;
    let mut boresight_mm = [0.0; 2];
    if compensation.boresight == Boresight::Remove {
        (built, boresight_mm) = without_boresight(&built)?;
    }
    Ok(Compensated {
        lens: built,
        film_shift_mm: focus.shift_mm,
        film_tilt_rad: focus.tilt_rad,
        boresight_mm,
        at_limit: focus.is_at_limit(),
        notes: focus.notes(),
    })
}

/// The adjustment so far.
struct Focus {
    /// The lens without the shift of its film's mount.
    lens: BuiltLens,
    /// Whether the light goes along z of the lens frame where it meets the film, 1 or −1.
    direction: f64,
    limits_mm: Option<(f64, f64)>,
    has_tilt: bool,
    is_tilt_undetermined: bool,
    shift_mm: f64,
    tilt_rad: [f64; 2],
}

impl Focus {
    fn new(lens: &BuiltLens, compensation: &Compensation) -> Result<Self, SkewError> {
        let mut deviations = lens.deviations().to_vec();
        let mut has_shift = false;
        for deviation in &mut deviations {
            if let Deviation::Film { shift_mm, .. } = deviation {
                has_shift |= *shift_mm != 0.0;
                *shift_mm = 0.0;
            }
        }
        let nominal = lens.nominal();
        Ok(Self {
            lens: if has_shift { BuiltLens::new(nominal, &deviations)? } else { lens.clone() },
            direction: nominal.axis()[nominal.image()].1,
            limits_mm: compensation.focus_um.map(|(low, high)| (low * 1e-3, high * 1e-3)),
            has_tilt: compensation.film_tilt,
            is_tilt_undetermined: false,
            shift_mm: 0.0,
            tilt_rad: [0.0; 2],
        })
    }

    /// The adjustment as an error of the film, none if there is none.
    fn film(&self) -> Vec<Deviation> {
        let film = Deviation::Film {
            decentre_mm: [0.0; 2],
            tilt_rad: self.tilt_rad,
            shift_mm: self.direction * self.shift_mm,
        };
        let is_moved = self.shift_mm != 0.0 || self.tilt_rad != [0.0; 2];
        if is_moved { vec![film] } else { Vec::new() }
    }

    /// One step of least squares.
    fn step(&mut self, fields: &mut Vec<Field>) -> Result<(), SkewError> {
        let is_free = [self.limits_mm.is_some(), self.has_tilt, self.has_tilt];
        if is_free == [false; 3] {
            return Ok(());
        }
        let lens = self.lens.with(&self.film())?;
        let colours = Colours::new(&lens)?;
        *fields = colours.followed(fields)?;
        let spots = in_parallel(fields, |field| spot_sums(&colours, field))?;
        let (mut matrix, mut right) = ([[0.0; 3]; 3], [0.0; 3]);
        for (field, [square, cross]) in fields.iter().zip(spots) {
            let by = [1.0, -self.direction * field.place[1], -self.direction * field.place[0]];
            for i in 0..3 {
                right[i] -= cross * by[i];
                for j in 0..3 {
                    matrix[i][j] += square * by[i] * by[j];
                }
            }
        }
        let (step, is_determined) = solve(matrix, right, is_free);
        self.is_tilt_undetermined = self.has_tilt && !is_determined;
        let limited = self.limited(self.shift_mm + step[0]);
        let mut tilt = [step[1], step[2]];
        if limited != self.shift_mm + step[0] {
            // The tilt with the shift at its limit.
            let shift = limited - self.shift_mm;
            let rest = [0, 1, 2].map(|i| right[i] - matrix[i][0] * shift);
            let (step, _) = solve(matrix, rest, [false, is_free[1], is_free[2]]);
            tilt = [step[1], step[2]];
        }
        self.shift_mm = limited;
        self.tilt_rad = [self.tilt_rad[0] + tilt[0], self.tilt_rad[1] + tilt[1]];
        Ok(())
    }

    /// To the greatest mean MTF.
    fn search(&mut self, fields: &mut Vec<Field>, frequency_per_mm: f64) -> Result<(), SkewError> {
        let lens = self.lens.with(&self.film())?;
        let colours = Colours::new(&lens)?;
        let depth_mm =
            colours.primary().primary.working_f_number().powi(2) * 1e-3 * lens.nominal().primary_um();
        let (half_mm, accuracy_mm) = (SEARCH * depth_mm, SEARCH_ACCURACY * depth_mm);
        let reach_mm = SEARCHES as f64 * half_mm;
        *fields = colours.followed(fields)?;
        let mtf = |field: &Field| FocusMtf::trace(&colours, field, frequency_per_mm, reach_mm);
        let curves = in_parallel(fields, mtf)?;
        let mean = |shift: f64| -> f64 { curves.iter().map(|f| f.mean(shift)).sum() };
        let mut found = 0.0;
        for _ in 0..SEARCHES {
            let ends = [found - half_mm, found + half_mm];
            let before = found;
            found = greatest(
                mean,
                ends.map(|end| self.limited(self.shift_mm + end) - self.shift_mm),
                accuracy_mm,
            );
            if (found - before).abs() < half_mm - accuracy_mm {
                break;
            }
        }
        self.shift_mm = self.limited(self.shift_mm + found);
        Ok(())
    }

    fn limited(&self, shift_mm: f64) -> f64 {
        self.limits_mm.map_or(0.0, |(low, high)| shift_mm.clamp(low, high))
    }

    fn is_at_limit(&self) -> bool {
        self.limits_mm.is_some_and(|(low, high)| self.shift_mm <= low || self.shift_mm >= high)
    }

    fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if let Some((low, high)) = self.limits_mm.filter(|_| self.is_at_limit()) {
            notes.push(format!(
                "the film shift is at its limit of {:+.1} µm ({:.1} to {:.1} µm): the best focus lies beyond it",
                1e3 * self.shift_mm,
                1e3 * low,
                1e3 * high
            ));
        }
        if self.is_tilt_undetermined {
            notes.push(
                "the fields of the criterion do not determine the tilt of the film: they need places that are not on one line"
                    .to_owned(),
            );
        }
        notes
    }
}

/// Σ w |s − s̄|² and Σ w (ρ − ρ̄)·(s − s̄) of the spot of a field.
fn spot_sums(colours: &Colours<'_>, field: &Field) -> Result<[f64; 2], SkewError> {
    let mut rays = Vec::new();
    for (tracer, weight) in &colours.tracers {
        if *weight == 0.0 {
            continue;
        }
        let bundle = FilmBundle::trace(tracer, field, FOCUS_RAYS)?;
        rays.extend(bundle.rays.iter().map(|r| (weight * r.weight, r.at_mm, r.slopes())));
    }
    let mut mean = [[0.0; 2]; 2];
    for (w, at, slopes) in &rays {
        for i in 0..2 {
            mean[0][i] += w * at[i];
            mean[1][i] += w * slopes[i];
        }
    }
    let (mut square, mut cross) = (0.0, 0.0);
    for (w, at, slopes) in &rays {
        for i in 0..2 {
            let s = slopes[i] - mean[1][i];
            square += w * s * s;
            cross += w * (at[i] - mean[0][i]) * s;
        }
    }
    Ok([square, cross])
}

/// The solution of the equations of the unknowns that are free, all others 0, by elimination; unknowns that the matrix, which is
/// positive semidefinite, does not determine are 0. Whether it determines all.
fn solve(matrix: [[f64; 3]; 3], right: [f64; 3], is_free: [bool; 3]) -> ([f64; 3], bool) {
    let free: Vec<usize> = (0..3).filter(|i| is_free[*i]).collect();
    let mut rows: Vec<Vec<f64>> =
        free.iter().map(|i| free.iter().map(|j| matrix[*i][*j]).chain([right[*i]]).collect()).collect();
    let n = free.len();
    let mut is_known = vec![true; n];
    for k in 0..n {
        is_known[k] = rows[k][k] > PIVOT * matrix[free[k]][free[k]];
        if !is_known[k] {
            continue;
        }
        let pivot = rows[k].clone();
        for (_, row) in rows.iter_mut().enumerate().filter(|(i, _)| *i != k) {
            let part = row[k] / pivot[k];
            row.iter_mut().zip(&pivot).for_each(|(v, p)| *v -= part * p);
        }
    }
    let mut solution = [0.0; 3];
    for k in (0..n).filter(|k| is_known[*k]) {
        solution[free[k]] = rows[k][n] / rows[k][k];
    }
    (solution, is_known.iter().all(|known| *known))
}

/// Where `value` is greatest between the ends of `range`, to `accuracy`, by golden section.
fn greatest(value: impl Fn(f64) -> f64, [mut low, mut high]: [f64; 2], accuracy: f64) -> f64 {
    const SECTION: f64 = 0.618_033_988_749_894_9;
    let (mut a, mut b) = (high - SECTION * (high - low), low + SECTION * (high - low));
    let (mut at_a, mut at_b) = (value(a), value(b));
    while high - low > accuracy {
        if at_a >= at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - SECTION * (high - low);
            at_a = value(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + SECTION * (high - low);
            at_b = value(b);
        }
    }
    0.5 * (low + high)
}
