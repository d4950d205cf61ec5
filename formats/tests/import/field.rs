//! Measured fields: round trips from arrays to packs, and errors of descriptions and arrays.

use lenscube_formats::import::field;
use lenscube_formats::lens::{LensPack, ReferencePoint};
use pipeline::lens::planar::PsfPlaces;
use std::fs;
use std::path::Path;

/// An NPY array of f8.
fn npy(shape: &[usize], values: &[f64]) -> Vec<u8> {
    assert_eq!(shape.iter().product::<usize>(), values.len());
    let sizes: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({sizes}), }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

/// Side of the windows.
const N: usize = 21;
const X_MM: [f64; 3] = [-2.0, 0.0, 2.0];
const Y_MM: [f64; 2] = [-1.0, 2.0];

/// Centre of the Gaussian of band b, row j, column i, samples from the middle: column, row.
fn centre(b: usize, j: usize, i: usize) -> [f64; 2] {
    [0.5 * i as f64 - 0.3, 0.4 * j as f64 + 0.25 * b as f64]
}

/// A Gaussian of σ = 2 samples and sum 1.
fn gaussian([x, y]: [f64; 2]) -> Vec<f64> {
    let half = (N / 2) as f64;
    let of = |i: usize| {
        let (u, v) = ((i % N) as f64 - half - x, (i / N) as f64 - half - y);
        (-(u * u + v * v) / 8.0).exp()
    };
    let window: Vec<f64> = (0..N * N).map(of).collect();
    let sum: f64 = window.iter().sum();
    window.into_iter().map(|v| v / sum).collect()
}

/// The windows of a band, scaled as counts of a camera.
fn windows(b: usize) -> Vec<f64> {
    let places = (0..2).flat_map(|j| (0..3).map(move |i| (j, i)));
    places.flat_map(|(j, i)| gaussian(centre(b, j, i)).into_iter().map(|v| 5e4 * v)).collect()
}

const HEAD: &str = "name = \"unit 17\"\nwavelengths_nm = [500, 600]\ndistortion_focal_length_mm = 35.0\n";
const PSF: &str = "[psf]\nfiles = \"psf-{band}.npy\"\nx_mm = [-2, 0, 2]\ny_mm = [-1, 2]\npitch_um = 1.5\nsample = \"point\"\n";

/// A folder with the windows of two bands, and a description.
fn folder(description: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    for b in 0..2 {
        fs::write(dir.path().join(format!("psf-{b}.npy")), npy(&[2, 3, N, N], &windows(b))).unwrap();
    }
    fs::write(dir.path().join("field.toml"), description).unwrap();
    dir
}

/// Imports the description of a folder into a pack beside it.
fn pack(dir: &Path) -> LensPack {
    let out = dir.join("out.lens.zarr");
    field::write(&out, field::open(&dir.join("field.toml")).unwrap(), |_, _| ()).unwrap();
    LensPack::open(&out).unwrap()
}

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

fn assert_window(found: &[f32], expected: &[f64], bound: f64) {
    let worst = found.iter().zip(expected).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
    assert!(worst < bound, "{worst}");
    let sum: f64 = found.iter().map(|v| f64::from(*v)).sum();
    assert!((sum - 1.0).abs() < 1e-6, "{sum}");
}

fn places(pack: &LensPack) -> (Vec<f64>, Vec<f64>) {
    match &pack.lens().bands[0].planar.as_ref().unwrap().psfs {
        PsfPlaces::Cartesian { x_mm, y_mm } => (x_mm.clone(), y_mm.clone()),
        PsfPlaces::Polar { .. } => panic!("polar"),
    }
}

#[test]
fn windows_come_back_at_their_places_and_defaults_have_notes() {
    let dir = folder(&format!("{HEAD}{PSF}"));
    let field = field::open(&dir.path().join("field.toml")).unwrap();
    for word in ["no [map]", "no [shading]", "no f_number", "psf_energy 1"] {
        assert!(field.notes().iter().any(|n| n.contains(word)), "{word}");
    }
    let pack = pack(dir.path());
    let lens = pack.lens();
    assert_eq!(
        (lens.name.as_str(), lens.distortion_focal_length_mm, lens.primary_wavelength_nm),
        ("unit 17", 35.0, 600.0)
    );
    assert_eq!(places(&pack), (X_MM.to_vec(), Y_MM.to_vec()));
    assert_eq!(pack.attributes().reference_point, Some(ReferencePoint::AsGiven));
    for b in 0..2 {
        let stack = pack.psf(b).unwrap();
        assert_eq!((stack.size, stack.pitch_um, stack.heights()), (N, 1.5, 6));
        for (row, (j, i)) in [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2)].into_iter().enumerate() {
            assert_window(stack.window(row), &gaussian(centre(b, j, i)), 1e-8);
        }
    }
    // No distortion, a step beyond the places.
    let map = &lens.bands[1].planar.as_ref().unwrap().map;
    assert_eq!((map.x_mm[0], map.x_mm[4], map.y_mm[0], map.y_mm[4]), (-4.0, 4.0, -4.0, 5.0));
    assert_eq!((map.ideal_point_at([1.0, -2.0]), map.relative_illumination[7]), ([1.0, -2.0], 1.0));
    assert_eq!(pack.attributes().source.as_ref().unwrap()["negative_samples"], serde_json::json!([0, 0]));
}

/// With y up, row 0 of windows and places is the lowest one: the mirror image of the same numbers.
#[test]
fn y_up_mirrors_places_and_windows() {
    let dir = folder(&format!("{HEAD}{PSF}y_up = true\n"));
    let pack = pack(dir.path());
    assert_eq!(places(&pack), (X_MM.to_vec(), vec![-2.0, 1.0]));
    let stack = pack.psf(1).unwrap();
    for (row, (j, i)) in [(1, 0), (1, 1), (1, 2), (0, 0), (0, 1), (0, 2)].into_iter().enumerate() {
        let [x, y] = centre(1, j, i);
        assert_window(stack.window(row), &gaussian([x, -y]), 1e-8);
    }
}

#[test]
fn centroids_of_point_samples_are_in_the_middle_to_1e_6() {
    let dir = folder(&format!("{HEAD}{PSF}centre = \"centroid\"\n"));
    assert!(
        field::open(&dir.path().join("field.toml"))
            .unwrap()
            .notes()
            .iter()
            .any(|n| n.contains("must be of centroids"))
    );
    let pack = pack(dir.path());
    assert_eq!(pack.attributes().reference_point, Some(ReferencePoint::Centroid));
    for b in 0..2 {
        let stack = pack.psf(b).unwrap();
        (0..6).for_each(|row| assert_window(stack.window(row), &gaussian([0.0, 0.0]), 1e-6));
    }
    // Integrated samples move by whole ones: of band 1, row 1, column 2 by (1, 1) from (0.7, 0.65).
    let text = format!("{HEAD}{PSF}centre = \"centroid\"\n").replace("\"point\"", "\"integrated\"");
    for text in [text.clone(), text.replace("\"centroid\"", "\"peak\"")] {
        let dir = folder(&text);
        let pack = self::pack(dir.path());
        assert_window(pack.psf(1).unwrap().window(5), &gaussian([0.7 - 1.0, 0.65 - 1.0]), 1e-5);
    }
}

#[test]
fn one_file_of_all_bands_and_archives_and_fits_are_read() {
    let all = [windows(0), windows(1)].concat();
    let expected = {
        let dir = folder(&format!("{HEAD}{PSF}"));
        let pack = pack(dir.path());
        [0, 1].map(|b| pack.psf(b).unwrap())
    };
    let check = |dir: &tempfile::TempDir| {
        let pack = pack(dir.path());
        (0..2).for_each(|b| assert_eq!(pack.psf(b).unwrap(), expected[b], "band {b}"));
    };
    let with = |files: &str| folder(&format!("{HEAD}{PSF}").replace("\"psf-{band}.npy\"", files));
    for shape in [&[2, 2, 3, N, N][..], &[2, 6, N, N]] {
        let dir = with("\"all.npy\"");
        fs::write(dir.path().join("all.npy"), npy(shape, &all)).unwrap();
        check(&dir);
    }
    let dir = with("[\"psf-0.npy\", \"psf-1.npy\"]");
    check(&dir);
    let dir = with("\"all.npz:psf\"");
    let mut zip = zip::ZipWriter::new(fs::File::create(dir.path().join("all.npz")).unwrap());
    let stored = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for (name, bytes) in [("psf", npy(&[2, 2, 3, N, N], &all)), ("other", npy(&[1], &[0.0]))] {
        zip.start_file(format!("{name}.npy"), stored).unwrap();
        std::io::Write::write_all(&mut zip, &bytes).unwrap();
    }
    zip.finish().unwrap();
    check(&dir);
    // An image a band, the first in the primary unit.
    let dir = with("\"cube.fits\"");
    let mut fits = Vec::new();
    for (b, first) in [(0, "SIMPLE  =                    T"), (1, "XTENSION= 'IMAGE   '")] {
        let sizes = [N, N, 3, 2];
        let mut cards = vec![
            first.to_owned(),
            "BITPIX  =                  -64".into(),
            "NAXIS   =                    4".into(),
        ];
        cards.extend(sizes.iter().enumerate().map(|(i, n)| format!("NAXIS{}  = {n:>20}", i + 1)));
        cards.push("END".into());
        fits.extend(cards.iter().flat_map(|card| format!("{card:80}").into_bytes()));
        fits.resize(fits.len().next_multiple_of(2880), b' ');
        fits.extend(windows(b).iter().flat_map(|v| v.to_be_bytes()));
        fits.resize(fits.len().next_multiple_of(2880), 0);
    }
    fs::write(dir.path().join("cube.fits"), fits).unwrap();
    check(&dir);
}

/// Ideal points of X(1 + 0.01) + 0.02, Y(1 − 0.01) on 4 × 5 nodes, rows down or up, and as displacements in px of 2 µm.
#[test]
fn ideal_points_and_displacements_give_the_same_map() {
    let (x_mm, y_mm) = ([-3.0, -1.0, 1.0, 3.0], [-2.0, -1.0, 0.0, 1.0, 2.0]);
    let table = |of: &dyn Fn(f64, f64) -> f64| -> Vec<f64> {
        y_mm.iter().flat_map(|y| x_mm.iter().map(|x| of(*x, *y)).collect::<Vec<_>>()).collect()
    };
    let axes = "x_mm = [-3, -1, 1, 3]\ny_mm = \"y.npy\"\n";
    let ideal = "[map]\nideal_x = \"x.npz\"\nideal_y = \"iy.npy\"\n";
    let displacement =
        "[map]\ndisplacement_x_px = \"dx.npy\"\ndisplacement_y_px = \"dy.npy\"\npitch_um = 2\n";
    for (map, up) in [(ideal, false), (ideal, true), (displacement, false), (displacement, true)] {
        let sign = if up { -1.0 } else { 1.0 };
        let dir = folder(&format!("{HEAD}{PSF}{map}{axes}y_up = {up}\n"));
        let write = |name: &str, shape: &[usize], values: &[f64]| {
            fs::write(dir.path().join(name), npy(shape, values)).unwrap()
        };
        // The numbers of a file with y up: y of the file is −Y, and so is the ideal y.
        write("y.npy", &[5], &y_mm);
        write("iy.npy", &[5, 4], &table(&|_, y| 0.99 * y));
        write("dx.npy", &[5, 4], &table(&|x, _| (x - (1.01 * x + 0.02)) * 500.0));
        // Of both bands.
        write(
            "dy.npy",
            &[2, 5, 4],
            &[table(&|_, y| 0.01 * y * 500.0), table(&|_, y| 0.01 * y * 500.0)].concat(),
        );
        let mut zip = zip::ZipWriter::new(fs::File::create(dir.path().join("x.npz")).unwrap());
        zip.start_file("only.npy", zip::write::SimpleFileOptions::default()).unwrap();
        std::io::Write::write_all(&mut zip, &npy(&[5, 4], &table(&|x, _| 1.01 * x + 0.02))).unwrap();
        zip.finish().unwrap();
        let pack = pack(dir.path());
        for b in 0..2 {
            let map = &pack.lens().bands[b].planar.as_ref().unwrap().map;
            assert_eq!((map.x_mm.as_slice(), map.y_mm.as_slice()), (&x_mm[..], &y_mm[..]));
            for (i, (x, y)) in map.ideal_x_mm.iter().zip(&map.ideal_y_mm).enumerate() {
                let film = (x_mm[i % 4], y_mm[i / 4]);
                assert!(
                    (x - 1.01 * film.0 - 0.02).abs() < 1e-12 && (y - 0.99 * film.1).abs() < 1e-12,
                    "{map:?} {sign}"
                );
            }
        }
    }
}

/// The map of a Brown model: forward evaluation of its ideal points meets the film places.
#[test]
fn brown_model_is_inverted_to_1e_10() {
    let head = HEAD.replace("distortion_focal_length_mm = 35.0\n", "");
    let map = "[map]\nsize_px = [2000, 1500]\npitch_um = 2\nbrown = { f_px = 3000, c_px = [1004.5, 745.0], k = [-0.2, 0.05, 0.01], p = [1e-3, -2e-3] }\n";
    let dir = folder(&format!("{head}{PSF}{map}"));
    let pack = pack(dir.path());
    assert!((pack.lens().distortion_focal_length_mm - 6.0).abs() < 1e-12);
    let map = &pack.lens().bands[0].planar.as_ref().unwrap().map;
    // Half the film, half a window of 31.5 µm, two pixels.
    assert!(
        (map.x_mm[0] + 2.0 + 0.01575 + 0.004).abs() < 1e-12 && (map.y_mm[128] - 1.5 - 0.01975).abs() < 1e-12
    );
    let mut worst: f64 = 0.0;
    for (i, (ideal_x, ideal_y)) in map.ideal_x_mm.iter().zip(&map.ideal_y_mm).enumerate() {
        let (x, y) = (ideal_x / 6.0, ideal_y / 6.0);
        let r2 = x * x + y * y;
        let radial = 1.0 - 0.2 * r2 + 0.05 * r2 * r2 + 0.01 * r2 * r2 * r2;
        let u = 3000.0 * (x * radial + 2e-3 * x * y - 2e-3 * (r2 + 2.0 * x * x)) + 1004.5;
        let v = 3000.0 * (y * radial + 1e-3 * (r2 + 2.0 * y * y) - 4e-3 * x * y) + 745.0;
        let film = [(u - 999.5) * 2e-3, (v - 749.5) * 2e-3];
        worst = worst.max((film[0] - map.x_mm[i % 129]).abs()).max((film[1] - map.y_mm[i / 129]).abs());
    }
    assert!(worst < 1e-10, "{worst} mm");
}

#[test]
fn flat_fields_are_normalised_and_brought_to_the_nodes() {
    let of = |x: f64, y: f64| 200.0 * (1.0 + 0.05 * x) * (1.0 - 0.1 * y);
    let flat: Vec<f64> = [-2.0, 0.0, 2.0].iter().flat_map(|y| [-4.0, 4.0].map(|x| of(x, *y))).collect();
    let shading = "[shading]\nrelative_illumination = \"flat.npy\"\nx_mm = [-4, 4]\ny_mm = [-2, 0, 2]\n";
    let map =
        "[map]\nsize_px = [1000, 1000]\npitch_um = 2\nbrown = { f_px = 17500, c_px = [499.5, 499.5] }\n";
    for (normalise, one) in [("", 200.0), ("normalise = \"largest\"\n", 200.0 * 1.2 * 1.2)] {
        let dir = folder(&format!("{HEAD}{PSF}{map}{shading}{normalise}"));
        fs::write(dir.path().join("flat.npy"), npy(&[3, 2], &flat)).unwrap();
        let pack = pack(dir.path());
        let map = &pack.lens().bands[1].planar.as_ref().unwrap().map;
        for (i, r) in map.relative_illumination.iter().enumerate() {
            let expected = of(map.x_mm[i % 129], map.y_mm[i / 129]) / one;
            assert!((r - expected).abs() < 1e-12, "{r} {expected}");
        }
    }
    // Without a map, at nodes of its own; beyond a map of its own places, the edge, with a note.
    let four = "[shading]\nrelative_illumination = \"flat.npy\"\nx_mm = [-3, -1, 1, 3]\ny_mm = [-3, -1, 1, 3]\ny_up = true\n";
    let dir = folder(&format!("{HEAD}{PSF}{four}"));
    let rows: Vec<f64> = (0..16).map(|i| if i < 8 { 1.0 } else { 3.0 }).collect();
    fs::write(dir.path().join("flat.npy"), npy(&[4, 4], &rows)).unwrap();
    let read = pack(dir.path());
    let map = &read.lens().bands[0].planar.as_ref().unwrap().map;
    assert_eq!((map.relative_illumination[0], map.relative_illumination[15]), (1.5, 0.5));
    let dir = folder(&format!(
        "{HEAD}{PSF}{map_text}{four}",
        map_text =
            "[map]\nsize_px = [4000, 1000]\npitch_um = 2\nbrown = { f_px = 17500, c_px = [1999.5, 499.5] }\n"
    ));
    fs::write(dir.path().join("flat.npy"), npy(&[4, 4], &rows)).unwrap();
    assert!(
        field::open(&dir.path().join("field.toml"))
            .unwrap()
            .notes()
            .iter()
            .any(|n| n.contains("reaches beyond [shading]"))
    );
}

#[test]
fn negative_samples_pass_and_are_counted() {
    let dir = folder(&format!("{HEAD}{PSF}"));
    let mut values = windows(1);
    (values[0], values[N * N + 3]) = (-7.0, -2.0);
    fs::write(dir.path().join("psf-1.npy"), npy(&[2, 3, N, N], &values)).unwrap();
    let pack = pack(dir.path());
    assert_eq!(pack.attributes().source.as_ref().unwrap()["negative_samples"], serde_json::json!([0, 2]));
    let sum: f64 = pack.psf(1).unwrap().window(0).iter().map(|v| f64::from(*v)).sum();
    assert!((sum - 1.0).abs() < 1e-6 && pack.psf(1).unwrap().window(0)[0] < 0.0);
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
