//! Packs with pupil functions in place of PSFs.

use crate::*;
use lenscube_formats::design::builtin::BuiltinLens;
use lenscube_formats::lens::PUPIL_SCHEMA;
use pipeline::design::trace::{Azimuths, PsfHeights, TraceOptions, TracedBand, trace_lens};
use std::fs;
use std::sync::OnceLock;

/// Two bands of three heights of a lens whose pupil is limited by several surfaces off the axis.
pub(crate) fn traced() -> &'static (Lens, Vec<TracedBand>) {
    static TRACED: OnceLock<(Lens, Vec<TracedBand>)> = OnceLock::new();
    TRACED.get_or_init(|| {
        let system = BuiltinLens::named("macro-70").unwrap().system();
        let options = TraceOptions {
            field_points: 21,
            film_pitch_um: 8.0,
            heights: PsfHeights::Given(vec![0.0, 10.0, 20.0]),
            azimuths: Azimuths::Given(8),
            ..TraceOptions::new(vec![540.0, 560.0], 21.0)
        };
        let mut bands = Vec::new();
        let sink = |_, band| {
            bands.push(band);
            Ok::<_, std::convert::Infallible>(())
        };
        let lens = trace_lens(&system, &options, &mut |_| (), sink).unwrap();
        (lens, bands)
    })
}

pub(crate) fn write_pupils(path: &Path) {
    let (lens, bands) = traced();
    let mut writer = LensPackWriter::create(path).unwrap();
    for (index, band) in bands.iter().enumerate() {
        writer.pupils(index, &band.pupils).unwrap();
    }
    writer.finish(lens, &small_attributes()).unwrap();
}

#[test]
fn pack_of_pupil_functions_gives_the_psfs_of_the_trace() {
    let (lens, bands) = traced();
    let tmp = tempfile::tempdir().unwrap();
    let [psfs, pupils, zip] =
        ["psfs.lens.zarr", "pupils.lens.zarr", "pupils.zip"].map(|n| tmp.path().join(n));
    let stacks = bands.iter().map(|band| Ok::<_, LensPackError>(band.psf.clone()));
    write(&psfs, lens, &small_attributes(), stacks).unwrap();
    write_pupils(&pupils);
    write_pupils(&zip);
    let [psfs, pupils, zip] = [psfs, pupils, zip].map(|path| LensPack::open(path).unwrap());
    assert!(pupils.has_pupils() && zip.has_pupils() && !psfs.has_pupils());
    assert_eq!(pupils.lens(), psfs.lens());
    let segments: Vec<usize> = bands.iter().map(|b| b.pupils.parts().0.len()).collect();
    assert!(segments.iter().all(|n| *n > 3), "off the axis several surfaces limit the pupil: {segments:?}");
    for band in 0..bands.len() {
        let expected = psfs.psf(band).unwrap();
        assert_eq!(pupils.psf(band).unwrap(), expected, "band {band}");
        assert_eq!(pupils.psfs_of_sets(band, 0, 1..2, 2).unwrap(), expected.window(1), "band {band}");
        assert_eq!(zip.psf(band).unwrap(), expected, "band {band}");
        assert_eq!(zip.band_digest(band).unwrap(), pupils.band_digest(band).unwrap());
        assert!(pupils.psf_reading_bytes(band) > 64 * expected.size * expected.size);
    }
    assert_eq!(zip.digest().unwrap(), pupils.digest().unwrap());
    assert_ne!(psfs.digest().unwrap(), pupils.digest().unwrap());
    pupils.check_unchanged().unwrap();
}

#[test]
fn psfs_and_pupil_functions_in_one_pack_are_an_error() {
    let (_, bands) = traced();
    let tmp = tempfile::tempdir().unwrap();
    let mut writer = LensPackWriter::create(tmp.path().join("a.lens.zarr")).unwrap();
    writer.pupils(0, &bands[0].pupils).unwrap();
    assert!(writer.psf(1, &bands[1].psf).is_err());
    assert!(writer.pupils(0, &bands[0].pupils).is_err(), "written twice");
    let mut writer = LensPackWriter::create(tmp.path().join("b.lens.zarr")).unwrap();
    writer.psf(0, &bands[0].psf).unwrap();
    assert!(writer.pupils(1, &bands[1].pupils).is_err());
}

/// Error of reading a pack after `change` of the f64 values of an uncompressed `array` of band 0.
fn error_after(array: &str, change: impl FnOnce(&mut [f64])) -> String {
    let (_, bands) = traced();
    let tmp = tempfile::tempdir().unwrap();
    let path = tmp.path().join("changed.lens.zarr");
    write_pupils(&path);
    let (segments, values) = bands[0].pupils.parts();
    let mut numbers = if array == "pupil" { values } else { segments.into_flattened() };
    change(&mut numbers);
    let folder = path.join(array).join("0");
    let metadata = fs::read_to_string(folder.join("zarr.json")).unwrap();
    let mut json: serde_json::Value = serde_json::from_str(&metadata).unwrap();
    json["codecs"] = serde_json::json!([{"name": "bytes", "configuration": {"endian": "little"}}]);
    fs::write(folder.join("zarr.json"), json.to_string()).unwrap();
    let chunk = if array == "pupil" { "c/0/0/0" } else { "c/0/0" };
    let bytes: Vec<u8> = numbers.iter().flat_map(|v| v.to_le_bytes()).collect();
    fs::write(folder.join(chunk), bytes).unwrap();
    let error =
        LensPack::open(&path).and_then(|pack| pack.psf(0)).expect_err("invalid pupil functions were read");
    assert!(error.to_string().contains("changed.lens.zarr"), "{error}");
    error.to_string()
}

#[test]
fn invalid_pupil_functions_are_errors_that_name_the_segment() {
    type Case = (&'static str, fn(&mut [f64]), &'static str);
    let cases: [Case; 14] = [
        ("pupil_segment", |s| s[0] = 0.5, "whole numbers"),
        (
            "pupil_segment",
            |s| s[0] = 7.0,
            "segment 0 is of height index 7, expected ascending indices below 3",
        ),
        ("pupil_segment", |s| s[0] = 1.0, "segment 0 is not of height index 0, which has none"),
        ("pupil_segment", |s| s[1] = 1e9, "rings"),
        ("pupil_segment", |s| s[2] = 250.0, "points, but its rows have"),
        ("pupil_segment", |s| s[3] = 4.0, "ascending angles"),
        ("pupil_segment", |s| s[4] = f64::NAN, "ascending angles"),
        ("pupil_segment", |s| s[5] = -2.0, "limited by surface -2"),
        ("pupil_segment", |s| s[6] = 3.0, "centre 3"),
        ("pupil_segment", |s| s[7] = 0.0, "sign 0"),
        ("pupil", |v| v[0] = f64::INFINITY, "segment 0 has the value inf"),
        ("pupil", |v| v[0] = 1e12, "oscillates too much"),
        ("pupil", |v| v[1] = 1e300, "oscillates too much"),
        ("pupil", |v| v.fill(0.0), "expected a finite number"),
    ];
    for (array, change, words) in cases {
        let error = error_after(array, change);
        assert!(error.contains(words), "{error}, expected {words}");
    }
}

#[test]
fn pupil_functions_without_a_side_or_of_too_many_samples_are_errors() {
    let tmp = tempfile::tempdir().unwrap();
    let path = tmp.path().join("sides.lens.zarr");
    write_pupils(&path);
    let root = fs::read_to_string(path.join("zarr.json")).unwrap();
    assert!(root.contains(PUPIL_SCHEMA), "{root}");
    let side = path.join("psf_size");
    let mut json: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(side.join("zarr.json")).unwrap()).unwrap();
    json["codecs"] = serde_json::json!([{"name": "bytes", "configuration": {"endian": "little"}}]);
    fs::write(side.join("zarr.json"), json.to_string()).unwrap();
    for (sides, words) in
        [([4.0, 5.0], "odd number"), ([8191.0 * 2.0 + 1.0, 5.0], "odd number"), ([f64::NAN, 5.0], "finite")]
    {
        fs::write(side.join("c/0"), sides.map(f64::to_le_bytes).concat()).unwrap();
        let Err(error) = LensPack::open(&path) else { panic!("{sides:?} were read") };
        assert!(error.to_string().contains(words), "{error}");
    }
    fs::remove_dir_all(&side).unwrap();
    let Err(error) = LensPack::open(&path) else { panic!("no sides") };
    assert!(matches!(&error, LensPackError::MissingArray { array, .. } if array == "psf_size"), "{error}");
}
