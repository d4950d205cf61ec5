//! Maps of built lenses.

use super::lenses::{ARCMIN, LAST, UM, double_gauss, few_errors, lens_0, moved};
use crate::design::prescription::system::{RayAiming, System};
use crate::design::pupil::illumination::irradiance_sr;
use crate::design::pupil::test_lenses;
use crate::design::rays::ray::Tracer;
use crate::design::skew::deviation::Deviation;
use crate::design::skew::illumination::field_light;
use crate::design::skew::map::FilmRange;
use crate::design::skew::system::BuiltLens;
use crate::design::skew::trace::SkewTracer;
use crate::design::skew::trace_map::{TracedMap, trace_map, without_boresight};
use crate::real;

fn traced(tracer: &SkewTracer<'_>, half_mm: f64, pixel_mm: f64) -> TracedMap {
    trace_map(tracer, FilmRange::centred([half_mm; 2]), 1e-4 * pixel_mm).unwrap()
}

/// The grid of the table of the contract, and its errors at places of neither the grid nor the check, against chief rays and
/// light.
#[test]
fn a_map_of_a_built_lens_has_its_chief_rays_and_light() {
    for (aiming, errors) in
        [(RayAiming::Paraxial, lens_0()), (RayAiming::Real, few_errors()), (RayAiming::Real, vec![])]
    {
        let built = BuiltLens::new(&double_gauss(aiming), &errors).unwrap();
        let tracer = SkewTracer::new(&built, UM).unwrap();
        let found = traced(&tracer, 14.3, 2e-3);
        assert_eq!(found.map.counts(), [33, 33]);
        assert!(found.ideal_error_mm < 2e-7 && found.illumination_error < 1e-6, "{found:?}");
        for place in [[0.0, 0.0], [14.3, -14.3], [1.1, -2.3], [-9.87, 3.21], [-14.0, -13.9]] {
            let point = found.map.at(place).unwrap();
            let t = tracer.slopes_of_ideal(point.ideal_mm);
            let at = tracer.chief(t).unwrap().at_mm;
            assert!((0..2).all(|i| (at[i] - place[i]).abs() < 4e-7), "{place:?} {at:?}");
            let light = field_light(&tracer, t).unwrap().irradiance_sr / found.solid_angle_sr;
            assert!((point.relative_illumination - light).abs() < 1e-6, "{place:?}");
        }
        assert!((found.map.at([0.0; 2]).unwrap().relative_illumination - 1.0).abs() < 1e-9);
    }
}

/// `trace_map(lens0()[0], at, at, UM, real=False, rings=7, spokes=18)` of the model at (−6, 3) and (10, 10) mm: I_x, I_y, R.
#[test]
fn the_map_of_built_lens_0_is_that_of_the_model() {
    let built = BuiltLens::new(&double_gauss(RayAiming::Paraxial), &lens_0()).unwrap();
    let tracer = SkewTracer::new(&built, UM).unwrap();
    let map = traced(&tracer, 12.0, 2e-3).map;
    let golden = [
        ([-6.0, 3.0], [-5.986844480746957, 3.018632761151247, 0.9929509950525508]),
        ([10.0, 10.0], [10.038364051622803, 10.041436362989725, 0.9705754220129937]),
    ];
    for (place, [ix, iy, r]) in golden {
        let found = map.at(place).unwrap();
        assert!((found.ideal_mm[0] - ix).abs() < 2e-7 && (found.ideal_mm[1] - iy).abs() < 2e-7, "{found:?}");
        assert!((found.relative_illumination - r).abs() < 2e-7, "{found:?} {r}");
    }
}

/// Vignetted lenses: R of the symmetric tracer, within 1e-5 away from changes of the pupil's rims and 2e-4 near them.
#[test]
fn the_map_of_a_vignetted_lens() {
    for (name, half_mm) in [("mirrorless-50", 4.0), ("mirror-500", 12.0)] {
        let system = test_lenses::lens(name);
        let built = BuiltLens::new(&system, &[]).unwrap();
        let found = traced(&SkewTracer::new(&built, UM).unwrap(), half_mm, 4e-3);
        assert!(found.illumination_error < 1e-5 && found.illumination_error_at_rims < 2e-4, "{found:?}");
        let nominal = Tracer::new(&system, UM).unwrap();
        for (share, azimuth) in [(0.2, 0.3), (0.75, 2.0), (1.1, -0.8)] {
            let (s, c) = real::sin_cos(azimuth);
            let r = share * half_mm;
            let tan = nominal.field_of_height(r).unwrap();
            let expected = irradiance_sr(&nominal, tan).unwrap() / irradiance_sr(&nominal, 0.0).unwrap();
            let point = found.map.at([r * c, r * s]).unwrap();
            assert!((point.relative_illumination - expected).abs() < 2e-4, "{name} {r}");
            let ideal = nominal.ideal_scale_mm() * tan;
            assert!(
                (point.ideal_mm[0] - ideal * c).abs() < 1e-6 && (point.ideal_mm[1] - ideal * s).abs() < 1e-6
            );
        }
    }
    let system: System = test_lenses::lens("mirror-500");
    let built = BuiltLens::new(&system, &[moved([5, 6], [0.05, 0.02], [3.0 * ARCMIN, 0.0])]).unwrap();
    let found = traced(&SkewTracer::new(&built, UM).unwrap(), 12.0, 4e-3);
    assert!(found.illumination_error < 1e-5 && found.illumination_error_at_rims < 2e-4, "{found:?}");
}

#[test]
fn boresight_is_removed_at_the_primary_wavelength() {
    let tilted = Deviation::Film { decentre_mm: [0.0; 2], tilt_rad: [0.0, 5.0 * ARCMIN], shift_mm: 0.0 };
    let built =
        BuiltLens::new(&double_gauss(RayAiming::Paraxial), &[moved(LAST, [0.05, 0.02], [0.0; 2]), tilted]);
    let (centred, shift) = without_boresight(&built.unwrap()).unwrap();
    // 35.84 µm for 50 µm of decentre; y is down.
    assert!((shift[0] - 35.84e-3).abs() < 2e-5 && (shift[1] + 14.3e-3).abs() < 1e-4, "{shift:?}");
    let at = SkewTracer::new(&centred, UM).unwrap().chief([0.0; 2]).unwrap().at_mm;
    assert!(real::hypot(at[0], at[1]) < 1e-13, "{at:?}");
}
