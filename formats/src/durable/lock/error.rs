//! Errors of taking a lock.

use std::path::PathBuf;

use super::super::error::DurableError;
use super::owner::LockOwner;

/// A lock cannot be taken.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages describe the fields")]
pub enum LockError {
    /// Its owner is a running process of this host.
    #[error(
        "{} is locked by process {} of this host, which is running; wait for it or stop it", .path.display(),
        .owner.process.pid
    )]
    Held { path: PathBuf, owner: Box<LockOwner> },
    /// The state of its owner is unknown.
    #[error(
        "{} is locked by {}; if that process has ended, run again with --take-over", .path.display(),
        .owner.as_ref().map_or("an unknown process".into(), |o| format!("process {} of host {}", o.process.pid, o.process.host))
    )]
    Elsewhere {
        path: PathBuf,
        /// Its owner, if the file states it.
        owner: Option<Box<LockOwner>>,
    },
    /// Another process has held the flock of the directory beyond the limit.
    #[error(
        "taking a lock in {} waited {seconds} s for {}, which holds the lock of the directory; stop that process (or resume it \
         if it is suspended), then run the same command again", .directory.display(), process_name(*.holder)
    )]
    Busy {
        directory: PathBuf,
        /// Process id of the holder, if the system reports it.
        holder: Option<u32>,
        seconds: u64,
    },
    /// The lock path is not a regular file, so this program did not create it.
    #[error("{} is {found}, expected a lock file; remove it, then run the same command again", .path.display())]
    NotAFile { path: PathBuf, found: &'static str },
    /// Error of a file.
    #[error("locking: {0}")]
    Storage(#[from] DurableError),
}

impl LockError {
    /// Whether the same call may succeed later, when the other process has ended.
    pub fn retryable(&self) -> bool {
        match self {
            Self::Storage(e) => e.retryable(),
            Self::NotAFile { .. } => false,
            _ => true,
        }
    }
}

/// A process in messages; `None`: not reported by the system.
pub(super) fn process_name(pid: Option<u32>) -> String {
    pid.map_or("an unknown process, perhaps of another host".into(), |pid| {
        format!("process {pid} of this host")
    })
}
