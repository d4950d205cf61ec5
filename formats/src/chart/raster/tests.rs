//! Flat files: sample types, orders and byte orders; headers.

use std::fs::{self, File};

mod changes;
mod values;

use super::*;
use crate::sample::{RasterSample, Sample};

const SHAPE: [usize; 3] = [3, 7, 5];

fn value(b: usize, y: usize, x: usize) -> f32 {
    (b * 50 + y * 6 + x) as f32
}

fn encoded(layout: &RasterLayout) -> Vec<u8> {
    let [bands, rows, columns] = layout.shape;
    let mut out = vec![0xEE; layout.offset as usize];
    let mut put = |b, y, x| {
        let v = value(b, y, x);
        let bytes = match layout.sample {
            RasterSample::I16 => (v as i16).to_le_bytes().to_vec(),
            RasterSample::I32 => (v as i32).to_le_bytes().to_vec(),
            RasterSample::U32 => (v as u32).to_le_bytes().to_vec(),
            RasterSample::Plain(Sample::U8) => vec![v as u8],
            RasterSample::Plain(Sample::U16) => (v as u16).to_le_bytes().to_vec(),
            RasterSample::Plain(Sample::F16) => half::f16::from_f32(v).to_le_bytes().to_vec(),
            RasterSample::Plain(Sample::F32) => v.to_le_bytes().to_vec(),
            RasterSample::Plain(Sample::F64) => f64::from(v).to_le_bytes().to_vec(),
        };
        match layout.little_endian {
            true => out.extend(bytes),
            false => out.extend(bytes.iter().rev()),
        }
    };
    match layout.interleave {
        Interleave::Bsq => {
            (0..bands).for_each(|b| (0..rows).for_each(|y| (0..columns).for_each(|x| put(b, y, x))));
        }
        Interleave::Bil => {
            (0..rows).for_each(|y| (0..bands).for_each(|b| (0..columns).for_each(|x| put(b, y, x))));
        }
        Interleave::Bip => {
            (0..rows).for_each(|y| (0..columns).for_each(|x| (0..bands).for_each(|b| put(b, y, x))));
        }
        Interleave::BandColumnRow => {
            (0..bands).for_each(|b| (0..columns).for_each(|x| (0..rows).for_each(|y| put(b, y, x))));
        }
        Interleave::ColumnBandRow => {
            (0..columns).for_each(|x| (0..bands).for_each(|b| (0..rows).for_each(|y| put(b, y, x))));
        }
        Interleave::ColumnRowBand => {
            (0..columns).for_each(|x| (0..rows).for_each(|y| (0..bands).for_each(|b| put(b, y, x))));
        }
    }
    out
}

fn assert_pixels(chart: &RasterChart, what: &str) {
    let rect = Rect::new(2, 1, 4, 3);
    for b in 0..SHAPE[0] {
        let mut out = vec![0.0; 12];
        chart.read_rect(b, rect, &mut out).unwrap();
        let expected: Vec<f32> = (0..12).map(|i| value(b, 2 + i / 3, 1 + i % 3)).collect();
        assert_eq!(out, expected, "{what}, band {b}");
    }
}

#[test]
fn every_sample_type_order_and_byte_order_gives_the_same_pixels() {
    let directory = tempfile::tempdir().unwrap();
    let samples = [Sample::U8, Sample::U16, Sample::F16, Sample::F32, Sample::F64].map(RasterSample::Plain);
    for sample in samples.into_iter().chain([RasterSample::I16, RasterSample::I32, RasterSample::U32]) {
        use Interleave::{BandColumnRow, Bil, Bip, Bsq, ColumnBandRow, ColumnRowBand};
        for interleave in [Bsq, Bil, Bip, BandColumnRow, ColumnBandRow, ColumnRowBand] {
            for little_endian in [true, false] {
                let layout = RasterLayout { shape: SHAPE, interleave, sample, little_endian, offset: 13 };
                let path = directory.path().join("cube.raw");
                fs::write(&path, encoded(&layout)).unwrap();
                let mut chart = RasterChart::raw(&path, layout.clone(), NanPolicy::Error).unwrap();
                assert_pixels(&chart, &format!("{layout:?}"));
                chart.copy_bands(&[0, 1, 2], directory.path(), &|_, _| ()).unwrap();
                assert_pixels(&chart, &format!("{layout:?}, band copy"));
                assert_eq!(
                    fs::read_dir(directory.path()).unwrap().count(),
                    1,
                    "the temporary file has no name"
                );
            }
        }
    }
}

fn npy(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

const ENVI: &str = "ENVI\ndescription = {a\n cube}\nsamples = 5\nlines = 7\nbands = 3\nheader offset = 4\ndata type = 12\n\
                    interleave = bil\nbyte order = 1\nwavelength units = Micrometers\nwavelength = {0.45,\n 0.55, 0.65}\n";

#[test]
fn npy_and_envi_headers_are_parsed() {
    let directory = tempfile::tempdir().unwrap();
    let plain = RasterSample::Plain(Sample::F32);
    let layout = RasterLayout {
        shape: SHAPE,
        interleave: Interleave::Bsq,
        sample: plain,
        little_endian: true,
        offset: 0,
    };
    let path = directory.path().join("cube.npy");
    fs::write(&path, npy("<f4", "(3, 7, 5)", &encoded(&layout))).unwrap();
    assert!(RasterChart::is_supported_path(&path));
    assert_pixels(&RasterChart::open(&path, NanPolicy::Error).unwrap(), "npy");

    let sample = RasterSample::Plain(Sample::U16);
    let layout =
        RasterLayout { shape: SHAPE, interleave: Interleave::Bil, sample, little_endian: false, offset: 4 };
    let (data, header) = (directory.path().join("cube.img"), directory.path().join("cube.hdr"));
    fs::write(&data, encoded(&layout)).unwrap();
    fs::write(&header, ENVI).unwrap();
    for path in [&data, &header] {
        assert!(RasterChart::is_supported_path(path));
        let chart = RasterChart::open(path, NanPolicy::Error).unwrap();
        assert_eq!(chart.wavelengths_nm(), Some(&[450.0, 550.0, 650.0][..]));
        assert!(chart.needs_band_copy(), "lines of 10 bytes share their pages");
        assert_pixels(&chart, "ENVI");
    }
}

#[test]
fn numpy_files_with_declared_axes_have_the_same_pixels() {
    let fixture = |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/pictures").join(name);
    let axes = "y,x,wavelength".parse().unwrap();
    let dir = tempfile::tempdir().unwrap();
    for name in ["fortran-y-x-wavelength.npy", "y-x-wavelength.npy"] {
        let path = fixture(name);
        let error = RasterChart::open(&path, NanPolicy::Error).unwrap_err().to_string();
        assert!(error.contains("--axes y,x,wavelength"), "{error}");
        let open = || RasterChart::open_with_axes(&path, Some(&axes), NanPolicy::Error).unwrap();
        let mut chart = open();
        assert_eq!((chart.bands(), ChartSource::size(&chart)), (3, Size::new(37, 41)), "{name}");
        assert!(chart.needs_band_copy());
        let read = |chart: &RasterChart| {
            let mut out = vec![0.0; 37 * 41];
            chart.read_rect(2, Size::new(37, 41).rect(), &mut out).unwrap();
            out
        };
        let expected: Vec<f32> =
            (0..37 * 41).map(|k| ((62 + 7 * (k / 41) + 3 * (k % 41)) % 251) as f32).collect();
        assert_eq!(read(&chart), expected, "{name}");
        chart.copy_bands(&[0, 2], dir.path(), &|_, _| ()).unwrap();
        assert_eq!(read(&chart), expected, "{name}, band copy");
        let wrong = RasterChart::open_with_axes(&path, Some(&"y,x".parse().unwrap()), NanPolicy::Error);
        assert!(wrong.unwrap_err().to_string().contains("2 axes"));
    }
}

#[test]
fn scale_multiplies_values_and_is_part_of_the_identity() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("s.npy");
    fs::write(&path, npy("<u2", "(1, 2)", &[16, 39, 1, 0])).unwrap();
    let open = |scale| RasterChart::open(&path, NanPolicy::Error).unwrap().with_scale(scale);
    let mut out = [0.0; 2];
    open(1e-4).read_rect(0, Rect::new(0, 0, 1, 2), &mut out).unwrap();
    assert_eq!(out, [1.0, 1e-4]);
    assert_ne!(open(1e-4).identity().unwrap(), open(1.0).identity().unwrap());
    assert_eq!(
        open(1.0).identity().unwrap(),
        RasterChart::open(&path, NanPolicy::Error).unwrap().identity().unwrap()
    );
}

#[test]
fn malformed_header_is_an_error_that_names_the_property() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bad.npy");
    let open_error = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        RasterChart::open(&path, NanPolicy::Error).unwrap_err().to_string()
    };
    for (bytes, expected) in [
        (b"".to_vec(), "first bytes"),
        (b"PNG".to_vec(), "first bytes"),
        (b"\x93NUMPY\x09\x00aaaa".to_vec(), "NPY version"),
        (b"\x93NUMPY\x02\x00\xff\xff\xff\xff".to_vec(), "NPY header"),
        (npy("<i8", "(1, 2)", &[0; 16]), "samples"),
        (npy("<f4", "(0, 2)", &[]), "side of the chart"),
        (npy("<f4", "(1000000000, 1000000000, 1000000000)", &[0; 16]), "chart"),
        (npy("<f4", "(4,)", &[0; 16]), "shape"),
        (npy("<f4", "(40, 40, 3)", &[0; 19200]), "--axes"),
        (npy("<f4", "(99999999999999999999, 4)", &[0; 16]), "shape"),
        (npy("<f4", "(2, 4)", &[0; 31]), "expected"),
    ] {
        let error = open_error(&bytes);
        assert!(error.contains(expected) && error.contains("bad.npy"), "{error}");
    }
    fs::write(directory.path().join("e.img"), [0; 99]).unwrap();
    let hdr = directory.path().join("e.hdr");
    for (from, to, expected) in [
        ("ENVI", "INVE", "first line"),
        ("samples = 5\n", "", "samples"),
        ("lines = 7", "lines = -7", "lines"),
        ("lines = 7", "lines = 0", "side of the chart"),
        ("data type = 12", "data type = 6", "data type"),
        ("interleave = bil", "interleave = bog", "interleave"),
        ("byte order = 1", "byte order = 2", "byte order"),
        ("0.55, 0.65", "0.55", "wavelength"),
        ("0.55, 0.65", "x, 0.65", "wavelength"),
        ("bands = 3", "bands = 18446744073709551615", "wavelength"),
        ("header offset = 4", "header offset = 18446744073709551615", "shape"),
        ("header offset = 4", "header offset = 4", "expected 214 bytes"),
        ("byte order = 1", "byte order = 1\nmajor frame offsets = {8, 0}", "major frame offsets"),
        ("byte order = 1", "byte order = 1\nminor frame offsets = {0, 2}", "minor frame offsets"),
        ("byte order = 1", "byte order = 1\nfile compression = 1", "file compression"),
        (
            "byte order = 1",
            "byte order = 1\nmajor frame offsets = {0, 0}\nfile compression = 0",
            "expected 214",
        ),
    ] {
        fs::write(&hdr, ENVI.replace(from, to)).unwrap();
        let error = RasterChart::open(&hdr, NanPolicy::Error).unwrap_err().to_string();
        assert!(error.contains(expected), "{to}: {error}");
    }
}

#[test]
fn every_sample_type_of_envi_and_numpy_is_recognized() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let plain = RasterSample::Plain;
    let types = [
        (Some(1), Some("u1"), plain(Sample::U8)),
        (Some(2), None, RasterSample::I16),
        (Some(4), Some("f4"), plain(Sample::F32)),
        (Some(5), Some("f8"), plain(Sample::F64)),
        (Some(12), Some("u2"), plain(Sample::U16)),
        (None, Some("f2"), plain(Sample::F16)),
    ];
    for (envi, numpy, sample) in types {
        for little_endian in [true, false] {
            let mut layout =
                RasterLayout { shape: SHAPE, interleave: Interleave::Bsq, sample, little_endian, offset: 9 };
            if let Some(code) = envi {
                fs::write(at("t.img"), encoded(&layout)).unwrap();
                for (unit, list) in [("Nanometers", "{450, 550, 650}"), ("Micrometers", "{0.45, 0.55, 0.65}")]
                {
                    let header = format!(
                        "ENVI\nsamples = 5\nlines = 7\nbands = 3\nheader offset = 9\ndata type = {code}\ninterleave = bsq\n\
                         byte order = {}\nwavelength units = {unit}\nwavelength = {list}\n",
                        u8::from(!little_endian)
                    );
                    fs::write(at("t.hdr"), header).unwrap();
                    let chart = RasterChart::open(&at("t.hdr"), NanPolicy::Error).unwrap();
                    assert_eq!(&chart.layout, &layout);
                    assert_eq!(chart.wavelengths_nm(), Some(&[450.0, 550.0, 650.0][..]));
                    assert_pixels(&chart, &format!("ENVI {code}, {little_endian}"));
                }
            }
            if let Some(name) = numpy {
                layout.offset = 0;
                let order = if little_endian { "<" } else { ">" };
                fs::write(at("t.npy"), npy(&format!("{order}{name}"), "(3, 7, 5)", &encoded(&layout)))
                    .unwrap();
                let chart = RasterChart::open(&at("t.npy"), NanPolicy::Error).unwrap();
                assert_eq!((chart.layout.sample, chart.layout.little_endian), (sample, little_endian));
                assert_pixels(&chart, &format!("{order}{name}"));
            }
        }
    }
}
