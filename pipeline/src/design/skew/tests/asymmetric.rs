//! Designs that have no rotational symmetry: against the symmetric tracer, closed forms, and their own rays.

use super::lenses::{ARCMIN, UM, double_gauss, film, lens};
use crate::design::prescription::asymmetry::{Asymmetry, Form, FreeSurface, Outline};
use crate::design::prescription::error::DesignError;
use crate::design::prescription::freeform::{AlongY, SkewShape};
use crate::design::prescription::pose::Pose;
use crate::design::prescription::system::{Medium, RayAiming, Surface, System};
use crate::design::psf::{PsfGrid, PsfScratch};
use crate::design::pupil::test_lenses;
use crate::design::rays::ray::Tracer;
use crate::design::skew::error::SkewError;
use crate::design::skew::grid::GridTrace;
use crate::design::skew::illumination::field_light;
use crate::design::skew::map::FilmRange;
use crate::design::skew::opening::Opening;
use crate::design::skew::pupil::pupil_function;
use crate::design::skew::system::BuiltLens;
use crate::design::skew::trace::SkewTracer;
use crate::design::tables::trace::{TraceOptions, TracedBand, with_threads};
use crate::lens::planar::PsfPlaces;
use crate::real;
use std::f64::consts::{FRAC_PI_4, PI};

/// `system` with the poses that it has anyway.
fn posed(system: &System) -> System {
    let surface = |(s, (z, direction)): (&Surface, (f64, f64))| FreeSurface {
        pose: Pose::at([0.0, 0.0, z]),
        is_reversed: direction < 0.0,
        shape: s.shape.clone().into(),
        aperture: s.aperture_mm.map(Outline::disc),
        obscuration: s.obscuration_mm.map(Outline::disc),
        ..FreeSurface::default()
    };
    let surfaces = system.surfaces.iter().zip(system.axis()).map(surface).collect();
    System { asymmetry: Some(Asymmetry { surfaces }), ..system.clone() }
}

/// The surface `index` of `system` changed by `change`.
fn changed(system: &System, index: usize, change: impl Fn(&mut FreeSurface)) -> System {
    let mut system = system.clone();
    change(&mut system.asymmetry.as_mut().unwrap().surfaces[index]);
    system
}

fn ray(tracer: &SkewTracer<'_>, t: [f64; 2], p: f64, q: f64) -> [f64; 2] {
    let ray = tracer.ray(t, p, q).unwrap();
    [ray.x.v, ray.y.v]
}

fn worst(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).abs().max((a[1] - b[1]).abs())
}

/// A symmetric lens that is given by poses has its rays and its light; a symmetric tracer refuses it.
#[test]
fn poses_of_a_symmetric_lens_have_its_rays() {
    for name in ["mirrorless-50", "mirror-500"] {
        let system = System { aiming: RayAiming::Real, ..test_lenses::lens(name) };
        let [expected, found] =
            [BuiltLens::new(&system, &[]).unwrap(), BuiltLens::of_design(&posed(&system)).unwrap()];
        let [expected, found] = [&expected, &found].map(|lens| SkewTracer::new(lens, UM).unwrap());
        for t in [[0.0, 0.0], [0.02, -0.01]] {
            for (p, q) in [(0.0, 0.0), (0.4, -0.3), (0.0, 0.9)] {
                let difference = worst(ray(&found, t, p, q), ray(&expected, t, p, q));
                assert!(difference < 1e-11, "{name} {t:?} {difference:e}");
            }
            let light = |tracer| field_light(tracer, t).unwrap().irradiance_sr;
            assert!((light(&found) / light(&expected) - 1.0).abs() < 1e-9, "{name} {t:?}");
        }
        // The focal length of the ideal plane is that of the chief rays at the centre.
        let ratio = found.ideal_focal_mm() / expected.ideal_focal_mm();
        assert!((ratio - 1.0).abs() < 1e-6, "{name} {ratio}");
        assert!(matches!(Tracer::new(&posed(&system), UM), Err(DesignError::Asymmetric)));
    }
}

#[test]
fn a_tilted_film_is_that_of_a_lens_with_this_error() {
    let system = double_gauss(RayAiming::Real);
    let tilt = [0.0, 40.0 * ARCMIN];
    let built = BuiltLens::new(&system, &[film(tilt)]).unwrap();
    let image = system.image();
    let tilted = changed(&posed(&system), image, |s| {
        s.pose = s.pose.compose(&Pose::new([0.0; 3], [tilt[0], tilt[1], 0.0]));
    });
    let design = BuiltLens::of_design(&tilted).unwrap();
    let [built, design] = [&built, &design].map(|lens| SkewTracer::new(lens, UM).unwrap());
    for t in [[0.0, 0.0], [0.15, 0.05], [-0.1, 0.12]] {
        for (p, q) in [(0.0, 0.0), (0.7, -0.2)] {
            assert!(worst(ray(&design, t, p, q), ray(&built, t, p, q)) < 1e-11, "{t:?}");
        }
    }
}

/// A plane mirror at 45 degrees before the lens: the picture is that of the lens alone, mirrored; the ideal plane undoes that.
#[test]
fn a_fold_mirror_before_the_lens() {
    let system = double_gauss(RayAiming::Real);
    let straight = BuiltLens::new(&system, &[]).unwrap();
    let (ahead, behind) = (60.0, 40.0);
    let mut folded = system.clone();
    let mirror = Surface { is_mirror: true, ..Surface::new(0.0, behind, Medium::Air) };
    folded.surfaces.insert(0, mirror);
    folded.stop += 1;
    // Towards −y behind the mirror: its normal is turned about x by 45 degrees, the lens by 90.
    let turned = Pose::new([0.0, 0.0, ahead], [2.0 * FRAC_PI_4, 0.0, 0.0]);
    let mut surfaces = vec![FreeSurface {
        pose: Pose::new([0.0, 0.0, ahead], [FRAC_PI_4, 0.0, 0.0]),
        ..FreeSurface::default()
    }];
    for (s, (z, _)) in system.surfaces.iter().zip(system.axis()) {
        surfaces.push(FreeSurface {
            pose: turned.compose(&Pose::at([0.0, 0.0, -behind - z])),
            is_reversed: true,
            shape: s.shape.clone().into(),
            ..FreeSurface::default()
        });
    }
    folded.asymmetry = Some(Asymmetry { surfaces });
    let design = BuiltLens::of_design(&folded).unwrap();
    let [straight, design] = [&straight, &design].map(|lens| SkewTracer::new(lens, UM).unwrap());
    for t in [[0.0, 0.0], [0.1, 0.05], [-0.06, 0.12]] {
        // The mirror reverses y of the field, as the frame behind it is mirrored.
        let expected = ray(&straight, t, 0.0, 0.0);
        let found = [[t[0], t[1]], [t[0], -t[1]]].map(|t| worst(ray(&design, t, 0.0, 0.0), expected));
        assert!(found[0].min(found[1]) < 1e-10, "{t:?} {found:?}");
        // Upright and unmirrored on the ideal plane, whatever the mirror does.
        let (at, ideal) = (ray(&design, t, 0.0, 0.0), design.ideal_point_mm(t));
        assert!(worst(at, ideal) < 0.03 * real::hypot(at[0], at[1]) + 1e-9, "{at:?} {ideal:?}");
    }
}

/// An off-axis part of a paraboloid unites the light of its axis in its focus; the stop is decentred with it.
#[test]
fn an_off_axis_parabola_is_stigmatic() {
    let (focal, offset) = (100.0, 60.0);
    let curvature = -0.5 / focal;
    let mut system = lens(&[(0.0, 120.0, 1.0), (curvature, focal, 1.0)], 0, 10.0);
    system.surfaces[1].is_mirror = true;
    system.surfaces[1].shape.curvature = curvature;
    system.surfaces[1].shape.conic = -1.0;
    let shape = system.surfaces[1].shape.clone();
    let at = |z: f64, y: f64| FreeSurface { pose: Pose::at([0.0, y, z]), ..FreeSurface::default() };
    let mirror = FreeSurface { shape: shape.into(), ..at(120.0, 0.0) };
    let image = FreeSurface { is_reversed: true, ..at(120.0 - focal, 0.0) };
    system.asymmetry = Some(Asymmetry { surfaces: vec![at(0.0, offset), mirror, image] });
    let design = BuiltLens::of_design(&system).unwrap();
    let tracer = SkewTracer::new(&design, UM).unwrap();
    for (p, q) in [(0.0, 0.0), (0.9, 0.1), (-0.3, -0.9), (0.0, 1.0)] {
        assert!(worst(ray(&tracer, [0.0; 2], p, q), [0.0; 2]) < 1e-10, "{p} {q}");
    }
    // tan of a small field times the distance from mirror to focus along the chief ray.
    let along = focal + offset * offset / (4.0 * focal);
    let x = ray(&tracer, [1e-5, 0.0], 0.0, 0.0)[0];
    assert!((x.abs() / (1e-5 * along) - 1.0).abs() < 1e-4, "{x}");
}

/// A lens of two crossed cylinders: different focal lengths along x and y, f their geometric mean.
#[test]
fn anamorphic_squeeze_is_in_the_map() {
    let system = lens(&[(0.0, 30.0, 1.0), (0.02, 2.0, 1.5), (-0.01, 60.0, 1.0)], 0, 2.0);
    let cylinder = |along_x: f64, along_y: f64| {
        let along_y = AlongY { curvature: along_y, swept_mm: Some(1.0 / along_x), ..AlongY::default() };
        move |s: &mut FreeSurface| {
            s.shape = SkewShape { along_y: Some(along_y.clone()), ..SkewShape::default() }
        }
    };
    let posed = changed(&changed(&posed(&system), 1, cylinder(0.025, 0.02)), 2, cylinder(-0.02, -0.01));
    let design = BuiltLens::of_design(&posed).unwrap();
    let tracer = SkewTracer::new(&design, UM).unwrap();
    let chief = tracer.chief([0.0; 2]).unwrap();
    let [fx, fy] = [chief.by_slopes[0][0], -chief.by_slopes[1][1]];
    assert!((tracer.ideal_focal_mm() - (fx * fy).sqrt()).abs() < 1e-9 && (fx / fy - 1.0).abs() > 0.01);
    let ideal = tracer.ideal_point_mm([0.001, 0.001]);
    assert!(ideal[0] > 0.0 && ideal[1] < 0.0);
}

/// Rectangular and decentred apertures: the open area of the pupil in closed form.
#[test]
fn outlines_limit_the_pupil() {
    let system = lens(&[(0.0, 10.0, 1.0)], 0, 5.0);
    let open_area = |outline: Outline, is_hole: bool| {
        let design = changed(&posed(&system), 0, |s| match is_hole {
            true => s.obscuration = Some(outline),
            false => s.aperture = Some(outline),
        });
        let design = BuiltLens::of_design(&design).unwrap();
        let tracer = SkewTracer::new(&design, UM).unwrap();
        let opening = Opening::new(&tracer, [0.0; 2]).unwrap();
        25.0 * opening.nodes(&tracer, [0.0; 2], 8, 64).iter().map(|n| n.weight).sum::<f64>()
    };
    let outline = |form, half_mm, centre_mm| Outline { form, half_mm, centre_mm };
    let cases = [
        (outline(Form::Rectangle, [2.0, 3.0], [1.0, -0.5]), false, 24.0),
        (outline(Form::Rectangle, [9.0, 3.0], [0.0, 0.0]), false, 2.0 * (3.0 * 4.0 + 25.0 * real::asin(0.6))),
        (outline(Form::Ellipse, [2.0, 3.0], [1.0, 0.5]), false, 6.0 * PI),
        (outline(Form::Ellipse, [1.0, 1.5], [-2.0, 1.0]), true, 23.5 * PI),
        (outline(Form::Rectangle, [1.0, 1.5], [-2.0, 1.0]), true, 25.0 * PI - 6.0),
    ];
    for (outline, is_hole, area) in cases {
        let found = open_area(outline, is_hole);
        assert!((found / area - 1.0).abs() < 2e-5, "{outline:?} {found} {area}");
    }
}

fn options() -> TraceOptions {
    TraceOptions { film_pitch_um: 4.0, ..TraceOptions::new(vec![550.0], 4.0) }
}

fn traced(design: &BuiltLens, options: &TraceOptions) -> TracedBand {
    GridTrace::new(design, options, FilmRange::centred([2.4, 1.8])).unwrap().band(0, &mut |_| ()).unwrap()
}

/// A Double Gauss with its film tilted by 3 degrees: tables of a band, their error between nodes against direct traces, bits for any threads.
#[test]
fn tables_of_a_lens_with_a_tilted_film() {
    let system = posed(&double_gauss(RayAiming::Real));
    let tilted = changed(&system, system.image(), |s| {
        s.pose = s.pose.compose(&Pose::new([0.0; 3], [0.05, 0.0, 0.0]));
    });
    let design = BuiltLens::of_design(&tilted).unwrap();
    let options = options();
    let band = with_threads(2, || traced(&design, &options));
    band.tables.check().unwrap();
    let error = band.report.psf_error.unwrap();
    assert!(error.worst <= 1.3 * options.psf_tolerance && !error.limited, "{error:?}");
    let PsfPlaces::Cartesian { x_mm, y_mm } = &band.tables.planar.as_ref().unwrap().psfs else {
        panic!("on columns and rows")
    };
    assert_eq!(x_mm.len() * y_mm.len(), band.tables.psf_energy.len());
    // The defocus changes along y: more rows than columns.
    assert!(y_mm.len() > x_mm.len() && band.report.min_energy >= 0.99, "{} {}", x_mm.len(), y_mm.len());
    // Each PSF is that of its place.
    let tracer = SkewTracer::new(&design, 0.55).unwrap();
    let n = band.psf.size;
    let grid = PsfGrid::new(n / 2, band.psf.pitch_um);
    let (mut scratch, mut psf) = (PsfScratch::default(), Vec::new());
    for (i, j) in [(0, 0), (x_mm.len() - 1, 1), (1, y_mm.len() - 1)] {
        let function = pupil_function(&tracer, [x_mm[i], y_mm[j]], None).unwrap();
        grid.psf_into(&function, 0.0, &mut scratch, &mut psf);
        let sum: f64 = psf.iter().map(|v| f64::from(*v)).sum();
        let stored = band.psf.window(j * x_mm.len() + i);
        let l1: f64 = psf.iter().zip(stored).map(|(a, b)| (f64::from(*a) / sum - f64::from(*b)).abs()).sum();
        assert!(l1 < 1e-3, "{i} {j} {l1:e}");
    }
    let again = with_threads(1, || traced(&design, &options));
    assert!(again.psf.samples == band.psf.samples && again.tables == band.tables);
}

#[test]
fn what_has_no_tables_is_refused() {
    let symmetric = double_gauss(RayAiming::Real);
    let refused = BuiltLens::of_design(&symmetric).unwrap_err().to_string();
    assert!(refused.contains("rotational symmetry"), "{refused}");
    assert!(matches!(
        BuiltLens::new(&posed(&symmetric), &[]),
        Err(SkewError::Design(DesignError::Asymmetric))
    ));
    let far = changed(&posed(&symmetric), 4, |s| {
        s.aperture = Some(Outline { half_mm: [0.0, 1.0], ..Outline::disc(1.0) })
    });
    let error = BuiltLens::of_design(&far).unwrap_err().to_string();
    assert!(error.contains("side that is not positive"), "{error}");
    // A film that no ray reaches, with its place.
    let away = changed(&posed(&symmetric), symmetric.image(), |s| s.pose.origin_mm[0] = 1e4);
    let error = BuiltLens::of_design(&away).unwrap_err().to_string();
    assert!(error.contains("no chief ray lands"), "{error}");
}
