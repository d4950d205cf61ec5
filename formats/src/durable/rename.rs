//! Durable renames of files and directories that were completed under a temporary name.

use std::io::ErrorKind;
use std::path::Path;

use super::error::DurableError;
use super::fault;
use super::file_system::{parent_of, sync_directory};
use super::step::FileStep;
use super::temp::{remove_temp, temp_name};

/// Renames; an error names `path`.
pub(super) fn rename(from: &Path, to: &Path, path: &Path) -> Result<(), DurableError> {
    fault::inject(FileStep::Rename)
        .and_then(|()| std::fs::rename(from, to))
        .map_err(|e| DurableError::io(FileStep::Rename.verb(), path, 0, e))
}

/// Flushes a directory's entries to the disk.
pub(super) fn flush_directory(directory: &Path) -> Result<(), DurableError> {
    fault::inject(FileStep::SyncDirectory)
        .and_then(|()| sync_directory(directory))
        .map_err(|e| DurableError::io(FileStep::SyncDirectory.verb(), directory, 0, e))
}

/// Renames the directory or file `temp` to `path`, durably, without replacing anything. `false` if `path` exists.
pub fn publish(temp: &Path, path: &Path, fsync: bool) -> Result<bool, DurableError> {
    // rename(2) would replace a file, but no directory with contents: a file is linked first.
    let rename = || match temp.symlink_metadata()?.is_file() {
        true => match std::fs::hard_link(temp, path) {
            Err(e) if e.kind() == ErrorKind::AlreadyExists => Err(e),
            Ok(()) => std::fs::remove_file(temp),
            // A file system without hard links: another process may create `path` between check and rename.
            Err(_) if path.symlink_metadata().is_ok() => Err(ErrorKind::AlreadyExists.into()),
            Err(_) => std::fs::rename(temp, path),
        },
        false => std::fs::rename(temp, path),
    };
    match fault::inject(FileStep::Publish).and_then(|()| rename()) {
        Err(e)
            if matches!(
                e.kind(),
                ErrorKind::DirectoryNotEmpty | ErrorKind::AlreadyExists | ErrorKind::NotADirectory
            ) =>
        {
            return Ok(false);
        }
        Err(e) => return Err(DurableError::io("rename", path, 0, e)),
        Ok(()) => {}
    }
    if fsync {
        let parent = parent_of(path);
        sync_directory(parent).map_err(|e| DurableError::io("flush directory", parent, 0, e))?;
    }
    Ok(true)
}

/// Replaces the directory at `path` by the directory `temp` and removes the old one. Linux exchanges the two names atomically; on a file
/// system without that, a process killed between two renames leaves no directory `path`.
///
/// # Errors
/// [`DurableError`] if it cannot be renamed; the old directory is at `path` then.
pub fn replace_directory(temp: &Path, path: &Path) -> Result<(), DurableError> {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        let exchanged = fault::inject(FileStep::Publish)
            .and_then(|()| Ok(renameat_with(CWD, temp, CWD, path, RenameFlags::EXCHANGE)?));
        match exchanged {
            Ok(()) => {
                // Remaining files of the old directory are swept later.
                let _ = remove_temp(temp);
                return flush_directory(parent_of(path));
            }
            Err(e) if matches!(e.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => (),
            Err(e) => return Err(DurableError::io("replace", path, 0, e)),
        }
    }
    let aside = parent_of(path).join(temp_name());
    rename(path, &aside, path)?;
    let exists = || DurableError::io("rename to", path, 0, ErrorKind::AlreadyExists.into());
    publish(temp, path, true).and_then(|done| if done { Ok(()) } else { Err(exists()) }).inspect_err(
        |_| {
            // The first error is the one to report.
            let _ = std::fs::rename(&aside, path);
        },
    )?;
    let _ = remove_temp(&aside);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replace_directory_exchanges_and_removes_the_old_one() {
        let directory = tempfile::tempdir().unwrap();
        let (old, new) = (directory.path().join("chart.zarr"), directory.path().join(temp_name()));
        for (path, name) in [(&old, "old"), (&new, "new")] {
            std::fs::create_dir(path).unwrap();
            std::fs::write(path.join(name), name).unwrap();
        }
        replace_directory(&new, &old).unwrap();
        let names = |path: &Path| -> Vec<_> {
            std::fs::read_dir(path).unwrap().map(|e| e.unwrap().file_name()).collect()
        };
        assert_eq!(names(directory.path()), ["chart.zarr"]);
        assert_eq!(names(&old), ["new"]);
        assert_eq!(std::fs::read(old.join("new")).unwrap(), b"new");
    }
}
