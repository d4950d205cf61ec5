//! `lenscube depth`: what it finds in an array, and its forecast of slabs and cost.

use crate::common::{CommandResult, assert_exit, lenscube, text, write_npy};
use pipeline::geometry::Size;
use serde_json::Value;
use std::path::{Path, PathBuf};

const SIZE: Size = Size::new(400, 600);

struct Scene {
    dir: tempfile::TempDir,
}

impl Scene {
    fn new() -> Self {
        Self { dir: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// A wall at 4 m with a near square, changed by `change` (row, column, as it is).
    fn depth(&self, name: &str, change: impl Fn(usize, usize, f32) -> f32) -> PathBuf {
        let path = self.path(name);
        let at = |i: usize| {
            let (row, column) = (i / SIZE.width, i % SIZE.width);
            let near = (100..180).contains(&row) && (50..150).contains(&column);
            change(row, column, if near { 0.55 } else { 4.0 })
        };
        write_npy(&path, SIZE, &(0..SIZE.pixels()).map(at).collect::<Vec<_>>());
        path
    }
}

/// `lenscube depth` with the pack of six slabs, 2 µm.
fn report(depth: &Path, flags: &[&str]) -> CommandResult {
    let pack = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/depth/packs/six-slabs.lens.zip");
    let words = ["depth", text(depth), "--lens", text(&pack), "--film-pitch-um", "2", "--threads", "2"];
    lenscube(&[&words[..], flags].concat())
}

fn json(result: CommandResult, code: i32) -> Value {
    assert_eq!(result.code, code, "{}", result.stderr);
    serde_json::from_str(&result.stdout).unwrap()
}

#[test]
fn forecast_of_a_design_on_coarse_pixels_contains_its_trace() {
    let scene = Scene::new();
    let depth = scene.depth("depth.npy", |row, _, _| 1.9 + 0.0005 * row as f32);
    let words =
        ["depth", text(&depth), "--lens", "double-gauss-28", "--focus-m", "2", "--film-pitch-um", "48"];
    let size = ["--film-size", "60x40", "--json", "--threads", "2"];
    let found = json(lenscube(&[&words[..], &size].concat()), 0);
    let band = &found["band"];
    let nodes = band["node_vergences_per_m"].as_array().unwrap().len();
    // A run places 31 of them; their number by blur radius alone was 5.
    assert!((24..=38).contains(&nodes), "{nodes} nodes");
    assert!(band["trace_core_s"].as_f64().unwrap() > 1.0, "{band}");
    let text = lenscube(&[&words[..], &size[..2]].concat()).ok().stdout;
    assert!(text.contains("core seconds a band") && text.contains(" to trace its nodes"), "{text}");
}

#[test]
fn suspicious_pixels_are_counted_with_an_example() {
    let scene = Scene::new();
    let depth = scene.depth("bad.npy", |row, column, z| match (row, column) {
        (10, 20) | (11, 20) => f32::NAN,
        (12, 30) => 0.0,
        (13, 40) => -1.0,
        (200..=209, 300) => f32::INFINITY,
        (300, 400) => 2e6,
        (350, 500) => 0.6,
        (120..=139, 150) => 1.0,
        (20, 560) => 0.3,
        _ => z,
    });
    let always = ["--outside", "clamp", "--json"];
    let found = json(report(&depth, &always), 4);
    let surface = &found["surfaces"][0];
    let is = |key: &str, pixels: u64, row: u64, column: u64| {
        let (kind, first) = (&surface[key], &surface[key]["first"]);
        assert_eq!(
            (&kind["pixels"], &first["row"], &first["column"]),
            (&pixels.into(), &row.into(), &column.into()),
            "{key}"
        );
    };
    is("nan", 2, 10, 20);
    is("zero", 1, 12, 30);
    is("negative", 1, 13, 40);
    is("infinite", 11, 200, 300);
    is("nearer_than_nodes", 1, 20, 560);
    is("between_surfaces", 20, 120, 150);
    is("outliers", 2, 20, 560);
    assert!(found["problems"][0].as_str().unwrap().contains("4 pixels are NaN, 0 or negative"), "{found}");
    assert_eq!(
        json(report(&depth, &[&always[..], &["--depth-miss", "far"]].concat()), 0)["problems"],
        Value::Array(vec![])
    );
    let text = report(&depth, &["--depth-miss", "far"]);
    assert_exit(
        &text,
        4,
        &["2 pixels, e.g. row 10, column 20: NaN", "anti-aliased", "error       of a run", "--outside clamp"],
    );
    let clean = scene.depth("clean.npy", |_, _, z| z);
    assert_exit(&report(&clean, &["--outside", "clamp"]), 0, &["0.55 m to 4 m", "suspicious  no pixel"]);
}

#[test]
fn blur_slabs_and_cost_follow_the_distances() {
    let scene = Scene::new();
    let depth = scene.depth("depth.npy", |_, _, z| z);
    let flags = ["--outside", "clamp", "--json"];
    let found = json(report(&depth, &flags), 0);
    let number = |value: &Value| value.as_f64().unwrap();
    let per_dioptre = number(&found["blur_px_per_dioptre"]);
    let focus = 1.0 / number(&found["focus_m"]);
    let worst = (1.0 / 0.55 - focus).abs().max((0.25 - focus).abs()) * per_dioptre;
    assert!((number(&found["blur_px"]["greatest"]) - worst).abs() < 1e-5 * worst, "{found}");
    let band = &found["band"];
    assert_eq!(band["slabs_of_tiles"].as_array().unwrap().len(), 2, "tiles of 512 px");
    assert_eq!(number(&band["slabs_max"]), 2.0);
    let one = json(report(&depth, &[&flags[..], &["--depth", "0.7"]].concat()), 0);
    assert_eq!(number(&one["band"]["slabs_max"]), 1.0);
    assert_eq!(one["blur_px"]["least"], one["blur_px"]["greatest"]);
    assert!(number(&one["band"]["core_s"]) < number(&band["core_s"]), "{one}");
}

#[test]
fn the_figure_has_three_panels() {
    let scene = Scene::new();
    let depth = scene.depth("depth.npy", |_, _, z| z);
    let svg = scene.path("depth.svg");
    report(&depth, &["--outside", "clamp", "--plot", text(&svg)]).ok();
    let figure = std::fs::read_to_string(&svg).unwrap();
    for words in ["distance", "blur radius", "slabs in reach of a tile", "film of 600x400 px"] {
        assert!(figure.contains(&format!(">{words}")), "{words}");
    }
    assert_eq!(figure.matches("<image").count(), 3);
    let again = ["--outside", "clamp", "--plot", text(&svg)];
    assert_exit(&report(&depth, &again), 3, &["depth.svg already exists", "--overwrite"]);
    report(&depth, &[&again[..], &["--overwrite"]].concat()).ok();
}

#[test]
fn a_design_is_not_traced_and_its_gaps_count() {
    let scene = Scene::new();
    let depth = scene.depth("depth.npy", |row, _, _| if row < 200 { 1.0 } else { 0.8 });
    let cache = scene.path("cache");
    let design = |flags: &[&str]| {
        let words = ["depth", text(&depth), "--lens", "phone", "--film-pitch-um", "2", "--json"];
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_lenscube"));
        let output = command.env("XDG_CACHE_HOME", &cache).args(words).args(flags).output().unwrap();
        CommandResult::new(&output)
    };
    let found = json(design(&["--focus-m", "1"]), 0);
    assert!(found["band"]["psf_bytes_to_trace"].as_u64().unwrap() > 100_000, "{found}");
    assert!(!cache.exists(), "nothing was traced into the cache");
    assert_exit(&design(&["--gap", "99=1"]), 2, &["--gap 99=1", "the design has gaps behind surfaces 1 to"]);
    let moved = json(design(&["--focus-m", "1", "--gap", "2=0.2"]), 0);
    let blur = |value: &Value| value["blur_px_per_dioptre"].as_f64().unwrap();
    assert!((blur(&moved) / blur(&found) - 1.0).abs() > 1e-4, "{} {}", blur(&moved), blur(&found));
}

#[test]
fn a_run_forecasts_its_trace_without_it_and_refuses_too_little_memory_before_it() {
    let scene = Scene::new();
    let cache = scene.path("cache");
    let run = |flags: &[&str]| {
        let chart = "gen:depth-scene?size=120x80&wavelengths=550&near_m=0.2&far_m=1";
        let film = scene.path("film.zarr");
        let words =
            ["run", chart, text(&film), "--lens", "phone", "--focus-m", "0.3", "--film-size", "120x80"];
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_lenscube"));
        let always = ["--film-pitch-um", "2", "--threads", "2"];
        let output = command.env("XDG_CACHE_HOME", &cache).args(words).args(always).args(flags).output();
        CommandResult::new(&output.unwrap())
    };
    let forecast = run(&["--dry-run"]).ok().stdout;
    for words in
        ["depth nodes: ", " core seconds to trace, ", " GB in the cache", "time    about ", "memory  "]
    {
        assert!(forecast.contains(words), "{words}: {forecast}");
    }
    assert_exit(&run(&["--memory", "50MiB"]), 2, &["--memory 50MiB is too small"]);
    let traced = || std::fs::read_dir(cache.join("lenscube/lenses")).map_or(0, |dir| dir.flatten().count());
    assert_eq!(traced(), 0, "nothing was traced into the cache");
}
