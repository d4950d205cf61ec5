//! Scenes: a damaged file of a store is an error, or changes no pixel that is read.

use crate::directory;
use crate::fuzz_support::{Random, damage, damage_text, fuzz};
use lenscube_formats::chart::{Chart, ChartRequest};
use lenscube_formats::object;
use lenscube_formats::scene::{Plane, SceneLight, SceneShard, SceneSpec, SceneStore, object_bits};
use pipeline::colour::Illuminant;
use pipeline::geometry::{Rect, Size};
use pipeline::projection::{FilmProjection, Projection};
use pipeline::scene::weights::{Basis, LightSpectrum, Reflectance, SceneIlluminant, Spectrum};
use serde_json::json;
use std::cell::RefCell;
use std::fs;
use std::path::{Path, PathBuf};

const SIZE: Size = Size::new(20, 40);

/// A scene of two surfaces with weights of 16 bits and numbers of objects, in the projection of a film.
fn write(path: &Path) {
    let spec = SceneSpec {
        size: SIZE,
        sheets: 2,
        bases: 2,
        pitch_um: 2.5,
        centre_mm: (0.0, 0.0),
        shard: (16, 32),
        chunk: 16,
        half: true,
        ids: true,
        projection: Projection::Film(FilmProjection {
            focal_mm: 4.0,
            radius_mm: 3.0,
            coefficients: std::array::from_fn(|k| if k == 0 { 0.25 } else { 0.0 }),
        }),
    };
    // Not red and green, whose spectra take long to find.
    let basis = |name: &str, values| {
        let spectrum = Spectrum::new(name, vec![400.0, 700.0], values, 1.0).unwrap();
        Basis { reflectance: Reflectance::Named(spectrum), light: LightSpectrum::Illuminant }
    };
    let light = SceneLight {
        bases: vec![basis("brick", vec![0.1, 0.5]), basis("leaf", vec![0.25, 0.75])],
        illuminant: SceneIlluminant::Cie(Illuminant::D65),
        illuminance_lx: 1000.0,
    };
    let mut attributes = object! {
        "focal_mm": 4.0,
        "film_size": [10, 20],
        "provenance": json!({ "job_digest": "j", "layout_digest": "l" }),
    };
    attributes.extend(light.attributes());
    let scene = SceneStore::create(path, spec, attributes, false).unwrap();
    for shard in scene.spec().all_shards() {
        let rect = scene.spec().shard_rect(shard.place);
        let pixels: Vec<f32> = (0..rect.size().pixels()).map(|i| value(shard, i)).collect();
        scene.commit(shard, &|y| &pixels[y * rect.width..][..rect.width]).unwrap();
    }
}

fn value(shard: SceneShard, i: usize) -> f32 {
    match shard.plane {
        Plane::Weight(basis) => (basis + i % 7) as f32 * 0.125,
        Plane::Depth => 1.0 + i as f32,
        Plane::Coverage => 0.5,
        Plane::Object => object_bits(Some(i as u32)),
    }
}

/// The pixels of two bands of a surface; `None` if they cannot be read.
fn pixels(path: &Path, surface: &str) -> Option<Vec<u32>> {
    let request = ChartRequest { wavelengths_nm: Some(&[500.0, 600.0]), ..ChartRequest::default() };
    let chart = Chart::open(&format!("{}{surface}", path.display()), &request).ok()?;
    let rect = Rect::new(0, 0, chart.size().height.min(64), chart.size().width.min(64));
    let mut all = Vec::new();
    for band in 0..2 {
        let mut out = vec![0.0; rect.size().pixels()];
        chart.source().read(band, rect, &mut out).ok()?;
        all.extend(out.iter().map(|v| v.to_bits()));
    }
    Some(all)
}

fn files(path: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = fs::read_dir(path).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for entry in entries {
        if entry.is_dir() { files(&entry, found) } else { found.push(entry) }
    }
}

#[test]
fn damaged_scenes_give_no_other_pixels() {
    let dir = directory();
    let path = dir.path().join("scene.zarr");
    write(&path);
    let mut all = Vec::new();
    files(&path, &mut all);
    let whole = [pixels(&path, ""), pixels(&path, "//hidden/1")];
    assert!(whole.iter().all(Option::is_some));
    let current = RefCell::new((PathBuf::new(), Vec::new()));
    let make = |r: &mut Random| {
        let file = &all[r.below(all.len())];
        let original = fs::read(file).unwrap();
        let mut bytes = original.clone();
        match file.ends_with("zarr.json") && r.below(2) == 0 {
            true => damage_text(&mut bytes, r),
            false => damage(&mut bytes, r),
        }
        *current.borrow_mut() = (file.clone(), original);
        bytes
    };
    fuzz("scene store", 300, make, |bytes| {
        let (file, original) = &*current.borrow();
        fs::write(file, bytes).unwrap();
        let found = [pixels(&path, ""), pixels(&path, "//hidden/1")];
        if let Ok(scene) = SceneStore::open_to_verify(&path, true) {
            let _ = scene.verify(1, &|_, _| ());
        }
        fs::write(file, original).unwrap();
        // Metadata may be those of another scene.
        if !file.ends_with("zarr.json") {
            for (found, whole) in found.iter().zip(&whole) {
                assert!(found.is_none() || found == whole, "other pixels");
            }
        }
        found.iter().all(Option::is_some)
    });
}
