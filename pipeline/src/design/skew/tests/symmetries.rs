//! Turned and mirrored lenses, and mirrors, tilted films, figure errors and glasses in closed form.

use super::lenses::{ARCMIN, REAR, UM, double_gauss, film, lens, moved};
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::{RayAiming, System};
use crate::design::pupil::test_lenses;
use crate::design::rays::surface::Ray;
use crate::design::skew::deviation::{Deviation, ShapeChange, zernike};
use crate::design::skew::error::SkewError;
use crate::design::skew::illumination::field_light;
use crate::design::skew::opening::Opening;
use crate::design::skew::system::BuiltLens;
use crate::design::skew::trace::SkewTracer;
use crate::real;

fn built(system: &System, deviations: &[Deviation]) -> BuiltLens {
    BuiltLens::new(system, deviations).unwrap()
}

/// A ray along z at (x, y) from z = 0, on the film: y up.
fn beam(lens: &BuiltLens, x: f64, y: f64) -> Ray<f64> {
    let tracer = SkewTracer::new(lens, UM).unwrap();
    let start = Ray { p: [x, y, 0.0], d: [0.0, 0.0, 1.0], path: 0.0 };
    tracer.run(start, lens.nominal().image(), |_, _| {}).unwrap()
}

fn chief_and_light(system: &System, deviations: &[Deviation], t: [f64; 2]) -> ([f64; 2], f64) {
    let lens = built(system, deviations);
    let tracer = SkewTracer::new(&lens, UM).unwrap();
    (tracer.chief(t).unwrap().at_mm, field_light(&tracer, t).unwrap().irradiance_sr)
}

/// Deviations turned by 90 degrees about z turn the image; mirrored in x they mirror it. +90 degrees about z take +x to +y, which
/// is UP the film.
#[test]
fn turned_and_mirrored_lenses() {
    for aiming in [RayAiming::Paraxial, RayAiming::Real] {
        let system = double_gauss(aiming);
        // A rear doublet, decentred and tilted; a surface tilted about x; a film tilted about y.
        let original = [
            moved(REAR, [0.05, 0.02], [0.0, 2.0 * ARCMIN]),
            moved([4, 4], [0.0; 2], [ARCMIN, 0.0]),
            film([0.0, 5.0 * ARCMIN]),
        ];
        let turned = [
            moved(REAR, [-0.02, 0.05], [-2.0 * ARCMIN, 0.0]),
            moved([4, 4], [0.0; 2], [0.0, ARCMIN]),
            film([-5.0 * ARCMIN, 0.0]),
        ];
        let mirrored = [
            moved(REAR, [-0.05, 0.02], [0.0, -2.0 * ARCMIN]),
            moved([4, 4], [0.0; 2], [ARCMIN, 0.0]),
            film([0.0, -5.0 * ARCMIN]),
        ];
        let t = [0.12, -0.07];
        let ([x, y], light) = chief_and_light(&system, &original, t);
        let ([tx, ty], turned_light) = chief_and_light(&system, &turned, [-t[1], t[0]]);
        let ([mx, my], mirrored_light) = chief_and_light(&system, &mirrored, [-t[0], t[1]]);
        // In the film frame y is down: (x, y) up turns to (−y, x), so (X, Y) to (Y, −X).
        assert!((tx - y).abs() < 1e-11 && (ty + x).abs() < 1e-11);
        assert!((mx + x).abs() < 1e-11 && (my - y).abs() < 1e-11);
        assert!((turned_light / light - 1.0).abs() < 1e-10 && (mirrored_light / light - 1.0).abs() < 1e-10);
        let ([px, _], _) = chief_and_light(&system, &original, [-t[0], t[1]]);
        assert!((px + x).abs() > 1e-3, "the lens itself has no such symmetry");
    }
}

/// Light of a ray, its place and its slopes on the film.
type Weighted = (f64, [f64; 2], [f64; 2]);

/// A film tilted by a: best focus moves by X tan a along x, not along y.
#[test]
fn a_tilted_film_is_defocus() {
    let (system, a) = (double_gauss(RayAiming::Real), 5.0 * ARCMIN);
    // Shift of the film to the least mean square radius of the spot: −Σ w (h − h̄)(s − s̄)/Σ w |s − s̄|².
    let focus = |deviations: &[Deviation], place: [f64; 2]| {
        let lens = built(&system, deviations);
        let tracer = SkewTracer::new(&lens, UM).unwrap();
        let t = tracer.field_of(place).unwrap();
        let nodes = Opening::new(&tracer, t).unwrap().nodes(&tracer, t, 6, 16);
        let rays: Vec<Weighted> = nodes
            .iter()
            .map(|n| {
                let r = tracer.ray(t, n.p, n.q).unwrap();
                (n.weight * r.flux, [r.x.v, r.y.v], [r.l.v / r.n, r.m.v / r.n])
            })
            .collect();
        let light: f64 = rays.iter().map(|r| r.0).sum();
        let mean = |of: &dyn Fn(&Weighted) -> f64| rays.iter().map(|r| r.0 * of(r)).sum::<f64>() / light;
        let (mut cross, mut square) = (0.0, 0.0);
        for i in 0..2 {
            let (h, s) = (mean(&|r| r.1[i]), mean(&|r| r.2[i]));
            cross += mean(&|r| (r.1[i] - h) * (r.2[i] - s));
            square += mean(&|r| (r.2[i] - s) * (r.2[i] - s));
        }
        -cross / square
    };
    for place in [-8.0, 8.0] {
        let along_x = focus(&[film([0.0, a])], [place, 0.0]) - focus(&[], [place, 0.0]);
        let exact = place * real::tan(a);
        // x to the right goes to −z, nearer to the lens: the focus lies farther behind the film.
        assert!((along_x - exact).abs() < 3e-4 * exact.abs() + 2e-6, "{along_x} {exact}");
        let along_y = focus(&[film([0.0, a])], [0.0, place]) - focus(&[], [0.0, place]);
        assert!(along_y.abs() < 2e-6, "{along_y}");
    }
}

/// A parabola decentred by 30 mm images to its own focus; a plane mirror tilted by a deviates by 2 a.
#[test]
fn mirrors() {
    let (f, off) = (100.0, 30.0);
    let mut parabola = lens(&[(0.0, 20.0, 1.0), (-0.5 / f, f, 1.0)], 0, 1.0);
    parabola.surfaces[1].shape.conic = -1.0;
    parabola.surfaces[1].is_mirror = true;
    let decentred = built(&parabola, &[moved([1, 1], [0.0, -off], [0.0; 2])]);
    let path = beam(&decentred, 0.0, 0.0).path;
    for (x, y) in [(0.0, 0.0), (3.0, 4.0), (-5.0, 2.0)] {
        let ray = beam(&decentred, x, y);
        assert!(ray.p[0].abs() < 1e-12 && (ray.p[1] + off).abs() < 1e-12, "{:?}", ray.p);
        assert!((ray.path - path).abs() < 1e-12);
    }
    let mut plane = lens(&[(0.0, 20.0, 1.0), (0.0, 50.0, 1.0)], 0, 1.0);
    plane.surfaces[1].is_mirror = true;
    for a in [ARCMIN, 0.1] {
        // A tilt about +x turns +y towards +z: the light leaves towards +y.
        let tilted = built(&plane, &[moved([1, 1], [0.0; 2], [a, 0.0])]);
        assert!((beam(&tilted, 0.0, 0.0).p[1] - 50.0 * real::tan(2.0 * a)).abs() < 1e-12);
        // The film tilted about +x: z sin a + y cos a, from its centre, of the point where its plane is met.
        let film = built(&plane, &[film([a, 0.0])]);
        let y = beam(&film, 0.0, 3.0).p[1];
        assert!((y - 3.0 / real::cos(a)).abs() < 1e-12, "{y}");
    }
}

/// A lens with two mirrors, moved as a whole, images as before.
#[test]
fn a_mirror_lens_decentred_is_a_shift() {
    let system = test_lenses::lens("mirror-500");
    let last = system.image() - 1;
    let t = [0.01, 0.02];
    let (at, _) = chief_and_light(&system, &[], t);
    let (shifted, _) = chief_and_light(&system, &[moved([0, last], [0.3, -0.2], [0.0; 2])], t);
    assert!((shifted[0] - at[0] - 0.3).abs() < 1e-10 && (shifted[1] - at[1] - 0.2).abs() < 1e-10);
    let turn = Deviation::element(0, last, [0.0; 2], [0.0, 0.0, 0.7]);
    let (turned, _) = chief_and_light(&system, &[turn], t);
    assert!((0..2).all(|i| (turned[i] - at[i]).abs() < 1e-10));
}

/// A figure error on a plane changes the path by (n − 1) times its sag.
#[test]
fn a_figure_error_changes_the_path() {
    let n = 1.5;
    let plate = lens(&[(0.0, 5.0, n), (0.0, 1.0, 1.0)], 0, 1.0);
    let figure = zernike(2, 2, 1e-4, 5.0, true);
    let shape = ShapeChange { figure: figure.clone(), ..ShapeChange::default() };
    let bump = Deviation::Surface { surface: 0, decentre_mm: [0.0; 2], tilt_rad: [0.0; 2], shape };
    for (x, y) in [(3.0, 1.0), (-1.0, 4.0)] {
        let path = |deviations: &[Deviation]| beam(&built(&plate, deviations), x, y).path;
        let sag: f64 = figure.iter().map(|t| t.coefficient * x.powi(t.i as i32) * y.powi(t.j as i32)).sum();
        assert!((path(std::slice::from_ref(&bump)) - path(&[]) + (n - 1.0) * sag).abs() < 2e-8);
    }
}

/// A change of radius is that of a design with this radius.
#[test]
fn changes_of_shape_and_glass() {
    let mut other = double_gauss(RayAiming::Paraxial);
    other.surfaces[2].shape.curvature += 1e-5;
    other.surfaces[2].shape.conic += 0.01;
    let shape = ShapeChange { curvature: 1e-5, conic: 0.01, figure: vec![] };
    let change = Deviation::Surface { surface: 2, decentre_mm: [0.0; 2], tilt_rad: [0.0; 2], shape };
    let system = double_gauss(RayAiming::Paraxial);
    let (a, b) = (beam(&built(&system, &[change]), 5.0, 2.0), beam(&built(&other, &[]), 5.0, 2.0));
    assert_eq!(a, b);
    let indices = |deviations: &[Deviation], um: f64| built(&system, deviations).indices(um).unwrap();
    let glass = [Deviation::Glass { after: 2, index: 5e-4, abbe: 0.008 }];
    let [blue, red] = [0.486, 0.656].map(|um| (indices(&glass, um)[3], indices(&[], um)[3]));
    let primary = (indices(&glass, UM)[3], indices(&[], UM)[3]);
    assert!((primary.0 - primary.1 - 5e-4).abs() < 1e-15);
    assert!(((blue.0 - red.0) * 1.008 - (blue.1 - red.1)).abs() < 1e-15);
    assert_eq!(indices(&glass, UM)[4], indices(&[], UM)[4]);
}

#[test]
fn deviations_that_do_not_fit_are_errors() {
    let system = double_gauss(RayAiming::Paraxial);
    let gap = |after, thickness_mm, absorb| Deviation::Gap { after, thickness_mm, absorb };
    let bad = [
        moved([3, 11], [0.0; 2], [0.0; 2]),
        moved([3, 2], [0.0; 2], [0.0; 2]),
        moved([3, 4], [f64::NAN, 0.0], [0.0; 2]),
        gap(11, 0.1, None),
        gap(3, 0.1, Some(3)),
        Deviation::Glass { after: 2, index: 0.0, abbe: -1.0 },
    ];
    for deviation in bad {
        assert!(matches!(BuiltLens::new(&system, &[deviation]), Err(SkewError::Deviation { .. })));
    }
    let mut ideal = system.clone();
    ideal.surfaces[5].ideal_focal_mm = Some(100.0);
    assert!(matches!(BuiltLens::new(&ideal, &[]), Err(SkewError::Unsupported { surface: 6, .. })));
}

/// A lens that loses its chief ray, and a place that no chief ray reaches, are errors.
#[test]
fn lost_rays_and_places_are_errors() {
    let system = double_gauss(RayAiming::Real);
    let far = built(&system, &[moved(REAR, [40.0, 0.0], [0.0; 2])]);
    let tracer = SkewTracer::new(&far, UM).unwrap();
    assert!(matches!(tracer.chief([0.0; 2]), Err(DesignError::Ray { .. })));
    assert!(matches!(tracer.field_of([0.0; 2]), Err(SkewError::Place { .. })));
    let nominal = built(&system, &[]);
    let tracer = SkewTracer::new(&nominal, UM).unwrap();
    assert!(matches!(tracer.field_of([500.0, 0.0]), Err(SkewError::Place { .. })));
}
