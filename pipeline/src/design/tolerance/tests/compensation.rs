//! Films that are put back, limits, and what is left where nothing was wrong.

use super::super::*;
use super::lens_figures::{criterion, double_gauss, errors};
use crate::design::skew::deviation::Deviation;
use crate::design::skew::system::BuiltLens;
use crate::design::skew::trace::SkewTracer;

const PLACES: [[f64; 2]; 5] = [[0.0, 0.0], [12.0, 0.0], [0.0, 12.0], [-12.0, 0.0], [0.0, -12.0]];

fn focused(lens: &BuiltLens, compensation: &Compensation) -> Compensated {
    compensate(lens, compensation, &criterion(CriterionKind::RmsSpot, &PLACES), 20.0).unwrap()
}

fn last_gap(thickness_mm: f64) -> Deviation {
    Deviation::Gap { after: 10, thickness_mm, absorb: None }
}

fn film(tilt_rad: [f64; 2], shift_mm: f64) -> Deviation {
    Deviation::Film { decentre_mm: [0.0; 2], tilt_rad, shift_mm }
}

/// `focus_shift` of fields_reference.py, twice, for `double_gauss()` with `ERRORS` and the places of `figures_gold.py`.
#[test]
fn two_steps_of_focus_are_those_of_the_model() {
    let built = BuiltLens::new(&double_gauss(), &errors()).unwrap();
    let places = [[0.0, 0.0], [10.0, -4.0], [-13.0, 13.0]];
    let found =
        compensate(&built, &Compensation::default(), &criterion(CriterionKind::RmsSpot, &places), 20.0)
            .unwrap();
    let expected = -0.028308933610258463;
    assert!((found.film_shift_mm - expected).abs() < 1e-8, "{} {expected}", found.film_shift_mm);
    assert_eq!((found.at_limit, found.film_tilt_rad, found.boresight_mm), (false, [0.0; 2], [0.0; 2]));
}

#[test]
fn a_film_out_of_place_is_put_back() {
    let system = double_gauss();
    let free = Compensation::default();
    let nominal = focused(&BuiltLens::new(&system, &[]).unwrap(), &free);
    for error_mm in [-0.3, 0.02, 0.3] {
        let found = focused(&BuiltLens::new(&system, &[last_gap(error_mm)]).unwrap(), &free);
        let left = found.film_shift_mm + error_mm - nominal.film_shift_mm;
        assert!(left.abs() < 1e-4, "{error_mm}: {left:e}");
    }
    // The shift of the film's mount acts after focusing.
    let found = focused(&BuiltLens::new(&system, &[film([0.0; 2], 0.05)]).unwrap(), &free);
    assert_eq!(found.film_shift_mm, nominal.film_shift_mm);
    let z = |c: &Compensated| c.lens.poses()[11].origin_mm[2];
    assert!((z(&found) - z(&nominal) - 0.05).abs() < 1e-12);
}

#[test]
fn a_tilted_film_is_tilted_back() {
    let system = double_gauss();
    let free = Compensation { film_tilt: true, ..Compensation::default() };
    let tilt = [2e-3, -1.3e-3];
    let found = focused(&BuiltLens::new(&system, &[film(tilt, 0.0)]).unwrap(), &free);
    for (back, error) in found.film_tilt_rad.iter().zip(tilt) {
        assert!((back + error).abs() < 2e-6, "{:?}", found.film_tilt_rad);
    }
    let nominal = focused(&BuiltLens::new(&system, &[]).unwrap(), &free);
    assert!(nominal.film_tilt_rad.iter().all(|a| a.abs() < 1e-9), "{:?}", nominal.film_tilt_rad);
    assert!((found.film_shift_mm - nominal.film_shift_mm).abs() < 1e-4);
    assert!(found.notes.is_empty());
    // Without the tilt: the mean of the places is not defocused.
    let kept = focused(&BuiltLens::new(&system, &[film(tilt, 0.0)]).unwrap(), &Compensation::default());
    assert_eq!(kept.film_tilt_rad, [0.0; 2]);
    let on_axis = criterion(CriterionKind::RmsSpot, &[[0.0; 2]]);
    let point =
        compensate(&BuiltLens::new(&system, &[film(tilt, 0.0)]).unwrap(), &free, &on_axis, 20.0).unwrap();
    assert!(point.film_tilt_rad == [0.0; 2] && point.notes[0].contains("do not determine"), "{point:?}");
}

/// Behind an odd number of mirrors the light goes along −z: shifts are along the light, tilts in the lens frame.
#[test]
fn a_film_behind_a_mirror_is_put_back() {
    let mut system = crate::design::figures::tests::parabolic_mirror(100.0, 12.5);
    system.wavelengths_um = vec![(0.5, 1.0)];
    let places = [[0.0, 0.0], [0.5, 0.0], [0.0, 0.5], [-0.5, 0.0], [0.0, -0.5]];
    let spot = criterion(CriterionKind::RmsSpot, &places);
    let free = Compensation { film_tilt: true, ..Compensation::default() };
    let of = |deviations: &[Deviation]| {
        compensate(&BuiltLens::new(&system, deviations).unwrap(), &free, &spot, 1.0).unwrap()
    };
    let nominal = of(&[]);
    let gap = of(&[Deviation::Gap { after: 0, thickness_mm: 0.1, absorb: None }]);
    assert!((gap.film_shift_mm + 0.1 - nominal.film_shift_mm).abs() < 1e-6, "{}", gap.film_shift_mm);
    let tilted = of(&[film([4e-3, -3e-3], 0.0)]);
    for (found, error) in tilted.film_tilt_rad.into_iter().zip([4e-3, -3e-3]) {
        assert!((found + error).abs() < 1e-5, "{:?}", tilted.film_tilt_rad);
    }
}

/// The lens without errors is focused like any other one. Its design has the film elsewhere: 0 here would need a design focused for
/// these places and this criterion.
#[test]
fn the_lens_without_errors_is_focused_like_any_other() {
    let system = double_gauss();
    let nominal = BuiltLens::new(&system, &[]).unwrap();
    let once = focused(&nominal, &Compensation::default());
    assert!(once.film_shift_mm.abs() < 0.5);
    // Once more finds it focused.
    let again =
        focused(&BuiltLens::new(&system, &[last_gap(once.film_shift_mm)]).unwrap(), &Compensation::default());
    assert!(again.film_shift_mm.abs() < 1e-5, "{}", again.film_shift_mm);
    let none = Compensation { focus_um: None, ..Compensation::default() };
    let kept = focused(&nominal, &none);
    assert_eq!((kept.film_shift_mm, kept.lens.deviations().len()), (0.0, 0));
}

#[test]
fn a_limit_that_is_reached_is_noted() {
    let built = BuiltLens::new(&double_gauss(), &[last_gap(0.8)]).unwrap();
    let narrow = Compensation { focus_um: Some((-100.0, 50.0)), ..Compensation::default() };
    let found = focused(&built, &narrow);
    assert_eq!((found.film_shift_mm, found.at_limit), (-0.1, true));
    assert_eq!(
        found.notes,
        ["the film shift is at its limit of -100.0 µm (-100.0 to 50.0 µm): the best focus lies beyond it"]
    );
}

#[test]
fn boresight_is_removed_if_asked_for() {
    let built = BuiltLens::new(&double_gauss(), &errors()).unwrap();
    let remove = Compensation { boresight: Boresight::Remove, ..Compensation::default() };
    let found = focused(&built, &remove);
    let centre = |lens: &BuiltLens| {
        SkewTracer::new(lens, lens.nominal().primary_um()).unwrap().chief([0.0; 2]).unwrap().at_mm
    };
    let left = centre(&found.lens);
    assert!(left.iter().all(|v| v.abs() < 1e-6), "{left:?}");
    let kept = centre(&focused(&built, &Compensation::default()).lens);
    for axis in 0..2 {
        assert!((found.boresight_mm[axis] - kept[axis]).abs() < 1e-12, "{:?} {kept:?}", found.boresight_mm);
    }
}

/// The focus of the greatest MTF is better than that of the least spot and than its neighbours.
#[test]
fn the_mtf_is_greatest_at_its_focus() {
    let built = BuiltLens::new(&double_gauss(), &errors()).unwrap();
    let mtf = criterion(CriterionKind::Mtf { frequency_per_mm: 40.0 }, &PLACES);
    let free = Compensation::default();
    let found = compensate(&built, &free, &mtf, 20.0).unwrap();
    let spot = focused(&built, &free);
    let value = |shift_mm: f64| {
        mtf.figures(&built.with(&[film([0.0; 2], shift_mm)]).unwrap(), 20.0).unwrap().criterion
    };
    let best = value(found.film_shift_mm);
    // λN² is 5 µm; the search is accurate to a hundredth of it.
    for other in [spot.film_shift_mm, found.film_shift_mm - 5e-4, found.film_shift_mm + 5e-4] {
        assert!(best > value(other), "{} {best}, {other} {}", found.film_shift_mm, value(other));
    }
}

#[test]
fn any_number_of_threads_has_the_same_bits() {
    let built = BuiltLens::new(&double_gauss(), &errors()).unwrap();
    let mtf = criterion(CriterionKind::Mtf { frequency_per_mm: 40.0 }, &PLACES);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let found = compensate(&built, &Compensation::default(), &mtf, 20.0).unwrap();
            (found.film_shift_mm.to_bits(), mtf.figures(&found.lens, 20.0).unwrap())
        })
    };
    assert_eq!(with(1), with(3));
}
