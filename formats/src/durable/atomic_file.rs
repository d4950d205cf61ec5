//! A file written under a temporary name in its directory, flushed, then renamed: absent, old or complete, never in between.

use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

#[cfg(target_os = "linux")]
use rustix::fs::{Mode, OFlags};

use super::error::DurableError;
use super::fault;
use super::file_system::{link_target, parent_of};
use super::file_writer::FileWriter;
use super::rename::{flush_directory, rename};
use super::step::FileStep;
use super::sweep::sweep_entries;
use super::temp::temp_name;
use super::url::is_url;

/// Bytes that are read again at a time.
const READ_BYTES: usize = 1 << 20;

/// A file that is being written. Dropped before [`AtomicFile::finish`], it is removed.
#[derive(Debug)]
pub struct AtomicFile {
    file: File,
    pub(super) temp: PathBuf,
    /// Final path.
    pub(super) path: PathBuf,
}

impl AtomicFile {
    /// Begins the file `path`; an existing file there remains until [`AtomicFile::finish`]. A symbolic link is kept and its target
    /// replaced. Temporary files of ended processes in the directory are removed.
    pub fn create(path: &Path) -> Result<Self, DurableError> {
        if is_url(path) {
            let problem = "expected a local file".into();
            return Err(DurableError::Address { path: path.into(), problem });
        }
        let path = &link_target(path);
        let parent = parent_of(path);
        let create = || {
            path.file_name().ok_or(ErrorKind::InvalidFilename)?;
            if path.symlink_metadata().is_ok_and(|m| m.is_dir()) {
                return Err(ErrorKind::IsADirectory.into());
            }
            let temp = parent.join(temp_name());
            let file = File::options().read(true).write(true).create_new(true).open(&temp)?;
            Ok((file, temp))
        };
        let (file, temp) = create().map_err(|e| DurableError::io("create", path, 0, e))?;
        let created = Self { file, temp, path: path.into() };
        sweep_entries(parent)?;
        Ok(created)
    }

    /// Begins a file with contents `text`.
    pub fn with_text(path: &Path, text: &str) -> Result<Self, DurableError> {
        let created = Self::create(path)?;
        let written = created.writer().write_all(text.as_bytes());
        written.map_err(|e| DurableError::io("write", path, text.len() as u64, e))?;
        Ok(created)
    }

    /// The open file, empty at first.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// A writer into the file, from where the last one ended.
    pub fn writer(&self) -> FileWriter<'_> {
        FileWriter::new(&self.file)
    }

    /// Whether the bytes of the file, read again, have the digest `expected`.
    ///
    /// # Errors
    /// [`DurableError`]: it cannot be read.
    pub(crate) fn reads_as(&self, expected: blake3::Hash) -> Result<bool, DurableError> {
        let hash = |mut file: &File| {
            let (mut digest, mut buffer) = (blake3::Hasher::new(), vec![0; READ_BYTES]);
            file.seek(SeekFrom::Start(0))?;
            loop {
                match file.read(&mut buffer)? {
                    0 => return Ok(digest.finalize()),
                    n => digest.update(&buffer[..n]),
                };
            }
        };
        let read = hash(&self.file).map_err(|e| DurableError::io("read", &self.path, 0, e))?;
        Ok(read == expected)
    }

    /// Flushes the file to the disk and renames it to its final path.
    ///
    /// # Errors
    /// [`DurableError`]; an existing file at the path is unchanged then.
    pub fn finish(self) -> Result<(), DurableError> {
        self.flush()?;
        rename(&self.temp, &self.path, &self.path)?;
        flush_directory(parent_of(&self.path))
    }

    pub(super) fn flush(&self) -> Result<(), DurableError> {
        fault::inject(FileStep::Sync)
            .and_then(|()| self.file.sync_all())
            .map_err(|e| DurableError::io("flush", &self.path, 0, e))
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        // Not found after a rename; otherwise an earlier error is the one to report.
        let _ = std::fs::remove_file(&self.temp);
    }
}

/// An unnamed file in `directory` (O_TMPFILE), open for reading and writing; it exists until it is closed, however the process ends.
/// Temporary files of ended processes in the directory are removed.
pub fn unnamed_temp_file(directory: &Path) -> Result<File, DurableError> {
    sweep_entries(directory)?;
    let failed = |e| DurableError::io("create a temporary file in", directory, 0, e);
    #[cfg(target_os = "linux")]
    {
        let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
        if let Ok(file) = rustix::fs::open(directory, flags, Mode::RUSR | Mode::WUSR) {
            return Ok(file.into());
        }
    }
    // A file system without O_TMPFILE: a process killed between the two calls leaves an empty file, swept later.
    let temp = directory.join(temp_name());
    let file = File::options().read(true).write(true).create_new(true).open(&temp).map_err(failed)?;
    std::fs::remove_file(&temp).map_err(failed)?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_is_unchanged_until_finished() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.bin");
        std::fs::write(&path, b"before").unwrap();
        let unfinished = AtomicFile::create(&path).unwrap();
        unfinished.file().write_all(b"half").unwrap();
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 2);
        drop(unfinished);
        assert_eq!(std::fs::read(&path).unwrap(), b"before");
        let file = AtomicFile::create(&path).unwrap();
        file.file().write_all(b"after").unwrap();
        file.finish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"after");
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 1);
        let error = AtomicFile::create(Path::new("/nowhere/at/all.bin")).unwrap_err().to_string();
        assert!(error.contains("/nowhere/at/all.bin"), "{error}");
    }

    #[test]
    fn unnamed_temp_file_has_no_directory_entry() {
        let directory = tempfile::tempdir().unwrap();
        let file = unnamed_temp_file(directory.path()).unwrap();
        (&file).write_all(b"bands").unwrap();
        assert_eq!(file.metadata().unwrap().len(), 5);
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0);
    }
}
