//! Where a new pack's bytes go: a directory or a .zip under a temporary name, renamed when whole.
//!
//! What stops half-way leaves at most a temporary name ([`crate::durable::temp_name`]), swept by the next pack that is written beside it,
//! never something that looks finished. Files, directory entries and the rename are synced, so this also holds after a power
//! cut.

use super::error::LensPackError;
use crate::durable::{is_url, parent_of, publish, sweep_entries, temp_name};
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

/// A pack in the making; removes what it wrote unless finished.
pub(super) struct Sink {
    pub(super) path: PathBuf,
    part: PathBuf,
    zip: Option<ZipWriter<BufWriter<File>>>,
}

impl Sink {
    /// Starts a .zip if `path` ends in `.zip`, else a directory.
    pub(super) fn create(path: &Path) -> Result<Self, LensPackError> {
        if is_url(path) {
            let source = io::Error::other("packs are written to files; write it here and copy it there");
            return Err(LensPackError::Io { path: path.into(), action: "create the lens pack", source });
        }
        if path.symlink_metadata().is_ok() {
            return Err(LensPackError::Exists { path: path.into() });
        }
        let io = |source| LensPackError::Io { path: path.into(), action: "create the lens pack", source };
        path.file_name().ok_or_else(|| io(io::Error::other("it has no file name")))?;
        sweep_entries(parent_of(path)).map_err(|e| io(e.into()))?;
        let part = path.with_file_name(temp_name());
        let zip = if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("zip")) {
            Some(ZipWriter::new(BufWriter::new(File::create_new(&part).map_err(io)?)))
        } else {
            fs::create_dir(&part).map_err(io)?;
            None
        };
        Ok(Self { path: path.into(), part, zip })
    }

    /// Writes one key's value.
    pub(super) fn put(&mut self, key: &str, bytes: &[u8]) -> Result<(), LensPackError> {
        let done = match &mut self.zip {
            Some(zip) => {
                let options = SimpleFileOptions::default()
                    .compression_method(CompressionMethod::Stored)
                    .last_modified_time(zip::DateTime::default())
                    .unix_permissions(0o644);
                zip.start_file(key, options).map_err(io::Error::other).and_then(|()| zip.write_all(bytes))
            }
            None => write_synced(&self.part.join(key), bytes),
        };
        done.map_err(|e| self.io("write", e))
    }

    /// Makes the pack appear, whole.
    pub(super) fn finish(mut self) -> Result<(), LensPackError> {
        self.seal().map_err(|e| self.io("finish", e))?;
        // Never over a file that another process has put there meanwhile.
        match publish(&self.part, &self.path, true) {
            Ok(true) => Ok(()),
            Ok(false) => Err(LensPackError::Exists { path: self.path.clone() }),
            Err(e) => Err(self.io("rename the finished", e.into())),
        }
    }

    fn seal(&mut self) -> io::Result<()> {
        match self.zip.take() {
            Some(zip) => {
                let file = zip.finish().map_err(io::Error::other)?;
                file.into_inner().map_err(|e| e.into_error())?.sync_all()
            }
            None => sync_directories(&self.part),
        }
    }

    fn io(&self, verb: &'static str, source: io::Error) -> LensPackError {
        LensPackError::Io { path: self.path.clone(), action: verb, source }
    }
}

impl Drop for Sink {
    fn drop(&mut self) {
        // After `finish` nothing has this name any more.
        let _ = if self.part.is_dir() { fs::remove_dir_all(&self.part) } else { fs::remove_file(&self.part) };
    }
}

fn write_synced(path: &Path, bytes: &[u8]) -> io::Result<()> {
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent)?;
    }
    let mut file = File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

fn sync_directories(root: &Path) -> io::Result<()> {
    for entry in fs::read_dir(root)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            sync_directories(&entry.path())?;
        }
    }
    sync_directory(root)
}

/// Makes new names in a directory last; other systems than Unix do not open directories.
fn sync_directory(path: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(path)?.sync_all() } else { Ok(()) }
}
