//! Spots, wavefronts and MTF against closed forms, the model and the symmetric lens's PSFs.

use std::f64::consts::PI;

use super::super::fields::{Colours, FilmBundle};
use super::super::focus_mtf::FocusMtf;
use super::super::*;
use crate::design::figures::tests::parabolic_mirror;
use crate::design::pupil::test_lenses;
use crate::design::skew::deviation::Deviation;
use crate::design::skew::system::BuiltLens;
use crate::design::system::{RayAiming, System};

/// The wavelength of the model, µm.
const UM: f64 = 0.587_561_8;
const ARCMIN: f64 = PI / 10_800.0;

/// The Double Gauss of the model.
pub(super) fn double_gauss() -> System {
    System {
        aiming: RayAiming::Real,
        wavelengths_um: vec![(UM, 1.0)],
        primary: 0,
        ..System::double_gauss_28()
    }
}

/// `ERRORS` of the model's tests.
pub(super) fn errors() -> Vec<Deviation> {
    vec![
        Deviation::element(6, 8, [0.05, 0.0], [0.0, 2.0 * ARCMIN, 0.0]),
        Deviation::element(4, 4, [0.0; 2], [ARCMIN, 0.0, 0.0]),
        Deviation::Film { decentre_mm: [0.0; 2], tilt_rad: [0.0, 5.0 * ARCMIN], shift_mm: 0.0 },
    ]
}

pub(super) fn criterion(kind: CriterionKind, places: &[[f64; 2]]) -> Criterion {
    Criterion { kind, fields: CriterionFields::Places(places.to_vec()) }
}

pub(super) fn mtf_at(frequency_per_mm: f64) -> CriterionKind {
    CriterionKind::Mtf { frequency_per_mm }
}

/// (2/π) (arccos ν − ν √(1 − ν²)), ν = λ f / 2 NA, of a parabolic mirror of focal length 100 mm with a pupil of 2.5 mm,
/// whose amplitude grows by 0.02 % towards its rim.
#[test]
fn perfect_lens_has_the_mtf_of_a_round_pupil() {
    let mut mirror = parabolic_mirror(100.0, 2.5);
    mirror.wavelengths_um = vec![(0.5, 1.0)];
    let built = BuiltLens::new(&mirror, &[]).unwrap();
    let na = 1.25 / (100.0 + 1.25 * 1.25 / 400.0);
    for frequency in [2.0, 10.0, 20.0, 40.0, 48.0] {
        let nu: f64 = frequency * 0.5e-3 / (2.0 * na);
        let expected = 2.0 / PI * (nu.acos() - nu * (1.0 - nu * nu).sqrt());
        let found = criterion(mtf_at(frequency), &[[0.0; 2]]).figures(&built, 1.0).unwrap();
        for mtf in found.fields[0].mtf.unwrap() {
            assert!((mtf - expected).abs() < 5e-5, "{frequency}: {mtf} {expected}");
        }
        assert!(found.fields[0].rms_spot_um < 1e-9 && found.fields[0].rms_wavefront < 1e-9, "{found:?}");
    }
    let beyond = criterion(mtf_at(2000.0 * na / 0.5 * 1.01), &[[0.0; 2]]).figures(&built, 1.0).unwrap();
    assert_eq!(beyond.criterion, 0.0);
}

/// An annulus of radii 1 and ε: (A(1, 1) − 2 A(1, ε) + A(ε, ε))/(π (1 − ε²)), A(r, s) the area common to two circles at the
/// distance d = λ f/NA.
#[test]
fn perfect_lens_with_an_obscuration_has_the_mtf_of_an_annulus() {
    let mut mirror = parabolic_mirror(100.0, 2.5);
    mirror.wavelengths_um = vec![(0.5, 1.0)];
    mirror.surfaces[0].obscuration_mm = Some(0.5);
    let built = BuiltLens::new(&mirror, &[]).unwrap();
    let (na, epsilon) = (1.25 / (100.0 + 1.25 * 1.25 / 400.0), 0.4);
    let common = |r: f64, s: f64, d: f64| {
        if d >= r + s {
            return 0.0;
        }
        if d <= (r - s).abs() {
            return PI * r.min(s).powi(2);
        }
        let part = |r: f64, s: f64| {
            let x = (d * d + r * r - s * s) / (2.0 * d);
            r * r * (x / r).acos() - x * (r * r - x * x).sqrt()
        };
        part(r, s) + part(s, r)
    };
    for frequency in [3.0, 8.0, 15.0, 25.0, 40.0] {
        let d = frequency * 0.5e-3 / na;
        let area = common(1.0, 1.0, d) - 2.0 * common(1.0, epsilon, d) + common(epsilon, epsilon, d);
        let expected = area / (PI * (1.0 - epsilon * epsilon));
        let found = criterion(mtf_at(frequency), &[[0.0; 2]]).figures(&built, 1.0).unwrap();
        for mtf in found.fields[0].mtf.unwrap() {
            assert!((mtf - expected).abs() < 5e-4, "{frequency}: {mtf} {expected}");
        }
    }
}

/// The parabola with its film moved by z. Spot: z times the RMS slope. Wavefront: z (N − N̄), N even over a paraboloid's pupil; MTF
/// of a small defocus: that of a round pupil times 2 J1(x)/x at low frequency, by rays x = 2π f z tan.
#[test]
fn defocused_parabola_in_closed_form() {
    let mut mirror = parabolic_mirror(100.0, 12.5);
    mirror.wavelengths_um = vec![(0.5, 1.0)];
    // Light goes along −z behind the mirror.
    let z = 0.03;
    let film = Deviation::Film { decentre_mm: [0.0; 2], tilt_rad: [0.0; 2], shift_mm: -z };
    let built = BuiltLens::new(&mirror, &[film]).unwrap();
    let found = criterion(mtf_at(5.0), &[[0.0; 2]]).figures(&built, 1.0).unwrap().fields[0];
    // With u = h/2f: tan of the slope 2u/(1 − u²), N = (1 − u²)/(1 + u²); both averaged over u².
    let n = 100_000;
    let u2 = |i: usize| (6.25_f64 / 200.0).powi(2) * (i as f64 + 0.5) / n as f64;
    let mean = |f: &dyn Fn(f64) -> f64| (0..n).map(|i| f(u2(i))).sum::<f64>() / n as f64;
    let spot = 1e3 * z * mean(&|u| 4.0 * u / (1.0 - u).powi(2)).sqrt();
    let cosine = |u: f64| (1.0 - u) / (1.0 + u);
    let middle = mean(&cosine);
    let wavefront = z / 0.5e-3 * mean(&|u| (cosine(u) - middle).powi(2)).sqrt();
    assert!((found.rms_spot_um / spot - 1.0).abs() < 1e-8, "{found:?} {spot}");
    assert!((found.rms_wavefront / wavefront - 1.0).abs() < 1e-8, "{found:?} {wavefront}");
    let [s, t] = found.mtf.unwrap();
    assert!((s - t).abs() < 1e-6, "{s} {t}");
}

/// `figures_gold.py`: spot and wavefront by `bundle(lens, t, UM, 8, 24)` of fields_reference.py for `double_gauss()` with `ERRORS`,
/// MTF by polynomials of degree 14 through `bundle(.., 24, 72)` and sums over 801² points of the shifted pupils.
#[test]
fn figures_of_a_lens_with_errors_are_those_of_the_model() {
    let built = BuiltLens::new(&double_gauss(), &errors()).unwrap();
    let golden = [
        (
            [0.0, 0.0],
            8.377814325954569,
            0.26390717650559636,
            [0.7635521648506418, 0.7627441224579735],
            [0.30191087168258857, 0.3084596941126475],
        ),
        (
            [10.0, -4.0],
            5.918979615688677,
            0.3824944463984817,
            [0.8482102762535404, 0.8298024460954111],
            [0.5158426602878223, 0.3295130959583208],
        ),
        (
            [-13.0, 13.0],
            8.16198143627714,
            0.4963255138605722,
            [0.6220574606831796, 0.870795450094062],
            [0.141891573642545, 0.5526301694521986],
        ),
    ];
    for (place, spot, wavefront, mtf_20, mtf_50) in golden {
        for (frequency, mtf) in [(20.0, mtf_20), (50.0, mtf_50)] {
            let found = criterion(mtf_at(frequency), &[place]).figures(&built, 1.0).unwrap().fields[0];
            assert!((found.rms_spot_um / spot - 1.0).abs() < 1e-7, "{found:?} {spot}");
            assert!((found.rms_wavefront / wavefront - 1.0).abs() < 1e-7, "{found:?} {wavefront}");
            for (a, b) in found.mtf.unwrap().into_iter().zip(mtf) {
                assert!((a - b).abs() < 2e-4, "{frequency}: {found:?} {mtf:?}");
            }
        }
    }
}

/// The MTF that is extrapolated to a shifted film against that of the film there.
#[test]
fn mtf_through_focus_is_that_of_shifted_films() {
    let system = System { aiming: RayAiming::Real, ..System::double_gauss_28() };
    let lens = BuiltLens::new(&system, &errors()).unwrap();
    let place = [9.0, -6.0];
    let colours = Colours::new(&lens).unwrap();
    let field = colours.fields(&[place]).unwrap().remove(0);
    let through = FocusMtf::trace(&colours, &field, 40.0, 0.05).unwrap();
    for shift_mm in [-0.04, 0.0, 0.025] {
        let film = Deviation::Film { decentre_mm: [0.0; 2], tilt_rad: [0.0; 2], shift_mm };
        let moved = lens.with(&[film]).unwrap();
        let moved_colours = Colours::new(&moved).unwrap();
        // The same field, so another place of the film.
        let chief = moved_colours.primary().chief(field.t).unwrap().at_mm;
        let there = moved_colours.fields(&[chief]).unwrap();
        let there = FocusMtf::trace(&moved_colours, &there[0], 40.0, 0.0).unwrap();
        for (a, b) in through.at(shift_mm).into_iter().zip(there.at(0.0)) {
            assert!((a - b).abs() < 2e-5, "{shift_mm}: {a} {b}");
        }
    }
}

#[test]
fn places_of_the_film_are_seventeen() {
    let places = CriterionFields::Film.places(20.0);
    assert_eq!(places.len(), 17);
    assert_eq!(
        (places[0], places[1], places[9], places[11]),
        ([0.0; 2], [14.0, 0.0], [20.0, 0.0], [0.0, 20.0])
    );
    let r = |p: &[f64; 2]| (p[0] * p[0] + p[1] * p[1]).sqrt();
    assert!(places[1..9].iter().all(|p| (r(p) - 14.0).abs() < 1e-13));
    assert!(places[9..].iter().all(|p| (r(p) - 20.0).abs() < 1e-13));
}

/// Rays of a bundle carry all of the light, and its rims are closed.
#[test]
fn bundles_of_a_vignetted_lens() {
    let built = BuiltLens::new(&test_lenses::lens("macro-70"), &[]).unwrap();
    let colours = Colours::new(&built).unwrap();
    let place = [16.0, 12.0];
    let fields = colours.fields(&[place]).unwrap();
    let bundle = FilmBundle::trace(colours.primary(), &fields[0], [8, 24, 48]).unwrap();
    assert!((bundle.rays.iter().map(|r| r.weight).sum::<f64>() - 1.0).abs() < 1e-12);
    let rim = &bundle.rims[0];
    assert!(bundle.rims.len() == 1 && rim.len() > 1);
    for (a, b) in rim.iter().zip(rim.iter().cycle().skip(1)) {
        let (a, b) = (a.last().unwrap().cosines, b[0].cosines);
        assert!((a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-5, "{a:?} {b:?}");
    }
}
