//! A camera that moves during its exposure.

use super::USAGE;
use crate::common::camera::{IRRADIANCE, Place, frame, sensor, window};
use crate::common::{assert_exit, files};
use pipeline::geometry::{Rect, Size};
use std::fs;
use std::path::{Path, PathBuf};

/// Black of ideal-mono, DN.
const BLACK: f64 = 1024.0;
const HEAD: &str = "time_s,x_um,y_um,rotation_deg\n";
/// The sensor's 60 x 40 pixels of 2 µm lie in the middle of the film's 120 x 80.
const OWN: [&str; 8] =
    ["--sensor", "ideal-mono", "--size", "60x40", "--noise", "none", "--set", "adc.gain_dn_per_e=0.5"];

/// A film of a bright column and a point, in a dim light.
fn film(place: &Place) -> PathBuf {
    let value = |y: usize, x: usize| match (y, x) {
        (40, 50) => 1e-3,
        (_, 70) => 4e-4,
        _ => 1e-5,
    };
    place.film(Size::new(80, 120), &[450.0, 550.0, 650.0], IRRADIANCE, |_, y, x| value(y, x))
}

fn table(place: &Place, name: &str, rows: &str) -> PathBuf {
    let path = place.at(name);
    fs::write(&path, format!("{HEAD}{rows}")).unwrap();
    path
}

fn exposed(place: &Place, name: &str, film: &Path, motion: Option<&Path>, flags: &[&str]) -> PathBuf {
    let motion: Vec<&str> = motion.iter().flat_map(|m| ["--motion", m.to_str().unwrap()]).collect();
    place.raw(name, film, &[&OWN[..], &motion, flags].concat())
}

fn numbers(raw: &Path) -> Vec<f64> {
    frame(raw, "raw", 0).1.iter().map(|v| f64::from(*v) - BLACK).collect()
}

#[test]
fn a_point_becomes_a_line_and_keeps_its_light() {
    let place = Place::new();
    let film = film(&place);
    let right = table(&place, "right.csv", "0,0,0,0\n0.01,20,0,0\n");
    let time = ["--exposure", "10ms"];
    let still = numbers(&exposed(&place, "still.zarr", &film, None, &time));
    let moved_raw = exposed(&place, "moved.zarr", &film, Some(&right), &time);
    let moved = numbers(&moved_raw);
    // Row 20 of the sensor is row 40 of the film; its column 20 the film's 50. Twenty µm are ten pixels.
    let (row, dim) = (|of: &[f64]| of[20 * 60..21 * 60].to_vec(), still[0]);
    let point = row(&still)[20] - dim;
    for (k, v) in row(&moved).iter().enumerate().take(36) {
        let expected = match k {
            21..30 => 0.1,
            20 | 30 => 0.05,
            _ => 0.0,
        };
        let share = (v - dim) / point;
        assert!((share - expected).abs() < 0.01, "{k}: {share}, expected {expected}");
    }
    let light = |of: &[f64]| of.iter().sum::<f64>();
    assert!((light(&moved) / light(&still) - 1.0).abs() < 1e-3);
    // Windows and threads have the bits of the whole; a raw of another motion is another.
    let part = exposed(
        &place,
        "part.zarr",
        &film,
        Some(&right),
        &[&time[..], &["--roi", "7,11,40,20", "--threads", "1"]].concat(),
    );
    let (size, pixels) = frame(&moved_raw, "raw", 0);
    assert_eq!(frame(&part, "roi_0", 0).1, window(size, &pixels, Rect::new(11, 7, 20, 40)));
    let again =
        exposed(&place, "again.zarr", &film, Some(&right), &[&time[..], &["--threads", "3"]].concat());
    assert!(files(&again) == files(&moved_raw));
    assert_exit(&sensor(&film, &moved_raw, &[&OWN[..], &time].concat()), 3, &["another job"]);
    // A table of rest is no motion.
    let rest = table(&place, "rest.csv", "0,0,0,0\n1,0,0,0\n");
    assert_eq!(numbers(&exposed(&place, "rest.zarr", &film, Some(&rest), &time)), still);
}

/// A constant rate is a shift that grows with time; the camera turns up and to the right, the picture moves down and to the left, and counter-clockwise as the camera turns clockwise.
#[test]
fn rates_of_a_gyroscope_are_shifts_by_the_focal_length() {
    let place = Place::new();
    let film = film(&place);
    let time = ["--exposure", "10ms"];
    // 20 mm times the tangent of 0.04 degrees; 0.3 degrees.
    let shift_um = 20e3 * 0.04f64.to_radians().tan();
    let shifts = table(&place, "shifts.csv", &format!("0,0,0,0\n0.01,{},{shift_um},-0.3\n", -shift_um));
    let rates = place.at("rates.csv");
    fs::write(
        &rates,
        "time_s,rate_x_deg_s,rate_y_deg_s,rate_z_deg_s\n-0.001,4,4,30\n0.004,4,4,30\n0.011,4,4,30\n",
    )
    .unwrap();
    let expected = numbers(&exposed(&place, "shifts.zarr", &film, Some(&shifts), &time));
    let flags = [&time[..], &["--focal-length-mm", "20"]].concat();
    let found = numbers(&exposed(&place, "rates.zarr", &film, Some(&rates), &flags));
    let still = numbers(&exposed(&place, "still.zarr", &film, None, &time));
    let largest = |a: &[f64]| a.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let peak = still.iter().copied().fold(0.0, f64::max);
    assert!(largest(&found) < 1e-3 * peak && largest(&still) > 0.5 * peak, "{} {peak}", largest(&found));
    let refused = |file: &Path, flags: &[&str], expected: &str| {
        let all = [&OWN[..], &["--motion", file.to_str().unwrap()], &time, flags].concat();
        assert_exit(&sensor(&film, &place.at("no"), &all), USAGE, &[expected]);
    };
    refused(&rates, &[], "give --focal-length-mm");
    refused(&shifts, &["--focal-length-mm", "20"], "has shifts of the picture");
}

/// A frame that begins later sees the table from there on.
#[test]
fn an_exposure_begins_at_a_time_of_the_table() {
    let place = Place::new();
    let film = film(&place);
    let table_of = |name: &str, from: f64| {
        let rows = [(0.0, 0.0), (0.01, 4.0), (0.02, 20.0), (0.04, 24.0)];
        let row = |(t, x): (f64, f64)| format!("{},{x},{},0\n", t - from, 0.5 * x);
        table(&place, name, &rows.map(row).concat())
    };
    let (whole, later) = (table_of("whole.csv", 0.0), table_of("later.csv", 0.015));
    let exposed = |name: &str, motion: &Path, flags: &[&str]| {
        numbers(&exposed(&place, name, &film, Some(motion), &[&["--exposure", "10ms"], flags].concat()))
    };
    let found = exposed("a.zarr", &whole, &["--motion-start", "15ms"]);
    assert!(found == exposed("b.zarr", &later, &[]));
    assert!(found != exposed("c.zarr", &whole, &["--motion-start", "0"]));
    // Rates of a log that begins at another time: their angles count from its first row.
    let rates = |name: &str, from: f64| {
        let row = |t: f64| format!("{},4,4,0\n", from + t);
        let path = place.at(name);
        let text =
            format!("time_s,rate_x_deg_s,rate_y_deg_s,rate_z_deg_s\n{}", [0.0, 0.02].map(row).concat());
        fs::write(&path, text).unwrap();
        path
    };
    let focal = ["--focal-length-mm", "20"];
    let found = exposed("d.zarr", &rates("late.csv", 2.0), &[&focal[..], &["--motion-start", "2s"]].concat());
    let expected = exposed("e.zarr", &rates("early.csv", 0.0), &focal);
    let largest = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let peak = expected.iter().copied().fold(0.0, f64::max);
    assert!(largest < 1e-3 * peak, "{largest} of {peak}");
    let flags = ["--exposure", "10ms", "--motion", whole.to_str().unwrap(), "--motion-start", "31ms"];
    let refused = sensor(&film, &place.at("no"), &[&OWN[..], &flags].concat());
    assert_exit(&refused, USAGE, &["expected times from 0.031 to 0.041"]);
}

#[test]
fn a_rolling_shutter_slants_a_column() {
    let place = Place::new();
    let film = film(&place);
    let right = table(&place, "right.csv", "0,0,0,0\n0.05,50,0,0\n");
    let flags = ["--exposure", "100us", "--set", "shutter.row_time_us=1000", "--set", "adc.gain_dn_per_e=4"];
    let raw = exposed(&place, "slanted.zarr", &film, Some(&right), &flags);
    let all = numbers(&raw);
    for y in [2, 10, 30, 38] {
        let row = &all[y * 60..][..60];
        let dim = row[5];
        let (sum, moment) = row
            .iter()
            .enumerate()
            .skip(30)
            .fold((0.0, 0.0), |(s, m), (x, v)| (s + v - dim, m + (v - dim) * x as f64));
        // Column 40 of the sensor; 0.5 px a row of 1 ms, and half of 100 µs.
        let expected = 40.0 + 0.5 * (y as f64 + 0.05);
        assert!((moment / sum - expected).abs() < 0.1, "row {y}: {} {expected}", moment / sum);
    }
}

#[test]
fn motions_that_are_not_possible_are_one_clear_error() {
    let place = Place::new();
    let film = film(&place);
    let bad = |name: &str, rows: &str, flags: &[&str], expected: &[&str]| {
        let file = table(&place, name, rows);
        let all = [&OWN[..], &["--motion", file.to_str().unwrap()], flags].concat();
        assert_exit(&sensor(&film, &place.at("no"), &all), USAGE, expected);
        assert!(!place.at("no").exists());
    };
    let (good, time) = ("0,0,0,0\n0.01,20,0,0\n", ["--exposure", "10ms"]);
    bad("auto.csv", good, &["--exposure", "auto"], &["--motion", "one frame of one exposure time"]);
    bad("two.csv", good, &["--exposure", "10ms", "--frames", "2"], &["one frame"]);
    bad("several.csv", good, &["--exposure", "1ms,2ms"], &["one frame"]);
    bad("kept.csv", good, &["--exposure", "10ms", "--keep-signal"], &["--keep-signal"]);
    bad("short.csv", good, &["--exposure", "11ms"], &["expected times from 0 to 0.011 s", "0 to 0.01 s"]);
    bad("late.csv", "0.001,0,0,0\n0.02,0,0,0\n", &time, &["expected times from 0"]);
    bad("far.csv", "0,0,0,0\n0.01,100,0,0\n", &time, &["100.00 µm", "40.00 µm beyond the sensor", "--size"]);
    bad("back.csv", "0,0,0,0\n0,1,0,0\n", &time, &["line 3", "time_s above 0"]);
    bad("word.csv", "0,0,0,0\n0.01,some,0,0\n", &time, &["line 3, column x_um"]);
    let other = place.at("other.csv");
    fs::write(&other, "time_s,x_um\n0,0\n").unwrap();
    let all = [&OWN[..], &["--motion", other.to_str().unwrap()], &time].concat();
    assert_exit(&sensor(&film, &place.at("no"), &all), USAGE, &["y_um"]);
    let kept = place.raw("kept.zarr", &film, &[&OWN[..], &["--exposure", "1ms", "--keep-signal"]].concat());
    let named = place.at("auto.csv");
    let flags = ["--exposure", "1ms", "--motion", named.to_str().unwrap()];
    assert_exit(&sensor(&kept, &place.at("no"), &flags), USAGE, &["--motion", "are for films"]);
}
