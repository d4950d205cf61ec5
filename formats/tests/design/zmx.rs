//! The .zmx reader: accepted files, errors with their line, no panic for any input.

use lenscube_formats::design::{LensFileError, ReadOptions, agf, zmx};
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::paraxial::Paraxial;
use pipeline::design::system::{Aperture, FieldKind, RayAiming};
use pipeline::design::{System, describe};
use proptest::prelude::*;

/// A finite-conjugate lens as written by older versions of the design program: no quotes, old field keywords, an asphere, floating
/// apertures.
const OLD: &str = "VERS 41101 487 13667
MODE SEQ
NAME a small lens
NOTE 0 first
UNIT IN X W X CM
FNUM 4.0 1
GFAC 0 0
GCAT SCHOTT
RAIM 1.0E-8 2 1 1 0 0
FTYP 2 0 2 1
XFLD 0 0
YFLD 0 0.1
WAVL 0.55
PWAV 1
SURF 0
  TYPE STANDARD
  CURV 0
  DISZ 10
SURF 1
  STOP
  TYPE EVENASPH
  CURV 0.5 0 0 0
  CONI -0.5
  PARM 2 0.001
  SLAB 12
  DISZ 0.2
  GLAS N-BK7 0 0 1.5 40 0 0 0 0 0 0
  DIAM 0.4 1 0
  FLAP 0 0.4 0
SURF 2
  TYPE STANDARD
  CURV -0.5
  DISZ 1.1
  DIAM 0.4 0 0
SURF 3
  TYPE STANDARD
  CURV 0
  DISZ 0
CONF 1 0 0 0
EFFL 0 2 0 0 0 0 6 2
";

const STRICT: ReadOptions = ReadOptions { strict: true, configuration: None };

fn read(text: &str) -> Result<System, LensFileError> {
    zmx::parse(text.as_bytes(), &GlassLibrary::new(), &ReadOptions::default())
}

#[test]
fn units_apertures_and_aspheres_are_converted_to_mm() {
    let s = read(OLD).unwrap();
    assert_eq!((s.stop, s.aiming, s.aperture), (0, RayAiming::Real, Aperture::WorkingFNumber(4.0)));
    assert!((s.object_distance_mm.unwrap() - 254.0).abs() < 1e-12);
    assert_eq!(s.field_kind, FieldKind::ParaxialImageHeight);
    assert!((s.fields[1] - 2.54).abs() < 1e-12);
    let front = &s.surfaces[0];
    assert!((front.shape.curvature - 0.5 / 25.4).abs() < 1e-15 && front.shape.conic == -0.5);
    // α2 multiplies r⁴: in⁻³ to mm⁻³.
    assert!((front.shape.aspheric[1] - 0.001 / 25.4_f64.powi(3)).abs() < 1e-15);
    assert!((front.aperture_mm.unwrap() - 10.16).abs() < 1e-12 && s.surfaces[1].aperture_mm.is_none());
    let p = Paraxial::new(&s, 0.55).unwrap();
    assert!((p.working_f_number() - 4.0).abs() < 1e-12);
    // In the paraxial image plane, behind which the film lies.
    let d = describe(&s).unwrap();
    assert!((d.paraxial_image_height_mm - 2.54).abs() < 1e-9 && d.paraxial_focus_mm.abs() > 0.1);
}

/// The field point (10°, 20°), whose wavefront OpticStudio prints, is at atan √(tan² 10° + tan² 20°), not at √(10² + 20²) = 22.36 degrees.
#[test]
fn angles_along_x_and_y_are_projected_angles() {
    let points = |x: &str, y: &str| {
        let text =
            OLD.replace("FTYP 2 0 2 1", "FTYP 0 0 2 1").replace("XFLD 0 0", x).replace("YFLD 0 0.1", y);
        read(&text).unwrap().fields
    };
    let fields = points("XFLD 0 10", "YFLD 0 20");
    assert!((fields[1] - 22.020_001_607_717_24).abs() < 1e-12, "{fields:?}");
    assert_eq!(points("XFLD 0 0", "YFLD 0 20.3")[1], 20.3);
    // Heights are lengths.
    let heights = read(&OLD.replace("XFLD 0 0", "XFLD 0 0.1")).unwrap().fields;
    assert!((heights[1] - 2.54 * 2.0_f64.sqrt()).abs() < 1e-12, "{heights:?}");
}

#[test]
fn unit_behind_the_entrance_pupil_holds_for_it() {
    let text = OLD.replacen("UNIT IN X W X CM\nFNUM 4.0 1\n", "ENPD 0.4\nUNIT IN X W X CM\n", 1);
    assert_eq!(read(&text).unwrap().aperture, Aperture::EntrancePupil(0.4 * 25.4));
}

/// Paraxial ray aiming aims at the paraxial radius of the stop, real ray aiming at the height of the real marginal ray there.
#[test]
fn paraxial_ray_aiming_keeps_the_paraxial_stop() {
    let behind = OLD.replacen("  STOP\n", "", 1).replacen("SURF 2\n", "SURF 2\n  STOP\n", 1);
    let real = read(&behind).unwrap();
    let paraxial = read(&behind.replacen("RAIM 1.0E-8 2", "RAIM 1.0E-8 1", 1)).unwrap();
    let radius = Paraxial::new(&real, 0.55).unwrap().stop_radius_mm;
    assert_eq!((paraxial.aiming, paraxial.stop), (RayAiming::Real, 1));
    assert!(matches!(paraxial.aperture, Aperture::StopRadius(r) if (r - radius).abs() < 1e-12));
    // As with the stop's own size for the aperture.
    let floating = behind.replacen("FNUM 4.0 1", "FLOA", 1);
    let floating = floating.replacen("DIAM 0.4 0", &format!("DIAM {} 0", radius / 25.4), 1);
    let na = |s: &System| describe(s).unwrap().real_na;
    let (a, b) = (na(&paraxial), na(&read(&floating).unwrap()));
    assert!((a - b).abs() < 1e-9 && (a - na(&real)).abs() > 1e-4, "{a} {b} {}", na(&real));
}

#[test]
fn utf16_and_latin1_give_the_same_system() {
    let mut wide = vec![0xFF, 0xFE];
    wide.extend(OLD.replace('\n', "\r\n").encode_utf16().flat_map(u16::to_le_bytes));
    assert_eq!(zmx::parse(&wide, &GlassLibrary::new(), &ReadOptions::default()), read(OLD));
    let latin: Vec<u8> = OLD.replace("first", "f\u{fc}r").chars().map(|c| c as u32 as u8).collect();
    assert_eq!(zmx::parse(&latin, &GlassLibrary::new(), &ReadOptions::default()), read(OLD));
}

#[test]
fn unsupported_optics_is_an_error_with_its_line() {
    for (from, to, line) in [
        ("MODE SEQ", "MODE NSC", 2),
        ("FTYP 2 0", "FTYP 7 0", 10),
        ("TYPE EVENASPH", "TYPE GRID_SAG", 21),
        ("PARM 2 0.001", "SCBD 5 0 0 0 0 1 0 0", 24),
        ("TYPE EVENASPH", "TYPE STANDARD", 24),
        ("PARM 2 0.001", "PARM 9 0.001", 24),
        ("CONI -0.5", "CONI x", 23),
        ("GLAS N-BK7", "GLAS N-BK8Q", 27),
        ("SURF 2", "SURF 4", 30),
    ] {
        let e = read(&OLD.replacen(from, to, 1)).unwrap_err();
        assert!(matches!(&e, LensFileError::Line { line: l, .. } if *l == line), "{to}: {e}");
    }
    let e = read(&OLD.replacen("GLAS N-BK7", "GLAS N-BK8Q", 1)).unwrap_err().to_string();
    assert!(e.contains("N-BK7"), "{e}");
    for from in ["STOP\n", "UNIT", "FNUM", "PWAV", "FTYP"] {
        assert!(from == "PWAV" || read(&OLD.replacen(from, "NOTE", 1)).is_err(), "{from}");
    }
    let factors = OLD.replace("PWAV 1", "PWAV 1\nVCYN 0 0.1");
    assert_eq!(read(&factors).unwrap().notes.len(), 1);
    // Without an aperture the semi-diameters stand for the factors.
    let drawn = factors.replace("FLAP", "COMM").replace("DIAM 0.4 1", "DIAM 0.4 0");
    let system = read(&drawn).unwrap();
    assert!((system.surfaces[0].aperture_mm.unwrap() - 10.16).abs() < 1e-4 && system.notes.len() == 1);
}

#[test]
fn unknown_keywords_are_notes_and_errors_where_strict() {
    for text in [OLD.replacen("GCAT SCHOTT", "ABCD 1", 1), OLD.replacen("SLAB 12", "ABCD 1", 1)] {
        let system = read(&text).unwrap();
        assert!(
            system.notes.iter().any(|n| n.contains("`ABCD 1`") && n.contains("ignored")),
            "{:?}",
            system.notes
        );
        let error = zmx::parse(text.as_bytes(), &GlassLibrary::new(), &STRICT).unwrap_err();
        assert!(matches!(error, LensFileError::Line { .. }), "{error}");
    }
}

#[test]
fn apodisation_is_a_note_and_an_error_where_strict() {
    // Factor and type: 0 uniform, 1 Gaussian.
    for (setting, is_noted) in [("GFAC 1 0", false), ("GFAC 0 1", false), ("GFAC 2.3 1", true)] {
        let text = OLD.replace("GFAC 0 0", setting);
        let notes = read(&text).unwrap().notes;
        assert_eq!(notes.iter().any(|n| n.contains("apodisation")), is_noted, "{setting}: {notes:?}");
        assert_eq!(zmx::parse(text.as_bytes(), &GlassLibrary::new(), &STRICT).is_err(), is_noted);
    }
}

#[test]
fn offsets_of_a_glass_are_a_note_and_an_error_where_strict() {
    let glass = |values: &str| OLD.replacen("N-BK7 0 0 1.5 40 0 0 0 0 0 0", &format!("N-BK7 {values}"), 1);
    let offset = glass("4 0 1.5168 64.17 0 0 0 0 0.0005 0.5");
    let notes = read(&offset).unwrap().notes;
    assert!(notes.iter().any(|n| n.contains("line 27") && n.contains("offset")), "{notes:?}");
    let strict = |text: &str| zmx::parse(text.as_bytes(), &GlassLibrary::new(), &STRICT);
    assert!(matches!(strict(&offset), Err(LensFileError::Line { line: 27, .. })));
    assert!(strict(&glass("4 0 1.5168 64.17 0 0 0 0 0 0")).is_ok());
}

#[test]
fn more_surfaces_than_a_lens_has_are_an_error() {
    let surfaces =
        (0..1200).map(|i| format!("SURF {i}\n  TYPE STANDARD\n  CURV 0\n  DISZ 1\n")).collect::<String>();
    let text = format!("MODE SEQ\nUNIT MM\nENPD 1\nFTYP 0 0 1 1\nWAVM 1 0.55 1\n{surfaces}");
    let error = read(&text).unwrap_err().to_string();
    assert!(error.contains("line 4010") && error.contains("more than 1000 surfaces"), "{error}");
}

#[test]
fn extended_aspheres_of_any_norm_radius_are_read() {
    let even = OLD
        .replace("EVENASPH", "XASPHERE")
        .replace("PARM 2 0.001", "XDAT 1 2 0 0\n  XDAT 2 0.5 0 0\n  XDAT 3 0 0 0\n  XDAT 4 6.25E-5 0 0");
    assert_eq!(read(&even).unwrap().surfaces[0].shape.aspheric.len(), 2);
    let (a, b) = (read(&even).unwrap(), read(OLD).unwrap());
    let (a, b) = (a.surfaces[0].shape.aspheric[1], b.surfaces[0].shape.aspheric[1]);
    assert!((a / b - 1.0).abs() < 1e-12, "{a} {b}");
    let odd =
        even.replace("XASPHERE", "XODDASPH").replace("XDAT 1 2", "XDAT 1 5").replace("XDAT 4", "XDAT 7");
    assert_eq!(read(&odd).unwrap().surfaces[0].shape.odd.len(), 3);
    for (from, to) in [("XDAT 2 0.5", "XDAT 2 0"), ("XDAT 4", "XDAT 400")] {
        assert!(read(&even.replace(from, to)).is_err(), "{to}");
    }
}

/// Two configurations: another gap, glass, curvature, stop size, wavelength and field.
#[test]
fn configurations_are_read_by_their_number() {
    let operands = "MNUM 2 1\nMOFF 0 1 \"\" 0\nTHIC 1 1 0.2 0\nTHIC 1 2 0.3 0\nGLSS 1 1 \"N-BK7\" 0\nGLSS 1 2 \"F2\" 0\nCRVT 2 1 -0.5 0\n\
                    CRVT 2 2 -0.25 0\nAPER 0 1 4 0\nAPER 0 2 8 0\nWAVE 1 2 0.6 0\nYFIE 2 2 0.2 0\nSTPS 0 2 2 0\nPRAM 1 2 5 0\nTEMP 0 2 20 0\n";
    let text = format!("{OLD}{operands}");
    let with = |configuration| {
        let options = ReadOptions { strict: false, configuration };
        zmx::parse(text.as_bytes(), &GlassLibrary::new(), &options)
    };
    let first = with(None).unwrap();
    assert_eq!(first.surfaces, read(OLD).unwrap().surfaces);
    assert!(first.notes.iter().any(|n| n.contains("configuration 1 of 2")), "{:?}", first.notes);
    assert_eq!(with(Some(1)).unwrap(), first);
    let second = with(Some(2)).unwrap();
    assert!((second.surfaces[0].thickness_mm - 0.3 * 25.4).abs() < 1e-12);
    assert!((second.surfaces[1].shape.curvature + 0.25 / 25.4).abs() < 1e-15);
    assert!((second.surfaces[0].medium.index(0.587_6).unwrap() - 1.620_04).abs() < 1e-4);
    assert_eq!((second.stop, second.aperture), (1, Aperture::WorkingFNumber(8.0)));
    assert_eq!((second.wavelengths_um[0].0, (second.fields[1] - 5.08).abs() < 1e-12), (0.6, true));
    assert!(second.notes.iter().any(|n| n.contains("PRAM") && n.contains("ignored")), "{:?}", second.notes);
    assert!(with(Some(3)).unwrap_err().to_string().contains("2 configuration"));
    for (from, to) in
        [("THIC 1 2 0.3", "THIC 9 2 0.3"), ("THIC 1 2 0.3", "THIC 1 2 x"), ("\"F2\"", "\"F99Q\"")]
    {
        let options = ReadOptions { strict: false, configuration: Some(2) };
        let error =
            zmx::parse(text.replace(from, to).as_bytes(), &GlassLibrary::new(), &options).unwrap_err();
        assert!(matches!(error, LensFileError::Line { .. }), "{to}: {error}");
    }
    // Saved in the second configuration: the first is made of its operands.
    let saved = text.replace("MNUM 2 1", "MNUM 2 2").replace("THIC 1 1 0.2", "THIC 1 1 0.25");
    let first = read(&saved).unwrap();
    assert!((first.surfaces[0].thickness_mm - 0.25 * 25.4).abs() < 1e-12);
}

#[test]
fn harmless_settings_and_breaks_without_tilt_are_read() {
    for (from, to) in [
        ("GFAC 0 0", "GFAC 1 0"),
        ("FTYP 2 0", "FTYP 3 0"),
        ("SLAB 12", "VDSZ 0 0"),
        ("SLAB 12", "OBSC 0.39 0.4"),
        ("FLAP 0 0.4", "SQAP 0.4 0.5"),
        ("GLAS N-BK7", "GLAS BK7"),
        ("GLAS N-BK7", "GLAS ___BLANK 1 0 1.5168 64.17"),
    ] {
        let system = read(&OLD.replacen(from, to, 1)).unwrap_or_else(|e| panic!("{to}: {e}"));
        let n = system.surfaces[0].medium.index(0.587_561_8).unwrap();
        assert!((n - 1.516_80).abs() < 1e-5, "{to}: {n}");
    }
}

/// A fixed semi-diameter blocks light on the flat rear face of a lens.
#[test]
fn fixed_semi_diameter_is_an_aperture_wherever_the_index_changes() {
    let text = OLD.replacen("CURV -0.5", "CURV 0", 1).replacen("DIAM 0.4 0", "DIAM 0.4 1", 1);
    let rear = &read(&text).unwrap().surfaces[1];
    assert_eq!(rear.shape.curvature, 0.0);
    assert!(rear.aperture_mm.is_some());
}

#[test]
fn catalogue_supplies_a_glass_that_is_not_built_in() {
    let text = OLD.replace("N-BK7", "MYGLASS");
    assert!(read(&text).is_err());
    let mut glasses = GlassLibrary::new();
    let catalogue = agf::parse(b"NM MYGLASS 1 0 1.5 60 0\nCD 2.25 0 0 0 0 0\nLD 0.3 1.0\n").unwrap();
    glasses.add("MINE", catalogue);
    let s = zmx::parse(text.as_bytes(), &glasses, &ReadOptions::default()).unwrap();
    assert!((s.surfaces[0].medium.index(0.5).unwrap() - 1.5).abs() < 1e-15);
}

/// May return an error, must not panic.
fn parse_and_describe(bytes: &[u8]) {
    if let Ok(s) = zmx::parse(bytes, &GlassLibrary::new(), &ReadOptions::default()) {
        let _ = describe(&s);
    }
    let _ = agf::parse(bytes);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    #[test]
    fn mutated_files_never_panic(
        edits in proptest::collection::vec((0_usize..10_000, any::<u8>(), 0_u8..4), 1..12),
        built_in in any::<bool>(),
    ) {
        let source: &[u8] =
            if built_in { include_bytes!("../../data/lenses/double-gauss-28.zmx") } else { OLD.as_bytes() };
        let mut bytes = source.to_vec();
        for (at, value, kind) in edits {
            let at = at % bytes.len().max(1);
            match kind {
                0 if !bytes.is_empty() => bytes[at] = value,
                1 if !bytes.is_empty() => { bytes.remove(at); }
                2 => bytes.insert(at.min(bytes.len()), b"0123456789.-E \nINF"[usize::from(value) % 18]),
                _ => {
                    // A line removed or duplicated.
                    let mut lines: Vec<Vec<u8>> = bytes.split(|b| *b == b'\n').map(<[u8]>::to_vec).collect();
                    let i = at % lines.len();
                    if value < 128 { lines.remove(i); } else { lines.insert(i, lines[i].clone()); }
                    bytes = lines.join(&b'\n');
                }
            }
        }
        parse_and_describe(&bytes);
    }
}
