//! Mirrors, central obscurations and folded axes in lens files.

use lenscube_formats::design::{LensFileError, ReadOptions, optiland, table, zmx};
use pipeline::design::System;
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::illumination::{field_light, numerical_aperture};
use pipeline::design::paraxial::Paraxial;
use pipeline::design::ray::Tracer;
use pipeline::design::spots::spot;

/// Newtonian telescope: paraboloid of f = 300 mm, a plane mirror at 45 degrees 150 mm before it, the film beside the tube.
const NEWTON: &str = "MODE SEQ\nUNIT MM\nENPD 100\nRAIM 0 2\nFTYP 0 0 1 1\nYFLN 0.3\nWAVM 1 0.55 1\nPWAV 1\nSURF 0\n  TYPE STANDARD\n  CURV 0\n\
    \x20 DISZ INFINITY\nSURF 1\n  TYPE STANDARD\n  CURV 0\n  DISZ 200\n  OBSC 0 20\nSURF 2\n  STOP\n  TYPE STANDARD\n  CURV -0.00166666666666666667\n  CONI -1\n\
    \x20 GLAS MIRROR\n  DISZ -150\n  CLAP 15 60\nSURF 3\n  TYPE COORDBRK\n  PARM 3 45\n  DISZ 0\nSURF 4\n  TYPE STANDARD\n  CURV 0\n  GLAS MIRROR\n  DISZ 0\n\
    SURF 5\n  TYPE COORDBRK\n  PARM 3 45\n  DISZ 150\nSURF 6\n  TYPE STANDARD\n  CURV 0\n  DISZ 0\n";

fn read(text: &str) -> Result<System, LensFileError> {
    zmx::parse(text.as_bytes(), &GlassLibrary::new(), &ReadOptions::default())
}

#[test]
fn newtonian_telescope_is_in_focus_and_its_obscuration_takes_its_light() {
    let system = read(NEWTON).unwrap();
    assert!(system.notes.iter().any(|n| n.contains("fold the axis at 1 plane mirror")), "{:?}", system.notes);
    assert_eq!(
        (system.surfaces[0].obscuration_mm, system.surfaces[1].obscuration_mm),
        (Some(20.0), Some(15.0))
    );
    // The shadow of a curved mirror, drawn as large as it is.
    let shadow = NEWTON.replace("CURV 0\n  DISZ 200\n", "CURV -0.01\n  DIAM 20 1\n  DISZ 200\n");
    let shadow = &read(&shadow).unwrap().surfaces[0];
    assert_eq!(
        (shadow.shape.curvature, shadow.aperture_mm, shadow.obscuration_mm),
        (-0.01, None, Some(20.0))
    );
    let p = Paraxial::new(&system, 0.55).unwrap();
    assert!((p.effective_focal_length_mm - 300.0).abs() < 1e-9 && p.focus_shift_mm().abs() < 1e-9, "{p:?}");
    // The fold mirror turns the light back along z.
    assert!((p.total_track_mm - 200.0).abs() < 1e-9, "{}", p.total_track_mm);
    let tracer = Tracer::new(&system, 0.55).unwrap();
    assert!(!tracer.passes(0.0, 0.39, 0.0) && tracer.passes(0.0, 0.41, 0.0) && tracer.passes(0.0, 0.0, 0.99));
    // A paraboloid images the axis in a point.
    let axis = spot(&tracer, 0.0).unwrap();
    assert!(axis.strehl > 0.999_999 && axis.geo_um < 1e-6, "{axis:?}");
    let open = read(&NEWTON.replace("  OBSC 0 20\n", "").replace("CLAP 15 60", "CLAP 0 60")).unwrap();
    let whole = Tracer::new(&open, 0.55).unwrap();
    let share =
        field_light(&tracer, 0.0).unwrap().irradiance_sr / field_light(&whole, 0.0).unwrap().irradiance_sr;
    assert!((share - 0.84).abs() < 1e-9, "{share}");
    // The numerical aperture is that of the marginal ray.
    let (a, b) = (numerical_aperture(&tracer).unwrap(), numerical_aperture(&whole).unwrap());
    assert!((a - b).abs() < 1e-9, "{a} {b}");
}

#[test]
fn folded_systems_are_written_along_z_and_read_again() {
    let system = read(NEWTON).unwrap();
    let written = [
        (zmx::write(&system, "own").unwrap().text, zmx::parse as fn(&[u8], &GlassLibrary, &ReadOptions) -> _),
        (table::write(&system, "own").unwrap().text, table::parse),
        (optiland::write(&system).unwrap().text, optiland::parse),
    ];
    for (text, parse) in written {
        let again: Result<System, LensFileError> =
            parse(text.as_bytes(), &GlassLibrary::new(), &ReadOptions::default());
        for (a, b) in system.surfaces.iter().zip(&again.unwrap().surfaces) {
            assert!((a.thickness_mm - b.thickness_mm).abs() < 1e-9, "{text}");
            assert!((a.shape.curvature - b.shape.curvature).abs() < 1e-15, "{text}");
            assert_eq!(
                (a.is_mirror, a.obscuration_mm, a.aperture_mm),
                (b.is_mirror, b.obscuration_mm, b.aperture_mm)
            );
        }
    }
}

/// A lens in front of a prism of glass: a path of 20 mm, straight or folded at 45 degrees after 10 mm.
fn prism(folded: bool, operands: &str) -> String {
    let glass = "GLAS N-BK7 0 0 1.5 40";
    let fold = format!(
        "SURF 4\n  TYPE COORDBRK\n  PARM 3 45\n  DISZ 0\nSURF 5\n  TYPE STANDARD\n  GLAS MIRROR\n  DISZ 0\n\
         SURF 6\n  TYPE COORDBRK\n  PARM 3 45\n  DISZ -10\n  {glass}\nSURF 7\n  TYPE STANDARD\n  DISZ -30\nSURF 8\n"
    );
    let (length, rest) = match folded {
        true => (10, fold),
        false => (20, "SURF 4\n  TYPE STANDARD\n  DISZ 30\nSURF 5\n".to_owned()),
    };
    format!(
        "MODE SEQ\nUNIT MM\nENPD 10\nGCAT SCHOTT\nRAIM 0 0\nFTYP 0 0 1 1\nYFLN 0\nWAVM 1 0.5876 1\nPWAV 1\nSURF 0\n  TYPE STANDARD\n\
         \x20 DISZ INFINITY\nSURF 1\n  STOP\n  TYPE STANDARD\n  CURV 0.02\n  DISZ 5\n  {glass}\nSURF 2\n  TYPE STANDARD\n  CURV -0.02\n  DISZ 5\n\
         SURF 3\n  TYPE STANDARD\n  DISZ {length}\n  {glass}\n{rest}  TYPE STANDARD\n  DISZ 0\n{operands}"
    )
}

/// Coordinate breaks behind a mirror, or behind a glass of another configuration, continue the medium before them.
#[test]
fn prism_is_of_glass_behind_its_mirror() {
    let paraxial = |text: &str, configuration| {
        let options = ReadOptions { strict: false, configuration };
        let system = zmx::parse(text.as_bytes(), &GlassLibrary::new(), &options).unwrap();
        let p = Paraxial::new(&system, 0.5876).unwrap();
        [p.effective_focal_length_mm.abs(), p.focus_shift_mm()]
    };
    let (straight, folded) = (prism(false, ""), prism(true, ""));
    let same = |a: [f64; 2], b: [f64; 2]| (0..2).all(|k| (a[k] - b[k]).abs() < 1e-9);
    let (a, b) = (paraxial(&straight, None), paraxial(&folded, None));
    assert!(same(a, b), "{a:?} {b:?}");
    // The prism of another configuration, in place of the saved one.
    let operands = "MNUM 2 1\nGLSS 3 1 \"N-BK7\" 0\nGLSS 3 2 \"F2\" 0\n";
    let heavy = straight.replacen("DISZ 20\n  GLAS N-BK7", "DISZ 20\n  GLAS F2", 1);
    let (a, b) = (paraxial(&heavy, None), paraxial(&prism(true, operands), Some(2)));
    assert!(same(a, b), "{a:?} {b:?}");
}

#[test]
fn impossible_obscurations_name_the_surface() {
    for (from, to, words) in [
        ("OBSC 0 20", "OBSC 0 60", ["all others are blocked", "(0.0000, 0.0000)"]),
        ("CLAP 15 60", "CLAP 70 60", ["obscuration", "as large as its aperture"]),
    ] {
        let result = read(&NEWTON.replace(from, to)).and_then(|system| {
            let tracer = Tracer::new(&system, 0.55)?;
            field_light(&tracer, 0.0)?;
            Ok(())
        });
        let error = result.unwrap_err().to_string();
        assert!(words.iter().all(|w| error.contains(w)), "{to}: {error}");
    }
}
