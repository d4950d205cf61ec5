//! Designs written in each format and read again: nothing that the format holds is lost.

use crate::chain::{self, assert_survives_all_formats};
use crate::suite::suite;
use lenscube_formats::design::builtin::LENSES;
use lenscube_formats::design::{LensFileError, ReadOptions, agf, codev, optiland, table, zmx};
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::system::{Aperture, FieldKind, Medium, RayAiming};
use pipeline::design::{System, describe};

/// The fourteen kinds of lenses of `pipeline/tests/lens_suite`.
#[test]
fn every_lens_of_the_suite_survives_all_formats() {
    for entry in suite() {
        assert_survives_all_formats(&entry.system.name, &entry.system);
    }
}

#[test]
fn every_builtin_lens_survives_all_formats() {
    for lens in LENSES {
        let system = lens.system();
        assert_survives_all_formats(lens.name, &system);
        let written = optiland::write(&system).unwrap();
        assert!(written.notes.iter().all(|n| n.contains("Optiland")), "{:?}", written.notes);
    }
}

/// An odd asphere, a finite object, a glass of a catalogue of its own, a glass name of two makers, aperture by the stop's radius.
fn unusual() -> System {
    let text = "name,Unusual\nstop radius,3\nobject height,0,4\nwavelengths nm,500,600\nweights,1,0.5\nprimary nm,500\naiming,paraxial\n\
                surface,radius,thickness,glass,n,V,dP_gF,conic,a1,a2,a3,a4,a18,aperture radius\nobject,,120\n1,31.7,4,OWN,,,,-1.5,0,1e-3,2e-5,-3e-6,0,9\n\
                2,-40,1,F2_CDGM\n3,70,2,F2_SCHOTT\nstop,,3\n5,90,2.5,,1.6,40,0.004,0,0,0,0,1e-6,1e-22\n6,inf,2,,1.4\n7,-60,95\n";
    let mut glasses = GlassLibrary::new();
    let own = "NM OWN 2 0 1.5 60\nCD 1.2 0.01\nLD 0.4 0.7\n";
    glasses.add("mine", agf::parse(own.as_bytes()).unwrap());
    table::parse(text.as_bytes(), &glasses, &ReadOptions::default()).unwrap()
}

#[test]
fn unusual_designs_survive_zmx_and_table() {
    let system = unusual();
    assert_eq!((system.aperture, system.aiming), (Aperture::StopRadius(3.0), RayAiming::Paraxial));
    assert_eq!((system.field_kind, system.object_distance_mm), (FieldKind::ObjectHeight, Some(120.0)));
    let (a, b) = (&system.surfaces[1].medium, &system.surfaces[2].medium);
    assert!(
        matches!((a, b), (Medium::Glass(a), Medium::Glass(b)) if a.name == "F2" && b.name == "F2" && a != b)
    );
    let written = zmx::write(&system, "own").unwrap();
    assert!(written.catalogue.is_some() && written.text.contains("XASPHERE"), "{}", written.text);
    assert_survives_all_formats("unusual", &system);
}

/// A private glass of CODE V is a table of indices.
#[test]
fn private_glasses_of_sequence_files_survive_all_formats() {
    let text = "RDM;LEN\nEPD 8\nDIM M\nWL 656.3 587.6 486.1\nREF 2\nYAN 0 5\nPRV\nPWL 656.3 587.6 486.1\n'OWN' 1.51432 1.5168 1.52237\nEND\n\
                SO 0 1e13\nS 40 5 'OWN'\n  STO\nS -40 36\nSI 0 0\nGO\n";
    let system = codev::parse(text.as_bytes(), &GlassLibrary::new(), &ReadOptions::default()).unwrap();
    assert_eq!(system.surfaces[0].medium.index(0.5876), Ok(1.5168));
    assert_survives_all_formats("private", &system);
}

#[test]
fn optiland_lists_what_it_cannot_hold() {
    let mut system = unusual();
    let notes = optiland::write(&system).unwrap().notes;
    assert!(
        notes.iter().any(|n| n.contains("OWN")) && notes.iter().any(|n| n.contains("ΔP_gF")),
        "{notes:?}"
    );
    system.aperture = Aperture::WorkingFNumber(4.0);
    assert!(optiland::write(&system).unwrap_err().to_string().contains("working F-number"));
}

/// A file as the program itself writes it, with Python's words for numbers that are not finite.
#[test]
fn optilands_own_files_are_read() {
    let surface = |kind: &str, radius: &str, z: f64, after: &str, is_stop: bool| {
        format!(
            r#"{{"type": "Surface", "geometry": {{"type": "{kind}", "cs": {{"x": 0.0, "y": 0.0, "z": {z}, "rx": 0.0, "ry": 0.0, "rz": 0.0}}, "radius": {radius}, "conic": -1.0}}, "material_post": {after}, "is_stop": {is_stop}, "aperture": null, "is_reflective": false}}"#
        )
    };
    let air = r#"{"type": "IdealMaterial", "index": 1.0, "absorp": NaN}"#;
    let glass = r#"{"type": "Material", "filename": "C:\\data-nk\\glass\\hikari\\SK16.yml", "name": "SK16", "reference": null}"#;
    let object = r#"{"type": "ObjectSurface", "geometry": {"type": "Plane", "cs": {"z": -Infinity}, "radius": Infinity}}"#;
    let surfaces = [
        object.to_owned(),
        surface("StandardGeometry", "50.0", 0.0, glass, true),
        surface("Plane", "Infinity", 5.0, air, false),
        surface("Plane", "Infinity", 80.0, air, false),
    ]
    .join(",");
    let text = format!(
        r#"{{"version": 1.0, "aperture": {{"type": "EPD", "value": 10}}, "fields": {{"fields": [{{"x": 3.0, "y": 4.0}}], "field_type": "angle"}}, "wavelengths": {{"wavelengths": [{{"value": 550, "is_primary": true, "unit": "nm"}}]}}, "surface_group": {{"surfaces": [{surfaces}]}}}}"#
    );
    let parse = |text: &str| optiland::parse(text.as_bytes(), &GlassLibrary::new(), &ReadOptions::default());
    let system = parse(&text).unwrap();
    assert_eq!((system.stop, system.fields.len(), system.object_distance_mm), (0, 1, None));
    // Angles along x and y are projected: the tangents add in squares.
    let tan = f64::hypot(f64::tan(3_f64.to_radians()), f64::tan(4_f64.to_radians()));
    assert!((system.fields[0] - tan.atan().to_degrees()).abs() < 1e-12, "{}", system.fields[0]);
    assert_eq!((system.surfaces[0].thickness_mm, system.surfaces[1].thickness_mm), (5.0, 75.0));
    assert!((system.surfaces[0].medium.index(0.587_6).unwrap() - 1.620_4).abs() < 1e-3);
    assert_keys_of_version_0_6(&text, &parse);
    for (from, to, word) in [
        ("\"Plane\", \"cs\": {\"x\"", "\"Zernike\", \"cs\": {\"x\"", "Zernike"),
        (
            "\"cs\": {\"z\": -Infinity}",
            "\"cs\": {\"z\": -Infinity, \"rx\": 0.1}",
            "tilted or decentred object",
        ),
        ("\"EPD\"", "\"EPDX\"", "EPDX"),
        ("\"SK16\"", "\"SK16999\"", "SK16999"),
        ("\"nm\"", "\"furlong\"", "furlong"),
        ("\"surface_group\"", "\"surfaces\"", "Optiland"),
        ("{\"version\": 1.0,", "{\"version\": 1.0", "not JSON"),
    ] {
        let error = parse(&text.replace(from, to)).unwrap_err().to_string();
        assert!(error.contains(word), "{to}: {error}");
    }
}

/// Field type, telecentricity and ray aiming under their keys of version 0.6 and later; both generations of keys are written.
fn assert_keys_of_version_0_6(old: &str, parse: &dyn Fn(&str) -> Result<System, LensFileError>) {
    let new = |kind: &str, telecentric: bool| {
        let fields =
            format!("\"telecentric\": {telecentric}, \"field_definition\": {{\"field_type\": \"{kind}\"}}");
        let aiming = "\"ray_tracer\": {\"ray_aiming_config\": {\"mode\": \"robust\"}}, \"surface_group\"";
        old.replace("\"field_type\": \"angle\"", &fields).replace("\"surface_group\"", aiming)
    };
    for (kind, expected) in [
        ("AngleField", FieldKind::Angle),
        ("ObjectHeightField", FieldKind::ObjectHeight),
        ("ParaxialImageHeightField", FieldKind::ParaxialImageHeight),
        ("RealImageHeightField", FieldKind::RealImageHeight),
    ] {
        let system = parse(&new(kind, false)).unwrap();
        assert_eq!((system.field_kind, system.aiming), (expected, RayAiming::Real), "{kind}");
        let written = optiland::write(&system).unwrap().text;
        assert!(written.contains(kind) && written.contains("ray_aiming_config"), "{written}");
        assert!(written.contains("-Infinity") && !written.contains("300"), "{written}");
    }
    // Optiland's paraxial image height is that on the film, which is not at the focus here.
    let system = parse(&new("ParaxialImageHeightField", false)).unwrap();
    let heights = |s: &System| describe(s).map(|d| (d.paraxial_film_height_mm, d.paraxial_image_height_mm));
    let (film, image) = heights(&system).unwrap();
    assert!((film - 5.0).abs() < 1e-9 && (image - 5.0).abs() > 0.1, "{film} {image}");
    for again in [
        parse(&optiland::write(&system).unwrap().text).unwrap(),
        chain::read(&zmx::write(&system, "own").unwrap(), zmx::parse),
        chain::read(&table::write(&system, "own").unwrap(), table::parse),
    ] {
        assert!((heights(&again).unwrap().0 - film).abs() < 1e-9);
    }
    let gaussian =
        old.replace("{\"version\"", "{\"apodization\": {\"type\": \"GaussianApodization\"}, \"version\"");
    let notes = parse(&gaussian).unwrap().notes;
    assert!(notes.iter().any(|n| n.contains("GaussianApodization")), "{notes:?}");
    let strict = optiland::parse(gaussian.as_bytes(), &GlassLibrary::new(), &chain::STRICT).unwrap_err();
    assert!(strict.to_string().contains("apodised"), "{strict}");
    assert!(parse(&new("PolarField", false)).unwrap_err().to_string().contains("PolarField"));
    let near = new("ObjectHeightField", true).replace("-Infinity", "-300.0");
    let system = parse(&near.replace("\"EPD\", \"value\": 10", "\"objectNA\", \"value\": 0.05")).unwrap();
    assert!(system.is_telecentric);
    let written = optiland::write(&system).unwrap().text;
    assert!(written.contains("\"telecentric\": true"), "{written}");
}
