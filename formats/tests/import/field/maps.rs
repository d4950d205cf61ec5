//! Maps and flat fields.

use super::*;

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
