//! A lens without deviations has the rays of the symmetric tracer.

use super::lenses::{ARCMIN, UM, double_gauss, few_errors};
use crate::design::prescription::system::{Aperture, FieldKind, RayAiming, System};
use crate::design::pupil::test_lenses::lens;
use crate::design::rays::ray::Tracer;
use crate::design::skew::deviation::Deviation;
use crate::design::skew::system::BuiltLens;
use crate::design::skew::trace::SkewTracer;
use crate::real;

const AIMINGS: [RayAiming; 2] = [RayAiming::Paraxial, RayAiming::Real];

fn check_rays(system: &System, tan: f64, tolerance: f64) {
    let built = BuiltLens::new(system, &[]).unwrap();
    let (tracer, skew) = (Tracer::new(system, 0.55).unwrap(), SkewTracer::new(&built, 0.55).unwrap());
    for azimuth in [0.0, 0.3, 2.0, -1.1] {
        let (s, c) = real::sin_cos(azimuth);
        let t = tracer.image_sign() * tan;
        for (p, q) in [(0.0, 0.0), (0.7, 0.5), (-0.2, 0.9)] {
            let expected = tracer.ray(tan, p, q).unwrap();
            let found = skew.ray([t * c, t * s], p * c - q * s, p * s + q * c).unwrap();
            // The film's y is down.
            let pairs = [
                (found.x.v, expected.x.v * c - expected.y.v * s),
                (-found.y.v, expected.x.v * s + expected.y.v * c),
                (found.l.v, expected.l.v * c - expected.m.v * s),
                (-found.m.v, expected.l.v * s + expected.m.v * c),
                (found.n, expected.n),
                (found.path.v, expected.path.v),
                (found.flux / expected.flux, 1.0),
                (found.solid_angle() / expected.solid_angle(), 1.0),
            ];
            for (k, (a, b)) in pairs.iter().enumerate() {
                assert!((a - b).abs() < tolerance, "{} {azimuth} ({p}, {q}) {k}: {a} {b}", system.name);
            }
        }
    }
}

#[test]
fn rays_of_a_lens_without_deviations() {
    for aiming in AIMINGS {
        check_rays(&System { aiming, ..System::double_gauss_28() }, 0.17, 1e-12);
    }
    check_rays(&lens("phone"), 0.5, 1e-12);
    check_rays(&lens("macro-70"), 0.2, 1e-12);
    check_rays(&lens("mirror-500"), 0.02, 1e-11);
    let near = System { object_distance_mm: Some(900.0), ..double_gauss(RayAiming::Real) };
    check_rays(&near, 0.1, 1e-12);
    let telecentric = System {
        object_distance_mm: Some(160.0),
        is_telecentric: true,
        aperture: Aperture::ObjectNa(0.02),
        field_kind: FieldKind::ObjectHeight,
        ..double_gauss(RayAiming::Paraxial)
    };
    check_rays(&telecentric, 0.03, 1e-12);
}

/// Along x the operations are those of the symmetric tracer: the same bits.
#[test]
fn a_lens_without_deviations_has_the_bits_of_its_nominal_lens() {
    let system = System { aiming: RayAiming::Paraxial, ..System::double_gauss_28() };
    let zero = [Deviation::element(2, 4, [0.0; 2], [0.0; 3])];
    for deviations in [&[] as &[Deviation], &zero] {
        let built = BuiltLens::new(&system, deviations).unwrap();
        let (tracer, skew) = (Tracer::new(&system, 0.55).unwrap(), SkewTracer::new(&built, 0.55).unwrap());
        for (p, q) in [(0.0, 0.0), (0.7, 0.5), (-0.2, 0.9)] {
            let (expected, found) = (tracer.ray(0.17, p, q).unwrap(), skew.ray([0.17, 0.0], p, q).unwrap());
            assert_eq!((found.x, -found.y), (expected.x, expected.y));
            assert_eq!((found.path.v, found.flux), (expected.path.v, expected.flux));
        }
    }
}

/// A group that moves as one body has the nominal gaps inside, whatever its motion.
#[test]
fn the_whole_lens_with_its_film_moved_has_the_rays_of_the_nominal_one() {
    let system = double_gauss(RayAiming::Paraxial);
    let nominal = BuiltLens::new(&system, &[]).unwrap();
    let gap = Deviation::Gap { after: 4, thickness_mm: 0.1, absorb: Some(5) };
    let moved = BuiltLens::new(&system, &[gap]).unwrap();
    let z = |lens: &BuiltLens, i: usize| lens.poses()[i].origin_mm[2];
    assert!((z(&moved, 5) - z(&nominal, 5) - 0.1).abs() < 1e-13);
    assert_eq!(z(&moved, 6), z(&nominal, 6));
    assert_eq!(z(&moved, 11), z(&nominal, 11));
}

#[test]
fn field_of_a_place_is_that_of_the_symmetric_tracer() {
    for aiming in AIMINGS {
        let system = double_gauss(aiming);
        let built = BuiltLens::new(&system, &[]).unwrap();
        let (tracer, skew) = (Tracer::new(&system, UM).unwrap(), SkewTracer::new(&built, UM).unwrap());
        let t = skew.field_of([12.0, 9.0]).unwrap();
        let tan = tracer.field_of_height(15.0).unwrap();
        assert!((t[0] - 0.8 * tan).abs() < 1e-14 && (t[1] + 0.6 * tan).abs() < 1e-14, "{t:?}");
        let (height, slope) = tracer.chief_height_and_slope(tan).unwrap();
        let chief = skew.chief(t).unwrap();
        assert!((chief.determinant() / (-slope * height / tan) - 1.0).abs() < 1e-12);
    }
}

#[test]
fn chief_rays_and_their_jacobian_with_deviations() {
    for aiming in AIMINGS {
        let mut errors = few_errors();
        errors.push(Deviation::element(5, 5, [0.2, -0.1], [20.0 * ARCMIN, 0.0, 0.0]));
        let built = BuiltLens::new(&double_gauss(aiming), &errors).unwrap();
        let skew = SkewTracer::new(&built, UM).unwrap();
        let (t, h) = ([0.12, -0.07], 1e-5);
        let chief = skew.chief(t).unwrap();
        for (k, d) in [[h, 0.0], [0.0, h]].into_iter().enumerate() {
            let [more, less] =
                [1.0, -1.0].map(|s| skew.chief([t[0] + s * d[0], t[1] + s * d[1]]).unwrap().at_mm);
            for i in 0..2 {
                let difference = (more[i] - less[i]) / (2.0 * h);
                assert!((chief.by_slopes[i][k] - difference).abs() < 2e-7, "{i} {k}");
            }
        }
        let back = skew.field_of(chief.at_mm).unwrap();
        assert!((0..2).all(|i| (back[i] - t[i]).abs() < 1e-13));
    }
}
