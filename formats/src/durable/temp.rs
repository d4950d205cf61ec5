//! Temporary names, which state the process that made the file.
//!
//! `.tmp-<host>-<machine>-<boot>-<pid namespace>-<pid>-<start>-<nonce>`, the fields of a [`ProcessIdentity`]. No zarr key begins with
//! `.tmp-`, so no reader requests one. Every temporary file or directory of this program has such a name, in the directory of the output
//! that it becomes.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use super::error::{DurableError, is_not_found};
use super::fault;
use super::process::ProcessIdentity;
use super::step::FileStep;

const PREFIX: &str = ".tmp-";

/// A name that no other process, and no other call in this one, uses.
pub fn temp_name() -> String {
    static NONCE: AtomicU64 = AtomicU64::new(0);
    let p = ProcessIdentity::current();
    let nonce = NONCE.fetch_add(1, Ordering::Relaxed);
    format!("{PREFIX}{}-{}-{}-{}-{}-{}-{nonce}", p.host, p.machine, p.boot, p.namespace, p.pid, p.start)
}

/// Whether a file name is a temporary name, of any process.
pub fn is_temp_name(name: &str) -> bool {
    name.starts_with(PREFIX)
}

/// The process stated by a temporary name; `None` if the name states none.
pub(super) fn process_of(name: &str) -> Option<ProcessIdentity> {
    let fields: Vec<&str> = name.strip_prefix(PREFIX)?.split('-').collect();
    // The nonce may have a suffix, as in `.tmp-….zip`.
    let [host, machine, boot, namespace, pid, start, _nonce] = fields[..] else { return None };
    Some(ProcessIdentity {
        host: host.into(),
        machine: machine.into(),
        boot: boot.into(),
        namespace: namespace.into(),
        pid: pid.parse().ok()?,
        start: start.parse().ok()?,
    })
}

/// Removes a temporary file or directory; one that does not exist is no error.
pub fn remove_temp(path: &Path) -> Result<(), DurableError> {
    let is_dir = path.symlink_metadata().is_ok_and(|m| m.is_dir());
    let removed = fault::inject(FileStep::Sweep).and_then(|()| match is_dir {
        true => std::fs::remove_dir_all(path),
        false => std::fs::remove_file(path),
    });
    match removed {
        Err(e) if !is_not_found(&e) => Err(DurableError::io("remove", path, 0, e)),
        _ => Ok(()),
    }
}
