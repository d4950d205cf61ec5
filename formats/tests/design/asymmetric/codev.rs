//! CODE V sequence files: tilts and decentres, toroids, special surfaces, apertures.

use super::{is_near, note_of_asymmetry, origin_and_z, sag, surface};
use lenscube_formats::design::{LensFileError, ReadOptions, codev};
use lenscube_pipeline::design::System;
use lenscube_pipeline::design::glass_library::GlassLibrary;
use lenscube_pipeline::design::prescription::asymmetry::{Form, Outline};

fn read(unit: char, surfaces: &str) -> Result<System, LensFileError> {
    let text =
        format!("RDM;LEN\nEPD 4\nDIM {unit}\nWL 587.6\nYAN 0 0.2\nSO 0 1e13\n{surfaces}\nSI 0 0\nGO\n");
    codev::parse(text.as_bytes(), &GlassLibrary::new(), &ReadOptions::default())
}

/// A lens in cm whose first surface has the commands `commands`.
fn singlet(commands: &str) -> Result<System, LensFileError> {
    read('C', &format!("S 0 1\n  STO\nS 5 0.5 NBK7_SCHOTT\n  {commands}\nS -6 8"))
}

#[test]
fn kinds_of_decentres_place_the_surfaces_behind_them() {
    // ADE is left-handed: +20 degrees turn z to +y.
    let (sin, cos) = 20_f64.to_radians().sin_cos();
    let lens = |kind: &str| {
        read('M', &format!("S 0 10\n  STO\nS 50 30 REFL\n  YDE 2; ADE 20{kind}\nS 0 -5")).unwrap()
    };
    for (kind, y, z) in [
        // z of the mirror's frame, that of before, and the frame tilted once more.
        ("", 2.0 + 30.0 * sin, 10.0 + 30.0 * cos),
        ("; DAR", 0.0, 40.0),
        ("; BEN", 2.0 + 30.0 * (2.0 * sin * cos), 10.0 + 30.0 * (cos * cos - sin * sin)),
    ] {
        let system = lens(kind);
        let (mirror, axis) = origin_and_z(&system, 2);
        assert!(
            is_near(&mirror, &[0.0, 2.0, 10.0], 1e-12) && is_near(&axis, &[0.0, sin, cos], 1e-15),
            "{kind}"
        );
        let (next, _) = origin_and_z(&system, 3);
        assert!(is_near(&next, &[0.0, y, z], 1e-12), "{kind}: {next:?}");
        assert!(surface(&system, 3).is_reversed && !surface(&system, 2).is_reversed, "{kind}");
    }
    assert!(note_of_asymmetry(&lens("")).starts_with("surface 2 is tilted or decentred: "));
}

#[test]
fn toroids_and_cylinders() {
    let circle = |r: f64, t: f64| r - r.signum() * (r * r - t * t).sqrt();
    // cm, at 4 mm and 3 mm.
    let (x, y) = (0.4, 0.3);
    let g = circle(5.0, y) + 1e-3 * y.powi(4);
    let swept = |r: f64, g: f64, t: f64| r - r.signum() * ((r - g).powi(2) - t * t).sqrt();
    let h = circle(7.0, x) + 1e-3 * x.powi(4);
    for (commands, expected, what) in [
        ("YTO; RDX 7; A 1e-3", swept(7.0, g, x), "a toroid"),
        ("XTO; RDX 7; A 1e-3", swept(5.0, h, y), "a toroid"),
        ("CYL; A 1e-3", g, "a cylinder"),
        ("CYL; RDY 0; RDX 7; A 1e-3", h, "a cylinder"),
        ("YTO; CUX 0.125", swept(8.0, circle(5.0, y), x), "a toroid"),
    ] {
        let system = singlet(commands).unwrap_or_else(|e| panic!("{commands}: {e}"));
        let s = surface(&system, 2);
        // The file's x and y in the frame of the surface, which XTO rotates about z.
        let local = |v: [f64; 2]| [0, 1].map(|j| s.pose.rotation[0][j] * v[0] + s.pose.rotation[1][j] * v[1]);
        let [u, v] = local([4.0, 3.0]);
        assert!(
            (sag(&system, 2, u, v) - 10.0 * expected).abs() < 1e-12,
            "{commands}: {} {}",
            sag(&system, 2, u, v),
            10.0 * expected
        );
        assert!(note_of_asymmetry(&system).starts_with(&format!("surface 2 is {what}: ")), "{commands}");
    }
    // The straightened lens has the profile along y.
    let curvature = |commands: &str| singlet(commands).unwrap().surfaces[1].shape.curvature;
    assert!((curvature("XTO; RDX 7") - 0.02).abs() < 1e-15 && (curvature("YTO; RDX 7") - 0.02).abs() < 1e-15);
    // The aperture of a rotated surface is rotated with it.
    let system = singlet("XTO; RDX 7; REX 0.6; REY 0.2; ADY 0.1").unwrap();
    let expected = Outline { form: Form::Rectangle, half_mm: [2.0, 6.0], centre_mm: [1.0, 0.0] };
    assert_eq!(surface(&system, 2).aperture, Some(expected));
}

#[test]
fn special_surfaces_and_anamorphic_aspheres() {
    let (x, y) = (0.4_f64, 0.3_f64);
    let r2 = x * x + y * y;
    let conic = |k: f64| 0.2 * r2 / (1.0 + (1.0 - (1.0 + k) * 0.04 * r2).sqrt());
    let biconic =
        (0.1 * x * x + 0.2 * y * y) / (1.0 + (1.0 - 1.5 * 0.01 * x * x - 0.2 * 0.04 * y * y).sqrt());
    for (commands, expected, what) in [
        // C5 is xy, C10 is y³, C1 the conic constant.
        (
            "SPS XYP; SCO C1 -0.5; SCO C5 0.01; SCO C10 0.02",
            conic(-0.5) + 0.01 * x * y + 0.02 * y.powi(3),
            "an XY polynomial",
        ),
        (
            "SPS XYP; SCO NRADIUS 2; SCO K -0.5; SCO C5 0.01",
            conic(-0.5) + 0.01 * x * y / 4.0,
            "an XY polynomial",
        ),
        // C5 is the fourth, ρ² cos 2φ; C6 the fifth, 2ρ² − 1.
        (
            "SPS ZRN; K -0.5; SCO C1 2; SCO C5 0.01; SCO C6 0.02",
            conic(-0.5) + 0.01 * (x * x - y * y) / 4.0 + 0.02 * (2.0 * r2 / 4.0 - 1.0),
            "a Zernike surface",
        ),
        // C8 is the fifth fringe polynomial, ρ² cos 2φ.
        (
            "SPS ZFR; SCO C1 -0.5; SCO C3 2; SCO C8 0.01",
            conic(-0.5) + 0.01 * (x * x - y * y) / 4.0,
            "a Zernike surface",
        ),
        (
            "AAS; RDX 10; KX 0.5; KY -0.8; AR 0.01; BR 0.02; BP 0.25",
            biconic + 0.01 * r2 * r2 + 0.02 * (0.75 * x * x + 1.25 * y * y).powi(3),
            "an anamorphic asphere",
        ),
    ] {
        let system = singlet(commands).unwrap_or_else(|e| panic!("{commands}: {e}"));
        let found = sag(&system, 2, 4.0, 3.0);
        assert!((found - 10.0 * expected).abs() < 1e-12, "{commands}: {found} {}", 10.0 * expected);
        assert!(note_of_asymmetry(&system).starts_with(&format!("surface 2 is {what}: ")), "{commands}");
    }
}

#[test]
fn decentred_apertures_are_outlines() {
    let system = singlet("CIR 0.5; ADX 0.1; ADY -0.2; CIR OBS 0.1; ADY OBS -0.2").unwrap();
    assert!(note_of_asymmetry(&system).starts_with("surface 2 has a decentred aperture: "));
    let disc = |radius: f64, centre_mm| Some(Outline { centre_mm, ..Outline::disc(radius) });
    let s = surface(&system, 2);
    assert_eq!((s.aperture, s.obscuration), (disc(5.0, [1.0, -2.0]), disc(1.0, [0.0, -2.0])));
    let ellipse = singlet("ELX 0.5; ELY 0.25; ADX 0.1").unwrap();
    let expected = Outline { form: Form::Ellipse, half_mm: [5.0, 2.5], centre_mm: [1.0, 0.0] };
    assert_eq!(surface(&ellipse, 2).aperture, Some(expected));
    assert!(!ellipse.notes.iter().any(|n| n.contains("not a circle")), "{:?}", ellipse.notes);
}

#[test]
fn what_is_not_supported_is_an_error_of_one_line() {
    for (commands, words) in [
        ("SPS QCN", "XYP, ZRN and ZFR are"),
        ("SPS ZRN; SCO C1 0; SCO C5 1", "norm radius 0"),
        ("SPS ZFR; SCO C2 1; SCO C3 2", "C2"),
        ("SPS ZFR; SCO C3 2; SCO C41 1", "C41, the last is C40"),
        ("SPS XYP; A 1e-3", "A to J"),
        ("CYL; RDX 7", "along x and along y"),
        ("RDX 7", "not CYL, YTO, XTO or AAS"),
        ("REX 1; REY 2; ARO 30", "ARO"),
    ] {
        let error = singlet(commands).unwrap_err().to_string();
        assert!(error.contains(words) && !error.contains('\n'), "{commands}: {error}");
    }
}
