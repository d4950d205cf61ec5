//! Arrays in files by other software (`tests/data/make_hdf5.py`), and damaged files.

use std::fs;
use std::path::PathBuf;

use super::*;
use crate::chart::ChartError;
use crate::chart::axes::AxisOrder;
use crate::chart::options::NanPolicy;
use pipeline::flow::ChartSource;
use pipeline::geometry::Size;

mod written;

const SIZE: Size = Size::new(37, 41);
const NM: [f64; 3] = [400.0, 410.0, 420.5];

fn open(path: &Path, array: &str, axes: Option<&AxisOrder>, nan: NanPolicy) -> Result<Hdf5Chart, ChartError> {
    super::open(path, array, axes, nan, None)
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/hdf5").join(name)
}

type ReadBand<'a> = &'a dyn Fn(usize, &mut [f32]) -> Result<(), ChartError>;

/// Opens `FILE//array`, checks bands, size and wavelengths, and returns pixels of `bands`, units and counted pixels without data.
fn read(
    path: &Path,
    array: &str,
    nan: NanPolicy,
    bands: &[usize],
) -> Result<(Vec<f32>, Option<String>, u64), ChartError> {
    let dir = tempfile::tempdir().unwrap();
    let (mut pixels, mut one) = (Vec::new(), vec![0.0; SIZE.pixels()]);
    let mut collect = |read: ReadBand<'_>| -> Result<(), ChartError> {
        for &band in bands {
            read(band, &mut one)?;
            pixels.extend_from_slice(&one);
        }
        Ok(())
    };
    match open(path, array, None, nan)? {
        Hdf5Chart::Raster(chart) => {
            assert_eq!((chart.bands(), chart.size()), (3, SIZE), "{path:?} {array}");
            collect(&|band, out| chart.read_rect(band, SIZE.rect(), out))?;
            Ok((pixels, chart.units().map(str::to_owned), chart.stats().1))
        }
        Hdf5Chart::Decoded(chart) => {
            assert_eq!((chart.bands(), chart.size()), (3, SIZE), "{path:?} {array}");
            chart.copy_bands(bands, dir.path(), 2, &|_, _| ())?;
            assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0, "the temporary file has no name");
            collect(&|band, out| chart.read_rect(band, SIZE.rect(), out))?;
            Ok((pixels, chart.units().map(str::to_owned), chart.stats().1))
        }
    }
}

fn expected(bands: &[usize]) -> Vec<f32> {
    let value =
        |band: usize, k: usize| ((31 * band + 7 * (k / SIZE.width) + 3 * (k % SIZE.width)) % 251) as f32;
    bands.iter().flat_map(|&b| (0..SIZE.pixels()).map(move |k| value(b, k))).collect()
}

fn wavelengths(chart: &Hdf5Chart) -> Option<Vec<f64>> {
    match chart {
        Hdf5Chart::Raster(chart) => chart.wavelengths_nm().map(<[f64]>::to_vec),
        Hdf5Chart::Decoded(chart) => chart.wavelengths_nm().map(<[f64]>::to_vec),
    }
}

#[test]
fn every_storage_type_and_filter_gives_the_expected_samples_and_wavelengths() {
    let radiance = Some("W m-2 sr-1 nm-1");
    for (name, array, units) in [
        ("matlab.mat", "", None),
        ("matlab-contiguous.mat", "rad", None),
        ("filters.h5", "scene/deflate", Some("counts")),
        ("filters.h5", "scene/lzf", None),
        ("filters.h5", "scene/none", Some("counts")),
        ("filters.h5", "scene/half", None),
        ("filters.h5", "scene/big-endian", None),
        ("latest.h5", "fixed", Some("counts")),
        ("latest.h5", "extensible", Some("counts")),
        ("latest.h5", "single", Some("counts")),
        ("netcdf4.nc", "", radiance),
        ("packed.nc", "radiance", radiance),
        ("unlimited.nc", "", radiance),
    ] {
        assert!(is_hdf5(&fixture(name)), "{name}");
        for bands in [&[0, 1, 2][..], &[1]] {
            let (pixels, found, _) = read(&fixture(name), array, NanPolicy::Error, bands).unwrap();
            assert_eq!(pixels, expected(bands), "{name} {array}");
            assert_eq!(found.as_deref(), units, "{name} {array}");
        }
        let nm = wavelengths(&open(&fixture(name), array, None, NanPolicy::Error).unwrap()).unwrap();
        assert!(std::iter::zip(&nm, NM).all(|(a, b)| (a - b).abs() < 1e-9), "{name} {array}: {nm:?}");
    }
    assert!(!is_hdf5(&fixture("netcdf3.nc")) && !is_hdf5(&fixture("matlab-v5.mat")));
}

#[test]
fn chunks_that_are_not_stored_hold_the_fill_value() {
    let (pixels, ..) = read(&fixture("filters.h5"), "scene/sparse", NanPolicy::Error, &[0, 2]).unwrap();
    let all = expected(&[0]);
    for (k, pixel) in pixels.iter().enumerate() {
        let stored = k / SIZE.width < 16 && k % SIZE.width < 16;
        assert_eq!(*pixel, if stored { all[k] } else { 7.0 }, "{k}");
    }
}

#[test]
fn array_that_is_missing_ambiguous_or_not_supported_is_an_error_that_lists_or_names_it() {
    let error = |name: &str, array: &str| {
        open(&fixture(name), array, None, NanPolicy::Error).unwrap_err().to_string()
    };
    for (name, array, words) in [
        (
            "filters.h5",
            "",
            &["several have three axes", "scene/lzf [3, 37, 41] of 64-bit floats", "--var"][..],
        ),
        ("matlab.mat", "cube", &["no array \"cube\"", "rad [3, 41, 37]", "bands"]),
        ("filters.h5", "scene", &["no array \"scene\""]),
        ("filters.h5", "scene/wide", &["samples", "32-bit signed integers in scene/wide", "astype"]),
        ("filters.h5", "scene/complex", &["records"]),
        ("filters.h5", "scene/wavelengths", &["two or three", "[3]"]),
        ("filters.h5", "huge/chunks", &["chunks", "256 MiB", "[1, 16384, 16384]"]),
        ("filters.h5", "huge/count", &["number of chunks", "2^20"]),
        ("latest.h5", "tree", &["HDF5 structure", "h5repack"]),
    ] {
        let error = error(name, array);
        assert!(words.iter().all(|w| error.contains(w)), "{words:?} in {error}");
    }
}

#[test]
fn size_without_data_is_limited_by_the_disk() {
    let chart = open(&fixture("filters.h5"), "huge/space", None, NanPolicy::Error).unwrap();
    let Hdf5Chart::Decoded(chart) = chart else { panic!("the array is chunked") };
    // One chunk, its strip of four columns, its values and their bytes.
    assert!(chart.chunk_memory().rechunking < 640 << 20, "{:?}", chart.chunk_memory());
    let memory = Path::new("/dev/shm");
    let error = chart.copy_bands(&[0, 1, 2], memory, 1, &|_, _| ()).unwrap_err();
    assert!(matches!(error, ChartError::Space { needed: 51_539_607_552, .. }), "{error}");
    assert!(error.retryable() && error.to_string().contains("temporary copy of its bands"), "{error}");
}

#[test]
fn fill_values_of_packed_samples_are_errors_or_counted_zeros() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("packed.nc");
    let mut bytes = fs::read(fixture("packed.nc")).unwrap();
    // Band 0, row 0, columns 0 and 1 hold (0 + 3) / 0.5 = 6 and (3 + 3) / 0.5 = 12; the array is (y, x, wavelength).
    let row: Vec<u8> = [6u16, 68, 130, 12].iter().flat_map(|v| v.to_le_bytes()).collect();
    let at = bytes.windows(8).position(|w| w == row).expect("the first pixels");
    bytes[at..at + 2].fill(0xff);
    fs::write(&path, bytes).unwrap();
    let error = read(&path, "", NanPolicy::Error, &[0]).unwrap_err();
    assert!(matches!(error, ChartError::NoData { band: 0, row: 0, column: 0, .. }), "{error}");
    assert_eq!(read(&path, "", NanPolicy::Error, &[1, 2]).unwrap().2, 0);
    assert_eq!(read(&path, "", NanPolicy::Zero, &[0]).unwrap().2, 1);
}

#[test]
fn truncated_file_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cut.h5");
    for (name, array) in [
        ("matlab.mat", "rad"),
        ("filters.h5", "scene/deflate"),
        ("netcdf4.nc", ""),
        ("packed.nc", ""),
        ("latest.h5", "fixed"),
    ] {
        let complete = fs::read(fixture(name)).unwrap();
        for cut in 0..60 {
            let length = complete.len() * cut / 60;
            fs::write(&path, &complete[..length]).unwrap();
            let Ok((pixels, ..)) = read(&path, array, NanPolicy::Error, &[0, 1, 2]) else { continue };
            // What other arrays hold may be missing.
            assert_eq!(pixels, expected(&[0, 1, 2]), "{name} cut to {length} of {}", complete.len());
        }
        fs::write(&path, &complete[..complete.len() / 4]).unwrap();
        assert!(read(&path, array, NanPolicy::Error, &[0, 1, 2]).is_err(), "{name}");
    }
}

#[test]
fn damaged_bytes_are_errors_or_values_without_a_panic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("damaged.h5");
    let mut state = 1u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let mut failed = 0;
    for (name, array) in
        [("filters.h5", "scene/deflate"), ("netcdf4.nc", ""), ("latest.h5", "fixed"), ("matlab.mat", "rad")]
    {
        let complete = fs::read(fixture(name)).unwrap();
        for _ in 0..150 {
            let mut bytes = complete.clone();
            for _ in 0..=random(8) {
                let at = random(bytes.len());
                bytes[at] = [0, 0xff, 0x80, random(256) as u8][random(4)];
            }
            fs::write(&path, bytes).unwrap();
            let opened = std::panic::catch_unwind(|| {
                let chart = open(&path, array, None, NanPolicy::Zero)?;
                let Hdf5Chart::Decoded(chart) = chart else { return Ok(()) };
                if chart.bands() * chart.size().pixels() > 1 << 20 {
                    return Ok(());
                }
                chart.copy_bands(&[0], dir.path(), 1, &|_, _| ())
            });
            failed += usize::from(opened.expect("no panic").is_err());
        }
    }
    assert!(failed > 100, "{failed} of 600 damaged files were errors");
}

#[test]
fn order_of_a_matlab_array_is_declared_or_implied_by_its_sides() {
    let path = Path::new("cube.mat");
    let order = |sides: &[usize], declared: Option<&str>| {
        let declared = declared.map(|d| d.parse().unwrap());
        super::read::matlab_order(path, "rad", sides, declared.as_ref()).map(|(order, _)| order.to_string())
    };
    assert_eq!(order(&[31, 512, 482], None).unwrap(), "(wavelength, x, y)");
    assert_eq!(order(&[482, 512], None).unwrap(), "(x, y)");
    // MATLAB shows (31, 482, 512).
    let error = order(&[512, 482, 31], None).unwrap_err().to_string();
    assert!(error.contains("[31, 482, 512]") && error.contains("--axes wavelength,y,x"), "{error}");
    assert_eq!(order(&[512, 482, 31], Some("wavelength,y,x")).unwrap(), "(x, y, wavelength)");
    assert!(order(&[512, 482, 31], Some("y,x")).is_err());
}
