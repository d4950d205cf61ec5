//! Files that are absent or whole: written under a temporary name beside their place, flushed, then renamed.
//!
//! One file is replaced by one rename: a reader sees the old file or the new one. Several files that belong together
//! ([`finish_together`]) cannot be replaced at once, so readers are kept from a mixture instead. The last file is the one without which
//! the others are not read (an ENVI header, the page of a report); old files are renamed aside in reverse order, the new ones renamed
//! into place in order:
//!
//! | a process killed | is followed by |
//! |---|---|
//! | before the first rename | all old files |
//! | between the first and the last | no last file: nothing that a reader takes for complete; the same command completes it |
//! | after the last | all new files |
//!
//! Never an old header beside new data, nor the reverse. An error (not a kill) on the way renames everything back. Without old files
//! nothing is renamed aside, and the last file appears last.

use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

#[cfg(target_os = "linux")]
use rustix::fs::{Mode, OFlags, RenameFlags};

use super::fault::strike;
use super::{
    DurableError, Step, is_url, link_target, parent_of, publish, remove_temp, sweep_entries, sync_directory,
    temp_name,
};

/// A file that is being written. Dropped before [`WholeFile::finish`], it leaves nothing.
#[derive(Debug)]
pub struct WholeFile {
    file: File,
    temp: PathBuf,
    place: PathBuf,
}

impl WholeFile {
    /// Begins the file that is to be at `place`; what lies there stays until the end. Temporary files beside it whose makers
    /// have ended are removed.
    ///
    /// # Errors
    /// [`DurableError`] if no file can be made there.
    pub fn create(place: &Path) -> Result<Self, DurableError> {
        if is_url(place) {
            return Err(not_here(place));
        }
        // A link stays a link: the file that it leads to is replaced.
        let place = &link_target(place);
        let parent = parent_of(place);
        let made = || {
            place.file_name().ok_or(ErrorKind::InvalidFilename)?;
            if place.symlink_metadata().is_ok_and(|m| m.is_dir()) {
                return Err(ErrorKind::IsADirectory.into());
            }
            let temp = parent.join(temp_name());
            let file = File::options().read(true).write(true).create_new(true).open(&temp)?;
            Ok((file, temp))
        };
        let (file, temp) = made().map_err(|e| DurableError::io("create", place, 0, e))?;
        let whole = Self { file, temp, place: place.into() };
        sweep_entries(parent)?;
        Ok(whole)
    }

    /// Begins a file that holds `text`.
    ///
    /// # Errors
    /// [`DurableError`] if no file can be made there, or the disk is full.
    pub fn with_text(place: &Path, text: &str) -> Result<Self, DurableError> {
        let whole = Self::create(place)?;
        let written = whole.file().write_all(text.as_bytes());
        written.map_err(|e| DurableError::io("write", place, text.len() as u64, e))?;
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
        self.flush()?;
        rename(&self.temp, &self.place, &self.place)?;
        flush_directory(parent_of(&self.place))
    }

    fn flush(&self) -> Result<(), DurableError> {
        strike(Step::Sync)
            .and_then(|()| self.file.sync_all())
            .map_err(|e| DurableError::io("flush", &self.place, 0, e))
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        // Gone after a rename; otherwise an earlier error is the one to report.
        let _ = std::fs::remove_file(&self.temp);
    }
}

/// Gives several files their names; the last is the one without which the others are not read. See the head of this file.
///
/// # Errors
/// [`DurableError`]; all old files are in their places then.
pub fn finish_together(files: Vec<WholeFile>) -> Result<(), DurableError> {
    for file in &files {
        file.flush()?;
    }
    let mut moved = Moved::default();
    let mut directories: Vec<&Path> = files.iter().map(|f| parent_of(&f.place)).collect();
    directories.sort_unstable();
    directories.dedup();
    let flush = || directories.iter().try_for_each(|d| flush_directory(d));
    let all = files.iter().rev().try_for_each(|f| moved.aside(&f.place));
    all.and_then(|()| if moved.aside.is_empty() { Ok(()) } else { flush() })
        .and_then(|()| files.iter().try_for_each(|f| moved.rename(&f.temp, &f.place, &f.place)))
        .and_then(|()| flush())
        .inspect_err(|_| moved.undo())?;
    // The new files are complete; an old one that stays under its temporary name is swept later.
    moved.aside.iter().for_each(|old| drop(std::fs::remove_file(old)));
    Ok(())
}

/// Renames done so far, so that they can be undone.
#[derive(Default)]
struct Moved {
    /// From, to.
    renames: Vec<(PathBuf, PathBuf)>,
    aside: Vec<PathBuf>,
}

impl Moved {
    fn aside(&mut self, place: &Path) -> Result<(), DurableError> {
        if place.symlink_metadata().is_err() {
            return Ok(());
        }
        let aside = parent_of(place).join(temp_name());
        self.rename(place, &aside, place)?;
        self.aside.push(aside);
        Ok(())
    }

    fn rename(&mut self, from: &Path, to: &Path, place: &Path) -> Result<(), DurableError> {
        rename(from, to, place)?;
        self.renames.push((from.into(), to.into()));
        Ok(())
    }

    fn undo(&mut self) {
        for (from, to) in self.renames.drain(..).rev() {
            // The error that led here is the one to report.
            let _ = std::fs::rename(to, from);
        }
    }
}

fn rename(from: &Path, to: &Path, place: &Path) -> Result<(), DurableError> {
    strike(Step::Rename)
        .and_then(|()| std::fs::rename(from, to))
        .map_err(|e| DurableError::io("rename to", place, 0, e))
}

fn flush_directory(directory: &Path) -> Result<(), DurableError> {
    strike(Step::SyncDirectory)
        .and_then(|()| sync_directory(directory))
        .map_err(|e| DurableError::io("flush directory", directory, 0, e))
}

fn not_here(place: &Path) -> DurableError {
    DurableError::Address { path: place.into(), problem: "expected a file of this machine".into() }
}

/// Gives the directory `temp` the name `path`, in place of the directory that is there, which is then removed. Linux exchanges the
/// two names at once; on a file system that cannot, a process killed between two renames leaves no directory of that name.
///
/// # Errors
/// [`DurableError`] if it cannot be renamed; the old directory is in its place then.
pub fn replace_directory(temp: &Path, path: &Path) -> Result<(), DurableError> {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{CWD, renameat_with};
        let exchanged = strike(Step::Publish)
            .and_then(|()| Ok(renameat_with(CWD, temp, CWD, path, RenameFlags::EXCHANGE)?));
        match exchanged {
            Ok(()) => {
                // What cannot be removed of the old one is swept later.
                let _ = remove_temp(temp);
                return flush_directory(parent_of(path));
            }
            Err(e) if matches!(e.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => (),
            Err(e) => return Err(DurableError::io("replace", path, 0, e)),
        }
    }
    let aside = parent_of(path).join(temp_name());
    rename(path, &aside, path)?;
    let taken = || DurableError::io("rename to", path, 0, ErrorKind::AlreadyExists.into());
    publish(temp, path, true).and_then(|done| if done { Ok(()) } else { Err(taken()) }).inspect_err(
        |_| {
            // The error in hand is the one to report.
            let _ = std::fs::rename(&aside, path);
        },
    )?;
    let _ = remove_temp(&aside);
    Ok(())
}

/// A file without a name in `directory`, open for reading and writing; gone when it is closed, however the process ends. Temporary files
/// of ended processes in the directory are removed.
///
/// # Errors
/// [`DurableError`] if it cannot be made there.
pub fn nameless_file(directory: &Path) -> Result<File, DurableError> {
    sweep_entries(directory)?;
    let failed = |e| DurableError::io("create a temporary file in", directory, 0, e);
    #[cfg(target_os = "linux")]
    {
        let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
        if let Ok(file) = rustix::fs::open(directory, flags, Mode::RUSR | Mode::WUSR) {
            return Ok(file.into());
        }
    }
    // A file system without such files: a process killed between the two calls leaves an empty file, swept later.
    let temp = directory.join(temp_name());
    let file = File::options().read(true).write(true).create_new(true).open(&temp).map_err(failed)?;
    std::fs::remove_file(&temp).map_err(failed)?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn files(directory: &Path) -> BTreeMap<String, Vec<u8>> {
        let entries = std::fs::read_dir(directory).unwrap().map(|e| e.unwrap());
        entries
            .map(|e| (e.file_name().into_string().unwrap(), std::fs::read(e.path()).unwrap_or_default()))
            .collect()
    }

    fn holding(all: &[(&str, &str)]) -> BTreeMap<String, Vec<u8>> {
        all.iter().map(|(name, text)| ((*name).to_owned(), text.as_bytes().to_vec())).collect()
    }

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

    #[test]
    fn files_that_belong_together_are_all_new_or_all_old() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        let new = |n: &str| {
            ["a.bsq", "a.hdr"].map(|name| WholeFile::with_text(&at(name), &format!("{name} {n}")).unwrap())
        };
        finish_together(new("1").into()).unwrap();
        assert_eq!(files(directory.path()), holding(&[("a.bsq", "a.bsq 1"), ("a.hdr", "a.hdr 1")]));
        drop(new("2"));
        finish_together(new("3").into()).unwrap();
        let third = holding(&[("a.bsq", "a.bsq 3"), ("a.hdr", "a.hdr 3")]);
        assert_eq!(files(directory.path()), third);
        // The last rename fails: a directory has taken the header's name, after the old one was renamed aside.
        let mut moved = Moved::default();
        let both = new("4");
        both.iter().rev().try_for_each(|f| moved.aside(&f.place)).unwrap();
        moved.rename(&both[0].temp, &both[0].place, &both[0].place).unwrap();
        std::fs::create_dir(at("a.hdr")).unwrap();
        assert!(moved.rename(&both[1].temp, &both[1].place, &both[1].place).is_err());
        std::fs::remove_dir(at("a.hdr")).unwrap();
        moved.undo();
        drop(both);
        assert_eq!(files(directory.path()), third);
    }

    #[test]
    fn a_directory_is_replaced_at_once_and_the_old_one_removed() {
        let directory = tempfile::tempdir().unwrap();
        let (old, new) = (directory.path().join("chart.zarr"), directory.path().join(temp_name()));
        for (path, name) in [(&old, "old"), (&new, "new")] {
            std::fs::create_dir(path).unwrap();
            std::fs::write(path.join(name), name).unwrap();
        }
        replace_directory(&new, &old).unwrap();
        assert_eq!(files(directory.path()).into_keys().collect::<Vec<_>>(), ["chart.zarr"]);
        assert_eq!(files(&old), holding(&[("new", "new")]));
    }

    #[test]
    fn a_nameless_file_leaves_no_entry() {
        let directory = tempfile::tempdir().unwrap();
        let file = nameless_file(directory.path()).unwrap();
        (&file).write_all(b"bands").unwrap();
        assert_eq!(file.metadata().unwrap().len(), 5);
        assert_eq!(files(directory.path()), BTreeMap::new());
    }
}
