//! The tracer compared with known physics: Airy pattern, cos⁴ law, overlapping discs, symmetry, thin lenses.

use std::f64::consts::PI;

use crate::design_cases::{bessel_j1_over_x, system};
use lenscube_pipeline::design::glass::{Dispersion, Glass};
use lenscube_pipeline::design::illumination::{irradiance_sr, numerical_aperture, solid_angle_sr};
use lenscube_pipeline::design::paraxial::Paraxial;
use lenscube_pipeline::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use lenscube_pipeline::design::pupil::Pupil;
use lenscube_pipeline::design::ray::Tracer;
use lenscube_pipeline::design::shape::Shape;
use lenscube_pipeline::design::spots::spot;
use lenscube_pipeline::design::system::{ImagePlane, Medium, RayAiming, Surface};
use lenscube_pipeline::design::{DesignError, System, describe};

fn flat(thickness: f64) -> Surface {
    Surface::new(0.0, thickness, Medium::Air)
}

fn glass(n: f64) -> Medium {
    Medium::Glass(Glass::new("n".to_owned(), Dispersion::constant(n), (0.0, 9.0)))
}

/// Plano-hyperbolic lens: free of spherical aberration for a distant axial point (Cartesian oval).
fn stigmatic(pupil_mm: f64) -> System {
    let (n, f): (f64, f64) = (1.5, 100.0);
    let mut back = Surface::new(0.0, f, Medium::Air);
    back.shape =
        Shape { curvature: -1.0 / ((n - 1.0) * f), conic: -n * n, aspheric: vec![], ..Shape::default() };
    system(vec![Surface::new(0.0, 2.0, glass(n)), back, flat(0.0)], 0, pupil_mm)
}

#[test]
fn aberration_free_lens_gives_the_airy_pattern() {
    // F/100: apodisation and obliquity are of order NA² = 2.5e-5.
    let system = stigmatic(1.0);
    let tracer = Tracer::new(&system, 0.55).unwrap();
    let f = PupilFunction::trace(&tracer, 0.0).unwrap();
    let (half, pitch) = (40, 7.0);
    let psf = PsfGrid::new(half, pitch).psf(&f, 0.0, &mut PsfScratch::default());
    let na = numerical_aperture(&tracer).unwrap();
    let n = 2 * half + 1;
    // Peak as a share of the total energy: π NA²/λ² per µm².
    let peak = PI * (na / 0.55).powi(2) * pitch * pitch;
    let mut worst = 0.0_f64;
    for (i, v) in psf.iter().enumerate() {
        let at = |i: usize| (i as f64 - half as f64) * pitch;
        let x = 2.0 * PI / 0.55 * na * at(i % n).hypot(at(i / n));
        worst = worst.max((v / peak - (2.0 * bessel_j1_over_x(x)).powi(2)).abs());
    }
    println!("Airy: {worst:.2e} of the peak");
    assert!(worst < 1e-4);
    assert!(spot(&tracer, 0.0).unwrap().strehl > 1.0 - 1e-9);
}

/// A glass surface that is an ellipsoid of eccentricity 1/n images a distant axial point in the glass without aberration (Cartesian oval):
/// semi-axes a and b, focus at a (1 + 1/n) behind the vertex.
#[test]
fn film_in_glass_has_the_focus_numerical_aperture_and_airy_pattern_of_its_index() {
    let (n, radius): (f64, f64) = (1.5, 20.0);
    let a = radius / (1.0 - 1.0 / (n * n));
    let focus = a * (1.0 + 1.0 / n);
    let cemented = |pupil_mm: f64| {
        let mut front = Surface::new(1.0 / radius, focus, glass(n));
        front.shape.conic = -1.0 / (n * n);
        system(vec![front, flat(0.0)], 0, pupil_mm)
    };
    let wide = cemented(30.0);
    let d = describe(&wide).unwrap();
    assert!((d.effective_focal_length_mm - radius / (n - 1.0)).abs() < 1e-12, "for an index of 1 behind it");
    assert!((d.paraxial_working_f_number - 40.0 / 30.0).abs() < 1e-12 && d.paraxial_focus_mm.abs() < 1e-12);
    assert!((d.image_space_na - n * 0.25_f64.atan().sin()).abs() < 1e-12);
    // From the point of the ellipsoid at height h to the focus.
    let real_na = |h: f64| {
        let sag = a * (1.0 - (1.0 - h * h / (a * radius)).sqrt());
        n * (h / (focus - sag)).atan().sin()
    };
    assert!((d.real_na - real_na(15.0)).abs() < 1e-9, "{}", d.real_na);
    let found = spot(&Tracer::new(&wide, 0.55).unwrap(), 0.0).unwrap();
    assert!(found.geo_um < 1e-9 && (found.strehl - 1.0).abs() < 1e-9, "{found:?}");
    let refocused = wide.with_image_plane(ImagePlane::AsDesigned, 0.005).unwrap();
    let refocused = refocused.with_image_plane(ImagePlane::BestStrehl(0.55), 0.0).unwrap();
    assert!((refocused.surfaces[0].thickness_mm - focus).abs() < 1e-6);
    let narrow = cemented(1.0);
    let tracer = Tracer::new(&narrow, 0.55).unwrap();
    let f = PupilFunction::trace(&tracer, 0.0).unwrap();
    let (half, pitch, na) = (20, 7.0, real_na(0.5));
    let psf = PsfGrid::new(half, pitch).psf(&f, 0.0, &mut PsfScratch::default());
    let peak = PI * (na / 0.55).powi(2) * pitch * pitch;
    for (i, v) in psf.iter().enumerate() {
        let at = |i: usize| (i as f64 - half as f64) * pitch;
        let x = 2.0 * PI / 0.55 * na * at(i % (2 * half + 1)).hypot(at(i / (2 * half + 1)));
        assert!((v / peak - (2.0 * bessel_j1_over_x(x)).powi(2)).abs() < 1e-4, "{i}");
    }
}

#[test]
fn psf_rotates_with_azimuth_and_is_symmetric_about_the_meridian() {
    let system = System::double_gauss_28();
    let tracer = Tracer::new(&system, 0.55).unwrap();
    let f = PupilFunction::trace(&tracer, 0.2).unwrap();
    let grid = PsfGrid::new(30, 0.6);
    let n = grid.size();
    let mut scratch = PsfScratch::default();
    let mut psf = |azimuth: f64| grid.psf(&f, azimuth, &mut scratch);
    let (upright, down, a, b) = (psf(0.0), psf(PI / 2.0), psf(0.4), psf(-0.4));
    let peak = upright.iter().fold(0.0_f64, |a, v| a.max(*v));
    for i in 0..n * n {
        let (x, y) = (i % n, i / n);
        // A quarter turn maps (x, y) to (−y, x), row down: +x to below the centre.
        assert!((upright[i] - down[x * n + (n - 1 - y)]).abs() < 1e-6 * peak);
        assert!((a[i] - b[(n - 1 - y) * n + x]).abs() < 1e-6 * peak);
        assert!((upright[i] - upright[(n - 1 - y) * n + x]).abs() < 1e-12 * peak);
    }
}

#[test]
fn lone_stop_has_cos4_illumination() {
    let mut system = system(vec![flat(50.0), flat(0.0)], 0, 0.02);
    system.object_distance_mm = Some(200.0);
    let tracer = Tracer::new(&system, 0.55).unwrap();
    let axis = solid_angle_sr(&tracer, 0.0).unwrap();
    assert!((axis / (PI * (0.01_f64 / 200.0).powi(2)) - 1.0).abs() < 1e-6);
    for degrees in [5.0_f64, 20.0, 40.0] {
        let ri = solid_angle_sr(&tracer, degrees.to_radians().tan()).unwrap() / axis;
        assert!((ri - degrees.to_radians().cos().powi(4)).abs() < 1e-7, "{degrees}: {ri}");
        // A pinhole is out of focus: the film, 50 mm behind it, receives the solid angle of the pinhole from there.
        let film = irradiance_sr(&tracer, degrees.to_radians().tan()).unwrap();
        let expected = PI * (0.01_f64 / 50.0).powi(2) * degrees.to_radians().cos().powi(4);
        assert!((film / expected - 1.0).abs() < 1e-6, "{degrees}: {film}");
    }
}

#[test]
fn vignetted_pupil_area_is_the_overlap_of_two_discs() {
    let (stop, hood, gap) = (5.0_f64, 6.0_f64, 30.0);
    let mut front = flat(gap);
    front.aperture_mm = Some(hood);
    let mut system = system(vec![front, flat(50.0), flat(0.0)], 1, 2.0 * stop);
    for aiming in [RayAiming::Paraxial, RayAiming::Real] {
        system.aiming = aiming;
        let tracer = Tracer::new(&system, 0.55).unwrap();
        for tan in [0.0, 0.02, 0.1, 0.2, 0.3] {
            let d: f64 = gap * tan;
            let expected = if d <= hood - stop {
                PI * stop * stop
            } else {
                let angle = |r: f64, s: f64| ((d * d + r * r - s * s) / (2.0 * d * r)).acos();
                let root =
                    ((stop + hood - d) * (d + stop - hood) * (d - stop + hood) * (d + stop + hood)).sqrt();
                stop * stop * angle(stop, hood) + hood * hood * angle(hood, stop) - 0.5 * root
            };
            let nodes = Pupil::new(&tracer, tan).unwrap().nodes(&tracer, tan, 7, 9);
            let area = 2.0 * stop * stop * nodes.iter().map(|n| n.weight).sum::<f64>();
            assert!((area / expected - 1.0).abs() < 1e-7, "tan {tan}: {area} against {expected}");
        }
        assert!(matches!(Pupil::new(&tracer, 0.4), Err(DesignError::Ray { .. })));
    }
}

#[test]
fn thin_lens_obeys_the_lens_formula() {
    // Thin enough that the principal planes coincide to 1e-6 mm.
    let n = 1.5;
    let c = 1.0 / 100.0;
    let lens = |distance: Option<f64>, image: f64| {
        let surfaces = vec![Surface::new(c, 1e-6, glass(n)), Surface::new(-c, image, Medium::Air), flat(0.0)];
        System { object_distance_mm: distance, ..system(surfaces, 0, 10.0) }
    };
    let p = Paraxial::new(&lens(None, 100.0), 0.55).unwrap();
    assert!((p.effective_focal_length_mm - 100.0).abs() < 1e-5 && p.focus_shift_mm().abs() < 1e-5);
    assert!((p.image_f_number() - 10.0).abs() < 1e-6 && (p.working_f_number() - 10.0).abs() < 1e-6);
    // 300 mm before a lens of 100 mm: image at 150 mm, half as large, upside down.
    let finite = lens(Some(300.0), 140.0);
    let p = Paraxial::new(&finite, 0.55).unwrap();
    assert!((p.magnification + 0.5).abs() < 1e-6 && (p.focus_shift_mm() - 10.0).abs() < 1e-4, "{p:?}");
    // The film lies 10 mm before the image: the chief ray through the centre of the thin lens has the height ratio 140/300.
    assert!((p.film_magnification(Some(300.0)) + 140.0 / 300.0).abs() < 1e-6);
    let focused = finite.with_image_plane(ImagePlane::Paraxial(0.55), 0.0).unwrap();
    assert!((focused.surfaces[1].thickness_mm - 150.0).abs() < 1e-4);
    // The stop radius is kept at another object distance.
    let moved = lens(None, 100.0).with_object_distance(Some(300.0)).unwrap();
    let p = Paraxial::new(&moved, 0.55).unwrap();
    assert!((p.entrance_radius_mm - 5.0).abs() < 1e-9);
}

#[test]
fn best_focus_minimises_rms_spot_and_maximises_strehl() {
    let system = System::double_gauss_28();
    let um = 0.5876;
    let at = |s: &System| spot(&Tracer::new(s, um).unwrap(), 0.0).unwrap();
    let rms = system.with_image_plane(ImagePlane::BestRmsSpot(um), 0.0).unwrap();
    let strehl = system.with_image_plane(ImagePlane::BestStrehl(um), 0.0).unwrap();
    for step in [-0.01, 0.01] {
        let off = |s: &System| at(&s.with_image_plane(ImagePlane::AsDesigned, step).unwrap());
        assert!(off(&rms).rms_um > at(&rms).rms_um);
        assert!(off(&strehl).strehl < at(&strehl).strehl);
    }
    assert!(at(&strehl).strehl > at(&rms).strehl && at(&rms).rms_um < at(&system).rms_um);
}

#[test]
fn real_aiming_equals_paraxial_where_the_stop_is_the_pupil() {
    let paraxial = stigmatic(20.0);
    let real = System { aiming: RayAiming::Real, ..paraxial.clone() };
    let (a, b) = (Tracer::new(&paraxial, 0.55).unwrap(), Tracer::new(&real, 0.55).unwrap());
    for (tan, p, q) in [(0.0, 0.3, 0.1), (0.05, -0.7, 0.6), (0.1, 0.0, -1.0)] {
        let (x, y) = (a.ray(tan, p, q).unwrap(), b.ray(tan, p, q).unwrap());
        assert!((x.x.v - y.x.v).abs() < 1e-10 && (x.solid_angle() / y.solid_angle() - 1.0).abs() < 1e-9);
    }
    // In a lens with an inner stop the real pupil moves with the field, so the chief rays differ a little.
    let lens = System::double_gauss_28();
    let aimed = System { aiming: RayAiming::Real, ..lens.clone() };
    let (a, b) = (Tracer::new(&lens, 0.55).unwrap(), Tracer::new(&aimed, 0.55).unwrap());
    let gap = a.chief_height_mm(0.2).unwrap() - b.chief_height_mm(0.2).unwrap();
    assert!(gap.abs() > 1e-6 && gap.abs() < 0.05, "{gap}");
    assert!(solid_angle_sr(&b, 0.2).unwrap() > 0.5 * solid_angle_sr(&b, 0.0).unwrap());
    assert!(PupilFunction::trace(&b, 0.2).is_ok() && describe(&aimed).is_ok());
}

/// Four million rays of random field points and pupil points, counted in a ring of the film at 24.45 mm, against a disc of 0.6 mm on
/// the axis: 0.9220 with a standard deviation of 0.0009, by a tracer in NumPy.
#[test]
fn irradiance_at_the_edge_is_the_density_of_rays_on_the_film() {
    let system = System::double_gauss_28();
    let tracer = Tracer::new(&system, 0.5876).unwrap();
    let tan = tracer.field_of_height(24.45).unwrap();
    let ratio = irradiance_sr(&tracer, tan).unwrap() / irradiance_sr(&tracer, 0.0).unwrap();
    assert!((ratio - 0.9220).abs() < 0.002, "{ratio}");
}

/// A stop behind a strong negative meniscus: the real pupil moves towards the object by many radii at the edge of the field.
#[test]
fn chief_rays_of_a_fisheye_are_followed_to_85_degrees() {
    let mut surfaces = vec![
        Surface::new(1.0 / 40.0, 2.0, glass(1.7)),
        Surface::new(1.0 / 10.0, 14.0, Medium::Air),
        Surface::new(1.0 / 60.0, 1.5, glass(1.7)),
        Surface::new(1.0 / 10.0, 12.0, Medium::Air),
        flat(1.0),
        Surface::new(1.0 / 30.0, 3.0, glass(1.7)),
        Surface::new(-1.0 / 10.0, 12.0, Medium::Air),
        flat(0.0),
    ];
    surfaces[5].aperture_mm = None;
    let system = System { aiming: RayAiming::Real, ..system(surfaces, 4, 0.8) };
    let tracer = Tracer::new(&system, 0.55).unwrap();
    let (height, tan) = tracer.farthest_field();
    assert!(tan.atan().to_degrees() >= 85.0, "{}", tan.atan().to_degrees());
    let found = tracer.field_of_height(0.999 * height).unwrap();
    assert!((tracer.chief_height_mm(found).unwrap() - 0.999 * height).abs() < 1e-9);
    let ray = tracer.ray(85.0_f64.to_radians().tan(), 0.7, 0.7).unwrap();
    assert!(ray.flux > 0.0 && ray.x.v.is_finite());
    let beyond = tracer.field_of_height(1.5 * height).unwrap_err().to_string();
    assert!(beyond.contains("maximum real image height") && beyond.contains("degrees"), "{beyond}");
}

#[test]
fn slope_of_the_chief_ray_height_is_its_derivative() {
    for aiming in [RayAiming::Paraxial, RayAiming::Real] {
        let system = System { aiming, ..System::double_gauss_28() };
        let tracer = Tracer::new(&system, 0.45).unwrap();
        for tan in [0.0, 0.1, 0.24] {
            let at = |t: f64| tracer.chief_height_mm(t).unwrap();
            let expected = (at(tan + 1e-4) - at(tan - 1e-4)) / 2e-4;
            let (_, slope) = tracer.chief_height_and_slope(tan).unwrap();
            assert!((slope - expected).abs() < 1e-5, "{aiming:?} {tan}: {slope} {expected}");
        }
    }
}

#[test]
fn paraxial_aiming_with_much_pupil_aberration_becomes_real_with_a_note() {
    let lens = System::double_gauss_28();
    let checked = lens.clone().with_checked_aiming().unwrap();
    assert_eq!(checked.aiming, RayAiming::Real);
    assert!(checked.notes.iter().any(|n| n.contains("ray aiming is off")), "{:?}", checked.notes);
    let narrow = System { fields: vec![0.0, 1.0], ..lens };
    assert_eq!(narrow.clone().with_checked_aiming().unwrap(), narrow);
}
