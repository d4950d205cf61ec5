//! Invalid input: one error line, the documented exit code, and no film that looks complete.

mod charts;
mod flags;
mod inputs_kept;
mod lens_packs;
mod outputs;

use crate::common::{
    CommandResult, Picture, assert_error_line, assert_exit, delta, files, identity_band, lens, lenscube,
    pixels, run, scattered, shards, text, write_pack,
};
use formats::chart::{ChartOptions, ChartStore};
use formats::lens::{LensPackError, PackAttributes};
use pipeline::geometry::Size;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const FAILED: i32 = 1;
const USAGE: i32 = 2;
const OTHER_JOB: i32 = 3;

/// Chart of three bands of 90 x 100 px and a lens pack that covers it, for tests that damage one of them.
struct SmallJob {
    dir: tempfile::TempDir,
    chart: PathBuf,
    pack: PathBuf,
    film: PathBuf,
}

impl SmallJob {
    fn new() -> Self {
        Self::with(Picture::noise(5, Size::new(90, 100), 3))
    }

    fn with(picture: Picture) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        let job = Self { chart: at("chart.zarr"), pack: at("pack.lens.zarr"), film: at("film.zarr"), dir };
        picture.write(&job.chart);
        let lens = lens([450.0, 500.0, 550.0].map(|nm| identity_band(nm, 0.2, 5)).into());
        let stacks = lens.bands.iter().zip(1..).map(|(b, seed)| scattered(seed, b)).collect();
        write_pack(&job.pack, &lens, stacks);
        job
    }

    fn run(&self, flags: &[&str]) -> CommandResult {
        run(text(&self.chart), &self.film, text(&self.pack), flags)
    }

    /// Asserts that the run fails before a film exists and leaves the directory unchanged.
    fn assert_rejected(&self, flags: &[&str], code: i32, words: &[&str]) {
        let before = files(self.dir.path());
        assert_error_line(&self.run(flags), code, words);
        assert!(files(self.dir.path()) == before, "{flags:?} changed the directory");
    }

    /// Asserts that the run fails during the computation and leaves an incomplete film without temporary files.
    fn assert_fails(&self, flags: &[&str], words: &[&str]) {
        assert_error_line(&self.run(flags), FAILED, words);
        let store = ChartStore::open(text(&self.film), ChartOptions::default()).unwrap();
        let mut out = vec![0.0; store.size().pixels()];
        let missing = (0..store.bands()).any(|b| store.read_rect(b, store.size().rect(), &mut out).is_err());
        assert!(missing, "the film is complete after a failed run");
        let stray = files(&self.film).into_keys().find(|p| text(p).contains("tmp"));
        assert_eq!(stray, None, "leftover temporary file");
    }
}

fn edit(path: &Path, change: impl FnOnce(&mut Value)) {
    let mut json: Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
    change(&mut json);
    fs::write(path, json.to_string()).unwrap();
}

fn flip_bit(path: &Path) {
    let mut bytes = fs::read(path).unwrap();
    let middle = bytes.len() / 3;
    bytes[middle] ^= 0x40;
    fs::write(path, bytes).unwrap();
}
