use super::*;
use crate::shard::SampleType;

fn spec(layout: Layout, samples: u64) -> DatasetSpec {
    DatasetSpec {
        digest: "abc".into(),
        samples,
        per_unit: 4,
        layout,
        arrays: vec![ArraySpec {
            name: "film",
            axes: vec!["y", "x"],
            shape: vec![2, 3],
            sample: SampleType::U16,
        }],
        attributes: Map::new(),
        record: Map::new(),
    }
}

/// Sample 2 failed.
fn sample(number: u64, layout: Layout) -> Sample {
    let mut line = Map::new();
    line.insert("picture".into(), format!("{number}.png").into());
    let ending = if layout == Layout::Zarr { "array" } else { "png" };
    let item = Item { name: "film".into(), ending, bytes: vec![number as u8; 12] };
    Sample { number, line, items: if number == 2 { Vec::new() } else { vec![item] } }
}

fn fill(store: &DatasetStore) {
    for unit in 0..store.spec().units() {
        if !store.has(unit).unwrap() {
            let samples = store.spec().of_unit(unit).map(|k| sample(k, store.spec().layout)).collect();
            store.write_unit(unit, samples).unwrap();
        }
    }
    assert!(store.finish().unwrap());
}

#[test]
fn units_are_kept_verified_and_added_in_every_layout() {
    for layout in [Layout::Folders, Layout::Tar, Layout::Zarr] {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("out");
        let store = DatasetStore::create(&path, spec(layout, 6)).unwrap();
        assert!(!store.finish().unwrap());
        fill(&store);
        let lines = std::fs::read_to_string(path.join(ALL)).unwrap();
        assert_eq!(lines.lines().count(), 6);
        let store = DatasetStore::open(&path).unwrap();
        let checked: Vec<_> = (0..2).map(|unit| store.verify_unit(unit).unwrap()).collect();
        assert_eq!(checked, [(Vec::new(), 36), (Vec::new(), 24)], "{layout:?}");
        // More samples: complete units stay, the last of before is made again.
        let first = std::fs::metadata(path.join(lines_key(0))).unwrap().modified().unwrap();
        let store = DatasetStore::create(&path, spec(layout, 9)).unwrap();
        assert_eq!([0, 1, 2].map(|unit| store.has(unit).unwrap()), [true, false, false]);
        fill(&store);
        assert_eq!(std::fs::metadata(path.join(lines_key(0))).unwrap().modified().unwrap(), first);
        let all = std::fs::read_to_string(path.join(ALL)).unwrap();
        assert_eq!((all.lines().count(), all.starts_with(&lines)), (9, true));
        assert!(matches!(DatasetStore::create(&path, spec(layout, 6)), Err(DatasetError::Fewer { .. })));
        let other = DatasetSpec { digest: "d".into(), ..spec(layout, 9) };
        assert!(matches!(DatasetStore::create(&path, other), Err(DatasetError::OtherRecipe { .. })));
        DatasetStore::remove(&path).unwrap();
        assert!(!path.exists());
    }
}

#[test]
fn damage_and_loss_are_found_in_every_layout() {
    for (layout, file) in [
        (Layout::Folders, "000000/000000001.film.png"),
        (Layout::Tar, "000000.tar"),
        (Layout::Zarr, "data.zarr/film/c/0/0/0"),
    ] {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("out");
        fill(&DatasetStore::create(&path, spec(layout, 6)).unwrap());
        let file = path.join(file);
        let good = std::fs::read(&file).unwrap();
        let mut bad = good.clone();
        bad[7] ^= 1;
        std::fs::write(&file, &bad).unwrap();
        let store = DatasetStore::open(&path).unwrap();
        let found = store.verify_unit(0).unwrap().0;
        assert!(!found.is_empty() && store.verify_unit(1).unwrap().0.is_empty(), "{layout:?}");
        std::fs::remove_file(&file).unwrap();
        let found = store.verify_unit(0).unwrap().0;
        assert!(found.iter().all(|f| f.kind == "missing") && !found.is_empty(), "{layout:?} {found:?}");
        std::fs::write(&file, &good).unwrap();
        assert!(store.verify_unit(0).unwrap().0.is_empty());
        std::fs::write(path.join(lines_key(0)), "{}\n").unwrap();
        assert_eq!(store.verify_unit(0).unwrap().0[0].kind, "damaged");
    }
}

#[test]
fn what_units_have_in_common_is_verified() {
    for layout in [Layout::Folders, Layout::Zarr] {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("out");
        fill(&DatasetStore::create(&path, spec(layout, 6)).unwrap());
        let store = DatasetStore::open(&path).unwrap();
        assert_eq!(store.verify_common().unwrap(), []);
        let keys = [ALL, "data.zarr/zarr.json", "data.zarr/film/zarr.json"];
        for key in &keys[..if layout == Layout::Zarr { 3 } else { 1 }] {
            let good = std::fs::read(path.join(key)).unwrap();
            let mut flipped = good.clone();
            flipped[good.len() / 2] ^= 1;
            for bad in [&flipped[..], &good[..good.len() - 1], &[&good[..], b"x"].concat(), b""] {
                std::fs::write(path.join(key), bad).unwrap();
                let expected = Finding { kind: "damaged", key: (*key).into(), unit: None };
                assert_eq!(store.verify_common().unwrap(), [expected], "{key}");
            }
            std::fs::remove_file(path.join(key)).unwrap();
            assert_eq!(store.verify_common().unwrap()[0].kind, "missing", "{key}");
            std::fs::write(path.join(key), &good).unwrap();
        }
        store.forget_all_lines().unwrap();
        fill(&DatasetStore::create(&path, spec(layout, 6)).unwrap());
        assert_eq!(store.verify_common().unwrap(), []);
    }
}

#[test]
fn a_store_that_was_replaced_gets_no_unit() {
    for digest in ["abc", "other"] {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("out");
        let store = DatasetStore::create(&path, spec(Layout::Folders, 6)).unwrap();
        DatasetStore::remove(&path).unwrap();
        let new = DatasetSpec { digest: digest.into(), ..spec(Layout::Folders, 6) };
        let new = DatasetStore::create(&path, new).unwrap();
        let samples = store.spec().of_unit(0).map(|k| sample(k, Layout::Folders)).collect();
        assert!(matches!(store.write_unit(0, samples), Err(DatasetError::Replaced { .. })), "{digest}");
        assert!(!new.has(0).unwrap() && !path.join("000000").exists());
        assert!(matches!(store.finish(), Ok(false) | Err(DatasetError::Replaced { .. })));
    }
}

#[test]
fn files_of_others_are_neither_used_nor_removed() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("out");
    std::fs::create_dir(&path).unwrap();
    std::fs::write(path.join("mine.txt"), "x").unwrap();
    let spec = || spec(Layout::Folders, 6);
    assert!(matches!(DatasetStore::create(&path, spec()), Err(DatasetError::Foreign { .. })));
    assert!(matches!(DatasetStore::check(&path, "abc"), Err(DatasetError::Foreign { .. })));
    assert!(DatasetStore::remove(&path).is_err());
    std::fs::remove_file(path.join("mine.txt")).unwrap();
    fill(&DatasetStore::create(&path, spec()).unwrap());
    std::fs::write(path.join("000000/mine.txt"), "x").unwrap();
    assert!(matches!(DatasetStore::remove(&path), Err(DatasetError::Foreign { .. })));
    assert!(path.join("000000/mine.txt").exists() && is_one(&path).unwrap());
}
