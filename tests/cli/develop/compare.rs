//! `lenscube compare`: two raws under the same noise.

use super::{OTHER_JOB, USAGE};
use crate::common::camera::{LENS, Place};
use crate::common::{assert_exit, lenscube, text, write_npy_of};
use pipeline::geometry::Size;
use std::path::Path;

#[test]
fn comparison_of_raws_finds_what_differs() {
    let place = Place::new();
    let chart = "gen:slanted-edge?size=240&pitch_um=2&wavelengths=450,550,650&angle_deg=5";
    let (sharp, blurred) = (place.at("sharp.film"), place.at("blurred.film"));
    crate::common::run(chart, &sharp, LENS, &["--stages", "ri"]).ok();
    crate::common::run(chart, &blurred, LENS, &[]).ok();
    let flags = ["--sensor", "example-2um", "--exposure", "5ms", "--seed", "3"];
    let (a, b) = (place.raw("a.zarr", &sharp, &flags), place.raw("b.zarr", &blurred, &flags));
    let compare = |a: &Path, b: &Path, out: &Path, more: &[&str]| {
        lenscube(&[&["compare", text(a), text(b), "--out", text(out)], more].concat())
    };
    let edge = ["--edge", "114,60,125,180", "--patch", "10,10,50,50", "--patch", "180,180,50,50"];
    let out = place.at("out");
    let ran = compare(&a, &b, &out, &edge).ok();
    assert!(ran.stderr.contains("same seed, die and noises"), "{}", ran.stderr);
    for file in [
        "report.html",
        "difference.png",
        "figures.png",
        "regions.csv",
        "mtf.csv",
        "patches.csv",
        "compare.json",
    ] {
        assert!(std::fs::metadata(out.join(file)).unwrap().len() > 100, "{file}");
    }
    let all: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("compare.json")).unwrap()).unwrap();
    let mtf50 = |curve: usize, raw: &str| all["edges"][0]["curves"][curve][raw]["mtf50_cy_px"].as_f64();
    // Luminance and the green plane: the lens lowers the MTF.
    for (curve, name) in [(0, "luminance"), (2, "G")] {
        assert_eq!(all["edges"][0]["curves"][curve]["name"], name);
        let (before, after) = (mtf50(curve, "a").unwrap_or(1.0), mtf50(curve, "b").unwrap());
        assert!(after < 0.95 * before, "{name}: {before} {after}");
    }
    // Away from the edge the films are equal, and so is the noise: the difference is far below what independent noise would give.
    let region = all["regions"].as_array().unwrap().iter().find(|r| r["plane"] == "G").unwrap();
    let (sigma, equivalent) = (&region["difference_sigma_e"], &region["noise_equivalent_difference_e"]);
    assert!(sigma.as_f64().unwrap() < 0.2 * equivalent.as_f64().unwrap(), "{region}");
    assert!(all["patches"][0]["delta_e_2000"].as_f64().unwrap() < 0.5);
    // A raw against itself: nothing differs. Against another seed: independent noise.
    compare(&a, &a, &place.at("same"), &[]).ok();
    let same: serde_json::Value =
        serde_json::from_slice(&std::fs::read(place.at("same/compare.json")).unwrap()).unwrap();
    assert!(same["regions"].as_array().unwrap().iter().all(|r| r["difference_sigma_e"] == 0.0));
    let other = place.raw("c.zarr", &sharp, &["--sensor", "example-2um", "--exposure", "5ms", "--seed", "4"]);
    let ran = compare(&a, &other, &place.at("noise"), &["--grid", "1", "--threads", "1"]).ok();
    assert!(ran.stderr.contains("noise of both"), "{}", ran.stderr);
    let noise: serde_json::Value =
        serde_json::from_slice(&std::fs::read(place.at("noise/compare.json")).unwrap()).unwrap();
    let green = noise["regions"].as_array().unwrap().iter().find(|r| r["plane"] == "G").unwrap().clone();
    let number = |key: &str| green[key].as_f64().unwrap();
    // PRNU and the other patterns of the die are common; shot noise dominates.
    let ratio = number("difference_sigma_e") / number("noise_equivalent_difference_e");
    assert!((0.85..1.02).contains(&ratio), "{ratio}");
    assert_exit(&compare(&a, &b, &out, &[]), OTHER_JOB, &["--overwrite"]);
    // A comparison that replaces another leaves none of its tables.
    compare(&a, &b, &out, &["--overwrite"]).ok();
    assert!(out.join("report.html").exists());
    assert!(!out.join("mtf.csv").exists() && !out.join("patches.csv").exists());
    let small = place.raw("small.zarr", &sharp, &[&flags[..], &["--size", "100"]].concat());
    assert_exit(&compare(&a, &small, &place.at("no"), &[]), USAGE, &["pixels differ"]);
    assert_exit(&compare(&a, &b, &place.at("no"), &["--edge", "1,1,5,200"]), USAGE, &["not inside the raw"]);
    assert_exit(&compare(&a, &b, &place.at("no"), &["--patch", "200,200,50,50"]), USAGE, &["not inside"]);
    assert!(!place.at("no").exists());
}

/// Uniform light on pixels of 2 and 4 µm with shot noise alone: four times the charge, twice the SNR, the same SNR of an area.
#[test]
fn raws_of_different_sensors_are_measured_side_by_side() {
    let place = Place::new();
    let film = place.film_named("u.film", Size::new(300, 400), |_, _, _| 1e-3);
    let flags = ["--sensor", "ideal-mono", "--exposure", "1ms", "--noise", "shot"];
    let raw = |name: &str, pitch: &str, size: &str| {
        place.raw(name, &film, &[&flags[..], &["--set", pitch, "--size", size]].concat())
    };
    let (a, b) = (raw("a.zarr", "pixel.pitch_um=2", "300x200"), raw("b.zarr", "pixel.pitch_um=4", "180x140"));
    let out = place.at("out");
    let words = ["compare", text(&a), text(&b), "--out", text(&out), "--grid", "3"];
    let ran = lenscube(&words).ok();
    assert!(ran.stderr.contains("of different sensors: each is measured by itself"), "{}", ran.stderr);
    let all: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("compare.json")).unwrap()).unwrap();
    // The part that both see: that of the smaller one in each direction, in mm.
    assert_eq!(all["common_mm"]["x"], serde_json::json!([-0.3, 0.3]));
    assert_eq!(all["common_mm"]["y"], serde_json::json!([-0.2, 0.2]));
    let cells = all["cells"].as_array().unwrap();
    assert_eq!(cells.len(), 2 * 9);
    for (a, b) in cells[..9].iter().zip(&cells[9..]) {
        let number = |cell: &serde_json::Value, key: &str| cell[key].as_f64().unwrap();
        assert!(a["raw"] == "A" && b["raw"] == "B" && a["middle_mm"] == b["middle_mm"], "{a} {b}");
        assert!((number(b, "mean_e") / number(a, "mean_e") - 4.0).abs() < 0.02, "{a} {b}");
        assert!((number(b, "snr_db") - number(a, "snr_db") - 20.0 * 2f64.log10()).abs() < 0.05, "{a} {b}");
        assert!((number(b, "snr_of_100_um2_db") - number(a, "snr_of_100_um2_db")).abs() < 0.05, "{a} {b}");
        let area_db = 10.0 * (100.0 / 4.0_f64).log10();
        assert!((number(a, "snr_of_100_um2_db") - number(a, "snr_db") - area_db).abs() < 1e-9, "{a}");
    }
    assert!(!out.join("difference.png").exists() && out.join("report.html").exists());
    assert_exit(
        &lenscube(&[&words[..], &["--overwrite", "--edge", "1,1,9,90"]].concat()),
        USAGE,
        &["--edge", "no pixels in common"],
    );
    let away = place.raw(
        "c.zarr",
        &film,
        &[&flags[..], &["--set", "pixel.pitch_um=3", "--size", "20", "--center", "0.35,0"]].concat(),
    );
    assert_exit(
        &lenscube(&["compare", text(&a), text(&away), "--out", text(&place.at("no"))]),
        USAGE,
        &["a common part"],
    );
    assert!(!place.at("no").exists());
}

#[test]
fn edges_that_measure_refuses_are_not_compared() {
    let place = Place::new();
    let film = place.film_named("u.film", Size::new(300, 300), |_, _, _| 1e-3);
    let flags = ["--sensor", "example-2um", "--exposure", "5ms"];
    let raws =
        ["1", "2"].map(|s| place.raw(&format!("{s}.zarr"), &film, &[&flags[..], &["--seed", s]].concat()));
    let compare = |edge: &str| {
        let words = ["compare", text(&raws[0]), text(&raws[1]), "--out"];
        lenscube(&[&words[..], &[text(&place.at("no")), "--edge", edge]].concat())
    };
    for edge in ["150,100,155,180", "100,100,105,180"] {
        assert_exit(&compare(edge), USAGE, &["--edge", edge]);
    }
    assert_exit(&compare("150,100,151,105"), USAGE, &["5.1 px apart"]);
    assert!(!place.at("no").exists());
}

#[test]
fn other_noise_is_named_and_another_place_is_refused() {
    let place = Place::new();
    let film = place.film_named("u.film", Size::new(60, 60), |_, _, _| 1e-3);
    let flags = ["--sensor", "example-2um", "--exposure", "5ms"];
    let raw = |name: &str, more: &[&str]| place.raw(name, &film, &[&flags[..], more].concat());
    let a = raw("a.zarr", &["--size", "30"]);
    let compare = |b: &Path, out: &str| {
        lenscube(&["compare", text(&a), text(b), "--out", text(&place.at(out)), "--grid", "1"])
    };
    for (name, more, differ) in [
        ("noisy", &["--set", "noise.read_noise_e=200"][..], "differ in sensor electronics: "),
        ("warm", &["--temperature", "60"], "differ in temperature: "),
        ("gain", &["--gain", "2", "--seed", "2"], "differ in seed, gain: "),
    ] {
        let b = raw(name, &[&["--size", "30"], more].concat());
        let ran = compare(&b, &format!("{name}.out")).ok();
        assert!(ran.stderr.contains(differ), "{}", ran.stderr);
    }
    let moved = raw("moved.zarr", &["--size", "30", "--center", "0.02,0"]);
    assert_exit(&compare(&moved, "no"), USAGE, &["middles in mm"]);
}

/// Uniform films of 0.5 and 0.6: a difference of 0.1 everywhere, a fifth of the first, in the bands that both have.
#[test]
fn films_are_compared_band_by_band() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let compare = |a: &str, b: &str, out: &Path, more: &[&str]| {
        lenscube(&[&["compare", a, b, "--out", text(out)], more].concat())
    };
    let json = |out: &Path| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(out.join("compare.json")).unwrap()).unwrap()
    };
    let uniform = |value: f64, nm: &str| {
        format!("gen:uniform?size=90&overscan=0&pitch_um=2&value={value}&wavelengths={nm}")
    };
    let (a, b) = (uniform(0.5, "450,550,650"), uniform(0.6, "550,650,700"));
    let ran = compare(&a, &b, &at("out"), &["--grid", "2"]).ok();
    assert!(ran.stderr.contains("2 bands that only one of the films has"), "{}", ran.stderr);
    assert!(ran.stdout.contains("550 nm: mean 0.5 and 0.6, difference 0.1"), "{}", ran.stdout);
    let all = json(&at("out"));
    assert_eq!(all["bands"].as_array().unwrap().len(), 2);
    let close = |value: &serde_json::Value, expected: f64| (value.as_f64().unwrap() - expected).abs() < 1e-7;
    for band in all["bands"].as_array().unwrap() {
        assert!(close(&band["difference_mean"], 0.1) && close(&band["difference_rms"], 0.1), "{band}");
        assert!(
            close(&band["difference_rms_share"], 0.2) && close(&band["difference_largest"], 0.1),
            "{band}"
        );
        assert!(
            close(&band["regions"][3]["mean"][1], 0.6) && band["regions"][3]["region"][0] == 45,
            "{band}"
        );
    }
    assert_eq!(std::fs::read_to_string(at("out/regions.csv")).unwrap().lines().count(), 1 + 2 * 4);
    for file in ["report.html", "difference.png", "figures.png"] {
        assert!(std::fs::metadata(at("out").join(file)).unwrap().len() > 100, "{file}");
    }
    // The film of an edge without and with PSFs: the lens lowers the MTF, as `lenscube measure` says of each.
    let chart = "gen:slanted-edge?size=240&pitch_um=2&wavelengths=550&angle_deg=5";
    let (sharp, film) = (at("sharp"), at("film"));
    crate::common::run(chart, &sharp, LENS, &["--stages", "ri"]).ok();
    crate::common::run(chart, &film, LENS, &[]).ok();
    let ran = compare(text(&sharp), text(&film), &at("edge"), &["--edge", "114,60,125,180"]);
    let edge = &json(&at("edge"))["edges"][0]["bands"][0];
    let measured = lenscube(&["measure", text(&film), "--edge", "114,60,125,180"]).ok();
    let mtf50 = edge["b"]["figures"]["mtf50_cy_px"].as_f64().unwrap();
    assert!(measured.stdout.contains(&format!("MTF50 {mtf50:.4} cycles/px")), "{}", measured.stdout);
    assert!(edge["a"]["figures"]["mtf50_cy_px"].as_f64().is_none_or(|sharp| sharp > mtf50), "{}", ran.stdout);
    // The files of an earlier comparison that this one lacks are removed.
    compare(&a, &a, &at("edge"), &["--overwrite"]).ok();
    assert!(!at("edge/mtf.csv").exists() && json(&at("edge"))["bands"][0]["difference_rms"] == 0.0);
    for (a, b, flags, words) in [
        (&a, &uniform(0.5, "400"), &[][..], &["no band of one is in the other"][..]),
        (&a, &a.replace("size=90", "size=91"), &["--edge", "9,9,60,60"], &["--edge", "90x90 px", "91x91 px"]),
        (&a, &a, &["--patch", "1,1,5,5"], &["--patch", "raws"]),
        (&a, &a, &["--edge", "10,10,60,60"], &["--edge 10,10,60,60"]),
    ] {
        assert_exit(&compare(a, b, &at("never"), flags), USAGE, words);
    }
    assert!(!at("never").exists());
}

/// Of a film of pixels of 2 µm about another place of the axis, and of 4 µm: the means over the pixels of the coarser one, of the part that both have.
#[test]
fn films_of_other_pixels_are_compared_at_common_ones() {
    let place = Place::new();
    let chart = "gen:slanted-edge?size=240&pitch_um=2&wavelengths=550&angle_deg=5";
    let (fine, coarse) = (place.at("fine"), place.at("coarse"));
    crate::common::run(
        chart,
        &fine,
        LENS,
        &["--stages", "ri", "--film-size", "200x160", "--axis", "99.5,59.5"],
    )
    .ok();
    let half = ["--stages", "ri", "--film-size", "120", "--film-pitch-um", "4", "--scale", "0.5"];
    crate::common::run(chart, &coarse, LENS, &half).ok();
    for (k, (a, b)) in [(&fine, &coarse), (&coarse, &fine)].into_iter().enumerate() {
        let out = place.at(&format!("out-{k}"));
        let ran = lenscube(&["compare", text(a), text(b), "--out", text(&out)]).ok();
        assert!(ran.stderr.contains("100x80 px of 4 µm"), "{}", ran.stderr);
        let found: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(out.join("compare.json")).unwrap()).unwrap();
        assert_eq!(
            found["common_pixels"],
            serde_json::json!({ "width": 100, "height": 80, "pitch_um": 4.0, "axis_px": { "x": 49.5, "y": 29.5 } })
        );
        let band = &found["bands"][0];
        let share = band["difference_rms_share"].as_f64().unwrap();
        assert!(share < 1e-4, "{band}");
    }
}

#[test]
fn places_of_films_of_other_pixels_are_those_that_they_record() {
    let place = Place::new();
    let chart = "gen:slanted-edge?size=240&pitch_um=2&wavelengths=550&angle_deg=5";
    let (regions, coarse) = (place.at("regions"), place.at("coarse"));
    let roi = ["--stages", "ri", "--roi", "140,20,80,80"];
    crate::common::run(chart, &regions, LENS, &roi).ok();
    let half = ["--stages", "ri", "--film-size", "120", "--film-pitch-um", "4", "--scale", "0.5"];
    crate::common::run(chart, &coarse, LENS, &half).ok();
    let out = place.at("out");
    let compare = |a: &str, b: &str, flags: &[&str]| {
        lenscube(&[&["compare", a, b, "--out", text(&out), "--overwrite"], flags].concat())
    };
    // A region beside the axis, by both of its names.
    for name in [format!("{}//roi_0", text(&regions)), format!("{}/roi_0", text(&regions))] {
        compare(&name, text(&coarse), &[]).ok();
        let found: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(out.join("compare.json")).unwrap()).unwrap();
        assert_eq!(
            (&found["common_pixels"]["width"], &found["common_pixels"]["height"]),
            (&40.into(), &40.into())
        );
        assert!(found["bands"][0]["difference_rms_share"].as_f64().unwrap() < 1e-4, "{name}: {found}");
    }
    // Photons of a pixel are not comparable; regions that lie apart have nothing in common.
    let photons = place.at("photons");
    crate::common::run(chart, &photons, LENS, &["--stages", "ri", "--film-units", "photons"]).ok();
    assert_exit(&compare(text(&photons), text(&coarse), &[]), USAGE, &["photons of a pixel", "240x240 px"]);
    let apart = place.at("apart");
    let roi = [
        "--stages",
        "ri",
        "--film-size",
        "120",
        "--film-pitch-um",
        "4",
        "--scale",
        "0.5",
        "--roi",
        "0,80,20,20",
    ];
    crate::common::run(chart, &apart, LENS, &roi).ok();
    let (a, b) = (format!("{}//roi_0", text(&regions)), format!("{}//roi_0", text(&apart)));
    assert_exit(&compare(&a, &b, &[]), USAGE, &["have a pixel of the film plane in common"]);
    // The same pixels about another place of the axis are compared as they are, with a note.
    let moved = place.at("moved");
    crate::common::run(chart, &moved, LENS, &[&half[..], &["--axis", "61.5,58.5"]].concat()).ok();
    let notes = [&moved, &coarse].map(|a| compare(text(a), text(&coarse), &[]).ok().stderr);
    assert!(
        notes[0].contains("2 px right, -1 px down in") && notes[0].contains("pixel by pixel"),
        "{}",
        notes[0]
    );
    assert!(!notes[1].contains("optical axis"), "{}", notes[1]);
}

#[test]
fn raw_and_film_are_not_compared() {
    let place = Place::new();
    let film = place.at("some.film");
    crate::common::run("gen:uniform?size=64&pitch_um=2&wavelengths=450,550,650", &film, LENS, &[]).ok();
    let raw = place.raw("a.zarr", &film, &["--sensor", "example-2um", "--exposure", "5ms"]);
    let ran = lenscube(&["compare", text(&film), text(&raw), "--out", text(&place.at("out"))]);
    assert_exit(&ran, USAGE, &["a.zarr is a raw", "some.film is none"]);
}

/// A command without the flags that the format of a chart needs names the one that has them, and reads what that writes.
#[test]
fn charts_whose_formats_need_flags_are_compared_after_an_export() {
    let place = Place::new();
    let (npy, bands_last, envi) = (place.at("a.npy"), place.at("b.npy"), place.at("a.hdr"));
    let noise: Vec<f32> = (0..3 * 40 * 30).map(|k| ((k * 7919) % 101) as f32).collect();
    write_npy_of(&npy, &[3, 40, 30], &noise);
    write_npy_of(&bands_last, &[40, 30, 3], &noise);
    let compare = |a: &Path| lenscube(&["compare", text(a), text(a), "--out", text(&place.at("out"))]);
    assert_exit(&compare(&npy), USAGE, &["no --wavelengths; `lenscube export ", "a.npy CHART.hdr`"]);
    assert_exit(&compare(&bands_last), 1, &["this command has no --axes", "b.npy CHART.hdr`"]);
    let nm = ["--wavelengths", "450,550,650"];
    lenscube(&[&["export", text(&bands_last), text(&envi), "--axes", "y,x,wavelength"], &nm[..]].concat())
        .ok();
    compare(&envi).ok();
    let found: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(place.at("out/compare.json")).unwrap()).unwrap();
    // The first band of pixels whose bands follow each other: every third number.
    let mean = noise.iter().step_by(3).sum::<f32>() / 1200.0;
    assert!((found["bands"][0]["mean"][0].as_f64().unwrap() - f64::from(mean)).abs() < 1e-4, "{found}");
}
