//! Reading and atomic creation of lock files. Only regular files are read: a FIFO or a device at the path is an error and does not
//! block.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

use rustix::fs::OFlags;

use super::super::error::{DurableError, is_not_found};
use super::super::temp::temp_name;
use super::error::LockError;

const MAX_BYTES: u64 = 4096;

/// The bytes of a lock file, empty if it is too long for one; `None` if it does not exist.
pub(super) fn read(path: &Path) -> Result<Option<Vec<u8>>, LockError> {
    let failed = |e| DurableError::io("read", path, 0, e);
    let kind = match path.symlink_metadata() {
        Err(e) if is_not_found(&e) => return Ok(None),
        other => other.map_err(failed)?.file_type(),
    };
    let not_a_file = |kind| LockError::NotAFile { path: path.into(), found: kind_name(kind) };
    if !kind.is_file() {
        return Err(not_a_file(kind));
    }
    // It may have been replaced since: do not follow a link, do not wait for the writer of a FIFO.
    let flags = (OFlags::NOFOLLOW | OFlags::NONBLOCK).bits();
    let file = match File::options().read(true).custom_flags(flags as i32).open(path) {
        Err(e) if is_not_found(&e) => return Ok(None),
        other => other.map_err(failed)?,
    };
    let meta = file.metadata().map_err(failed)?;
    if !meta.is_file() {
        return Err(not_a_file(meta.file_type()));
    }
    let mut bytes = Vec::new();
    file.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(failed)?;
    Ok(Some(if bytes.len() as u64 > MAX_BYTES { Vec::new() } else { bytes }))
}

fn kind_name(kind: std::fs::FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    match kind {
        k if k.is_dir() => "a directory",
        k if k.is_symlink() => "a symbolic link",
        k if k.is_fifo() => "a FIFO",
        k if k.is_socket() => "a socket",
        _ => "a device",
    }
}

/// Creates the file with its contents; `AlreadyExists` if there is one.
pub(super) fn create(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let temp = path.with_file_name(temp_name());
    std::fs::write(&temp, bytes).inspect_err(|_| drop(std::fs::remove_file(&temp)))?;
    let linked = match std::fs::hard_link(&temp, path) {
        // A file system without hard links: a process killed between the two calls leaves an empty lock of an unknown owner.
        Err(e) if !matches!(e.kind(), ErrorKind::AlreadyExists | ErrorKind::NotFound) => {
            File::options().write(true).create_new(true).open(path).and_then(|mut f| f.write_all(bytes))
        }
        other => other,
    };
    let _ = std::fs::remove_file(&temp);
    linked
}
