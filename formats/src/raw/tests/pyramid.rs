//! Pyramids of raws compared with the definition; stale and damaged ones.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use pipeline::geometry::{Rect, Size};
use serde_json::{Map, Value, json};

use crate::chart::{ChartOptions, ChartStore};
use crate::group::{Finding, GroupError, Output};
use crate::pyramid::PyramidState;
use crate::raw::{RawSpec, RawStore, halve_mosaic, mosaic_below};

fn attributes(job: &str) -> Map<String, Value> {
    let all = json!({
        "provenance": {"job_digest": job, "layout_digest": "l"},
        "cfa": {"pattern": [["R", "G"], ["G", "B"]]},
        "black_dn": 64.0, "white_dn": 1023.0,
    });
    let Value::Object(map) = all else { unreachable!() };
    map
}

/// A raw of two frames and two windows, without its last shard if not `whole`.
fn raw(path: &Path, whole: bool) -> RawStore {
    let sensor = Size::new(700, 600);
    let output = |name: &str, rect| Output { name: name.into(), rect };
    let spec = RawSpec {
        outputs: vec![output("roi_0", Rect::new(1, 2, 690, 533)), output("roi_1", Rect::new(0, 0, 40, 30))],
        sensor,
        pitch_um: 2.0,
        centre_mm: (0.0, 0.5),
        exposure_s: vec![0.01, 0.02],
        signal: false,
        shard: 256,
        chunk: 64,
    };
    let raw = RawStore::create(path, spec, attributes("a"), false).unwrap();
    let all = raw.spec().all_shards();
    for &shard in &all[..all.len() - usize::from(!whole)] {
        let rect = raw.spec().shard_rect(shard);
        let frame = shard.frame.unwrap() as i64;
        let at = |k: usize| (rect.y + (k / rect.width) as i64, rect.x + (k % rect.width) as i64);
        let value = |(y, x): (i64, i64)| {
            (64 + frame * 100 + (y % 2 * 2 + x % 2) * 200 + (y * 31 + x * 17) % 97) as u16
        };
        let counts: Vec<u16> = (0..rect.size().pixels()).map(|k| value(at(k))).collect();
        raw.commit_counts(shard, &counts).unwrap();
    }
    raw
}

fn make(raw: &RawStore) -> Result<bool, GroupError> {
    raw.pyramid().make(2, 1 << 30, &AtomicBool::new(false), &|_, _| ())
}

fn level(raw: &RawStore, array: &str, frame: usize) -> (Size, Vec<f32>) {
    let options = ChartOptions { wavelengths_nm: Some(vec![1.0, 2.0]), ..ChartOptions::default() };
    let store = ChartStore::open_at(raw.path(), array, options).unwrap();
    let mut pixels = vec![0.0; store.size().pixels()];
    store.read_rect(frame, store.size().rect(), &mut pixels).unwrap();
    (store.size(), pixels)
}

#[test]
fn levels_are_mosaics_of_means_over_one_filter() {
    let directory = tempfile::tempdir().unwrap();
    let raw = raw(&directory.path().join("raw.zarr"), true);
    assert_eq!(raw.pyramid().state().unwrap(), PyramidState::None);
    assert!(make(&raw).unwrap());
    assert_eq!(raw.pyramid().state().unwrap(), PyramidState::Complete);
    for frame in 0..2 {
        let mut below = level(&raw, "roi_0", frame);
        for (number, size) in [(1, Size::new(345, 267)), (2, Size::new(173, 134))] {
            let found = level(&raw, &format!("pyramid/roi_0/{number}"), frame);
            assert_eq!(found.0, size);
            let rect = mosaic_below(size.rect(), below.0, (2, 2));
            let rows = rect.y as usize..rect.bottom() as usize;
            let part: Vec<f32> = rows
                .flat_map(|y| below.1[y * below.0.width + rect.x as usize..][..rect.width].to_vec())
                .collect();
            let mut means = vec![0.0; size.pixels()];
            halve_mosaic(&part, rect, (2, 2), size.rect(), &mut means);
            assert!(found.1 == means, "frame {frame}, level {number}");
            below = found;
        }
    }
    // The window of 40 x 30 pixels has no level; the group lists arrays and transformations.
    assert!(!raw.path().join("pyramid/roi_1").exists());
    let group: Value = serde_json::from_slice(&std::fs::read(raw.path().join("zarr.json")).unwrap()).unwrap();
    let scales = &group["attributes"]["ome"]["multiscales"];
    assert_eq!(scales[0]["datasets"][2]["path"], "pyramid/roi_0/2");
    assert_eq!(scales[1]["datasets"].as_array().unwrap().len(), 1);
    let translation = &scales[0]["datasets"][1]["coordinateTransformations"][1]["translation"];
    let mm = |k: usize| translation[k].as_f64().unwrap();
    assert!(
        (mm(1) - (1.0 - 349.5 + 0.5) * 2e-3).abs() < 1e-12
            && (mm(2) - ((2.0 - 299.5 + 0.5) * 2e-3 + 0.5)).abs() < 1e-12
    );
    assert!(group["consolidated_metadata"]["metadata"].get("pyramid/roi_0/1").is_some());
    // It is the same raw as before, and removed with its levels.
    let again = RawStore::open(raw.path(), false).unwrap();
    assert_eq!((again.spec(), again.attributes()), (raw.spec(), raw.attributes()));
    assert!(again.verify(2, &|_, _| ()).unwrap().findings.is_empty());
    RawStore::remove(raw.path()).unwrap();
    assert!(!raw.path().exists());
}

#[test]
fn damaged_stale_and_incomplete_levels_are_found_and_replaced() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("raw.zarr");
    let partial = raw(&path, false);
    assert!(matches!(make(&partial), Err(GroupError::Incomplete { missing: 1, shards: 20, .. })));
    RawStore::remove(&path).unwrap();
    let raw = raw(&path, true);
    assert!(make(&raw).unwrap());
    let shard = path.join("pyramid/roi_0/1/c/1/0/1");
    let bytes = std::fs::read(&shard).unwrap();
    std::fs::write(&shard, b"no shard").unwrap();
    let findings = raw.verify(1, &|_, _| ()).unwrap().findings;
    let [Finding::Bad { key, .. }] = &findings[..] else { panic!("{findings:?}") };
    assert_eq!(key, "pyramid/roi_0/1/c/1/0/1");
    assert!(raw.remove_bad(key).unwrap());
    assert!(matches!(raw.pyramid().state().unwrap(), PyramidState::Unfinished(..)));
    assert!(make(&raw).unwrap());
    assert!(std::fs::read(&shard).unwrap() == bytes);
    // Another pixel of the raw: its levels are stale, and made again.
    let last = *raw.spec().all_shards().last().unwrap();
    raw.commit_counts(last, &vec![500; raw.spec().shard_rect(last).size().pixels()]).unwrap();
    assert_eq!(raw.pyramid().state().unwrap(), PyramidState::Stale);
    let findings = raw.verify(1, &|_, _| ()).unwrap().findings;
    assert!(matches!(&findings[..], [Finding::Metadata { .. }]), "{findings:?}");
    assert!(make(&raw).unwrap());
    assert_eq!(raw.pyramid().state().unwrap(), PyramidState::Complete);
}
