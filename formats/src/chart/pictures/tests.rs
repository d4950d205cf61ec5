//! Sets of pictures and TIFF of several bands: fixtures by other software (`tests/data/make_pictures.py`), and damaged files.

use std::fs;
use std::path::{Path, PathBuf};

use super::*;
use ::tiff::encoder::{Compression, TiffEncoder, colortype};
use pipeline::flow::ChartSource;

mod gdal;

const SIZE: Size = Size::new(37, 41);

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/pictures").join(name)
}

fn tiff(name: &str) -> DecodedChart {
    open_tiff(&fixture(name), NanPolicy::Error).unwrap()
}

fn set(path: &Path) -> Result<DecodedChart, ChartError> {
    open_set(path.to_str().unwrap(), NanPolicy::Error)
}

fn assert_pixels(chart: &DecodedChart, bands: &[usize], what: &str) {
    let dir = tempfile::tempdir().unwrap();
    assert_eq!(ChartSource::size(chart), SIZE, "{what}");
    chart.copy_bands(bands, dir.path(), 2, &|_, _| ()).unwrap();
    for &band in bands {
        let mut out = vec![0.0; SIZE.pixels()];
        chart.read_rect(band, SIZE.rect(), &mut out).unwrap();
        let value = |k: usize| ((31 * band + 7 * (k / SIZE.width) + 3 * (k % SIZE.width)) % 251) as f32;
        let expected: Vec<f32> = (0..out.len()).map(value).collect();
        assert_eq!(out, expected, "{what}, band {band}");
    }
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0, "the temporary file has no name");
}

#[test]
fn tiff_of_every_layout_has_the_expected_bands_and_wavelengths() {
    let all: &[f64] = &[400.0, 410.0, 420.5];
    for (name, nm, units) in [
        ("tiff/planar-deflate-f32.tif", Some(all), None),
        ("tiff/chunky-tiled-big-endian-bigtiff.tif", Some(all), Some("counts")),
        ("tiff/chunky-lzw-u8.tif", Some(all), Some("counts")),
        ("tiff/planar-one-strip-u16.tif", Some(all), Some("counts")),
        ("tiff/pages-f64.tif", None, None),
        ("gdal/descriptions.tif", Some(all), Some("counts")),
        ("gdal/scaled.tif", Some(all), None),
        ("gdal/tiled-big-endian-predictor-chunky-f32.tif", Some(all), None),
        ("gdal/tiled-big-endian-predictor-planar-u16.tif", Some(all), Some("counts")),
        ("gdal/tiled-big-endian-predictor-chunky-u8.tif", Some(all), Some("counts")),
        ("gdal/bigtiff-overviews.tif", Some(&all[..1]), None),
    ] {
        let chart = tiff(name);
        let bands = nm.map_or(3, <[f64]>::len);
        assert_eq!((chart.bands(), chart.wavelengths_nm(), chart.units()), (bands, nm, units), "{name}");
        assert_pixels(&chart, &(0..bands).collect::<Vec<_>>(), name);
        if bands == 3 {
            assert_pixels(&tiff(name), &[2], name);
        }
    }
    assert!(tiff("gdal/scaled.tif").notes()[0].contains("scale and offset"));
}

#[test]
fn pictures_of_a_folder_or_pattern_are_bands_in_the_order_of_their_numbers() {
    let chart = set(&fixture("png16")).unwrap();
    assert_eq!(chart.wavelengths_nm(), Some(&[400.0, 410.0, 420.5][..]));
    assert_eq!((chart.sample().name(), chart.units()), ("16-bit unsigned integers", Some("counts")));
    assert!(
        chart.notes()[0].contains("scene_400nm.png (400 nm), scene_410nm.png (410 nm)"),
        "{:?}",
        chart.notes()
    );
    assert!(chart.notes()[1].starts_with("1 other files"), "{:?}", chart.notes());
    assert_pixels(&chart, &[0, 1, 2], "folder");
    assert_pixels(&set(&fixture("png16/*.png")).unwrap(), &[1], "pattern");
    let chart = set(&fixture("numbered-tif")).unwrap();
    assert_eq!(chart.wavelengths_nm(), None);
    assert!(chart.notes()[0].contains("band_2.tif, band_10.tif, band_100.tif"), "{:?}", chart.notes());
    assert_pixels(&chart, &[0, 1, 2], "numbers");
    let chart = chart.with_wavelengths(vec![500.0, 510.0, 520.0]).unwrap();
    assert!(set(&fixture("numbered-tif")).unwrap().with_wavelengths(vec![500.0]).is_err());
    assert_ne!(chart.identity().unwrap(), set(&fixture("numbered-tif")).unwrap().identity().unwrap());
}

#[test]
fn scale_multiplies_values_and_is_part_of_the_identity() {
    let dir = tempfile::tempdir().unwrap();
    let mut out = vec![0.0; SIZE.pixels()];
    for (name, scale) in [("tiff/chunky-lzw-u8.tif", 1e-4), ("gdal/scaled.tif", 0.5)] {
        let chart = tiff(name).with_scale(scale);
        assert_ne!(chart.identity().unwrap().0, tiff(name).identity().unwrap().0);
        assert_eq!(chart.units(), None);
        chart.copy_bands(&[1], dir.path(), 1, &|_, _| ()).unwrap();
        chart.read_rect(1, SIZE.rect(), &mut out).unwrap();
        assert!((f64::from(out[0]) - 31.0 * scale).abs() < 1e-6 * scale, "{name}: {}", out[0]);
    }
    assert_eq!(
        tiff("gdal/scaled.tif").with_scale(1.0).identity().unwrap(),
        tiff("gdal/scaled.tif").identity().unwrap()
    );
}

fn write_grey(path: &Path, width: u32, height: u32) {
    let file = fs::File::create(path).unwrap();
    let mut encoder = ::png::Encoder::new(file, width, height);
    encoder.set_color(::png::ColorType::Grayscale);
    encoder.set_depth(::png::BitDepth::Eight);
    let data: Vec<u8> = (0..width * height).map(|v| v as u8).collect();
    encoder.write_header().unwrap().write_image_data(&data).unwrap();
}

#[test]
fn picture_that_differs_from_the_first_is_an_error_that_names_it() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    for (odd, expected) in [
        ("size", "7x8 px"),
        ("depth", "16-bit"),
        ("format", "TIFF of"),
        ("colour", "channels"),
        ("bands", "one in each picture"),
        ("empty", "first bytes"),
    ] {
        for file in fs::read_dir(dir.path()).unwrap() {
            fs::remove_file(file.unwrap().path()).unwrap();
        }
        write_grey(&at("b1.png"), 41, 37);
        write_grey(&at("b2.png"), 41, 37);
        match odd {
            "size" => write_grey(&at("b10.png"), 7, 8),
            "depth" => drop(fs::copy(fixture("png16/scene_400nm.png"), at("b10.png")).unwrap()),
            "format" => drop(fs::copy(fixture("numbered-tif/band_2.tif"), at("b10.tif")).unwrap()),
            "colour" => drop(fs::copy(fixture("colour/rgb.png"), at("b10.png")).unwrap()),
            "bands" => drop(fs::copy(fixture("tiff/chunky-lzw-u8.tif"), at("b10.tif")).unwrap()),
            _ => fs::write(at("b10.png"), b"").unwrap(),
        }
        let error = set(dir.path()).unwrap_err().to_string();
        assert!(error.contains("b10.") && error.contains(expected), "{odd}: {error}");
    }
    let error = set(&at("*.jpg")).unwrap_err().to_string();
    assert!(error.contains("*.jpg") && error.contains("no file"), "{error}");
    assert!(set(&at("[")).is_err());
}

#[test]
fn changed_file_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    write_grey(&at("400.png"), 41, 37);
    write_grey(&at("500.png"), 41, 37);
    let chart = set(dir.path()).unwrap();
    write_grey(&at("500.png"), 41, 36);
    let temporary = tempfile::tempdir().unwrap();
    let error = chart.copy_bands(&[0], temporary.path(), 1, &|_, _| ()).unwrap_err();
    assert!(matches!(error, ChartError::Changed { .. }), "{error}");
    assert!(chart.identity().is_err());
}

fn decode(path: &Path, directory: &Path) -> Result<(), ChartError> {
    let chart = open_tiff(path, NanPolicy::Error)?;
    let all: Vec<usize> = (0..chart.bands()).collect();
    chart.copy_bands(&all, directory, 1, &|_, _| ())
}

#[test]
fn truncated_file_is_an_error_and_leaves_no_temporary_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cut.tif");
    for name in [
        "tiff/planar-deflate-f32.tif",
        "tiff/chunky-tiled-big-endian-bigtiff.tif",
        "tiff/chunky-lzw-u8.tif",
        "tiff/planar-one-strip-u16.tif",
        "tiff/pages-f64.tif",
        "gdal/descriptions.tif",
        "gdal/scaled.tif",
    ] {
        let complete = fs::read(fixture(name)).unwrap();
        for cut in 0..50 {
            // The last bytes may be padding.
            let length = (complete.len() - 8) * cut / 50;
            fs::write(&path, &complete[..length]).unwrap();
            assert!(decode(&path, dir.path()).is_err(), "{name} cut to {length} of {}", complete.len());
            assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
        }
    }
    let png = fs::read(fixture("png16/scene_400nm.png")).unwrap();
    fs::remove_file(&path).unwrap();
    for cut in 0..50 {
        fs::write(dir.path().join("400.png"), &png[..(png.len() - 20) * cut / 50]).unwrap();
        let chart = set(dir.path());
        assert!(chart.and_then(|c| c.copy_bands(&[0], dir.path(), 1, &|_, _| ())).is_err(), "cut {cut}");
    }
}

/// Replaces the value of a tag of one LONG or SHORT in the first directory of a little-endian file.
fn with_tag(bytes: &[u8], tag: u16, value: u32) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let first = u32::from_le_bytes(bytes[4..8].try_into().unwrap()) as usize;
    let entries = usize::from(u16::from_le_bytes([bytes[first], bytes[first + 1]]));
    let mut entry = (0..entries).map(|k| first + 2 + 12 * k);
    let at = entry.find(|&at| u16::from_le_bytes([bytes[at], bytes[at + 1]]) == tag).expect("the tag exists");
    bytes[at + 2..at + 4].copy_from_slice(&4u16.to_le_bytes());
    bytes[at + 8..at + 12].copy_from_slice(&value.to_le_bytes());
    bytes
}

#[test]
fn false_sizes_and_unsupported_properties_are_errors_before_memory_is_allocated() {
    let mut valid = std::io::Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut valid).unwrap().with_compression(Compression::Lzw);
    let mut image = encoder.new_image::<colortype::Gray16>(41, 37).unwrap();
    image.rows_per_strip(37).unwrap();
    image.write_data(&vec![7; 41 * 37]).unwrap();
    let valid = valid.into_inner();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("bomb.tif");
    let (width, height, bits, compression, photometric, rows, counts) = (256, 257, 258, 259, 262, 278, 279);
    for (tag, value, expected) in [
        (width, u32::MAX, "bomb.tif"),
        (width, 0, "bomb.tif"),
        (width, 900_000, "bomb.tif"),
        (height, u32::MAX, "bomb.tif"),
        (height, 36_000_000, "bomb.tif"),
        (bits, 12, "samples"),
        (bits, 32, "samples"),
        (compression, 7, "compression"),
        (compression, 34_712, "compression"),
        (photometric, 0, "photometric"),
        (photometric, 2, "colour"),
        (rows, 0, "bomb.tif"),
        (rows, 5, "bomb.tif"),
        (counts, u32::MAX, "expected"),
        (277, 1000, "bomb.tif"),
    ] {
        fs::write(&path, with_tag(&valid, tag, value)).unwrap();
        let error = decode(&path, dir.path()).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("bomb.tif"), "{tag} {value}: {error}");
    }
    fs::write(&path, &valid).unwrap();
    decode(&path, dir.path()).unwrap();
}

#[test]
fn no_data_samples_of_gdal_are_errors_or_counted_zeros() {
    // The sample 248·4 + 8 occurs in every band.
    let mut bytes = fs::read(fixture("gdal/scaled.tif")).unwrap();
    // The file has a directory that is not used any more: both no-data values.
    while let Some(at) = bytes.windows(5).position(|w| w == b"65535") {
        bytes[at..at + 5].copy_from_slice(b"  008");
    }
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("scaled.tif");
    fs::write(&path, bytes).unwrap();
    let error = decode(&path, dir.path()).unwrap_err().to_string();
    assert!(error.contains("band 0, row 0, column 0") && error.contains("declared fill value"), "{error}");
    let chart = open_tiff(&path, NanPolicy::Zero).unwrap();
    chart.copy_bands(&[0, 1, 2], dir.path(), 1, &|_, _| ()).unwrap();
    // As tifffile counts them.
    assert_eq!(chart.stats().1, 19);
}

#[test]
fn invalid_samples_of_bands_that_are_not_read_neither_fail_nor_count() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("chunky.tif");
    let file = fs::File::create(&path).unwrap();
    let mut encoder = TiffEncoder::new(file).unwrap().with_compression(Compression::Lzw);
    let mut image = encoder.new_image::<colortype::RGB32Float>(2, 3).unwrap();
    let photometric = ::tiff::tags::Tag::PhotometricInterpretation;
    image.encoder().write_tag(photometric, 1u16).unwrap();
    // Bands 0 and 1 are valid; band 2 has NaN and infinity.
    let pixels: Vec<f32> = (0..6)
        .flat_map(|k| [k as f32, 10.0 + k as f32, if k % 2 == 0 { f32::NAN } else { f32::INFINITY }])
        .collect();
    image.write_data(&pixels).unwrap();
    for nan in [NanPolicy::Error, NanPolicy::Zero] {
        let chart = open_tiff(&path, nan).unwrap();
        chart.copy_bands(&[0, 1], dir.path(), 1, &|_, _| ()).unwrap();
        let mut out = [0.0; 6];
        chart.read_rect(1, Size::new(3, 2).rect(), &mut out).unwrap();
        assert_eq!((out, chart.stats().1), ([10.0, 11.0, 12.0, 13.0, 14.0, 15.0], 0), "{nan:?}");
    }
    let all = |nan| {
        open_tiff(&path, nan)
            .and_then(|c| c.copy_bands(&[0, 2], dir.path(), 1, &|_, _| ()).map(|()| c.stats().1))
    };
    assert!(matches!(all(NanPolicy::Error), Err(ChartError::NotFinite { band: 2, .. })));
    assert_eq!(all(NanPolicy::Zero).unwrap(), 6);
}
