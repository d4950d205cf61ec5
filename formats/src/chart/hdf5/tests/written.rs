//! Coordinates, dimensions and attributes of files that the tests write.

use super::*;
use hdf5_pure::{AttrValue, FileBuilder};
use std::fs;

/// A file with a cube of 3 bands of 2 x 2 px and what `build` adds.
fn written(build: impl FnOnce(&mut FileBuilder)) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cube.h5");
    let mut file = FileBuilder::new();
    build(&mut file);
    file.write(&path).unwrap();
    (dir, path)
}

fn cube(file: &mut FileBuilder, labels: &[&str; 3]) {
    let labels = labels.iter().map(|l| (*l).to_owned()).collect();
    file.create_dataset("cube")
        .with_f32_data(&[1.0; 12])
        .with_shape(&[3, 2, 2])
        .set_attr("DIMENSION_LABELS", AttrValue::StringArray(labels));
}

fn list(file: &mut FileBuilder, name: &str, nm: [f64; 3]) {
    file.create_dataset(name)
        .with_f64_data(&nm)
        .with_shape(&[3])
        .set_attr("units", AttrValue::String("nm".into()));
}

fn nm_of(path: &Path) -> Result<Option<Vec<f64>>, String> {
    open(path, "cube", None, NanPolicy::Error).map(|chart| wavelengths(&chart)).map_err(|e| e.to_string())
}

#[test]
fn packed_wavelengths_are_unpacked() {
    let packed = |fill: i16| {
        written(|file| {
            cube(file, &["wavelength", "y", "x"]);
            file.create_dataset("wavelength")
                .with_i16_data(&[501, 1505, 2500])
                .with_shape(&[3])
                .set_attr("units", AttrValue::String("nm".into()))
                .set_attr("scale_factor", AttrValue::F64(0.1))
                .set_attr("add_offset", AttrValue::F64(400.0))
                .set_attr("_FillValue", AttrValue::I16(fill));
        })
    };
    let (_dir, path) = packed(-1);
    assert_eq!(nm_of(&path).unwrap(), Some(vec![450.1, 550.5, 650.0]));
    let (_dir, path) = packed(1505);
    let error = nm_of(&path).unwrap_err();
    assert!(error.contains("fill value") && error.contains("1505 in wavelength"), "{error}");
}

#[test]
fn coordinate_of_the_spectral_dimension_comes_before_other_arrays_of_wavelengths() {
    let (own, other) = ([450.0, 550.0, 650.0], [452.3, 552.9, 653.1]);
    for dimension in ["wavelength", "centre_wavelength"] {
        let (_dir, path) = written(|file| {
            cube(file, &[dimension, "y", "x"]);
            list(file, dimension, own);
            list(file, "calibrated_wavelength", other);
            list(file, "delta_wavelength", [10.0; 3]);
        });
        assert_eq!(nm_of(&path).unwrap(), Some(own.to_vec()), "{dimension}");
    }
    let (_dir, path) = written(|file| {
        cube(file, &["band", "y", "x"]);
        list(file, "calibrated_wavelength", other);
        list(file, "nominal_wavelength", own);
    });
    let error = nm_of(&path).unwrap_err();
    assert!(error.contains("calibrated_wavelength and nominal_wavelength"), "{error}");
}

#[test]
fn coordinate_of_another_unit_is_not_read_where_the_caller_gives_wavelengths() {
    let (_dir, path) = written(|file| {
        cube(file, &["wavelength", "y", "x"]);
        file.create_dataset("wavelength")
            .with_f64_data(&[4500.0, 5500.0, 6500.0])
            .with_shape(&[3])
            .set_attr("units", AttrValue::String("Angstrom".into()));
    });
    assert!(nm_of(&path).unwrap_err().contains("Angstrom"));
    let chart = super::super::open(&path, "cube", None, NanPolicy::Error, Some(3)).unwrap();
    assert_eq!(wavelengths(&chart), None);
}

fn scale(file: &mut FileBuilder, name: &str, length: usize) {
    file.create_dataset(name)
        .with_f64_data(&vec![0.0; length])
        .with_shape(&[length as u64])
        .set_attr("CLASS", AttrValue::AsciiString("DIMENSION_SCALE".into()));
}

#[test]
fn dimensions_are_those_of_the_groups_above_and_without_names_an_error() {
    let cube = |sides: [u64; 3], inner: bool| {
        written(|file| {
            for (name, length) in [("wavelength", 3), ("x", 4), ("y", sides[2])] {
                scale(file, name, length as usize);
            }
            let data = vec![0.0f32; sides.iter().product::<u64>() as usize];
            let mut group = file.create_group("obs");
            let references = AttrValue::I32Array(vec![0; 3]);
            match inner {
                true => group.create_dataset("cube"),
                false => file.create_dataset("cube"),
            }
            .with_f32_data(&data)
            .with_shape(&sides)
            .set_attr("DIMENSION_LIST", references);
            file.add_group(group.finish());
        })
    };
    for (inner, name) in [(true, "obs/cube"), (false, "cube")] {
        // (wavelength, x, y)
        let (_dir, path) = cube([3, 4, 5], inner);
        let Hdf5Chart::Raster(chart) = open(&path, name, None, NanPolicy::Error).unwrap() else {
            panic!("the array is contiguous")
        };
        assert_eq!((chart.bands(), chart.size()), (3, Size::new(5, 4)), "{name}");
        let (_dir, path) = cube([3, 4, 4], inner);
        let error = open(&path, name, None, NanPolicy::Error).unwrap_err().to_string();
        assert!(error.contains("DIMENSION_LIST") && error.contains("--axes"), "{error}");
        let axes = "wavelength,x,y".parse().unwrap();
        open(&path, name, Some(&axes), NanPolicy::Error).unwrap();
    }
}

/// A file with cubes of these names and shapes and three wavelengths.
fn cubes(cubes: &[(&str, [u64; 3])]) -> (tempfile::TempDir, PathBuf) {
    written(|file| {
        for (name, shape) in cubes {
            let values = vec![1.0; shape.iter().product::<u64>() as usize];
            file.create_dataset(name).with_f32_data(&values).with_shape(shape);
        }
        list(file, "wavelength", [450.0, 550.0, 650.0]);
    })
}

#[test]
fn array_that_fits_the_wavelengths_is_chosen() {
    let (_dir, path) = cubes(&[("rad", [3, 4, 5]), ("rgb", [2, 4, 5])]);
    let Hdf5Chart::Raster(chart) = open(&path, "", None, NanPolicy::Error).unwrap() else {
        panic!("the array is contiguous")
    };
    assert_eq!((chart.bands(), chart.size()), (3, Size::new(4, 5)));
    let said = chart
        .notes()
        .iter()
        .any(|n| n.contains("array rad is read: of 2") && n.contains("the 3 wavelengths"));
    assert!(said, "{:?}", chart.notes());
    let given = super::super::open(&path, "", None, NanPolicy::Error, Some(2)).unwrap();
    let Hdf5Chart::Raster(chart) = given else { panic!("the array is contiguous") };
    assert_eq!(chart.bands(), 2);
    let (_dir, path) = cubes(&[("a", [3, 4, 5]), ("b", [3, 4, 5]), ("c", [2, 4, 5])]);
    let error = open(&path, "", None, NanPolicy::Error).unwrap_err().to_string();
    assert!(error.contains("several have three axes") && error.contains("--var"), "{error}");
}

#[test]
fn axes_that_the_sides_do_not_tell_are_asked_for() {
    for shape in [[4, 5, 3], [5, 3, 4], [3, 3, 4], [3, 4, 3]] {
        let (_dir, path) = cubes(&[("cube", shape)]);
        let error = open(&path, "cube", None, NanPolicy::Error).unwrap_err().to_string();
        let shown = format!("{shape:?}");
        assert!(
            [&shown, "3 wavelengths", "--axes y,x,wavelength"].iter().all(|w| error.contains(*w)),
            "{error}"
        );
        let axes = "y,x,wavelength".parse().unwrap();
        open(&path, "cube", Some(&axes), NanPolicy::Error).unwrap();
    }
    let (_dir, path) = cubes(&[("cube", [3, 4, 5])]);
    open(&path, "cube", None, NanPolicy::Error).unwrap();
}

#[test]
fn only_array_of_three_axes_may_have_one_band() {
    let (_dir, path) = written(|file| {
        file.create_dataset("cube").with_f32_data(&[1.0; 8]).with_shape(&[1, 2, 4]);
        list(file, "wavelength", [450.0, 550.0, 650.0]);
    });
    let Hdf5Chart::Raster(chart) = open(&path, "", None, NanPolicy::Error).unwrap() else {
        panic!("the array is contiguous")
    };
    assert_eq!((chart.bands(), chart.size()), (1, Size::new(2, 4)));
}

#[test]
fn attribute_of_the_conversion_of_another_type_is_an_error() {
    let (_dir, path) = written(|file| {
        file.create_dataset("cube")
            .with_f32_data(&[1.0; 12])
            .with_shape(&[3, 2, 2])
            .set_attr("scale_factor", AttrValue::F32(0.5));
    });
    open(&path, "", None, NanPolicy::Error).unwrap();
    let mut bytes = fs::read(&path).unwrap();
    let find = |bytes: &[u8], text: &[u8]| bytes.windows(text.len()).rposition(|w| w == text).unwrap();
    // Class 1 (float) of four bytes becomes class 4 (bit field).
    let at = find(&bytes, b"scale_factor");
    let float = at + find(&bytes[at..at + 32], &[4, 0, 0, 0]) - 4;
    assert_eq!(bytes[float] & 0x0f, 1);
    bytes[float] += 3;
    // Version 2 of object headers: OHDR, version, flags, size of the messages, messages, checksum.
    let header = bytes[..at].windows(4).rposition(|w| w == b"OHDR").unwrap();
    let (flags, mut messages) = (bytes[header + 5], header + 6);
    messages += if flags & 0x20 != 0 { 16 } else { 0 };
    messages += if flags & 0x10 != 0 { 4 } else { 0 };
    let width = 1 << (flags & 3);
    let size = (0..width).fold(0, |n, k| n | usize::from(bytes[messages + k]) << (8 * k));
    let end = messages + width + size;
    let sum = lookup3(&bytes[header..end]);
    bytes[end..end + 4].copy_from_slice(&sum.to_le_bytes());
    fs::write(&path, bytes).unwrap();
    let error = open(&path, "", None, NanPolicy::Error).unwrap_err().to_string();
    assert!(error.contains("scale_factor") && error.contains("another type in cube"), "{error}");
}

/// Checksum of HDF5's metadata: Bob Jenkins' lookup3 (hashlittle) with 0 as its start.
fn lookup3(key: &[u8]) -> u32 {
    let start = 0xdead_beef_u32.wrapping_add(key.len() as u32);
    let [mut a, mut b, mut c] = [start; 3];
    let blocks = key.len().saturating_sub(1) / 12;
    for (k, block) in key.chunks(12).enumerate() {
        let mut padded = [0; 12];
        padded[..block.len()].copy_from_slice(block);
        let word = |i: usize| u32::from_le_bytes(padded[4 * i..4 * i + 4].try_into().unwrap());
        a = a.wrapping_add(word(0));
        b = b.wrapping_add(word(1));
        c = c.wrapping_add(word(2));
        if k < blocks {
            for (turn, bits) in [4, 6, 8, 16, 19, 4].into_iter().enumerate() {
                let (x, y, z) = match turn % 3 {
                    0 => (&mut a, &mut c, b),
                    1 => (&mut b, &mut a, c),
                    _ => (&mut c, &mut b, a),
                };
                *x = x.wrapping_sub(*y) ^ y.rotate_left(bits);
                *y = y.wrapping_add(z);
            }
        } else {
            for (turn, bits) in [14, 11, 25, 16, 4, 14, 24].into_iter().enumerate() {
                let (x, y) = match turn % 3 {
                    0 => (&mut c, b),
                    1 => (&mut a, c),
                    _ => (&mut b, a),
                };
                *x = (*x ^ y).wrapping_sub(y.rotate_left(bits));
            }
        }
    }
    c
}
