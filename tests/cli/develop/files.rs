//! Raws as DNG, TIFF and PNG; pictures in one command.

use super::{CHECKER, OTHER_JOB, USAGE, linear};
use crate::common::camera::{LENS, Place, attributes, develop, frame};
use crate::common::{assert_exit, files, lenscube, text};
use formats::chart::image::Transfer;
use pipeline::geometry::Size;
use std::path::Path;
use std::process::Command;

#[test]
fn a_frame_becomes_a_file_and_resumes() {
    let place = Place::new();
    let film = place.run(CHECKER);
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
    let numbers = crate::common::pixels(&raw, "raw").1.remove(0);
    let (_, grey) = linear(&place.at("a.png"), Transfer::Linear);
    let scale = 65535.0 / 4095.0f32;
    assert!(
        std::iter::zip(&grey[0], &numbers).all(|(g, n)| (g * 65535.0).round() == (n * scale + 0.5).floor())
    );
    assert!(linear(&place.at("a.tif"), Transfer::Linear).1 == grey);
    assert_exit(&sensor(&place.at("said.tif"), &[]), 0, &["65535 is 4095 DN; --keep-dn"]);
    for name in ["dn.tif", "dn.png"] {
        sensor(&place.at(name), &["--keep-dn"]).ok();
        let (_, kept) = linear(&place.at(name), Transfer::Linear);
        assert!(std::iter::zip(&kept[0], &numbers).all(|(g, n)| (g * 65535.0).round() == *n), "{name}");
    }
    assert_exit(&sensor(&place.at("dn.dng"), &["--keep-dn"]), USAGE, &["--keep-dn is for .tif and .png"]);
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
    let quad = r#"cfa.pattern=[["R","R","G","G"],["R","R","G","G"],["G","G","B","B"],["G","G","B","B"]]"#;
    assert_exit(&sensor(&place.at("quad.dng"), &["--set", quad]), 0, &["note: ", "quad.dng", "LibRaw"]);
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
    crate::common::run(chart, &film, LENS, &[]).ok();
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
    // The same again finds film and raw complete, also with --overwrite; a raw of another sensor is replaced with it only.
    let again =
        lenscube(&[&["shoot", chart, text(&two), "--keep", text(&kept), "--overwrite"], &own[..]].concat());
    assert_exit(&again, 0, &["1/3  film", "3/3  picture"]);
    assert_eq!(again.stderr.matches("nothing to do").count(), 2, "{}", again.stderr);
    let other = ["--lens", LENS, "--sensor", "ideal-mono"];
    let other = lenscube(
        &[&["shoot", chart, text(&place.at("four.png")), "--keep", text(&kept)], &other[..]].concat(),
    );
    assert_exit(&other, OTHER_JOB, &["another job"]);
    let replaced = ["--lens", LENS, "--sensor", "ideal-mono", "--overwrite"];
    let replaced = lenscube(
        &[&["shoot", chart, text(&place.at("four.png")), "--keep", text(&kept)], &replaced[..]].concat(),
    );
    assert_exit(&replaced, 0, &["3/3  picture"]);
    assert_eq!(replaced.stderr.matches("nothing to do").count(), 1, "{}", replaced.stderr);
    assert_exit(&lenscube(&[&["shoot", chart, text(&one)], &own[..]].concat()), OTHER_JOB, &["--overwrite"]);
    let dng = place.at("five.dng");
    lenscube(&[&["shoot", chart, text(&dng)], &own[..]].concat()).ok();
    assert!(dng.exists() && !place.at("five.dng.shot").exists());
    let (six, mine) = (place.at("six.dng"), place.at("six.dng.shot/mine.txt"));
    std::fs::create_dir(place.at("six.dng.shot")).unwrap();
    std::fs::write(&mine, "mine").unwrap();
    let shot = lenscube(&[&["shoot", chart, text(&six)], &own[..]].concat());
    assert_exit(&shot, 0, &["note: ", "six.dng.shot", "was not removed"]);
    assert!(six.exists() && std::fs::read_dir(place.at("six.dng.shot")).unwrap().count() == 1);
}

/// The same as converting the picture first; an interrupted command resumes, and what cannot be done is said before anything is made.
#[test]
fn a_picture_in_colour_is_shot() {
    let place = Place::new();
    let picture =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("formats/tests/data/pictures/colour/baseline.jpg");
    let (out, chart, other) = (place.at("out.png"), place.at("chart.zarr"), place.at("other.png"));
    let kept = place.at("kept");
    let own = ["--lens", LENS, "--sensor", "example-2um", "--film-pitch-um", "2"];
    let bands = ["--wavelengths", "400:700:20"];
    let base = [&["shoot", text(&picture), text(&out)], &own[..], &bands].concat();
    let keep = ["--keep", text(&kept)];
    for (refused, words) in [
        (&["--exposure", "0"][..], "--exposure 0"),
        (&["--white", "F7"], "--white F7"),
        (&["--gain", "1000"], "gain 1000"),
        (&["--chart-units", "W m-2 nm-1 sr-1"], "is a picture"),
    ] {
        assert_exit(&lenscube(&[&base[..], refused].concat()), USAGE, &[words]);
    }
    assert_exit(
        &lenscube(&[&["shoot", text(&picture), text(&out)], &own[..4]].concat()),
        USAGE,
        &["--film-pitch-um"],
    );
    assert_eq!(std::fs::read_dir(place.at(".")).unwrap().count(), 0, "something was made");
    let killed = Command::new(env!("CARGO_BIN_EXE_lenscube"))
        .args([&base[..], &keep].concat())
        .env("LENSCUBE_FAULT", "commit:1:kill")
        .output()
        .unwrap();
    assert!(!killed.status.success() && !out.exists());
    let shot = lenscube(&[&base[..], &keep].concat());
    assert_exit(&shot, 0, &["1/4  chart", "2/4  film", "4/4  picture"]);
    let mut convert = vec!["chart", "image", text(&picture), text(&chart), "--film-pitch-um", "2"];
    convert.extend(bands);
    lenscube(&convert).ok();
    lenscube(&[&["shoot", text(&chart), text(&other)], &own[..4]].concat()).ok();
    // The comment in the files names their jobs.
    let same = || linear(&out, Transfer::Srgb).1 == linear(&other, Transfer::Srgb).1;
    assert!(same());
    // Nothing else is left behind.
    std::fs::remove_file(&out).unwrap();
    lenscube(&base).ok();
    assert!(same() && !place.at("out.png.shot").exists());
}

#[test]
fn a_shot_of_surfaces_at_several_distances_has_the_film_of_run() {
    let place = Place::new();
    let chart = "gen:checker?size=96&overscan=0&wavelengths=500&pitch_um=2";
    let pack = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/depth/packs/six-slabs.lens.zip");
    let (picture, depth, film) = (place.at("one.png"), place.at("depth.npy"), place.at("film.zarr"));
    let near = |i: usize| if (30..70).contains(&(i / 96)) { 0.55 } else { 4.0 };
    crate::common::write_npy(
        &depth,
        pipeline::geometry::Size::new(96, 96),
        &(0..96 * 96).map(near).collect::<Vec<f32>>(),
    );
    let surfaces = ["--depth", text(&depth), "--depth-unit", "m", "--hidden", "none"];
    let shot = ["shoot", chart, text(&picture), "--lens", text(&pack), "--sensor", "ideal-mono"];
    let kept = place.at("kept");
    lenscube(&[&shot[..], &["--keep", text(&kept)], &surfaces].concat()).ok();
    crate::common::run(chart, &film, text(&pack), &surfaces).ok();
    assert!(crate::common::pixels(&film, "film") == crate::common::pixels(&kept.join("film.zarr"), "film"));
    let shading = lenscube(&[&shot[..], &["--overwrite", "--even-light", "--focus-m", "1"]].concat());
    assert_exit(&shading, USAGE, &["--even-light", "another focus"]);
}

/// The numbers x = (DN − black)/(white − black) of a DNG contain the dark charge, so S·x + O has its shot noise once.
#[test]
fn noise_profile_of_a_dng_is_that_of_its_dark_frame() {
    let place = Place::new();
    let film = place.film_named("dark.film", Size::new(200, 200), |_, _, _| 1e-12);
    let dng = place.at("dark.dng");
    let flags = ["--sensor", "example-2um", "--exposure", "1s", "--temperature", "60"];
    let noises = ["--noise", "shot,dark,read", "--set", "noise.dark_nonuniformity=0"];
    let toggles = [&flags[..], &noises].concat();
    let out = lenscube(&[&["sensor", text(&film), text(&dng)], &toggles[..]].concat());
    assert_exit(&out, 0, &[]);
    let (s, o) = noise_profile(&std::fs::read(&dng).unwrap());
    let raw = place.raw("dark.zarr", &film, &toggles);
    let a = attributes(&raw);
    let (black, white) = (a["black_dn"].as_f64().unwrap(), a["white_dn"].as_f64().unwrap());
    let x: Vec<f64> =
        frame(&raw, "raw", 0).1.iter().map(|v| (f64::from(*v) - black) / (white - black)).collect();
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    let variance = x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / x.len() as f64;
    // 40 000 pixels determine the variance to 0.7 %.
    let ratio = (s * mean + o) / variance;
    assert!(s * mean > 0.1 * o && (0.97..1.03).contains(&ratio), "{ratio}: S {s}, O {o}, mean {mean}");
}

/// The neutral is that of the light which the film records, of `--white`, or of D65 with a note.
#[test]
fn neutral_of_a_dng_is_that_of_the_charts_light() {
    let place = Place::new();
    let unknown = place.film_named("unknown.film", Size::new(64, 64), |_, _, _| 1e-3);
    let incandescent = place.run("checker?size=64&pitch_um=2&wavelengths=450,550,650&illuminant=A");
    let own = ["--sensor", "example-2um", "--exposure", "1ms"];
    let dng = |name: &str, film: &Path, more: &[&str], words: &[&str]| {
        let out = place.at(name);
        let made = lenscube(&[&["sensor", text(film), text(&out)], &own[..], more].concat());
        assert_exit(&made, 0, words);
        assert_eq!(made.stderr.contains("does not record"), !words.is_empty());
        neutral(&std::fs::read(&out).unwrap())
    };
    let d65 = dng("d65.dng", &unknown, &[], &["note: ", "d65.dng", "neutral is that of D65", "--white"]);
    let a = dng("a.dng", &incandescent, &[], &[]);
    assert!(a[0] / a[2] > 1.5 * d65[0] / d65[2], "{a:?} {d65:?}");
    assert_eq!(dng("given-a.dng", &unknown, &["--white", "A"], &[]), a);
    assert_eq!(dng("given-d65.dng", &incandescent, &["--white", "d65"], &[]), d65);
    let flags = |out: &Path, white: &str| {
        lenscube(&[&["sensor", text(&unknown), text(out)], &own[..], &["--white", white]].concat())
    };
    assert_exit(&flags(&place.at("raw.zarr"), "A"), USAGE, &["--white is the neutral of a .dng", "develop"]);
    assert_exit(&flags(&place.at("f2.dng"), "F2"), USAGE, &["F2", "D65, A or E"]);
}

/// The tag AsShotNeutral (50728) of a little-endian DNG.
fn neutral(bytes: &[u8]) -> [f64; 3] {
    let tag = bytes.windows(4).position(|w| w == [0x28, 0xc6, 5, 0]).unwrap();
    let long = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let at = long(tag + 8) as usize;
    std::array::from_fn(|k| f64::from(long(at + 8 * k)) / f64::from(long(at + 8 * k + 4)))
}

/// S and O of the tag NoiseProfile (51041) of a little-endian DNG.
fn noise_profile(bytes: &[u8]) -> (f64, f64) {
    let tag = bytes.windows(4).position(|w| w == [0x61, 0xc7, 12, 0]).unwrap();
    let at = u32::from_le_bytes(bytes[tag + 8..tag + 12].try_into().unwrap()) as usize;
    let number = |k: usize| f64::from_le_bytes(bytes[at + 8 * k..][..8].try_into().unwrap());
    (number(0), number(1))
}
