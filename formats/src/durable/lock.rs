//! Advisory lock: a file that names the process which works on a unit of a job, so that no second process works on it as well.
//!
//! Only duplicate work depends on it: writers of one job write the same bytes, each file atomically. The lock file appears complete
//! (written under a temporary name, then linked) and is removed at the end. The lock of an ended process
//! ([`ProcessIdentity::has_ended`]) is taken over; one of unknown state only on request (`take_over`).
//!
//! A process holds `flock` on the directory while it inspects and changes a lock, for milliseconds ([`directory_flock`]).

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::error::{DurableError, is_not_found};
use super::process::ProcessIdentity;

mod directory_flock;
mod error;
mod file;
mod owner;

pub use error::LockError;
pub use owner::LockOwner;

const SUFFIX: &str = ".lock";

/// A lock; released when dropped.
#[derive(Debug)]
pub struct Lock {
    path: PathBuf,
    bytes: Vec<u8>,
}

impl Lock {
    /// Takes the lock of `unit` in `directory`; with `take_over` also from an owner of unknown state.
    ///
    /// # Errors
    /// [`LockError`] if another process has it, or a file cannot be written.
    pub fn take(directory: &Path, unit: &str, take_over: bool) -> Result<Self, LockError> {
        // Not its parents: a film that was removed is not created again by a lock.
        match std::fs::create_dir(directory) {
            Err(e) if e.kind() != ErrorKind::AlreadyExists => {
                return Err(DurableError::io("create directory", directory, 0, e).into());
            }
            _ => (),
        }
        let path = directory.join(format!("{unit}{SUFFIX}"));
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_secs());
        let process = ProcessIdentity::current().clone();
        let owner = LockOwner { unit: unit.into(), process, since_unix_s: since };
        let bytes = serde_json::to_vec(&owner).expect("JSON values are JSON");
        let _flock =
            directory_flock::hold(directory, directory_flock::REPORT_AFTER, directory_flock::GIVE_UP_AFTER)?;
        remove_stale(&path, take_over)?;
        match file::create(&path, &bytes) {
            Ok(()) => Ok(Self { path, bytes }),
            Err(e) if e.kind() == ErrorKind::AlreadyExists => Err(LockError::Elsewhere {
                owner: file::read(&path)?.and_then(|b| LockOwner::parse(&b)),
                path,
            }),
            Err(e) => Err(DurableError::io("create", &path, bytes.len() as u64, e).into()),
        }
    }

    /// Path of the lock file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Releases a lock of this process by its path: for a process that ends without dropping the value.
    pub fn release(path: &Path) {
        let own =
            |bytes: &[u8]| LockOwner::parse(bytes).is_some_and(|o| o.process == *ProcessIdentity::current());
        if file::read(path).ok().flatten().is_some_and(|b| own(&b)) {
            // One that remains is taken over: its owner has ended by then.
            let _ = std::fs::remove_file(path);
        }
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        if file::read(&self.path).ok().flatten().as_ref() == Some(&self.bytes) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Removes the lock file if its owner has ended or, with `take_over`, is of unknown state.
fn remove_stale(path: &Path, take_over: bool) -> Result<(), LockError> {
    let Some(bytes) = file::read(path)? else { return Ok(()) };
    let owner = LockOwner::parse(&bytes);
    match (owner.as_ref().and_then(|o| o.process.has_ended()), owner) {
        (Some(true), _) => (),
        (Some(false), Some(owner)) => return Err(LockError::Held { path: path.into(), owner }),
        (_, owner) if !take_over => return Err(LockError::Elsewhere { path: path.into(), owner }),
        _ => (),
    }
    match std::fs::remove_file(path) {
        Err(e) if !is_not_found(&e) => Err(DurableError::io("remove", path, 0, e).into()),
        _ => Ok(()),
    }
}

/// The locks in `directory`: path, owner if the file is readable as a lock, and whether that process has ended (`None`: unknown).
#[allow(clippy::type_complexity, reason = "a list of three plain values")]
pub fn locks(directory: &Path) -> Result<Vec<(PathBuf, Option<Box<LockOwner>>, Option<bool>)>, DurableError> {
    let failed = |e| DurableError::io("list", directory, 0, e);
    let entries = match std::fs::read_dir(directory) {
        Err(e) if is_not_found(&e) => return Ok(Vec::new()),
        other => other.map_err(failed)?,
    };
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.map_err(failed)?.path();
        if !path.file_name().is_some_and(|n| n.to_string_lossy().ends_with(SUFFIX)) {
            continue;
        }
        let bytes = match file::read(&path) {
            Err(LockError::Storage(e)) => return Err(e),
            // Not a regular file: listed without an owner.
            Err(_) => Vec::new(),
            Ok(Some(bytes)) => bytes,
            Ok(None) => continue,
        };
        let owner = LockOwner::parse(&bytes);
        let ended = owner.as_ref().and_then(|o| o.process.has_ended());
        found.push((path, owner, ended));
    }
    found.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(found)
}

#[cfg(test)]
mod tests;
