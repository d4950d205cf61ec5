//! Defects of a die, rows that start one after another in a flickering light, and brackets that develop into one picture.

use super::USAGE;
use crate::common::assert_exit;
use crate::common::camera::{IRRADIANCE, Place, develop, frame, sensor, window};
use formats::chart::image::{ImageFile, Transfer};
use pipeline::geometry::{Rect, Size};
use std::path::{Path, PathBuf};

/// Black of example-2um, DN.
const BLACK: f64 = 256.0;
const SENSOR: &str = "example-2um";

fn raw(place: &Place, name: &str, film: &Path, flags: &[&str]) -> PathBuf {
    place.raw(name, film, &[&["--sensor", SENSOR], flags].concat())
}

fn numbers(raw: &Path, number: usize) -> Vec<f64> {
    frame(raw, "raw", number).1.iter().map(|v| f64::from(*v) - BLACK).collect()
}

fn dark(place: &Place) -> PathBuf {
    place.film(Size::new(200, 220), &[450.0, 550.0, 650.0], IRRADIANCE, |_, _, _| 1e-9)
}

#[test]
fn defects_have_their_density_stay_in_place_and_are_corrected() {
    let place = Place::new();
    let film = dark(&place);
    let flags = [
        "--exposure",
        "1s",
        "--frames",
        "2",
        "--set",
        "defects.hot_pixels=0.002",
        "--set",
        "defects.hot_dark_e_per_s=3000",
    ];
    let out = raw(&place, "hot.zarr", &film, &flags);
    let hot = |frame: usize| -> Vec<usize> {
        let all = numbers(&out, frame);
        (0..all.len()).filter(|k| all[*k] > 30.0).collect()
    };
    let (first, second) = (hot(0), hot(1));
    // 44,000 pixels of which 88 are hot, 96 % of them above 30 DN, 107 e-.
    assert!((55..120).contains(&first.len()), "{}", first.len());
    let same = first.iter().filter(|k| second.contains(k)).count();
    assert!(same as f64 > 0.97 * first.len() as f64, "{same} of {}", first.len());
    // Another die has others; without dark current there are none; a window has those of the whole.
    let part = raw(&place, "part.zarr", &film, &[&flags[..], &["--roi", "7,5,90,80"]].concat());
    let (size, pixels) = frame(&out, "raw", 1);
    assert_eq!(frame(&part, "roi_0", 1).1, window(size, &pixels, Rect::new(5, 7, 80, 90)));
    let none = raw(&place, "none.zarr", &film, &[&flags[..], &["--noise", "shot,read"]].concat());
    assert!(numbers(&none, 0).iter().all(|v| *v < 30.0));
    let light = |name: &str, more: &[&str]| {
        let picture = place.at(name);
        let own = ["--matrix", "none", "--demosaic", "bilinear", "--white", "1,1,1"];
        develop(&out, &picture, &[&own[..], more].concat()).ok();
        ImageFile::open(&picture).unwrap().linear_part(Transfer::Linear, size.rect()).unwrap()
    };
    let brightest = |of: &[f32]| of.iter().copied().fold(0.0, f32::max);
    let (plain, corrected) = (light("plain.exr", &[]), light("corrected.exr", &["--correct-defects"]));
    assert!(brightest(&plain) > 0.2 && brightest(&corrected) < 0.02, "{}", brightest(&corrected));
}

#[test]
fn telegraph_noise_has_two_levels() {
    let place = Place::new();
    let film = dark(&place);
    let set = ["--set", "defects.telegraph_pixels=0.02", "--set", "defects.telegraph_e=400"];
    let flags = [&["--exposure", "1ms", "--frames", "8"][..], &set].concat();
    let out = raw(&place, "telegraph.zarr", &film, &flags);
    let frames: Vec<Vec<f64>> = (0..8).map(|f| numbers(&out, f)).collect();
    let of = |k: usize| frames.iter().map(|f| f[k]).collect::<Vec<f64>>();
    // Pixels whose levels are 100 DN apart or more: 2 % · e^(−357 e-/400 e-) of 44,000, but for those that stay in one level.
    let wide: Vec<Vec<f64>> = (0..frames[0].len())
        .map(of)
        .filter(|v| {
            v.iter().copied().fold(f64::MIN, f64::max) - v.iter().copied().fold(f64::MAX, f64::min) > 100.0
        })
        .collect();
    let expected = 44_000.0 * 0.02 * (-357.0f64 / 400.0).exp() * (1.0 - 2.0 / 256.0);
    assert!((wide.len() as f64 / expected - 1.0).abs() < 0.2, "{} {expected}", wide.len());
    for values in &wide {
        let middle = 0.5
            * (values.iter().copied().fold(f64::MIN, f64::max)
                + values.iter().copied().fold(f64::MAX, f64::min));
        assert!(values.iter().all(|v| (v - middle).abs() > 40.0), "{values:?}");
    }
}

#[test]
fn rows_see_a_flickering_light_at_their_time() {
    let place = Place::new();
    let film = place.film(Size::new(200, 60), &[450.0, 550.0, 650.0], IRRADIANCE, |_, _, _| 5e-4);
    let own = ["--exposure", "2ms", "--noise", "none", "--set", "shutter.row_time_us=50", "--frames", "2"];
    let steady = numbers(&raw(&place, "steady.zarr", &film, &own), 0);
    let out = raw(&place, "flicker.zarr", &film, &[&own[..], &["--flicker", "100:0.4:1ms"]].concat());
    for number in 0..2 {
        let seen = numbers(&out, number);
        for row in 0..200 {
            // Mean over 2 ms of 1 + 0.4 cos(2π 100 Hz t); a frame of 200 rows takes 10 ms.
            let start_s = 1e-3 + 10e-3 * number as f64 + 50e-6 * row as f64;
            let power = |k: usize| {
                1.0 + 0.4 * (628.318_530_717_958_6 * (start_s + 2e-3 * (k as f64 + 0.5) / 500.0)).cos()
            };
            let expected = (0..500).map(power).sum::<f64>() / 500.0;
            let (got, of) = (seen[row * 60 + 31], steady[row * 60 + 31]);
            assert!((got - of * expected).abs() <= 1.0, "{number} {row}: {got} {}", of * expected);
        }
    }
    // An exposure of one period sees none.
    let even =
        raw(&place, "even.zarr", &film, &["--exposure", "10ms", "--noise", "none", "--flicker", "100:1"]);
    let without = raw(&place, "without.zarr", &film, &["--exposure", "10ms", "--noise", "none"]);
    assert_eq!(numbers(&even, 0), numbers(&without, 0));
    for (text, expected) in [
        ("100", "expected a modulation of 0 to 1"),
        ("0:0.5", "expected a frequency in Hz"),
        ("100:1.5", "found `1.5`"),
        ("100:0.5:soon", "is no time"),
    ] {
        let no =
            sensor(&film, &place.at("no"), &["--sensor", SENSOR, "--exposure", "1ms", "--flicker", text]);
        assert_exit(&no, USAGE, &["--flicker", expected]);
    }
}

/// Light of 1 to 1000 in one picture.
#[test]
fn a_bracket_develops_into_one_picture_of_a_wider_range() {
    let place = Place::new();
    let level = |x: usize| 5e-6 * 10f32.powf(3.0 * x as f32 / 299.0);
    let film = place.film(Size::new(64, 300), &[450.0, 550.0, 650.0], IRRADIANCE, |_, _, x| level(x));
    let out = raw(&place, "bracket.zarr", &film, &["--exposure", "160ms,10ms,0.6ms"]);
    let merged = place.at("merged.exr");
    let flags = ["--merge", "--matrix", "none", "--demosaic", "bilinear", "--white", "1,1,1"];
    develop(&out, &merged, &flags).ok();
    let pixels =
        ImageFile::open(&merged).unwrap().linear_part(Transfer::Linear, Rect::new(0, 0, 64, 300)).unwrap();
    let green = |x: usize| (10..54).map(|y| f64::from(pixels[(64 + y) * 300 + x])).sum::<f64>() / 44.0;
    let scale = green(60) / f64::from(level(60));
    for x in [20, 100, 140, 180, 220, 260, 290] {
        let ratio = green(x) / (scale * f64::from(level(x)));
        // Noise of the mean of 44 pixels, of which half are green: about 0.5 % in the dark.
        assert!((ratio - 1.0).abs() < 0.03, "{x}: {ratio}");
    }
    assert!(green(299) > 20.0);
    let one = raw(&place, "one.zarr", &film, &["--exposure", "10ms", "--frames", "2"]);
    assert_exit(
        &develop(&one, &place.at("no.exr"), &["--merge"]),
        USAGE,
        &["--merge", "several exposure times"],
    );
    assert!(!place.at("no.exr").exists());
}

#[test]
fn rows_of_a_power_law_are_alike_and_stay_in_windows() {
    let place = Place::new();
    let film = dark(&place);
    let own = ["--exposure", "1ms", "--noise", "row", "--set", "noise.row_noise_e=40"];
    let white = raw(&place, "white.zarr", &film, &own);
    let set = ["--set", "noise_spectrum.row_exponent=1.5"];
    let out = raw(&place, "rows.zarr", &film, &[&own[..], &set].concat());
    // Mean square of the step from row to row over that of white noise.
    let steps = |raw: &Path| -> f64 {
        let rows: Vec<f64> = numbers(raw, 0).chunks(220).map(|row| row[7]).collect();
        rows.windows(2).map(|v| (v[1] - v[0]) * (v[1] - v[0])).sum::<f64>()
    };
    assert!(steps(&out) < 0.3 * steps(&white), "{} {}", steps(&out), steps(&white));
    let part = raw(&place, "part.zarr", &film, &[&own[..], &set, &["--roi", "7,120,30,70"]].concat());
    let (size, pixels) = frame(&out, "raw", 0);
    assert_eq!(frame(&part, "roi_0", 0).1, window(size, &pixels, Rect::new(120, 7, 70, 30)));
    assert_exit(
        &sensor(&film, &white, &[&["--sensor", SENSOR], &own[..], &set].concat()),
        3,
        &["another job"],
    );
    let shown = crate::common::lenscube(&[&["sensor", "show", SENSOR][..], &set].concat()).ok();
    assert!(shown.stdout.contains("rows 0.3 e- (1/f^1.5)"), "{}", shown.stdout);
    let no = ["--sensor", SENSOR, "--exposure", "1ms", "--set", "noise_spectrum.column_exponent=3"];
    assert_exit(
        &sensor(&film, &place.at("no"), &no),
        USAGE,
        &["noise_spectrum.column_exponent: expected 0 to 2, found 3"],
    );
}
