//! Films, raws and pictures of the tests of `lenscube sensor` and what follows it.

use super::{CommandResult, Noise, lenscube, text};
use formats::chart::{ChartOptions, ChartStore};
use formats::film::{FilmSpec, FilmStore};
use pipeline::geometry::{Rect, Size};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Units of a film that a sensor takes as they are.
pub const IRRADIANCE: &str = "W m-2 nm-1";
/// A built-in lens.
pub const LENS: &str = "double-gauss-28-npz";

/// A directory of its own.
pub struct Place(tempfile::TempDir);

impl Place {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// A film of pixels `value(band, row, column)`.
    pub fn film(
        &self,
        size: Size,
        nm: &[f64],
        units: &str,
        value: impl FnMut(usize, usize, usize) -> f32,
    ) -> PathBuf {
        let path = self.at("film.zarr");
        write_film(&path, size, nm, (2.0, units), value);
        path
    }

    /// A film of pixels `value(band, row, column)` in three bands, W m⁻² nm⁻¹.
    pub fn film_named(
        &self,
        name: &str,
        size: Size,
        value: impl FnMut(usize, usize, usize) -> f32,
    ) -> PathBuf {
        let path = self.at(name);
        write_film(&path, size, &[450.0, 550.0, 650.0], (2.0, IRRADIANCE), value);
        path
    }

    /// A film of noise in three bands, W m⁻² nm⁻¹.
    pub fn noise(&self, size: Size) -> PathBuf {
        let mut noise = Noise(5);
        self.film(size, &[450.0, 550.0, 650.0], IRRADIANCE, |_, _, _| 1e-3 * noise.next())
    }

    /// The film of a chart, with relative illumination alone.
    pub fn run(&self, chart: &str) -> PathBuf {
        let film = self.at("film.zarr");
        super::run(&format!("gen:{chart}"), &film, LENS, &["--stages", "ri"]).ok();
        film
    }

    /// A raw of a film.
    pub fn raw(&self, name: &str, film: &Path, flags: &[&str]) -> PathBuf {
        let raw = self.at(name);
        sensor(film, &raw, flags).ok();
        raw
    }
}

/// Writes a film of pixels `value(band, row, column)`.
pub fn write_film(
    path: &Path,
    size: Size,
    nm: &[f64],
    (pitch_um, units): (f64, &str),
    mut value: impl FnMut(usize, usize, usize) -> f32,
) {
    let spec = FilmSpec {
        units: units.into(),
        shard: 512,
        chunk: 64,
        ..FilmSpec::full_film(size, nm.to_vec(), pitch_um)
    };
    let Value::Object(provenance) = json!({"job_digest": "a", "layout_digest": "b", "engine": "portable"})
    else {
        unreachable!()
    };
    let film = FilmStore::create(path, spec, provenance, false).unwrap();
    let all: Vec<Vec<f32>> = (0..nm.len())
        .map(|b| (0..size.pixels()).map(|k| value(b, k / size.width, k % size.width)).collect())
        .collect();
    for (output, band, shard) in film.all_shards().collect::<Vec<_>>() {
        let rect = film.shard_rect(output, shard);
        let rows = rect.y as usize..rect.bottom() as usize;
        let pixels: Vec<f32> =
            rows.flat_map(|y| all[band][y * size.width + rect.x as usize..][..rect.width].to_vec()).collect();
        film.commit(&film.encode_shard(output, band, shard, &pixels).unwrap()).unwrap();
    }
}

/// `lenscube sensor FILM RAW`.
pub fn sensor_command(film: &Path, raw: &Path, flags: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(["sensor", text(film), text(raw), "--no-fsync"]).args(flags);
    command
}

pub fn sensor(film: &Path, raw: &Path, flags: &[&str]) -> CommandResult {
    CommandResult::new(&sensor_command(film, raw, flags).output().unwrap())
}

pub fn develop(raw: &Path, out: &Path, flags: &[&str]) -> CommandResult {
    lenscube(&[&["develop", text(raw), text(out)], flags].concat())
}

/// Frame `frame` of array `array`.
pub fn frame(raw: &Path, array: &str, frame: usize) -> (Size, Vec<u16>) {
    let array_metadata = std::fs::read(raw.join(array).join("zarr.json")).unwrap();
    let metadata: Value = serde_json::from_slice(&array_metadata).unwrap();
    let frames = metadata["shape"][0].as_u64().unwrap();
    let options = ChartOptions {
        wavelengths_nm: Some((1..=frames).map(|f| f as f64).collect()),
        ..ChartOptions::default()
    };
    let store = ChartStore::open_at(raw, array, options).unwrap();
    let size = store.size();
    let mut pixels = vec![0.0; size.pixels()];
    store.read_rect(frame, size.rect(), &mut pixels).unwrap();
    (size, pixels.iter().map(|v| *v as u16).collect())
}

/// Attributes of a film or raw.
pub fn attributes(store: &Path) -> Map<String, Value> {
    let group: Value = serde_json::from_slice(&std::fs::read(store.join("zarr.json")).unwrap()).unwrap();
    group["attributes"].as_object().unwrap().clone()
}

/// The pixels of a window.
pub fn window(size: Size, pixels: &[u16], w: Rect) -> Vec<u16> {
    (w.y as usize..w.bottom() as usize)
        .flat_map(|y| pixels[y * size.width + w.x as usize..][..w.width].to_vec())
        .collect()
}
