//! Which files of the demo's directory the demo made: all that it may replace.
//!
//! `.lenscube-demo.json` names them, each with the digest that it had when it was whole (of a film the digest of its job), or `null`
//! from before it is begun until then. Anything else in the directory, and what has another digest by now, is somebody's own.

use crate::failure::other_job;
use anyhow::{Context, Result};
use formats::durable::{Directory, create_directories, is_temp_name};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

const RECORD: &str = ".lenscube-demo.json";
const SCHEMA: &str = "lenscube/demo/1";
const LARGEST: u64 = 1 << 20;

/// The demo's directory.
pub struct DemoDirectory {
    path: PathBuf,
    files: Map<String, Value>,
}

impl DemoDirectory {
    /// Opens the directory, or creates it.
    ///
    /// # Errors
    /// It holds what the demo did not make (exit code 3); the disk.
    pub fn open(path: &Path) -> Result<Self> {
        create_directories(path, true)?;
        let record = Directory::new(path).read_at_most(RECORD, LARGEST)?;
        let record: Option<Value> = record.and_then(|bytes| serde_json::from_slice(&bytes).ok());
        let files = record.filter(|r| r["schema"] == SCHEMA).and_then(|r| r["files"].as_object().cloned());
        let opened = Self { path: path.into(), files: files.unwrap_or_default() };
        let mut foreign = Vec::new();
        for entry in std::fs::read_dir(path).with_context(|| format!("listing {}", path.display()))? {
            let name = entry?.file_name().to_string_lossy().into_owned();
            if name != RECORD && !is_temp_name(&name) && !opened.is_own(&name)? {
                foreign.push(name);
            }
        }
        foreign.sort();
        match foreign.is_empty() {
            true => Ok(opened),
            false => Err(other_job(format!(
                "{} holds what `lenscube demo` did not make, or what was changed since: {}; nothing was changed, choose another \
                 directory with --dir",
                path.display(),
                foreign.join(", ")
            ))),
        }
    }

    fn is_own(&self, name: &str) -> Result<bool> {
        Ok(match self.files.get(name) {
            None => false,
            Some(Value::Null) => true,
            Some(known) => Some(known) == digest(&self.path.join(name))?.map(Value::from).as_ref(),
        })
    }

    /// Makes `name` by `make`, which gets its path, and keeps a record of it.
    ///
    /// # Errors
    /// What `make` brings; the disk.
    pub fn make<T>(&mut self, name: &str, make: impl FnOnce(&Path) -> Result<T>) -> Result<T> {
        self.record(name, Value::Null)?;
        let path = self.path.join(name);
        let made = make(&path)?;
        self.record(name, digest(&path)?.into())?;
        Ok(made)
    }

    fn record(&mut self, name: &str, digest: Value) -> Result<()> {
        self.files.insert(name.into(), digest);
        let record = json!({ "schema": SCHEMA, "files": self.files });
        Ok(Directory::new(&self.path).write(RECORD, &serde_json::to_vec_pretty(&record)?)?)
    }
}

/// What a file, a chart or a film is; `None` if there is nothing.
fn digest(path: &Path) -> Result<Option<String>> {
    let file = if path.is_dir() { path.join("zarr.json") } else { path.to_path_buf() };
    let bytes = match std::fs::read(&file) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        other => other.with_context(|| format!("reading {}", file.display()))?,
    };
    let group: Value = serde_json::from_slice(&bytes).unwrap_or_default();
    let job = &group["attributes"]["provenance"]["job_digest"];
    Ok(Some(job.as_str().map_or_else(|| blake3::hash(&bytes).to_hex().to_string(), str::to_owned)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn only_what_the_demo_made_and_nobody_changed_is_its_own() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("demo");
        let mut demo = DemoDirectory::open(&path).unwrap();
        demo.make("a.png", |p| Ok(fs::write(p, "a")?)).unwrap();
        let failed: Result<()> = demo.make("b.png", |p| {
            fs::write(p, "half")?;
            anyhow::bail!("interrupted")
        });
        assert!(failed.is_err());
        // Made, and begun: both are the demo's.
        let mut again = DemoDirectory::open(&path).unwrap();
        again.make("b.png", |p| Ok(fs::write(p, "b")?)).unwrap();
        DemoDirectory::open(&path).unwrap();
        let refused = |word: &str| {
            let e = DemoDirectory::open(&path).map(|_| ()).unwrap_err();
            assert!(crate::failure::exit_code(&e) == 3 && e.to_string().contains(word), "{e}");
        };
        fs::write(path.join("b.png"), "mine").unwrap();
        refused("since: b.png;");
        fs::remove_file(path.join("b.png")).unwrap();
        fs::create_dir(path.join("film.zarr")).unwrap();
        refused("since: film.zarr;");
        fs::remove_dir(path.join("film.zarr")).unwrap();
        DemoDirectory::open(&path).unwrap();
        fs::remove_file(path.join(RECORD)).unwrap();
        refused("since: a.png;");
    }
}
