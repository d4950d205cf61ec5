//! Plain tables and NumPy archives.

use crate::*;
use lenscube_formats::import::window::Outward;
use lenscube_formats::lens::builtin;
use pipeline::lens::PsfSample;

#[test]
fn example_directory_gives_the_documented_lens() {
    let (_keep, pack) = pack(&data("../../data/tables-example"), &ImportOptions::default());
    let lens = pack.lens();
    assert_eq!(
        (lens.name.as_str(), lens.bands.len(), lens.psf_sample),
        ("invented 50 mm", 2, PsfSample::Point)
    );
    let band = &lens.bands[1];
    assert_eq!((band.psf_size, band.psf_pitch_um, band.ideal_height_mm.len()), (11, 0.5, 1001));
    assert_eq!(band.psf_energy, [0.99, 0.98, 0.97]);
    assert_eq!((band.image_height_mm.len(), band.relative_illumination.len()), (1001, 1001));
    // The lens is a cubic and cos⁴, which a few points determine well: image height h − 2e-4 h³.
    for (h, (r, ri)) in
        band.ideal_height_mm.iter().zip(band.image_height_mm.iter().zip(&band.relative_illumination))
    {
        assert!((r - (h - 2e-4 * h.powi(3))).abs() < 1e-8, "{h}: {r}");
        assert!((ri - (h / 50.0).atan().cos().powi(4)).abs() < 1e-5, "{h}: {ri}");
    }
    // Tails of 0, 0.2 and 0.4 samples outward (Gaussian cut at the window's edge).
    for (k, um) in [(0, 0.0), (1, 0.1), (2, 0.2)] {
        let (x, y) = centroid_um(&pack, 1, k);
        assert!((x - um).abs() < 0.01 && y.abs() < 1e-6, "{k}: {x} {y}");
    }
    let given = &pack.attributes().source.as_ref().unwrap()["given_points"];
    assert_eq!(given[0]["image_height_mm"][4], 9.79951);
}

/// The example's files in a folder of their own.
fn example() -> tempfile::TempDir {
    let directory = tempfile::tempdir().unwrap();
    for file in std::fs::read_dir(data("../../data/tables-example")).unwrap() {
        let file = file.unwrap().path();
        std::fs::copy(&file, directory.path().join(file.file_name().unwrap())).unwrap();
    }
    directory
}

#[test]
fn numbers_that_no_lens_has_are_errors_that_name_them() {
    let directory = example();
    let path = directory.path().join("lens.csv");
    let text = std::fs::read_to_string(&path).unwrap();
    let without =
        |key: &str| text.lines().filter(|line| !line.starts_with(key)).collect::<Vec<_>>().join("\n");
    let finite = without("object_distance_mm");
    for (text, words) in [
        (without("f_number") + "\nf_number,0\n", ["F-number is 0", "positive"]),
        (without("f_number") + "\nf_number,-2\n", ["F-number is -2", "positive"]),
        (
            finite.clone() + "\nobject_distance_mm,-5\nmagnification,-0.1\n",
            ["object distance is -5", "lens.csv"],
        ),
        (finite.clone() + "\nobject_distance_mm,500\nmagnification,1e9\n", ["magnification is", "lens.csv"]),
        (finite + "\nobject_distance_mm,500\nmagnification,0\n", ["`magnification`", "one of 0"]),
    ] {
        std::fs::write(&path, text).unwrap();
        let error = import_error(directory.path(), &ImportOptions::default());
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    }
}

/// Illumination that is listed as 0 at the end of the field: the spline through it is 0 there but for rounding.
#[test]
fn illumination_that_ends_at_zero_is_read() {
    let directory = example();
    let path = directory.path().join("heights.csv");
    let mut lines: Vec<String> = std::fs::read_to_string(&path).unwrap().lines().map(str::to_owned).collect();
    for k in 1..lines.len() {
        if k + 1 == lines.len() || lines[k + 1][..3] != lines[k][..3] {
            let cells: Vec<&str> = lines[k].split(',').collect();
            lines[k] = [&cells[..3], &["0"]].concat().join(",");
        }
    }
    std::fs::write(&path, lines.join("\n")).unwrap();
    let (_keep, pack) = pack(directory.path(), &ImportOptions::default());
    for band in &pack.lens().bands {
        assert!(band.relative_illumination.iter().all(|ri| *ri >= 0.0));
        assert!(band.relative_illumination.last().is_some_and(|ri| *ri < 1e-12));
    }
}

fn npz() -> ImportOptions {
    ImportOptions {
        sample: Some(PsfSample::Integrated),
        outward: Some(Outward::Down),
        symmetric: true,
        distortion_focal_length_mm: Some(99.3320630),
        entrance_pupil_mm: Some(33.33),
        primary_wavelength_nm: Some(587.5618),
        ..ImportOptions::default()
    }
}

/// The built-in pack was made from the same archive by other code (NumPy and SciPy): tables and windows agree bit for bit.
#[test]
fn archive_of_one_band_equals_the_built_in_lens() {
    let (_keep, pack) = pack(&data("double-gauss-28-550nm.npz"), &npz());
    let expected = builtin("double-gauss-28-npz").unwrap();
    assert_eq!(pack.lens().bands[0], expected.lens().bands[15]);
    assert_eq!(pack.psf(0).unwrap(), expected.psf(15).unwrap());
    let (a, b) = (pack.lens(), expected.lens());
    assert_eq!(
        (a.distortion_focal_length_mm, a.effective_focal_length_mm, a.f_number, a.primary_wavelength_nm),
        (b.distortion_focal_length_mm, b.effective_focal_length_mm, b.f_number, b.primary_wavelength_nm)
    );
}

/// All 31 bands; `scripts/check-long` makes the archive from the built-in lens pack and runs this test.
#[test]
#[ignore = "long: scripts/check --full"]
fn complete_archive_has_the_built_in_digest() {
    let path = std::env::var_os("LENSCUBE_TABLES_NPZ").expect("the archive's path");
    let (_keep, pack) = pack(Path::new(&path), &npz());
    assert_eq!(pack.digest().unwrap(), builtin("double-gauss-28-npz").unwrap().digest().unwrap());
}

#[test]
fn missing_option_of_an_archive_is_an_error_naming_it() {
    let path = data("double-gauss-28-550nm.npz");
    for (options, expected) in [
        (ImportOptions { sample: None, ..npz() }, "--psf-sample"),
        (ImportOptions { outward: None, ..npz() }, "--psf-outward"),
        (ImportOptions { entrance_pupil_mm: None, ..npz() }, "--f-number"),
        (ImportOptions { primary_wavelength_nm: None, ..npz() }, "--primary-nm"),
        (ImportOptions { bands: Some(vec![1]), ..npz() }, "beyond the last of 1"),
    ] {
        let error = import_error(&path, &options);
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn primary_wavelength_is_that_of_the_archive() {
    use std::io::Write;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("lens.npz");
    std::fs::copy(data("double-gauss-28-550nm.npz"), &path).unwrap();
    let file = std::fs::File::options().read(true).write(true).open(&path).unwrap();
    let mut archive = zip::ZipWriter::new_append(file).unwrap();
    archive.start_file("primary_nm.npy", zip::write::SimpleFileOptions::default()).unwrap();
    let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (), }";
    let header = format!("{header:<117}\n");
    archive.write_all(b"\x93NUMPY\x01\x00").unwrap();
    archive.write_all(&(header.len() as u16).to_le_bytes()).unwrap();
    archive.write_all(header.as_bytes()).unwrap();
    archive.write_all(&551.5f64.to_le_bytes()).unwrap();
    archive.finish().unwrap();
    let (_keep, pack) = pack(&path, &ImportOptions { primary_wavelength_nm: None, ..npz() });
    assert_eq!(pack.lens().primary_wavelength_nm, 551.5);
}

#[test]
fn mirrored_windows_are_symmetric_and_others_unchanged() {
    let path = data("double-gauss-28-550nm.npz");
    let (_a, as_given) = pack(&path, &ImportOptions { symmetric: false, ..npz() });
    let (_b, mirrored) = pack(&path, &npz());
    let (a, b) = (as_given.psf(0).unwrap(), mirrored.psf(0).unwrap());
    assert_eq!(a.samples.len(), b.samples.len());
    let worst = a.samples.iter().zip(&b.samples).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-6, "{worst}");
    for row in 0..51 {
        assert_eq!(b.window(21)[row * 51..][..51], b.window(21)[(50 - row) * 51..][..51]);
    }
}
