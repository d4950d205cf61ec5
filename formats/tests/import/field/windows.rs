//! Windows of PSFs: places, mirror images, centroids, files, negative samples.

use super::*;
use lenscube_formats::lens::ReferencePoint;
use pipeline::lens::planar::PsfPlaces;

const X_MM: [f64; 3] = [-2.0, 0.0, 2.0];
const Y_MM: [f64; 2] = [-1.0, 2.0];

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
