//! What can go wrong with a file, and whether trying again helps.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rustix::io::Errno;

use super::Step;

/// A file could not be written, read or removed. Nothing is ever left half-written under a final name.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DurableError {
    /// The disk, or the user's share of it, is full.
    #[error(
        "no space left to {doing} {path} ({bytes} bytes): {source}; free some space or choose another place, then run \
         the same command again"
    )]
    StorageFull {
        /// What was being done.
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// Bytes that were to be written.
        bytes: u64,
        /// The system's words.
        source: std::io::Error,
    },
    /// The system forbids it.
    #[error(
        "not allowed to {doing} {path}: {source}; check its owner and permissions, or choose another place"
    )]
    Permission {
        /// What was being done.
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
    /// A store that was there when the job began is not there any more.
    #[error(
        "the store {path} is gone: its {missing} was there when the job began; bring it back (is the disk mounted?)"
    )]
    Vanished {
        /// The store.
        path: PathBuf,
        /// The file whose absence shows it.
        missing: String,
    },
    /// A store far away does not answer, or is in trouble, again and again.
    #[error(
        "could not {doing} {path}: {reason}; the store is out of reach or in trouble: check the network and the address, then \
         run the same command again"
    )]
    Unreachable {
        /// What was being done.
        doing: &'static str,
        /// The URL.
        path: PathBuf,
        /// What came instead of an answer, or the answer.
        reason: String,
    },
    /// A store far away answers, and will not.
    #[error("could not {doing} {path}: {reason}; {way_out}")]
    Refused {
        /// What was being done.
        doing: &'static str,
        /// The URL.
        path: PathBuf,
        /// The store's words.
        reason: String,
        /// What can be done about it.
        way_out: &'static str,
    },
    /// A URL, or what the environment adds to it, tells no store.
    #[error("{path}: {problem}")]
    Address {
        /// The URL, without what may be secret.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// Any other failure of the system.
    #[error("could not {doing} {path}: {source}")]
    Io {
        /// What was being done.
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
    /// A file has another length than it must.
    #[error("{path} has {found} bytes, expected {expected}")]
    Length {
        /// The file.
        path: PathBuf,
        /// Bytes it must have, or may have at most.
        expected: u64,
        /// Bytes it has.
        found: u64,
    },
    /// A part was asked for that the file does not have.
    #[error("{path} is cut short: {length} bytes from offset {offset} are wanted, it has {size}")]
    Range {
        /// The file.
        path: PathBuf,
        /// First byte; negative counts from the end.
        offset: i64,
        /// Bytes wanted.
        length: u64,
        /// Bytes there are.
        size: u64,
    },
    /// A key that is not a plain relative path.
    #[error("key {key:?} is not a path inside {root}")]
    Key {
        /// The key.
        key: String,
        /// The directory.
        root: PathBuf,
    },
}

impl DurableError {
    /// Sorts an error of the system into its kind.
    pub fn io(doing: &'static str, path: &Path, bytes: u64, source: std::io::Error) -> Self {
        let path = path.to_path_buf();
        match source.kind() {
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
                Self::StorageFull { doing, path, bytes, source }
            }
            ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
                Self::Permission { doing, path, source }
            }
            _ => Self::Io { doing, path, source },
        }
    }

    /// Whether the disk is full.
    pub fn is_storage_full(&self) -> bool {
        matches!(self, Self::StorageFull { .. })
    }

    /// Whether the same call may succeed later although nobody changes a word of it. Not: forbidden, damaged.
    pub fn retryable(&self) -> bool {
        match self {
            Self::StorageFull { .. } | Self::Vanished { .. } | Self::Unreachable { .. } => true,
            Self::Io { source, .. } => passes(source),
            _ => false,
        }
    }

    /// Whether a device says that it failed (EIO): the network of a disk that is far, or one bad place of a near one.
    pub fn is_device_error(&self) -> bool {
        let Self::Io { source, .. } = self else { return false };
        Errno::from_io_error(source) == Some(Errno::IO)
    }
}

/// Whether an error of the system may pass: the disk is full, the store is away (also a device or network file system in
/// trouble: EIO), the host is short of something.
pub fn passes(error: &std::io::Error) -> bool {
    let kind = matches!(
        error.kind(),
        ErrorKind::StorageFull
            | ErrorKind::QuotaExceeded
            | ErrorKind::Interrupted
            | ErrorKind::WouldBlock
            | ErrorKind::OutOfMemory
            | ErrorKind::TimedOut
            | ErrorKind::StaleNetworkFileHandle
            | ErrorKind::HostUnreachable
            | ErrorKind::NetworkUnreachable
            | ErrorKind::NetworkDown
            | ErrorKind::NotConnected
            | ErrorKind::ConnectionAborted
            | ErrorKind::ConnectionReset
            | ErrorKind::ResourceBusy
    );
    let away = [Errno::IO, Errno::NODEV, Errno::NXIO, Errno::MFILE, Errno::NFILE];
    kind || Errno::from_io_error(error).is_some_and(|e| away.contains(&e))
}

impl From<DurableError> for std::io::Error {
    fn from(e: DurableError) -> Self {
        let kind = match &e {
            DurableError::StorageFull { source, .. }
            | DurableError::Permission { source, .. }
            | DurableError::Io { source, .. } => source.kind(),
            DurableError::Unreachable { .. } => ErrorKind::TimedOut,
            DurableError::Refused { .. } => ErrorKind::PermissionDenied,
            _ => ErrorKind::InvalidData,
        };
        Self::new(kind, e)
    }
}

/// The error of the store under an error of another library, if there is one.
pub(crate) fn store_error(
    doing: &'static str,
    path: &Path,
    error: &(dyn std::error::Error + 'static),
) -> Option<DurableError> {
    use std::io::Error as Io;
    let of = |e: &Io| {
        let far = |e: &DurableError| match e {
            DurableError::Unreachable { doing, path, reason } => {
                Some(DurableError::Unreachable { doing, path: path.clone(), reason: reason.clone() })
            }
            DurableError::Refused { doing, path, reason, way_out } => {
                Some(DurableError::Refused { doing, path: path.clone(), reason: reason.clone(), way_out })
            }
            _ => None,
        };
        let system =
            || e.raw_os_error().map(|code| DurableError::io(doing, path, 0, Io::from_raw_os_error(code)));
        e.get_ref().and_then(|inner| far(inner.downcast_ref()?)).or_else(system)
    };
    std::iter::successors(Some(error), |e| e.source())
        .find_map(|e| of(e.downcast_ref().or_else(|| e.downcast_ref::<Arc<Io>>().map(AsRef::as_ref))?))
}

impl Step {
    pub(super) const fn doing(self) -> &'static str {
        match self {
            Self::Create => "create",
            Self::Write => "write",
            Self::Sync => "flush",
            Self::Rename => "rename to",
            Self::SyncDirectory => "flush directory",
            Self::Remove | Self::Sweep => "remove",
            Self::Read => "read",
            Self::Publish => "rename to",
        }
    }
}
