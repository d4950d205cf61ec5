use super::*;
use pipeline::design::system::{Aperture, FieldKind, Medium};

const TRIPLET: &str = "name, A triplet, as printed\n# a comment\nf-number, 4\nfield deg, 0, 14, 20\nwavelengths nm, 486.133, 587.562, 656.273\nfocal length, 50\n\n\
surface, radius (mm), thickness, glass, n_d, V_d, semi-diameter, k, A4, comment\n1, 23.713, 4.831, N-LAK9, 1.691, 54.71, 10\n2, 7331.288, 5.86\n\
stop, -24.456, .975, , 1.67271, 32.25\n4, 21.896, 4.822, air\n5, 86.759, 3.127, 691547\n6, -20.4942, , , , , , 0, 0, the last\n";

fn read(text: &str) -> Result<System, LensFileError> {
    parse(text.as_bytes(), &GlassLibrary::new(), &ReadOptions::default())
}

#[test]
fn triplet_as_printed_has_its_focal_length() {
    let system = read(TRIPLET).unwrap();
    assert_eq!((system.name.as_str(), system.stop, system.surfaces.len()), ("A triplet, as printed", 2, 7));
    assert_eq!((system.aperture, system.field_kind), (Aperture::ImageFNumber(4.0), FieldKind::Angle));
    assert_eq!(
        (system.primary, system.fields.clone(), system.object_distance_mm),
        (1, vec![0.0, 14.0, 20.0], None)
    );
    let p = Paraxial::new(&system, system.primary_um()).unwrap();
    assert!((p.effective_focal_length_mm - 50.0).abs() < 0.1, "{}", p.effective_focal_length_mm);
    assert!(p.focus_shift_mm().abs() < 1e-9 && system.surfaces[5].thickness_mm > 40.0);
    assert!(system.notes.iter().any(|n| n.contains("paraxial focus")), "{:?}", system.notes);
    assert!(!system.notes.iter().any(|n| n.contains("focal length is")));
}

#[test]
fn semicolons_tabs_and_decimal_commas_give_the_same_lens() {
    let plain = read(TRIPLET).unwrap();
    let semicolons = TRIPLET.replace(", as printed", "").replace(',', ";").replace('.', ",");
    let other = read(&semicolons).unwrap();
    assert_eq!(plain.surfaces, other.surfaces);
    assert_eq!(
        read(&TRIPLET.replace(", as printed", "").replace(", ", "\t")).unwrap().surfaces,
        plain.surfaces
    );
}

#[test]
fn units_aspheres_object_and_apertures_are_converted_to_mm() {
    let text = "unit, in\nstop radius, 0.1\nobject height, 0, 0.5\nradius;thickness;n;V;aperture radius;conic;a4;a3;surface\n";
    assert!(read(text).is_err());
    let text = "unit;in\nobject height;0;0,5\nradius;thickness;n;V;aperture radius;conic;a4;a3;surface\n;10;;;;;;;object\n2;0,2;1,5;;0,3;-1;0,01;0,02;stop\n-2;1,1\n";
    let system = read(text).unwrap();
    assert!((system.object_distance_mm.unwrap() - 254.0).abs() < 1e-12);
    let front = &system.surfaces[0];
    assert!((front.shape.curvature * 50.8 - 1.0).abs() < 1e-15 && front.shape.conic == -1.0);
    assert!((front.shape.aspheric[1] * 25.4_f64.powi(3) - 0.01).abs() < 1e-15);
    assert!((front.shape.odd[1] * 25.4_f64.powi(2) - 0.02).abs() < 1e-15);
    assert!((front.aperture_mm.unwrap() - 7.62).abs() < 1e-12 && (system.fields[1] - 12.7).abs() < 1e-12);
    assert!(matches!(&front.medium, Medium::Glass(g) if g.dispersion.index(0.4) == 1.5));
    assert!(matches!(system.aperture, Aperture::StopRadius(r) if (r - 7.62).abs() < 1e-12));
}

#[test]
fn wrong_tables_are_errors_with_their_line() {
    for (from, to, line) in [
        ("4.831", "4,8x1", 9),
        ("N-LAK9, 1.691, 54.71", "N-LAK99", 9),
        ("stop", "mirror stop x", 0),
        ("f-number, 4", "f-number, four", 3),
        ("5, 86.759", "stop, 86.759", 13),
        ("5, 86.759", "object, 86.759", 13),
        ("4, 21.896, 4.822", "4, 21.896,", 13),
        ("semi-diameter", "radius", 8),
        ("f-number, 4", "f-number, 4\nepd, 12", 4),
        ("f-number, 4", "f-number, 4\nunit, mm\nf-number, 8", 5),
    ] {
        let result = read(&TRIPLET.replace(from, to));
        match line {
            0 => assert!(result.is_ok(), "{to}"),
            line => {
                let error = result.unwrap_err();
                assert!(matches!(&error, LensFileError::Line { line: l, .. } if *l == line), "{to}: {error}");
            }
        }
    }
    assert!(read("a, b\n1, 2\n").unwrap_err().to_string().contains("header row"));
    assert!(read(&TRIPLET.replace("stop", "3")).unwrap_err().to_string().contains("stop"));
    let unknown = TRIPLET.replace("comment\n1", "colour\n1");
    assert!(read(&unknown).unwrap().notes.iter().any(|n| n.contains("`colour`")));
    let strict = ReadOptions { strict: true, configuration: None };
    assert!(parse(unknown.as_bytes(), &GlassLibrary::new(), &strict).is_err());
    let other = ReadOptions { strict: false, configuration: Some(2) };
    assert!(parse(TRIPLET.as_bytes(), &GlassLibrary::new(), &other).is_err());
}

#[test]
fn printed_values_that_differ_are_noted() {
    let notes =
        read(&TRIPLET.replace("1.691, 54.71", "1.7, 54.71").replace("focal length, 50", "focal length, 60"))
            .unwrap()
            .notes;
    assert!(notes.iter().any(|n| n.contains("N-LAK9") && n.contains("1.7")), "{notes:?}");
    assert!(notes.iter().any(|n| n.contains("focal length is 60 mm")), "{notes:?}");
}

/// Values are read in the unit of the table, degrees and nm, whatever a name says: another unit is an error.
#[test]
fn units_in_names_must_be_those_of_the_table() {
    for (from, to, line) in [
        ("radius (mm)", "radius (cm)", 8),
        ("thickness,", "thickness [inch],", 8),
        ("A4", "a4 (cm^-3)", 8),
        ("field deg", "field angle (rad)", 4),
        ("wavelengths nm", "wavelengths (µm)", 5),
        ("focal length", "focal length (m)", 6),
        ("f-number, 4", "unit, in", 8),
    ] {
        let error = read(&TRIPLET.replace(from, to)).unwrap_err();
        assert!(matches!(&error, LensFileError::Line { line: l, .. } if *l == line), "{to}: {error}");
    }
    let plain = read(TRIPLET).unwrap();
    for (from, to) in [
        ("field deg", "field angle (deg)"),
        ("wavelengths nm", "wavelengths [nm]"),
        ("A4", "A4 (mm^-3)"),
        ("thickness", "thickness (axial)"),
        ("n_d", "n (d)"),
    ] {
        assert_eq!(read(&TRIPLET.replace(from, to)).unwrap(), plain, "{to}");
    }
    let inches = TRIPLET.replace("f-number, 4", "f-number, 4\nunit, in").replace("(mm)", "(in)");
    let inches = read(&inches).unwrap();
    let apart = inches.surfaces[0].shape.curvature * 25.4 - plain.surfaces[0].shape.curvature;
    assert!(apart.abs() < 1e-15);
}
