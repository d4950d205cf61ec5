//! Raws: creation, reading, replacement, verification.

mod pyramid;

use super::*;
use crate::group::{Finding, Output};
use pipeline::geometry::Size;
use serde_json::json;

fn spec() -> RawSpec {
    let sensor = Size::new(70, 50);
    RawSpec {
        outputs: vec![Output { name: "raw".into(), rect: sensor.rect() }],
        sensor,
        pitch_um: 5.5,
        centre_mm: (0.0, 0.1),
        exposure_s: vec![0.01, 0.02],
        signal: true,
        shard: 64,
        chunk: 16,
    }
}

fn attributes(job: &str) -> Map<String, Value> {
    let Value::Object(map) = json!({"provenance": {"job_digest": job, "layout_digest": "l"}}) else {
        unreachable!()
    };
    map
}

#[test]
fn a_raw_is_created_filled_and_opened_again() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("raw.zarr");
    let raw = RawStore::create(&path, spec(), attributes("a"), false).unwrap();
    assert!(matches!(
        RawStore::create(&path, spec(), attributes("a"), false),
        Err(GroupError::Exists { .. })
    ));
    let all = raw.spec().all_shards();
    assert_eq!(all.len(), 3 * 2);
    assert_eq!(raw.missing(&all).unwrap(), all);
    for shard in &all {
        let rect = raw.spec().shard_rect(*shard);
        let pixels = rect.size().pixels();
        match shard.frame {
            Some(frame) => raw.commit_counts(*shard, &vec![frame as u16 + 7; pixels]).unwrap(),
            None => raw.commit_signal(*shard, &vec![1.5; pixels]).unwrap(),
        };
    }
    let again = RawStore::open(&path, false).unwrap();
    assert_eq!((again.spec(), again.attributes()), (&spec(), &attributes("a")));
    assert!(again.missing(&all).unwrap().is_empty());
    // As a chart reads it: the array of u16 with three dimensions.
    let options = crate::chart::ChartOptions { wavelengths_nm: Some(vec![1.0, 2.0]), ..Default::default() };
    let array = crate::chart::ChartStore::open_at(&path, "raw", options).unwrap();
    let mut pixels = vec![0.0; 70 * 50];
    array.read_rect(1, spec().sensor.rect(), &mut pixels).unwrap();
    assert!(pixels.iter().all(|v| *v == 8.0));
    RawStore::remove(&path).unwrap();
    assert!(!path.exists());
}

#[test]
fn another_raw_in_its_place_gets_nothing() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("raw.zarr");
    let old = RawStore::create(&path, spec(), attributes("a"), false).unwrap();
    RawStore::remove(&path).unwrap();
    RawStore::create(&path, spec(), attributes("b"), false).unwrap();
    let shard = old.spec().all_shards()[1];
    let pixels = vec![0; old.spec().shard_rect(shard).size().pixels()];
    assert!(matches!(old.commit_counts(shard, &pixels), Err(GroupError::Replaced { .. })));
    std::fs::write(path.join("notes.txt"), "mine").unwrap();
    assert!(matches!(RawStore::remove(&path), Err(GroupError::Foreign { .. })));
}

#[test]
fn damaged_attributes_are_an_error() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("raw.zarr");
    RawStore::create(&path, spec(), attributes("a"), false).unwrap();
    let file = path.join("zarr.json");
    let text = std::fs::read_to_string(&file).unwrap();
    for (from, to) in [
        ("\"chunk\": 16", "\"chunk\": 0"),
        ("\"shard\": 64", "\"shard\": 1000000000"),
        ("\"column\": 0", "\"column\": 60"),
    ] {
        assert!(text.contains(from), "{from}");
        std::fs::write(&file, text.replace(from, to)).unwrap();
        assert!(matches!(RawStore::open(&path, false), Err(GroupError::Damaged { .. })), "{to}");
    }
}

#[test]
fn remove_bad_keeps_a_shard_that_is_intact_by_now() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("raw.zarr");
    let raw = RawStore::create(&path, spec(), attributes("a"), false).unwrap();
    let shard = *raw.spec().all_shards().last().unwrap();
    let counts = vec![700; raw.spec().shard_rect(shard).size().pixels()];
    raw.commit_counts(shard, &counts).unwrap();
    let key = raw.spec().key(shard);
    let intact = std::fs::read(path.join(&key)).unwrap();
    std::fs::write(path.join(&key), &intact[..50]).unwrap();
    let findings = raw.verify(2, &|_, _| ()).unwrap().findings;
    assert!(
        findings.iter().any(|f| matches!(f, Finding::Bad { key: bad, .. } if *bad == key)),
        "{findings:?}"
    );
    // Another process makes it again between the check and the removal.
    raw.commit_counts(shard, &counts).unwrap();
    assert!(!raw.remove_bad(&key).unwrap());
    assert!(std::fs::read(path.join(&key)).unwrap() == intact);
    std::fs::write(path.join(&key), &intact[..50]).unwrap();
    assert!(raw.remove_bad(&key).unwrap() && !path.join(&key).exists());
    assert!(!raw.remove_bad(&key).unwrap() && !raw.remove_bad("raw/notes").unwrap());
}
