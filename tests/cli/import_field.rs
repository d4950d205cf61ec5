//! `lenscube lens import FIELD.toml`: films of imported fields, error messages and exit codes.

use crate::common::{CommandResult, lenscube, pixels, run, text};
use std::fs;
use std::path::Path;

/// An NPY array of f8.
fn npy(shape: &[usize], values: &[f64]) -> Vec<u8> {
    let sizes: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({sizes}), }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

const PSF: &str = "name = \"bench\"\nwavelengths_nm = [550]\ndistortion_focal_length_mm = 35.0\n[psf]\nfiles = \"psf.npy\"\nx_mm = [-0.1, 0, 0.1]\n\
y_mm = [-0.1, 0.1]\npitch_um = 2\nsample = \"integrated\"\n";
const SHADING: &str = "[shading]\nrelative_illumination = \"flat.npy\"\nx_mm = [-0.3, -0.1, 0.1, 0.3]\ny_mm = [-0.3, -0.1, 0.1, 0.3]\n";

/// A folder of a Gaussian at 3 × 2 places, and of a flat field.
fn folder(description: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let of = |i: usize| {
        let (x, y) = ((i % 9) as f64 - 4.0, (i / 9) as f64 - 4.0);
        (-(x * x + y * y) / 1.4).exp()
    };
    let windows: Vec<f64> = (0..486).map(|i| of(i % 81)).collect();
    fs::write(dir.path().join("psf.npy"), npy(&[2, 3, 9, 9], &windows)).unwrap();
    let places = [-0.3, -0.1, 0.1, 0.3];
    let flat: Vec<f64> = places.iter().flat_map(|y| places.map(|x| 900.0 * relative(x, *y))).collect();
    fs::write(dir.path().join("flat.npy"), npy(&[4, 4], &flat)).unwrap();
    fs::write(dir.path().join("field.toml"), description).unwrap();
    dir
}

/// The flat field over its value at the centre.
fn relative(x_mm: f64, y_mm: f64) -> f64 {
    1.0 + 0.5 * x_mm - 1.5 * y_mm
}

fn import(dir: &Path, flags: &[&str]) -> CommandResult {
    let (source, out) = (dir.join("field.toml"), dir.join("out.lens.zarr"));
    lenscube(&[&["lens", "import", text(&source), text(&out)][..], flags].concat())
}

/// A linear flat field is that of the film of a uniform chart: equal symmetric PSFs leave it. Its darker side is the lower one.
#[test]
fn film_of_a_uniform_chart_is_the_flat_field() {
    let dir = folder(&format!("{PSF}{SHADING}"));
    let ran = import(dir.path(), &[]).ok();
    for words in
        ["note: no [map]", "note: no f_number", "550 nm: 6 PSFs, 9 samples a side at 2 µm pitch", "1 band"]
    {
        assert!(ran.stderr.contains(words), "{words}: {}", ran.stderr);
    }
    let (lens, film) = (dir.path().join("out.lens.zarr"), dir.path().join("film.zarr"));
    run("gen:uniform?size=96&wavelengths=550", &film, text(&lens), &["--film-pitch-um", "2"]).ok();
    let (size, bands) = pixels(&film, "film");
    let at_mm = |i: usize, side: usize| (i as f64 - 0.5 * (side - 1) as f64) * 2e-3;
    let mut worst: f64 = 0.0;
    for (i, v) in bands[0].iter().enumerate() {
        let (x, y) = (at_mm(i % size.width, size.width), at_mm(i / size.width, size.height));
        worst = worst.max((f64::from(*v) - relative(x, y)).abs());
    }
    assert!(worst < 2e-6, "{worst}");
    let refused = run(
        "gen:uniform?size=96&wavelengths=550",
        &film,
        text(&lens),
        &["--film-pitch-um", "2", "--azimuths", "8"],
    );
    assert!(refused.code == 2 && refused.stderr.contains("--azimuths: the PSFs of `"), "{}", refused.stderr);
    let shown = lenscube(&["lens", "show", text(&lens)]).ok().stdout;
    assert!(shown.contains("bench") && shown.contains("(grid) at 3 × 2 places"), "{shown}");
}

#[test]
fn name_is_the_only_flag_of_a_description() {
    let dir = folder(PSF);
    let refused = import(dir.path(), &["--psf-sample", "point"]);
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    assert!(refused.stderr.contains("only --name is used with it"), "{}", refused.stderr);
    import(dir.path(), &["--name", "unit 3"]).ok();
    let shown = lenscube(&["lens", "show", text(&dir.path().join("out.lens.zarr"))]).ok().stdout;
    assert!(shown.contains("unit 3"), "{shown}");
    // An existing pack is kept.
    assert_eq!(import(dir.path(), &[]).code, 3);
}

#[test]
fn descriptions_and_arrays_that_cannot_be_are_one_line() {
    let dir = folder(&PSF.replace("pitch_um", "pitch"));
    let failed = import(dir.path(), &[]);
    assert_eq!(failed.code, 1, "{}", failed.stderr);
    let lines: Vec<&str> = failed.stderr.lines().filter(|line| line.starts_with("lenscube: ")).collect();
    assert!(
        lines.len() == 1 && lines[0].contains("line 8: [psf] has no key `pitch`; did you mean `pitch_um`?"),
        "{lines:?}"
    );
    assert!(!dir.path().join("out.lens.zarr").exists());
}
