use super::*;
use pipeline::real;

fn powers(coating: &Coating, um: f64) -> [f64; 4] {
    let a = coating.at(um).unwrap().amplitudes(1.0, 1.5, real::cos(f64::to_radians(20.0)));
    [a.r[0], a.r[1], a.t[0], a.t[1]].map(|v| v.norm_sqr())
}

const TOML: &str = r#"
default = "bbar"
[surface]
2 = "ircut"
3 = "measured"
4 = "ideal"
[coating.bbar]
reflectance = [[400, 0.006], [450, 0.002], [700, 0.004]]
[coating.flat]
reflectance = 0.003
[coating.ircut]
layers = [["TiO2", 62.0], ["SiO2", 94.5]]
[coating.measured]
table = "measured.csv"
[material.TiO2]
n = [[400, 2.55, 0.001], [700, 2.30, 0.0]]
[material.SiO2]
n = 1.46
"#;

fn beside(name: &str) -> Result<String, String> {
    match name {
        "measured.csv" => {
            Ok("# a comment\nwavelength_nm,angle_deg,rs,rp\n500,0,0.01,0.01\n500,40,0.03,0.01\n\
            600,0,0.02,0.02\n600,40,0.04,0.02\n"
                .to_owned())
        }
        _ => Err("not found".to_owned()),
    }
}

#[test]
fn toml_gives_each_surface_its_coating() {
    let coatings = toml::parse(TOML, &beside).unwrap().coatings().unwrap();
    assert!(matches!(&coatings.default, Coating::Reflectance(r) if r.entries[1] == (0.45, 0.002)));
    let [(1, Some(Coating::Films(films))), (2, Some(table)), (3, None)] = &coatings.surfaces[..] else {
        panic!("{:?}", coatings.surfaces)
    };
    assert_eq!((films[0].thickness_um, films[1].index.entries[0].1), (0.062, 1.46));
    // Half-way in wavelength and angle; T = 1 − R.
    for (found, expected) in std::iter::zip(powers(table, 0.55), [0.025, 0.015, 0.975, 0.985]) {
        assert!((found - expected).abs() < 1e-12);
    }
}

#[test]
fn tables_beside_a_file_are_listed() {
    assert_eq!(toml::tables_beside(TOML), ["measured.csv"]);
    assert!(toml::tables_beside("coating = 3").is_empty() && toml::tables_beside("= no").is_empty());
}

#[test]
fn errors_do_not_repeat_a_long_line() {
    let error = toml::parse(&format!("a = {}", "[".repeat(100_000)), &beside).unwrap_err().to_string();
    assert!(error.contains("line 1, column") && error.len() < 300, "{}", error.len());
}

#[test]
fn errors_of_files_have_their_lines() {
    for (from, to, words) in [
        ("default = \"bbar\"", "default = 3", "line 2: default: "),
        ("[surface]", "[surfaces]", "line 3: `surfaces` is not known"),
        ("2 = \"ircut\"", "two = \"ircut\"", "line 4: [surface] two: expected the number of a surface"),
        ("0.006", "1.2", "line 8: [coating.bbar] reflectance 1.2"),
        ("94.5", "200000", "line 12: [coating.ircut] a layer is 200000 nm"),
        ("measured.csv", "missing.csv", "line 14: [coating.measured] missing.csv: not found"),
        ("n = 1.46", "n = \"x\"", "line 12: [coating.ircut] line 18: [material.SiO2] "),
    ] {
        assert!(TOML.contains(from), "{from}");
        let error = toml::parse(&TOML.replacen(from, to, 1), &beside).unwrap_err().to_string();
        assert!(error.starts_with(words), "{to}: {error}");
    }
    let file = dat::parse(DAT.as_bytes(), 0.55).unwrap();
    for (name, line) in [("LOOP", 14), ("LOST", 16), ("POL", 18), ("WRONG", 31)] {
        let error = file.get(name).unwrap_err().to_string();
        assert!(error.starts_with(&format!("coating {name}: line {line} of the coating file: ")), "{error}");
    }
    let error = csv::parse("a", "# a comment\nnm,rs\n").unwrap_err();
    assert!(error.starts_with("line 2: found the columns nm,rs"), "{error}");
}

#[test]
fn wrong_toml_is_an_error_that_says_where() {
    for (from, to, words) in [
        ("default = \"bbar\"", "default = \"bbra\"", "no coating `bbra`; there are BBAR, FLAT"),
        ("\"SiO2\", 94.5", "\"SiO3\", 94.5", "[coating.ircut] material SiO3 has no entry"),
        ("94.5", "200000", "a layer is 200000 nm (200 µm) thick, expected 0 to 100 µm"),
        ("0.006", "1.2", "[coating.bbar] reflectance 1.2"),
        ("[450,", "[350,", "do not ascend"),
        ("measured.csv", "missing.csv", "missing.csv: not found"),
        ("n = 1.46", "n = 0", "n of a layer is 0"),
        ("reflectance = 0.003", "reflectence = 0.003", "expected one of reflectance, layers, table"),
        ("[surface]", "[surfaces]", "`surfaces` is not known"),
        ("2 = \"ircut\"", "two = \"ircut\"", "expected the number of a surface"),
        ("2 = \"ircut\"", "0 = \"ircut\"", "counted from 1"),
        ("3 = \"measured\"", "02 = \"measured\"", "two coatings of surface 2"),
        ("[coating.flat]", "[coating.BBar]", "[coating.bbar] another coating has this name"),
        ("n = 1.46", "n = 1.46\nk = 0.1", "[material.SiO2] `k` is not known"),
        ("default =", "default = =", "line 2, column 11: "),
    ] {
        assert!(TOML.contains(from), "{from}");
        let read = toml::parse(&TOML.replacen(from, to, 1), &beside).and_then(|f| f.coatings());
        let error = read.unwrap_err().to_string();
        assert!(error.contains(words), "{to}: {error}");
    }
}

const DAT: &str = "! materials\nMATE MGF2\n0.4 1.38 0\n0.7 1.38 0\nMATE AL\n0.5 0.77 -6.1\n\nCOAT AR\nMGF2 .25\n\
    COAT THIN\nAL 0.010 1\nMGF2 0.1 1 0\nCOAT LOOP\nMGF2 .25 0 1\nCOAT LOST\nZRO2 .5\nIDEAL HALF 0.5\nIDEAL2 POL 1 0 0\n\
    TAPR EDGE 3\n0 1\n5 0.5\nTABLE T1\nANGL 0\nWAVE 0.5 0.1 0.1 0.8 0.8 0 0 0 0\nWAVE 0.6 0.1 0.1 0.9 0.9\n\
    ANGL 40\nWAVE 0.5 0.2 0.1 0.7 0.8\nWAVE 0.6 0.2 0.1 0.8 0.9\nTABLE WRONG\nANGL 0\nWAVE 0.5 0.9 0.9 0.9 0.9\n";

#[test]
fn file_of_the_design_program_is_read() {
    let file = dat::parse(DAT.as_bytes(), 0.55).unwrap();
    let [mgf2_like, half, thin, table] = ["ar", "HALF", "THIN", "T1"].map(|n| file.get(n).unwrap().unwrap());
    // A quarter of the primary wavelength in the material.
    let expected = powers(&mgf2(Some(550.0)), 0.6);
    assert!(std::iter::zip(powers(&mgf2_like, 0.6), expected).all(|(a, b)| (a - b).abs() < 1e-12));
    assert!(powers(&half, 0.9).iter().all(|v| (v - 0.5).abs() < 1e-12));
    // k of the file is negative, and the film absorbs.
    let [rs, _, ts, _] = powers(&thin, 0.5);
    assert!(rs + ts < 0.95 && ts > 0.1, "{rs} {ts}");
    for (found, expected) in std::iter::zip(powers(&table, 0.55), [0.15, 0.1, 0.8, 0.85]) {
        assert!((found - expected).abs() < 1e-12);
    }
}

#[test]
fn coatings_that_cannot_be_used_are_errors_only_where_they_are_used() {
    let file = dat::parse(DAT.as_bytes(), 0.55).unwrap();
    for (name, words) in [
        ("LOOP", "loops and tapers are not read"),
        ("LOST", "does not define its material ZRO2"),
        ("POL", "IDEAL2 is not read"),
        ("WRONG", "whose sums R + T are at most 1"),
        ("NEW", "no coating `NEW`; there are AR, HALF"),
    ] {
        let error = file.get(name).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
    let error = dat::parse(b"COAT A\nMATE B\nx y\n", 0.55).unwrap_err().to_string();
    assert!(error.contains("line 3"), "{error}");
}

#[test]
fn names_of_a_design_are_looked_up() {
    let mut lens = System::double_gauss_28();
    let named =
        |lens: &mut System, i: usize, name: &str| lens.surfaces[i].coating_name = Some(name.to_owned());
    named(&mut lens, 0, "AR");
    named(&mut lens, 1, "I.99");
    // The stop refracts nothing.
    named(&mut lens, 5, "HIGHLY_SPECIAL");
    let (coatings, notes) = CoatingFile::default().of_design(&lens).unwrap();
    assert_eq!(coatings.surfaces.len(), 2);
    assert!(notes.iter().any(|n| n.contains("coating AR of surface 1")), "{notes:?}");
    assert!((powers(coatings.surfaces[1].1.as_ref().unwrap(), 0.5)[2] - 0.99).abs() < 1e-12);
    named(&mut lens, 2, "THORB");
    let error = CoatingFile::default().of_design(&lens).unwrap_err().to_string();
    assert!(error.contains("THORB") && error.contains("--coatings"), "{error}");
    let (_, notes) = CoatingFile::default().of_design(&System::double_gauss_28()).unwrap();
    assert!(notes[0].contains("names no coatings"), "{notes:?}");
}
