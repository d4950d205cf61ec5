//! Metadata of charts, Zarr v2 and v3, groups and attributes: a directory in memory with one damaged metadata file.

use crate::fuzz_support::{damage_text, fuzz};
use crate::{data, directory, json};
use lenscube_formats::chart::{ChartOptions, ChartStore};
use pipeline::geometry::Rect;
use std::fs;
use std::path::{Path, PathBuf};

fn copy_tree(from: &Path, to: &Path, metadata: &mut Vec<(PathBuf, Vec<u8>)>) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let to = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy_tree(&path, &to, metadata);
            continue;
        }
        fs::copy(&path, &to).unwrap();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if name == "zarr.json" || name.starts_with(".z") {
            metadata.push((to, fs::read(&path).unwrap()));
        }
    }
}

#[test]
fn damaged_chart_metadata_does_not_panic() {
    let dir = directory();
    let mut stores = Vec::new();
    for name in
        ["v2-blosc", "v2-big-endian-fortran", "v3-sharded", "v3-index-first", "v3-transposed", "v3-bip-zstd"]
    {
        let mut metadata = Vec::new();
        copy_tree(&data("charts").join(name), &dir.path().join(name), &mut metadata);
        metadata.sort();
        stores.push((dir.path().join(name), metadata));
    }
    let mut damaged: Option<(PathBuf, Vec<u8>)> = None;
    let current = std::cell::RefCell::new(PathBuf::new());
    let make = |r: &mut crate::fuzz_support::Random| {
        if let Some((path, original)) = damaged.take() {
            fs::write(path, original).unwrap();
        }
        let (store, metadata) = &stores[r.below(stores.len())];
        let (path, original) = &metadata[r.below(metadata.len())];
        let mut bytes = original.clone();
        match r.below(4) {
            0 => damage_text(&mut bytes, r),
            _ => json::damage_values(&mut bytes, r),
        }
        fs::write(path, &bytes).unwrap();
        damaged = Some((path.clone(), original.clone()));
        *current.borrow_mut() = store.clone();
        bytes
    };
    fuzz("chart metadata", 300, make, |_| {
        let store = current.borrow().to_string_lossy().into_owned();
        let Ok(chart) = ChartStore::open(&store, ChartOptions::default()) else { return false };
        let (size, chunk) = (chart.size(), chart.chunk_shape());
        // A missing chunk of a GiB is valid, but slow.
        if chunk.iter().product::<usize>() > 1 << 20 {
            return true;
        }
        let rect = Rect::new(0, 0, size.height.min(40), size.width.min(40));
        let mut out = vec![0.0; rect.size().pixels()];
        for band in [0, chart.bands() - 1] {
            let _ = chart.read_rect(band, rect, &mut out);
        }
        true
    });
}
