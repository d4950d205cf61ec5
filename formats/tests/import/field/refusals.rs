//! Errors of descriptions and arrays.

use super::*;

/// The error of a folder; no pack remains.
fn error(dir: &Path) -> String {
    let out = dir.join("out.lens.zarr");
    let imported =
        field::open(&dir.join("field.toml")).and_then(|field| field::write(&out, field, |_, _| ()));
    assert!(!out.exists(), "a file remains");
    imported.unwrap_err().to_string()
}

/// The error of a description beside valid windows.
fn description_error(description: &str) -> String {
    error(folder(description).path())
}

#[test]
fn errors_of_a_description_name_line_key_and_expectation() {
    let text = format!("{HEAD}{PSF}");
    let brown =
        "[map]\nsize_px = [2000, 1500]\npitch_um = 2\nbrown = { f_px = 3000, c_px = [1, 2], k = [-0.2] }\n";
    let cases = [
        (
            text.replace("files", "file"),
            &["field.toml, line 5", "[psf] has no key `file`; did you mean `files`?"][..],
        ),
        (format!("{text}[shade]\n"), &["the file has no key `shade`; did you mean `name`?", "shading"]),
        (text.replace("[500, 600]", "[600, 500]"), &["line 2", "wavelengths_nm", "ascending", "[600, 500]"]),
        (
            text.replace("distortion_focal_length_mm = 35.0\n", ""),
            &["has no key `distortion_focal_length_mm`"],
        ),
        (text.replace("35.0", "0"), &["line 3", "focal length is 0 mm"]),
        (text.replace("\"point\"", "\"mean\""), &["sample", "\"point\" or \"integrated\"", "\"mean\""]),
        (text.replace("psf-{band}", "../psf-{band}"), &["expected a file in the folder of the description"]),
        (
            text.replace("\"psf-{band}.npy\"", "[\"a.npy\", \"b.npy\", \"c.npy\"]"),
            &["expected 1 file, or 2, one a band"],
        ),
        (
            text.replace("psf-{band}.npy", "psf.mat"),
            &["NAME.npy, NAME.npz:ARRAY or NAME.fits:IMAGE", "psf.mat"],
        ),
        (text.replace("psf-{band}.npy", "absent.npy"), &["absent.npy", "cannot read"]),
        (
            text.replace("[-2, 0, 2]", "[-2, 0.5, 2]"),
            &["[psf] x_mm is not uniform: 0.5 mm at index 1, expected 0 mm", "scattered places"],
        ),
        (text.replace("[-2, 0, 2]", "[-2, 0, 2, 4]"), &["psf-0.npy", "[2, 3, 21, 21]", "(2, 4, n, n)"]),
        (
            text.replace("[-2, 0, 2]", "[-2, 0, 2, 4, 6, 8]").replace("[-1, 2]", "[0, 1, 2, 3, 4, 5]"),
            &["(scattered) are not read"],
        ),
        (format!("object_distance_mm = 500\n{text}"), &["one of object_distance_mm and magnification"]),
        (format!("{text}[map]\nx_mm = [0, 1, 2, 3]\n"), &["[map] needs one of: ideal_x and ideal_y"]),
        (
            format!("{text}[map]\nideal_x = \"a.npy\"\nx_mm = [0, 1]\ny_mm = [0, 1]\n"),
            &["[map] has no key `ideal_y`"],
        ),
        (
            format!(
                "{text}[map]\nideal_x = \"a.npy\"\nideal_y = \"a.npy\"\nx_mm = [0, 1, 2]\ny_mm = [0, 1, 2, 3]\n"
            ),
            &["[map] x_mm", "number of nodes of the map is 3, expected 4 to 1025"],
        ),
        (format!("{text}{brown}x_mm = [0, 1]\n"), &["has x_mm beside brown"]),
        (
            format!("{text}{brown}"),
            &["distortion_focal_length_mm: expected 6, f_px·pitch_um of brown", "35.0"],
        ),
        (
            format!(
                "{}{}",
                text.replace("distortion_focal_length_mm = 35.0\n", ""),
                brown.replace("[-0.2]", "[-20]")
            ),
            &["[map] brown has no ideal point at", "check the order and the signs"],
        ),
        (
            format!("{text}{}", brown.replace("k = [-0.2]", "k = [1, 2, 3, 4]")),
            &["k: expected a list of up to 3 numbers"],
        ),
        (
            format!("{text}[shading]\nrelative_illumination = \"psf-0.npy\"\n"),
            &["psf-0.npy", "has shape [2, 3, 21, 21], expected (5, 5) or (2, 5, 5)"],
        ),
        (format!("{text}x ="), &["line 10, column"]),
    ];
    for (text, words) in cases {
        let found = description_error(&text);
        assert!(found.contains("field.toml") || found.contains(".npy"), "{found}");
        for word in words {
            assert!(found.contains(word), "`{word}` is not in: {found}");
        }
    }
}

#[test]
fn errors_of_arrays_name_file_place_and_value() {
    let with = |name: &str, shape: &[usize], values: &[f64], more: &str| {
        let dir = folder(&format!("{HEAD}{PSF}{more}"));
        fs::write(dir.path().join(name), npy(shape, values)).unwrap();
        error(dir.path())
    };
    let assert_words = |found: String, words: &[&str]| {
        words.iter().for_each(|word| assert!(found.contains(word), "`{word}` is not in: {found}"))
    };
    let place = "the window of row 1, column 0 (film place -2, 2 mm)";
    let mut values = windows(0);
    values[3 * N * N + N + 2] = f64::NAN;
    let shape = [2, 3, N, N];
    assert_words(with("psf-0.npy", &shape, &values, ""), &["psf-0.npy", place, "has NaN at row 1, column 2"]);
    let mut values = windows(1);
    values[3 * N * N..4 * N * N].iter_mut().for_each(|v| *v -= 1e3);
    assert_words(
        with("psf-1.npy", &shape, &values, ""),
        &["psf-1.npy", place, "expected a positive number; subtract less background"],
    );
    // Noise about 0.
    let mut values = windows(1);
    values[3 * N * N..4 * N * N]
        .iter_mut()
        .enumerate()
        .for_each(|(i, v)| *v = if i % 2 == 0 { 1.0 } else { -0.9 });
    assert_words(
        with("psf-1.npy", &shape, &values, ""),
        &["psf-1.npy", place, "of that of its absolute samples, expected at least 0.1"],
    );
    let mut more = npy(&shape, &windows(0));
    more.extend([0; 8]);
    let dir = folder(&format!("{HEAD}{PSF}"));
    fs::write(dir.path().join("psf-0.npy"), more).unwrap();
    let found = error(dir.path());
    assert!(found.contains("bytes of samples, expected") && !found.contains("cut short"), "{found}");
    assert_words(
        with("psf-0.npy", &[2, 3, 20, 20], &[1.0; 2400], ""),
        &["windows of 20 × 20 samples, expected an odd number"],
    );
    assert_words(
        with("psf-0.npy", &[2, 3, 3, 5], &[1.0; 90], ""),
        &["windows of 3 × 5 samples, expected squares"],
    );
    let mut values = windows(0);
    values[..N * N].iter_mut().for_each(|v| *v = 0.0);
    values[0] = 1.0;
    values[N * N - 1] = 0.9;
    assert_words(
        with("psf-0.npy", &shape, &values, "centre = \"peak\"\n"),
        &["column 0 (film place -2, -1 mm) loses 47.4 % of its light"],
    );
    let map =
        "[map]\nideal_x = \"ix.npy\"\nideal_y = \"iy.npy\"\nx_mm = [-3, -1, 1, 3]\ny_mm = [3, 1, -1, -3]\n";
    let dir = folder(&format!("{HEAD}{PSF}{map}"));
    let across: Vec<f64> = (0..16).map(|i| [-3.0, -1.0, 1.0, 3.0][i % 4]).collect();
    let mut down: Vec<f64> = (0..16).map(|i| [3.0, 1.0, -1.0, -3.0][i / 4]).collect();
    let write = |name: &str, values: &[f64]| fs::write(dir.path().join(name), npy(&[4, 4], values)).unwrap();
    write("ix.npy", &across);
    write("iy.npy", &down.iter().map(|v| -v).collect::<Vec<f64>>());
    assert_words(error(dir.path()), &["field.toml", "folds at"]);
    down[6] = f64::INFINITY;
    write("iy.npy", &down);
    assert_words(error(dir.path()), &["iy.npy", "inf at row 1, column 2 (film place 1, 1 mm)"]);
    let shading = "[shading]\nrelative_illumination = \"flat.npy\"\n";
    let flat = |value: f64| (0..25).map(|i| if i == 7 { value } else { 1.0 }).collect::<Vec<f64>>();
    assert_words(
        with("flat.npy", &[5, 5], &flat(-1.0), shading),
        &["flat.npy", "has -1 at the film place 0, -1.75 mm"],
    );
    assert_words(with("flat.npy", &[5, 5], &[0.0; 25], shading), &["has 0 at the film's centre"]);
    let off = "x_mm = [1, 2, 3, 4]\ny_mm = [1, 2, 3, 4]\n";
    assert_words(
        with("flat.npy", &[4, 4], &[1.0; 16], &format!("{shading}{off}")),
        &["has no value at the film's centre", "largest"],
    );
}
