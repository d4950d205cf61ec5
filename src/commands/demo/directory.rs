//! Record of the files that the demo made in its directory; the demo replaces no others.
//!
//! `.lenscube-demo.json` lists them with their digests when complete (of a film the digest of its job), or `null` from before they
//! are started until they are complete. A file that is not listed, or has another digest, belongs to the user.

use crate::failure::other_job;
use anyhow::{Context, Result};
use formats::durable::{Directory, create_directories, is_temp_name};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

const RECORD: &str = ".lenscube-demo.json";
const SCHEMA: &str = "lenscube/demo/1";
const MAX_RECORD_BYTES: u64 = 1 << 20;

/// Directory of the demo.
pub struct DemoDirectory {
    path: PathBuf,
    files: Map<String, Value>,
}

impl DemoDirectory {
    /// Opens the directory, or creates it.
    ///
    /// # Errors
    /// The directory holds files that the demo did not make (exit code 3), or cannot be read.
    pub fn open(path: &Path) -> Result<Self> {
        create_directories(path, true)?;
        let record = Directory::new(path).read_at_most(RECORD, MAX_RECORD_BYTES)?;
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
                "{} holds files that `lenscube demo` did not make or that were changed since: {}; nothing was replaced, choose another \
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

    /// Creates file `name` by `create`, which takes its path, and records it.
    ///
    /// # Errors
    /// Those of `create`; the record cannot be written.
    pub fn create<T>(&mut self, name: &str, create: impl FnOnce(&Path) -> Result<T>) -> Result<T> {
        self.record(name, Value::Null)?;
        let path = self.path.join(name);
        let created = create(&path)?;
        self.record(name, digest(&path)?.into())?;
        Ok(created)
    }

    fn record(&mut self, name: &str, digest: Value) -> Result<()> {
        self.files.insert(name.into(), digest);
        let record = json!({ "schema": SCHEMA, "files": self.files });
        Ok(Directory::new(&self.path).write(RECORD, &serde_json::to_vec_pretty(&record)?)?)
    }
}

/// Digest of a file or chart, or of the job of a film; none if the path does not exist.
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
    fn directory_with_foreign_or_changed_files_is_rejected() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("demo");
        let mut demo = DemoDirectory::open(&path).unwrap();
        demo.create("a.png", |p| Ok(fs::write(p, "a")?)).unwrap();
        let failed: Result<()> = demo.create("b.png", |p| {
            fs::write(p, "half")?;
            anyhow::bail!("interrupted")
        });
        assert!(failed.is_err());
        // A complete and an incomplete file, both of the demo.
        let mut again = DemoDirectory::open(&path).unwrap();
        again.create("b.png", |p| Ok(fs::write(p, "b")?)).unwrap();
        DemoDirectory::open(&path).unwrap();
        let assert_rejected = |text: &str| {
            let e = DemoDirectory::open(&path).map(|_| ()).unwrap_err();
            assert!(crate::failure::exit_code(&e) == 3 && e.to_string().contains(text), "{e}");
        };
        fs::write(path.join("b.png"), "mine").unwrap();
        assert_rejected("since: b.png;");
        fs::remove_file(path.join("b.png")).unwrap();
        fs::create_dir(path.join("film.zarr")).unwrap();
        assert_rejected("since: film.zarr;");
        fs::remove_dir(path.join("film.zarr")).unwrap();
        DemoDirectory::open(&path).unwrap();
        fs::remove_file(path.join(RECORD)).unwrap();
        assert_rejected("since: a.png;");
    }
}
