//! `lenscube chart motion`: a chart that moves during an exposure.

use crate::common::{assert_exit, lenscube, pixels, run, text, write_npy};
use pipeline::geometry::Size;
use std::f64::consts::TAU;
use std::fs;
use std::path::PathBuf;
use tempfile::TempDir;

const USAGE: i32 = 2;
const SIDE: usize = 128;
const PITCH_UM: f64 = 2.0;
/// Period of the pattern, px: with a motion of 8 px its contrast is that of half a period, 2/π.
const PERIOD_PX: f64 = 16.0;
/// The chart's middle 7.5 mm from the axis.
const PLACE: [&str; 2] = ["--axis=-2936,-2186", "--center=5.999,4.499"];
/// Films that are averaged.
const MOMENTS: usize = 16;

struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        Self(TempDir::new().unwrap())
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// A chart of an oblique pattern that is shifted by (right, down) px.
    fn chart(&self, name: &str, shift_px: (f64, f64)) -> String {
        let value = |i: usize| {
            let (y, x) = ((i / SIDE) as f64 - shift_px.1, (i % SIDE) as f64 - shift_px.0);
            (1.0 + 0.8 * (TAU * (0.8 * x + 0.6 * y) / PERIOD_PX).cos()) as f32
        };
        let path = self.at(name);
        write_npy(&path, Size::new(SIDE, SIDE), &(0..SIDE * SIDE).map(value).collect::<Vec<_>>());
        text(&path).to_owned()
    }

    fn table(&self, name: &str, rows: &str) -> String {
        let path = self.at(name);
        fs::write(&path, format!("time_s,x_um,y_um,rotation_deg\n{rows}")).unwrap();
        text(&path).to_owned()
    }
}

/// The film of the mean chart is the mean of 16 films, each of the chart drawn at its place of a moment: within the interpolation of a pattern of 16 px and the 0.2 % of its contrast by which moments
/// ½ px apart differ from an integral.
#[test]
#[ignore = "long: films of many places"]
fn the_film_of_a_moving_chart_is_the_mean_of_films_of_its_places() {
    let folder = Folder::new();
    // 8 px along the pattern in 4 ms, from a place beside the first one.
    let table = folder.table("motion.csv", "0,2,0,0\n0.004,14.8,9.6,0\n");
    let chart = folder.chart("chart.npy", (0.0, 0.0));
    let moved = folder.at("moved.zarr");
    let flags = ["--wavelengths", "550", "--film-pitch-um", "2", "--motion", &table, "--exposure", "4ms"];
    lenscube(&[&["chart", "motion", &chart, text(&moved)][..], &flags].concat()).ok();
    let of = |chart: &str, name: &str| {
        let film = folder.at(name);
        let flags = [&["--wavelengths", "550", "--film-pitch-um", "2", "--overwrite"][..], &PLACE].concat();
        run(chart, &film, "double-gauss-28-npz", &flags).ok();
        pixels(&film, "film").1.remove(0)
    };
    let found = {
        let film = folder.at("found.zarr");
        run(text(&moved), &film, "double-gauss-28-npz", &PLACE).ok();
        pixels(&film, "film").1.remove(0)
    };
    let mut mean = vec![0.0; SIDE * SIDE];
    for k in 0..MOMENTS {
        let t = (k as f64 + 0.5) / MOMENTS as f64;
        let shift = ((2.0 + 12.8 * t) / PITCH_UM, 9.6 * t / PITCH_UM);
        let film = of(&folder.chart("place.npy", shift), "place.zarr");
        mean.iter_mut().zip(film).for_each(|(to, v)| *to += f64::from(v) / MOMENTS as f64);
    }
    let still = of(&chart, "still.zarr");
    // Beyond the chart its last pixel counts on, which the drawn ones do not have.
    let inside = |i: &usize| (40..SIDE - 40).contains(&(i / SIDE)) && (40..SIDE - 40).contains(&(i % SIDE));
    let swing = |film: &dyn Fn(usize) -> f64| {
        let all: Vec<f64> = (0..SIDE * SIDE).filter(inside).map(film).collect();
        all.iter().copied().fold(f64::MIN, f64::max) - all.iter().copied().fold(f64::MAX, f64::min)
    };
    let amplitude = swing(&|i| f64::from(still[i]));
    let ratio = swing(&|i| f64::from(found[i])) / amplitude;
    assert!((ratio - 2.0 / std::f64::consts::PI).abs() < 0.01, "{ratio}");
    let worst = (0..SIDE * SIDE).filter(inside).map(|i| (f64::from(found[i]) - mean[i]).abs());
    let worst = worst.fold(0.0, f64::max);
    assert!(worst < 4e-3 * amplitude, "{worst} of {amplitude}");
}

#[test]
fn what_a_motion_of_a_chart_cannot_be_is_said_before_any_work() {
    let folder = Folder::new();
    let chart = folder.chart("chart.npy", (0.0, 0.0));
    let good = folder.table("good.csv", "0,0,0,0\n0.004,4,0,0\n");
    let rates = folder.at("rates.csv");
    fs::write(&rates, "time_s,rate_x_deg_s,rate_y_deg_s,rate_z_deg_s\n0,0,0,0\n1,1,1,1\n").unwrap();
    let far = folder.table("far.csv", "0,0,0,0\n0.004,40000,0,0\n");
    let short = folder.table("short.csv", "0,0,0,0\n0.001,4,0,0\n");
    let out = folder.at("out.zarr");
    let nm = ["--wavelengths", "550"];
    let pitch = ["--film-pitch-um", "2"];
    let cases: [(&str, &str, &[&str], &str); 5] = [
        (&chart, &good, &nm, "give --film-pitch-um"),
        (&chart, text(&rates), &[&nm[..], &pitch].concat(), "rates of a gyroscope"),
        (&chart, &far, &[&nm[..], &pitch].concat(), "expected at most 2048 and 20000"),
        (&chart, &short, &[&nm[..], &pitch].concat(), "expected times from 0 to 0.004 s"),
        ("gen:depth-scene?size=64&wavelengths=550", &good, &[], "has distances"),
    ];
    for (chart, table, flags, expected) in cases {
        let words = ["chart", "motion", chart, text(&out), "--motion", table, "--exposure", "4ms"];
        let result = lenscube(&[&words[..], flags].concat());
        assert_exit(&result, USAGE, &[expected]);
        assert!(!out.exists(), "{expected}");
    }
}
