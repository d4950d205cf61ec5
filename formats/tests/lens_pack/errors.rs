//! Invalid packs: each error names the pack, the array and the way out.

use crate::*;
use lenscube_formats::lens::{LensPackWriter, builtin};
use serde_json::{Value, json};
use std::fs;

/// Error of reading a small pack that `change` has made invalid.
fn error_after(change: impl FnOnce(&Path)) -> LensPackError {
    let tmp = tempfile::tempdir().unwrap();
    let path = tmp.path().join("small.lens.zarr");
    write_small(&path);
    read_all(&path).unwrap();
    change(&path);
    let error = read_all(&path).expect_err("an invalid pack was read");
    assert!(error.to_string().contains("small.lens.zarr"), "{error}");
    error
}

pub(crate) fn edit_json(path: PathBuf, change: impl FnOnce(&mut Value)) {
    let mut json: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    change(&mut json);
    fs::write(path, json.to_string()).unwrap();
}

/// Replaces an array's chunks by a single uncompressed one.
pub(crate) fn replace_array(array: PathBuf, data_type: &str, shape: &[usize], bytes: &[u8]) {
    edit_json(array.join("zarr.json"), |json| {
        json["shape"] = json!(shape);
        json["data_type"] = json!(data_type);
        json["fill_value"] = json!(0);
        json["chunk_grid"]["configuration"]["chunk_shape"] = json!(shape);
        json["codecs"] = json!([{"name": "bytes", "configuration": {"endian": "little"}}]);
    });
    fs::remove_dir_all(array.join("c")).unwrap();
    let chunk = shape.iter().fold(array.join("c"), |at, _| at.join("0"));
    fs::create_dir_all(chunk.parent().unwrap()).unwrap();
    fs::write(chunk, bytes).unwrap();
}

pub(crate) fn f64s(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

#[test]
fn missing_path_or_other_file_is_an_error() {
    let tmp = tempfile::tempdir().unwrap();
    assert!(matches!(LensPack::open(tmp.path().join("no")), Err(LensPackError::NotFound { .. })));
    assert!(matches!(LensPack::open(tmp.path()), Err(LensPackError::NotAPack { .. })));
    let file = tmp.path().join("file");
    fs::write(&file, "text").unwrap();
    assert!(matches!(LensPack::open(&file), Err(LensPackError::NotAPack { .. })));
    let Err(e) = builtin("planar") else { panic!("there is no such lens") };
    assert!(e.to_string().contains("double-gauss-28"), "{e}");
    fs::write(tmp.path().join(".zgroup"), "{}").unwrap();
    let Err(e) = LensPack::open(tmp.path()) else { panic!("Zarr v2") };
    assert!(e.to_string().contains("v2"), "{e}");
}

#[test]
fn group_without_schema_or_required_attribute_is_an_error() {
    let root = |change: fn(&mut Value)| error_after(|p| edit_json(p.join("zarr.json"), change));
    assert!(matches!(root(|j| j["node_type"] = json!("array")), LensPackError::NotAPack { .. }));
    assert!(matches!(
        root(|j| j["attributes"]["schema"] = json!("lenscube/lens-pack/9")),
        LensPackError::Schema { found, .. } if found == "\"lenscube/lens-pack/9\""
    ));
    assert!(
        matches!(root(|j| j["attributes"] = json!({})), LensPackError::Schema { found, .. } if found == "missing")
    );
    for name in ["distortion_focal_length_mm", "f_number", "psf_sample", "primary_wavelength_nm"] {
        let e = error_after(|p| {
            edit_json(p.join("zarr.json"), |j| {
                j["attributes"].as_object_mut().unwrap().remove(name);
            });
        });
        assert!(matches!(e, LensPackError::Attribute { name: found, .. } if found == name), "{name}");
    }
}

#[test]
fn missing_required_array_is_an_error() {
    for name in [
        "wavelength",
        "ideal_height",
        "image_height",
        "relative_illumination",
        "psf_height",
        "azimuth_count",
        "psf/0",
        "psf/1",
        "psf_pitch",
        "psf_energy",
    ] {
        let e = error_after(|p| fs::remove_dir_all(p.join(name)).unwrap());
        assert!(matches!(&e, LensPackError::MissingArray { array, .. } if array == name), "{e}");
    }
    // Arrays with a default whose values are there.
    for name in ["solid_angle", "transmission"] {
        let e = error_after(|p| fs::remove_file(p.join(name).join("zarr.json")).unwrap());
        assert!(matches!(&e, LensPackError::MissingArray { array, .. } if array == name), "{e}");
    }
}

#[test]
fn unexpected_shape_or_type_is_an_error() {
    let e = error_after(|p| replace_array(p.join("psf_pitch"), "float64", &[3], &f64s(&[1.0; 3])));
    assert!(matches!(&e, LensPackError::Shape { found, .. } if found[..] == [3]), "{e}");
    let e = error_after(|p| replace_array(p.join("image_height"), "float64", &[2, 3], &f64s(&[1.0; 6])));
    assert!(matches!(e, LensPackError::Shape { .. }));
    let e = error_after(|p| replace_array(p.join("psf/0"), "float32", &[2, 4, 4], &[0; 128]));
    assert!(e.to_string().contains("n odd"), "{e}");
    let e = error_after(|p| replace_array(p.join("psf/0"), "int32", &[2, 5, 5], &[0; 200]));
    assert!(matches!(e, LensPackError::DataType { .. }));
    let e =
        error_after(|p| edit_json(p.join("psf_energy/zarr.json"), |j| j["data_type"] = json!("complex64")));
    assert!(matches!(&e, LensPackError::DataType { found, .. } if found.contains("complex64")), "{e}");
}

#[test]
fn invalid_table_value_is_an_error_with_band_and_index() {
    let nan = f64::NAN;
    let e = error_after(|p| replace_array(p.join("psf_pitch"), "float64", &[2], &f64s(&[1.0, nan])));
    assert!(matches!(e, LensPackError::Value { band: 1, .. }));
    let heights = [0.0, 1.1, nan, 0.0, 1.1, f64::INFINITY];
    let e = error_after(|p| replace_array(p.join("psf_height"), "float64", &[2, 3], &f64s(&heights)));
    assert!(matches!(e, LensPackError::Value { band: 1, index: 2, .. }));
    let e = error_after(|p| {
        replace_array(p.join("psf_height"), "float64", &[2, 3], &f64s(&[0.0, nan, 2.0, 0.0, 1.0, 2.0]))
    });
    assert!(matches!(e, LensPackError::Value { band: 0, index: 2, .. }), "numbers after NaN are no padding");
    let e = error_after(|p| {
        replace_array(p.join("psf_height"), "float64", &[2, 3], &f64s(&[0.0, 1.1, nan, 0.0, 2.0, 1.0]))
    });
    assert!(e.to_string().contains("550 nm: psf_height does not ascend"), "{e}");
    let e = error_after(|p| replace_array(p.join("wavelength"), "float64", &[2], &f64s(&[550.0, 450.0])));
    assert!(e.to_string().contains("ascend"), "{e}");
    let e = error_after(|p| {
        replace_array(p.join("azimuth_count"), "float64", &[2, 3], &f64s(&[1.0, 8.5, 0.0, 1.0, 8.0, 8.0]))
    });
    assert!(e.to_string().contains("whole number"), "{e}");
    let e = error_after(|p| {
        replace_array(p.join("azimuth_count"), "float64", &[2, 3], &f64s(&[1.0, 9.0, 0.0, 1.0, 8.0, 8.0]))
    });
    assert!(e.to_string().contains("multiple of 4"), "{e}");
}

#[test]
fn window_not_finite_or_not_of_sum_one_is_an_error() {
    let e = error_after(|p| replace_array(p.join("psf/1"), "float64", &[3, 3, 3], &f64s(&[1.002 / 9.0; 27])));
    let LensPackError::PsfSum { ref array, index: 0, sum, .. } = e else { panic!("{e}") };
    assert_eq!(array, "psf/1");
    assert!((sum - 1.002).abs() < 1e-6);
    let mut samples = [1.0 / 9.0; 27];
    samples[13] = f64::INFINITY;
    let e = error_after(|p| replace_array(p.join("psf/1"), "float64", &[3, 3, 3], &f64s(&samples)));
    assert!(matches!(e, LensPackError::Value { index: 13, .. }), "{e}");
}

#[test]
fn missing_damaged_or_truncated_chunk_is_an_error() {
    for chunk in ["image_height/c/1/0", "wavelength/c/0", "psf/1/c/2/0/0"] {
        let e = error_after(|p| fs::remove_file(p.join(chunk)).unwrap());
        assert!(matches!(&e, LensPackError::MissingChunk { chunk: found, .. } if found == chunk), "{e}");
        let e = error_after(|p| {
            let mut bytes = fs::read(p.join(chunk)).unwrap();
            let middle = bytes.len() - 6;
            bytes[middle] ^= 4;
            fs::write(p.join(chunk), bytes).unwrap();
        });
        assert!(matches!(&e, LensPackError::Chunk { chunk: found, .. } if found == chunk), "{e}");
        for keep in [0, 3, 20] {
            let e = error_after(|p| {
                let bytes = fs::read(p.join(chunk)).unwrap();
                fs::write(p.join(chunk), &bytes[..keep]).unwrap();
            });
            assert!(matches!(e, LensPackError::Chunk { .. } | LensPackError::TooLarge { .. }), "{e}");
        }
    }
}

/// zarr-python omits chunks equal to the fill value.
#[test]
fn missing_psf_chunk_of_zeros_is_read_as_zeros() {
    let tmp = tempfile::tempdir().unwrap();
    let path = tmp.path().join("a.lens.zarr");
    write_small(&path);
    let array = path.join("psf/1");
    let delta: Vec<f64> = (0..27).map(|i| if i % 9 == 4 { 1.0 } else { 0.0 }).collect();
    replace_array(array.clone(), "float64", &[3, 3, 3], &f64s(&delta[..12]));
    edit_json(array.join("zarr.json"), |j| {
        j["chunk_grid"]["configuration"]["chunk_shape"] = json!([3, 2, 2]);
        j["fill_value"] = json!(0.0);
    });
    let chunk = [0.0, 0.0, 0.0, 1.0].repeat(3);
    fs::write(array.join("c/0/0/0"), f64s(&chunk)).unwrap();
    let psf = LensPack::open(&path).unwrap().psf(1).unwrap();
    assert!(psf.samples.iter().map(|&v| f64::from(v)).eq(delta));
    fs::write(array.join("c/0/0/0"), f64s(&[0.0, 0.0, 0.0, 0.999].repeat(3))).unwrap();
    assert!(matches!(read_all(&path), Err(LensPackError::MissingChunk { .. })));
}

#[test]
fn oversized_metadata_is_an_error_before_allocation() {
    let huge = |array: &'static str, shape: Value, chunk: Value| {
        error_after(move |p| {
            edit_json(p.join(array).join("zarr.json"), |j| {
                j["shape"] = shape;
                j["chunk_grid"]["configuration"]["chunk_shape"] = chunk;
            });
        })
    };
    let e = huge("psf/0", json!([1u64 << 40, 1u64 << 40, 5]), json!([1, 5, 5]));
    assert!(matches!(e, LensPackError::TooLarge { .. }), "{e}");
    let e = huge("psf/0", json!([2, 5, 5]), json!([1u64 << 60, 5, 5]));
    assert!(matches!(e, LensPackError::TooLarge { .. }), "{e}");
    let e = huge("wavelength", json!([4000]), json!([1u64 << 26]));
    assert!(matches!(e, LensPackError::Chunk { .. }), "{e}");
    let e = huge("ideal_height", json!([2, 1 << 26]), json!([2, 1 << 26]));
    assert!(matches!(e, LensPackError::TooLarge { .. }), "{e}");
    let e = huge("wavelength", json!([0]), json!([1]));
    assert!(matches!(e, LensPackError::Metadata { .. }), "{e}");
    let e = huge("wavelength", json!([2]), json!([0]));
    assert!(matches!(e, LensPackError::Metadata { .. }), "{e}");
}

#[test]
fn truncated_zip_is_an_error_at_every_length() {
    let tmp = tempfile::tempdir().unwrap();
    let complete = tmp.path().join("complete.zip");
    write_small(&complete);
    let bytes = fs::read(&complete).unwrap();
    let cut = tmp.path().join("cut.zip");
    for keep in (0..bytes.len()).step_by(97) {
        fs::write(&cut, &bytes[..keep]).unwrap();
        let e = read_all(&cut).expect_err("a truncated zip was read");
        assert!(matches!(e, LensPackError::Zip { .. } | LensPackError::NotAPack { .. }), "{keep}: {e}");
    }
}

#[test]
fn unfinished_pack_leaves_no_file_and_an_existing_one_is_not_replaced() {
    let tmp = tempfile::tempdir().unwrap();
    for name in ["a.lens.zarr", "a.lens.zip"] {
        let path = tmp.path().join(name);
        let mut writer = LensPackWriter::create(&path).unwrap();
        writer.psf(0, &small_psf(&small_lens(), 0)).unwrap();
        assert!(!path.exists());
        let e = writer.finish(&small_lens(), &small_attributes()).unwrap_err();
        assert!(e.to_string().contains("2 bands, PSFs were written for [0]"), "{e}");
        assert_eq!(fs::read_dir(tmp.path()).unwrap().count(), 0);
    }
    let path = tmp.path().join("b.zip");
    write_small(&path);
    assert!(matches!(LensPackWriter::create(&path), Err(LensPackError::Exists { .. })));
    let mut stack = small_psf(&small_lens(), 0);
    stack.samples[3] = f32::NAN;
    let mut writer = LensPackWriter::create(tmp.path().join("c.zip")).unwrap();
    assert!(matches!(writer.psf(0, &stack), Err(LensPackError::Write { .. })));
}

#[test]
fn psfs_changed_after_opening_are_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("small.lens.zarr");
    write_small(&path);
    let pack = LensPack::open(&path).unwrap();
    pack.digest().unwrap();
    pack.psf(0).unwrap();
    let other = dir.path().join("other.lens.zarr");
    let mut lens = small_lens();
    lens.name = "other".into();
    let stacks = (0..lens.bands.len()).map(|b| {
        let mut stack = small_psf(&lens, b);
        stack.samples.reverse();
        Ok::<_, LensPackError>(stack)
    });
    write(&other, &lens, &small_attributes(), stacks).unwrap();
    std::fs::remove_dir_all(&path).unwrap();
    std::fs::rename(&other, &path).unwrap();
    let e = pack.psf(0).unwrap_err();
    assert!(matches!(e, LensPackError::Changed { .. }), "{e}");
}
