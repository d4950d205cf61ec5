//! Scenes: creation, reading as a chart, verification, replacement.

use super::*;
use crate::chart::{ChartOptions, ChartStore, NanPolicy};
use crate::group::Finding;
use pipeline::flow::ChartSource;
use pipeline::geometry::{Rect, Size};
use pipeline::projection::{FilmProjection, Projection};
use serde_json::json;

fn spec() -> SceneSpec {
    SceneSpec {
        size: Size::new(40, 70),
        sheets: 2,
        bases: 3,
        pitch_um: 2.5,
        centre_mm: (0.0, 0.1),
        shard: (16, 64),
        chunk: 16,
        half: false,
        ids: false,
        projection: Projection::Planar,
    }
}

fn attributes() -> Map<String, Value> {
    let Value::Object(map) =
        json!({"provenance": {"job_digest": "j", "layout_digest": "l"}, "focal_mm": 4.0})
    else {
        unreachable!()
    };
    map
}

/// A number of every pixel; hidden planes are 0 but for one pixel.
fn value(shard: SceneShard, y: i64, x: i64) -> f32 {
    match (shard.sheet, shard.plane) {
        (0, Plane::Coverage) => {
            if x < 10 {
                0.25
            } else {
                1.0
            }
        }
        (0, Plane::Depth) => (1 + y) as f32,
        (0, Plane::Weight(b)) => b as f32 + x as f32,
        (0, Plane::Object) => object_bits((x > 3).then_some(x as u32 * 1000)),
        (_, Plane::Weight(_)) if (y, x) == (3, 69) => 7.0,
        _ => 0.0,
    }
}

fn write_all(scene: &SceneStore) {
    for shard in scene.spec().all_shards() {
        let rect = scene.spec().shard_rect(shard.place);
        let pixels: Vec<f32> = (rect.y..rect.bottom())
            .flat_map(|y| (rect.x..rect.right()).map(move |x| (y, x)))
            .map(|(y, x)| value(shard, y, x))
            .collect();
        scene.commit(shard, &|y| &pixels[y * rect.width..][..rect.width]).unwrap();
    }
}

#[test]
fn a_scene_is_created_filled_and_read_as_charts() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("scene.zarr");
    let scene = SceneStore::create(&path, spec(), attributes(), false).unwrap();
    let all: Vec<_> = scene.spec().all_shards().collect();
    // 3 × 2 places, 2 surfaces, 5 planes.
    assert_eq!(all.len(), 60);
    assert_eq!(scene.missing(&all).unwrap(), all);
    write_all(&scene);
    assert!(scene.missing(&all).unwrap().is_empty());
    let again = SceneStore::open(&path, false).unwrap();
    assert_eq!((again.spec(), again.attributes()), (&spec(), &attributes()));
    for shard in all.iter().filter(|shard| shard.place == (0, 0)) {
        let (array, band) = match shard.key().split_once("/c/") {
            Some((array, rest)) => {
                let band = if array.ends_with("weights") {
                    rest.split('/').next().unwrap().parse().unwrap()
                } else {
                    0
                };
                (array.to_owned(), band)
            }
            None => unreachable!(),
        };
        let nm = if array.ends_with("weights") { vec![1.0, 2.0, 3.0] } else { vec![1.0] };
        let options =
            ChartOptions { nan: NanPolicy::Keep, wavelengths_nm: Some(nm), ..ChartOptions::default() };
        let chart = ChartStore::open_at(&path, &array, options).unwrap();
        let rect = Rect::new(0, 0, 40, 70);
        let mut pixels = vec![0.0; 40 * 70];
        chart.read(band, rect, &mut pixels).unwrap();
        for (i, found) in pixels.iter().enumerate() {
            let (y, x) = ((i / 70) as i64, (i % 70) as i64);
            assert_eq!(*found, value(*shard, y, x), "{array} band {band} at {y}, {x}");
        }
    }
    // The last column of the first coverage is 1 everywhere: its chunks are left out.
    let file = |key: &str| std::fs::metadata(path.join(key)).unwrap().len();
    assert!(file("coverage/c/0/1") < 100 && file("coverage/c/0/0") > 100);
    let report = again.verify(2, &|_, _| ()).unwrap();
    assert_eq!((report.shards, report.findings), (60, vec![]));
    SceneStore::remove(&path).unwrap();
    assert!(!path.exists());
}

#[test]
fn damage_is_found_and_repaired() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("scene.zarr");
    let scene = SceneStore::create(&path, spec(), attributes(), false).unwrap();
    write_all(&scene);
    let key = "hidden/1/weights/c/2/0/1";
    let mut bytes = std::fs::read(path.join(key)).unwrap();
    bytes[3] ^= 0x10;
    std::fs::write(path.join(key), bytes).unwrap();
    std::fs::remove_file(path.join("depth/c/2/0")).unwrap();
    std::fs::remove_file(path.join("hidden/1/zarr.json")).unwrap();
    std::fs::write(path.join("y/c/0"), b"nonsense").unwrap();
    let found = scene.verify(1, &|_, _| ()).unwrap().findings;
    let keys: Vec<&str> = found.iter().map(|f| f.fields().1).collect();
    for expected in [key, "depth/c/2/0", "hidden/1/zarr.json", "y/c/0"] {
        assert!(keys.contains(&expected), "{expected}: {keys:?}");
    }
    assert_eq!(found.len(), 4);
    assert!(scene.remove_bad(key).unwrap() && scene.restore("hidden/1/zarr.json").unwrap());
    assert!(scene.restore("y/c/0").unwrap() && !scene.restore("notes.txt").unwrap());
    let left = scene.verify(1, &|_, _| ()).unwrap().findings;
    let missing = |key: &str| Finding::Missing { key: key.into() };
    assert_eq!(left.len(), 2);
    assert!(left.contains(&missing(key)) && left.contains(&missing("depth/c/2/0")));
}

#[test]
fn attributes_that_are_no_layout_are_an_error() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("scene.zarr");
    drop(SceneStore::create(&path, spec(), attributes(), false).unwrap());
    let text = std::fs::read_to_string(path.join("zarr.json")).unwrap();
    for (from, to) in [
        ("\"sheets\": 2", "\"sheets\": 9"),
        ("\"bases\": 3", "\"bases\": 0"),
        ("\"chunk\": 16", "\"chunk\": 0"),
    ] {
        assert!(text.contains(from), "{from}");
        std::fs::write(path.join("zarr.json"), text.replace(from, to)).unwrap();
        assert!(matches!(SceneStore::open(&path, false), Err(GroupError::Damaged { .. })), "{to}");
    }
}

/// The projection of a film is kept bit for bit, a planar scene has no attribute of it, and one whose angles do not ascend is damaged.
#[test]
fn the_projection_of_a_film_is_kept() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("scene.zarr");
    let coefficients = std::array::from_fn(|k| if k == 0 { 0.1 / 0.3 } else { 1e-3 / (k * k) as f64 });
    let film = FilmProjection { focal_mm: 3.1, radius_mm: 2.7, coefficients };
    let spec = SceneSpec { projection: Projection::Film(film), ..spec() };
    drop(SceneStore::create(&path, spec.clone(), attributes(), false).unwrap());
    let again = SceneStore::open(&path, false).unwrap();
    assert_eq!(again.spec(), &spec);
    assert!(!again.attributes().contains_key("film_projection"));
    drop(again);
    let text = std::fs::read_to_string(path.join("zarr.json")).unwrap();
    let group: Value = serde_json::from_str(&text).unwrap();
    let of = &group["attributes"]["film_projection"];
    assert_eq!((of["focal_mm"].as_f64(), of["coefficients"].as_array().map(Vec::len)), (Some(3.1), Some(20)));
    let coordinate = std::fs::read_to_string(path.join("x/zarr.json")).unwrap();
    assert!(coordinate.contains("on the film at the primary wavelength"));
    for (from, to) in [("\"radius_mm\": 2.7", "\"radius_mm\": -2.7"), ("0.3333333333333333", "-0.5")] {
        assert!(text.contains(from), "{from}");
        std::fs::write(path.join("zarr.json"), text.replacen(from, to, 1)).unwrap();
        assert!(matches!(SceneStore::open(&path, false), Err(GroupError::Damaged { .. })), "{to}");
    }
    let planar = directory.path().join("planar.zarr");
    let planar_spec = SceneSpec { projection: Projection::Planar, ..spec };
    drop(SceneStore::create(&planar, planar_spec, attributes(), false).unwrap());
    assert!(!std::fs::read_to_string(planar.join("zarr.json")).unwrap().contains("projection"));
}

/// Weights of 16 bits are those of 32 rounded; numbers of objects are those of u32, as other programs read them.
#[test]
fn weights_may_have_16_bits_and_objects_numbers() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("scene.zarr");
    let spec = SceneSpec { half: true, ids: true, ..spec() };
    let scene = SceneStore::create(&path, spec.clone(), attributes(), false).unwrap();
    // One more plane of the first surface at 3 × 2 places.
    assert_eq!(scene.spec().all_shards().count(), 66);
    assert_eq!(scene.spec().bytes(), (2 * (3 * 2 + 8) + 4) * 40 * 70);
    write_all(&scene);
    let again = SceneStore::open(&path, false).unwrap();
    assert_eq!(again.spec(), &spec);
    assert_eq!(again.verify(1, &|_, _| ()).unwrap().findings, vec![]);
    let nm = Some(vec![1.0, 2.0, 3.0]);
    let options = ChartOptions { nan: NanPolicy::Keep, wavelengths_nm: nm, ..ChartOptions::default() };
    let chart = ChartStore::open_at(&path, "weights", options).unwrap();
    let mut pixels = vec![0.0; 40 * 70];
    chart.read(2, Rect::new(0, 0, 40, 70), &mut pixels).unwrap();
    assert!(pixels.iter().enumerate().all(|(i, v)| *v == 2.0 + (i % 70) as f32));
    let store = std::sync::Arc::new(zarrs::filesystem::FilesystemStore::new(&path).unwrap());
    let array = zarrs::array::Array::open(store, "/object").unwrap();
    assert_eq!(array.data_type(), &zarrs::array::data_type::uint32());
    let objects: Vec<u32> = array.retrieve_array_subset(&array.subset_all()).unwrap();
    let number = |x: u32| if x > 3 { x * 1000 + 1 } else { 0 };
    assert!(objects.iter().zip(0..).all(|(found, i)| *found == number(i % 70)));
    assert_eq!(object_bits(Some(u32::MAX)).to_bits(), f32::MAX.to_bits());
    // A weight beyond 16 bits is refused.
    let shard = SceneShard { place: (0, 0), sheet: 0, plane: Plane::Weight(0) };
    let large = vec![70_000.0; 64];
    assert!(matches!(scene.commit(shard, &|_| &large), Err(GroupError::Codec { .. })));
    SceneStore::remove(&path).unwrap();
}
