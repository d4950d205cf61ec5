//! One file that is absent or whole: written under a temp name beside its place, flushed, given its name.

use std::fs::File;
use std::path::{Path, PathBuf};

use super::{DurableError, parent_of, sweep_entries, sync_directory, temp_name};

/// A file that is being written. Dropped before [`WholeFile::finish`], it leaves nothing.
#[derive(Debug)]
pub struct WholeFile {
    file: File,
    temp: PathBuf,
    place: PathBuf,
}

impl WholeFile {
    /// Begins the file that is to be at `place`; what lies there stays until the end. Temp files beside it whose makers are
    /// dead are removed.
    ///
    /// # Errors
    /// [`DurableError`] if no file can be made there.
    pub fn create(place: &Path) -> Result<Self, DurableError> {
        let parent = parent_of(place);
        let made = || {
            place.file_name().ok_or(std::io::ErrorKind::InvalidFilename)?;
            let temp = parent.join(temp_name());
            let file = File::options().read(true).write(true).create_new(true).open(&temp)?;
            Ok((file, temp))
        };
        let (file, temp) = made().map_err(|e| DurableError::io("create", place, 0, e))?;
        let whole = Self { file, temp, place: place.into() };
        sweep_entries(parent)?;
        Ok(whole)
    }

    /// The file, empty at first.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Flushes the file to the disk and gives it its name.
    ///
    /// # Errors
    /// [`DurableError`]; what lay there before is still there then.
    pub fn finish(self) -> Result<(), DurableError> {
        let Self { file, temp, place } = &self;
        file.sync_all().map_err(|e| DurableError::io("flush", place, 0, e))?;
        std::fs::rename(temp, place).map_err(|e| DurableError::io("rename to", place, 0, e))?;
        let parent = parent_of(place);
        sync_directory(parent).map_err(|e| DurableError::io("flush directory", parent, 0, e))
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        // Gone after a rename; otherwise the error that brought us here is the one to tell.
        let _ = std::fs::remove_file(&self.temp);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn a_file_is_whole_or_as_before() {
        let directory = tempfile::tempdir().unwrap();
        let place = directory.path().join("a.bin");
        std::fs::write(&place, b"before").unwrap();
        let begun = WholeFile::create(&place).unwrap();
        begun.file().write_all(b"half").unwrap();
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 2);
        drop(begun);
        assert_eq!(std::fs::read(&place).unwrap(), b"before");
        let begun = WholeFile::create(&place).unwrap();
        begun.file().write_all(b"after").unwrap();
        begun.finish().unwrap();
        assert_eq!(std::fs::read(&place).unwrap(), b"after");
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 1);
        let error = WholeFile::create(Path::new("/nowhere/at/all.bin")).unwrap_err().to_string();
        assert!(error.contains("/nowhere/at/all.bin"), "{error}");
    }
}
