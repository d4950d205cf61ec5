//! Optiland's JSON: absolute places, geometries, apertures. The sags are those that Optiland 0.6.3 computes.

use super::{is_near, note_of_asymmetry, origin_and_z, sag, surface};
use lenscube_formats::design::{LensFileError, ReadOptions, optiland};
use lenscube_pipeline::design::System;
use lenscube_pipeline::design::glass_library::GlassLibrary;
use lenscube_pipeline::design::prescription::asymmetry::{Form, Outline};

fn cs(x: f64, y: f64, z: f64, rx: f64, ry: f64) -> String {
    format!(r#"{{"x": {x}, "y": {y}, "z": {z}, "rx": {rx}, "ry": {ry}, "rz": 0.0, "reference_cs": null}}"#)
}

fn plane(cs: &str, more: &str) -> String {
    format!(r#"{{"type": "Surface", "geometry": {{"type": "Plane", "cs": {cs}, "radius": Infinity}}{more}}}"#)
}

fn read(surfaces: &[String]) -> Result<System, LensFileError> {
    let object = r#"{"type": "ObjectSurface", "geometry": {"type": "Plane", "cs": {"z": -Infinity}, "radius": Infinity}}"#;
    let text = format!(
        r#"{{"version": 1.0, "aperture": {{"type": "EPD", "value": 10}}, "fields": {{"fields": [{{"x": 0.0, "y": 4.0}}], "field_type": "angle"}},
        "wavelengths": {{"wavelengths": [{{"value": 0.55, "is_primary": true, "unit": "um"}}]}}, "surface_group": {{"surfaces": [{object}, {}]}}}}"#,
        surfaces.join(",")
    );
    optiland::parse(text.as_bytes(), &GlassLibrary::new(), &ReadOptions::default())
}

/// A lens whose first surface has the geometry.
fn singlet(geometry: &str, aperture: &str) -> Result<System, LensFileError> {
    let at = |z: f64| cs(0.0, 0.0, z, 0.0, 0.0);
    let glass = r#""material_post": {"type": "IdealMaterial", "index": 1.5}"#;
    let first = format!(
        r#"{{"type": "Surface", "geometry": {{"cs": {}, {geometry}}}, "is_stop": true, {glass}, "aperture": {aperture}}}"#,
        at(3.0)
    );
    read(&[first, plane(&at(5.0), ""), plane(&at(85.0), "")])
}

#[test]
fn absolute_places_are_those_of_the_lens_frame() {
    let (rx, ry) = (0.3, -0.2);
    let mirror = plane(&cs(1.0, -2.0, 23.0, rx, ry), r#", "is_reflective": true"#);
    let stop = plane(&cs(0.0, 0.0, 3.0, 0.0, 0.0), r#", "is_stop": true"#);
    let curved = format!(
        r#"{{"type": "Surface", "geometry": {{"type": "StandardGeometry", "cs": {}, "radius": -50.0, "conic": -1.0}}, "is_reflective": true}}"#,
        cs(8.0, 9.0, 5.0, rx, ry)
    );
    let system = read(&[stop, mirror, curved, plane(&cs(8.0, 9.0, 45.0, 0.0, 0.0), "")]).unwrap();
    // R = Rz Ry Rx; its z column, and the origin at surface 1.
    let (origin, z) = origin_and_z(&system, 2);
    assert!(is_near(&origin, &[1.0, -2.0, 20.0], 1e-12));
    let (sx, cx) = f64::sin_cos(rx);
    let (sy, cy) = f64::sin_cos(ry);
    assert!(is_near(&z, &[sy * cx, -sx, cy * cx], 1e-15), "{z:?}");
    let flags: Vec<_> = system.asymmetry.as_ref().unwrap().surfaces.iter().map(|s| s.is_reversed).collect();
    assert_eq!(flags, [false, false, true, false]);
    assert!(
        note_of_asymmetry(&system).starts_with("surface 3 is tilted or decentred: "),
        "{:?}",
        system.notes
    );
    // Gaps: distances where one of both is tilted.
    let distance = |v: [f64; 3]| v.iter().map(|c| c * c).sum::<f64>().sqrt();
    let gaps: Vec<f64> = system.surfaces.iter().map(|s| s.thickness_mm).collect();
    let expected = [distance([1.0, -2.0, 20.0]), distance([7.0, 11.0, -18.0]), 40.0, 0.0];
    assert!(is_near(&gaps, &expected, 1e-12), "{gaps:?}");
    // The light sees the mirror's curvature from the other side.
    assert!((system.surfaces[2].shape.curvature - 0.02).abs() < 1e-15 && sag(&system, 3, 0.0, 1.0) < 0.0);
}

#[test]
fn frames_within_frames_are_composed() {
    let inner = r#"{"x": 0.0, "y": 2.0, "z": 0.0, "rx": 0.0, "ry": 0.0, "rz": 0.0, "reference_cs":
        {"x": 0.0, "y": 0.0, "z": 10.0, "rx": 1.5707963267948966, "ry": 0.0, "rz": 0.0, "reference_cs": null}}"#;
    let stop = plane(&cs(0.0, 0.0, 0.0, 0.0, 0.0), r#", "is_stop": true"#);
    let system = read(&[stop, plane(inner, ""), plane(&cs(0.0, 1.0, 20.0, 0.1, 0.0), "")]).unwrap();
    // y of the outer frame is z of the lens frame.
    let (origin, z) = origin_and_z(&system, 2);
    assert!(
        is_near(&origin, &[0.0, 0.0, 12.0], 1e-12) && is_near(&z, &[0.0, -1.0, 0.0], 1e-15),
        "{origin:?} {z:?}"
    );
}

#[test]
fn a_plane_mirror_that_folds_the_axis_leaves_the_lens_symmetric() {
    let quarter = std::f64::consts::FRAC_PI_4;
    let stop = plane(&cs(0.0, 0.0, 0.0, 0.0, 0.0), r#", "is_stop": true"#);
    let lens = format!(
        r#"{{"type": "Surface", "geometry": {{"type": "StandardGeometry", "cs": {}, "radius": 40.0, "conic": 0.0}}, "material_post": {{"type": "IdealMaterial", "index": 1.5}}}}"#,
        cs(0.0, 0.0, 5.0, 0.0, 0.0)
    );
    let mirror = plane(
        &cs(0.0, 0.0, 40.0, quarter, 0.0),
        r#", "is_reflective": true, "material_post": {"type": "IdealMaterial", "index": 1.5}"#,
    );
    let film = |y: f64| plane(&cs(0.0, y, 40.0, 2.0 * quarter, 0.0), "");
    let system = read(&[stop.clone(), lens.clone(), mirror.clone(), film(30.0)]).unwrap();
    assert!(system.asymmetry.is_none(), "{:?}", system.notes);
    let gaps: Vec<f64> = system.surfaces.iter().map(|s| s.thickness_mm).collect();
    assert!(is_near(&gaps, &[5.0, 35.0, 30.0, 0.0], 1e-9), "{gaps:?}");
    let tilted = plane(&cs(0.0, 30.0, 40.0, 2.0 * quarter + 0.01, 0.0), "");
    assert!(read(&[stop, lens, mirror, tilted]).unwrap().asymmetry.is_some());
}

#[test]
fn geometries_without_symmetry() {
    let (x, y) = (4.0_f64, 3.0_f64);
    let (u2, v) = ((x * x + y * y) / 100.0, y / 10.0);
    let circle = |c: f64, k: f64, t: f64| c * t * t / (1.0 + (1.0 - (1.0 + k) * c * c * t * t).sqrt());
    let g = circle(0.02, -0.5, y) + 1e-4 * y * y - 2e-7 * y.powi(4);
    let base = circle(0.02, -0.5, x.hypot(y));
    for (geometry, expected, what) in [
        (
            r#""type": "BiconicGeometry", "radius_x": 30.0, "radius_y": 50.0, "conic_x": 0.7, "conic_y": -0.5"#,
            circle(1.0 / 30.0, 0.7, x) + circle(0.02, -0.5, y),
            "a biconic surface",
        ),
        (
            r#""type": "BiconicGeometry", "radius_x": 30.0, "radius_y": Infinity, "conic_x": 0.7, "conic_y": 0.0"#,
            circle(1.0 / 30.0, 0.7, x),
            "a biconic surface",
        ),
        (
            r#""type": "ToroidalGeometry", "radius_x": 30.0, "radius_y": 50.0, "conic_yz": -0.5, "coeffs_poly_y": [1e-4, -2e-7]"#,
            30.0 - ((30.0 - g).powi(2) - x * x).sqrt(),
            "a toroid",
        ),
        (
            r#""type": "ToroidalGeometry", "radius_x": Infinity, "radius_y": 50.0, "conic_yz": -0.5, "coeffs_poly_y": [1e-4, -2e-7]"#,
            g,
            "a cylinder",
        ),
        (
            r#""type": "PolynomialGeometry", "radius": 50.0, "conic": -0.5, "coefficients": [[0.0, 1e-3], [0.0, 2e-4], [3e-5, 0.0]]"#,
            base + 1e-3 * y + 2e-4 * x * y + 3e-5 * x * x,
            "an XY polynomial",
        ),
        // OSA: j = 1 is ρ sin φ, j = 4 is 2ρ² − 1.
        (
            r#""type": "ZernikePolynomialGeometry", "radius": 50.0, "conic": -0.5, "coefficients": [0, 1e-3, 0, 0, 2e-3], "norm_radius": 10.0, "zernike_type": "standard""#,
            base + 1e-3 * 2.0 * v + 2e-3 * 3_f64.sqrt() * (2.0 * u2 - 1.0),
            "a Zernike surface",
        ),
        (
            r#""type": "ZernikePolynomialGeometry", "radius": 50.0, "conic": -0.5, "coefficients": [0, 0, 1e-3, 2e-3], "norm_radius": 10.0, "zernike_type": "noll""#,
            base + 1e-3 * 2.0 * v + 2e-3 * 3_f64.sqrt() * (2.0 * u2 - 1.0),
            "a Zernike surface",
        ),
        (
            r#""type": "ZernikePolynomialGeometry", "radius": 50.0, "conic": -0.5, "coefficients": [0, 0, 1e-3, 2e-3], "norm_radius": 10.0, "zernike_type": "fringe""#,
            base + 1e-3 * v + 2e-3 * (2.0 * u2 - 1.0),
            "a Zernike surface",
        ),
    ] {
        let system = singlet(geometry, "null").unwrap_or_else(|e| panic!("{geometry}: {e}"));
        let found = sag(&system, 1, x, y);
        assert!((found - expected).abs() < 1e-13, "{geometry}: {found} {expected}");
        assert!(note_of_asymmetry(&system).starts_with(&format!("surface 1 is {what}: ")), "{geometry}");
    }
    for (geometry, words) in [
        (r#""type": "ForbesQ2dGeometry""#, "ForbesQ2dGeometry"),
        (r#""type": "PolynomialGeometry", "radius": 50.0, "coefficients": [[0, "a"]]"#, "not a number"),
        (r#""type": "ZernikePolynomialGeometry", "coefficients": [1], "zernike_type": "other""#, "other"),
        (r#""type": "ZernikePolynomialGeometry", "coefficients": [1], "norm_radius": 0.0"#, "norm radius 0"),
    ] {
        let error = singlet(geometry, "null").unwrap_err().to_string();
        assert!(error.contains(words), "{geometry}: {error}");
    }
}

#[test]
fn apertures_are_outlines() {
    let geometry = r#""type": "StandardGeometry", "radius": 50.0, "conic": 0.0"#;
    let of = |aperture: &str| singlet(geometry, aperture).unwrap();
    let rectangle =
        of(r#"{"type": "RectangularAperture", "x_min": -1.0, "x_max": 3.0, "y_min": 2.0, "y_max": 8.0}"#);
    let expected = Outline { form: Form::Rectangle, half_mm: [2.0, 3.0], centre_mm: [1.0, 5.0] };
    assert_eq!(surface(&rectangle, 1).aperture, Some(expected));
    assert!(note_of_asymmetry(&rectangle).starts_with("surface 1 has a decentred aperture: "));
    let ring = of(
        r#"{"type": "OffsetRadialAperture", "r_max": 4.0, "r_min": 1.0, "offset_x": 0.0, "offset_y": 6.0}"#,
    );
    let disc = |radius: f64| Some(Outline { centre_mm: [0.0, 6.0], ..Outline::disc(radius) });
    assert_eq!((surface(&ring, 1).aperture, surface(&ring, 1).obscuration), (disc(4.0), disc(1.0)));
    // About the vertex they are the circle inside.
    let ellipse =
        of(r#"{"type": "EllipticalAperture", "a": 4.0, "b": 3.0, "offset_x": 0.0, "offset_y": 0.0}"#);
    assert_eq!((ellipse.asymmetry, ellipse.surfaces[0].aperture_mm), (None, Some(3.0)));
    let error = singlet(geometry, r#"{"type": "PolygonAperture"}"#).unwrap_err().to_string();
    assert!(error.contains("PolygonAperture") && error.contains("RectangularAperture"), "{error}");
}
