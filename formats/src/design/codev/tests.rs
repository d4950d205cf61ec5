use super::*;
use pipeline::design::paraxial::Paraxial;

const DOUBLET: &str = "RDM;LEN \"VERSION: 11\"\nTITLE 'a doublet'\nEPD 25.0\nDIM M\nWL 587.6 486.1 &\n 656.3\nREF 1\n\
    XAN 0.0 0.0\nYAN 0.0 1.0 ! degrees\nSO 0.0 0.1e14\nS 61.47 6.0 NBK7_SCHOTT\n  STO\n  CIR 12.0\nS -44.64 2.5 NSF5_SCHOTT; SLB \"b\"\n\
    S -129.94 95.951944\n  CIR EDG 13\n  PIM\nSI 0.0 0.0\nGO\n";

fn read(text: &str) -> Result<System, LensFileError> {
    parse(text.as_bytes(), &GlassLibrary::new(), &ReadOptions::default())
}

#[test]
fn doublet_has_its_catalogue_focal_length() {
    let system = read(DOUBLET).unwrap();
    assert_eq!((system.name.as_str(), system.stop, system.notes.len()), ("a doublet", 0, 0));
    assert_eq!((system.fields.len(), system.wavelengths_um.len()), (2, 3));
    assert_eq!((system.surfaces[0].aperture_mm, system.surfaces[2].aperture_mm), (Some(12.0), None));
    let p = Paraxial::new(&system, 0.5876).unwrap();
    assert!((p.effective_focal_length_mm - 100.0).abs() < 0.05, "{}", p.effective_focal_length_mm);
    assert!(p.focus_shift_mm().abs() < 1e-3, "{}", p.focus_shift_mm());
}

#[test]
fn paraxial_image_solve_is_solved_where_the_gap_is_zero() {
    let solved = read(&DOUBLET.replace("95.951944", "0")).unwrap();
    assert!((solved.surfaces[2].thickness_mm - 95.951944).abs() < 1e-3);
}

#[test]
fn curvature_mode_inches_and_glass_codes_are_converted() {
    let text = DOUBLET
        .replace("RDM;", "")
        .replace("DIM M", "DIM I")
        .replace("S 61.47 6.0 NBK7_SCHOTT", "S 0.5 0.2 516800.641673");
    let system = read(&text).unwrap();
    assert!((system.surfaces[0].shape.curvature - 0.5 / 25.4).abs() < 1e-15);
    let radii = read(&DOUBLET.replace("RDM;", "")).unwrap();
    assert_eq!(radii.surfaces, read(DOUBLET).unwrap().surfaces);
    assert!(radii.notes.iter().any(|n| n.contains("RDM")), "{:?}", radii.notes);
    assert!((system.surfaces[0].medium.index(0.587_561_8).unwrap() - 1.5168).abs() < 1e-9);
    assert!(system.notes.iter().any(|n| n.contains("516800.641673")));
}

#[test]
fn numbered_lists_and_private_glasses_are_read() {
    let text = DOUBLET
        .replace("WL 587.6 486.1 &\n 656.3", "WL W1 587.6 W2 486.1 W3 656.3")
        .replace("YAN 0.0 1.0", "YAN F1 0.0 F2 1.0")
        .replace("NBK7_SCHOTT", "'OWN'")
        .replace(
            "SO 0.0 0.1e14",
            "PRV\nPWL 656.3 587.6 486.1 404.7\n'OWN' 1.51432 1.51680 1.52237 1.53024\nEND\nSO INF INF",
        );
    let system = read(&text).unwrap();
    assert_eq!((system.fields.clone(), system.wavelengths_um.len()), (vec![0.0, 1.0], 3));
    assert_eq!(system.surfaces[0].medium.index(0.5876).unwrap(), 1.5168);
    let between = system.surfaces[0].medium.index(0.546_074).unwrap();
    assert!((between - 1.518_72).abs() < 2e-5, "{between}");
    assert!(system.surfaces[0].medium.index(0.39).is_err() && system.object_distance_mm.is_none());
}

#[test]
fn mirrors_and_obscurations_count_along_the_light() {
    let text = "RDM;LEN\nEPD 4\nDIM I\nWL 587.6\nYAN 0 0.2\nSO 0 1e13\nS 0 8.0\n  CIR OBS L'A' 0.8\nS -24 -8.0 REFL\n  STO\n  K -1.1\n  A 1e-6\n\
        S -12.5 10.4 REFL\nSI 0 0.1\nGO\n";
    let system = read(text).unwrap();
    let [plane, primary, secondary, _] = &system.surfaces[..] else { panic!("{system:?}") };
    assert_eq!(system.aperture, Aperture::EntrancePupil(4.0 * 25.4));
    assert!((plane.obscuration_mm.unwrap() - 0.8 * 25.4).abs() < 1e-12);
    assert!(primary.is_mirror && primary.shape.curvature < 0.0 && primary.shape.aspheric[1] > 0.0);
    // Seen by the light that comes back, the secondary is convex towards it.
    assert!(secondary.is_mirror && secondary.shape.curvature > 0.0);
    let gaps: Vec<f64> = system.surfaces.iter().map(|s| s.thickness_mm / 25.4).collect();
    assert!(gaps.iter().zip([8.0, 8.0, 10.5, 0.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{gaps:?}");
}

#[test]
fn apertures_that_are_not_circles_are_the_circle_inside_with_a_note() {
    for (commands, radius) in [("REX 9; REY 7", 7.0), ("ELX 8; ELY 11", 8.0), ("REX EDG 3", 12.0)] {
        let text = DOUBLET.replace("  CIR 12.0", &format!("  CIR 12.0; {commands}"));
        let system = read(&text).unwrap();
        assert_eq!(system.surfaces[0].aperture_mm, Some(radius), "{commands}");
        let notes = system.notes.iter().filter(|n| n.contains("not a circle")).count();
        assert_eq!(notes, if radius < 12.0 { 2 } else { 0 }, "{:?}", system.notes);
    }
}

#[test]
fn unsupported_optics_is_an_error_with_its_line() {
    for (from, to, line) in
        [("NBK7_SCHOTT", "NBK99_SCHOTT", 11), ("  CIR EDG 13", "  GRT", 16), ("EPD 25.0", "EPD x", 3)]
    {
        let error = read(&DOUBLET.replace(from, to)).unwrap_err();
        assert!(matches!(&error, LensFileError::Line { line: l, .. } if *l == line), "{to}: {error}");
    }
    let returned = read(&DOUBLET.replace("  CIR EDG 13", "  RET S1")).unwrap_err().to_string();
    assert!(returned.contains("`RET S1`") && returned.contains("as a thickness"), "{returned}");
    let macro_file = read("ver no\nlcl num ^x\nfor ^i 1 3\nend for\n").unwrap_err().to_string();
    let strict = ReadOptions { strict: true, configuration: None };
    assert!(macro_file.contains("macro"), "{macro_file}");
    assert!(parse(DOUBLET.replace("GO", "QQQ 1").as_bytes(), &GlassLibrary::new(), &strict).is_err());
}

/// Tilts and decentres whose surfaces are on one axis: gaps along it, and the focal length of the doublet.
#[test]
fn returned_reversed_and_bent_axes_are_straight() {
    let straight = read(DOUBLET).unwrap();
    let last = "S -129.94 95.951944\n  CIR EDG 13\n";
    for (behind, folds) in [
        // A plane that is tilted alone, one that is undone, and two fold mirrors.
        ("S -129.94 50\nS 0 45.951944\n  ADE 30; YDE 2; DAR\n", false),
        (
            "S -129.94 50\nS 0 0\n  YDE 2; ADE 10; BDE -20; ZDE 4\nS 0 45.951944\n  REV; YDE 2; ADE 10; BDE -20; ZDE 4\n",
            false,
        ),
        ("S -129.94 50\nS 0 -40 REFL\n  ADE 45; BEN; CIR 9\nS 0 5.951944 REFL\n  BEN; ADE -45\n", true),
        ("S -129.94 50\nS 0 0 REFL\n  BDE 30; DAR\nS 0 -45.951944\n  BDE 60\n", true),
    ] {
        let system = read(&DOUBLET.replace(last, &format!("{behind}  CIR EDG 13\n"))).unwrap();
        let gaps = |s: &System| s.surfaces.iter().map(|s| s.thickness_mm).sum::<f64>();
        assert!((gaps(&system) - gaps(&straight)).abs() < 1e-9, "{behind}: {}", gaps(&system));
        let (p, q) = (Paraxial::new(&straight, 0.5876).unwrap(), Paraxial::new(&system, 0.5876).unwrap());
        assert!(
            (p.effective_focal_length_mm.abs() - q.effective_focal_length_mm.abs()).abs() < 1e-9,
            "{behind}"
        );
        let word = if folds { "fold the axis at" } else { "on one axis" };
        assert!(system.notes.iter().any(|n| n.contains(word)), "{behind}: {:?}", system.notes);
    }
    // Without effect.
    let none = read(&DOUBLET.replace("  CIR 12.0", "  CIR 12.0\n  DAR; XDE 0; ADE S1 0; CDE 20")).unwrap();
    assert_eq!((none.surfaces, none.notes.len()), (straight.surfaces, 0));
    let with = |line: &str| read(&DOUBLET.replace("  CIR 12.0", &format!("  CIR 12.0\n{line}")));
    for (tilted, surface) in [("  ADE 3", 1), ("  DAR; YDE 1", 1), ("  REV; ADE 2", 2)] {
        let system = with(tilted).unwrap();
        let note = format!("surface {surface} is tilted or decentred: the design has no rotational symmetry");
        assert!(
            system.asymmetry.is_some() && system.notes[0].starts_with(&note),
            "{tilted}: {:?}",
            system.notes
        );
    }
    let error = with("  ADE S0 1").unwrap_err().to_string();
    assert!(error.contains("tilt or decentre of the object"), "{error}");
    for (command, tilt) in [("ADE 1e30", "1e30"), ("BDE -361", "-361"), ("CDE S1 400", "400")] {
        let error = with(&format!("  {command}")).unwrap_err().to_string();
        let expected = format!("`{command}`: the tilt is {tilt} deg, expected -360 to 360 deg");
        assert!(error.starts_with("line ") && error.contains(&expected), "{error}");
    }
    assert!(with("  ADE 360; CDE -360").is_ok());
}

#[test]
fn commands_of_named_surfaces_are_read_wherever_they_stand() {
    let with = |commands: &str| read(&DOUBLET.replace("GO\n", &format!("{commands}\nGO\n")));
    let straight = read(DOUBLET).unwrap();
    assert_eq!(with("THI SO 500").unwrap().object_distance_mm, Some(500.0));
    assert_eq!(with("THI SO 500; THI s0 INF").unwrap(), straight);
    let gap = |s: &System| s.surfaces[2].thickness_mm;
    assert!((gap(&with("THI SI 0.5").unwrap()) - gap(&straight) - 0.5).abs() < 1e-12);
    let curvatures = |s: &System| s.surfaces.iter().map(|s| s.shape.curvature).collect::<Vec<_>>();
    assert_eq!(curvatures(&with("RDY S1 INF").unwrap())[0], 0.0);
    assert_eq!(curvatures(&with("RDY S1..2 80; CUY S3..I 0").unwrap()), [1.0 / 80.0, 1.0 / 80.0, 0.0, 0.0]);
    // Solves: the saved values hold.
    assert_eq!(with("CUY S3 UMY -0.125; THI S3 HMY 0").unwrap(), straight);
    for (command, words) in [
        ("THI S1 X", "`X` is not a number"),
        ("THI S9 5", "no surface 9"),
        ("RDY S1..9 50", "no surface 9"),
        ("CUY S1 INF", "not a number"),
        ("S 0 1", "behind the image"),
    ] {
        let error = with(command).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("line 19"), "{command}: {error}");
    }
    let heights = read(&DOUBLET.replace("YAN 0.0 1.0 ! degrees\n", "").replace("XAN 0.0 0.0", "XIM 0.0 2.0"));
    let heights = heights.unwrap();
    assert_eq!((heights.field_kind, heights.fields), (FieldKind::ParaxialImageHeight, vec![0.0, 2.0]));
}

/// FNO and NA are those of the paraxial marginal ray at the conjugates used.
#[test]
fn f_number_of_a_near_object_is_that_of_its_image() {
    let at = |so: &str, aperture: &str| {
        read(&DOUBLET.replace("SO 0.0 0.1e14", so).replace("EPD 25.0", aperture)).unwrap()
    };
    let near = at("SO 0.0 250", "FNO 8");
    let p = Paraxial::new(&near, near.primary_um()).unwrap();
    assert!((p.working_f_number() - 8.0).abs() < 1e-9, "{}", p.working_f_number());
    assert_eq!(near.aperture, at("SO 0.0 250", "NA 0.0625").aperture);
    assert_eq!(at("SO 0.0 0.1e14", "FNO 8").aperture, Aperture::ImageFNumber(8.0));
}

#[test]
fn apodisation_is_a_note_and_an_error_where_strict() {
    let strict = ReadOptions { strict: true, configuration: None };
    let text = |value: &str| DOUBLET.replace("DIM M", &format!("DIM M\nPUI {value}; PUX 1; PUY 1"));
    let system = read(&text("0.135335")).unwrap();
    assert!(matches!(&system.notes[..], [n] if n.contains("line 5") && n.contains("apodisation")));
    let error = parse(text("0.135335").as_bytes(), &GlassLibrary::new(), &strict).unwrap_err();
    assert!(error.to_string().contains("apodised"), "{error}");
    assert!(parse(text("1").as_bytes(), &GlassLibrary::new(), &strict).is_ok());
}

#[test]
fn glass_in_two_words_is_a_model_glass() {
    let [a, b] =
        ["1.5168 64.17", "1.5168:64.17"].map(|glass| read(&DOUBLET.replace("NBK7_SCHOTT", glass)).unwrap());
    assert_eq!((&a.surfaces, &a.notes), (&b.surfaces, &b.notes));
    assert!((a.surfaces[0].medium.index(0.587_561_8).unwrap() - 1.5168).abs() < 1e-9);
}
