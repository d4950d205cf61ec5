//! Lenses of a batch against the nominal lens, first order and closed forms.

use super::super::*;
use super::lens_figures::{criterion, double_gauss};
use super::of;
use crate::design::skew::deviation::Deviation;
use crate::design::skew::system::BuiltLens;
use crate::design::system::RayAiming;

const PLACES: [[f64; 2]; 5] = [[0.0, 0.0], [12.0, 0.0], [0.0, 12.0], [-12.0, 0.0], [0.0, -12.0]];

fn tolerances(list: &[Tolerance]) -> Tolerances {
    Tolerances::new(list, 546.1, &double_gauss()).unwrap()
}

#[test]
fn no_errors_change_nothing() {
    let (system, spot) = (double_gauss(), criterion(CriterionKind::RmsSpot, &PLACES));
    let set = tolerances(&[
        of(Target::Film, Quantity::Shift, 10.0),
        of(Target::element(7, 9), Quantity::Shift, 10.0),
    ]);
    for boresight in [Boresight::Keep, Boresight::Remove] {
        let compensation = Compensation { boresight, ..Compensation::default() };
        let batch = Batch::new(&system, &set, compensation, &spot, 20.0).unwrap();
        let found = batch.assess(&[0.0, 0.0]).unwrap();
        assert!(found.shift_mm < 1e-12 && found.illumination_change < 1e-12, "{found:?}");
        assert!(found.boresight_mm.iter().all(|v| v.abs() < 1e-12));
    }
}

/// A film that is decentred and a film that is tilted, in closed form: the boresight is the decentre, the picture moves the other
/// way; with the film tilted by b about y the place x is seen at x (1 + x tan b/z + …), z the distance to the exit pupil.
#[test]
fn film_errors_in_closed_form() {
    let (system, spot) = (double_gauss(), criterion(CriterionKind::RmsSpot, &PLACES));
    let list = [
        of(Target::Film, Quantity::Decentre(Direction::X), 30.0),
        of(Target::Film, Quantity::Tilt(Direction::Y), 5.0),
    ];
    let set = tolerances(&list);
    let batch =
        Batch::new(&system, &set, Compensation { focus_um: None, ..Compensation::default() }, &spot, 20.0);
    let batch = batch.unwrap();
    let decentred = batch.assess(&[30.0, 0.0]).unwrap();
    assert!((decentred.boresight_mm[0] + 0.03).abs() < 1e-12 && decentred.boresight_mm[1].abs() < 1e-12);
    assert!(decentred.shift_mm < 1e-12, "{}", decentred.shift_mm);
    let tilted = batch.assess(&[0.0, 5.0]).unwrap();
    assert!(tilted.boresight_mm.iter().all(|v| v.abs() < 1e-12));
    // Slope of the nominal chief ray that lands at x = 12 mm.
    let nominal = BuiltLens::new(&system, &[]).unwrap();
    let tracer = crate::design::skew::trace::SkewTracer::new(&nominal, system.primary_um()).unwrap();
    let ray = tracer.ray(tracer.field_of([12.0, 0.0]).unwrap(), 0.0, 0.0).unwrap();
    let (slope, b) = (ray.l.v / ray.n, 5.0 * std::f64::consts::PI / 10_800.0);
    // z = −x' sin b, x' cos b = 12 + slope z; the farther one of ± b.
    let along = |b: f64| 12.0 / (b.cos() + slope * b.sin()) - 12.0;
    let expected = along(b).abs().max(along(-b).abs());
    assert!((tilted.shift_mm - expected).abs() < 1e-9, "{} {expected}", tilted.shift_mm);
}

/// Film shifts of 100 lenses whose last gap is uniform within ± 30 µm: minus the gap, so their mean and deviation are those of the
/// draws; with the second gap within ± 20 µm also, first order adds the squares of its effect from its derivative.
#[test]
fn film_shifts_have_the_moments_of_first_order() {
    let system = double_gauss();
    let on_axis = criterion(CriterionKind::RmsSpot, &[[0.0, 0.0], [10.0, 0.0]]);
    let gap = |after, um| Tolerance {
        target: Target::Gap { after, absorb: None },
        quantity: Quantity::Thickness,
        limits: Limits::symmetric(um, Law::Uniform),
    };
    let shift = |deviations: &[Deviation]| {
        let lens = BuiltLens::new(&system, deviations).unwrap();
        compensate(&lens, &Compensation::default(), &on_axis, 20.0).unwrap().film_shift_mm
    };
    let thicker = |after, thickness_mm| Deviation::Gap { after, thickness_mm, absorb: None };
    let nominal = shift(&[]);
    // Derivatives by finite differences of 1 µm, surfaces counted from 0.
    let by = [1, 10].map(|after| (shift(&[thicker(after, 1e-3)]) - shift(&[thicker(after, -1e-3)])) / 2e-3);
    assert!((by[1] + 1.0).abs() < 1e-4, "{by:?}");
    let set = tolerances(&[gap(2, 20.0), gap(11, 30.0)]);
    let batch = Batch::new(&system, &set, Compensation::default(), &on_axis, 20.0).unwrap();
    let n = 100;
    let (mut shifts, mut linear) = (Vec::new(), Vec::new());
    for k in 0..n {
        let values = set.draw(3, k);
        shifts.push(Some(batch.assess(&values).unwrap().compensated.film_shift_mm));
        linear.push(nominal + 1e-3 * (by[0] * values[0] + by[1] * values[1]));
    }
    for (shift, linear) in shifts.iter().zip(&linear) {
        assert!((shift.unwrap() - linear).abs() < 2e-5, "{shift:?} {linear}");
    }
    let found = statistics::summary(&shifts).unwrap();
    let variance = [(by[0], 20e-3), (by[1], 30e-3)].map(|(by, half): (f64, f64)| (by * half).powi(2) / 3.0);
    let deviation = (variance[0] + variance[1]).sqrt();
    // Within four deviations of mean and of deviation.
    assert!((found.mean - nominal).abs() < 4.0 * deviation / (n as f64).sqrt(), "{found:?} {nominal}");
    assert!(
        (found.deviation / deviation - 1.0).abs() < 4.0 / (2.0 * n as f64).sqrt(),
        "{found:?} {deviation}"
    );
}

/// A lens whose front element is far off the axis loses its light.
#[test]
fn a_lens_without_light_fails() {
    let mut system = double_gauss();
    system.surfaces[0].aperture_mm = Some(18.0);
    let spot = criterion(CriterionKind::RmsSpot, &[[0.0, 0.0]]);
    let set = tolerances(&[of(Target::element(1, 2), Quantity::Decentre(Direction::X), 40_000.0)]);
    let batch = Batch::new(&system, &set, Compensation::default(), &spot, 20.0).unwrap();
    assert!(batch.assess(&[0.0]).is_ok());
    let failure = batch.assess(&[40_000.0]).unwrap_err();
    assert!(matches!(failure, LensFailure::Skew(_)), "{failure}");
}

/// A stop that is moved by 1.96 of its radius leaves about (2/π) (arccos ν − ν √(1 − ν²)) = 0.3 % of the pupil's area, ν = 0.98.
#[test]
fn a_lens_that_loses_99_percent_of_its_light_fails() {
    let mut system = double_gauss();
    system.aiming = RayAiming::Paraxial;
    let radius_mm = 10.228;
    system.surfaces[5].aperture_mm = Some(radius_mm);
    let spot = criterion(CriterionKind::RmsSpot, &[[0.0, 0.0]]);
    let set = tolerances(&[of(Target::Surface(6), Quantity::Decentre(Direction::Y), 20_000.0)]);
    let none = Compensation { focus_um: None, ..Compensation::default() };
    let batch = Batch::new(&system, &set, none, &spot, 20.0).unwrap();
    let dim = batch.assess(&[1800.0 * radius_mm]);
    assert!(dim.is_ok(), "{dim:?}");
    let failure = batch.assess(&[1960.0 * radius_mm]).unwrap_err();
    assert_eq!(failure, LensFailure::Dark { x_mm: 0.0, y_mm: 0.0 });
}
