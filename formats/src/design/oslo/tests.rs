use super::*;
use pipeline::design::paraxial::Paraxial;
use pipeline::design::system::Medium;

const TRIPLET: &str = "// OSLO 6.6 58447     0     0\nLEN NEW \"A triplet; f/4\" 50 7\nEBR  6.25\nANG  20.0\nDES  \"OSLO\"\nUNI  1.0\n// SRF 0\n\
    AIR\nTH   1.0e+20\nAP  3.6397e+19\nNXT  // SRF 1\nGLA SK16\nRD   21.25\nTH   2.0\nAP  CHK 6.5\nNXT  // SRF 2\nAIR\nRD   -158.65\nTH   6.0\n\
    AP  6.5\nNXT  // SRF 3\nGLA F2\nRD   -20.25\nTH   1.0\nAP  5.0\nNXT  // SRF 4\nAIR\nRD   19.3\nTH   6.0\nAP  5.0\nAST\nNXT  // SRF 5\n\
    PK  GLA 1\nRD   141.25\nTH   2.0\nAP  6.5\nNXT  // SRF 6\nAIR\nRD   -17.285\nTH   42.95\nAP  6.5\nNXT  // SRF 7\nAIR\nTH 0.0\nAP  18.2\n\
    WV 0.58756 0.48613 0.65627\nWW 1.0 1.0 1.0\nEND  7\nOPR NEW\nEND\n";

fn read(text: &str) -> Result<System, LensFileError> {
    parse(text.as_bytes(), &GlassLibrary::new(), &ReadOptions::default())
}

#[test]
fn triplet_has_its_focal_length_and_settings() {
    let system = read(TRIPLET).unwrap();
    assert_eq!((system.name.as_str(), system.stop, system.surfaces.len()), ("A triplet; f/4", 3, 7));
    assert_eq!(system.notes.iter().filter(|n| n.contains("ignored")).count(), 0, "{:?}", system.notes);
    assert_eq!(
        (system.aperture, system.fields.clone()),
        (Aperture::EntrancePupil(12.5), vec![0.0, 14.0, 20.0])
    );
    assert_eq!((system.surfaces[0].aperture_mm, system.surfaces[1].aperture_mm), (Some(6.5), None));
    assert_eq!(system.surfaces[4].medium, system.surfaces[0].medium);
    let p = Paraxial::new(&system, system.primary_um()).unwrap();
    // From the radii and the n_d of SK16 and F2.
    assert!((p.effective_focal_length_mm - 50.477_1).abs() < 1e-3, "{}", p.effective_focal_length_mm);
}

#[test]
fn units_glasses_aspheres_and_mirrors_are_converted() {
    let text = "LEN NEW \"x\" 1 4\nUNI 25.4; EBR 1; OBH 2\nTH 40\nNXT\nGLA MOD M1 1.6 1.61 1.59\nCV 0.1\nTH 0.5; AST\nCC -0.5; AD 1e-3\nNXT\nPK CVM 1\nTH 5\n\
        NXT\nRFL; RD -20; TH -3; ASP ASR 3; AS1 0; AS2 1e-4\nNXT\nWV 0.55 0.48 0.65\nEND\n";
    let system = read(text).unwrap();
    let [a, b, mirror, _] = &system.surfaces[..] else { panic!("{system:?}") };
    assert!((a.shape.curvature - 0.1 / 25.4).abs() < 1e-15 && b.shape == a.shape.reversed());
    assert!((a.shape.aspheric[1] - 1e-3 / 25.4f64.powi(3)).abs() < 1e-18);
    assert!(matches!(&a.medium, Medium::Glass(g) if g.index(0.48).unwrap() == 1.61));
    // Behind the mirror lengths count along the light.
    assert!(mirror.is_mirror && (mirror.thickness_mm - 3.0 * 25.4).abs() < 1e-12);
    assert!((mirror.shape.aspheric[1] - 1e-4 / 25.4f64.powi(3)).abs() < 1e-18);
    assert_eq!((system.object_distance_mm, system.field_kind), (Some(1016.0), FieldKind::ObjectHeight));
    assert!(matches!(system.aperture, Aperture::ObjectNa(na) if (na - 1.0 / 1601f64.sqrt()).abs() < 1e-12));
}

#[test]
fn solve_of_the_last_gap_puts_the_film_in_the_paraxial_focus() {
    let solved = read(&TRIPLET.replace("TH   42.95", "PY 0.0")).unwrap();
    let p = Paraxial::new(&solved, solved.primary_um()).unwrap();
    assert!(p.focus_shift_mm().abs() < 1e-9, "{}", p.focus_shift_mm());
    assert!(read(&TRIPLET.replace("TH   6.0\nAP  5.0\nAST", "PY 0.0\nAST")).is_err());
}

#[test]
fn what_is_not_supported_is_an_error_with_its_line() {
    for (from, to, line) in [
        ("RD   21.25", "RD x", 13),
        ("GLA F2", "GLA F2QQQ", 22),
        ("GLA F2", "GLA 1.5 1.6", 22),
        ("AP  CHK 6.5", "TLA 10", 15),
        ("AP  CHK 6.5", "PFL 100", 15),
        ("AP  CHK 6.5", "ASP ZER 4", 15),
        ("AP  CHK 6.5", "PU 0.1", 15),
        ("PK  GLA 1", "PK GLA 9", 33),
        ("ANG  20.0", "AFO ON", 4),
        ("UNI  1.0", "UNI 0", 6),
    ] {
        let error = read(&TRIPLET.replacen(from, to, 1)).unwrap_err();
        assert!(matches!(&error, LensFileError::Line { line: l, .. } if *l == line), "{to}: {error}");
    }
    let unknown = TRIPLET.replace("AST\n", "AST\nQQQ 3\n");
    assert!(read(&unknown).unwrap().notes.iter().any(|n| n.contains("`QQQ 3`") && n.contains("ignored")));
    let strict = ReadOptions { strict: true, configuration: None };
    assert!(parse(unknown.as_bytes(), &GlassLibrary::new(), &strict).is_err());
    for text in ["", "hello", "LEN NEW \"x\" 1 2\nTH 1"] {
        assert!(read(text).is_err(), "{text}");
    }
}

#[test]
fn glass_codes_are_model_glasses() {
    let system = read(&TRIPLET.replacen("GLA F2", "GLA 620364", 1)).unwrap();
    let glasses = system.surfaces.iter().map(|s| s.medium.index(0.587_561_8).unwrap());
    assert!(glasses.into_iter().any(|n| (n - 1.620).abs() < 1e-9), "{system:?}");
    assert!(system.notes.iter().any(|n| n.contains("glass code 620364")), "{:?}", system.notes);
}
