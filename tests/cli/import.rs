//! `lenscube lens import`: packs, error messages and exit codes.

use crate::common::{CommandResult, lenscube, text};
use formats::lens::LensPack;
use pipeline::lens::cone_field::ConeField;
use std::fs;
use std::path::{Path, PathBuf};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("formats/tests/data").join(name)
}

fn import(source: &Path, out: &Path, flags: &[&str]) -> CommandResult {
    let mut words = vec!["lens", "import", text(source), text(out)];
    words.extend(flags);
    lenscube(&words)
}

/// Asserts the exit code, one error line with `words`, and that no file was written.
fn assert_import_fails(source: &Path, flags: &[&str], code: i32, words: &[&str]) {
    let dir = tempfile::tempdir().unwrap();
    let ran = import(source, &dir.path().join("out.lens.zarr"), flags);
    assert_eq!(ran.code, code, "{}", ran.stderr);
    let lines: Vec<&str> = ran.stderr.lines().filter(|l| l.starts_with("lenscube: ")).collect();
    assert_eq!(lines.len(), 1, "{}", ran.stderr);
    let parts: Vec<&str> = lines[0].split(": ").collect();
    assert!(parts.iter().enumerate().all(|(i, p)| !parts[..i].contains(p)), "repeated: {}", lines[0]);
    for word in words {
        assert!(lines[0].contains(word), "`{word}` is not in: {}", lines[0]);
    }
    assert!(!ran.stderr.contains("panicked"), "{}", ran.stderr);
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0, "leftover files");
}

const NPZ: [&str; 9] = [
    "--psf-sample",
    "integrated",
    "--psf-outward",
    "down",
    "--entrance-pupil-mm",
    "33.33",
    "--primary-nm",
    "587.5618",
    "--symmetric-psf",
];

#[test]
fn design_program_export_without_psfs_is_imported() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("asphere.lens.zarr");
    import(&data("zemax-asphere"), &out, &["--without-psf", "--name", "asphere"]).ok();
    let pack = LensPack::open(&out).unwrap();
    assert_eq!((pack.lens().name.as_str(), pack.lens().bands.len()), ("asphere", 5));
    assert!((pack.lens().bands[2].image_height_mm.last().unwrap() - 0.959263593).abs() < 1e-7);
    let shown = lenscube(&["lens", "show", text(&out)]).ok();
    assert!(shown.stdout.contains("asphere"), "{}", shown.stdout);
}

#[test]
fn imported_pack_is_usable_in_a_run() {
    let dir = tempfile::tempdir().unwrap();
    let (out, film) = (dir.path().join("example.lens.zip"), dir.path().join("film.zarr"));
    import(&data("../../data/tables-example"), &out, &["--azimuths", "8"]).ok();
    let chart = "gen:uniform?size=64&wavelengths=500,550";
    crate::common::run(chart, &film, text(&out), &["--film-pitch-um", "2"]).ok();
    let (_, bands) = crate::common::pixels(&film, "film");
    assert!(bands.iter().flatten().all(|v| (v - 1.0).abs() < 1e-2), "a uniform chart near the axis stays 1");
}

/// A column of chief-ray angles makes cones: here 3 degrees a millimetre behind a pupil of the F-number of the lens.
#[test]
fn chief_ray_angles_of_tables_are_the_directions_of_a_pack() {
    let dir = tempfile::tempdir().unwrap();
    let tables = dir.path().join("tables");
    fs::create_dir(&tables).unwrap();
    for file in fs::read_dir(data("../../data/tables-example")).unwrap() {
        let file = file.unwrap();
        fs::copy(file.path(), tables.join(file.file_name())).unwrap();
    }
    let heights = fs::read_to_string(tables.join("heights.csv")).unwrap();
    let with_angles = |per_mm: f64| {
        let row = |line: &str| {
            let number = |k: usize| line.split(',').nth(k).and_then(|cell| cell.trim().parse::<f64>().ok());
            match number(2) {
                Some(height) => format!("{line},{}\n", per_mm * height),
                None if line.contains("wavelength_nm") => format!("{line},cra_deg\n"),
                None => format!("{line}\n"),
            }
        };
        fs::write(tables.join("heights.csv"), heights.lines().map(row).collect::<String>()).unwrap();
    };
    with_angles(3.0);
    let out = dir.path().join("cones.lens.zarr");
    import(&tables, &out, &[]).ok();
    let pack = LensPack::open(&out).unwrap();
    let half = 0.5 / pack.lens().f_number;
    for band in &pack.lens().bands {
        let Some(ConeField::Symmetric(cones)) = &band.cones else { panic!("{:?}", band.cones) };
        let last_mm = *band.image_height_mm.last().unwrap();
        assert!((cones.last_mm() / last_mm - 1.0).abs() < 1e-9, "{} {last_mm}", cones.last_mm());
        for height_mm in [0.0, 0.3 * last_mm, 0.77 * last_mm] {
            let (sine, cosine) = (3.0 * height_mm).to_radians().sin_cos();
            let cone = cones.at(height_mm);
            let found = [cone.chief, cone.centre, cone.tangential, cone.sagittal];
            let expected = [sine, sine, half * cosine.powi(3), half * cosine];
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() < 1e-9, "{height_mm}: {found} {expected}");
            }
        }
    }
    with_angles(1000.0);
    assert_import_fails(&tables, &[], 1, &["heights.csv", "line", "cra_deg is", "expected -85 to 85"]);
}

#[test]
fn npz_archive_is_imported_and_not_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("dg.lens.zip");
    let mut flags = NPZ.to_vec();
    flags.extend(["--distortion-focal-mm", "99.3320630"]);
    let ran = import(&data("double-gauss-28-550nm.npz"), &out, &flags).ok();
    assert!(
        ran.stderr.contains("550 nm") && ran.stderr.contains("22 PSFs, 51 samples a side"),
        "{}",
        ran.stderr
    );
    // An existing output is kept.
    let before = fs::read(&out).unwrap();
    let again = import(&data("double-gauss-28-550nm.npz"), &out, &flags);
    assert_eq!(again.code, 3, "{}", again.stderr);
    assert_eq!(fs::read(&out).unwrap(), before);
}

#[test]
fn missing_or_conflicting_import_flags_exit_2() {
    let npz = data("double-gauss-28-550nm.npz");
    assert_import_fails(&npz, &NPZ[2..], 2, &["double-gauss-28-550nm.npz", "--psf-sample"]);
    assert_import_fails(
        &npz,
        &["--psf-sample", "integrated", "--f-number", "3", "--primary-nm", "550"],
        2,
        &["--psf-outward"],
    );
    assert_import_fails(
        &data("zemax-asphere"),
        &["--bands", "7", "--without-psf"],
        2,
        &["--bands", "last of 5"],
    );
    assert_import_fails(
        &data("zemax-asphere"),
        &["--bands", "2:", "--without-psf"],
        2,
        &["--bands", "must have an end"],
    );
    let both = import(&npz, Path::new("out"), &["--f-number", "3", "--entrance-pupil-mm", "3"]);
    assert_eq!(both.code, 2, "{}", both.stderr);
}

#[test]
fn broken_exports_fail_with_file_and_line() {
    assert_import_fails(Path::new("absent"), &[], 1, &["absent", "cannot open"]);
    assert_import_fails(&data("zemax-asphere"), &[], 1, &["holds neither", "PSF_1_1.dat", "--without-psf"]);
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    for name in ["ISETPARMS.TXT", "AsphereF=2mm_DI_.dat", "AsphereF=2mm_RI_.dat"] {
        fs::copy(data("zemax-asphere").join(name), at(name)).unwrap();
    }
    let di = fs::read_to_string(at("AsphereF=2mm_DI_.dat")).unwrap();
    // Decimal commas are accepted; NaN, a missing line and descending heights are errors.
    fs::write(at("AsphereF=2mm_DI_.dat"), di.replace('.', ",")).unwrap();
    let out = at("comma.lens.zip");
    import(dir.path(), &out, &["--without-psf"]).ok();
    fs::remove_file(out).unwrap();
    for (change, words) in [
        (di.replacen("1.013804E-001", "NaN", 1), ["DI_.dat, line 3", "`NaN`"]),
        (
            di.lines().take(20).collect::<Vec<_>>().join("\n"),
            ["DI_.dat, line 20", "100 numbers, expected 105"],
        ),
        (di.replacen("1.013804E-001", "1.013804E-002", 1), ["DI_.dat, line 3", "does not ascend"]),
    ] {
        fs::write(at("AsphereF=2mm_DI_.dat"), change).unwrap();
        assert_import_fails(dir.path(), &["--without-psf"], 1, &words);
    }
}

#[test]
fn template_is_imported_at_once() {
    let dir = tempfile::tempdir().unwrap();
    let (folder, out) = (dir.path().join("my lens"), dir.path().join("my.lens.zip"));
    let template = || lenscube(&["lens", "import", "--template", text(&folder)]);
    assert!(template().ok().stderr.contains("explained in README.md"));
    import(&folder, &out, &["--azimuths", "8"]).ok();
    assert_eq!(LensPack::open(&out).unwrap().lens().bands.len(), 2);
    // Edited files are kept.
    fs::write(folder.join("lens.csv"), "mine").unwrap();
    let again = template();
    assert_eq!(again.code, 3, "{}", again.stderr);
    assert_eq!(fs::read_to_string(folder.join("lens.csv")).unwrap(), "mine");
    let help = lenscube(&["lens", "import", "--help"]).ok().stdout;
    for (file, column) in [("heights.csv", "relative_illumination"), ("psf.csv", "psf_energy")] {
        assert!(help.contains(file) && help.contains(column), "{help}");
    }
    assert_eq!(lenscube(&["lens", "import", "source"]).code, 2);
}
