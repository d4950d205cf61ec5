//! Creation, writing and verification of films.

mod layers;
mod pyramid;
mod replaced;
mod url;
mod writer;

use std::io::{Error, ErrorKind};
use std::path::Path;

use pipeline::geometry::{Rect, Size};
use serde_json::{Map, Value};

use super::*;
use crate::chart::{ChartOptions, ChartStore};
use crate::durable::{DurableError, FileStep, Store, Sweep};
use crate::group::{Finding, GroupError, Output};

fn spec() -> FilmSpec {
    FilmSpec {
        shard: 64,
        chunk: 32,
        units: "W m-2 nm-1".into(),
        axis_px: (70.25, 50.0),
        ..FilmSpec::full_film(Size::new(150, 100), vec![450.0, 550.5], 2.0)
    }
}

fn provenance() -> Map<String, Value> {
    serde_json::from_str(r#"{"program": "lenscube 0.1.0", "chart": {"digest": "ab"}, "f": 0.1}"#).unwrap()
}

fn value(band: usize, y: i64, x: i64) -> f32 {
    band as f32 * 100.0 + y as f32 + x as f32 / 128.0
}

fn fill(film: &FilmStore) {
    for output in 0..film.spec().outputs.len() {
        let (down, across) = film.shards(output);
        for (band, sy, sx) in
            (0..2).flat_map(|b| (0..down).flat_map(move |i| (0..across).map(move |j| (b, i, j))))
        {
            let r = film.shard_rect(output, (sy, sx));
            let pixels: Vec<f32> =
                (r.y..r.bottom()).flat_map(|y| (r.x..r.right()).map(move |x| value(band, y, x))).collect();
            assert!(film.shards_bytes(&[(output, band, (sy, sx))]).unwrap()[0].is_none());
            let shard = film.encode_shard(output, band, (sy, sx), &pixels).unwrap();
            assert_eq!(shard.bytes(), film.encode_shard(output, band, (sy, sx), &pixels).unwrap().bytes());
            film.commit(&shard).unwrap();
            assert!(film.shards_bytes(&[(output, band, (sy, sx))]).unwrap()[0].is_some());
        }
    }
}

fn check(path: &Path, array: &str, rect: Rect, f16: bool) {
    let chart = ChartStore::open(&format!("{}//{array}", path.display()), ChartOptions::default()).unwrap();
    assert_eq!((chart.size(), chart.pitch_um()), (rect.size(), Some(2.0)));
    assert_eq!(chart.wavelengths_nm(), Some(&[450.0, 550.5][..]));
    assert_eq!((chart.units(), chart.film_size()), (Some("W m-2 nm-1"), Some(Size::new(150, 100))));
    let mut out = vec![0.0; rect.size().pixels()];
    for band in 0..2 {
        chart.read_rect(band, rect.size().rect(), &mut out).unwrap();
        for (k, v) in out.iter().enumerate() {
            let e = value(band, rect.y + (k / rect.width) as i64, rect.x + (k % rect.width) as i64);
            let e = if f16 { half::f16::from_f32(e).to_f32() } else { e };
            assert_eq!(*v, e);
        }
    }
}

#[test]
fn pixels_read_equal_pixels_written_for_every_codec_and_sample_type() {
    let dir = tempfile::tempdir().unwrap();
    for (codec, sample) in
        [(Codec::Zstd, SampleType::F32), (Codec::Lz4, SampleType::F16), (Codec::None, SampleType::F32)]
    {
        let path = dir.path().join(format!("{codec:?}.zarr"));
        let film =
            FilmStore::create(&path, FilmSpec { codec, sample, ..spec() }, provenance(), false).unwrap();
        assert_eq!((film.shards(0), film.spec().shard_shape(0)), ((3, 2), (64, 64)));
        fill(&film);
        check(&path, "film", Rect::new(0, 0, 150, 100), sample == SampleType::F16);
        let reopened = FilmStore::open(&path, true).unwrap();
        assert_eq!((reopened.spec(), reopened.provenance()), (film.spec(), &provenance()));
    }
}

#[test]
fn regions_are_separate_arrays() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("roi.zarr");
    let rects = [Rect::new(10, 20, 40, 30), Rect::new(0, 0, 150, 7)];
    let outputs = (0..2).map(|k| Output { name: format!("roi_{k}"), rect: rects[k] }).collect();
    let film = FilmStore::create(&path, FilmSpec { outputs, ..spec() }, provenance(), false).unwrap();
    assert_eq!((film.spec().shard_shape(0), film.spec().shard_shape(1)), ((64, 32), (64, 32)));
    fill(&film);
    check(&path, "roi_0", rects[0], false);
    check(&path, "roi_1", rects[1], false);
    assert_eq!(FilmStore::open(&path, false).unwrap().spec(), film.spec());
}

#[test]
fn existing_film_or_foreign_group_is_not_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("film.zarr");
    FilmStore::create(&path, spec(), provenance(), true).unwrap();
    let e = FilmStore::create(&path, spec(), provenance(), true).unwrap_err();
    assert!(matches!(e, GroupError::Exists { .. }), "{e}");
    let other = dir.path().join("thesis");
    std::fs::create_dir(&other).unwrap();
    std::fs::write(other.join("zarr.json"), r#"{"attributes": {"schema": "mine"}}"#).unwrap();
    assert!(matches!(FilmStore::remove(&other), Err(GroupError::NotOfKind { .. })));
    assert!(other.join("zarr.json").exists());
    FilmStore::remove(&path).unwrap();
    FilmStore::remove(&path).unwrap();
    assert!(matches!(FilmStore::open(&path, true), Err(GroupError::NotOfKind { .. })));
    FilmStore::create(&path, spec(), provenance(), true).unwrap();
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2);
}

#[test]
fn changed_array_metadata_are_an_error_on_opening() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("film.zarr");
    FilmStore::create(&path, spec(), provenance(), false).unwrap();
    let file = path.join("film/zarr.json");
    let json = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, json.replace("100", "101")).unwrap();
    assert!(matches!(FilmStore::open(&path, false), Err(GroupError::ArrayMetadata { .. })));
}

#[test]
fn full_disk_leaves_no_shard_and_is_retryable() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("film.zarr");
    let film = FilmStore::create(&path, spec(), provenance(), false).unwrap().with_directory(|d| {
        d.with_fault(
            |step, _| if step == FileStep::Write { Err(Error::from(ErrorKind::StorageFull)) } else { Ok(()) },
        )
    });
    let shard = film.encode_shard(0, 0, (2, 1), &vec![1.0; 22 * 36]).unwrap();
    let e = film.commit(&shard).unwrap_err();
    assert!(e.is_storage_full() && e.retryable(), "{e}");
    assert!(film.shards_bytes(&[(0, 0, (2, 1))]).unwrap()[0].is_none());
    assert_eq!(std::fs::read_dir(path.join("film/c/0/2")).unwrap().count(), 0);
}

#[test]
fn f16_overflow_is_an_error_with_band_row_column() {
    let dir = tempfile::tempdir().unwrap();
    let spec = FilmSpec { sample: SampleType::F16, ..spec() };
    let film = FilmStore::create(&dir.path().join("f"), spec, provenance(), false).unwrap();
    let mut pixels = vec![65504.0; 64 * 36];
    film.encode_shard(0, 1, (1, 1), &pixels).unwrap();
    pixels[40 * 36 + 35] = 7e4;
    let e = film.encode_shard(0, 1, (1, 1), &pixels).unwrap_err();
    assert!(matches!(e, GroupError::Overflow { band: 1, row: 104, column: 99, .. }), "{e}");
}

#[test]
fn invalid_spec_is_rejected_before_anything_is_written() {
    let cases = [
        FilmSpec { chunk: 48, ..spec() },
        FilmSpec { chunk: 0, ..spec() },
        FilmSpec { wavelengths_nm: vec![], ..spec() },
        FilmSpec { pitch_um: f64::NAN, ..spec() },
        FilmSpec { outputs: vec![], ..spec() },
        FilmSpec { outputs: vec![Output { name: "../x".into(), rect: Rect::new(0, 0, 2, 2) }], ..spec() },
        FilmSpec { outputs: vec![Output { name: "roi_0".into(), rect: Rect::new(149, 0, 2, 2) }], ..spec() },
    ];
    let dir = tempfile::tempdir().unwrap();
    for spec in cases {
        let e = FilmStore::create(&dir.path().join("f"), spec, Map::new(), false).unwrap_err();
        assert!(matches!(e, GroupError::Spec { .. } | GroupError::Bounds(_)), "{e}");
    }
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn verify_finds_and_names_every_defect() {
    let dir = tempfile::tempdir().unwrap();
    for (sample, codec) in [(SampleType::F32, Codec::Zstd), (SampleType::F16, Codec::None)] {
        let path = dir.path().join(format!("{codec:?}"));
        let film =
            FilmStore::create(&path, FilmSpec { codec, sample, ..spec() }, provenance(), false).unwrap();
        let empty = film.verify(2, &|_, _| ()).unwrap();
        assert_eq!((empty.shards, empty.findings.len()), (12, 12));
        fill(&film);
        let intact = film.verify(3, &|_, _| ()).unwrap();
        assert!(intact.findings.is_empty() && intact.temp.is_empty(), "{intact:?}");
        let file = |key: &str| path.join(key);
        let check_shard = |film: &FilmStore| {
            let files = film.shard_files();
            film.group().check_file(files.iter().find(|f| f.key == "film/c/1/0/1").unwrap())
        };
        // A flipped bit in any byte of a shard is found: all bytes are covered by a checksum.
        let good = std::fs::read(file("film/c/1/0/1")).unwrap();
        for k in (0..good.len()).step_by(good.len() / 97) {
            let mut bad = good.clone();
            bad[k] ^= 0x10;
            std::fs::write(file("film/c/1/0/1"), &bad).unwrap();
            let (_, finding) = check_shard(&film).unwrap();
            assert!(
                matches!(&finding, Some(Finding::Bad { key, .. }) if key == "film/c/1/0/1"),
                "{k}: {finding:?}"
            );
        }
        for cut in [&good[..good.len() - 1], &good[1..], &good[..10], &[]] {
            std::fs::write(file("film/c/1/0/1"), cut).unwrap();
            assert!(check_shard(&film).unwrap().1.is_some());
        }
        let mut pixels = vec![0.5; 64 * 36];
        pixels[3 * 36 + 2] = f32::NAN;
        let e = film.encode_shard(0, 1, (1, 1), &pixels).unwrap_err();
        assert!(matches!(e, GroupError::NotFinite { band: 1, row: 67, column: 66, .. }), "{e}");
        // A shard by another program.
        let intact = film.encode_shard(0, 1, (1, 1), &vec![0.5; 64 * 36]).unwrap();
        let bytes = film.encoder.encode_unchecked(&pixels, (64, 36), (2, 2)).unwrap();
        film.commit(&EncodedShard { bytes: bytes.into(), ..intact }).unwrap();
        film.remove_shard(0, 0, (2, 0)).unwrap();
        std::fs::write(file("wavelength/c/0"), [0; 20]).unwrap();
        std::fs::write(file("film/c/0/.tmp-elsewhere-1-2-3-4-5"), "half").unwrap();
        let found = film.verify(2, &|_, _| ()).unwrap();
        let text = format!("{:?}", found.findings);
        assert_eq!(found.findings.len(), 4, "{text}");
        for expected in
            ["Metadata { key: \"wavelength/c/0\"", "Missing { key: \"film/c/0/2/0\"", "row 67, column 66"]
        {
            assert!(text.contains(expected), "{expected}: {text}");
        }
        assert_eq!(found.temp.iter().map(|t| t.1).collect::<Vec<_>>(), [None]);
    }
}

/// Everything in a directory or below a URL, by key.
fn contents(film: &FilmStore) -> std::collections::BTreeMap<String, Vec<u8>> {
    let names = |key: &str| film.group().store.names(key).unwrap();
    let mut found = std::collections::BTreeMap::new();
    let mut todo = vec![String::new()];
    while let Some(key) = todo.pop() {
        for name in names(&key) {
            let key = if key.is_empty() { name } else { format!("{key}/{name}") };
            match film.group().store.read(&key).unwrap() {
                Some(bytes) => drop(found.insert(key, bytes)),
                None => todo.push(key),
            }
        }
    }
    found
}

#[test]
fn remove_bad_keeps_an_intact_shard() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("film.zarr");
    let film = FilmStore::create(&path, spec(), provenance(), false).unwrap();
    fill(&film);
    let (key, intact) = ("film/c/1/0/1", std::fs::read(path.join("film/c/1/0/1")).unwrap());
    let before = contents(&film);
    // Intact by now.
    assert!(!film.remove_bad(key).unwrap());
    assert_eq!(contents(&film), before);
    std::fs::write(path.join(key), &intact[..100]).unwrap();
    assert!(film.remove_bad(key).unwrap() && !path.join(key).exists());
    assert!(!film.remove_bad(key).unwrap());
}
