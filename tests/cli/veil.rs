//! Scatter and veiling glare: closed forms on films of the program, the same bytes however a film is made, the stored layer, and errors.

mod cache;
mod closed_forms;
mod figures;
mod jobs;
mod layer;

use crate::common::test_job::TestJob;
use crate::common::{
    CommandResult, Picture, assert_error_line, assert_exit, files, identity_band, lens, lenscube, pixels,
    run, scattered, text, write_pack,
};
use pipeline::geometry::Size;
use std::fs;
use std::path::{Path, PathBuf};

const VEIL: [&str; 4] = ["--veiling-glare", "2%", "--scatter", "3%,r0=5,slope=2.2"];
const KILLED: i32 = -1;

/// A chart of `size` with the value f(row, column) in one band, and a lens without aberrations.
struct Scene {
    dir: tempfile::TempDir,
    chart: PathBuf,
    pack: PathBuf,
}

impl Scene {
    fn new(size: Size, f: impl Fn(usize, usize) -> f32) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let (chart, pack) = (dir.path().join("chart.zarr"), dir.path().join("pack.lens.zip"));
        let values = (0..size.pixels()).map(|i| f(i / size.width, i % size.width)).collect();
        Picture { size, bands: vec![values] }.write(&chart);
        let lens = lens(vec![identity_band(450.0, 1.0, 5)]);
        let stacks = lens.bands.iter().map(|band| scattered(1, band)).collect();
        write_pack(&pack, &lens, stacks);
        Self { dir, chart, pack }
    }

    /// The pixels of the film with `flags`.
    fn film(&self, name: &str, flags: &[&str]) -> Vec<f32> {
        let film = self.dir.path().join(name);
        run(text(&self.chart), &film, text(&self.pack), &[&["--outside", "clamp"], flags].concat()).ok();
        pixels(&film, "film").1.remove(0)
    }
}
