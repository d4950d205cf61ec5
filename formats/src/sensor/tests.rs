use super::*;

fn open(name: &str) -> Sensor {
    SensorFile::open(name, &[]).unwrap().sensor(2.0)
}

fn error_of(text: &str) -> String {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("my.toml");
    std::fs::write(&path, text).unwrap();
    SensorFile::open(path.to_str().unwrap(), &[]).unwrap_err().to_string()
}

const GOOD: &str = r#"schema = "lenscube/sensor/1"
name = "mine"
description = "a test"
[pixel]
pitch_um = 5.0
full_well_e = 1000
[adc]
bits = 10
gain_dn_per_e = 0.5
black_dn = 32
[spectral]
constant = 0.5
[cfa]
pattern = [["Y"]]
Y = {}
[source]
"*" = "assumed"
"#;

#[test]
fn built_in_sensors_load_and_stay_below_one_electron_a_photon() {
    for name in builtin_names() {
        let sensor = open(name);
        assert_eq!(sensor.name, name);
        let most = (300..=1100).flat_map(|nm| (0..sensor.channels.len()).map(move |c| (c, f64::from(nm))));
        assert!(
            most.map(|(c, nm)| sensor.quantum_efficiency(c, nm)).all(|q| (0.0..=1.0 + 1e-12).contains(&q))
        );
    }
    assert!((open("cmv12000-mono").quantum_efficiency(0, 555.0) - 0.4652).abs() < 1e-9);
    assert_eq!(open("ideal-mono").pixel.pitch_um, 2.0);
    assert_eq!(open("cmv12000-rgb").planes(), ["R", "G", "B"]);
    assert_eq!(open("cmv12000-rgb").channels.len(), 4);
}

/// Photons of 1 W m⁻² nm⁻¹ from 395 to 705 nm.
#[test]
fn weights_of_an_ideal_sensor_count_photons() {
    let bands: Vec<f64> = (0..31).map(|i| 400.0 + 10.0 * f64::from(i)).collect();
    let sum: f64 = open("ideal-mono").band_weights(0, &bands).iter().sum();
    let expected = (705e-9f64.powi(2) - 395e-9f64.powi(2)) / 2.0 / pipeline::sensor::HC_J_M * 1e9;
    assert!((sum / expected - 1.0).abs() < 1e-12);
    assert!(open("cmv12000-mono").share_outside(0, &bands) > 0.3);
    assert!(open("ideal-xyz").share_outside(1, &bands) < 0.01);
}

#[test]
fn a_record_gives_the_sensor_back() {
    for name in builtin_names() {
        let file = SensorFile::open(name, &["noise.prnu=0".into()]).unwrap();
        let back = SensorFile::from_record(Path::new("raw"), &file.record()).unwrap();
        assert_eq!(back.sensor(2.0), file.sensor(2.0), "{name}");
        assert_eq!(back.record(), file.record());
        assert_eq!(back.sensor(2.0).noise.prnu, 0.0);
    }
}

#[test]
fn set_replaces_fields_and_names_what_is_wrong() {
    let set = |words: &[&str]| {
        SensorFile::open("cmv12000-mono", &words.iter().map(|w| (*w).to_owned()).collect::<Vec<_>>())
    };
    let quad = set(&[r#"cfa.pattern=[["Y","Y"],["Y","Y"]]"#, "pixel.full_well_e=5e3"]).unwrap().sensor(2.0);
    assert_eq!((quad.pattern.rows, quad.pixel.full_well_e), (2, 5000.0));
    for (word, expected) in [
        ("noise.prnu", "FIELD=VALUE"),
        ("noise.pnru=0", "unknown field `pnru`"),
        ("noise.prnu=lots", "expected f64"),
        ("noise.prnu=0.5", "noise.prnu: expected 0 to 0.2, found 0.5"),
    ] {
        let error = set(&[word]).unwrap_err().to_string();
        assert!(error.contains(expected), "{word}: {error}");
    }
}

#[test]
fn bad_descriptions_are_named_with_their_place() {
    assert!(
        SensorFile::open("cmv12000-rbg", &[])
            .unwrap_err()
            .to_string()
            .contains("did you mean `cmv12000-rgb`")
    );
    let change = |from: &str, to: &str| {
        assert!(GOOD.contains(from));
        error_of(&GOOD.replace(from, to))
    };
    for (from, to, expected) in [
        ("bits = 10", "bits = = 10", "line 8, column"),
        ("bits = 10", "bits = 10\nbots = 3", "line 9, column 1: unknown field `bots`"),
        ("bits = 10", "bits = \"ten\"", "line 8"),
        ("bits = 10\n", "", "missing field `bits`"),
        ("bits = 10", "bits = 17", "adc.bits: expected 1 to 16, found 17"),
        ("sensor/1", "sensor/2", "schema: expected \"lenscube/sensor/1\", found \"lenscube/sensor/2\""),
        ("pitch_um = 5.0", "pitch_um = \"chart\"", "\"film\""),
        ("pitch_um = 5.0", "pitch_um = nan", "pixel.pitch_um: expected 0.1 to 1000"),
        (
            "pitch_um = 5.0",
            "pitch_um = 5.0\naperture_um = 6.0",
            "pixel.aperture_um: expected above 0, at most the pitch",
        ),
        ("constant = 0.5", "constant = 1.5", "spectral.constant"),
        ("constant = 0.5", "quantity = \"quantum_efficiency\"", "spectral.file: expected a CSV file"),
        ("constant = 0.5", "file = \"no.csv\"\nquantity = \"quantum_efficiency\"", "no file no.csv"),
        ("constant = 0.5", "file = \"cmv12000-qe.csv\"", "spectral.quantity"),
        (
            "constant = 0.5",
            "file = \"cmv12000-qe.csv\"\nquantity = \"relative_response\"",
            "spectral.peak_quantum_efficiency",
        ),
        ("Y = {}", "Y = {}\nR = {}", "cfa.R: expected a name of the pattern"),
        ("[[\"Y\"]]", "[[\"Y\"], [\"Y\", \"Y\"]]", "cfa.pattern: expected 1 to 8 rows"),
        ("[[\"Y\"]]", "[[\"Z\"]]", "cfa.Z: expected a filter"),
        ("[source]\n\"*\" = \"assumed\"\n", "", "missing field `source`"),
    ] {
        let error = change(from, to);
        assert!(error.contains(expected), "{to}: {error}");
    }
}

#[test]
fn bad_tables_are_named_with_their_line() {
    for (text, expected) in [
        ("", "is empty"),
        ("nm,mono\n400,0.1\n", "expected a column `wavelength_nm`, found the columns nm, mono"),
        ("wavelength_nm,red\n400,0.1\n", "expected a column `mono`"),
        ("wavelength_nm,mono\n400,0.1\n", "expected two rows of numbers or more, found 1"),
        ("wavelength_nm,mono\n400,0.1\n400,0.2\n", "line 3: expected a wavelength above 400 nm"),
        ("wavelength_nm,mono\n400,0.1\n500\n", "line 3: expected 2 columns, found 1"),
        ("wavelength_nm,mono\n400,0.1\n500,x\n", "line 3, column mono: expected a number, found `x`"),
        ("wavelength_nm,mono\n400,10\n500,48\n", "did you mean percent?"),
        ("wavelength_nm,mono\n400,-0.1\n500,0.2\n", "from 0 to 1, found -0.1"),
        ("wavelength_nm,mono\n400,0\n500,0\n", "expected a value above 0"),
    ] {
        let error = table::curve(Path::new("qe.csv"), text, "mono", Quantity::Share("quantum efficiency"));
        let error = error.unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("qe.csv"), "{error}");
    }
}
