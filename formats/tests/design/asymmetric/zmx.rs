//! .zmx: coordinate breaks, surface types, apertures with decentres; in inches, so that every length is converted.

use super::{is_near, note_of_asymmetry, origin_and_z, sag, surface};
use lenscube_formats::design::{LensFileError, ReadOptions, optiland, table, zmx};
use lenscube_pipeline::design::System;
use lenscube_pipeline::design::glass_library::GlassLibrary;
use lenscube_pipeline::design::prescription::asymmetry::{Form, Outline};

const INCH: f64 = 25.4;

const HEAD: &str = "MODE SEQ\nUNIT IN\nENPD 0.4\nRAIM 0 2\nFTYP 0 0 1 1\nYFLN 0.3\nWAVM 1 0.55 1\nPWAV 1\nSURF 0\n  TYPE STANDARD\n  DISZ INFINITY\n";

fn parse(text: &str) -> Result<System, LensFileError> {
    zmx::parse(text.as_bytes(), &GlassLibrary::new(), &ReadOptions::default())
}

/// A lens whose first surface has the lines of `surface`, behind a stop.
fn singlet(surface: &str) -> Result<System, LensFileError> {
    parse(&format!(
        "{HEAD}SURF 1\n  STOP\n  DISZ 0.1\nSURF 2\n{surface}  DISZ 0.2\n  GLAS N-BK7\n  DIAM 0.3 1\nSURF 3\n  CURV -0.4\n  DISZ 2\nSURF 4\n  DISZ 0\n"
    ))
}

#[test]
fn places_follow_coordinate_breaks_and_mirrors() {
    let text = format!(
        "{HEAD}SURF 1\n  STOP\n  DISZ 2\nSURF 2\n  TYPE COORDBRK\n  PARM 2 0.5\n  PARM 3 30\n  DISZ 0\nSURF 3\n  CURV -0.05\n  GLAS MIRROR\n  DISZ 0\n\
         SURF 4\n  TYPE COORDBRK\n  PARM 2 0.25\n  PARM 3 30\n  PARM 6 1\n  DISZ -4\nSURF 5\n  DISZ 0\n"
    );
    let system = parse(&text).unwrap();
    assert!(
        note_of_asymmetry(&system).starts_with("surface 3 is tilted or decentred: "),
        "{:?}",
        system.notes
    );
    let cos = |degrees: f64| degrees.to_radians().cos();
    let sin = |degrees: f64| degrees.to_radians().sin();
    // About x by +30 degrees z turns to −y.
    let (mirror, z) = origin_and_z(&system, 3);
    assert!(
        is_near(&mirror, &[0.0, 0.5 * INCH, 2.0 * INCH], 1e-12)
            && is_near(&z, &[0.0, -sin(30.0), cos(30.0)], 1e-15)
    );
    // Then another 30, a decentre along the new y, and −4 along the new z: the light, which came along +z, leaves there.
    let (film, z) = origin_and_z(&system, 5);
    let (y_axis, z_axis) = ([cos(60.0), sin(60.0)], [-sin(60.0), cos(60.0)]);
    let expected = [0, 1].map(|i| mirror[i + 1] + INCH * (0.25 * y_axis[i] - 4.0 * z_axis[i]));
    assert!(
        is_near(&film[1..], &expected, 1e-12) && is_near(&z, &[0.0, z_axis[0], z_axis[1]], 1e-15),
        "{film:?}"
    );
    let flags: Vec<_> =
        system.asymmetry.as_ref().unwrap().surfaces.iter().map(|s| (s.is_frame, s.is_reversed)).collect();
    assert_eq!(flags, [(false, false), (true, false), (false, false), (true, true), (false, true)]);
    // The straightened lens has the gaps of the file along the light, and the shape that the light sees.
    let gaps: Vec<f64> = system.surfaces.iter().map(|s| s.thickness_mm / INCH).collect();
    assert!(is_near(&gaps, &[2.0, 0.0, 0.0, 4.0, 0.0], 1e-12), "{gaps:?}");
    assert!((system.surfaces[2].shape.curvature + 0.05 / INCH).abs() < 1e-15);
    assert!((sag(&system, 3, 0.0, 8.0) + 0.5 * 0.05 / INCH * 64.0).abs() < 1e-3);
    // A tilt beyond a quarter reverses the light along z without a mirror.
    let text = text.replace("PARM 3 30\n  PARM 6 1", "PARM 3 150\n  PARM 6 1").replace("DISZ -4", "DISZ 4");
    let system = parse(&text).unwrap();
    assert!(!surface(&system, 5).is_reversed && (system.surfaces[3].thickness_mm - 4.0 * INCH).abs() < 1e-12);
}

#[test]
fn tilts_of_surfaces_are_breaks_before_and_behind_them() {
    // Around a mirror, order 0: decentre first; behind it order 1.
    let lens = |break_before: &str, mirror: &str, break_behind: &str| {
        let text = format!(
            "{HEAD}SURF 1\n  STOP\n  DISZ 2\n{break_before}SURF NN\n  CURV -0.05\n{mirror}  GLAS MIRROR\n  DISZ {}\n{break_behind}SURF NN\n  DISZ 0\n",
            if break_behind.is_empty() { "-4" } else { "0" }
        );
        let mut number = 1;
        let numbered =
            text.split("NN").collect::<Vec<_>>().iter().enumerate().fold(String::new(), |text, (i, part)| {
                number += usize::from(i > 0);
                if i == 0 { (*part).to_owned() } else { format!("{text}{number}{part}") }
            });
        parse(&numbered).unwrap_or_else(|e| panic!("{e}:\n{numbered}"))
    };
    let behind = "SURF NN\n  TYPE COORDBRK\n  PARM 2 0.2\n  PARM 3 -10\n  PARM 4 7\n  PARM 6 1\n  DISZ -4\n";
    let breaks =
        lens("SURF NN\n  TYPE COORDBRK\n  PARM 1 0.5\n  PARM 3 30\n  PARM 5 20\n  DISZ 0\n", "", behind);
    let own = lens("", "  SCBD 1 0 0 0.5 0 30 0 20\n  SCBD 2 1 0 0 0.2 -10 7 0\n", "");
    for (a, b) in [(2, 3), (3, 5)] {
        let (own, breaks) = (surface(&own, a).pose, surface(&breaks, b).pose);
        assert!(is_near(&own.origin_mm, &breaks.origin_mm, 1e-12), "{own:?} {breaks:?}");
        assert!((0..3).all(|i| is_near(&own.rotation[i], &breaks.rotation[i], 1e-15)), "{own:?} {breaks:?}");
    }
    // A plane mirror that folds the axis, with the saved values of a pickup, and a coordinate return.
    let fold = format!(
        "{HEAD}SURF 1\n  STOP\n  CURV 0.4\n  DISZ 0.2\n  GLAS N-BK7\nSURF 2\n  DISZ 1\nSURF 3\n  SCBD 1 0 0 0.0 0.0 45 0 0\n  SCBD 2 0 1 0.0 0.0 45 0 0\n  GLAS MIRROR\n\
         \x20 DISZ -1\nSURF 4\n  TYPE COORDBRK\n  SCBD 3 1 1\n  DISZ 0\nSURF 5\n  DISZ 0\n"
    );
    let system = parse(&fold).unwrap();
    assert!(
        system.asymmetry.is_none() && system.notes.iter().any(|n| n.contains("1 plane mirror")),
        "{:?}",
        system.notes
    );
}

#[test]
fn breaks_that_cancel_leave_the_lens_symmetric() {
    let text = format!(
        "{HEAD}SURF 1\n  TYPE COORDBRK\n  PARM 1 0.3\n  PARM 4 9\n  DISZ 0\nSURF 2\n  TYPE COORDBRK\n  PARM 1 -0.3\n  PARM 4 -9\n  PARM 6 1\n  DISZ 0\n\
         SURF 3\n  STOP\n  CURV 0.4\n  DISZ 0.2\n  GLAS N-BK7\n  SQAP 0.3 0.2\nSURF 4\n  DISZ 2\nSURF 5\n  DISZ 0\n"
    );
    let system = parse(&text).unwrap();
    assert!(
        system.asymmetry.is_none() && system.notes.iter().any(|n| n.contains("cancel")),
        "{:?}",
        system.notes
    );
    assert!(
        system.notes.iter().any(|n| n.contains("the circle inside it, radius 0.2")),
        "{:?}",
        system.notes
    );
    assert!((system.surfaces[2].aperture_mm.unwrap() - 0.2 * INCH).abs() < 1e-12);
}

#[test]
fn biconic_and_toroidal_surfaces() {
    let system = singlet("  TYPE BICONICX\n  CURV 0.5\n  CONI -0.6\n  PARM 1 4\n  PARM 2 1.5\n").unwrap();
    let shape = &surface(&system, 2).shape;
    let along_y = shape.along_y.as_ref().unwrap();
    assert!(is_near(
        &[shape.base.curvature, shape.base.conic, along_y.curvature, along_y.conic],
        &[0.25 / INCH, 1.5, 0.5 / INCH, -0.6],
        1e-15
    ));
    assert_eq!(
        (system.surfaces[1].shape.curvature, system.surfaces[1].shape.conic),
        (along_y.curvature, -0.6)
    );
    assert!(note_of_asymmetry(&system).starts_with("surface 2 is a biconic surface: "));

    let toroid = "  TYPE TOROIDAL\n  CURV 0.5\n  CONI -0.6\n  PARM 1 3\n  PARM 2 0.01\n  PARM 3 -0.002\n";
    let system = singlet(toroid).unwrap();
    let (x, y) = (4.0 / INCH, 3.0 / INCH);
    let g = 0.5 * y * y / (1.0 + (1.0 - 0.4 * 0.25 * y * y).sqrt()) + 0.01 * y * y - 0.002 * y.powi(4);
    let expected = INCH * (3.0 - ((3.0 - g).powi(2) - x * x).sqrt());
    assert!((sag(&system, 2, 4.0, 3.0) - expected).abs() < 1e-13);
    // The straightened lens: the curvature and the terms of the curve.
    let straight = &system.surfaces[1].shape;
    assert!(
        is_near(&straight.aspheric, &[0.01 / INCH, -0.002 / INCH.powi(3)], 1e-18),
        "{:?}",
        straight.aspheric
    );
    assert!(note_of_asymmetry(&system).starts_with("surface 2 is a toroid: "));
    // The x radius 0 is a cylinder; Zernike standard terms are added: the fourth is √3 (2ρ² − 1).
    let cylinder = toroid.replace("PARM 1 3", "PARM 1 0") + "  XDAT 1 4\n  XDAT 2 2\n  XDAT 6 0.001\n";
    let system = singlet(&cylinder).unwrap();
    let zernike = 0.001 * 3_f64.sqrt() * (2.0 * (x * x + y * y) / 4.0 - 1.0);
    assert!((sag(&system, 2, 4.0, 3.0) - INCH * (g + zernike)).abs() < 1e-13);
    assert!(note_of_asymmetry(&system).starts_with("surface 2 is a cylinder: "));
    // Terms beyond their number are not used; a flat toroid is a plane, a biconic surface of equal axes a conic.
    let unused = cylinder.replace("XDAT 1 4", "XDAT 1 3");
    assert!((sag(&singlet(&unused).unwrap(), 2, 4.0, 3.0) - INCH * g).abs() < 1e-13);
    let flat = singlet("  TYPE TOROIDAL\n  CURV 0\n  PARM 1 0\n").unwrap();
    assert!(flat.asymmetry.is_none() && flat.surfaces[1].shape.is_flat());
    let conic = singlet("  TYPE BICONICX\n  CURV 0.5\n  CONI -1\n  PARM 1 2\n  PARM 2 -1\n").unwrap();
    assert_eq!((conic.asymmetry, conic.surfaces[1].shape.conic), (None, -1.0));
}

#[test]
fn polynomial_and_zernike_surfaces() {
    let (x, y) = (4.0 / INCH, 3.0 / INCH);
    let conic = 0.5 * (x * x + y * y) / (1.0 + (1.0 - 0.25 * (x * x + y * y)).sqrt());
    for (lines, added, what) in [
        // Terms 1 (x), 4 (xy) and 12 (x²y²) over the norm radius 2.
        (
            "XPOLYNOM\n  CURV 0.5\n  XDAT 1 12\n  XDAT 2 2\n  XDAT 3 0.01\n  XDAT 6 0.02\n  XDAT 14 0.03\n",
            conic + 0.01 * x / 2.0 + 0.02 * x * y / 4.0 + 0.03 * (x * y / 4.0).powi(2),
            "an XY polynomial",
        ),
        // The same numbers as parameters.
        (
            "XPOLYNOM\n  CURV 0.5\n  PARM 13 12\n  PARM 14 2\n  PARM 15 0.01\n  PARM 18 0.02\n  PARM 26 0.03\n",
            conic + 0.01 * x / 2.0 + 0.02 * x * y / 4.0 + 0.03 * (x * y / 4.0).powi(2),
            "an XY polynomial",
        ),
        (
            "POLYNOMI\n  PARM 1 0.1\n  PARM 2 0.02\n  PARM 5 0.3\n  PARM 8 0.04\n",
            0.1 * x * x + 0.02 * x.powi(4) + 0.3 * y * y + 0.04 * y.powi(8),
            "an XY polynomial",
        ),
        // √6 ρ² sin 2φ, the fifth of the standard ones, is √6·2 xy.
        (
            "SZERNSAG\n  CURV 0.5\n  PARM 0 1\n  PARM 2 0.07\n  XDAT 1 5\n  XDAT 2 2\n  XDAT 7 0.01\n",
            conic + 0.07 * (x * x + y * y).powi(2) + 0.01 * 6_f64.sqrt() * 2.0 * x * y / 4.0,
            "a Zernike surface",
        ),
        // ρ² cos 2φ is the fifth of the fringe ones.
        (
            "FZERNSAG\n  CURV 0.5\n  XDAT 1 37\n  XDAT 2 2\n  XDAT 7 0.01\n",
            conic + 0.01 * (x * x - y * y) / 4.0,
            "a Zernike surface",
        ),
        ("TILTSURF\n  PARM 1 0.1\n  PARM 2 -0.2\n", 0.1 * x - 0.2 * y, "a tilted plane"),
    ] {
        let system = singlet(&format!("  TYPE {lines}")).unwrap_or_else(|e| panic!("{lines}: {e}"));
        let found = sag(&system, 2, 4.0, 3.0);
        assert!((found - INCH * added).abs() < 1e-12, "{lines}: {found} {}", INCH * added);
        let note = note_of_asymmetry(&system);
        assert!(note.starts_with(&format!("surface 2 is {what}: ")), "{note}");
    }
    // Without terms they are the conic alone.
    for lines in [
        "SZERNSAG\n  CURV 0.5\n  XDAT 1 5\n",
        "XPOLYNOM\n  CURV 0.5\n  XDAT 1 2\n  XDAT 2 1\n",
        "FZERNSAG\n  CURV 0.5\n",
    ] {
        let system = singlet(&format!("  TYPE {lines}")).unwrap();
        assert!(
            system.asymmetry.is_none() && (system.surfaces[1].shape.curvature - 0.5 / INCH).abs() < 1e-15
        );
    }
    // The curvature along y of an XY polynomial counts in the straightened lens.
    let system = singlet("  TYPE POLYNOMI\n  PARM 1 0.1\n  PARM 5 0.3\n").unwrap();
    assert!((system.surfaces[1].shape.paraxial_curvature() - 0.6 / INCH).abs() < 1e-15);
}

#[test]
fn apertures_have_their_own_outlines() {
    let lines = "  TYPE BICONICX\n  CURV 0.5\n  PARM 1 4\n";
    let outline = |added: &str| {
        let system = singlet(&format!("{lines}{added}")).unwrap();
        assert!(!system.notes.iter().any(|n| n.contains("circle inside")), "{:?}", system.notes);
        let s = surface(&system, 2);
        (s.aperture, s.obscuration)
    };
    let of = |form: Form, a: f64, b: f64, x: f64, y: f64| {
        Some(Outline { form, half_mm: [a * INCH, b * INCH], centre_mm: [x * INCH, y * INCH] })
    };
    // The fixed semi-diameter (DIAM with flag 1).
    assert_eq!(outline(""), (of(Form::Ellipse, 0.3, 0.3, 0.0, 0.0), None));
    assert_eq!(
        outline("  SQAP 0.2 0.1 0\n  OBDC 0.05 -0.3\n"),
        (of(Form::Rectangle, 0.2, 0.1, 0.05, -0.3), None)
    );
    assert_eq!(outline("  ELAP 0.2 0.1 0\n"), (of(Form::Ellipse, 0.2, 0.1, 0.0, 0.0), None));
    let disc = |r: f64| of(Form::Ellipse, r, r, 0.0, 0.2);
    assert_eq!(outline("  OBDC 0 0.2\n  CLAP 0.05 0.25 0\n"), (disc(0.25), disc(0.05)));

    // A decentred aperture alone takes the symmetry; a rectangle about the vertex is the circle inside it.
    let lens = |added: &str| singlet(&format!("  CURV 0.5\n{added}")).unwrap();
    let decentred = lens("  CLAP 0 0.25 0\n  OBDC 0 0.2\n");
    assert!(note_of_asymmetry(&decentred).starts_with("surface 2 has a decentred aperture: "));
    assert_eq!(
        (surface(&decentred, 2).aperture, decentred.surfaces[1].aperture_mm),
        (disc(0.25), Some(0.3 * INCH))
    );
    let centred = lens("  SQAP 0.2 0.1 0\n  OBDC 0 0\n");
    assert!(
        centred.asymmetry.is_none() && (centred.surfaces[1].aperture_mm.unwrap() - 0.1 * INCH).abs() < 1e-12
    );
    // Vignetting factors.
    let text = format!(
        "VCXN 0.1\n{HEAD}SURF 1\n  STOP\n  CURV 0.5\n  DISZ 0.2\n  GLAS N-BK7\n  CLAP 0 0.3 0\n  OBDC 0.1 0\nSURF 2\n  DIAM 0.3 0\n  DISZ 2\nSURF 3\n"
    );
    let system = parse(&text).unwrap();
    assert!(system.notes.iter().any(|n| n.contains("vignetting factors are not used")), "{:?}", system.notes);
    assert_eq!(surface(&system, 2).aperture, None);
}

#[test]
fn film_is_the_plane_of_the_image_surface() {
    let text = format!(
        "{HEAD}SURF 1\n  STOP\n  CURV 0.5\n  DISZ 0.2\n  GLAS N-BK7\nSURF 2\n  DISZ 2\nSURF 3\n  TYPE COORDBRK\n  PARM 3 20\n  DISZ 0\nSURF 4\n  TYPE TOROIDAL\n\
         \x20 CURV 0.1\n  PARM 1 5\n  DISZ 0\n"
    );
    let system = parse(&text).unwrap();
    assert!(note_of_asymmetry(&system).starts_with("surface 4 is tilted or decentred: "));
    assert!(surface(&system, 4).shape.base.is_flat() && surface(&system, 4).shape.is_symmetric());
    assert!(system.notes.iter().any(|n| n.contains("image surface is curved")), "{:?}", system.notes);
}

#[test]
fn what_is_not_supported_is_an_error_of_one_line() {
    for (lines, words) in [
        ("  TYPE GRID_SAG\n", "surface type GRID_SAG is not supported"),
        ("  TYPE SZERNSAG\n  PARM 9 0.1\n  XDAT 1 4\n  XDAT 2 1\n  XDAT 6 1\n", "decentred point"),
        ("  TYPE FZERNSAG\n  XDAT 1 38\n  XDAT 2 1\n  XDAT 40 1\n", "a term 38, the maximum is 37"),
        ("  TYPE XPOLYNOM\n  XDAT 1 3\n  XDAT 2 0\n  XDAT 3 1\n", "norm radius 0"),
        ("  TYPE XPOLYNOM\n  XDAT 1 -2\n  XDAT 2 1\n  XDAT 3 1\n", "of -2 terms, expected a whole number"),
        ("  TYPE SZERNSAG\n  XDAT 1 6.7\n  XDAT 2 1\n  XDAT 3 1\n", "of 6.7 terms, expected a whole number"),
        ("  TYPE POLYNOMI\n  CURV 1\n  PARM 1 1\n", "POLYNOMI"),
        ("  TYPE BICONICX\n  PARM 3 1\n", "a parameter that this surface type does not have"),
        ("  TYPE COORDBRK\n  SCBD 1 0 0 0 0 5 0 0\n", "SCBD"),
        ("  TYPE STANDARD\n  SCBD 4 0 0 0 0 5 0 0\n", "coordinate return (3)"),
        ("  TYPE STANDARD\n  SCBD 1 0 0 0 0 0 1e30 0\n", "the tilt is 1e30 deg, expected -360 to 360 deg"),
        ("  TYPE COORDBRK\n  PARM 4 -400\n", "`PARM 4 -400`: the tilt is -400 deg, expected -360 to 360 deg"),
    ] {
        let error = singlet(lines).unwrap_err().to_string();
        assert!(error.contains(words) && !error.contains('\n'), "{lines}: {error}");
    }
}

#[test]
fn formats_of_symmetric_lenses_do_not_hold_them() {
    let system = singlet("  TYPE BICONICX\n  CURV 0.5\n  PARM 1 4\n").unwrap();
    for written in [zmx::write(&system, "own"), table::write(&system, "own"), optiland::write(&system)] {
        let error = written.unwrap_err().to_string();
        assert!(error.contains("no rotational symmetry (surface 2)"), "{error}");
    }
}
