//! `lenscube restore`.

mod films;
mod raws;
mod refusals;

use crate::common::{CommandResult, Noise, assert_error_line, lenscube, pairs, pixels, run, shards, text};
use formats::film::FilmStore;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// A pack of PSFs at 450, 500, 550 … 650 nm.
const LENS: &str = "double-gauss-28-npz";
/// RMS noise of films, whose white is 0.0038.
const NOISE: f32 = 1e-5;

/// A folder with a chart, its film away from the axis, and that film with noise; flags of such films.
struct Folder(tempfile::TempDir, Vec<String>);

impl Folder {
    fn new(size: usize) -> Self {
        Self::of("composite", size)
    }

    fn of(kind: &str, size: usize) -> Self {
        let size = size.to_string();
        let center = |axis: f64| ((size.parse::<f64>().unwrap() - 1.0) / 2.0 - axis) * 2e-3;
        let center = format!("--center={:.4},{:.4}", center(1500.0), center(1000.0));
        let flags = vec!["--axis=1500,1000".into(), center, format!("--film-size={size}")];
        let folder = Self(tempfile::tempdir().unwrap(), flags);
        let chart = folder.at("chart.zarr");
        lenscube(&[
            "chart",
            kind,
            text(&chart),
            "--size",
            &size,
            "--overscan",
            "0",
            "--wavelengths",
            "550",
            "--pitch-um",
            "2",
        ])
        .ok();
        folder.run("chart.zarr", "clean.zarr");
        add_noise(&folder.at("clean.zarr"), &folder.at("film.zarr"), 11);
        folder
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// The film of a chart 2.8 mm left of the axis and 1.8 mm above it, where PSFs are not round; chart pixels are those of the film's grid.
    fn run(&self, chart: &str, film: &str) {
        let flags: Vec<&str> = self.1.iter().map(String::as_str).collect();
        run(text(&self.at(chart)), &self.at(film), LENS, &flags).ok();
    }

    fn restore(&self, film: &str, out: &str, flags: &[&str]) -> CommandResult {
        lenscube(&[&["restore", text(&self.at(film)), text(&self.at(out))], flags].concat())
    }
}

/// Copies a film, with noise on its pixels.
fn add_noise(from: &Path, to: &Path, seed: u64) {
    let clean = FilmStore::open(from, false).unwrap();
    let (_, mut bands) = pixels(from, "film");
    let mut noise = Noise(seed);
    for value in bands.iter_mut().flatten() {
        let sum: f32 = (0..12).map(|_| noise.next()).sum();
        *value += NOISE * (sum - 6.0);
    }
    let noisy = FilmStore::create(to, clean.spec().clone(), clean.provenance().clone(), false).unwrap();
    for (output, band, shard) in clean.all_shards() {
        let encoded = noisy.encode_shard(output, band, shard, &bands[band]).unwrap();
        noisy.commit(&encoded).unwrap();
    }
}

/// A raw of the film of `chart` by a sensor with pixels of 2 um.
fn expose(film: &Path, raw: &Path, sensor: &str, flags: &[&str]) {
    let words = ["sensor", text(film), text(raw), "--sensor", sensor, "--set", "pixel.pitch_um=2"];
    lenscube(&[&words[..], flags].concat()).ok();
}

fn report(result: &CommandResult) -> Value {
    serde_json::from_str(&result.stdout).unwrap()
}
