//! Writes, renames and removals of the files of a [`Directory`].

use std::io::Write;
use std::path::Path;

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
        let directory = path.parent().unwrap_or(&self.root).to_path_buf();
        self.create_directories(&directory)?;
        let temp = directory.join(temp_name());
        let (base, from) = self.resolve(&temp);
        let rename = |p: &Path| handle::rename(base, &from, &self.resolve(p).1);
        self.write_temp(&temp, bytes)
            .and_then(|()| self.step(FileStep::Rename, &path, rename, bytes.len() as u64))
            .inspect_err(|_| {
                // The first error is the one to report; a remaining temporary file is swept later.
                let _ = handle::remove_file(base, &from);
            })?;
        self.sync_directory(&directory)
    }

    fn create_directories(&self, path: &Path) -> Result<(), DurableError> {
        let (base, relative) = match &self.handle {
            Some(_) => self.resolve(path),
            None => return file_system::create_directories(path, self.fsync),
        };
        handle::create_directories(base, &relative, self.fsync)
            .map_err(|e| DurableError::io("create directory", path, 0, e))
    }

    fn write_temp(&self, temp: &Path, bytes: &[u8]) -> Result<(), DurableError> {
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
        if self.fsync {
            self.step(FileStep::Sync, temp, |_| file.sync_all(), size)?;
        }
        Ok(())
    }

    fn sync_directory(&self, directory: &Path) -> Result<(), DurableError> {
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
