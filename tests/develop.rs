//! `lenscube develop`, `lenscube shoot`, and `lenscube sensor` with files as output, from outside.

mod common;

use common::{CommandResult, assert_exit, files, lenscube, text};
use formats::chart::image::{ImageFile, Transfer};
use pipeline::chart::Generator;
use pipeline::colour::{Illuminant, linear_srgb_to_xyz};
use pipeline::develop::matrix::{difference, patch_targets};
use pipeline::geometry::{Rect, Size};
use std::path::{Path, PathBuf};
use std::process::Command;

const USAGE: i32 = 2;
const OTHER_JOB: i32 = 3;
const LENS: &str = "double-gauss-28-npz";
const CHECKER: &str = "checker?size=450x300&pitch_um=2";

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// The film of a ColorChecker, with relative illumination alone.
    fn checker(&self, chart: &str) -> PathBuf {
        let film = self.at("film.zarr");
        common::run(&format!("gen:{chart}"), &film, LENS, &["--stages", "ri"]).ok();
        film
    }

    fn raw(&self, name: &str, film: &Path, flags: &[&str]) -> PathBuf {
        let raw = self.at(name);
        lenscube(&[&["sensor", text(film), text(&raw), "--no-fsync"], flags].concat()).ok();
        raw
    }
}

fn develop(raw: &Path, out: &Path, flags: &[&str]) -> CommandResult {
    lenscube(&[&["develop", text(raw), text(out)], flags].concat())
}

/// Size and linear channels of a picture.
fn linear(path: &Path, transfer: Transfer) -> (Size, Vec<Vec<f32>>) {
    let file = ImageFile::open(path).unwrap();
    let (size, channels) = (file.size(), if file.is_grey() { 1 } else { 3 });
    let source = file.linear(transfer, path.parent().unwrap(), 2, &|_, _| ()).unwrap();
    let read = |c| {
        let mut pixels = vec![0.0; size.pixels()];
        source.read(c, size.rect(), &mut pixels).unwrap();
        pixels
    };
    (size, (0..channels).map(read).collect())
}

/// Mean ΔE2000 of the patches of a picture, its greys made as bright as they should be.
fn delta_e(path: &Path, chart: &str, light: Illuminant) -> f64 {
    let (size, channels) = linear(path, Transfer::Linear);
    let generator = chart.parse::<Generator>().unwrap();
    let patches = generator.patches_px();
    assert_eq!(patches.len(), 24);
    let mean = |rect: &Rect, c: usize| {
        let inner = Rect::new(rect.y + 5, rect.x + 5, rect.height - 10, rect.width - 10);
        let rows = inner.y as usize..inner.bottom() as usize;
        let line = |y: usize| &channels[c][y * size.width + inner.x as usize..][..inner.width];
        rows.flat_map(line).map(|v| f64::from(*v)).sum::<f64>() / inner.size().pixels() as f64
    };
    let found: Vec<[f64; 3]> = patches.iter().map(|p| std::array::from_fn(|c| mean(p, c))).collect();
    let targets = patch_targets(light);
    let luminance = |v: &[f64; 3]| linear_srgb_to_xyz(*v)[1];
    let greys = |all: &[[f64; 3]]| all[18..22].iter().map(luminance).sum::<f64>();
    let scale = greys(&targets) / greys(&found);
    let all = std::iter::zip(found, targets).map(|(f, t)| difference(f.map(|v| v * scale), t));
    all.sum::<f64>() / 24.0
}

#[test]
fn photographs_of_a_checker_have_the_error_of_their_matrix() {
    let place = Place::new();
    for (light, chart) in
        [(Illuminant::D65, CHECKER.to_owned()), (Illuminant::A, format!("{CHECKER}&illuminant=A"))]
    {
        let film = place.checker(&chart);
        for (name, expected, noise) in
            [("example-2um", [0.79, 0.88], "all"), ("ideal-xyz", [0.0, 0.0], "none")]
        {
            let raw = place.raw(
                "raw.zarr",
                &film,
                &["--sensor", name, "--exposure", "auto", "--noise", noise, "--overwrite"],
            );
            let picture = place.at("picture.exr");
            // Linear floats: the colour of patch 17 has negative red.
            let flags = ["--shading", LENS, "--overwrite"];
            assert_exit(&develop(&raw, &picture, &flags), 0, &["ΔE2000", &format!("white {}", light.name())]);
            let found = delta_e(&picture, &chart, light);
            let expected = expected[usize::from(light == Illuminant::A)];
            // Bands of 10 nm from 400 to 700 nm cost a mean of 0.14 (D65) and 0.20 (A) by themselves.
            let allowed = if noise == "none" { 0.21 } else { 0.3 };
            assert!((found - expected).abs() <= allowed, "{name} {light:?}: {found} for {expected}");
        }
        std::fs::remove_dir_all(film).unwrap();
    }
}

#[test]
fn threads_memory_and_crops_give_the_same_pixels() {
    let place = Place::new();
    let raw =
        place.raw("raw.zarr", &place.checker(CHECKER), &["--sensor", "example-2um", "--exposure", "auto"]);
    for format in ["png", "tif", "exr"] {
        let (one, other) = (place.at(&format!("one.{format}")), place.at(&format!("other.{format}")));
        develop(&raw, &one, &["--threads", "1"]).ok();
        develop(&raw, &other, &["--threads", "3", "--memory", "128MiB"]).ok();
        assert!(std::fs::read(&one).unwrap() == std::fs::read(&other).unwrap(), "{format}");
        let crop = place.at(&format!("crop.{format}"));
        develop(&raw, &crop, &["--crop", "31,17,200,101"]).ok();
        let ((size, all), (_, part)) = (linear(&one, Transfer::Linear), linear(&crop, Transfer::Linear));
        for c in 0..3 {
            for (k, v) in part[c].iter().enumerate() {
                assert_eq!(*v, all[c][(17 + k / 200) * size.width + 31 + k % 200], "{format} {c} {k}");
            }
        }
    }
    // A window of the sensor is that part of the whole, but for its border.
    let window = place.raw(
        "window.zarr",
        &place.at("film.zarr"),
        &["--sensor", "example-2um", "--exposure", "3ms", "--roi", "31,17,60,50"],
    );
    let whole =
        place.raw("whole.zarr", &place.at("film.zarr"), &["--sensor", "example-2um", "--exposure", "3ms"]);
    let (a, b) = (place.at("a.exr"), place.at("b.exr"));
    develop(&window, &a, &[]).ok();
    develop(&whole, &b, &["--crop", "31,17,60,50"]).ok();
    let ((_, a), (_, b)) = (linear(&a, Transfer::Linear), linear(&b, Transfer::Linear));
    let inner = |k: usize| (2..48).contains(&(k / 60)) && (2..58).contains(&(k % 60));
    assert!((0..3).all(|c| (0..3000).filter(|k| inner(*k)).all(|k| a[c][k] == b[c][k])));
}

#[test]
fn options_change_what_they_say() {
    let place = Place::new();
    let film = place.checker(CHECKER);
    let raw = place.raw(
        "raw.zarr",
        &film,
        &["--sensor", "example-2um", "--exposure", "auto:0.4", "--noise", "none"],
    );
    let at = |name: &str, flags: &[&str]| {
        let out = place.at(name);
        develop(&raw, &out, flags).ok();
        linear(&out, Transfer::Linear)
    };
    let (size, plain) = at("plain.exr", &[]);
    assert_eq!(size, Size::new(300, 450));
    let (_, brighter) = at("brighter.exr", &["--exposure", "1"]);
    let near = |a: f32, b: f32| (a - b).abs() <= 1e-6 * b.abs().max(1.0);
    assert!(std::iter::zip(&brighter[0], &plain[0]).all(|(a, b)| near(*a, 2.0 * b)));
    let (small, _) = at("superpixel.exr", &["--demosaic", "superpixel"]);
    assert_eq!(small, Size::new(150, 225));
    let (_, warm) = at("warm.exr", &["--white", "1,2,1", "--matrix", "none"]);
    let (_, cool) = at("cool.exr", &["--white", "1,1,1", "--matrix", "none"]);
    let mean = |v: &[f32]| v.iter().map(|v| f64::from(*v)).sum::<f64>() / v.len() as f64;
    assert!((mean(&warm[1]) / mean(&cool[1]) - 2.0).abs() < 0.05);
    let matrix = place.at("matrix.txt");
    std::fs::write(&matrix, "# rows\n0 1 0\n0, 1, 0\n0;1;0\n").unwrap();
    let (_, grey) = at("grey.exr", &["--matrix", text(&matrix)]);
    assert!(grey[0] == grey[1] && grey[1] == grey[2]);
    let (_, auto) = at("auto.exr", &["--white", "auto", "--matrix", "none", "--demosaic", "superpixel"]);
    let means: Vec<f64> = auto.iter().map(|v| mean(v)).collect();
    assert!(means.iter().all(|m| (m / means[0] - 1.0).abs() < 0.02), "{means:?}");
    // A flat divides itself to an even picture.
    let flat_film = place.at("flat.film");
    common::run(
        "gen:uniform?size=450x300&pitch_um=2&wavelengths=450,550,650",
        &flat_film,
        LENS,
        &["--stages", "ri"],
    )
    .ok();
    let flat = place.raw(
        "flat.zarr",
        &flat_film,
        &["--sensor", "example-2um", "--exposure", "auto:0.5", "--noise", "none"],
    );
    develop(&flat, &place.at("even.exr"), &["--shading", text(&flat)]).ok();
    let (_, even) = linear(&place.at("even.exr"), Transfer::Linear);
    assert!(even[1].iter().all(|v| (v / even[1][0] - 1.0).abs() < 1e-3));
    // Quad to Bayer, and monochrome to grey.
    let quad = [
        "--sensor",
        "example-2um",
        "--exposure",
        "auto",
        "--set",
        r#"cfa.pattern=[["R","R","G","G"],["R","R","G","G"],["G","G","B","B"],["G","G","B","B"]]"#,
    ];
    let quad = place.raw("quad.zarr", &film, &quad);
    let binned = develop(&quad, &place.at("quad.exr"), &["--bin", "2"]).ok();
    assert!(binned.stderr.contains("demosaic malvar, bin 2"), "{}", binned.stderr);
    assert_eq!(linear(&place.at("quad.exr"), Transfer::Linear).0, Size::new(150, 225));
    let mono = place.raw("mono.zarr", &film, &["--sensor", "ideal-mono", "--exposure", "auto"]);
    develop(&mono, &place.at("mono.png"), &[]).ok();
    assert!(ImageFile::open(&place.at("mono.png")).unwrap().is_grey());
}

#[test]
fn developments_that_are_not_possible_are_one_clear_error() {
    let place = Place::new();
    let film = place.checker("checker?size=90x60&pitch_um=2");
    let raw = place.raw(
        "raw.zarr",
        &film,
        &["--sensor", "example-2um", "--exposure", "1ms,2ms", "--roi", "0,0,20,20", "--roi", "4,4,20,20"],
    );
    let (array, out) = (PathBuf::from(format!("{}//roi_1", text(&raw))), place.at("out.png"));
    let bad = |raw: &Path, out: &str, flags: &[&str], words: &[&str]| {
        let out = place.at(out);
        assert_exit(&develop(raw, &out, flags), USAGE, words);
        assert!(!out.exists());
    };
    bad(&raw, "out.png", &[], &["roi_0, roi_1", "name one"]);
    bad(&array, "out.jpg", &[], &["expected a picture"]);
    bad(&array, "out.png", &["--frame", "2"], &["2 frames"]);
    bad(&array, "out.png", &["--crop", "10,10,20,20"], &["not inside"]);
    bad(&array, "out.png", &["--white", "D50"], &["D65, A, E, auto"]);
    bad(&array, "out.png", &["--white", "1,2"], &["3 gains"]);
    bad(&array, "out.png", &["--bin", "2"], &["one filter"]);
    bad(&array, "out.png", &["--memory", "10MiB"], &["--memory"]);
    bad(&array, "out.exr", &["--depth", "16"], &["--depth"]);
    bad(&array, "out.exr", &["--tone", "srgb"], &["linear"]);
    bad(&array, "out.png", &["--exposure", "99"], &["20 EV"]);
    bad(&film, "out.png", &[], &["expected a raw of this program"]);
    std::fs::write(place.at("matrix"), "1 0 0\n0 x 0\n0 0 1\n").unwrap();
    bad(&array, "out.png", &["--matrix", text(&place.at("matrix"))], &["line 2", "3 numbers"]);
    let quad = [
        "--sensor",
        "example-2um",
        "--exposure",
        "1ms",
        "--set",
        r#"cfa.pattern=[["R","R","G","G"],["R","R","G","G"],["G","G","B","B"],["G","G","B","B"]]"#,
    ];
    let quad = place.raw("quad.zarr", &film, &quad);
    bad(&quad, "out.png", &["--demosaic", "malvar"], &["bilinear"]);
    develop(&array, &out, &["--frame", "1"]).ok();
    assert_exit(&develop(&array, &out, &[]), OTHER_JOB, &["--overwrite"]);
    std::fs::remove_file(raw.join("roi_1/c/1/0/0")).unwrap();
    assert_exit(
        &develop(&array, &place.at("new.png"), &["--frame", "1"]),
        1,
        &["1 of 1 shards", "lenscube sensor"],
    );
}

#[test]
fn a_frame_becomes_a_file_and_resumes() {
    let place = Place::new();
    let film = place.checker(CHECKER);
    let flags = ["--sensor", "example-2um", "--exposure", "5ms", "--no-fsync"];
    let sensor = |out: &Path, more: &[&str]| {
        lenscube(&[&["sensor", text(&film), text(out)], &flags[..], more].concat())
    };
    for name in ["a.dng", "a.tif", "a.png"] {
        let out = place.at(name);
        let killed = Command::new(env!("CARGO_BIN_EXE_lenscube"))
            .args(["sensor", text(&film), text(&out)])
            .args(flags)
            .env("LENSCUBE_FAULT", "commit:1:kill")
            .output()
            .unwrap();
        assert!(!killed.status.success() && !out.exists());
        sensor(&out, &[]).ok();
        assert!(out.exists() && !place.at(&format!("{name}.raw.zarr")).exists());
        assert_exit(&sensor(&out, &[]), OTHER_JOB, &["--overwrite"]);
        let before = std::fs::read(&out).unwrap();
        sensor(&out, &["--overwrite", "--threads", "1"]).ok();
        assert!(std::fs::read(&out).unwrap() == before);
    }
    let raw = place.raw("raw.zarr", &film, &["--sensor", "example-2um", "--exposure", "5ms"]);
    let numbers = common::pixels(&raw, "raw").1.remove(0);
    let (_, grey) = linear(&place.at("a.png"), Transfer::Linear);
    let scale = 65535.0 / 4095.0f32;
    assert!(
        std::iter::zip(&grey[0], &numbers).all(|(g, n)| (g * 65535.0).round() == (n * scale + 0.5).floor())
    );
    assert!(linear(&place.at("a.tif"), Transfer::Linear).1 == grey);
    let bad = |out: &str, flags: &[&str], words: &[&str]| {
        let out = place.at(out);
        let all = [&["sensor", text(&film), text(&out), "--exposure", "5ms"], flags].concat();
        assert_exit(&lenscube(&all), USAGE, words);
        assert!(!out.exists());
    };
    let own = ["--sensor", "example-2um"];
    bad("b.dng", &[&own[..], &["--frames", "2"]].concat(), &["one frame"]);
    bad("b.dng", &[&own[..], &["--keep-signal"]].concat(), &["one frame"]);
    let other = r#"cfa.pattern=[["R","G","B"]]"#;
    bad("b.dng", &[&own[..], &["--set", other]].concat(), &["Bayer and quad", "1 x 3"]);
}

#[test]
fn comparison_of_raws_finds_what_differs() {
    let place = Place::new();
    let chart = "gen:slanted-edge?size=240&pitch_um=2&wavelengths=450,550,650&angle_deg=5";
    let (sharp, blurred) = (place.at("sharp.film"), place.at("blurred.film"));
    common::run(chart, &sharp, LENS, &["--stages", "ri"]).ok();
    common::run(chart, &blurred, LENS, &[]).ok();
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
    let small = place.raw("small.zarr", &sharp, &[&flags[..], &["--size", "100"]].concat());
    assert_exit(&compare(&a, &small, &place.at("no"), &[]), USAGE, &["pixels differ"]);
    assert_exit(&compare(&a, &b, &place.at("no"), &["--edge", "1,1,5,200"]), USAGE, &["not inside the raw"]);
    assert_exit(&compare(&a, &b, &place.at("no"), &["--patch", "200,200,50,50"]), USAGE, &["not inside"]);
    assert!(!place.at("no").exists());
}

#[test]
fn a_shot_is_run_sensor_and_develop() {
    let place = Place::new();
    let chart = "gen:composite?size=64&pitch_um=2&wavelengths=450,550,650";
    let (one, kept) = (place.at("one.png"), place.at("kept"));
    let own = ["--lens", LENS, "--sensor", "example-2um", "--seed", "4"];
    lenscube(&[&["shoot", chart, text(&one)], &own[..]].concat()).ok();
    assert_eq!(std::fs::read_dir(place.at(".")).unwrap().count(), 1);
    let two = place.at("two.png");
    lenscube(&[&["shoot", chart, text(&two), "--keep", text(&kept)], &own[..]].concat()).ok();
    assert!(std::fs::read(&one).unwrap() == std::fs::read(&two).unwrap());
    let (film, raw, three) = (place.at("film.zarr"), place.at("raw.zarr"), place.at("three.png"));
    common::run(chart, &film, LENS, &[]).ok();
    lenscube(&[
        "sensor",
        text(&film),
        text(&raw),
        "--sensor",
        "example-2um",
        "--exposure",
        "auto",
        "--seed",
        "4",
    ])
    .ok();
    develop(&raw, &three, &[]).ok();
    assert!(std::fs::read(&one).unwrap() == std::fs::read(&three).unwrap());
    assert!(files(&raw) == files(&kept.join("raw.zarr")));
    // The same again finds film and raw complete; a raw of another sensor is not replaced.
    let again =
        lenscube(&[&["shoot", chart, text(&two), "--keep", text(&kept), "--overwrite"], &own[..]].concat());
    assert_exit(&again, 0, &["1/3  film", "3/3  picture"]);
    let other = ["--lens", LENS, "--sensor", "ideal-mono"];
    let other = lenscube(
        &[&["shoot", chart, text(&place.at("four.png")), "--keep", text(&kept)], &other[..]].concat(),
    );
    assert_exit(&other, OTHER_JOB, &["another job"]);
    assert_exit(&lenscube(&[&["shoot", chart, text(&one)], &own[..]].concat()), OTHER_JOB, &["--overwrite"]);
    let dng = place.at("five.dng");
    lenscube(&[&["shoot", chart, text(&dng)], &own[..]].concat()).ok();
    assert!(dng.exists() && !place.at("five.dng.shot").exists());
}
