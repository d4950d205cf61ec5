//! Zarr charts: fixtures by zarr-python (`tests/data/make_charts.py`), charts of [`write_chart`], and invalid stores.

mod broken;
mod speed;
mod stores;
mod values;
mod written;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicU64;

use super::*;
use pipeline::geometry::{Rect, Size};

/// A fixture made by zarr-python.
fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/charts").join(name)
}

/// Value of every fixture.
fn sample(band: usize, y: usize, x: usize) -> f32 {
    ((31 * band + 7 * y + 3 * x) % 251) as f32
}

fn open(path: &Path) -> ChartStore {
    ChartStore::open(path.to_str().unwrap(), ChartOptions::default()).unwrap()
}

fn open_error(path: &Path) -> ChartError {
    ChartStore::open(path.to_str().unwrap(), ChartOptions::default()).unwrap_err()
}

fn all(chart: &ChartStore, band: usize) -> Result<Vec<f32>, ChartError> {
    let mut out = vec![0.0; chart.size().pixels()];
    chart.read_rect(band, chart.size().rect(), &mut out).map(|()| out)
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for e in std::fs::read_dir(from).unwrap() {
        let e = e.unwrap();
        let to = to.join(e.file_name());
        if e.path().is_dir() { copy(&e.path(), &to) } else { std::fs::copy(e.path(), to).map(drop).unwrap() }
    }
}

/// A copy of a fixture, to be modified.
fn copied(name: &str) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    copy(&fixture(name), &path);
    (dir, path)
}
