//! Packs of lenses without rotational symmetry: round trips, sets of PSFs, digests, summary.

use crate::*;
use lenscube_formats::lens::{PLANAR_SCHEMA, ReferencePoint, band_digest, summary};
use pipeline::lens::planar::{PlanarBand, PlanarMap, PsfPlaces};
use serde_json::{Value, json};
use std::fs;

/// A map of `columns` × `rows` nodes: the image 30 µm to the left and 50 µm down, with a keystone.
fn map_of(columns: usize, rows: usize) -> PlanarMap {
    let nodes =
        |n: usize, last: f64| (0..n).map(|i| last * (2.0 * i as f64 / (n - 1) as f64 - 1.0)).collect();
    let (x_mm, y_mm): (Vec<f64>, Vec<f64>) = (nodes(columns, 3.0), nodes(rows, 2.5));
    let table = |of: fn(f64, f64) -> f64| {
        y_mm.iter().flat_map(|y| x_mm.iter().map(|x| of(*x, *y)).collect::<Vec<_>>()).collect::<Vec<f64>>()
    };
    PlanarMap {
        ideal_x_mm: table(|x, y| 0.03 + x * (1.01 + 1e-3 * y)),
        ideal_y_mm: table(|_, y| -0.05 + y * (1.01 + 1e-3 * y)),
        relative_illumination: table(|x, y| 1.0 - 0.01 * x - 0.02 * y * y),
        x_mm,
        y_mm,
    }
}

/// The small lens with maps of different numbers of nodes, and PSFs at `places` in its two bands.
fn with_places(places: [PsfPlaces; 2]) -> Lens {
    let mut lens = small_lens();
    for ((b, places), band) in places.into_iter().enumerate().zip(&mut lens.bands) {
        let plain = band.clone().with_map(map_of(5 + 2 * b, 6 - b));
        let count = places.count();
        let is_polar = matches!(places, PsfPlaces::Polar { .. });
        *band = LensBand {
            psf_height_mm: if is_polar { plain.psf_height_mm } else { Vec::new() },
            azimuth_count: if is_polar { plain.azimuth_count } else { Vec::new() },
            psf_energy: (0..count).map(|i| 0.99 - 1e-3 * i as f64).collect(),
            planar: plain.planar.map(|planar| PlanarBand { psfs: places, ..planar }),
            ..plain
        };
    }
    lens
}

/// PSFs at 2 heights in the first band, 3 in the second.
pub(crate) fn polar_lens() -> Lens {
    let polar = |azimuth_samples: &[usize]| PsfPlaces::Polar { azimuth_samples: azimuth_samples.to_vec() };
    with_places([polar(&[1, 5]), polar(&[1, 4, 12])])
}

/// PSFs at 3 × 2 places in the first band, 1 × 4 in the second.
pub(crate) fn grid_lens() -> Lens {
    let grid = |x_mm: &[f64], y_mm: &[f64]| PsfPlaces::Cartesian { x_mm: x_mm.into(), y_mm: y_mm.into() };
    with_places([grid(&[-2.5, 0.0, 2.5], &[-2.0, 2.0]), grid(&[0.5], &[-2.0, -1.0, 0.0, 1.0])])
}

/// Windows of sum 1 (within f32), all different.
pub(crate) fn psfs(lens: &Lens, b: usize) -> PsfStack {
    let band = &lens.bands[b];
    let n = band.psf_size;
    let window = |row: usize| {
        let raw: Vec<f64> = (0..n * n).map(|i| 1.0 + ((i * 7 + row * 3 + b) % 23) as f64).collect();
        let sum: f64 = raw.iter().sum();
        raw.into_iter().map(move |v| (v / sum) as f32)
    };
    let samples = (0..band.psf_count()).flat_map(window).collect();
    PsfStack { size: n, pitch_um: band.psf_pitch_um, sample: lens.psf_sample, samples }
}

pub(crate) fn attributes() -> PackAttributes {
    PackAttributes {
        reference_point: Some(ReferencePoint::ChiefRay),
        errors: Some(json!({
            "file": "tol.toml", "digest": "ab12", "seed": 1, "sample": 7,
            "values": [{"id": "element 7-9/decentre_x", "value": 12.3, "unit": "um"}, {"id": "gap 3/thickness", "value": -4.0, "unit": "um"}],
        })),
        compensators: Some(
            json!({"film_shift_mm": 0.012, "film_tilt_rad": [0.0, 0.0], "boresight_mm": [0.03, -0.05]}),
        ),
        ..small_attributes()
    }
}

pub(crate) fn write_planar(path: &Path, lens: &Lens) -> Result<(), LensPackError> {
    let stacks = (0..lens.bands.len()).map(|b| Ok::<_, LensPackError>(psfs(lens, b)));
    write(path, lens, &attributes(), stacks)
}

fn written(lens: &Lens) -> (tempfile::TempDir, LensPack) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("built.lens.zarr");
    write_planar(&path, lens).unwrap();
    let pack = LensPack::open(&path).unwrap();
    (dir, pack)
}

#[test]
fn directory_and_zip_round_trip_with_equal_digests() {
    for (lens, field) in [(polar_lens(), "polar"), (grid_lens(), "grid")] {
        let tmp = tempfile::tempdir().unwrap();
        let [folder, zip] = ["a.lens.zarr", "a.lens.zip"].map(|name| {
            let path = tmp.path().join(name);
            write_planar(&path, &lens).unwrap();
            LensPack::open(path).unwrap()
        });
        for pack in [&folder, &zip] {
            assert_eq!(*pack.lens(), lens);
            assert_eq!(*pack.attributes(), attributes());
            assert!(pack.notes().is_empty() && !pack.is_symmetric() && !pack.has_pupils());
            for b in [1, 0] {
                assert_eq!(pack.psf(b).unwrap(), psfs(&lens, b));
            }
            pack.check_unchanged().unwrap();
        }
        assert_eq!(folder.digest().unwrap(), zip.digest().unwrap());
        assert_eq!(folder.band_digest(1).unwrap(), zip.band_digest(1).unwrap());
        let head: Value =
            serde_json::from_slice(&fs::read(folder.path().join("zarr.json")).unwrap()).unwrap();
        assert_eq!(head["attributes"]["schema"], PLANAR_SCHEMA);
        assert_eq!(head["attributes"]["psf_field"], field);
        assert_eq!(head["attributes"]["reference_point"], "chief ray");
        assert!(!folder.path().join("ideal_height").exists());
    }
}

#[test]
fn a_set_is_all_azimuths_of_a_height_or_one_psf_of_a_grid() {
    for (lens, sets) in [
        (polar_lens(), [vec![0..1, 1..6], vec![0..1, 1..5, 5..17]]),
        (grid_lens(), [(0..6).map(|i| i..i + 1).collect(), (0..4).map(|i| i..i + 1).collect()]),
    ] {
        let (_dir, pack) = written(&lens);
        for (b, sets) in sets.into_iter().enumerate() {
            let (stack, samples) = (psfs(&lens, b), lens.bands[b].psf_size.pow(2));
            for (set, rows) in sets.into_iter().enumerate() {
                let expected = &stack.samples[rows.start * samples..rows.end * samples];
                assert_eq!(
                    pack.psfs_of_sets(b, 0, set..set + 1, 2).unwrap(),
                    expected,
                    "band {b}, set {set}"
                );
            }
        }
    }
}

/// 20 windows of 183 × 183 samples are in chunks of 7 (1 MiB), the last of them not full.
#[test]
fn windows_are_read_from_chunks_of_several() {
    let mut lens = polar_lens();
    lens.bands.truncate(1);
    let band = &mut lens.bands[0];
    band.psf_size = 183;
    band.psf_energy = vec![0.5; 20];
    band.planar.as_mut().unwrap().psfs = PsfPlaces::Polar { azimuth_samples: vec![1, 19] };
    let (dir, pack) = written(&lens);
    let chunks = fs::read_dir(dir.path().join("built.lens.zarr/psf/0/c")).unwrap().count();
    assert_eq!(chunks, 3);
    assert_eq!(pack.psf_reading_bytes(0), 3 * 4 * 7 * 183 * 183);
    assert_eq!(pack.psf(0).unwrap(), psfs(&lens, 0));
    assert_eq!(pack.psfs_of_sets(0, 0, 1..2, 2).unwrap(), psfs(&lens, 0).samples[183 * 183..]);
}

#[test]
fn windows_in_chunks_of_one_are_the_same_pack() {
    let tmp = tempfile::tempdir().unwrap();
    let (lens, path) = (polar_lens(), tmp.path().join("one.lens.zarr"));
    let mut writer = LensPackWriter::create(&path).unwrap();
    (0..2).for_each(|b| writer.psf(b, &psfs(&lens, b)).unwrap());
    writer.finish(&lens, &attributes()).unwrap();
    let (_dir, several) = written(&lens);
    let one = LensPack::open(&path).unwrap();
    assert_eq!(one.lens(), several.lens());
    assert_eq!(one.digest().unwrap(), several.digest().unwrap());
    assert_eq!(fs::read_dir(path.join("psf/1/c")).unwrap().count(), 17);
}

/// blake3 of the bytes that the documentation of the digest lists.
#[test]
fn digest_is_that_of_the_documented_bytes() {
    let mut bytes = Vec::new();
    let lens = polar_lens();
    let f64s =
        |bytes: &mut Vec<u8>, values: &[f64]| bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    let counts = |bytes: &mut Vec<u8>, values: &[usize]| {
        bytes.extend(values.iter().flat_map(|v| (*v as u64).to_le_bytes()))
    };
    bytes.extend(b"lenscube/lens-pack/4 digest\n");
    f64s(&mut bytes, &[99.25, 99.5, 2.985, 587.5618, f64::NAN, 0.0]);
    counts(&mut bytes, &[1, 2]);
    for (b, (band, azimuths)) in lens.bands.iter().zip([vec![1, 5], vec![1, 4, 12]]).enumerate() {
        let map = map_of(5 + 2 * b, 6 - b);
        f64s(&mut bytes, &[band.wavelength_nm]);
        counts(&mut bytes, &[5 + 2 * b, 6 - b, [5, 3][b]]);
        for table in [&map.x_mm, &map.y_mm, &map.ideal_x_mm, &map.ideal_y_mm, &map.relative_illumination] {
            f64s(&mut bytes, table);
        }
        bytes.extend(b"polar\n");
        counts(&mut bytes, &[azimuths.len()]);
        f64s(&mut bytes, &[0.0, 1.1, 2.2][..azimuths.len()]);
        counts(&mut bytes, &[1, 8, 16][..azimuths.len()]);
        counts(&mut bytes, &azimuths);
        f64s(&mut bytes, &band.psf_energy);
        f64s(&mut bytes, &[band.psf_pitch_um, 0.088, 0.9]);
        bytes.extend(psfs(&lens, b).samples.iter().flat_map(|v| v.to_le_bytes()));
    }
    let (_dir, pack) = written(&lens);
    assert_eq!(pack.digest().unwrap(), blake3::hash(&bytes).to_hex().to_string());
    assert_eq!(pack.band_digest(1).unwrap(), band_digest(&lens, 1, &psfs(&lens, 1)));
}

#[test]
fn digest_changes_with_every_number_but_not_with_the_errors_record() {
    let digest = |lens: &Lens| written(lens).1.digest().unwrap().to_owned();
    let (polar, grid) = (polar_lens(), grid_lens());
    let (plain, plain_grid) = (digest(&polar), digest(&grid));
    let map = |lens: &Lens, change: fn(&mut PlanarMap)| {
        let mut lens = lens.clone();
        change(&mut lens.bands[1].planar.as_mut().unwrap().map);
        lens
    };
    let places = |lens: &Lens, places: PsfPlaces| {
        let mut lens = lens.clone();
        lens.bands[0].planar.as_mut().unwrap().psfs = places;
        lens
    };
    // As many PSFs at other places.
    let (six_rows, six) = (vec![-2.5, -1.5, -0.5, 0.5, 1.5, 2.5], vec![0.0]);
    let others = [
        map(&polar, |map| map.ideal_x_mm[3] += 1e-12),
        map(&polar, |map| map.ideal_y_mm[3] += 1e-12),
        map(&polar, |map| map.relative_illumination[0] += 1e-12),
        map(&polar, |map| map.x_mm.iter_mut().for_each(|x| *x += 1e-3)),
        map(&polar, |map| map.y_mm.iter_mut().for_each(|y| *y += 1e-3)),
        map(&grid, |map| map.ideal_x_mm[3] += 1e-12),
        places(&grid, PsfPlaces::Cartesian { x_mm: six.clone(), y_mm: six_rows.clone() }),
        places(&grid, PsfPlaces::Cartesian { x_mm: six_rows, y_mm: six }),
    ];
    let mut digests: Vec<String> = others.iter().map(digest).collect();
    digests.extend([plain.clone(), plain_grid]);
    digests.sort();
    digests.dedup();
    assert_eq!(digests.len(), 10);
    let tmp = tempfile::tempdir().unwrap();
    let path = tmp.path().join("no-errors.lens.zip");
    let stacks = (0..2).map(|b| Ok::<_, LensPackError>(psfs(&polar, b)));
    write(&path, &polar, &small_attributes(), stacks).unwrap();
    assert_eq!(LensPack::open(&path).unwrap().digest().unwrap(), plain);
}

#[test]
fn what_needs_image_heights_is_refused_in_one_line() {
    let (_dir, pack) = written(&polar_lens());
    let error = pack.require_symmetric("`lens export`").unwrap_err().to_string();
    let path = pack.path().display();
    assert_eq!(
        error,
        format!(
            "lens pack {path} has no rotational symmetry (schema lenscube/lens-pack/4): `lens export` needs image heights; use `lenscube run` or `lenscube lens show`"
        )
    );
    let tmp = tempfile::tempdir().unwrap();
    let path = tmp.path().join("small.zip");
    write_small(&path);
    let pack = LensPack::open(&path).unwrap();
    assert!(pack.is_symmetric() && pack.require_symmetric("`lens export`").is_ok());
}

#[test]
fn summary_has_maps_places_and_errors() {
    let (_dir, pack) = written(&polar_lens());
    let shown = summary(&pack, true, None);
    let text = shown.to_string();
    for expected in [
        "symmetry       none: maps over the film; reference point: chief ray",
        "errors         2 drawn values, file tol.toml, digest ab12, seed 1, sample 7",
        "compensators   film_shift_mm 0.012, film_tilt_rad [0.0,0.0], boresight_mm [0.03,-0.05]",
        "450.00 nm     map (-3.000, -2.500) to (3.000, 2.500) mm, 5 × 6 nodes",
        "17 PSFs (polar) at 3 heights to 2.200 mm and 4..12 azimuths, for 25 nodes at 8..16 azimuths",
        "window 3 px (2.6 µm), pitch 0.875 µm (Nyquist 0.821), energy 0.9740 to 0.9900",
    ] {
        assert!(text.contains(expected), "{expected} in\n{text}");
    }
    for band in &shown.planar.as_ref().unwrap().table {
        // The place whose ideal point is the centre: y (1.01 + 1e-3 y) = 0.05, x (1.01 + 1e-3 y) = -0.03.
        let y = (-1.01 + f64::sqrt(1.01 * 1.01 + 4e-3 * 0.05)) / 2e-3;
        let x = -0.03 / (1.01 + 1e-3 * y);
        let [found_x, found_y] = band.boresight_um;
        // One step from y = 0.5 mm misses 1e-3 y² by 0.2 µm.
        assert!((found_x - 1e3 * x).abs() < 0.02 && (found_y - 1e3 * y).abs() < 0.3, "{found_x}, {found_y}");
        // Film minus ideal point, farthest from that at (3, 2.5).
        let at = |x: f64, y: f64| [-0.03 - x * (0.01 + 1e-3 * y), 0.05 - y * (0.01 + 1e-3 * y)];
        let [dx, dy] = at(3.0, 2.5);
        let largest = (1e3 * dx - found_x).hypot(1e3 * dy - found_y);
        assert!((band.largest_shift_um - largest).abs() < 1e-9, "{} µm", band.largest_shift_um);
        // At (3, ±2.5).
        assert!((band.illumination[0] - (1.0 - 0.03 - 0.125)).abs() < 1e-12);
    }
    let value = serde_json::to_value(&shown).unwrap();
    assert_eq!(value["ideal_field_mm"], Value::Null);
    assert_eq!(value["planar"]["table"][1]["psf_field"]["polar"]["psf_azimuths"], json!([4, 12]));
    let (_dir, pack) = written(&grid_lens());
    let text = summary(&pack, true, None).to_string();
    let expected = "6 PSFs (grid) at 3 × 2 places from (-2.500, -2.000) to (2.500, 2.000) mm";
    assert!(text.contains(expected), "{expected} in\n{text}");
}

/// Written by tests/data/make_planar_lens_pack.py with zarr-python.
#[test]
fn pack_of_zarr_python_is_read() {
    for name in ["polar", "grid"] {
        let path = fixture().with_file_name(format!("zarr_python_{name}.lens.zip"));
        let pack = LensPack::open(path).unwrap();
        let band = &pack.lens().bands[1];
        let planar = band.planar.as_ref().unwrap();
        assert_eq!(planar.map.x_mm, [-2.0, -1.0, 0.0, 1.0, 2.0]);
        assert_eq!(planar.map.y_mm, [-1.5, -0.5, 0.5, 1.5]);
        // Row 3, column 1.
        let index = 3 * 5 + 1;
        assert_eq!(planar.map.ideal_x_mm[index], 0.25 - 1.02);
        assert_eq!(planar.map.ideal_y_mm[index], 1.5 * 0.98 - 0.125);
        assert_eq!(planar.map.relative_illumination[index], 1.0 - 0.0625 * 1.5);
        let rows = match &planar.psfs {
            PsfPlaces::Polar { azimuth_samples } => {
                assert_eq!((&azimuth_samples[..], &band.psf_height_mm[..]), (&[1, 6][..], &[0.0, 2.0][..]));
                7
            }
            PsfPlaces::Cartesian { x_mm, y_mm } => {
                assert_eq!((&x_mm[..], &y_mm[..]), (&[-1.0, 1.0][..], &[-1.5, 0.0, 1.5][..]));
                6
            }
        };
        let stack = pack.psf(1).unwrap();
        assert_eq!((stack.size, stack.heights()), (5, rows));
        for row in 0..rows {
            // One sample has the light: row-major index 3·row mod 25.
            let expected = (0..25).map(|i| if i == 3 * row % 25 { 1.0 } else { 0.0 });
            assert!(stack.window(row).iter().copied().eq(expected), "{name}, PSF {row}");
        }
        assert_eq!(pack.attributes().reference_point, Some(ReferencePoint::Centroid));
    }
}
