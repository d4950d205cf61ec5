//! Runs whose lens is a design: cache of traced bands, scale, changes during the run.

mod cache;
mod changes;
mod films;
mod flags;

use super::*;

/// Design file, chart and caches of traced bands.
pub(super) struct DesignJob {
    dir: tempfile::TempDir,
    design: PathBuf,
}

impl DesignJob {
    pub(super) fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let design = dir.path().join("my.zmx");
        fs::write(&design, DESIGN).unwrap();
        Picture::noise(3, Size::new(48, 40), 2).write(&dir.path().join("chart"));
        Self { dir, design }
    }

    pub(super) fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Runs with a film half a millimetre wide, so that few PSFs are traced.
    pub(super) fn run(&self, cache: &str, film: &str, flags: &[&str]) -> CommandResult {
        let (chart, film) = (self.at("chart"), self.at(film));
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["run", text(&chart), text(&film), "--no-fsync"]);
        if !flags.contains(&"--lens") {
            command.args(["--lens", text(&self.design)]);
        }
        if !flags.contains(&"--threads") {
            command.args(["--threads", "2"]);
        }
        if !flags.contains(&"--film-pitch-um") {
            command.args(["--film-pitch-um", "10"]);
        }
        command.args(flags);
        CommandResult::new(&command.env("XDG_CACHE_HOME", self.at(cache)).output().unwrap())
    }

    fn entries(&self, cache: &str) -> Vec<PathBuf> {
        let dir = self.at(cache).join("lenscube/lenses");
        let mut entries: Vec<_> = fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()).collect();
        entries.sort();
        entries
    }
}

/// Attributes of a film.
pub(super) fn attributes(film: &Path) -> Value {
    let text = fs::read_to_string(film.join("zarr.json")).unwrap();
    serde_json::from_str::<Value>(&text).unwrap()["attributes"].clone()
}
