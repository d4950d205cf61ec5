//! File operations relative to an open directory (`openat` and related system calls).
//!
//! A path refers to what is there at the time of the call; an open directory remains the one that was opened. A write relative to it never
//! reaches another directory that has taken its path since: it goes to the old directory, or fails with "not found" after the removal of
//! that. Paths are relative to `base`; with [`CWD`](rustix::fs::CWD) they are ordinary paths.

use std::ffi::OsString;
use std::fs::File;
use std::io::{ErrorKind, Result};
use std::os::fd::{BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStringExt;
use std::path::{Path, PathBuf};

use rustix::fs::{AtFlags, Dir, FileType, Mode, OFlags, Stat, mkdirat, openat, renameat, statat, unlinkat};
use rustix::io::retry_on_intr;

use super::error::is_not_found;

/// Attempts to remove a directory into which other processes still write, and pause between them.
const MAX_ATTEMPTS: usize = 100;
const PAUSE: std::time::Duration = std::time::Duration::from_millis(10);

fn open_with(base: BorrowedFd<'_>, path: &Path, flags: OFlags, mode: Mode) -> Result<OwnedFd> {
    // An empty path means the directory itself.
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    Ok(retry_on_intr(|| openat(base, path, flags | OFlags::CLOEXEC, mode))?)
}

/// Opens a directory.
pub(super) fn directory(base: BorrowedFd<'_>, path: &Path) -> Result<OwnedFd> {
    open_with(base, path, OFlags::RDONLY | OFlags::DIRECTORY, Mode::empty())
}

/// Opens a file for reading. A named pipe does not block; the caller rejects anything but a regular file.
pub(super) fn open(base: BorrowedFd<'_>, path: &Path) -> Result<File> {
    Ok(open_with(base, path, OFlags::RDONLY | OFlags::NONBLOCK, Mode::empty())?.into())
}

/// Creates a file for writing; it must not exist.
pub(super) fn create_new(base: BorrowedFd<'_>, path: &Path) -> Result<File> {
    let flags = OFlags::WRONLY | OFlags::CREATE | OFlags::EXCL;
    Ok(open_with(base, path, flags, Mode::from_raw_mode(0o666))?.into())
}

/// Renames `from` to `to`, replacing an existing file.
pub(super) fn rename(base: BorrowedFd<'_>, from: &Path, to: &Path) -> Result<()> {
    Ok(retry_on_intr(|| renameat(base, from, base, to))?)
}

/// Removes a file.
pub(super) fn remove_file(base: BorrowedFd<'_>, path: &Path) -> Result<()> {
    Ok(retry_on_intr(|| unlinkat(base, path, AtFlags::empty()))?)
}

/// Metadata of `path`, links followed.
pub(super) fn stat(base: BorrowedFd<'_>, path: &Path) -> Result<Stat> {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    Ok(retry_on_intr(|| statat(base, path, AtFlags::empty()))?)
}

/// Whether it is a regular file.
pub(super) fn is_file(stat: &Stat) -> bool {
    FileType::from_raw_mode(stat.st_mode) == FileType::RegularFile
}

/// Names and types of a directory's entries; links are not followed.
pub(super) fn entries(base: BorrowedFd<'_>, path: &Path) -> Result<Vec<(OsString, FileType)>> {
    let fd = directory(base, path)?;
    let mut found = Vec::new();
    for entry in Dir::read_from(&fd)? {
        let entry = entry?;
        let name = entry.file_name();
        if matches!(name.to_bytes(), b"." | b"..") {
            continue;
        }
        let kind = match entry.file_type() {
            FileType::Unknown => match retry_on_intr(|| statat(&fd, name, AtFlags::SYMLINK_NOFOLLOW)) {
                Ok(stat) => FileType::from_raw_mode(stat.st_mode),
                // Removed since it was listed.
                Err(rustix::io::Errno::NOENT) => continue,
                Err(e) => return Err(e.into()),
            },
            known => known,
        };
        found.push((OsString::from_vec(name.to_bytes().to_vec()), kind));
    }
    Ok(found)
}

/// Flushes a directory's entries. File systems without that (some network file systems) return EINVAL, which is ignored.
pub(super) fn sync_directory(base: BorrowedFd<'_>, path: &Path) -> Result<()> {
    match File::from(directory(base, path)?).sync_all() {
        Err(e) if matches!(e.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => Ok(()),
        other => other,
    }
}

/// Creates the missing directories of `path`; with `fsync` each new entry is flushed in its parent.
pub(super) fn create_directories(base: BorrowedFd<'_>, path: &Path, fsync: bool) -> Result<()> {
    let is_dir = || stat(base, path).is_ok_and(|s| FileType::from_raw_mode(s.st_mode) == FileType::Directory);
    if path.as_os_str().is_empty() || is_dir() {
        return Ok(());
    }
    let parent = path.parent().unwrap_or(Path::new(""));
    create_directories(base, parent, fsync)?;
    match retry_on_intr(|| mkdirat(base, path, Mode::from_raw_mode(0o777))) {
        Err(rustix::io::Errno::EXIST) if is_dir() => Ok(()),
        Err(e) => Err(e.into()),
        Ok(()) if fsync => sync_directory(base, parent),
        Ok(()) => Ok(()),
    }
}

/// Removes a directory with its contents, also files that another process adds meanwhile. A missing one is no error.
pub(super) fn remove_tree(base: BorrowedFd<'_>, path: &Path) -> Result<()> {
    for attempt in 1.. {
        match remove_once(base, path) {
            Err(e) if is_not_found(&e) => return Ok(()),
            Err(e) if e.kind() == ErrorKind::DirectoryNotEmpty && attempt < MAX_ATTEMPTS => {
                std::thread::sleep(PAUSE);
            }
            other => return other,
        }
    }
    unreachable!("the last attempt returns")
}

fn remove_once(base: BorrowedFd<'_>, path: &Path) -> Result<()> {
    for (name, kind) in entries(base, path)? {
        let inner: PathBuf = path.join(name);
        let removed = match kind {
            FileType::Directory => remove_once(base, &inner),
            _ => remove_file(base, &inner),
        };
        match removed {
            Err(e) if !is_not_found(&e) => return Err(e),
            _ => (),
        }
    }
    Ok(retry_on_intr(|| unlinkat(base, path, AtFlags::REMOVEDIR))?)
}
