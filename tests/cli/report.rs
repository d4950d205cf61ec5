//! `lenscube report`: each figure on a picture whose answer is known in closed form, the page of two cameras, and refusals.

mod cameras;
mod set_values;
mod sharpness;

use crate::common::{assert_exit, lenscube, text};
use formats::developed::{Developed, write_exr};
use formats::export::ExportError;
use pipeline::chart::Generator;
use pipeline::flow::ChartSource;
use pipeline::geometry::{Rect, Size};
use serde_json::Value;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

const USAGE: i32 = 2;
/// Radiance of a reflectance of 1 in the charts here is this to the value of a picture: any number, the figures are relative.
const GAIN: f64 = 2.5;

/// The film of a chart in its one band.
fn film(chart: &str) -> (Size, Vec<f64>) {
    let chart: Generator = chart.parse().unwrap();
    let (size, margin) = (chart.film_size(), chart.overscan_px() as i64);
    let mut pixels = vec![0f32; size.pixels()];
    chart.read(0, Rect::new(margin, margin, size.height, size.width), &mut pixels).unwrap();
    (size, pixels.iter().map(|v| GAIN * f64::from(*v)).collect())
}

/// Writes a picture of one or three channels as OpenEXR.
fn write(path: &Path, size: Size, channels: &[&[f64]]) {
    let picture = Developed {
        path,
        size,
        channels: channels.len(),
        depth: 16,
        linear: true,
        comment: "",
        rows: 16,
        threads: 2,
    };
    let make = |rows: std::ops::Range<usize>| {
        let pixels = rows.start * size.width..rows.end * size.width;
        Ok(pixels.flat_map(|i| channels.iter().map(move |c| c[i] as f32)).collect())
    };
    write_exr::<ExportError>(&picture, &|_, _| {}, make).unwrap();
}

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Values of the sections of the first camera of the report of `picture`.
    fn measured(&self, picture: &Path, chart: &str, flags: &[&str]) -> Vec<Value> {
        let out = self.at("report");
        let words = ["report", text(picture), "--chart", chart, "--out", text(&out), "--overwrite"];
        lenscube(&[&words[..], flags].concat()).ok();
        let all: Value = serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
        let page = std::fs::read_to_string(out.join("report.html")).unwrap();
        assert!(page.contains("<svg") || chart.starts_with("black-spots"), "a page with plots");
        all["cameras"][0]["sections"].as_array().unwrap().iter().map(|s| s["values"].clone()).collect()
    }
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("a number, not {value}"))
}

#[test]
fn what_cannot_be_measured_is_refused_before_work_and_nothing_is_written() {
    let place = Place::new();
    let exr = place.at("grey.exr");
    write(&exr, Size::new(200, 300), &[&vec![0.5; 60_000]]);
    let out = place.at("out");
    let refused = |flags: &[&str], code: i32, texts: &[&str]| {
        let words = ["report", text(&exr), "--out", text(&out)];
        assert_exit(&lenscube(&[&words[..], flags].concat()), code, texts);
        assert!(!out.exists(), "{flags:?} wrote");
    };
    refused(&["--chart", "cheker"], USAGE, &["checker"]);
    refused(&["--chart", "lamp"], USAGE, &["nothing is measured of a chart `lamp`"]);
    refused(
        &["--chart", "uniform", "--chart", "uniform"],
        USAGE,
        &["--chart: expected one for all pictures"],
    );
    refused(&["--chart", "checker"], USAGE, &["expected a picture in colour, found grey"]);
    refused(&["--chart", "oecf?fiducials=42"], USAGE, &["grey.exr", "mark"]);
    refused(&["--chart", "uniform", "--against", "a.png", "b.png"], USAGE, &["--against: expected as many"]);
    refused(&["--chart", "uniform", "--frame", "2"], USAGE, &["is not a raw"]);
    refused(&["--chart", "iso12233-esfr?grid=3"], 1, &["0 of the 36 edges of the chart could be measured"]);
    refused(&["--chart", "siemens"], 1, &["found none that can be measured"]);
    let none = place.at("none.png");
    let words = ["report", text(&none), "--chart", "uniform", "--out", text(&out)];
    assert_exit(&lenscube(&words), 1, &["none.png", "no such file"]);
    // The picture is not replaced by the report.
    let own = place.at("report.json");
    std::fs::copy(&exr, &own).unwrap();
    let words = ["report", text(&own), "--chart", "uniform", "--out", text(place.0.path()), "--overwrite"];
    assert_exit(&lenscube(&words), USAGE, &["report.json"]);
}
