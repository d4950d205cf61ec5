//! Invalid packs of lenses without rotational symmetry: each error names the pack, the array and the way out.

use crate::errors::{edit_json, f64s, replace_array};
use crate::planar::{attributes, grid_lens, polar_lens, psfs, write_planar};
use crate::*;
use pipeline::lens::planar::PsfPlaces;
use serde_json::{Value, json};
use std::fs;

const POLAR: fn() -> Lens = polar_lens;
const GRID: fn() -> Lens = grid_lens;

/// Error of reading a pack of `lens` that `change` has made invalid.
fn error_after(lens: fn() -> Lens, change: impl FnOnce(&Path)) -> LensPackError {
    let tmp = tempfile::tempdir().unwrap();
    let path = tmp.path().join("built.lens.zarr");
    write_planar(&path, &lens()).unwrap();
    read_all(&path).unwrap();
    change(&path);
    let error = read_all(&path).expect_err("an invalid pack was read");
    let text = error.to_string();
    assert!(text.contains("built.lens.zarr") && !text.contains('\n'), "{text}");
    error
}

fn table(lens: fn() -> Lens, name: &str, shape: &[usize], values: &[f64]) -> String {
    error_after(lens, |path| replace_array(path.join(name), "float64", shape, &f64s(values))).to_string()
}

#[test]
fn missing_required_array_is_an_error() {
    let both = [
        "wavelength",
        "map_x",
        "map_y",
        "map_ideal_x",
        "map_ideal_y",
        "map_relative_illumination",
        "psf_pitch",
        "psf_energy",
        "psf/0",
        "psf/1",
    ];
    let polar = ["psf_height", "azimuth_count", "psf_azimuths"];
    for (lens, names) in [(POLAR, &both[..]), (GRID, &both), (POLAR, &polar), (GRID, &["psf_x", "psf_y"])] {
        for name in names {
            let e = error_after(lens, |path| fs::remove_dir_all(path.join(name)).unwrap());
            assert!(matches!(&e, LensPackError::MissingArray { array, .. } if array == name), "{e}");
        }
    }
}

#[test]
fn unknown_psf_field_reference_point_or_extra_is_an_error() {
    let root =
        |change: fn(&mut Value)| error_after(POLAR, |p| edit_json(p.join("zarr.json"), change)).to_string();
    let e = root(|j| j["attributes"]["psf_field"] = json!("spiral"));
    assert!(e.contains("attribute `psf_field` is \"spiral\", expected \"polar\" or \"grid\""), "{e}");
    let e = root(|j| drop(j["attributes"].as_object_mut().unwrap().remove("psf_field")));
    assert!(e.contains("attribute `psf_field` is missing"), "{e}");
    let e = root(|j| j["attributes"]["reference_point"] = json!("peak"));
    assert!(
        e.contains("attribute `reference_point` is \"peak\", expected \"chief ray\", \"centroid\" or"),
        "{e}"
    );
    let e = root(|j| j["attributes"]["extras"] = json!(["tail"]));
    assert!(e.contains("attribute `extras`") && e.contains("rotational symmetry"), "{e}");
    // PSFs of the other kind of places.
    let e = root(|j| j["attributes"]["psf_field"] = json!("grid"));
    assert!(e.contains("array `psf_x` is missing"), "{e}");
    let e = root(|j| j["attributes"]["schema"] = json!("lenscube/lens-pack/1"));
    assert!(e.contains("array `ideal_height` is missing"), "{e}");
}

#[test]
fn invalid_maps_are_errors_with_band_and_place() {
    let nan = f64::NAN;
    let x = [-3.0, -1.5, 0.0, 1.5, 3.0, nan, nan, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0];
    let with = |i: usize, v: f64| {
        let mut x = x;
        x[i] = v;
        x
    };
    let e = table(POLAR, "map_x", &[2, 7], &with(8, -2.1));
    assert!(e.contains("550 nm: map_x is not uniform: -2.1 mm at index 1, expected -2 mm"), "{e}");
    let e = table(POLAR, "map_x", &[2, 7], &with(5, 4.5));
    // Six columns of which the last are padding.
    assert!(e.contains("`map_ideal_x`: band 0, index 5 is NaN, expected a finite number"), "{e}");
    let e = table(POLAR, "map_x", &[2, 7], &with(3, nan));
    assert!(
        e.contains("band 0, index 4 is 3, expected NaN to the end of the row after the first NaN"),
        "{e}"
    );
    let e = table(POLAR, "map_x", &[2, 3], &[-1.0, 0.0, 1.0, -1.0, 0.0, 1.0]);
    assert!(e.contains("`map_x` has shape [2, 3], expected [2, 4 to 1025 nodes]"), "{e}");
    let e = table(POLAR, "map_x", &[2, 7], &f64s_of(2 * 7, |i| x[i] * 1e5));
    assert!(e.contains("map_x is out of bounds"), "{e}");
    let e = table(POLAR, "map_x", &[2, 7], &f64s_of(2 * 7, |i| -x[i]));
    assert!(e.contains("map_x does not ascend"), "{e}");
    let map = |lens: fn() -> Lens, change: fn(&mut [f64])| {
        let mut values: Vec<f64> =
            (0..2 * 6 * 7).map(|i| (i % 7) as f64 - if i < 42 { 2.0 } else { 3.0 }).collect();
        change(&mut values);
        table(lens, "map_ideal_x", &[2, 6, 7], &values)
    };
    let e = map(GRID, |v| v[42 + 7 + 2] = f64::INFINITY);
    assert!(e.contains("`map_ideal_x`: band 1, index 9 is inf, expected a finite number"), "{e}");
    let e = map(POLAR, |v| v[42 + 7 + 2] = 1e6);
    assert!(e.contains("550 nm: map_ideal_x is out of bounds at row 1, column 2"), "{e}");
    let e = map(POLAR, |v| v.iter_mut().for_each(|x| *x = -*x));
    assert!(e.contains("450 nm: map_ideal_x, map_ideal_y folds at"), "{e}");
    let e = table(POLAR, "map_ideal_x", &[2, 7, 6], &[0.0; 84]);
    assert!(e.contains("[2, 7, 6], expected [2, 6, 7] (bands, nodes of map_y, nodes of map_x)"), "{e}");
    let e = table(POLAR, "map_relative_illumination", &[2, 6, 7], &[-0.5; 84]);
    assert!(e.contains("450 nm: map_relative_illumination is out of bounds at row 0, column 0"), "{e}");
}

fn f64s_of(n: usize, of: impl Fn(usize) -> f64) -> Vec<f64> {
    (0..n).map(of).collect()
}

#[test]
fn invalid_heights_and_azimuths_are_errors() {
    let samples = |values: [f64; 6]| table(POLAR, "psf_azimuths", &[2, 3], &values);
    let e = samples([1.0, 5.0, 0.0, 2.0, 4.0, 11.0]);
    assert!(e.contains("550 nm: psf_azimuths is 2 on the axis, expected 1"), "{e}");
    let e = samples([1.0, 5.0, 0.0, 1.0, 4.0, 11.0]);
    assert!(
        e.contains("`psf_energy` has shape [2, 17], expected [2, 16] (PSFs: the sum of psf_azimuths)"),
        "{e}"
    );
    let e = samples([1.0, 4.0, 0.0, 1.0, 4.0, 12.0]);
    assert!(
        e.contains(
            "`psf/0` has shape [6, 5, 5], expected [5, n, n] with n odd (5 PSFs: the sum of psf_azimuths)"
        ),
        "{e}"
    );
    let e = samples([1.0, 4.5, 0.0, 1.0, 4.0, 12.0]);
    assert!(e.contains("`psf_azimuths`: band 0, index 1 is 4.5, expected a whole number up to 2880"), "{e}");
    let e = samples([1.0, 2881.0, 0.0, 1.0, 4.0, 12.0]);
    assert!(e.contains("band 0, index 1 is 2881, expected a whole number up to 2880"), "{e}");
    let e = samples([1.0, f64::NAN, 0.0, 1.0, 4.0, 12.0]);
    assert!(e.contains("band 0, index 1 is NaN"), "{e}");
    let e = samples([0.0, 6.0, 0.0, 1.0, 4.0, 12.0]);
    assert!(
        e.contains("450 nm: psf_azimuths is out of bounds: the number of azimuths with PSFs is 0"),
        "{e}"
    );
    let e = table(POLAR, "azimuth_count", &[2, 3], &[1.0, 8.0, 0.0, 1.0, 9.0, 8.0]);
    assert!(e.contains("550 nm: azimuth_count is 9 at height 1, expected a multiple of 4"), "{e}");
    let e = table(POLAR, "psf_azimuths", &[2, 2], &[1.0, 5.0, 1.0, 4.0]);
    assert!(e.contains("[2, 2], expected [2, 3] (bands, heights of psf_height)"), "{e}");
    let e = table(POLAR, "psf_energy", &[2, 17], &[1.5; 34]);
    assert!(e.contains("450 nm: psf_energy is out of bounds at index 0"), "{e}");
}

#[test]
fn invalid_grids_are_errors() {
    let nan = f64::NAN;
    let e = table(GRID, "psf_x", &[2, 3], &[-2.5, 0.1, 2.5, 0.5, nan, nan]);
    assert!(e.contains("450 nm: psf_x is not uniform: 0.1 mm at index 1, expected 0 mm"), "{e}");
    let e = table(GRID, "psf_x", &[2, 3], &[-2.5, 0.0, 2.5, nan, nan, nan]);
    assert!(e.contains("`psf_x`: band 1, index 0 is NaN, expected at least 1 number"), "{e}");
    let e = table(GRID, "psf_x", &[2, 3], &[-2.5, 0.0, 2.5, 0.5, 0.75, nan]);
    assert!(
        e.contains("`psf_energy` has shape [2, 6], expected [2, 8] (PSFs: columns of psf_x times"),
        "{e}"
    );
    let e = table(GRID, "psf_y", &[2, 4], &[-2.0, -1.0, 0.0, nan, -2.0, -1.0, 0.0, 1.0]);
    assert!(e.contains("`psf_energy` has shape [2, 6], expected [2, 9]"), "{e}");
}

#[test]
fn more_psfs_than_the_bound_are_an_error_before_they_are_read() {
    let azimuths: Vec<f64> = [vec![1.0; 30], vec![2880.0; 30]].concat();
    let e = error_after(POLAR, |path| {
        let heights = f64s_of(60, |i| (i % 30) as f64);
        replace_array(path.join("psf_height"), "float64", &[2, 30], &f64s(&heights));
        replace_array(path.join("azimuth_count"), "float64", &[2, 30], &f64s(&[4.0; 60]));
        replace_array(path.join("psf_azimuths"), "float64", &[2, 30], &f64s(&azimuths));
    });
    let e = e.to_string();
    assert!(e.contains("`psf_azimuths` states 86400 PSFs of band 1, more than 65536"), "{e}");
    let nodes = f64s_of(2 * 300, |i| (i % 300) as f64 * 0.01);
    let e = error_after(GRID, |path| {
        replace_array(path.join("psf_x"), "float64", &[2, 300], &f64s(&nodes));
        replace_array(path.join("psf_y"), "float64", &[2, 300], &f64s(&nodes));
    });
    assert!(e.to_string().contains("states 90000 PSFs of band 0, more than 65536"), "{e}");
    let huge = |array: &'static str, shape: Value| {
        let change = |j: &mut Value| {
            j["chunk_grid"]["configuration"]["chunk_shape"] = shape.clone();
            j["shape"] = shape.clone();
        };
        error_after(GRID, |path| edit_json(path.join(array).join("zarr.json"), change)).to_string()
    };
    let e = huge("map_x", json!([2, 1026]));
    assert!(e.contains("expected [2, 4 to 1025 nodes]"), "{e}");
    let e = huge("psf/0", json!([1u64 << 20, 5, 5]));
    assert!(e.contains("expected [6, n, n] with n odd"), "{e}");
    let e = huge("psf/0", json!([6, 9501, 9501]));
    assert!(e.contains("more than 536870912 samples"), "{e}");
    let e = huge("psf_y", json!([2, 1 << 24]));
    assert!(e.contains("more than 1 to 4194304 numbers"), "{e}");
}

/// 40 bands whose maps have 1025 × 1025 nodes each, of a few bytes.
#[test]
fn maps_of_too_many_numbers_are_an_error_before_they_are_read() {
    let e = error_after(GRID, |path| {
        let (bands, nodes) = (40, 1025);
        let nm = f64s_of(bands, |b| 400.0 + b as f64);
        replace_array(path.join("wavelength"), "float64", &[bands], &f64s(&nm));
        let at = f64s(&f64s_of(bands * nodes, |i| (i % nodes) as f64));
        replace_array(path.join("map_x"), "float64", &[bands, nodes], &at);
        replace_array(path.join("map_y"), "float64", &[bands, nodes], &at);
        edit_json(path.join("map_ideal_x/zarr.json"), |j| {
            j["shape"] = json!([bands, nodes, nodes]);
            j["chunk_grid"]["configuration"]["chunk_shape"] = json!([bands, nodes, nodes]);
        });
    });
    let e = e.to_string();
    assert!(
        e.contains("`map_ideal_x` states 40 x 1025 x 1025 numbers, more than 1 to 3.362e7 numbers"),
        "{e}"
    );
}

#[test]
fn missing_damaged_or_truncated_chunk_is_an_error() {
    for chunk in ["map_ideal_y/c/1/0/0", "psf_azimuths/c/1/0", "psf/1/c/0/0/0"] {
        let e = error_after(POLAR, |p| fs::remove_file(p.join(chunk)).unwrap());
        assert!(matches!(&e, LensPackError::MissingChunk { chunk: found, .. } if found == chunk), "{e}");
        for keep in [0, 3, 20] {
            let e = error_after(POLAR, |p| {
                let bytes = fs::read(p.join(chunk)).unwrap();
                fs::write(p.join(chunk), &bytes[..keep]).unwrap();
            });
            assert!(matches!(e, LensPackError::Chunk { .. } | LensPackError::TooLarge { .. }), "{e}");
        }
    }
}

#[test]
fn window_not_finite_or_not_of_sum_one_is_an_error_with_its_place() {
    let windows = |lens: fn() -> Lens, rows: usize, row: usize, sample: f64| {
        let mut samples = vec![1.0 / 9.0; 9 * rows];
        samples[9 * row] = sample;
        table(lens, "psf/1", &[rows, 3, 3], &samples)
    };
    let e = windows(POLAR, 17, 7, 0.2);
    assert!(
        e.contains("array `psf/1`: the window at height 2 (2.200 mm), azimuth 2 of 12 sums to 1.08888"),
        "{e}"
    );
    let e = windows(GRID, 4, 2, 0.2);
    assert!(
        e.contains("array `psf/1`: the window at row 2, column 0 (0.500, 0.000 mm) sums to 1.08888"),
        "{e}"
    );
    let e = windows(POLAR, 17, 7, f64::NAN);
    assert!(e.contains("array `psf/1`: band 1, index 63 is NaN, expected a finite number"), "{e}");
}

/// Error of writing a lens of `change` of the polar one.
fn write_error(change: impl FnOnce(&mut Lens)) -> String {
    let tmp = tempfile::tempdir().unwrap();
    let path = tmp.path().join("new.lens.zarr");
    let mut lens = polar_lens();
    change(&mut lens);
    let e = write_planar(&path, &lens).expect_err("an invalid lens was written");
    assert_eq!(fs::read_dir(tmp.path()).unwrap().count(), 0, "{e}");
    e.to_string()
}

#[test]
fn bands_of_different_kinds_are_not_written() {
    let e = write_error(|lens| lens.bands[1] = small_lens().bands.remove(1));
    assert!(e.contains("the band 550 nm is with rotational symmetry, the band 450 nm without it"), "{e}");
    let e = write_error(|lens| lens.bands[0] = small_lens().bands.remove(0));
    assert!(e.contains("the band 550 nm is without rotational symmetry, the band 450 nm with it"), "{e}");
    let e = write_error(|lens| lens.bands[1] = grid_lens().bands.remove(1));
    assert!(e.contains("some bands have PSFs at heights and azimuths, others on a grid"), "{e}");
    let e = write_error(|lens| {
        lens.bands[1].planar.as_mut().unwrap().psfs = PsfPlaces::Polar { azimuth_samples: vec![2, 4, 11] };
    });
    assert!(e.contains("550 nm: psf_azimuths is 2 on the axis, expected 1"), "{e}");
    let e = write_error(|lens| lens.bands[1].planar.as_mut().unwrap().map.ideal_x_mm[3] = f64::NAN);
    assert!(e.contains("map_ideal_x is out of bounds at row 0, column 3"), "{e}");
}

#[test]
fn psfs_in_chunks_of_several_or_of_another_count_than_the_places_are_not_finished() {
    let tmp = tempfile::tempdir().unwrap();
    let symmetric = small_lens();
    let mut writer = LensPackWriter::create_planar(tmp.path().join("a.lens.zarr")).unwrap();
    (0..2).for_each(|b| writer.psf(b, &small_psf(&symmetric, b)).unwrap());
    let e = writer.finish(&symmetric, &small_attributes()).unwrap_err().to_string();
    assert!(e.contains("the lens is with rotational symmetry, the pack was begun for one without it"), "{e}");
    let built = polar_lens();
    let mut writer = LensPackWriter::create_planar(tmp.path().join("c.lens.zarr")).unwrap();
    writer.psf(0, &psfs(&built, 0)).unwrap();
    let mut few = psfs(&built, 1);
    few.samples.truncate(16 * 9);
    writer.psf(1, &few).unwrap();
    let e = writer.finish(&built, &attributes()).unwrap_err().to_string();
    assert!(
        e.contains("psf/1 has 16 windows of 3 integrated samples of 0.875 µm, the lens's table 17"),
        "{e}"
    );
}
