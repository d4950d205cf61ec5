//! Pyramids compared with the definition; interrupted, stale and damaged pyramids.

use std::collections::BTreeMap;
use std::io::Error;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use pipeline::geometry::{Rect, Size};
use serde_json::{Map, json};

use crate::chart::{ChartOptions, ChartStore, NanPolicy};
use crate::durable::FileStep;
use crate::film::{Codec, FilmSpec, FilmStore, SampleType};
use crate::group::{Finding, GroupError, Output, read_json};
use crate::pyramid::{PyramidState, halve, level_sizes};

static NEVER: AtomicBool = AtomicBool::new(false);

fn film(path: &Path, size: Size, change: impl FnOnce(&mut FilmSpec)) -> FilmStore {
    let mut spec = FilmSpec { shard: 128, chunk: 64, ..FilmSpec::full_film(size, vec![450.0, 550.5], 2.0) };
    change(&mut spec);
    let film = FilmStore::create(path, spec, Map::new(), false).unwrap();
    for (output, band, shard) in film.all_shards().collect::<Vec<_>>() {
        commit(&film, output, band, shard, 1.0);
    }
    film
}

fn commit(film: &FilmStore, output: usize, band: usize, shard: (usize, usize), factor: f32) {
    let r = film.shard_rect(output, shard);
    let value =
        |y: i64, x: i64| factor * (((y * 31 + x * 17) % 97) as f32 + 100.0 * band as f32 + (y / 60) as f32);
    let pixels: Vec<f32> =
        (r.y..r.bottom()).flat_map(|y| (r.x..r.right()).map(move |x| value(y, x))).collect();
    film.commit(&film.encode_shard(output, band, shard, &pixels).unwrap()).unwrap();
}

fn make(film: &FilmStore) -> Result<bool, GroupError> {
    film.pyramid().make(2, 1 << 30, &NEVER, &|_, _| ())
}

fn files(root: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    let mut todo = vec![root.to_path_buf()];
    while let Some(directory) = todo.pop() {
        for entry in std::fs::read_dir(directory).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => todo.push(path),
                false => {
                    drop(all.insert(path.strip_prefix(root).unwrap().into(), std::fs::read(&path).unwrap()))
                }
            }
        }
    }
    all
}

fn level(film: &FilmStore, output: usize, number: usize, band: usize) -> (Size, Vec<f32>) {
    let spec = format!("{}//{}", film.path().display(), film.pyramid().level_path(output, number));
    let options = ChartOptions {
        nan: NanPolicy::Keep,
        wavelengths_nm: Some(film.spec().wavelengths_nm.clone()),
        ..ChartOptions::default()
    };
    let array = ChartStore::open(&spec, options).unwrap();
    let mut pixels = vec![0.0; array.size().pixels()];
    array.read_rect(band, array.size().rect(), &mut pixels).unwrap();
    (array.size(), pixels)
}

#[test]
fn every_level_is_the_mean_of_the_previous_one() {
    let dir = tempfile::tempdir().unwrap();
    let shapes = [(Size::new(1101, 515), SampleType::F32), (Size::new(300, 3), SampleType::F16)];
    for (k, (size, sample)) in shapes.into_iter().enumerate() {
        let film = film(&dir.path().join(k.to_string()), size, |s| s.sample = sample);
        let before = files(film.path());
        assert!(make(&film).unwrap());
        assert_eq!(film.pyramid().state().unwrap(), PyramidState::Complete);
        for (path, bytes) in before.iter().filter(|(p, _)| p.as_os_str() != "zarr.json") {
            assert_eq!(Some(bytes), files(film.path()).get(path), "{path:?} was touched");
        }
        let sizes = level_sizes(size);
        assert!(sizes.len() > 1 && sizes[sizes.len() - 1].height <= 256, "{sizes:?}");
        for (number, &expected_size) in sizes.iter().enumerate().skip(1) {
            for band in 0..2 {
                let (below_size, below) = level(&film, 0, number - 1, band);
                let (found_size, found) = level(&film, 0, number, band);
                assert_eq!(found_size, expected_size);
                assert_eq!(expected_size.height, below_size.height.div_ceil(2));
                let mut expected = vec![0.0; expected_size.pixels()];
                halve(&below, below_size, &mut expected);
                assert_eq!(found.len(), expected.len());
                for (f, w) in found.iter().zip(expected) {
                    let w = if sample == SampleType::F16 { half::f16::from_f32(w).to_f32() } else { w };
                    assert_eq!(*f, w, "level {number}");
                }
            }
        }
    }
}

#[test]
fn pyramid_of_a_single_pixel_has_one_level() {
    let dir = tempfile::tempdir().unwrap();
    let film = film(&dir.path().join("one.zarr"), Size::new(1, 1), |_| ());
    assert_eq!((film.pyramid().shards(), film.pyramid().state().unwrap()), (0, PyramidState::None));
    assert!(make(&film).unwrap());
    assert_eq!(film.pyramid().state().unwrap(), PyramidState::Complete);
    let group = read_json(&film.group().store, "zarr.json").unwrap().unwrap();
    let datasets = &group["attributes"]["ome"]["multiscales"][0]["datasets"];
    assert_eq!((datasets[0]["path"].as_str(), datasets.as_array().unwrap().len()), (Some("film"), 1));
    let again = files(film.path());
    assert!(make(&film).unwrap());
    assert_eq!(files(film.path()), again);
}

#[test]
fn every_region_has_a_pyramid() {
    let dir = tempfile::tempdir().unwrap();
    let rects = [Rect::new(10, 20, 400, 300), Rect::new(0, 0, 150, 7)];
    let film = film(&dir.path().join("roi.zarr"), Size::new(700, 700), |s| {
        s.outputs = (0..2).map(|k| Output { name: format!("roi_{k}"), rect: rects[k] }).collect();
    });
    assert!(make(&film).unwrap());
    assert_eq!(level(&film, 0, 1, 1).0, Size::new(200, 150));
    let group = read_json(&film.group().store, "zarr.json").unwrap().unwrap();
    let ome = &group["attributes"]["ome"]["multiscales"];
    assert_eq!((&ome[0]["name"], &ome[1]["name"]), (&json!("roi_0"), &json!("roi_1")));
    assert_eq!(ome[0]["datasets"][1]["path"], "pyramid/roi_0/1");
    // The first pixel of level 1 lies half a film pixel beyond (10, 20); the axis is at 349.5.
    let translation = &ome[0]["datasets"][1]["coordinateTransformations"][1]["translation"];
    assert_eq!(translation[1].as_f64().unwrap(), (10.0 - 349.5 + 0.5) * 0.002);
    assert_eq!(translation[2].as_f64().unwrap(), (20.0 - 349.5 + 0.5) * 0.002);
    assert!(film.verify(2, &|_, _| ()).unwrap().findings.iter().all(|f| matches!(f, Finding::Bad { .. })));
}

#[test]
fn interrupted_pyramid_is_resumed_to_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let size = Size::new(533, 700);
    let uninterrupted = film(&dir.path().join("uninterrupted.zarr"), size, |_| ());
    assert!(make(&uninterrupted).unwrap());
    let expected = files(uninterrupted.path());
    let path = dir.path().join("film.zarr");
    let mut partial = film(&path, size, |_| ());
    // Faults at the 1st, 2nd, … rename: metadata, shards, the group's metadata. Each attempt makes progress.
    for n in 0..80 {
        let count = AtomicUsize::new(0);
        partial = partial.with_directory(|_| {
            crate::durable::Directory::new(&path).with_fsync(false).with_fault(move |step, _| {
                let fails = step == FileStep::Rename && count.fetch_add(1, Ordering::Relaxed) == n % 7;
                if fails { Err(Error::from_raw_os_error(5)) } else { Ok(()) }
            })
        });
        match partial.pyramid().make(1, 1, &NEVER, &|_, _| ()) {
            Ok(done) => {
                assert!(done && n > 7, "{n}");
                break;
            }
            Err(e) => assert!(matches!(e, GroupError::Storage(_)), "{e}"),
        }
        assert_ne!(partial.pyramid().state().unwrap(), PyramidState::Complete);
    }
    assert_eq!(partial.pyramid().state().unwrap(), PyramidState::Complete);
    assert_eq!(files(&path), expected);
    // Cancelled after the current shard.
    let film = film(&dir.path().join("cancelled.zarr"), size, |_| ());
    let cancel = AtomicBool::new(false);
    let stop = |done: u64, _: u64| cancel.store(done == 3, Ordering::Relaxed);
    assert!(!film.pyramid().make(1, 1, &cancel, &stop).unwrap());
    assert_eq!(film.pyramid().state().unwrap(), PyramidState::Unfinished(3, film.pyramid().shards()));
    assert!(make(&film).unwrap());
    assert_eq!(files(film.path()), expected);
}

#[test]
fn pyramid_of_a_changed_film_is_stale() {
    let dir = tempfile::tempdir().unwrap();
    for codec in [Codec::Zstd, Codec::None] {
        let path = dir.path().join(format!("{codec:?}.zarr"));
        let film = film(&path, Size::new(300, 300), |s| s.codec = codec);
        assert!(make(&film).unwrap());
        commit(&film, 0, 1, (2, 2), 3.0);
        assert_eq!(film.pyramid().state().unwrap(), PyramidState::Stale);
        let is_reported = |f: &FilmStore| {
            f.verify(1, &|_, _| ())
                .unwrap()
                .findings
                .iter()
                .any(|f| matches!(f, Finding::Metadata { key, .. } if key == "pyramid/zarr.json"))
        };
        assert!(is_reported(&film));
        assert!(make(&film).unwrap());
        assert_eq!(film.pyramid().state().unwrap(), PyramidState::Complete);
        assert!(!is_reported(&film));
        let (_, found) = level(&film, 0, 1, 1);
        assert!(found[149 * 150 + 149] > 300.0);
    }
}

#[test]
fn incomplete_film_is_an_error_and_stays_unchanged() {
    let dir = tempfile::tempdir().unwrap();
    let film = film(&dir.path().join("film.zarr"), Size::new(300, 300), |_| ());
    film.remove_shard(0, 1, (0, 2)).unwrap();
    let before = files(film.path());
    let e = make(&film).unwrap_err();
    assert!(
        matches!(&e, GroupError::Incomplete { missing: 1, shards: 18, first, .. } if first == "film/c/1/0/2"),
        "{e}"
    );
    assert_eq!(files(film.path()), before);
}

#[test]
fn bad_shard_of_a_level_is_found_and_made_again() {
    let dir = tempfile::tempdir().unwrap();
    let film = film(&dir.path().join("film.zarr"), Size::new(600, 300), |_| ());
    assert!(make(&film).unwrap());
    let expected = files(film.path());
    let key = "pyramid/film/2/c/1/0/0";
    std::fs::write(film.path().join(key), b"nothing").unwrap();
    let findings = film.verify(1, &|_, _| ()).unwrap().findings;
    assert!(findings.iter().any(|f| matches!(f, Finding::Bad { key: k, .. } if k == key)), "{findings:?}");
    assert!(film.remove_bad(key).unwrap() && !film.remove_bad("film/notes").unwrap());
    assert!(matches!(film.pyramid().state().unwrap(), PyramidState::Unfinished(..)));
    assert!(make(&film).unwrap());
    assert_eq!(files(film.path()), expected);
}

#[test]
fn bad_shard_of_a_film_that_is_its_only_level_is_found() {
    let dir = tempfile::tempdir().unwrap();
    let film = film(&dir.path().join("film.zarr"), Size::new(60, 40), |_| ());
    assert!(make(&film).unwrap());
    let key = "film/c/0/0/0";
    let mut bytes = std::fs::read(film.path().join(key)).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 16;
    std::fs::write(film.path().join(key), bytes).unwrap();
    let findings = film.verify(1, &|_, _| ()).unwrap().findings;
    assert!(matches!(&findings[..], [Finding::Bad { key: k, .. }] if k == key), "{findings:?}");
    assert!(film.remove_bad(key).unwrap());
}

#[test]
fn pyramid_at_a_url_is_made_and_replaced_when_the_film_changes() {
    let size = Size::new(301, 277);
    let dir = tempfile::tempdir().unwrap();
    let local = film(&dir.path().join("film.zarr"), size, |_| ());
    let remote = film(Path::new("memory://pyramids/deep/film.zarr"), size, |_| ());
    let shards = remote.all_shards().collect::<Vec<_>>();
    for factor in [1.0, 3.0] {
        for f in [&local, &remote] {
            shards.iter().for_each(|&(output, band, shard)| commit(f, output, band, shard, factor));
            assert_ne!(f.pyramid().state().unwrap(), PyramidState::Complete, "factor {factor}");
            assert!(make(f).unwrap());
            assert_eq!(f.pyramid().state().unwrap(), PyramidState::Complete);
        }
        for (key, _) in remote.pyramid().metadata() {
            assert!(remote.group().store.read(&format!("{key}/zarr.json")).unwrap().is_some(), "{key}");
        }
        for key in remote.pyramid().keys() {
            let key = format!("pyramid/{key}");
            assert!(
                remote.group().store.read(&key).unwrap() == local.group().store.read(&key).unwrap(),
                "{key}, factor {factor}"
            );
        }
    }
    assert_eq!(remote.group().store.names("").unwrap(), local.group().store.names("").unwrap());
}

#[cfg(unix)]
#[test]
fn path_that_is_not_utf_8_is_supported() {
    use std::os::unix::ffi::OsStrExt;
    let dir = tempfile::tempdir().unwrap();
    let f =
        film(&dir.path().join(std::ffi::OsStr::from_bytes(b"film-\xff.zarr")), Size::new(301, 277), |_| ());
    assert!(make(&f).unwrap());
    assert_eq!(f.pyramid().state().unwrap(), PyramidState::Complete);
}
