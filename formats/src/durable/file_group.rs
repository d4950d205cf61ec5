//! Replacement of several files that belong together.
//!
//! They cannot be replaced by one rename, so readers are prevented from seeing a mixture. The last file is the one without which the
//! others are not read (an ENVI header, the page of a report). Old files are renamed to temporary names in reverse order, then the new
//! ones to their final names in order:
//!
//! | process killed | state |
//! |---|---|
//! | before the first rename | all old files |
//! | between the first and the last | no last file, so no reader takes the set for complete; the same command completes it |
//! | after the last | all new files |
//!
//! An old header is never beside new data, nor the reverse. An error (not a kill) during the sequence undoes all renames. Without old
//! files there is no first half, and the last file appears last.

use std::path::{Path, PathBuf};

use super::atomic_file::AtomicFile;
use super::error::DurableError;
use super::file_system::parent_of;
use super::rename::{flush_directory, rename};
use super::temp::temp_name;

/// Renames several files to their final names; the last is the one without which the others are not read. See the head of this
/// file.
///
/// # Errors
/// [`DurableError`]; all old files are in their places then.
pub fn finish_together(files: Vec<AtomicFile>) -> Result<(), DurableError> {
    for file in &files {
        file.flush()?;
    }
    let mut renames = Renames::default();
    let mut directories: Vec<&Path> = files.iter().map(|f| parent_of(&f.path)).collect();
    directories.sort_unstable();
    directories.dedup();
    let flush = || directories.iter().try_for_each(|d| flush_directory(d));
    files
        .iter()
        .rev()
        .try_for_each(|f| renames.set_aside(&f.path))
        .and_then(|()| if renames.old_files.is_empty() { Ok(()) } else { flush() })
        .and_then(|()| files.iter().try_for_each(|f| renames.rename(&f.temp, &f.path, &f.path)))
        .and_then(|()| flush())
        .inspect_err(|_| renames.undo())?;
    // The new files are complete; an old one that remains under its temporary name is swept later.
    renames.old_files.iter().for_each(|old| drop(std::fs::remove_file(old)));
    Ok(())
}

/// Renames done so far.
#[derive(Default)]
struct Renames {
    /// From, to.
    done: Vec<(PathBuf, PathBuf)>,
    /// Temporary names of the old files.
    old_files: Vec<PathBuf>,
}

impl Renames {
    /// Renames an existing file at `path` to a temporary name.
    fn set_aside(&mut self, path: &Path) -> Result<(), DurableError> {
        if path.symlink_metadata().is_err() {
            return Ok(());
        }
        let aside = parent_of(path).join(temp_name());
        self.rename(path, &aside, path)?;
        self.old_files.push(aside);
        Ok(())
    }

    fn rename(&mut self, from: &Path, to: &Path, path: &Path) -> Result<(), DurableError> {
        rename(from, to, path)?;
        self.done.push((from.into(), to.into()));
        Ok(())
    }

    fn undo(&mut self) {
        for (from, to) in self.done.drain(..).rev() {
            // The first error is the one to report.
            let _ = std::fs::rename(to, from);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn read_all(directory: &Path) -> BTreeMap<String, Vec<u8>> {
        let entries = std::fs::read_dir(directory).unwrap().map(|e| e.unwrap());
        entries
            .map(|e| (e.file_name().into_string().unwrap(), std::fs::read(e.path()).unwrap_or_default()))
            .collect()
    }

    fn contents(all: &[(&str, &str)]) -> BTreeMap<String, Vec<u8>> {
        all.iter().map(|(name, text)| ((*name).to_owned(), text.as_bytes().to_vec())).collect()
    }

    #[test]
    fn files_of_a_group_are_all_new_or_all_old() {
        let directory = tempfile::tempdir().unwrap();
        let path = |name: &str| directory.path().join(name);
        let new = |n: &str| {
            ["a.bsq", "a.hdr"].map(|name| AtomicFile::with_text(&path(name), &format!("{name} {n}")).unwrap())
        };
        finish_together(new("1").into()).unwrap();
        assert_eq!(read_all(directory.path()), contents(&[("a.bsq", "a.bsq 1"), ("a.hdr", "a.hdr 1")]));
        drop(new("2"));
        finish_together(new("3").into()).unwrap();
        let third = contents(&[("a.bsq", "a.bsq 3"), ("a.hdr", "a.hdr 3")]);
        assert_eq!(read_all(directory.path()), third);
        // The last rename fails: a directory has the header's name, after the old header was renamed aside.
        let mut renames = Renames::default();
        let both = new("4");
        both.iter().rev().try_for_each(|f| renames.set_aside(&f.path)).unwrap();
        renames.rename(&both[0].temp, &both[0].path, &both[0].path).unwrap();
        std::fs::create_dir(path("a.hdr")).unwrap();
        assert!(renames.rename(&both[1].temp, &both[1].path, &both[1].path).is_err());
        std::fs::remove_dir(path("a.hdr")).unwrap();
        renames.undo();
        drop(both);
        assert_eq!(read_all(directory.path()), third);
    }
}
