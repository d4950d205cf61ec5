//! `lenscube lens export --as psf-…`.

use super::*;

/// A pack of two bands, and a folder for files.
fn pack() -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let pack = dir.path().join("lens.zarr");
    trace("double-gauss-28", &pack, &["--tails", "off"]).ok();
    (dir, pack)
}

fn export(lens: &Path, out: &Path, flags: &[&str]) -> CommandResult {
    lenscube(&[&["lens", "export", text(lens), text(out), "--film-pitch-um", "5"], flags].concat())
}

#[test]
fn psfs_at_places_are_the_films_of_points_there() {
    let (dir, lens) = pack();
    let out = dir.path().join("psf.npy");
    let flags = [
        "--as",
        "psf-npy",
        "--band",
        "500",
        "--film-size",
        "401x301",
        "--grid",
        "3x2",
        "--oversample",
        "3",
        "--json",
    ];
    let report = json(export(&lens, &out, &flags));
    let side = report["side"].as_u64().unwrap() as usize;
    let window = report["window_px"].as_u64().unwrap() as usize;
    assert_eq!((side, window % 2), (3 * window, 1));
    assert_eq!(report["places_x_mm"], serde_json::json!([-1.0, 0.0, 1.0]));
    assert_eq!(report["places_y_mm"], serde_json::json!([-0.75, 0.75]));
    let described: Value =
        serde_json::from_str(&fs::read_to_string(dir.path().join("psf.json")).unwrap()).unwrap();
    assert_eq!(described["energy"][0][1][2], report["energy"][0][5]);
    assert_eq!(described["axes"], serde_json::json!(["wavelength", "place_y", "place_x", "y", "x"]));
    let all = crate::common::read_npy(&out);
    assert_eq!(all.len(), 6 * side * side);
    for (i, psf) in all.chunks(side * side).enumerate() {
        let energy = report["energy"][0][i].as_f64().unwrap();
        let sum: f64 = psf.iter().map(|v| f64::from(*v)).sum();
        assert!(
            (sum / 9.0 - energy).abs() < 1e-5 && (0.98..1.0).contains(&energy),
            "place {i}: {sum}, {energy}"
        );
    }
    // A film of one point at the place (1, 0.75) mm: kernels of films have sum 1.
    let at = |name: &str| dir.path().join(name);
    let n = window;
    let mut point = vec![0.0; n * n];
    point[n * n / 2] = 1.0;
    crate::common::write_npy(&at("point.npy"), Size::new(n, n), &point);
    let (size, half) = (format!("{n}x{n}"), (n - 1) as f64 / 2.0);
    let axis = format!("{},{}", half - 200.0, half - 150.0);
    let film = at("film.zarr");
    let words = [
        "run",
        text(&at("point.npy")),
        text(&film),
        "--lens",
        text(&lens),
        "--wavelengths",
        "500",
        "--stages",
        "svpsf",
    ]
    .map(str::to_owned);
    let placed = ["--film-pitch-um", "5", "--film-size", &size, "--axis", &axis, "--center", "1,0.75"]
        .map(str::to_owned);
    let all_words: Vec<String> = words.into_iter().chain(placed).collect();
    lenscube(&all_words.iter().map(String::as_str).collect::<Vec<_>>()).ok();
    let film = pixels(&film, "film").1.remove(0);
    let psf = &all[5 * side * side..];
    let peak = film.iter().copied().fold(0.0, f32::max);
    let kernel_sum: f32 = film.iter().sum();
    let in_middle: f32 = (0..n * n).map(|i| psf[(3 * (i / n) + 1) * side + 3 * (i % n) + 1]).sum();
    for (i, value) in film.iter().enumerate() {
        let sample = psf[(3 * (i / n) + 1) * side + 3 * (i % n) + 1] / in_middle * kernel_sum;
        assert!((sample - value).abs() < 2e-5 * peak, "pixel {i}: {sample}, {value}");
    }
}

#[test]
fn fits_are_files_of_one_wavelength_or_a_folder_of_several() {
    let (dir, lens) = pack();
    let out = dir.path().join("psf.fits");
    let film =
        ["--as", "psf-fits", "--film-size", "300", "--grid", "2", "--psf-window", "9", "--oversample", "2"];
    export(&lens, &out, &[&film[..], &["--band", "600"]].concat()).ok();
    let bytes = fs::read(&out).unwrap();
    assert_eq!(bytes.len() % 2880, 0);
    let header: String = bytes.iter().take(2880).map(|b| char::from(*b)).collect();
    for card in [
        "NAXIS3  =                    4",
        "OVERSAMP=                    2",
        "DET_YX3 = '(299.0, 299.0)'",
        "WAVELEN =               6.0E-7",
    ] {
        assert!(header.contains(card), "{card} in {header}");
    }
    assert_exit(
        &export(&lens, &out, &[&film[..], &["--band", "600"]].concat()),
        OTHER_JOB,
        &["psf.fits", "--overwrite"],
    );
    let folder = dir.path().join("psfs");
    export(&lens, &folder, &[&film[..], &["--wavelengths", "500,600"]].concat()).ok();
    let names: Vec<PathBuf> = files(&folder).into_keys().collect();
    assert_eq!(names, ["psf-500nm.fits", "psf-600nm.fits"].map(PathBuf::from));
    assert_eq!(fs::read(folder.join("psf-600nm.fits")).unwrap(), bytes);
    // A Zarr group has an axis of wavelengths; bytes are those of before when it is replaced.
    let store = dir.path().join("psf.zarr");
    let of_store = [
        "--as",
        "psf-zarr",
        "--film-size",
        "300",
        "--grid",
        "2x1",
        "--wavelengths",
        "500,600",
        "--overwrite",
    ];
    export(&lens, &store, &of_store).ok();
    let before = files(&store);
    export(&lens, &store, &of_store).ok();
    assert!(before == files(&store) && before.contains_key(Path::new("psf/c/1/0/1/0/0")));
}

#[test]
fn what_psfs_do_not_have_is_refused() {
    let (dir, lens) = pack();
    let refused = |name: &str, flags: &[&str], words: &[&str]| {
        assert_exit(&export(&lens, &dir.path().join(name), flags), USAGE, words);
        assert!(!dir.path().join(name).exists());
    };
    refused("a.fits", &["--as", "psf-fits", "--grid", "2x1"], &["--grid 2x1", "2 or more along each side"]);
    refused("a.fits", &["--as", "psf-fits", "--grid", "11x10"], &["--grid 11x10", "100 at most"]);
    refused("a.fit5", &["--as", "psf-fits"], &[".fits", "photutils"]);
    refused(
        "a.fits",
        &["--as", "psf-fits", "--psf-window", "1", "--oversample", "3"],
        &["--psf-window", "--oversample"],
    );
    refused("a.npy", &["--as", "psf-npy", "--band", "555"], &["no band at 555 nm", "500,600"]);
    refused("a.npy", &["--as", "psf-npy", "--film-size", "3000"], &["beyond the PSFs", "--film-size"]);
    refused(
        "a.npy",
        &["--as", "psf-npy", "--grid", "400x400", "--oversample", "16"],
        &["GB a wavelength", "--oversample"],
    );
    refused("a.npy", &["--as", "psf-npy", "--max-residual", "1"], &["--max-residual"]);
    refused("a.npy", &["--as", "psf-npy", "--focus-m", "1"], &["lens pack", "designs only"]);
    refused("a.csv", &["--as", "lut", "--oversample", "3"], &["--oversample is for PSFs"]);
    assert_exit(
        &lenscube(&["lens", "export", text(&lens), "--as", "psf-zarr"]),
        USAGE,
        &["psf-zarr is written to a file"],
    );
    assert_exit(
        &lenscube(&["lens", "export", "phone", "no.npy", "--as", "psf-npy", "--oversample", "17"]),
        USAGE,
        &["1 to 16"],
    );
}

#[test]
fn optics_for_isetcam_have_the_tables_and_psfs_of_the_lens() {
    let (dir, lens) = pack();
    let out = dir.path().join("optics.mat");
    let flags = ["--as", "isetcam", "--film-size", "401x301", "--grid", "10", "--json"];
    let report = json(export(&lens, &out, &flags));
    // All bands of the pack; field heights in equal steps to that of the corner.
    assert_eq!(report["wavelengths_nm"], serde_json::json!([500.0, 600.0]));
    let numbers = |of: &Value| of.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect::<Vec<_>>();
    let heights = numbers(&report["field_heights_mm"]);
    assert!(heights.len() == 10 && heights[0] == 0.0 && (heights[9] / heights[1] - 9.0).abs() < 1e-9);
    let corner = 5e-3 * 200f64.hypot(150.0);
    for band in 0..2 {
        let real = numbers(&report["image_heights_mm"][band]);
        let light = numbers(&report["relative_illumination"][band]);
        assert!(real[9] <= corner + 1e-9 && real[9] > 0.999 * corner, "{real:?}");
        assert!(light[0] == 1.0 && light.windows(2).all(|w| w[1] < w[0]), "{light:?}");
    }
    let side = report["side"].as_u64().unwrap() as usize;
    let bytes = fs::read(&out).unwrap();
    assert!(bytes.starts_with(b"MATLAB 5.0 MAT-file, written by lenscube") && side.is_multiple_of(2));
    // 20 PSFs of doubles, each of sum 1, before the axes of their struct.
    let size = 20 * side * side * 8;
    let tag = [9u32.to_le_bytes(), (size as u32).to_le_bytes()].concat();
    let at = bytes.windows(8).position(|w| w == tag).unwrap() + 8;
    let psfs =
        bytes[at..at + size].as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect::<Vec<_>>();
    for psf in psfs.chunks(side * side) {
        assert!((psf.iter().sum::<f64>() - 1.0).abs() < 1e-6);
        let peak = (0..side * side).max_by(|a, b| psf[*a].total_cmp(&psf[*b])).unwrap();
        let from_middle = [peak / side, peak % side].map(|k| k.abs_diff(side / 2 - 1));
        assert!(from_middle.iter().all(|px| *px <= 2), "{from_middle:?}");
    }
    assert_exit(&export(&lens, &out, &flags), OTHER_JOB, &["optics.mat", "--overwrite"]);
    let refused = |name: &str, more: &[&str], words: &[&str]| {
        let ran = export(&lens, &dir.path().join(name), &[&["--as", "isetcam"], more].concat());
        assert_exit(&ran, USAGE, words);
    };
    refused("a.m", &[], &[".mat"]);
    refused("a.mat", &["--grid", "9"], &["--grid 9", "10 to 200"]);
    refused("a.mat", &["--film-size", "3000"], &["film's corner", "--film-size"]);
}
