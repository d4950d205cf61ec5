//! Conversion of samples to values; NaN, fill values, gains and offsets.

use super::*;

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
fn attributes_beside_a_npy_file_apply_as_those_of_a_stored_array() {
    let directory = tempfile::tempdir().unwrap();
    let (path, beside) = (directory.path().join("n.npy"), directory.path().join("n.npy.attributes.json"));
    let bytes = [0u16, 1, 10000, 65535].map(u16::to_le_bytes).concat();
    fs::write(&path, npy("<u2", "(2, 2)", &bytes)).unwrap();
    let plain = RasterChart::open(&path, NanPolicy::Zero).unwrap();
    let before = plain.identity().unwrap();
    fs::write(&beside, r#"{"units": "1", "note": {"a": "NaN"}}"#).unwrap();
    assert_eq!(RasterChart::open(&path, NanPolicy::Zero).unwrap().identity().unwrap(), before);
    let packed = r#"{"scale_factor": 1e-4, "add_offset": 0.5, "_FillValue": 65535, "valid_min": 1}"#;
    fs::write(&beside, packed).unwrap();
    let chart = RasterChart::open(&path, NanPolicy::Zero).unwrap();
    let mut out = [9.0; 4];
    chart.read_rect(0, Rect::new(0, 0, 2, 2), &mut out).unwrap();
    assert_eq!((out, chart.stats().1), ([0.0, 0.5001, 1.5, 0.0], 2));
    assert!(chart.notes()[0].contains("0.0001") && chart.identity().unwrap().0 != before.0);
    fs::write(&beside, packed.replace("0.5", "0.25")).unwrap();
    assert!(matches!(chart.identity(), Err(ChartError::Changed { .. })));
    for (wrong, words) in
        [("[1]", "a JSON object"), (r#"{"_FillValue": "none"}"#, "_FillValue: expected a number")]
    {
        fs::write(&beside, wrong).unwrap();
        let e = RasterChart::open(&path, NanPolicy::Zero).unwrap_err().to_string();
        assert!(e.contains(words) && e.contains("n.npy.attributes.json"), "{e}");
    }
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
