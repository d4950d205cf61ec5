//! Readers of lens designs and glasses: .zmx, .seq, .len of OSLO, lens tables, Optiland's JSON, .zar, .agf.

use super::fuzz_support::{Random, damage_text, fuzz};
use lenscube_formats::design::{ReadOptions, agf, builtin, codev, optiland, oslo, table, zar, zmx};
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::{System, describe};
use std::sync::atomic::{AtomicUsize, Ordering};

#[test]
fn damaged_prescriptions_do_not_panic() {
    const LENS: &[u8] = include_bytes!("../../data/lenses/double-gauss-28.zmx");
    let glasses = GlassLibrary::new();
    let make = |r: &mut Random| {
        let mut bytes = LENS.to_vec();
        damage_text(&mut bytes, r);
        match r.below(16) {
            0 => std::iter::once([0xFF, 0xFE]).chain(bytes.iter().map(|b| [*b, 0])).flatten().collect(),
            _ => bytes,
        }
    };
    fuzz(".zmx", 300, make, |bytes| {
        zmx::parse(bytes, &glasses, &ReadOptions::default()).is_ok_and(|system| is_read_and_written(&system))
    });
}

#[test]
fn damaged_sequence_files_do_not_panic() {
    const LENS: &[u8] = b"RDM;LEN\nPRV\nPWL 656.3 587.6 486.1\n'OWN' 1.514 1.517 1.522\n'LAU' LAU 2.3 0 0.02\nEND\nTITLE 'a doublet'\nEPD 25.0\nDIM M\nWL 587.6 486.1 &\n 656.3\nREF 1\nXAN 0.0 0.0\nYAN 0.0 1.0\n\
SO 0.0 0.1e14\nS 61.47 6.0 NBK7_SCHOTT\n  STO\n  CIR 12.0\n  ASP; K -0.5; A 1e-7; B 1e-10\nS -44.64 2.5 620.364; SLB \"b\"\nS -129.94 95.9 'OWN'\nS 0 2\n  PIM\n\
S -300 -40 REFL\n  CIR OBS 3\nS -90 50 REFL\nS 0 0\n  ADE 5; YDE 1\nS 0 2\n  REV; YDE 1; ADE 5\nS 0 -9 REFL\n  ADE 45; BEN\nSI 0.0 0.1\nTHI S3 90\nGO\n";
    let glasses = GlassLibrary::new();
    let make = |r: &mut Random| {
        let mut bytes = LENS.to_vec();
        damage_text(&mut bytes, r);
        bytes
    };
    fuzz(".seq", 500, make, |bytes| {
        codev::parse(bytes, &glasses, &ReadOptions::default())
            .is_ok_and(|system| is_read_and_written(&system))
    });
}

#[test]
fn damaged_oslo_files_do_not_panic() {
    const LENS: &[u8] = b"// OSLO 6.6 1 0 0\nLEN NEW \"A lens\" 50 6\nEBR 6.25\nANG 20.0\nDES \"OSLO\"\nUNI 1.0\nAIR\nTH 1.0e+20\nAP 3.6e+19\n\
NXT // SRF 1\nGLA SK16\nRD 21.25\nTH 2.0\nAP CHK 6.5\nCC -0.5; AD 1e-7\nNXT // SRF 2\nGLA MOD M 1.6 1.61 1.59\nCV -0.006\nTH 6.0\nAST\nNXT\n\
PK CVM 1\nTH 40.0\nASP ASR 3; AS1 0; AS2 1e-8\nNXT\nRFL\nRD -90\nTH -30\nNXT\nPK GLA 1\nRD 0\nPY 0.0\nNXT\nAIR\nTH 0.1\nWV 0.58756 0.48613 \
0.65627\nWW 1.0 1.0 1.0\nEND 6\n";
    let glasses = GlassLibrary::new();
    let make = |r: &mut Random| {
        let mut bytes = LENS.to_vec();
        damage_text(&mut bytes, r);
        bytes
    };
    fuzz("oslo .len", 500, make, |bytes| {
        oslo::parse(bytes, &glasses, &ReadOptions::default()).is_ok_and(|system| is_read_and_written(&system))
    });
}

#[test]
fn damaged_folded_prescriptions_do_not_panic() {
    let mirrors = "  TYPE COORDBRK\n  PARM 1 2\n  PARM 3 45\n  DISZ 0\nSURF 13\n  TYPE STANDARD\n  CURV 0\n  GLAS MIRROR\n  DISZ 0\nSURF 14\n  TYPE COORDBRK\n\
                   \x20 PARM 1 -2\n  PARM 3 45\n  PARM 6 0\n  DISZ -30\nSURF 15\n  TYPE EVENASPH\n  CURV 0.01\n  PARM 2 1e-7\n  CLAP 3 40 0\n  GLAS MIRROR\n  DISZ 60\nSURF 16\n\
                   \x20 TYPE STANDARD\n  CURV 0\n  DISZ 0\n";
    let lens = String::from_utf8_lossy(include_bytes!("../../data/lenses/double-gauss-28.zmx")).into_owned();
    let image = lens.rfind("SURF ").unwrap();
    let folded = format!("{}SURF 12\n{mirrors}", &lens[..image]);
    let glasses = GlassLibrary::new();
    let parse = |bytes: &[u8]| zmx::parse(bytes, &glasses, &ReadOptions::default());
    assert!(parse(folded.replace("  PARM 1 2\n", "").replace("  PARM 1 -2\n", "").as_bytes()).is_ok());
    let make = |r: &mut Random| {
        let mut bytes = folded.as_bytes()[image..].to_vec();
        damage_text(&mut bytes, r);
        [&folded.as_bytes()[..image], &bytes].concat()
    };
    fuzz(".zmx mirrors and breaks", 300, make, |bytes| parse(bytes).is_ok_and(|s| is_read_and_written(&s)));
}

#[test]
fn damaged_telecentric_prescriptions_with_ideal_lenses_do_not_panic() {
    const LENS: &[u8] = b"MODE SEQ\nUNIT MM\nOBNA 0.1 0\nRAIM 0 0\nFTYP 1 1 2 1\nYFLN 0 8\nWAVM 1 0.55 1\nPWAV 1\nSURF 0\n  TYPE STANDARD\n  DISZ 100\n\
SURF 1\n  TYPE PARAXIAL\n  PARM 1 100\n  PARM 2 1\n  DISZ 100\nSURF 2\n  STOP\n  TYPE STANDARD\n  DISZ 50\nSURF 3\n  TYPE PARAXIAL\n  PARM 1 60\n  DISZ 5\n\
SURF 4\n  TYPE STANDARD\n  CURV 0.01\n  GLAS N-BK7\n  DISZ 3\nSURF 5\n  TYPE STANDARD\n  DISZ 45\nSURF 6\n  TYPE STANDARD\n  DISZ 0\n";
    let glasses = GlassLibrary::new();
    let parse = |bytes: &[u8]| zmx::parse(bytes, &glasses, &ReadOptions::default());
    assert!(parse(LENS).is_ok_and(|s| is_read_and_written(&s)));
    let make = |r: &mut Random| {
        let mut bytes = LENS.to_vec();
        damage_text(&mut bytes, r);
        bytes
    };
    fuzz(".zmx telecentric", 300, make, |bytes| parse(bytes).is_ok_and(|s| is_read_and_written(&s)));
}

/// Whether what is written of a design is read again, and its first-order data are found. Always true of a case that a long run only reads: the
/// rest takes ten times as long.
fn is_read_and_written(system: &System) -> bool {
    static ACCEPTED: AtomicUsize = AtomicUsize::new(0);
    let is_long = std::env::var_os("LENSCUBE_FUZZ_CASES").is_some();
    if is_long && !ACCEPTED.fetch_add(1, Ordering::Relaxed).is_multiple_of(16) {
        return true;
    }
    let glasses = GlassLibrary::new();
    let options = ReadOptions::default();
    if let Ok(written) = zmx::write(system, "own") {
        let _ = zmx::parse(written.text.as_bytes(), &glasses, &options);
    }
    if let Ok(written) = table::write(system, "own") {
        let _ = table::parse(written.text.as_bytes(), &glasses, &options);
    }
    if let Ok(written) = optiland::write(system) {
        let _ = optiland::parse(written.text.as_bytes(), &glasses, &options);
    }
    describe(system).is_ok()
}

/// Whether a design is read with its true surfaces; that it is not written must be one line.
fn is_asymmetric(system: &System) -> bool {
    let error = zmx::write(system, "own").err().map(|e| e.to_string());
    assert!(system.asymmetry.is_none() || error.is_some_and(|e| !e.contains('\n')));
    system.asymmetry.is_some()
}

#[test]
fn damaged_designs_without_symmetry_do_not_panic() {
    let glasses = GlassLibrary::new();
    let zemax = "MODE SEQ\nUNIT IN\nENPD 0.4\nRAIM 0 2\nFTYP 0 0 1 1\nYFLN 0.3\nWAVM 1 0.55 1\nPWAV 1\nSURF 0\n  TYPE STANDARD\n  DISZ INFINITY\n\
        SURF 1\n  STOP\n  DISZ 0.1\nSURF 2\n  TYPE TOROIDAL\n  CURV 0.5\n  PARM 1 3\n  PARM 3 0.01\n  XDAT 1 4\n  XDAT 2 2\n  XDAT 6 0.1\n  GLAS N-BK7\n  SQAP 0.2 0.3\n  OBDC 0.1 0\n\
        \x20 DISZ 0.2\nSURF 3\n  TYPE BICONICX\n  CURV -0.2\n  PARM 1 4\n  PARM 2 -1\n  DISZ 1\nSURF 4\n  TYPE COORDBRK\n  PARM 2 0.1\n  PARM 3 30\n  PARM 6 1\n  DISZ 0\nSURF 5\n\
        \x20 TYPE SZERNSAG\n  PARM 2 0.1\n  XDAT 1 6\n  XDAT 2 1\n  XDAT 7 0.1\n  SCBD 2 0 1 0 0 30 0 0\n  GLAS MIRROR\n  DISZ -1\nSURF 6\n  TYPE XPOLYNOM\n  XDAT 1 5\n  XDAT 2 1\n\
        \x20 XDAT 7 0.1\n  DISZ -1\nSURF 7\n  TYPE TILTSURF\n  PARM 1 0.1\n  DISZ -0.1\nSURF 8\n  TYPE POLYNOMI\n  PARM 5 0.1\n  ELAP 1 2\n  CLAP 0.1 1\n  DISZ -1\nSURF 9\n  DISZ 0\n";
    let code_v = "RDM;LEN\nEPD 4\nDIM C\nWL 587.6\nYAN 0 0.2\nSO 0 1e13\nS 0 1\n  STO\nS 5 0.5 NBK7_SCHOTT\n  YTO; RDX 7; A 1e-3; REX 0.6; REY 0.2; ADY 0.1\nS -6 8\n\
        \x20 SPS XYP; SCO K -0.5; SCO C5 0.01; YDE 0.1; ADE 3; DAR\nS 9 -8 REFL\n  SPS ZRN; SCO C1 2; SCO C5 0.01; ADE 20; BEN\nS 7 -1\n  AAS; RDX 10; KX 0.5; AR 0.01; AP 0.2\nSI 0 0\nGO\n";
    let lenses = [zemax.as_bytes(), code_v.as_bytes()];
    let parse = |bytes: &[u8]| match bytes.starts_with(b"MODE") {
        true => zmx::parse(bytes, &glasses, &ReadOptions::default()),
        false => codev::parse(bytes, &glasses, &ReadOptions::default()),
    };
    for lens in lenses {
        assert!(is_asymmetric(&parse(lens).unwrap()));
    }
    let make = |r: &mut Random| {
        let kind = r.below(2);
        let mut bytes = lenses[kind][8..].to_vec();
        damage_text(&mut bytes, r);
        [&lenses[kind][..8], &bytes].concat()
    };
    fuzz("designs without symmetry", 400, make, |bytes| parse(bytes).is_ok_and(|s| is_asymmetric(&s)));

    let cs = |x: f64, z: f64, rx: f64| {
        format!(
            r#""cs": {{"x": {x}, "y": 1.0, "z": {z}, "rx": {rx}, "ry": 0.2, "rz": 0.0, "reference_cs": null}}"#
        )
    };
    let surface = |geometry: &str, cs: &str, more: &str| {
        format!(r#"{{"type": "Surface", "geometry": {{{geometry}, {cs}}}{more}}}"#)
    };
    let surfaces = [
        r#"{"type": "ObjectSurface", "geometry": {"type": "Plane", "cs": {"z": -Infinity}, "radius": Infinity}}"#.to_owned(),
        surface(r#""type": "BiconicGeometry", "radius_x": 30.0, "radius_y": 50.0"#, &cs(0.0, 0.0, 0.0), r#", "is_stop": true"#),
        surface(r#""type": "ToroidalGeometry", "radius_x": 30.0, "radius_y": 50.0, "coeffs_poly_y": [1e-4]"#, &cs(1.0, 5.0, 0.1), r#", "is_reflective": true"#),
        surface(r#""type": "PolynomialGeometry", "radius": 50.0, "coefficients": [[0, 1e-3], [1e-4, 0]]"#, &cs(1.0, -5.0, 0.1), r#", "aperture": {"type": "RectangularAperture", "x_min": -1.0, "x_max": 2.0, "y_min": -1.0, "y_max": 2.0}"#),
        surface(r#""type": "ZernikePolynomialGeometry", "radius": 50.0, "norm_radius": 9.0, "coefficients": [0, 1e-3, 0, 0, 2e-3]"#, &cs(0.0, -9.0, 0.0), r#", "aperture": {"type": "EllipticalAperture", "a": 2.0, "b": 1.0, "offset_x": 1.0, "offset_y": 0.0}"#),
        surface(r#""type": "Plane", "radius": Infinity"#, &cs(0.0, -20.0, 0.3), ""),
    ];
    let lens = format!(
        r#"{{"version": 1.0, "aperture": {{"type": "EPD", "value": 10}}, "fields": {{"fields": [{{"x": 0.0, "y": 4.0}}], "field_type": "angle"}}, "wavelengths": {{"wavelengths": [{{"value": 0.55, "is_primary": true, "unit": "um"}}]}}, "surface_group": {{"surfaces": [{}]}}}}"#,
        surfaces.join(",")
    );
    let parse = |bytes: &[u8]| optiland::parse(bytes, &glasses, &ReadOptions::default());
    assert!(is_asymmetric(&parse(lens.as_bytes()).unwrap()));
    let make = |r: &mut Random| {
        let mut bytes = lens.clone().into_bytes();
        damage_text(&mut bytes, r);
        bytes
    };
    fuzz("optiland .json without symmetry", 300, make, |bytes| parse(bytes).is_ok_and(|s| is_asymmetric(&s)));
}

#[test]
fn damaged_configurations_do_not_panic() {
    let lens = String::from_utf8_lossy(include_bytes!("../../data/lenses/double-gauss-28.zmx")).into_owned();
    let operands = "MNUM 2 1\nTHIC 5 1 3.7 0\nTHIC 5 2 4.7 0\nGLSS 3 2 \"F2\" 0\nCRVT 2 2 -0.25 0\nAPER 0 2 8 0\nWAVE 1 2 0.6 0\nYFIE 2 2 5 0\n\
                    STPS 0 2 4 0\nSDIA 5 2 9 0\nCONN 2 2 1 0\n";
    let glasses = GlassLibrary::new();
    let make = |r: &mut Random| {
        let mut bytes = operands.as_bytes().to_vec();
        damage_text(&mut bytes, r);
        [lens.as_bytes(), b"\n", &bytes].concat()
    };
    fuzz(".zmx configurations", 300, make, |bytes| {
        let options = ReadOptions { strict: false, configuration: Some(2) };
        zmx::parse(bytes, &glasses, &options).is_ok_and(|system| is_read_and_written(&system))
    });
}

#[test]
fn damaged_lens_tables_do_not_panic() {
    let glasses = GlassLibrary::new();
    let lenses: Vec<String> =
        builtin::LENSES.iter().map(|lens| table::write(&lens.system(), "own").unwrap().text).collect();
    let make = |r: &mut Random| {
        let mut bytes = lenses[r.below(lenses.len())].clone().into_bytes();
        damage_text(&mut bytes, r);
        bytes
    };
    fuzz(".csv lens tables", 300, make, |bytes| {
        table::parse(bytes, &glasses, &ReadOptions::default())
            .is_ok_and(|system| is_read_and_written(&system))
    });
}

#[test]
fn damaged_optiland_files_do_not_panic() {
    let glasses = GlassLibrary::new();
    let lenses: Vec<String> = ["phone", "mirror-500"]
        .map(|name| optiland::write(&builtin::BuiltinLens::named(name).unwrap().system()).unwrap().text)
        .to_vec();
    let make = |r: &mut Random| {
        let mut bytes = lenses[r.below(2)].clone().into_bytes();
        damage_text(&mut bytes, r);
        bytes
    };
    fuzz("optiland .json", 300, make, |bytes| {
        optiland::parse(bytes, &glasses, &ReadOptions::default())
            .is_ok_and(|system| is_read_and_written(&system))
    });
}

#[test]
fn damaged_archives_do_not_panic() {
    // A stored and a packed member: LZW codes of 9 bits without repetition are the bytes themselves.
    let member = |name: &str, data: &[u8], is_packed: bool| {
        let mut header = vec![0; 648];
        header[..2].copy_from_slice(&[0xEC, 0x03]);
        header[8] = u8::from(is_packed);
        let mut body = data.to_vec();
        if is_packed {
            let bits: Vec<u8> =
                data.iter().flat_map(|b| (0..9).rev().map(move |i| (u16::from(*b) >> i & 1) as u8)).collect();
            body =
                bits.chunks(8).map(|c| c.iter().enumerate().fold(0, |v, (i, b)| v | b << (7 - i))).collect();
        }
        header[16..24].copy_from_slice(&(body.len() as u64).to_le_bytes());
        header[24..32].copy_from_slice(&(data.len() as u64).to_le_bytes());
        for (i, b) in name.bytes().enumerate() {
            header[48 + 2 * i] = b;
        }
        [header, body].concat()
    };
    let short = b"MODE SEQ\nUNIT MM\n".repeat(8);
    let archive = [member("a.zmx.LZW", &short, true), member("B.AGF", b"NM A 1 0\n", false)].concat();
    let make = |r: &mut Random| {
        let mut bytes = archive.clone();
        for _ in 0..=r.below(4) {
            let at = r.below(bytes.len());
            bytes[at] = r.below(256) as u8;
        }
        if r.below(4) == 0 {
            bytes.truncate(r.below(bytes.len()));
        }
        bytes
    };
    fuzz(".zar", 1000, make, |bytes| zar::lens(bytes).is_ok());
}

#[test]
fn damaged_glass_catalogues_do_not_panic() {
    const TWO: &[u8] = b"CC a comment\nNM N-BK7 2 517642.251 1.5168 64.17 0 1 1\nED 7.1 8.3 2.51 -0.0009 0\n\
CD 1.03961212E+000 6.00069867E-003 2.31792344E-001 2.00179144E-002 1.01046945E+000 1.03560653E+002 0 0 0 0\n\
TD 0 0 0 0 0 0 20\nLD 3.0E-001 2.5E+000\nIT 3.0E-001 5.0E-002 25\nNM OLD 1 0 1.5 60\nCD 2.25 0 0 0 0 0\nLD 0.4 0.7\n";
    let make = |r: &mut Random| {
        let mut bytes = TWO.to_vec();
        damage_text(&mut bytes, r);
        bytes
    };
    fuzz(".agf", 1000, make, |bytes| {
        let Ok(catalogue) = agf::parse(bytes) else { return false };
        for glass in catalogue.glasses() {
            for um in [0.0, 0.4, 0.55, 3.0, f64::NAN] {
                let _ = glass.index(um);
            }
        }
        true
    });
}
