//! Ideal thin lenses and telecentric object spaces compared with their closed forms.

use crate::design_cases::{flat, ideal, relay, system};
use lenscube_pipeline::design::illumination::{irradiance_sr, numerical_aperture};
use lenscube_pipeline::design::paraxial::Paraxial;
use lenscube_pipeline::design::ray::{ImageRay, Tracer};
use lenscube_pipeline::design::spots::spot;
use lenscube_pipeline::design::system::{Aperture, FieldKind, RayAiming};
use lenscube_pipeline::design::trace::{LensTrace, TraceOptions};
use lenscube_pipeline::design::{DesignError, System, describe};

/// The rays of the field point at `tan` over the pupil; all in one point, after the same path.
fn assert_perfect(system: &System, tan: f64, height_mm: f64) {
    let tracer = Tracer::new(system, 0.55).unwrap();
    let chief = tracer.ray(tan, 0.0, 0.0).unwrap();
    assert!((chief.x.v - height_mm).abs() < 1e-11, "{} for {height_mm}", chief.x.v);
    for (p, q) in [(1.0, 0.0), (-1.0, 0.0), (0.3, 0.8), (0.0, 1.0), (-0.7, 0.7)] {
        let ImageRay { x, y, path, .. } = tracer.ray(tan, p, q).unwrap();
        assert!((x.v - height_mm).abs() < 1e-11 && y.v.abs() < 1e-11, "({p}, {q}): {} {}", x.v, y.v);
        assert!((path.v - chief.path.v).abs() < 1e-10, "({p}, {q}): {:e} mm", path.v - chief.path.v);
        // The derivatives of paths of equal length vanish.
        assert!(path.d.iter().all(|d| d.abs() < 1e-9), "{:?}", path.d);
    }
    assert!(spot(&tracer, tan).unwrap().strehl > 1.0 - 1e-9);
}

#[test]
fn ideal_lens_images_every_point_to_a_point_after_equal_paths() {
    // f/1, an object at infinity: f tan θ.
    let distant = system(vec![ideal(50.0, 50.0), flat(0.0)], 0, 50.0);
    assert_perfect(&distant, 0.0, 0.0);
    assert_perfect(&distant, 0.5, 25.0);
    // At 150 mm: 75 mm behind it, magnification −1/2; t = object height over distance.
    let near =
        System { object_distance_mm: Some(150.0), ..system(vec![ideal(50.0, 75.0), flat(0.0)], 0, 40.0) };
    assert_perfect(&near, 0.2, 15.0);
    // A negative lens makes a virtual image 25 mm before it, which the second one, 50 mm behind it, images to 37.5 mm: 75 mm before it, f 25.
    let telephoto = System {
        object_distance_mm: Some(50.0),
        ..system(vec![ideal(-50.0, 50.0), ideal(25.0, 37.5), flat(0.0)], 0, 20.0)
    };
    assert_perfect(&telephoto, 0.2, 2.5);
    // A field lens in the image between two others bends chief rays and adds no path.
    let relayed = vec![ideal(50.0, 50.0), ideal(40.0, 60.0), ideal(30.0, 60.0), flat(0.0)];
    assert_perfect(&system(relayed, 0, 10.0), 0.1, 5.0);
    let d = describe(&distant).unwrap();
    assert!((d.effective_focal_length_mm - 50.0).abs() < 1e-12 && d.paraxial_focus_mm.abs() < 1e-12);
    // The marginal ray has the slope 1/2 of the paraxial one.
    let na =
        numerical_aperture(&Tracer::new(&system(vec![ideal(50.0, 50.0), flat(0.0)], 0, 0.02), 0.55).unwrap());
    assert!((na.unwrap() - 2e-4).abs() < 1e-10);
}

#[test]
fn telecentric_relay_has_axial_chief_rays_constant_illumination_and_the_height_of_its_magnification() {
    let system = relay(0.1);
    let primary = Paraxial::new(&system, 0.55).unwrap();
    assert!((primary.magnification + 0.5).abs() < 1e-14);
    // The cone of NA 0.1 through the focal length of 100 mm fills the stop.
    let slope = 0.1 / f64::sqrt(0.99);
    assert!((primary.stop_radius_mm - 100.0 * slope).abs() < 1e-12);
    assert!((primary.marginal_slope - 2.0 * slope).abs() < 1e-14 && !primary.exit_pupil_mm.is_finite());
    assert!((primary.film_magnification(Some(100.0)) + 0.5).abs() < 1e-14);
    let tracer = Tracer::new(&system, 0.55).unwrap();
    for height in [0.0, 3.0, 8.0] {
        let tan = height / 100.0;
        assert_perfect(&system, tan, height / 2.0);
        // Chief rays stay parallel to the axis up to the first lens, and cross the axis in the stop.
        let path = tracer.path(tan, 0.0, 30.0).unwrap();
        assert!((path[0].1 + height).abs() < 1e-12 && (path[1].1 + height).abs() < 1e-12);
        assert!(path[2].1.abs() < 1e-12);
        // The same cone leaves every object point: π NA² over the square of the magnification.
        let expected = std::f64::consts::PI * 0.01 * 4.0;
        assert!((irradiance_sr(&tracer, tan).unwrap() / expected - 1.0).abs() < 1e-9);
    }
    let d = describe(&system).unwrap();
    assert!(d.entrance_pupil_position_mm.is_infinite() && d.maximum_field_deg == 0.0);
    assert!((d.paraxial_image_height_mm - 4.0).abs() < 1e-12);
}

/// The limit of entrance pupils far away: the same figures as with the stop 10 µm from the focus, whose pupil is 1 km away.
#[test]
fn telecentric_object_space_is_the_limit_of_distant_pupils() {
    let telecentric = relay(0.05);
    let mut distant = System { is_telecentric: false, ..telecentric.clone() };
    distant.surfaces[0].thickness_mm -= 0.01;
    distant.surfaces[1].thickness_mm += 0.01;
    let exact = System { is_telecentric: false, ..telecentric.clone() };
    let error = Paraxial::new(&exact, 0.55).unwrap_err();
    assert!(matches!(&error, DesignError::Paraxial { what: "entrance pupil", .. }), "{error}");
    let (a, b) = (Tracer::new(&telecentric, 0.55).unwrap(), Tracer::new(&distant, 0.55).unwrap());
    let scale = 100.0 / (100.0 + b.primary.entrance_pupil_mm);
    assert!(b.primary.entrance_pupil_mm.abs() > 9e5);
    for (p, q) in [(0.0, 0.0), (0.9, 0.2)] {
        let (a, b) = (a.ray(0.06, p, q).unwrap(), b.ray(0.06 * scale.abs(), p, q).unwrap());
        assert!((a.x.v.abs() - b.x.v.abs()).abs() < 1e-6, "{} {}", a.x.v, b.x.v);
    }
}

#[test]
fn telecentric_bands_are_traced_over_the_field() {
    let options = TraceOptions { field_points: 11, ..TraceOptions::new(vec![550.0], 4.0) };
    let band = LensTrace::new(&relay(0.05), &options).unwrap().band(0, &mut |_| ()).unwrap().tables;
    band.check().unwrap();
    for (ideal, real) in band.ideal_height_mm.iter().zip(&band.image_height_mm) {
        assert!((ideal - real).abs() < 1e-11);
    }
    assert!((band.image_height_mm[10] - 4.0).abs() < 1e-11);
    assert!(band.relative_illumination.iter().all(|r| (r - 1.0).abs() < 1e-8));
}

#[test]
fn impossible_telecentric_systems_and_ideal_lenses_are_errors() {
    let good = relay(0.1);
    for (bad, problem) in [
        (
            System { object_distance_mm: None, aperture: Aperture::StopRadius(1.0), ..good.clone() },
            "at infinity",
        ),
        (System { aperture: Aperture::EntrancePupil(5.0), ..good.clone() }, "object-space NA"),
        (System { field_kind: FieldKind::Angle, ..good.clone() }, "heights"),
        (System { aiming: RayAiming::Real, ..good.clone() }, "--aiming paraxial"),
        (System { surfaces: vec![ideal(0.0, 1.0), flat(0.0)], stop: 0, ..good.clone() }, "ideal lens"),
    ] {
        let error = bad.check().unwrap_err().to_string();
        assert!(error.contains(problem), "{error}");
    }
    assert!(good.at_vergence(1.0).unwrap_err().to_string().contains("telecentric"));
}
