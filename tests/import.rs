//! `lenscube lens import` from outside: the packs it makes, the words and exit codes when it cannot.

mod common;

use common::{Ran, lenscube, text};
use formats::lens::LensPack;
use std::fs;
use std::path::{Path, PathBuf};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("formats/tests/data").join(name)
}

fn import(source: &Path, out: &Path, flags: &[&str]) -> Ran {
    let mut words = vec!["lens", "import", text(source), text(out)];
    words.extend(flags);
    lenscube(&words)
}

/// One line for the user, the exit code, nothing written.
fn refused(source: &Path, flags: &[&str], code: i32, words: &[&str]) {
    let dir = tempfile::tempdir().unwrap();
    let ran = import(source, &dir.path().join("out.lens.zarr"), flags);
    assert_eq!(ran.code, code, "{}", ran.stderr);
    let lines: Vec<&str> = ran.stderr.lines().filter(|l| l.starts_with("lenscube: ")).collect();
    assert_eq!(lines.len(), 1, "{}", ran.stderr);
    let parts: Vec<&str> = lines[0].split(": ").collect();
    assert!(parts.iter().enumerate().all(|(i, p)| !parts[..i].contains(p)), "said twice: {}", lines[0]);
    for word in words {
        assert!(lines[0].contains(word), "`{word}` is not in: {}", lines[0]);
    }
    assert!(!ran.stderr.contains("panicked"), "{}", ran.stderr);
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0, "something is left behind");
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
fn the_real_export_without_its_psfs() {
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
fn an_import_is_a_lens_for_run() {
    let dir = tempfile::tempdir().unwrap();
    let (out, film) = (dir.path().join("example.lens.zip"), dir.path().join("film.zarr"));
    import(&data("tables-example"), &out, &["--azimuths", "8"]).ok();
    let chart = "gen:uniform?size=64&wavelengths=500,550";
    common::run(chart, &film, text(&out), &["--film-pitch-um", "2"]).ok();
    let (_, bands) = common::pixels(&film, "film");
    assert!(bands.iter().flatten().all(|v| (v - 1.0).abs() < 1e-2), "a uniform chart near the axis stays 1");
}

#[test]
fn an_archive_by_command() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("dg.lens.zip");
    let mut flags = NPZ.to_vec();
    flags.extend(["--distortion-focal-mm", "99.3320630"]);
    let ran = import(&data("double-gauss-28-550nm.npz"), &out, &flags).ok();
    assert!(ran.stderr.contains("550 nm") && ran.stderr.contains("22 PSFs of 51 samples"), "{}", ran.stderr);
    // There already: another job's output, and it stays.
    let before = fs::read(&out).unwrap();
    let again = import(&data("double-gauss-28-550nm.npz"), &out, &flags);
    assert_eq!(again.code, 3, "{}", again.stderr);
    assert_eq!(fs::read(&out).unwrap(), before);
}

#[test]
fn what_is_asked_for_is_usage() {
    let npz = data("double-gauss-28-550nm.npz");
    refused(&npz, &NPZ[2..], 2, &["double-gauss-28-550nm.npz", "--psf-sample"]);
    refused(
        &npz,
        &["--psf-sample", "integrated", "--f-number", "3", "--primary-nm", "550"],
        2,
        &["--psf-outward"],
    );
    refused(&data("zemax-asphere"), &["--bands", "7", "--without-psf"], 2, &["--bands", "last of 5"]);
    refused(&data("zemax-asphere"), &["--bands", "2:", "--without-psf"], 2, &["--bands", "its end"]);
    let both = import(&npz, Path::new("out"), &["--f-number", "3", "--entrance-pupil-mm", "3"]);
    assert_eq!(both.code, 2, "{}", both.stderr);
}

#[test]
fn broken_exports_fail_with_file_and_line() {
    refused(Path::new("absent"), &[], 1, &["absent", "cannot open"]);
    refused(&data("zemax-asphere"), &[], 1, &["holds neither", "PSF_1_1.dat", "--without-psf"]);
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    for name in ["ISETPARMS.TXT", "AsphereF=2mm_DI_.dat", "AsphereF=2mm_RI_.dat"] {
        fs::copy(data("zemax-asphere").join(name), at(name)).unwrap();
    }
    let di = fs::read_to_string(at("AsphereF=2mm_DI_.dat")).unwrap();
    // Decimal commas are read; NaN, a lost line and heights that fall are named.
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
        refused(dir.path(), &["--without-psf"], 1, &words);
    }
}
