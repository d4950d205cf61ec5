//! Sensors whose pixels collect light and charge of others, and whose pixels fill with a knee.

use super::USAGE;
use crate::common::camera::{IRRADIANCE, Place, attributes, develop, frame, sensor, window};
use crate::common::{assert_exit, files, lenscube};
use formats::chart::image::{ImageFile, Transfer};
use pipeline::geometry::{Rect, Size};
use std::fs;
use std::path::{Path, PathBuf};

/// Black and full well of the sensor; its gain is 1 DN/e-.
const BLACK: f64 = 100.0;
const WELL: f64 = 50_000.0;
/// Shares of the pixels around, by wavelength.
const TABLE: &str =
    "wavelength_nm,0:1,0:-1,1:0,-1:0,1:1\n450,0.01,0.02,0.03,0.01,0.002\n650,0.05,0.04,0.06,0.08,0.01\n";

/// A sensor without noise of the filters `pattern`, with more fields.
fn description(place: &Place, name: &str, (pixel, pattern, more): (&str, &str, &str)) -> PathBuf {
    fs::write(place.at("near.csv"), TABLE).unwrap();
    fs::write(
        place.at("qe.csv"),
        "wavelength_nm,Y,R,G,B\n400,0.5,0.02,0.1,0.4\n460,0.5,0.03,0.2,0.6\n540,0.5,0.1,0.6,0.15\n620,0.5,0.5,0.2,0.03\n700,0.5,0.4,0.1,0.02\n",
    )
    .unwrap();
    let filters: String = ["Y", "R", "G", "B"]
        .iter()
        .filter(|f| pattern.contains(**f))
        .fold(String::new(), |all, f| format!("{all}{f} = {{ column = \"{f}\" }}\n"));
    let path = place.at(&format!("{name}.toml"));
    let text = format!(
        "schema = \"lenscube/sensor/1\"\nname = \"{name}\"\ndescription = \"a test\"\n[pixel]\npitch_um = \"film\"\nfull_well_e = {WELL}\n{pixel}\n\
         [adc]\nbits = 16\ngain_dn_per_e = 1.0\nblack_dn = {BLACK}\n[spectral]\nfile = \"qe.csv\"\nquantity = \"quantum_efficiency\"\n\
         [cfa]\npattern = {pattern}\n{filters}\n{more}\n[source]\n\"*\" = \"a test\"\n"
    );
    fs::write(&path, text).unwrap();
    path
}

const MONO: &str = "[[\"Y\"]]";
const BAYER: &str = "[[\"R\", \"G\"], [\"G\", \"B\"]]";
const NEAR: &str = "[crosstalk]\nfile = \"near.csv\"";

/// A film with one bright pixel, in a dim one.
fn film_of_a_point(place: &Place, bright: f32) -> PathBuf {
    let value = |y: usize, x: usize| if (y, x) == (20, 30) { bright } else { 0.02 };
    place.film(Size::new(41, 60), &[450.0, 550.0, 650.0], IRRADIANCE, |_, y, x| value(y, x))
}

fn raw(place: &Place, name: &str, film: &Path, (file, exposure): (&Path, &str), flags: &[&str]) -> PathBuf {
    let out = place.at(name);
    let own = ["--sensor", file.to_str().unwrap(), "--exposure", exposure];
    sensor(film, &out, &[&own[..], flags].concat()).ok();
    out
}

fn numbers(raw: &Path) -> Vec<f64> {
    frame(raw, "raw", 0).1.iter().map(|v| f64::from(*v) - BLACK).collect()
}

#[test]
fn neighbours_collect_their_shares_and_light_is_kept() {
    let place = Place::new();
    let film = film_of_a_point(&place, 1.0);
    let own = |name: &str, more: &str| {
        let file = description(&place, name, ("", MONO, more));
        numbers(&raw(&place, &format!("{name}.zarr"), &film, (&file, "20us"), &["--noise", "none"]))
    };
    let (none, near) = (own("none", ""), own("near", NEAR));
    let at = |of: &[f64], down: i64, right: i64| of[((20 + down) * 60 + 30 + right) as usize];
    let more = at(&none, 0, 0) - at(&none, 0, 5);
    // Mean over the bands of photons: 0.03, 0.04 and 0.05 at 450, 550 and 650 nm weigh with the wavelength.
    let mean = |a: f64, b: f64, c: f64| (450.0 * a + 550.0 * b + 650.0 * c) / 1650.0;
    for ((down, right), (first, last)) in [
        ((0, 1), (0.01, 0.05)),
        ((0, -1), (0.02, 0.04)),
        ((1, 0), (0.03, 0.06)),
        ((-1, 0), (0.01, 0.08)),
        ((1, 1), (0.002, 0.01)),
    ] {
        let share = (at(&near, down, right) - at(&near, 0, 5)) / more;
        let expected = mean(first, 0.5 * (first + last), last);
        assert!((share - expected).abs() < 2e-3, "{down} {right}: {share} {expected}");
    }
    assert!((at(&near, -1, -1) - at(&near, 0, 5)).abs() <= 1.0);
    let total = |of: &[f64]| of.iter().sum::<f64>();
    assert!((total(&near) / total(&none) - 1.0).abs() < 1e-4);
    let shown = lenscube(&["sensor", "show", place.at("near.toml").to_str().unwrap()]).ok();
    assert!(
        shown.stdout.contains("crosstalk") && shown.stdout.contains("7.20 % of the charge of 450 nm"),
        "{}",
        shown.stdout
    );
}

#[test]
fn windows_kept_signals_and_threads_give_the_bits_of_the_whole() {
    let place = Place::new();
    let film = film_of_a_point(&place, 20.0);
    let more = format!("{NEAR}\ndiffusion_length_um = 4\ndepletion_um = 1\n");
    let file = description(&place, "all", ("knee = 0.8\nblooming = 1.0", BAYER, &more));
    let of = (&*file, "40us,20us");
    let whole = raw(&place, "whole.zarr", &film, of, &["--frames", "2", "--threads", "1"]);
    let again =
        raw(&place, "again.zarr", &film, of, &["--frames", "2", "--threads", "3", "--memory", "200MiB"]);
    assert!(files(&whole) == files(&again));
    let part = raw(&place, "part.zarr", &film, of, &["--frames", "2", "--roi", "28,3,9,30"]);
    for f in 0..4 {
        let (size, pixels) = frame(&whole, "raw", f);
        assert_eq!(frame(&part, "roi_0", f).1, window(size, &pixels, Rect::new(3, 28, 30, 9)), "frame {f}");
    }
    let kept = raw(&place, "kept.zarr", &film, (&file, "70us"), &["--keep-signal"]);
    let from = place.at("from-kept.zarr");
    sensor(&kept, &from, &["--exposure", "40us,20us", "--frames", "2"]).ok();
    assert!(files(&from) == files(&whole));
    // Another crosstalk is another signal, another overflow is not.
    let named = file.to_str().unwrap();
    let flags = |set: &'static str| ["--exposure", "1ms", "--sensor", named, "--set", set];
    let other = sensor(&kept, &place.at("no"), &flags("crosstalk.depletion_um=2"));
    assert_exit(&other, USAGE, &["another sensor", "crosstalk"]);
    sensor(&kept, &place.at("other-well.zarr"), &flags("pixel.blooming=0")).ok();
    // A raw that lacks a shard is completed.
    fs::remove_file(whole.join("raw/c/2/0/0")).unwrap();
    let own = ["--sensor", named, "--exposure", "40us,20us", "--frames", "2"];
    sensor(&film, &whole, &own).ok();
    assert!(files(&again) == files(&whole));
}

#[test]
fn a_full_pixel_fills_its_column() {
    let place = Place::new();
    let film = film_of_a_point(&place, 20.0);
    let of = |name: &str, pixel: &str| {
        let file = description(&place, name, (pixel, MONO, ""));
        numbers(&raw(&place, &format!("{name}.zarr"), &film, (&file, "20us"), &["--noise", "none"]))
    };
    let (drained, bloomed) = (of("drained", ""), of("bloomed", "blooming = 1"));
    let (at, dim) = (|of: &[f64], y: usize, x: usize| of[y * 60 + x], drained[0]);
    assert_eq!((at(&drained, 20, 30), at(&bloomed, 20, 30)), (WELL, WELL));
    let full = (0..41).filter(|y| at(&bloomed, *y, 30) == WELL).count();
    assert!((5..40).contains(&full), "{full}");
    let gained: f64 = bloomed.iter().sum::<f64>() - drained.iter().sum::<f64>();
    // 20/0.02 times the dim pixels' charge, less what the bright one holds.
    let excess = dim * 1000.0 - WELL;
    assert!((gained / excess - 1.0).abs() < 1e-3, "{gained} {excess}");
    for y in 0..41 {
        assert_eq!(at(&bloomed, y, 30), at(&bloomed, 40 - y, 30));
        assert_eq!(at(&bloomed, y, 29), dim);
    }
    let knee = of("knee", "knee = 0.5");
    assert!(at(&knee, 20, 30) == WELL && knee[0] == dim);
    let shown = lenscube(&["sensor", "show", place.at("knee.toml").to_str().unwrap()]).ok();
    assert!(shown.stdout.contains("knee at 50 % of the full well"), "{}", shown.stdout);
}

/// Crosstalk makes the filters more alike: white gains and matrices are those of what they respond to, so that grey stays grey.
#[test]
fn colours_are_balanced_for_what_filters_get_from_their_neighbours() {
    let place = Place::new();
    let film = place.run("uniform?size=64&pitch_um=2&value=0.5");
    let gains = |name: &str, more: &str| {
        let file = description(&place, name, ("", BAYER, more));
        let out = raw(&place, &format!("{name}.zarr"), &film, (&file, "20ms"), &["--noise", "none"]);
        let picture = place.at(&format!("{name}.png"));
        develop(&out, &picture, &[]).ok();
        let middle = Rect::new(32, 32, 1, 1);
        let pixel = ImageFile::open(&picture).unwrap().linear_part(Transfer::Linear, middle).unwrap();
        assert!(pixel.iter().all(|v| (v - pixel[1]).abs() < 2.0 / 255.0), "{name}: {pixel:?}");
        attributes(&out)["white_gains"]["D65"]["R"].as_f64().unwrap()
    };
    let (none, strong) = (gains("none", ""), gains("strong", "[crosstalk]\nfile = \"near.csv\""));
    assert!(none > 1.2 && strong < none - 0.02, "{none} {strong}");
}

#[test]
fn descriptions_that_are_not_possible_are_one_clear_error() {
    let place = Place::new();
    let film = film_of_a_point(&place, 1.0);
    let tables = [
        ("sum", "wavelength_nm,0:0,0:1\n500,0.9,0.2\n"),
        ("twice", "wavelength_nm,0:1,0:1\n500,0.1,0.1\n"),
        ("far", "wavelength_nm,0:4\n500,0.1\n"),
        ("less", "wavelength_nm,0:1\n500,-0.1\n"),
        ("none", "wavelength_nm\n500\n"),
        ("more", "wavelength_nm,0:1,1:0\n500,0.6,0.6\n"),
        ("empty", "wavelength_nm,0:1\n"),
    ];
    for (name, text) in tables {
        fs::write(place.at(&format!("{name}.csv")), text).unwrap();
    }
    for (pixel, more, expected) in [
        ("", "[crosstalk]\nfile = \"sum.csv\"", "line 2: expected shares whose sum is 1, found 1.1"),
        ("", "[crosstalk]\nfile = \"twice.csv\"", "column 0:1: expected DOWN:RIGHT"),
        ("", "[crosstalk]\nfile = \"far.csv\"", "within 3 pixels"),
        ("", "[crosstalk]\nfile = \"less.csv\"", "expected shares of 0 to 1, found -0.1"),
        ("", "[crosstalk]\nfile = \"none.csv\"", "columns of pixels around"),
        ("", "[crosstalk]\nfile = \"more.csv\"", "at most 1, found 1.2"),
        ("", "[crosstalk]\nfile = \"empty.csv\"", "a row of numbers or more, found 0"),
        ("", "[crosstalk]\nfile = \"not-there.csv\"", "no file not-there.csv"),
        ("", "[crosstalk]\n", "neither"),
        ("", "[crosstalk]\ndiffusion_length_um = 3", "both diffusion_length_um and depletion_um"),
        ("", "[crosstalk]\ndiffusion_length_um = 0\ndepletion_um = 1", "crosstalk.diffusion_length_um"),
        ("", "[crosstalk]\ndiffusion_length_um = 3\ndepletion_um = nan", "crosstalk.depletion_um"),
        ("", "[crosstalk]\ndifusion = 3", "unknown field `difusion`"),
        ("knee = 0", "", "pixel.knee: expected above 0, at most 1, found 0"),
        ("blooming = 1.5", "", "pixel.blooming: expected 0 to 1, found 1.5"),
    ] {
        let file = description(&place, "bad", (pixel, MONO, more));
        let flags = ["--sensor", file.to_str().unwrap(), "--exposure", "1ms"];
        assert_exit(&sensor(&film, &place.at("no"), &flags), USAGE, &[expected]);
        assert!(!place.at("no").exists());
    }
    // Charge that spreads far is said.
    let wide = "[crosstalk]\ndiffusion_length_um = 50\ndepletion_um = 0.5";
    let file = description(&place, "wide", ("", MONO, wide));
    let done =
        sensor(&film, &place.at("wide.zarr"), &["--sensor", file.to_str().unwrap(), "--exposure", "1ms"])
            .ok();
    assert!(
        done.stderr.contains("warning: ") && done.stderr.contains("spreads farther than 3 pixels"),
        "{}",
        done.stderr
    );
}
