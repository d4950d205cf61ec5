//! Queries and operations on paths: directories, links, permissions, free space, page cache.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

use rustix::fs::CWD;

use super::error::DurableError;
use super::handle;
use super::url::is_url;

/// Content of the file at `path`; `None` if it has more than `max` bytes. Of devices and pipes, which have no size, no more is read.
///
/// # Errors
/// It cannot be read.
pub fn read_file_at_most(path: &Path, max: u64) -> std::io::Result<Option<Vec<u8>>> {
    let mut bytes = Vec::new();
    File::open(path)?.take(max + 1).read_to_end(&mut bytes)?;
    Ok(Some(bytes).filter(|bytes| bytes.len() as u64 <= max))
}

/// Flushes a directory's entries to the disk.
pub(super) fn sync_directory(path: &Path) -> std::io::Result<()> {
    handle::sync_directory(CWD, path)
}

/// Creates `path` and its missing parents; with `fsync` each new entry is flushed in its parent.
pub fn create_directories(path: &Path, fsync: bool) -> Result<(), DurableError> {
    if path.as_os_str().is_empty() || path.is_dir() {
        return Ok(());
    }
    if is_url(path) {
        return Err(DurableError::Address {
            path: path.into(),
            problem: "expected a local directory".into(),
        });
    }
    let parent = path.parent().unwrap_or(Path::new(""));
    create_directories(parent, fsync)?;
    match std::fs::create_dir(path) {
        Err(e) if e.kind() == ErrorKind::AlreadyExists && path.is_dir() => Ok(()),
        Err(e) => Err(DurableError::io("create directory", path, 0, e)),
        Ok(()) if fsync => {
            let parent = parent_of(path);
            sync_directory(parent).map_err(|e| DurableError::io("flush directory", parent, 0, e))
        }
        Ok(()) => Ok(()),
    }
}

/// The directory that contains `path`; `.` for a bare name.
pub fn parent_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Target of the symbolic link `path`, also of a dangling one; `path` itself, without a trailing `/`, if it is no link. A rename to
/// the target keeps the link.
pub fn link_target(path: &Path) -> PathBuf {
    if is_url(path) {
        return path.to_path_buf();
    }
    let mut target: PathBuf = path.components().collect();
    // As many links in a row as Linux follows; a loop is reported by the operation that uses the result.
    for _ in 0..40 {
        let Ok(next) = std::fs::read_link(&target) else { break };
        target = parent_of(&target).join(next).components().collect();
    }
    target
}

/// Checks that this process may create files in `directory`.
///
/// # Errors
/// [`DurableError::Permission`] if not; [`DurableError`] if the check itself fails.
pub fn check_writable(directory: &Path) -> Result<(), DurableError> {
    use rustix::fs::Access;
    rustix::fs::access(directory, Access::WRITE_OK | Access::EXEC_OK)
        .map_err(|e| DurableError::io("write into", directory, 0, e.into()))
}

/// Bytes available to an ordinary user on the file system of `path`, which must exist.
pub fn free_bytes(path: &Path) -> Result<u64, DurableError> {
    let s = rustix::fs::statvfs(path)
        .map_err(|e| DurableError::io("determine the free space of", path, 0, e.into()))?;
    Ok(s.f_bavail.saturating_mul(s.f_frsize))
}

/// Removes a file from the page cache (POSIX_FADV_DONTNEED), so that the next read is from the disk; the kernel may ignore it.
pub fn evict(path: &Path) -> Result<(), DurableError> {
    let file = File::open(path).map_err(|e| DurableError::io("open", path, 0, e))?;
    #[cfg(target_os = "linux")]
    rustix::fs::fadvise(&file, 0, None, rustix::fs::Advice::DontNeed)
        .map_err(|e| DurableError::io("advise about", path, 0, e.into()))?;
    Ok(())
}
