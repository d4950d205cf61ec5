//! Flat files: sample types, orders and byte orders; headers; conversion to values; files that change or are truncated.

use std::fs::{self, File};

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
    for sample in samples.into_iter().chain([RasterSample::I16]) {
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
    ] {
        fs::write(&hdr, ENVI.replace(from, to)).unwrap();
        let error = RasterChart::open(&hdr, NanPolicy::Error).unwrap_err().to_string();
        assert!(error.contains(expected), "{to}: {error}");
    }
}

#[test]
fn nan_is_an_error_with_band_row_column_or_a_counted_zero() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("n.npy");
    let values = [1.0f32, f32::NAN, 3.0, f32::INFINITY];
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    fs::write(&path, npy("<f4", "(2, 2)", &bytes)).unwrap();
    let rect = Rect::new(0, 0, 2, 2);
    let error =
        RasterChart::open(&path, NanPolicy::Error).unwrap().read_rect(0, rect, &mut [0.0; 4]).unwrap_err();
    assert!(error.to_string().contains("band 0, row 0, column 1"), "{error}");
    let chart = RasterChart::open(&path, NanPolicy::Zero).unwrap();
    let mut out = [9.0; 4];
    chart.read_rect(0, rect, &mut out).unwrap();
    assert_eq!((out, chart.stats().1), ([1.0, 0.0, 3.0, 0.0], 2));
}

#[test]
fn too_large_values_and_declared_fill_values_are_distinguished() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let rect = Rect::new(0, 0, 2, 2);
    let read = |nan, path: &Path| {
        let chart = RasterChart::open(path, nan).unwrap();
        let mut out = [9.0; 4];
        chart.read_rect(0, rect, &mut out).map(|()| (out, chart.stats().1))
    };
    for (descr, bytes) in [
        ("<f4", [1.0f32, 2.0, -3.4e38, 4.0].map(f32::to_le_bytes).concat()),
        (">f4", [1.0f32, 2.0, 9.97e36, 4.0].map(f32::to_be_bytes).concat()),
        ("<f8", [1.0f64, 2.0, 1e300, 4.0].map(f64::to_le_bytes).concat()),
    ] {
        fs::write(at("n.npy"), npy(descr, "(2, 2)", &bytes)).unwrap();
        for nan in [NanPolicy::Error, NanPolicy::Zero] {
            let e = read(nan, &at("n.npy")).unwrap_err();
            assert!(matches!(e, ChartError::TooLarge { band: 0, row: 1, column: 0, .. }), "{e}");
        }
    }
    let header = "ENVI\nsamples = 2\nlines = 2\nbands = 1\ndata type = 4\ninterleave = bsq\n";
    fs::write(at("c.img"), [1.0f32, 2.0, -3.4e38, 4.0].map(f32::to_le_bytes).concat()).unwrap();
    for key in ["data ignore value = -3.4e38", "data ignore value = -3.4e+38 "] {
        fs::write(at("c.hdr"), format!("{header}{key}\n")).unwrap();
        let e = read(NanPolicy::Error, &at("c.hdr")).unwrap_err();
        assert!(matches!(e, ChartError::NoData { row: 1, column: 0, .. }), "{e}");
        assert_eq!(read(NanPolicy::Zero, &at("c.hdr")).unwrap(), ([1.0, 2.0, 0.0, 4.0], 1));
    }
}

#[test]
fn envi_gains_offsets_and_factor_are_applied_or_rejected() {
    let directory = tempfile::tempdir().unwrap();
    let (data, hdr) = (directory.path().join("c.img"), directory.path().join("c.hdr"));
    let samples = [0u16, 100, 65535, 5000, 0, 100, 7, 5000];
    fs::write(&data, samples.map(u16::to_le_bytes).concat()).unwrap();
    let base = "ENVI\nsamples = 2\nlines = 2\nbands = 2\ndata type = 12\ninterleave = bsq\ndata ignore value = 65535\n";
    let open = |keys: &str| {
        fs::write(&hdr, format!("{base}{keys}\n")).unwrap();
        RasterChart::open(&hdr, NanPolicy::Zero)
    };
    let read = |keys: &str, band| {
        let chart = open(keys).unwrap();
        assert_eq!(chart.notes().len(), usize::from(!keys.is_empty()), "{keys}");
        let mut out = [9.0; 4];
        chart.read_rect(band, Rect::new(0, 0, 2, 2), &mut out).unwrap();
        out
    };
    assert_eq!(read("", 0), [0.0, 100.0, 0.0, 5000.0]);
    assert_eq!(read("reflectance scale factor = 10000", 0), [0.0, 0.01, 0.0, 0.5]);
    let per_band = "data gain values = {0.5, 2}\ndata offset values = {1,\n -1}";
    assert_eq!(
        (read(per_band, 0), read(per_band, 1)),
        ([1.0, 51.0, 0.0, 2501.0], [-1.0, 199.0, 13.0, 9999.0])
    );
    for (keys, expected) in [
        ("reflectance scale factor = many", "reflectance scale factor"),
        ("reflectance scale factor = 0", "reflectance scale factor"),
        ("data gain values = {1}", "data gain values"),
        ("data gain values = {1, 0}", "data gain values"),
        ("data offset values = {1, x}", "data offset values"),
        ("data gain values = {2, 2}\nreflectance scale factor = 10000", "both"),
        ("data ignore value = none", "data ignore value"),
    ] {
        let e = open(keys).unwrap_err().to_string();
        assert!(e.contains(expected) && e.contains("c.hdr"), "{keys}: {e}");
    }
    // A band copy is not scaled again.
    let mut chart = open(per_band).unwrap();
    chart.copy_bands(&[0, 1], directory.path(), &|_, _| ()).unwrap();
    let mut out = [9.0; 4];
    chart.read_rect(1, Rect::new(0, 0, 2, 2), &mut out).unwrap();
    assert_eq!(out, [-1.0, 199.0, 13.0, 9999.0]);
}

#[test]
fn identity_changes_with_everything_that_changes_values() {
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("e.img"), [1; 300]).unwrap();
    let hdr = directory.path().join("e.hdr");
    let identity = |text: &str| {
        fs::write(&hdr, text).unwrap();
        RasterChart::open(&hdr, NanPolicy::Error).unwrap().identity().unwrap().0.to_string()
    };
    // Wavelengths that are within bounds in either unit.
    let envi = ENVI.replace("0.45,\n 0.55, 0.65", "2.45,\n 2.55, 2.65");
    let mut seen = vec![identity(&envi)];
    assert_eq!(identity(&envi.replace("a\n cube", "another")), seen[0], "the description does not change it");
    for (from, to) in [
        ("samples = 5\nlines = 7", "samples = 7\nlines = 5"),
        ("lines = 7", "lines = 6"),
        ("header offset = 4", "header offset = 6"),
        ("data type = 12", "data type = 1"),
        ("data type = 12", "data type = 2"),
        ("interleave = bil", "interleave = bsq"),
        ("interleave = bil", "interleave = bip"),
        ("byte order = 1", "byte order = 0"),
        ("Micrometers", "Nanometers"),
        ("Micrometers", "Index"),
        ("2.45", "2.46"),
        ("bands = 3", "bands = 3\ndata ignore value = 5"),
        ("bands = 3", "bands = 3\ndata ignore value = 6"),
        ("bands = 3", "bands = 3\nreflectance scale factor = 100"),
        ("bands = 3", "bands = 3\ndata gain values = {2, 2, 2}"),
        ("bands = 3", "bands = 3\ndata gain values = {2, 2, 3}"),
        ("bands = 3", "bands = 3\ndata offset values = {2, 2, 2}"),
    ] {
        let text = envi.replace(from, to);
        assert_ne!(text, envi, "{from}");
        seen.push(identity(&text));
    }
    fs::write(&hdr, &envi).unwrap();
    let declared = RasterChart::open(&hdr, NanPolicy::Error).unwrap().with_wavelengths(vec![1.0, 2.0, 3.0]);
    seen.push(declared.unwrap().identity().unwrap().0.to_string());
    let distinct: std::collections::HashSet<_> = seen.iter().collect();
    assert_eq!(distinct.len(), seen.len());
}

#[test]
fn change_of_a_file_after_opening_is_an_error() {
    let directory = tempfile::tempdir().unwrap();
    let (data, hdr) = (directory.path().join("e.img"), directory.path().join("e.hdr"));
    let write = || {
        fs::write(&data, [1; 300]).unwrap();
        fs::write(&hdr, ENVI).unwrap();
    };
    let assert_detected = |change: &dyn Fn(), expected: &str| {
        write();
        let chart = RasterChart::open(&hdr, NanPolicy::Error).unwrap();
        assert_eq!(chart.identity().unwrap(), chart.identity().unwrap());
        change();
        let e = chart.identity().unwrap_err();
        assert!(
            matches!(e, ChartError::Changed { .. }) && e.to_string().contains(expected),
            "{expected}: {e}"
        );
    };
    let time = fs::metadata(directory.path()).unwrap().modified().unwrap();
    assert_detected(&|| fs::write(&data, [2; 300]).unwrap(), "e.img");
    assert_detected(&|| fs::write(&data, [2; 301]).unwrap(), "size changed");
    // Same size, modification time restored.
    let restore_time = || {
        let then = fs::metadata(&data).unwrap().modified().unwrap();
        fs::write(&data, [2; 300]).unwrap();
        File::options().write(true).open(&data).unwrap().set_modified(then).unwrap();
    };
    assert_detected(&restore_time, "written to");
    let replaced = || {
        let other = directory.path().join("other");
        fs::write(&other, [1; 300]).unwrap();
        File::options().write(true).open(&other).unwrap().set_modified(time).unwrap();
        fs::rename(&other, &data).unwrap();
    };
    assert_detected(&replaced, "replaced by another file");
    assert_detected(&|| fs::remove_file(&data).unwrap(), "removed");
    assert_detected(&|| fs::write(&hdr, ENVI.replace("byte order = 1", "byte order = 0")).unwrap(), "e.hdr");
    // The same text is the same header.
    write();
    let chart = RasterChart::open(&hdr, NanPolicy::Error).unwrap();
    fs::write(&hdr, ENVI).unwrap();
    assert!(chart.identity().is_ok());
}

#[test]
fn truncation_of_a_mapped_file_is_an_error_and_no_signal() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("s.raw");
    let sample = RasterSample::Plain(Sample::F32);
    let (shape, interleave) = ([1, 64, 4096], Interleave::Bsq);
    let layout = RasterLayout { shape, interleave, sample, little_endian: true, offset: 0 };
    fs::write(&path, vec![1u8; 64 * 4096 * 4]).unwrap();
    let chart = RasterChart::raw(&path, layout, NanPolicy::Error).unwrap();
    let mut line = vec![0.0; 4096];
    chart.read_rect(0, Rect::new(3, 0, 1, 4096), &mut line).unwrap();
    File::options().write(true).open(&path).unwrap().set_len(4096 * 4 * 2).unwrap();
    let error = chart.read_rect(0, Rect::new(60, 0, 1, 4096), &mut line).unwrap_err();
    assert!(matches!(error, ChartError::Short { expected: 1_048_576, found: 32_768, .. }), "{error}");
    assert_eq!(line, vec![0.0; 4096], "lost pages read as zeros");
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

/// Pages behind the reader are released: a file of 256 MiB takes less than a third of its size.
#[test]
#[cfg(target_os = "linux")]
fn sequential_read_of_a_large_file_keeps_few_rows_in_memory() {
    let resident_bytes = || {
        let status = fs::read_to_string("/proc/self/status").unwrap();
        let line = status.lines().find_map(|l| l.strip_prefix("RssFile:")).unwrap();
        line.split_whitespace().next().unwrap().parse::<u64>().unwrap() << 10
    };
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("large.raw");
    let sample = RasterSample::Plain(Sample::F32);
    let shape = [1, 16384, 4096];
    let layout = RasterLayout { shape, interleave: Interleave::Bsq, sample, little_endian: true, offset: 0 };
    File::create(&path).unwrap().set_len(16384 * 4096 * 4).unwrap();
    let chart = RasterChart::raw(&path, layout, NanPolicy::Error).unwrap();
    let before = resident_bytes();
    let (mut out, mut peak) = (vec![0.0; 64 * 4096], 0);
    for row in (0..16384).step_by(64) {
        chart.read_rect(0, Rect::new(row, 0, 64, 4096), &mut out).unwrap();
        peak = peak.max(resident_bytes().saturating_sub(before));
    }
    assert_eq!(chart.stats().0, 256 << 20);
    // 2048 rows are kept, and up to 512 more before any go: 40 MiB. Other tests run in this process.
    assert!(peak > 16 << 20 && peak < 80 << 20, "{} MiB", peak >> 20);
}
