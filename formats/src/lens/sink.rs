//! Output of a new pack: a directory or a .zip under a temporary name, renamed when complete.
//!
//! An interrupted write leaves at most a temporary file or directory ([`crate::durable::temp_name`]), swept when the next pack is written
//! in the same directory, never an incomplete pack under its final name. Files, directory entries and the rename are flushed, so this
//! also holds after a power failure.

use super::error::LensPackError;
use crate::durable::{is_url, parent_of, publish, sweep_entries, temp_name};
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

/// An incomplete pack, removed when dropped before [`Sink::finish`].
pub(super) struct Sink {
    pub(super) path: PathBuf,
    temp: PathBuf,
    zip: Option<ZipWriter<BufWriter<File>>>,
}

impl Sink {
    /// Begins a .zip if `path` ends in `.zip`, else a directory.
    pub(super) fn create(path: &Path) -> Result<Self, LensPackError> {
        if is_url(path) {
            let source =
                io::Error::other("a lens pack cannot be written to a URL; write a file and copy it there");
            return Err(LensPackError::Io { path: path.into(), action: "create the lens pack", source });
        }
        if path.symlink_metadata().is_ok() {
            return Err(LensPackError::Exists { path: path.into() });
        }
        let io = |source| LensPackError::Io { path: path.into(), action: "create the lens pack", source };
        path.file_name().ok_or_else(|| io(io::Error::other("it has no file name")))?;
        sweep_entries(parent_of(path)).map_err(|e| io(e.into()))?;
        let temp = path.with_file_name(temp_name());
        let zip = if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("zip")) {
            Some(ZipWriter::new(BufWriter::new(File::create_new(&temp).map_err(io)?)))
        } else {
            fs::create_dir(&temp).map_err(io)?;
            None
        };
        Ok(Self { path: path.into(), temp, zip })
    }

    /// Writes the value of one key.
    pub(super) fn write(&mut self, key: &str, bytes: &[u8]) -> Result<(), LensPackError> {
        let written = match &mut self.zip {
            Some(zip) => {
                let options = SimpleFileOptions::default()
                    .compression_method(CompressionMethod::Stored)
                    .last_modified_time(zip::DateTime::default())
                    .unix_permissions(0o644);
                zip.start_file(key, options).map_err(io::Error::other).and_then(|()| zip.write_all(bytes))
            }
            None => write_synced(&self.temp.join(key), bytes),
        };
        written.map_err(|e| {
            // Dropped, it would try to finish the archive, and print that it cannot.
            std::mem::forget(self.zip.take());
            self.io("write", e)
        })
    }

    /// Flushes the pack and renames it to its final name.
    pub(super) fn finish(mut self) -> Result<(), LensPackError> {
        self.flush().map_err(|e| self.io("finish", e))?;
        // Does not replace a file that another process has created meanwhile.
        match publish(&self.temp, &self.path, true) {
            Ok(true) => Ok(()),
            Ok(false) => Err(LensPackError::Exists { path: self.path.clone() }),
            Err(e) => Err(self.io("rename the finished", e.into())),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self.zip.take() {
            Some(zip) => {
                let file = zip.finish().map_err(io::Error::other)?;
                file.into_inner().map_err(|e| e.into_error())?.sync_all()
            }
            None => sync_directories(&self.temp),
        }
    }

    fn io(&self, action: &'static str, source: io::Error) -> LensPackError {
        LensPackError::Io { path: self.path.clone(), action, source }
    }
}

impl Drop for Sink {
    fn drop(&mut self) {
        // Not found after `finish`.
        let _ = if self.temp.is_dir() { fs::remove_dir_all(&self.temp) } else { fs::remove_file(&self.temp) };
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

/// Flushes a directory's entries; only Unix can open directories.
fn sync_directory(path: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(path)?.sync_all() } else { Ok(()) }
}
