//! Raws: their development and their mosaic.

use super::*;
use crate::common::camera::{Place, develop, frame};
use formats::chart::image::{ImageFile, Transfer};

/// A raw: its development has the pixels of `lenscube develop`, its mosaic those of the store, with and without levels.
#[test]
fn raw_is_shown_developed_and_as_its_mosaic() {
    let place = Place::new();
    let film = place.noise(Size::new(600, 700));
    let flags = ["--sensor", "example-2um", "--exposure", "5ms,20ms", "--keep-signal"];
    let raw = place.raw("raw.zarr", &film, &flags);
    let (mosaic, (signal_size, signal)) = (frame(&raw, "raw", 1), pixels(&raw, "signal"));
    let bare = Server::start(&[text(&raw)]);
    let tiles = ["0/0_1.png?frame=1&white=A", "1/1_0.png?frame=0&mosaic=1", "2/0_0.png?frame=1&white=D65"];
    let tile = |server: &Server, tile: &str| server.body(&format!("/tile/film/{tile}&exposure=1&gamma=1.3"));
    let computed = tiles.map(|t| tile(&bare, t));
    drop(bare);
    lenscube(&["pyramid", text(&raw)]).ok();
    let server = Server::start(&[text(&raw)]);
    let content = server.get_text("/api/content");
    for part in [
        r#""sensor":"example-2um""#,
        r#""pyramid":"complete""#,
        r#""exposure_s":[0.005,0.02]"#,
        r#""levels":3"#,
    ] {
        assert!(content.contains(part), "{part}: {content}");
    }
    assert!(computed == tiles.map(|t| tile(&server, t)));
    // A crop of the development, and the same pixels by `develop`.
    let own = server.body("/crop.png?x=30&y=41&w=300&h=200&frame=1&white=D65&exposure=1&gamma=1");
    let (ours, theirs) = (place.at("own.png"), place.at("develop.png"));
    std::fs::write(&ours, own).unwrap();
    develop(&raw, &theirs, &["--frame", "1", "--white", "D65", "--crop", "30,41,300,200"]).ok();
    assert!(colours(&ours) == colours(&theirs));
    for (x, y) in [(0, 0), (699, 599), (123, 77)] {
        let body = server.body(&format!("/api/pixel?x={x}&y={y}&frame=1&white=D65"));
        let reading: Value = serde_json::from_slice(&body).unwrap();
        let dn = f64::from(mosaic.1[y * 700 + x]);
        let found = &reading["raw"]["frames"][1];
        assert_eq!(found["dn"].as_f64().unwrap(), dn);
        assert!((found["electrons"].as_f64().unwrap() - (dn - 256.0) / 0.28).abs() < 1e-9, "{found}");
        let light = 0.02 * f64::from(signal[0][y * signal_size.width + x]);
        assert!((found["signal_e"].as_f64().unwrap() - light).abs() < 1e-9 * light, "{found}");
        assert_eq!(reading["raw"]["filter"], ["R", "G", "G", "B"][y % 2 * 2 + x % 2]);
        assert_eq!(reading["developed"].as_array().unwrap().len(), 3);
    }
    for bad in ["frame=2&white=D65", "white=D65", "frame=0&white=D50", "band=0"] {
        assert_eq!(server.get(&format!("/tile/film/0/0_0.png?{bad}&exposure=1&gamma=1")).0, 400, "{bad}");
    }
    assert_eq!(server.get("/api/lens?x=1&y=1&band=0").0, 404);
    let ran = lenscube(&["view", text(&raw), "--lens", "double-gauss-28"]);
    assert!(ran.code == 2 && ran.stderr.contains("--lens is for films"), "{}", ran.stderr);
    std::fs::remove_file(raw.join("raw/c/1/0/0")).unwrap();
    let ran = lenscube(&["view", text(&raw)]);
    assert!(ran.code == 1 && ran.stderr.contains("1 of 1 shards of frame 1 are missing"), "{}", ran.stderr);
}

#[test]
fn raw_of_few_rows_is_shown_without_smaller_levels() {
    let place = Place::new();
    for (rows, levels, developed) in [(1, 1, 404), (3, 2, 200)] {
        let film = place.film_named(&format!("{rows}.film"), Size::new(rows, 700), |_, _, _| 1e-3);
        let raw = place.raw(&format!("{rows}.raw"), &film, &["--sensor", "example-2um", "--exposure", "5ms"]);
        let server = Server::start(&[text(&raw)]);
        assert!(server.get_text("/api/content").contains(&format!(r#""levels":{levels},"#)));
        server.body("/api/pixel?x=1&y=0&frame=0&white=D65");
        let tile =
            |mode: &str| server.get(&format!("/tile/film/0/0_0.png?frame=0&{mode}&exposure=1&gamma=1"));
        assert_eq!((tile("mosaic=1").0, tile("white=D65").0), (200, developed));
    }
}

/// Linear channels of a picture.
fn colours(path: &std::path::Path) -> Vec<Vec<f32>> {
    let file = ImageFile::open(path).unwrap();
    let size = file.size();
    let source = file.linear(Transfer::Linear, path.parent().unwrap(), 2, &|_, _| ()).unwrap();
    let read = |c| {
        let mut pixels = vec![0.0; size.pixels()];
        source.read(c, size.rect(), &mut pixels).unwrap();
        pixels
    };
    (0..3).map(read).collect()
}
