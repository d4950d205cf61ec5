//! Scenes that bring their distances: `gen:depth-scene`, charts whose group holds them, and designs traced for the distances of a scene.

use crate::common::{CommandResult, assert_exit, bits, files, lenscube, pixels, run, text, write_npy};
use std::path::{Path, PathBuf};

const SCENE: &str = "depth-scene?size=300x240&overscan=0&near_m=0.55&far_m=4&wavelengths=500";

fn golden_pack() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/depth/packs/six-slabs.lens.zip")
}

/// `lenscube chart` of [`SCENE`].
fn write_scene(path: &Path) {
    let flags =
        ["--size", "300x240", "--overscan", "0", "--near-m", "0.55", "--far-m", "4", "--wavelengths", "500"];
    let result = lenscube(&[&["chart", "depth-scene", text(path)][..], &flags].concat()).ok();
    assert_exit(&result, 0, &["with distances and hidden surfaces"]);
}

#[test]
fn a_scene_brings_its_distances_drawn_or_stored() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let store = path("scene.zarr");
    write_scene(&store);
    let film = |name: &str, chart: &str, flags: &[&str]| {
        let always = ["--wavelengths", "500", "--outside", "clamp"];
        run(chart, &path(name), text(&golden_pack()), &[&always, flags].concat()).ok();
        bits(&pixels(&path(name), "film").1)
    };
    let drawn = film("drawn", &format!("gen:{SCENE}"), &[]);
    assert!(drawn == film("stored", text(&store), &[]), "a store");
    assert!(drawn == film("array", &format!("{}//chart", text(&store)), &[]), "an array of a store");
    let (depth, hidden) = (format!("{}//depth", text(&store)), format!("{}//hidden/1", text(&store)));
    assert!(drawn == film("named", text(&store), &["--depth", &depth, "--hidden", &hidden]), "named arrays");
    let parts = |part: &str| format!("gen:{SCENE}&part={part}");
    let alone = film("alone", &format!("gen:{SCENE}"), &["--depth", &parts("depth")]);
    assert!(drawn != alone, "without what is hidden");
    let one = film("one", &format!("gen:{SCENE}"), &["--depth", "2"]);
    assert!(drawn != one, "one distance");
}

#[test]
fn distances_without_a_lens_for_them_and_flags_without_distances_are_errors() {
    let dir = tempfile::tempdir().unwrap();
    let film = dir.path().join("film");
    let try_run =
        |chart: &str, lens: &str, flags: &[&str]| -> CommandResult { run(chart, &film, lens, flags) };
    let scene = format!("gen:{SCENE}");
    let flat_pack = try_run(&scene, "double-gauss-28-npz", &[]);
    assert_exit(&flat_pack, 2, &["PSFs of one object distance, inf m", "px: trace a pack", "`--depth none`"]);
    let pack = golden_pack();
    assert_exit(&try_run(&scene, text(&pack), &["--focus-m", "1"]), 2, &["--focus-m", "are for designs"]);
    assert_exit(&try_run(&scene, text(&pack), &["--depth", "none"]), 2, &["has depth nodes"]);
    let flat = "gen:uniform?size=20";
    for flag in [["--depth-unit", "mm"], ["--depth-miss", "far"], ["--hidden", "x.zarr"]] {
        assert_exit(
            &try_run(flat, "phone", &flag),
            2,
            &[flag[0], "requires the distance of every chart pixel"],
        );
    }
    assert_exit(&try_run(flat, "phone", &["--gap", "99=1"]), 2, &["--gap 99=1", "gaps behind surfaces 1 to"]);
    assert_exit(&try_run(flat, "phone", &["--focus-m", "0"]), 2, &["expected a distance in m"]);
    let wide = try_run(&scene, "double-gauss-28", &[]);
    assert_exit(&wide, 2, &["m is blurred to a radius of 3.", "in focus at infinity", "--focus-m"]);
    let behind = "gen:depth-scene?size=20&near_m=0.05&wavelengths=550";
    let behind = try_run(behind, "double-gauss-28", &["--focus-m", "0.5"]);
    assert_exit(&behind, 1, &["the nearest surface, at 0.05 m", "in front of the first surface"]);
    let svpsf = try_run(&scene, text(&pack), &["--stages", "ri"]);
    assert_exit(&svpsf, 2, &["requires the stage svpsf", "--depth none"]);
}

#[test]
fn what_depth_nodes_need_is_known_before_they_are_traced() {
    let dir = tempfile::tempdir().unwrap();
    let pack = dir.path().join("large.lens.zarr");
    let trace = |depths: &str, more: &[&str]| {
        let words = ["lens", "trace", "double-gauss-28", text(&pack), "--focus-m", "2", "--depths-m", depths];
        lenscube(&[&words[..], more].concat())
    };
    let wide = trace("0.5:inf", &[]);
    assert_exit(&wide, 2, &["blurred more widely than the largest PSF window, 639 px", "--depths-m 1.25"]);
    let large = trace("1.5:3", &[]);
    let needed =
        ["depth nodes", "PSFs, windows of", "GB uncompressed", "core seconds", "--max-gb 16 is the limit"];
    assert_exit(&large, 2, &needed);
    assert_exit(&large, 2, &["fewer --wavelengths", "traces the nodes that its scene needs", "allows it"]);
    assert_exit(
        &trace("1.5:3", &["--wavelengths", "550", "--max-gb", "0.1"]),
        2,
        &["--max-gb 0.1 is the limit"],
    );
    assert!(!pack.exists());
}

#[test]
fn a_flat_pack_in_focus_gives_the_flat_film() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let chart = "gen:uniform?size=64&wavelengths=550";
    let film = |name: &str, flags: &[&str]| run(chart, &path(name), "double-gauss-28-npz", flags);
    film("flat", &[]).ok();
    // The blur per dioptre is 829 px of 2 µm.
    film("far", &["--depth", "4000"]).ok();
    assert_eq!(bits(&pixels(&path("far"), "film").1), bits(&pixels(&path("flat"), "film").1));
    assert_exit(&film("near", &["--depth", "2000"]), 2, &["its blur at 2000 to 2000 m is up to 0.4 px"]);
}

#[test]
fn a_design_is_traced_for_the_distances_of_the_scene() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let chart = "gen:depth-scene?size=60x48&overscan=0&near_m=0.3&far_m=0.5&wavelengths=550";
    let focus = ["--focus-m", "0.4", "--depth-tolerance", "0.1"];
    let film = path("film");
    run(chart, &film, "phone", &focus).ok();
    let expected = files(&film);
    // Two distances: the nodes around them alone are traced.
    let planes = path("planes.npy");
    let size = pipeline::geometry::Size::new(48, 60);
    let distances: Vec<f32> = (0..48 * 60).map(|i| if i % 60 < 30 { 0.3 } else { 0.5 }).collect();
    write_npy(&planes, size, &distances);
    let two = path("two");
    let words = [
        "run",
        chart,
        text(&two),
        "--lens",
        "phone",
        "--depth",
        text(&planes),
        "--hidden",
        "none",
        "--verbose",
    ];
    // With a cache of its own: nodes that are in it are not traced.
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_lenscube"));
    let output = command.env("XDG_CACHE_HOME", dir.path()).args(words).args(focus).output().unwrap();
    let two = CommandResult::new(&output).ok();
    let line = two.stderr.split("550 nm:").nth(1).unwrap_or_else(|| panic!("{}", two.stderr));
    let nodes: Vec<usize> = line.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    assert!(nodes[0] <= 4 && nodes[0] < nodes[1], "{nodes:?} of {}", two.stderr);
    // Once more, from the cache, and by units with the traced bands in a pack.
    let (again, plan) = (path("again"), path("plan.json"));
    let second = run(chart, &again, "phone", &focus).ok();
    assert!(!second.stderr.contains("tracing the bands"), "{}", second.stderr);
    assert!(files(&again) == expected, "from the cache");
    let (planned, pack) = (path("planned"), path("phone.lens.zarr"));
    let words = ["plan", chart, text(&planned), "--output", text(&plan), "--lens", "phone"];
    lenscube(&[&words[..], &focus, &["--lens-pack", text(&pack)]].concat()).ok();
    lenscube(&["run", "--plan", text(&plan), "--unit", "0", "--no-fsync"]).ok();
    assert_eq!(bits(&pixels(&planned, "film").1), bits(&pixels(&film, "film").1), "by a plan");
    // Another focus is another film, traced for it.
    let near = path("near");
    let other = run(chart, &near, "phone", &["--focus-m", "0.3", "--depth-tolerance", "0.1"]).ok();
    assert_eq!(other.code, 0);
    let (first, second) = (pixels(&film, "film").1, pixels(&near, "film").1);
    let peak = first[0].iter().fold(0f32, |m, v| m.max(*v));
    let difference = std::iter::zip(&first[0], &second[0]).fold(0f32, |m, (a, b)| m.max((a - b).abs()));
    assert!(difference > 0.01 * peak, "{difference} of {peak}");
    let changed = run(chart, &film, "phone", &["--focus-m", "0.3", "--depth-tolerance", "0.1"]);
    assert_exit(&changed, 3, &["belongs to another job", "--focus-m (film 0.4, requested 0.3)"]);
}

/// Numbers behind each `name` of a text.
fn number_after(text: &str, name: &str) -> f64 {
    let rest = text.split(name).nth(1).unwrap_or_else(|| panic!("no {name} in {text}"));
    let number = |c: char| c.is_ascii_digit() || c == '.';
    let rest = rest.trim_start_matches(|c| !number(c));
    rest[..rest.find(|c| !number(c)).unwrap_or(rest.len())].parse().unwrap()
}

#[test]
fn the_camera_of_a_lens_is_the_pinhole_at_its_entrance_pupil() {
    let double_gauss = ["lens", "camera", "double-gauss-28", "--focus-m", "2", "--image-plane", "paraxial"];
    let film = ["--film-size", "1400x1000", "--film-pitch-um", "2"];
    let camera = |more: &[&str]| lenscube(&[&double_gauss[..], &film, more].concat()).ok().stdout;
    let json: serde_json::Value = serde_json::from_str(&camera(&["--json"])).unwrap();
    let value = |key: &str| json[key].as_f64().unwrap();
    // First-order figures of tests/golden/depth/nodes.json, rounded.
    assert!((value("pinhole_behind_first_vertex_mm") - 58.94).abs() < 0.01);
    assert!((value("focal_length_mm") - 104.269).abs() < 1e-3);
    assert!((value("blur_per_dioptre_um") / 2.0 - 868.8).abs() < 0.1);
    // Near the axis this lens has no distortion of a pixel beyond the margin.
    let (width, height) = (value("width_px"), value("height_px"));
    assert_eq!((width - 1400.0, height - 1000.0), (2.0 * value("overscan_px"), 2.0 * value("overscan_px")));
    assert!((64.0..=66.0).contains(&value("overscan_px")));
    let tan = |px: f64| px * 0.002 / 2.0 / value("focal_length_mm");
    let half = |deg: f64| (deg.to_radians() / 2.0).tan();
    assert!((half(value("horizontal_fov_deg")) / tan(width) - 1.0).abs() < 1e-12);
    assert!((half(value("vertical_fov_deg")) / tan(height) - 1.0).abs() < 1e-12);
    let near =
        |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 1e-8, "{found} {expected}");
    let blender = camera(&["--for", "blender"]);
    near(18.0 / number_after(&blender, "36.0,"), tan(width));
    // The narrower side, and the one that fov_axis names.
    near(half(number_after(&camera(&["--for", "pbrt"]), "float fov")), tan(height));
    near(half(number_after(&camera(&["--for", "mitsuba"]), "\"fov\" value")), tan(width));
    // Blur of the nearest distance, 0.1666 dioptres from focus.
    let wide: serde_json::Value = serde_json::from_str(&camera(&["--json", "--depths-m", "1.5:2"])).unwrap();
    let expected = 12.0 + 1.2 * 868.8 / 6.0;
    assert!((wide["overscan_px"].as_f64().unwrap() - expected).abs() < 3.0, "{wide}");
}

#[test]
fn the_picture_breathes_with_focus_and_the_blur_per_dioptre_with_it() {
    let inf = f64::INFINITY;
    for (focus_m, blur_px, focal_mm) in [(inf, 829.1, 99.501), (2.0, 868.8, 104.269), (1.0, 912.6, 109.518)] {
        let focus = focus_m.to_string();
        let words = ["lens", "camera", "double-gauss-28", "--json", "--focus-m", &focus];
        let film = ["--film", "1400x1000", "--pitch-um", "2", "--image-plane", "paraxial"];
        let stdout = lenscube(&[&words[..], &film].concat()).ok().stdout;
        let json: serde_json::Value = serde_json::from_str(&stdout).unwrap();
        let value = |key: &str| json[key].as_f64().unwrap();
        assert!((value("blur_per_dioptre_um") / 2.0 - blur_px).abs() < 0.1, "{focus} m: {json}");
        assert!((value("focal_length_mm") - focal_mm).abs() < 1e-3, "{focus} m: {json}");
    }
}

#[test]
fn a_film_beyond_the_field_has_no_camera() {
    let words = ["lens", "camera", "phone", "--film", "9000x600"];
    assert_exit(&lenscube(&words), 1, &["camera of phone", "a smaller --film"]);
}

#[test]
#[ignore = "long: traces three bands for three focus distances"]
fn the_demo_pulls_the_focus_through_the_scene() {
    let dir = tempfile::tempdir().unwrap();
    let demo = dir.path().join("demo");
    let out = lenscube(&["demo", "--depth", "--dir", text(&demo)]).ok();
    assert!(!out.stderr.contains("anti-aliased"), "the distances of the ball are its own: {}", out.stderr);
    assert!(demo.join("focus.png").metadata().unwrap().len() > 100_000);
    // The steepest step of the wall's checks, and the contrast of the disc's star.
    let part = |film: &str, rows: std::ops::Range<usize>, columns: std::ops::Range<usize>| -> Vec<Vec<f32>> {
        let (size, bands) = pixels(&demo.join(film), "film");
        rows.map(|y| bands[1][y * size.width..][columns.clone()].to_vec()).collect()
    };
    let range = |values: &mut dyn Iterator<Item = f32>| {
        values.fold((f32::MAX, 0f32), |(low, high), v| (low.min(v), high.max(v)))
    };
    let wall = |film: &str| {
        let rows = part(film, 20..100, 240..300);
        let steps = rows.iter().flat_map(|row| row.windows(2)).map(|w| (w[1] - w[0]).abs());
        steps.fold(0f32, f32::max) / range(&mut rows.iter().flatten().copied()).1
    };
    let disc = |film: &str| {
        let (low, high) = range(&mut part(film, 130..160, 100..130).into_iter().flatten());
        high / low
    };
    let [near, middle, far] = ["near.zarr", "middle.zarr", "far.zarr"].map(|film| (wall(film), disc(film)));
    assert!(far.0 > 1.1 * middle.0 && middle.0 > 1.1 * near.0, "wall {near:?} {middle:?} {far:?}");
    assert!(near.1 > 1.3 * middle.1 && middle.1 > 1.1 * far.1, "disc {near:?} {middle:?} {far:?}");
}
