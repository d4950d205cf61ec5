//! Layers of light beside the shards.

use super::*;
use crate::film::FilmLayer;
use serde_json::json;

/// A veil in bins of 16 px, and tails in bins of 4 and 8 px.
fn spec_with_layers() -> FilmSpec {
    let layer = |name: &str, bin_px: Vec<usize>, margin_bins| FilmLayer {
        name: name.into(),
        bin_px,
        margin_bins,
        share_taken: vec![0.03, 0.031],
        parts: json!({"scatter": 0.03}).as_object().unwrap().clone(),
    };
    FilmSpec { layers: vec![layer("veil_tail", vec![4, 8], 3), layer("veil", vec![16, 16], 2)], ..spec() }
}

fn coefficients(film: &FilmStore, layer: usize, band: usize) -> Vec<f32> {
    let bins = film.spec().layer_grid(layer, band).size().pixels();
    (0..bins).map(|i| (layer * 10 + band) as f32 + i as f32 / 4096.0).collect()
}

const CHUNKS: [(usize, usize); 4] = [(0, 0), (0, 1), (1, 0), (1, 1)];

/// The film with all layers and shards.
fn film_at(path: &Path) -> FilmStore {
    let film = FilmStore::create(path, spec_with_layers(), provenance(), false).unwrap();
    for (layer, band) in CHUNKS {
        assert_eq!(film.read_layer(layer, band).unwrap(), None);
        film.commit(&film.encode_layer(layer, band, &coefficients(&film, layer, band))).unwrap();
    }
    fill(&film);
    film
}

#[test]
fn layers_are_read_as_they_were_written() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("film.zarr");
    let film = film_at(&path);
    let reopened = FilmStore::open(&path, false).unwrap();
    assert_eq!(reopened.spec(), film.spec());
    for (layer, band) in CHUNKS {
        assert_eq!(reopened.read_layer(layer, band).unwrap(), Some(coefficients(&film, layer, band)));
    }
    // Other programs read the array: 10 + 4 rows and 7 + 4 columns of bins of 16 px of a film of 150 x 100 px.
    let metadata: Value =
        serde_json::from_slice(&std::fs::read(path.join("veil/zarr.json")).unwrap()).unwrap();
    assert_eq!((&metadata["shape"], &metadata["data_type"]), (&json!([2, 14, 11]), &json!("float32")));
    let attributes = &metadata["attributes"];
    assert_eq!((&attributes["bin_px"], &attributes["first_pixel"]), (&json!(16), &json!([-32, -32])));
    assert_eq!((&attributes["margin_bins"], &attributes["share_taken"]), (&json!(2), &json!([0.03, 0.031])));
    let metadata: Value =
        serde_json::from_slice(&std::fs::read(path.join("veil_tail/zarr.json")).unwrap()).unwrap();
    assert_eq!(metadata["shape"], json!([2, 38 + 6, 25 + 6]));
    assert_eq!(metadata["attributes"]["first_pixel"], json!([[-12, -12], [-24, -24]]));
    // The film itself is opened as before.
    check(&path, "film", Rect::new(0, 0, 150, 100), false);
    FilmStore::remove(&path).unwrap();
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn verification_finds_every_flipped_byte_and_repair_removes_the_shards_of_the_band() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("film.zarr");
    let film = film_at(&path);
    let intact = film.verify(2, &|_, _| ()).unwrap();
    assert!(intact.findings.is_empty(), "{intact:?}");
    let key = "veil/c/1/0/0";
    let good = std::fs::read(path.join(key)).unwrap();
    for k in (0..good.len()).step_by(37) {
        let mut bad = good.clone();
        bad[k] ^= 0x10;
        std::fs::write(path.join(key), &bad).unwrap();
        let found = film.verify(1, &|_, _| ()).unwrap().findings;
        assert!(matches!(&found[..], [Finding::Bad { key: k, .. }] if k == key), "{k}: {found:?}");
        let error = film.read_layer(1, 1).unwrap_err().to_string();
        assert!(error.contains(key) && error.contains("verify") && error.contains("--repair"), "{error}");
    }
    std::fs::write(path.join(key), &good[..9]).unwrap();
    assert!(film.remove_bad(key).unwrap() && !path.join(key).exists());
    let found = film.verify(1, &|_, _| ()).unwrap().findings;
    // The six shards of band 1; those of band 0 and its layer stay.
    assert_eq!(found.len(), 6, "{found:?}");
    assert!(found.iter().all(|f| matches!(f, Finding::Missing { key } if key.starts_with("film/c/1/"))));
    assert!(!film.remove_bad("veil/c/0/0/0").unwrap());
}

#[test]
fn layer_is_missed_only_beside_shards_of_its_band() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("film.zarr");
    let film = film_at(&path);
    for shard in film.all_shards().filter(|(_, band, _)| *band == 0).collect::<Vec<_>>() {
        film.remove_shard(shard.0, shard.1, shard.2).unwrap();
    }
    for band in 0..2 {
        std::fs::remove_file(path.join(format!("veil_tail/c/{band}/0/0"))).unwrap();
    }
    let found = film.verify(1, &|_, _| ()).unwrap().findings;
    let bad: Vec<_> = found.iter().filter(|f| matches!(f, Finding::Bad { .. })).collect();
    assert!(matches!(&bad[..], [Finding::Bad { key, .. }] if key == "veil_tail/c/1/0/0"), "{bad:?}");
    assert_eq!(found.len(), 6 + 1);
}

#[test]
fn chunk_with_a_value_that_is_not_finite_is_bad() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("film.zarr");
    let film = film_at(&path);
    let mut values = coefficients(&film, 0, 1);
    values[7] = f32::INFINITY;
    film.commit(&film.encode_layer(0, 1, &values)).unwrap();
    let found = film.verify(1, &|_, _| ()).unwrap().findings;
    assert!(format!("{found:?}").contains("inf at bin row 0, column 7"), "{found:?}");
}

#[test]
fn layers_that_do_not_fit_the_film_are_rejected() {
    type Change<'a> = &'a dyn Fn(&mut Vec<FilmLayer>);
    let with = |change: Change<'_>| {
        let mut spec = spec_with_layers();
        change(&mut spec.layers);
        spec.check()
    };
    assert!(with(&|_| ()).is_ok());
    let cases: [Change<'_>; 6] = [
        &|layers| layers[0].name = "film".into(),
        &|layers| layers[0].name = "veil".into(),
        &|layers| layers[1].bin_px[1] = 12,
        &|layers| layers[1].margin_bins = 1,
        &|layers| layers[1].bin_px.truncate(1),
        &|layers| layers[1].share_taken[0] = 1.5,
    ];
    for case in cases {
        assert!(with(case).is_err());
    }
}
