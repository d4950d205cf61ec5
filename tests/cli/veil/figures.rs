//! Figures of `lenscube measure`: the veiling glare index of films and raws, the flare of a lamp.

use super::*;

/// The chart of black spots, measured in its middle spot and beside it.
#[test]
fn index_of_black_spots_is_measured() {
    let scene = Scene::new(Size::new(8, 8), |_, _| 1.0);
    let film = scene.dir.path().join("spots.zarr");
    let chart = "gen:black-spots?size=360&diameter=10%&wavelengths=450&pitch_um=2&overscan=0";
    let flags = ["--stages", "ri,distortion", "--veiling-glare", "2%", "--outside", "clamp"];
    run(chart, &film, text(&scene.pack), &flags).ok();
    let json = scene.dir.path().join("index.json");
    let areas = ["--glare", "172,172,16,16", "--white-area", "230,172,16,16", "--json", text(&json)];
    let measured = lenscube(&[&["measure", text(&film)], &areas[..]].concat()).ok().stdout;
    assert!(measured.contains("450 nm: veiling glare index 1.8") && measured.contains(" dB)"), "{measured}");
    let json: serde_json::Value = serde_json::from_slice(&fs::read(json).unwrap()).unwrap();
    let index = json["bands"][0]["figures"]["veiling_glare_index"].as_f64().unwrap();
    // Nine discs with a diameter of 36 px.
    let share = 9.0 * std::f64::consts::PI * 18.0 * 18.0 / (360.0 * 360.0);
    let expected = 0.02 * (1.0 - share) / (1.0 - 0.02 * share);
    assert!((index / expected - 1.0).abs() < 1e-5, "{index} {expected}");
    let alone = lenscube(&["measure", text(&film), "--glare", "172,172,16,16"]);
    assert_exit(&alone, 2, &["--white-area"]);
    let outside = ["measure", text(&film), "--glare", "172,172,16,16", "--white-area", "350,0,16,16"];
    assert_exit(&lenscube(&outside), 2, &["the white area", "360x360"]);
}

/// A raw is measured in electrons without black level and dark signal: its index is that of its film, whose bands are all alike.
#[test]
fn index_of_a_raw_is_that_of_its_film() {
    let dir = tempfile::tempdir().unwrap();
    let (keep, out) = (dir.path().join("shot"), dir.path().join("shot.png"));
    let chart = "gen:black-spots?size=400&wavelengths=450:650:50&spots=1&diameter=40%";
    let words = ["shoot", chart, text(&out), "--lens", "double-gauss-28-npz", "--sensor", "example-2um"];
    let flags = ["--keep", text(&keep), "--veiling-glare", "5%", "--memory", "1GiB"];
    lenscube(&[&words[..], &flags].concat()).ok();
    let areas = ["--glare", "180,180,40,40", "--white-area", "5,5,30,30"];
    let index = |name: &str, key: &str| -> Vec<(String, f64)> {
        let json = dir.path().join(format!("{name}.json"));
        let path = keep.join(name);
        lenscube(&[&["measure", text(&path), "--json", text(&json)], &areas[..]].concat()).ok();
        let json: serde_json::Value = serde_json::from_slice(&fs::read(json).unwrap()).unwrap();
        let one = |band: &serde_json::Value| {
            (band[key].to_string(), band["figures"]["veiling_glare_index"].as_f64().unwrap())
        };
        json["bands"].as_array().unwrap().iter().map(one).collect()
    };
    let film = index("film.zarr", "wavelength_nm");
    let raw = index("raw.zarr", "plane");
    assert_eq!(raw.iter().map(|(plane, _)| &**plane).collect::<Vec<_>>(), ["\"R\"", "\"G\"", "\"B\""]);
    let expected = film.iter().map(|(_, index)| index).sum::<f64>() / film.len() as f64;
    assert!(film.iter().all(|(_, index)| (index / expected - 1.0).abs() < 1e-2), "{film:?}");
    assert!(raw.iter().all(|(_, index)| (index / expected - 1.0).abs() < 0.03), "{raw:?} {expected}");
    let path = keep.join("raw.zarr");
    let tiny = ["measure", text(&path), "--glare", "180,180,40,40", "--white-area", "5,5,1,1"];
    assert_exit(&lenscube(&tiny), 2, &["the white area", "no pixel of this colour"]);
    let frame = [&["measure", text(&path), "--frame", "1"], &areas[..]].concat();
    assert_exit(&lenscube(&frame), 2, &["--frame 1"]);
}

/// Glare of a lamp on a dark ground: everywhere the same share of the light of the film, so all percentiles are one value, and the light outside over that inside follows from it.
#[test]
fn flare_of_a_lamp_with_glare_has_its_closed_form() {
    let scene = Scene::new(Size::new(8, 8), |_, _| 1.0);
    let at = |name: &str| scene.dir.path().join(name);
    let (film, json, csv) = (at("lamp.zarr"), at("flare.json"), at("flare.csv"));
    // Radius 20.5 px about pixel (150, 140).
    let chart = "gen:lamp?size=304&radius=20.5&x=140&y=150&wavelengths=450&pitch_um=2&overscan=0";
    let flags = ["--stages", "ri,distortion", "--veiling-glare", "1%", "--outside", "clamp"];
    run(chart, &film, text(&scene.pack), &flags).ok();
    let (map, plot) = (at("map.png"), at("flare.svg"));
    let words = ["measure", text(&film), "--flare", "140,150,22", "--json", text(&json), "--csv", text(&csv)];
    let outputs = ["--map", text(&map), "--plot", text(&plot)];
    let measured = lenscube(&[&words[..], &outputs].concat()).ok().stdout;
    assert!(
        measured.contains("450 nm: normalised flare of the lamp") && measured.contains(" dB)"),
        "{measured}"
    );
    let json: serde_json::Value = serde_json::from_slice(&fs::read(json).unwrap()).unwrap();
    let figures = &json["bands"][0]["figures"];
    // Light of 1 in the lamp of area π r² = s of the film: 0.99 + 0.01 s in it; within 22 px are n pixels of which π r² have the lamp.
    let share = std::f64::consts::PI * 20.5 * 20.5 / (304.0 * 304.0);
    let place = |i: usize| ((i / 304) as f64, (i % 304) as f64);
    let inside = (0..304 * 304).map(place).filter(|(y, x)| (y - 150.0).hypot(x - 140.0) <= 22.0);
    let n = inside.count() as f64;
    let lamp = 0.01 * share + 0.99 * share * 304.0 * 304.0 / n;
    // The ground has a millionth of the lamp's light.
    let beside = 0.01 * share + 0.99e-6;
    for percentile in ["p50", "p95", "p99_9"] {
        let found = figures["normalised_flare"][percentile].as_f64().unwrap();
        assert!((found / (beside / lamp) - 1.0).abs() < 5e-4, "{percentile}: {found} {}", beside / lamp);
    }
    let outside = beside * (304.0 * 304.0 - n) / (lamp * n);
    let found = figures["outside_over_inside"].as_f64().unwrap();
    assert!((found / outside - 1.0).abs() < 1e-3, "{found} {outside}");
    let profile = fs::read_to_string(csv).unwrap();
    assert!(profile.starts_with("wavelength_nm,distance_px,normalised_flare\n450,0.500000,"), "{profile}");
    assert!(
        fs::read(map).unwrap().starts_with(b"\x89PNG")
            && fs::read_to_string(plot).unwrap().contains("normalised flare (dB)")
    );
    for (flags, texts) in [
        (&["--flare", "5,150,22"][..], &["--flare", "is not inside the image of 304x304"][..]),
        (&["--flare", "140,150,0.5"], &["--flare", "the radius"]),
        (&["--flare", "140,150,22", "--map", "map.svg"], &["--map", ".png"]),
        (&["--points", "140,150", "--map", "map.png"], &["--map", "--points"]),
        (&["--flare", "140,150,22", "--frame", "1"], &["--frame", "not a raw"]),
    ] {
        assert_exit(&lenscube(&[&["measure", text(&film)], flags].concat()), 2, texts);
    }
}
