//! Values of samples (fill values, scale, magnitude), identity of a chart, and decompression bombs.

use serde_json::{Value, json};

use super::*;

use crate::bombs;

/// A bare array (1, 2, 2) in one chunk.
struct Array {
    dir: tempfile::TempDir,
    metadata: Value,
}

impl Array {
    fn new(sample: &str, attributes: Value, bytes: &[u8]) -> Self {
        let metadata = json!({
            "zarr_format": 3, "node_type": "array", "shape": [1, 2, 2], "data_type": sample,
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [1, 2, 2]}},
            "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
            "fill_value": 0, "codecs": [{"name": "bytes", "configuration": {"endian": "little"}}],
            "attributes": attributes
        });
        let array = Self { dir: tempfile::tempdir().unwrap(), metadata };
        std::fs::create_dir_all(array.chunk().parent().unwrap()).unwrap();
        std::fs::write(array.chunk(), bytes).unwrap();
        array.write();
        array
    }

    fn f32(attributes: Value, values: [f32; 4]) -> Self {
        Self::new("float32", attributes, &values.map(f32::to_le_bytes).concat())
    }

    fn write(&self) {
        std::fs::write(self.dir.path().join("zarr.json"), self.metadata.to_string()).unwrap();
    }

    fn chunk(&self) -> PathBuf {
        self.dir.path().join("c/0/0/0")
    }

    fn open(&self, nan: NanPolicy) -> ChartStore {
        let options = ChartOptions { nan, ..ChartOptions::default() };
        ChartStore::open(self.dir.path().to_str().unwrap(), options).unwrap()
    }

    fn pixels(&self, nan: NanPolicy) -> Result<Vec<f32>, ChartError> {
        all(&self.open(nan), 0)
    }
}

#[test]
fn value_above_the_maximum_is_an_error_with_band_row_column() {
    for huge in [9.969_21e36, -3.4e38, 1.1e30, f32::MAX] {
        let array = Array::f32(json!({}), [1.0, 2.0, huge, 4.0]);
        for nan in [NanPolicy::Error, NanPolicy::Zero] {
            let e = array.pixels(nan).unwrap_err();
            assert!(matches!(e, ChartError::TooLarge { band: 0, row: 1, column: 0, .. }), "{e}");
            assert!(e.to_string().contains("_FillValue"), "{e}");
        }
        assert_eq!(array.pixels(NanPolicy::Keep).unwrap()[2], huge, "NanPolicy::Keep checks no values");
    }
    assert_eq!(Array::f32(json!({}), [1e30; 4]).pixels(NanPolicy::Error).unwrap(), [1e30; 4]);
    let array = Array::f32(json!({}), [1e20; 4]);
    let mut limited = array.open(NanPolicy::Error);
    limited.limit_values(1e19);
    assert!(matches!(all(&limited, 0), Err(ChartError::TooLarge { row: 0, column: 0, .. })));
}

#[test]
fn f64_beyond_the_range_of_f32_is_too_large_and_not_infinite() {
    let bytes = [1.0, 1e300, 3.0, f64::INFINITY].map(f64::to_le_bytes).concat();
    let array = Array::new("float64", json!({}), &bytes);
    for nan in [NanPolicy::Error, NanPolicy::Zero] {
        let e = array.pixels(nan).unwrap_err();
        assert!(matches!(e, ChartError::TooLarge { row: 0, column: 1, value: 1e300, .. }), "{e}");
    }
}

#[test]
fn declared_fill_values_are_errors_or_counted_zeros() {
    let fill = 9.969_21e36f32;
    for attributes in [
        json!({"_FillValue": 9.969_21e36}),
        json!({"missing_value": [9.969_21e36, -1.0]}),
        json!({"valid_range": [0, 100]}),
        json!({"valid_max": 1e6}),
    ] {
        let array = Array::f32(attributes.clone(), [1.0, fill, f32::NAN, 4.0]);
        let e = array.pixels(NanPolicy::Error).unwrap_err();
        assert!(matches!(e, ChartError::NoData { row: 0, column: 1, .. }), "{attributes}: {e}");
        let chart = array.open(NanPolicy::Zero);
        assert_eq!(all(&chart, 0).unwrap(), [1.0, 0.0, 0.0, 4.0], "{attributes}");
        assert_eq!(chart.stats().nan_replaced, 2);
    }
}

#[test]
fn scale_and_offset_apply_after_fill_values_are_compared() {
    let bytes = [0u16, 65535, 20000, 10].map(u16::to_le_bytes).concat();
    let attributes = json!({"scale_factor": 0.0001, "add_offset": -0.5, "_FillValue": 65535});
    let array = Array::new("uint16", attributes, &bytes);
    assert!(matches!(
        array.pixels(NanPolicy::Error),
        Err(ChartError::NoData { column: 1, value: 65535.0, .. })
    ));
    let chart = array.open(NanPolicy::Zero);
    assert_eq!(all(&chart, 0).unwrap(), [-0.5, 0.0, 1.5, -0.499]);
    assert_eq!((chart.stats().nan_replaced, chart.scaling()), (1, Some((0.0001, -0.5))));
    std::fs::remove_file(array.chunk()).unwrap();
    assert_eq!(
        array.pixels(NanPolicy::Error).unwrap(),
        [-0.5; 4],
        "a missing chunk's fill value is scaled as well"
    );
}

#[test]
fn invalid_attribute_is_an_error_that_names_it() {
    for (key, value) in [
        ("scale_factor", json!("0.1")),
        ("add_offset", json!([1, 2])),
        ("_FillValue", json!("none")),
        ("valid_range", json!([1])),
        ("_Unsigned", json!("true")),
    ] {
        let e = open_error(Array::f32(json!({key: value}), [0.0; 4]).dir.path()).to_string();
        assert!(e.contains(key) && e.contains("expected"), "{e}");
    }
}

#[test]
fn v2_fill_value_of_xarray_is_no_data() {
    let (_dir, path) = copied("v2-blosc");
    let file = path.join("chart/.zarray");
    let json = std::fs::read_to_string(&file).unwrap();
    let mut zarray: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(zarray["fill_value"], 0);
    assert!(all(&open(&path), 0).is_ok(), "0 is a value");
    zarray["fill_value"] = json!(7);
    std::fs::write(&file, zarray.to_string()).unwrap();
    assert!(matches!(all(&open(&path), 0), Err(ChartError::NoData { value: 7.0, .. })));
}

#[test]
fn identity_changes_with_everything_that_changes_values() {
    let identity = |array: &Array, wavelengths_nm: Option<Vec<f64>>| {
        let options = ChartOptions { wavelengths_nm, ..ChartOptions::default() };
        let chart = ChartStore::open(array.dir.path().to_str().unwrap(), options).unwrap();
        chart.identity().unwrap().content
    };
    let plain = || Array::f32(json!({}), [1.0; 4]);
    let mut seen = vec![identity(&plain(), None)];
    assert_eq!(seen[0], identity(&plain(), None), "the location does not change it");
    assert_eq!(
        seen[0],
        identity(&Array::f32(json!({"title": "a chart"}), [1.0; 4]), None),
        "nor does a title"
    );
    for attributes in [
        json!({"_FillValue": -1}),
        json!({"_FillValue": -2}),
        json!({"missing_value": [-1, -2]}),
        json!({"valid_min": 0.5}),
        json!({"valid_max": 0.5}),
        json!({"valid_range": [0.5, 2]}),
        json!({"scale_factor": 2}),
        json!({"add_offset": 2}),
        json!({"scale_factor": 2, "add_offset": 2}),
        json!({"pitch_um": 2}),
        json!({"film_size": [2, 2]}),
        json!({"units": "W"}),
        json!({"wavelengths_nm": [500]}),
    ] {
        seen.push(identity(&Array::f32(attributes, [1.0; 4]), None));
    }
    seen.push(identity(&plain(), Some(vec![550.0])));
    let edits: [(&str, Value); 5] = [
        ("/fill_value", json!(1)),
        ("/data_type", json!("uint8")),
        ("/shape", json!([1, 2, 1])),
        ("/codecs/0/configuration/endian", json!("big")),
        ("/chunk_grid/configuration/chunk_shape", json!([1, 2, 4])),
    ];
    for (key, value) in edits {
        let mut array = plain();
        *array.metadata.pointer_mut(key).unwrap() = value;
        array.write();
        seen.push(identity(&array, None));
    }
    let sides = Array::f32(json!({}), [1.0; 4]);
    std::fs::write(sides.chunk(), [0; 15]).unwrap();
    seen.push(identity(&sides, None));
    let distinct: std::collections::HashSet<_> = seen.iter().collect();
    assert_eq!(distinct.len(), seen.len());
}

#[test]
fn arrays_of_one_store_have_different_identities() {
    let (_dir, path) = copied("v3-sharded");
    copy(&path.join("chart"), &path.join("other"));
    let identity = |name: &str| {
        let spec = format!("{}//{name}", path.display());
        ChartStore::open(&spec, ChartOptions::default()).unwrap().identity().unwrap().content
    };
    assert_ne!(identity("chart"), identity("other"));
    assert_eq!(identity("chart"), open(&path).identity().unwrap().content, "opened by name or by its group");
}

#[test]
fn foreign_files_do_not_change_the_identity() {
    for (name, array, foreign) in [
        ("v3-sharded", "chart", ["c/0/0/.nfs000012", "c/0/0/9", "c/9/0/0", "c/0/0/00"]),
        ("v2-blosc", "chart", ["0.0.9", "0.0.00", "0.0", "c.0.0.0"]),
        ("v2-big-endian-fortran", "", ["0/0/0", "0.0.0~", "9.0.0", "0.0.0.0"]),
        ("v3-two-dimensional", "", ["c/0/#0#", "c/.#0", "c/0.0", "0/0"]),
    ] {
        let (_dir, path) = copied(name);
        let before = open(&path).identity().unwrap();
        let always = [".DS_Store", ".zattrs~", "zarr.json.bak", "notes/readme.txt"];
        for file in always.iter().chain(&foreign) {
            let file = path.join(array).join(file);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(&file, b"x").unwrap();
            assert_eq!(open(&path).identity().unwrap(), before, "{name}: {}", file.display());
        }
        // A dangling link, as editors create for a lock.
        std::os::unix::fs::symlink("nobody@nowhere", path.join(array).join(".#zarr.json")).unwrap();
        assert_eq!(open(&path).identity().unwrap(), before, "{name}");
    }
}

#[test]
fn missing_chunk_changes_the_identity_in_every_key_encoding() {
    for (name, chunk) in [
        ("v3-sharded", "chart/c/2/1/0"),
        ("v2-blosc", "chart/0.0.0"),
        ("v2-big-endian-fortran", "0.0.0"),
        ("v3-two-dimensional", "c/1/2"),
    ] {
        let (_dir, path) = copied(name);
        let before = open(&path).identity().unwrap();
        std::fs::remove_file(path.join(chunk)).unwrap();
        assert_ne!(open(&path).identity().unwrap().content, before.content, "{name}");
    }
}

/// The bombs decode to up to 32 GiB.
#[test]
fn chunk_that_decodes_to_more_than_its_size_is_corrupt() {
    let level = json!({"level": 1, "checksum": false});
    let bombs = [
        ("zstd", level.clone(), bombs::zstd_without_content_size(1 << 18)),
        ("zstd", level, bombs::zstd_with_stated_size(1 << 45)),
        ("gzip", json!({"level": 1}), bombs::gzip_zeros(4 << 20)),
        ("numcodecs.zlib", json!({"level": 1}), bombs::zlib_zeros(4 << 20)),
        (
            "blosc",
            json!({"cname": "lz4", "clevel": 1, "shuffle": "noshuffle", "typesize": 4, "blocksize": 0}),
            bombs::blosc_with_stated_size(i32::MAX as u32, 1),
        ),
    ];
    for (codec, configuration, bomb) in bombs {
        // The limit on the file size of such a chunk is above the size of the bomb.
        let mut array = Array::f32(json!({}), [1.0; 4]);
        array.metadata["shape"] = json!([1, 512, 512]);
        array.metadata["chunk_grid"]["configuration"]["chunk_shape"] = json!([1, 512, 512]);
        let compressor = json!({"name": codec, "configuration": configuration});
        array.metadata["codecs"].as_array_mut().unwrap().push(compressor);
        array.write();
        std::fs::write(array.chunk(), bomb).unwrap();
        let e = array.pixels(NanPolicy::Error).unwrap_err();
        assert!(matches!(e, ChartError::Corrupt { .. }), "{codec}: {e}");
        assert!(e.to_string().contains("expected 1048576"), "{codec}: {e}");
    }
}

#[test]
fn coordinate_that_decodes_to_more_than_its_size_is_an_error() {
    let (_dir, path) = copied("v3-sharded");
    let file = path.join("wavelength/zarr.json");
    let mut metadata: Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    let zstd = json!({"name": "zstd", "configuration": {"level": 1, "checksum": false}});
    metadata["codecs"] = json!([{"name": "bytes", "configuration": {"endian": "little"}}, zstd]);
    std::fs::write(&file, metadata.to_string()).unwrap();
    std::fs::write(path.join("wavelength/c/0"), bombs::zstd_without_content_size(1 << 14)).unwrap();
    let e = open_error(&path).to_string();
    assert!(e.contains("wavelength") && e.contains("expected"), "{e}");
}

#[test]
fn packed_wavelengths_are_unpacked() {
    let (_dir, path) = copied("v3-sharded");
    let file = path.join("wavelength/zarr.json");
    let stored: Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    let write = |attributes: Value| {
        let mut metadata = stored.clone();
        for (key, value) in attributes.as_object().unwrap() {
            metadata["attributes"][key] = value.clone();
        }
        std::fs::write(&file, metadata.to_string()).unwrap();
    };
    write(json!({"scale_factor": 0.1, "add_offset": 400}));
    assert_eq!(open(&path).wavelengths_nm(), Some(&[440.0, 441.0, 442.05][..]));
    write(json!({"scale_factor": 0.1, "_FillValue": 410}));
    let e = open_error(&path).to_string();
    assert!(e.contains("wavelength") && e.contains("fill value") && e.contains("410"), "{e}");
}
