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
        ("schema=x", "schema of a description cannot be replaced"),
        ("angle.acceptance_deg=20", "missing field `stack_index`"),
    ] {
        let error = set(&[word]).unwrap_err().to_string();
        assert!(error.contains(expected), "{word}: {error}");
    }
    for words in [
        ["angle.acceptance_deg=20", "angle.stack_index=1.5"],
        ["angle.stack_index=1.5", "angle.acceptance_deg=20"],
    ] {
        set(&words).unwrap();
    }
}

#[test]
fn tables_of_a_description_are_those_that_it_and_set_name() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("sensor.toml");
    let text = "schema = \"lenscube/sensor/1\"\n[spectral]\nfile = \"qe.csv\"\nfilters = [\"ir.csv\"]\n[[plate]]\nfile = \"plate.csv\"\n\
                [angle.filters.red]\nfile = \"red.csv\"\n[crosstalk]\nfile = \"a.csv\"\n";
    std::fs::write(&path, text).unwrap();
    let found: BTreeSet<PathBuf> =
        sensor_tables(&path, &["crosstalk.file=\"xt.csv\"".to_owned()]).into_iter().collect();
    let expected =
        ["ir.csv", "plate.csv", "qe.csv", "red.csv", "xt.csv"].map(|name| directory.path().join(name));
    assert_eq!(found, BTreeSet::from(expected));
    assert_eq!(sensor_tables(&directory.path().join("none.toml"), &[]), Vec::<PathBuf>::new());
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
        ("wavelength_nm,mono\n400,0.1\n400,0.2\n", "line 3: expected a wavelength_nm above 400"),
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

/// Matrices and ΔE2000 of the model in float64 (NumPy).
#[test]
fn colour_matrices_are_those_of_the_float64_model() {
    use pipeline::colour::Illuminant::{A, D65};
    use pipeline::develop::ColourMatrix;
    let sensor = |name: &str| SensorFile::open(name, &[]).unwrap().sensor(2.0);
    for (name, light, first_row, mean, max) in [
        (
            "sony-a7r2",
            A,
            [1.947_331_645_491_687, -0.897_203_143_688_423, -0.050_128_501_803],
            0.880_826_96,
            3.006_886_52,
        ),
        (
            "sony-a7r2",
            D65,
            [1.904_958_282_309_085, -0.793_264_680_257_933, -0.111_693_602_051],
            0.791_667_24,
            2.646_107_07,
        ),
        (
            "cmv12000-rgb",
            A,
            [1.600_728_220_488_527, -0.338_836_912_273_113, -0.261_891_308_215],
            1.812_987_06,
            4.923_093_21,
        ),
        (
            "cmv12000-rgb",
            D65,
            [1.424_740_503_786_381, -0.203_357_931_809_037, -0.221_382_571_977],
            1.575_655_53,
            4.964_875_87,
        ),
        ("ideal-xyz", A, [3.194_102_059_321_453, -2.012_361_613_106_205, -0.181_740_446_215], 0.0, 0.0),
        ("ideal-xyz", D65, [3.080_181_098_185_949, -1.537_316_851_119_001, -0.542_864_247_066], 0.0, 0.0),
    ] {
        let matrix = ColourMatrix::fitted(&sensor(name), light).unwrap();
        for (found, expected) in std::iter::zip(&matrix.rows[0], first_row) {
            assert!((found - expected).abs() < 1e-11, "{name} {light:?}: {found} for {expected}");
        }
        for row in &matrix.rows {
            assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
        let (found_mean, found_max) = (matrix.mean_delta_e(), matrix.max_delta_e());
        assert!(
            (found_mean - mean).abs() < 1e-8 && (found_max - max).abs() < 1e-8,
            "{name} {light:?}: {found_mean}, {found_max}"
        );
    }
    // DNG: a white under the light has the neutral's values; the inverse of the development.
    let (sensor, gains) = (sensor("sony-a7r2"), [2.0, 1.0, 1.6]);
    let matrix = ColourMatrix::fitted(&sensor, A).unwrap();
    let to_planes = matrix.xyz_to_planes(A, gains);
    for (row, gain) in std::iter::zip(to_planes, gains) {
        let plane: f64 = std::iter::zip(row, A.white()).map(|(m, w)| m * w).sum();
        assert!((plane - 1.0 / gain).abs() < 1e-9, "{plane}");
    }
}
