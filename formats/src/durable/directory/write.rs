//! Writes, renames and removals of the files of a [`Directory`].

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::super::direct;
use super::super::error::{DurableError, is_not_found};
use super::super::step::FileStep;
use super::super::temp::temp_name;
use super::super::{fault, file_system, handle};
use super::Directory;

impl Directory {
    /// Writes `bytes` under `key`, replacing an existing file.
    ///
    /// # Errors
    /// [`DurableError`]; the file is then unchanged, and the temporary file removed.
    pub fn write(&self, key: &str, bytes: &[u8]) -> Result<(), DurableError> {
        let path = self.path(key)?;
        let (file, temp) = self.write_beside(&path, bytes, self.fsync)?;
        let size = bytes.len() as u64;
        self.sync_file(&file, &temp, size)
            .and_then(|()| self.rename_file(&temp, &path, size))
            .inspect_err(|_| self.remove_temp(&temp))?;
        self.sync_directory(path.parent().unwrap_or(&self.root))
    }

    /// Writes `bytes` under a temporary name in the directory of `path`, which is created if it is missing; with `flush_directories`
    /// each new directory is flushed in its parent. The file and its temporary path.
    ///
    /// # Errors
    /// [`DurableError`]; the temporary file is removed then.
    pub(super) fn write_beside(
        &self,
        path: &Path,
        bytes: &[u8],
        flush_directories: bool,
    ) -> Result<(File, PathBuf), DurableError> {
        let directory = path.parent().unwrap_or(&self.root);
        self.create_directories(directory, flush_directories)?;
        let temp = directory.join(temp_name());
        let file = self.write_temp(&temp, bytes).inspect_err(|_| self.remove_temp(&temp))?;
        Ok((file, temp))
    }

    fn create_directories(&self, path: &Path, fsync: bool) -> Result<(), DurableError> {
        let (base, relative) = match &self.handle {
            Some(_) => self.resolve(path),
            None => return file_system::create_directories(path, fsync),
        };
        handle::create_directories(base, &relative, fsync)
            .map_err(|e| DurableError::io("create directory", path, 0, e))
    }

    fn write_temp(&self, temp: &Path, bytes: &[u8]) -> Result<File, DurableError> {
        let size = bytes.len() as u64;
        let (base, relative) = self.resolve(temp);
        let mut file = self.step(FileStep::Create, temp, |_| handle::create_new(base, &relative), size)?;
        let mut write = |part: &[u8]| match self.fsync {
            true => direct::write_all(&mut file, part),
            false => file.write_all(part),
        };
        self.step(FileStep::Write, temp, |_| fault::write(bytes, &mut write), size)?;
        let found = self.step(FileStep::Write, temp, |_| file.metadata(), size)?.len();
        if found != size {
            return Err(DurableError::Length { path: temp.into(), expected: size, found });
        }
        Ok(file)
    }

    /// Flushes the file `temp` of `size` bytes, if writes are flushed.
    pub(super) fn sync_file(&self, file: &File, temp: &Path, size: u64) -> Result<(), DurableError> {
        match self.fsync {
            true => self.step(FileStep::Sync, temp, |_| file.sync_all(), size),
            false => Ok(()),
        }
    }

    /// Renames `temp`, of `size` bytes, to `path`.
    pub(super) fn rename_file(&self, temp: &Path, path: &Path, size: u64) -> Result<(), DurableError> {
        let (base, from) = self.resolve(temp);
        self.step(FileStep::Rename, path, |p| handle::rename(base, &from, &self.resolve(p).1), size)
    }

    /// Removes a temporary file after an error, which is the one to report; a file that remains is swept later.
    pub(super) fn remove_temp(&self, temp: &Path) {
        let (base, relative) = self.resolve(temp);
        let _ = handle::remove_file(base, &relative);
    }

    /// Flushes the entries of `directory`, if writes are flushed.
    pub(super) fn sync_directory(&self, directory: &Path) -> Result<(), DurableError> {
        if self.fsync {
            let (base, relative) = self.resolve(directory);
            self.step(FileStep::SyncDirectory, directory, |_| handle::sync_directory(base, &relative), 0)?;
        }
        Ok(())
    }

    /// Removes `key`, durably; a missing key is no error.
    pub fn remove(&self, key: &str) -> Result<(), DurableError> {
        let path = self.path(key)?;
        let (base, relative) = self.resolve(&path);
        let remove = |_: &Path| match handle::remove_file(base, &relative) {
            Err(e) if is_not_found(&e) => Ok(false),
            other => other.map(|()| true),
        };
        match self.step(FileStep::Remove, &path, remove, 0)? {
            true => self.sync_directory(path.parent().unwrap_or(&self.root)),
            false => Ok(()),
        }
    }

    /// Renames the file `key` to `to`, replacing an existing file. `false` if there is no file `key`.
    pub fn rename(&self, key: &str, to: &str) -> Result<bool, DurableError> {
        let (from, to) = (self.path(key)?, self.path(to)?);
        let ((base, old), (_, new)) = (self.resolve(&from), self.resolve(&to));
        match self.step(FileStep::Rename, &to, |_| handle::rename(base, &old, &new), 0) {
            Err(DurableError::Io { source, .. }) if is_not_found(&source) => Ok(false),
            other => other.map(|()| true),
        }
    }

    /// Removes directory `key` with its contents; a missing one is no error. It is renamed to a temporary name first, so that an
    /// interrupted removal leaves no incomplete directory `key`.
    pub fn remove_tree(&self, key: &str) -> Result<(), DurableError> {
        let path = self.path(key)?;
        let temp = path.with_file_name(temp_name());
        let ((base, from), (_, aside)) = (self.resolve(&path), self.resolve(&temp));
        match fault::inject(FileStep::Publish).and_then(|()| handle::rename(base, &from, &aside)) {
            Err(e) if is_not_found(&e) => return Ok(()),
            other => other.map_err(|e| DurableError::io("rename", &path, 0, e))?,
        }
        self.sync_directory(path.parent().unwrap_or(&self.root))?;
        handle::remove_tree(base, &aside).map_err(|e| DurableError::io("remove", &temp, 0, e))
    }
}
