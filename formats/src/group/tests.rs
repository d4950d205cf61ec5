//! Damage of every file of films and raws is detected, and what follows from the attributes is written again with the same bytes.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use pipeline::geometry::{Rect, Size};
use serde_json::{Map, Value, json};

use super::{Finding, GroupError, Output};
use crate::film::{Codec, FilmSpec, FilmStore, SampleType};
use crate::raw::{RawSpec, RawStore};

/// A store with all kinds of arrays, in a temporary directory.
struct Store {
    path: PathBuf,
    _dir: tempfile::TempDir,
    is_film: bool,
}

fn object(value: Value) -> Map<String, Value> {
    let Value::Object(map) = value else { unreachable!() };
    map
}

/// One array large enough for a level of a pyramid, and a small one.
const RECTS: [Rect; 2] = [Rect::new(1, 2, 3, 260), Rect::new(0, 0, 4, 5)];

fn film() -> Store {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("film.zarr");
    let outputs = (0..2).map(|k| Output { name: format!("roi_{k}"), rect: RECTS[k] }).collect();
    let spec = FilmSpec {
        outputs,
        shard: 256,
        chunk: 4,
        codec: Codec::None,
        sample: SampleType::F16,
        has_invented: true,
        ..FilmSpec::full_film(Size::new(6, 300), vec![450.0, 550.5], 2.0)
    };
    let provenance =
        object(json!({"job_digest": "a", "layout_digest": "b", "bands": [{"transmission": 0.5}]}));
    let film = FilmStore::create(&path, spec, provenance, false).unwrap();
    for (output, band, shard) in film.all_shards().collect::<Vec<_>>() {
        let size = film.shard_rect(output, shard).size();
        let pixels: Vec<f32> = (0..size.pixels()).map(|k| (band * 7 + k % 5) as f32).collect();
        let side = pipeline::depth::invented::block_px(film.spec().shard_grid(output).shard);
        let shares = vec![0.25; size.height.div_ceil(side) * size.width.div_ceil(side)];
        film.commit(&film.encode_invented(output, band, shard, size, &shares)).unwrap();
        film.commit(&film.encode_shard(output, band, shard, &pixels).unwrap()).unwrap();
    }
    assert!(film.pyramid().make(1, 1 << 20, &AtomicBool::new(false), &|_, _| ()).unwrap());
    Store { path, _dir: dir, is_film: true }
}

/// A raw of two frames with its signal, or of one frame and two windows.
fn raw(frames: usize) -> Store {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("raw.zarr");
    let outputs = match frames {
        1 => (0..2).map(|k| Output { name: format!("roi_{k}"), rect: RECTS[k] }).collect(),
        _ => vec![Output { name: "raw".into(), rect: Rect::new(0, 0, 6, 300) }],
    };
    let spec = RawSpec {
        outputs,
        sensor: Size::new(6, 300),
        pitch_um: 5.5,
        centre_mm: (0.0, 0.1),
        exposure_s: (0..frames).map(|f| 0.01 * (f + 1) as f64).collect(),
        signal: frames > 1,
        shard: 256,
        chunk: 4,
    };
    let attributes = object(json!({
        "provenance": {"job_digest": "a", "layout_digest": "b"},
        "cfa": {"pattern": [["R", "G"], ["G", "B"]]},
        "black_dn": 64.0, "white_dn": 1023.0,
        "white_gains": {"D65": {"R": 1.5}},
    }));
    let raw = RawStore::create(&path, spec, attributes, false).unwrap();
    for shard in raw.spec().all_shards() {
        let pixels = raw.spec().shard_rect(shard).size().pixels();
        match shard.frame {
            Some(frame) => {
                let counts: Vec<u16> = (0..pixels).map(|k| (frame * 7 + k % 5) as u16).collect();
                raw.commit_counts(shard, &counts).unwrap()
            }
            None => raw.commit_signal(shard, &vec![1.5; pixels]).unwrap(),
        };
    }
    assert!(raw.pyramid().make(1, 1 << 20, &AtomicBool::new(false), &|_, _| ()).unwrap());
    Store { path, _dir: dir, is_film: false }
}

impl Store {
    fn verify(&self) -> Result<Vec<Finding>, GroupError> {
        let report = match self.is_film {
            true => FilmStore::open_to_verify(&self.path, false)?.verify(1, &|_, _| ()),
            false => RawStore::open_to_verify(&self.path, false)?.verify(1, &|_, _| ()),
        };
        Ok(report?.findings)
    }

    fn restore(&self, key: &str) -> bool {
        match self.is_film {
            true => FilmStore::open_to_verify(&self.path, false).unwrap().restore(key).unwrap(),
            false => RawStore::open_to_verify(&self.path, false).unwrap().restore(key).unwrap(),
        }
    }

    /// All files, by key.
    fn files(&self) -> BTreeMap<String, Vec<u8>> {
        let mut files = BTreeMap::new();
        let mut todo = vec![self.path.clone()];
        while let Some(directory) = todo.pop() {
            for entry in fs::read_dir(directory).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    todo.push(path);
                } else {
                    let key = path.strip_prefix(&self.path).unwrap().to_str().unwrap().to_owned();
                    files.insert(key, fs::read(&path).unwrap());
                }
            }
        }
        files
    }
}

/// Contents of the file `key` that differ from `good`: flipped bits, cut ends, none, and those of other files.
fn damages(key: &str, files: &BTreeMap<String, Vec<u8>>) -> Vec<Option<Vec<u8>>> {
    let good = &files[key];
    // More of the file that holds all attributes, and a prime step, so that all bits occur.
    let step = (good.len() / if key == "zarr.json" { 150 } else { 5 }).max(1) | 1;
    let flipped = (0..good.len()).step_by(step).chain([good.len() - 1]).map(|k| {
        let mut bad = good.clone();
        bad[k] ^= 1 << (k % 8);
        Some(bad)
    });
    let cut = [0, good.len() / 2, good.len() - 1].map(|n| Some(good[..n].to_vec()));
    // Valid files of other arrays; those of other places in one array are not distinguishable.
    let array = |key: &str| key.split("/c/").next().unwrap().to_owned();
    let is_metadata = key.ends_with("zarr.json");
    let others = files.iter().filter(|(other, bytes)| {
        let is_other = if is_shard(key) { bytes.len() != good.len() } else { *bytes != good };
        other.ends_with("zarr.json") == is_metadata && array(other) != array(key) && is_other
    });
    flipped.chain(cut).chain([None]).chain(others.map(|(_, bytes)| Some(bytes.clone())).take(4)).collect()
}

/// Whether a file is a shard, or a chunk beside one.
fn is_shard(key: &str) -> bool {
    key.contains("/c/") && !key.ends_with("/c/0")
}

/// Whether `bad` says the same as `good`: equal JSON, or the same attributes with their digest under another name.
fn is_harmless(good: &[u8], bad: &[u8]) -> bool {
    let (Ok(good), Ok(bad)) = (serde_json::from_slice::<Value>(good), serde_json::from_slice::<Value>(bad))
    else {
        return false;
    };
    let mut named = good.clone();
    let digest = named["attributes"].as_object_mut().and_then(|a| a.remove("attributes_digest"));
    let contains = |(key, value): (&String, &Value)| bad["attributes"].get(key) == Some(value);
    let is_renamed = digest.is_some()
        && bad["attributes"].get("attributes_digest").is_none()
        && named["attributes"].as_object().unwrap().iter().all(contains)
        && bad["consolidated_metadata"] == good["consolidated_metadata"];
    good == bad || is_renamed
}

fn write(path: &Path, contents: Option<&[u8]>) {
    match contents {
        Some(bytes) => fs::write(path, bytes).unwrap(),
        None => fs::remove_file(path).unwrap(),
    }
}

fn check_every_damage(store: &Store) {
    let files = store.files();
    assert_eq!(store.verify().unwrap(), []);
    for (key, good) in &files {
        let file = store.path.join(key);
        for damage in damages(key, &files) {
            write(&file, damage.as_deref());
            let describe =
                || format!("{key}: {} of {} bytes", damage.as_ref().map_or(0, Vec::len), good.len());
            let found = store.verify();
            if damage.as_ref().is_some_and(|bad| is_harmless(good, bad)) {
                write(&file, Some(good));
                continue;
            }
            let Ok(findings) = found else {
                // Without valid attributes there is no film or raw.
                assert_eq!(key, "zarr.json", "{}", describe());
                write(&file, Some(good));
                continue;
            };
            assert!(!findings.is_empty(), "{} is not detected", describe());
            // Shards do not follow from the attributes, nor do the attributes.
            let is_derived = findings.iter().all(|f| matches!(f, Finding::Metadata { .. }));
            let differ = findings.iter().any(|f| matches!(f, Finding::Attributes { .. }));
            assert_eq!(is_derived, !is_shard(key) && !differ, "{}: {findings:?}", describe());
            if is_derived {
                for finding in &findings {
                    assert!(store.restore(finding.fields().1), "{}: {finding:?}", describe());
                }
                assert_eq!(store.verify().unwrap(), [], "{}", describe());
                assert!(store.files() == files, "{}", describe());
            } else {
                write(&file, Some(good));
            }
        }
    }
}

#[test]
fn damage_of_every_file_of_a_film_is_detected() {
    check_every_damage(&film());
}

#[test]
fn damage_of_every_file_of_a_raw_is_detected() {
    check_every_damage(&raw(2));
    check_every_damage(&raw(1));
}

#[test]
fn removed_arrays_and_levels_are_detected() {
    for (store, names) in [
        (film(), ["roi_0", "roi_1_invented", "roi_1_y", "pyramid/roi_0/1", "pyramid"]),
        (raw(2), ["raw", "signal", "exposure_s", "x", "pyramid"]),
    ] {
        let files = store.files();
        for name in names {
            fs::remove_dir_all(store.path.join(name)).unwrap();
            let findings = store.verify().unwrap();
            assert!(findings.iter().any(|f| f.fields().1.starts_with(name)), "{name}: {findings:?}");
            for (key, bytes) in &files {
                fs::create_dir_all(store.path.join(key).parent().unwrap()).unwrap();
                fs::write(store.path.join(key), bytes).unwrap();
            }
        }
        assert_eq!(store.verify().unwrap(), []);
    }
}

/// Of films and raws of earlier versions, too: they lack the digest.
#[test]
fn group_without_a_digest_of_its_attributes_is_correct() {
    let store = raw(1);
    let file = store.path.join("zarr.json");
    let mut group: Value = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
    assert!(group["attributes"].as_object_mut().unwrap().shift_remove("attributes_digest").is_some());
    fs::write(&file, group.to_string()).unwrap();
    assert_eq!(store.verify().unwrap(), []);
}
