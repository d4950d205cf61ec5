//! Errors of files and objects, and which of them may pass when the operation is repeated.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rustix::io::Errno;

/// Error of an operation on a file or an object. No file with a final name is left incomplete.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages describe the fields")]
pub enum DurableError {
    /// The disk is full, or the user's quota is exceeded.
    #[error(
        "could not {doing} {path} ({bytes} bytes): no space left: {source}; free some space or choose another directory, then run \
         the same command again"
    )]
    StorageFull {
        /// Operation, as a verb.
        doing: &'static str,
        path: PathBuf,
        bytes: u64,
        source: std::io::Error,
    },
    /// Permission denied.
    #[error(
        "could not {doing} {path}: not permitted: {source}; check its owner and permissions, or choose another directory"
    )]
    Permission { doing: &'static str, path: PathBuf, source: std::io::Error },
    /// A store that existed when the job started is missing.
    #[error(
        "{path}/{missing} has disappeared since the job started: another command replaces it, or its disk is not mounted; then run the same command again"
    )]
    StoreMissing { path: PathBuf, missing: String },
    /// Requests to a remote store failed or timed out, after all retries.
    #[error(
        "could not {doing} {path}: {reason}; the store is unreachable or failing: check the network and the address, then \
         run the same command again"
    )]
    Unreachable { doing: &'static str, path: PathBuf, reason: String },
    /// A remote store rejected the request.
    #[error("could not {doing} {path}: {reason}; {way_out}")]
    Rejected { doing: &'static str, path: PathBuf, reason: String, way_out: &'static str },
    /// A path or URL that names no store of the required kind, or invalid settings of the environment for it.
    #[error("{path}: {problem}")]
    Address {
        /// The path or URL, without credentials.
        path: PathBuf,
        problem: String,
    },
    /// Any other error of the operating system.
    #[error("could not {doing} {path}: {source}")]
    Io { doing: &'static str, path: PathBuf, source: std::io::Error },
    /// A file has an unexpected length.
    #[error("{path} has {found} bytes, expected {expected}")]
    Length {
        path: PathBuf,
        /// Required or maximum length in bytes.
        expected: u64,
        found: u64,
    },
    /// The requested range exceeds the file.
    #[error("{path} is truncated: {length} bytes from offset {offset} were requested, it has {size}")]
    Range {
        path: PathBuf,
        /// First byte; negative counts from the end.
        offset: i64,
        length: u64,
        size: u64,
    },
    /// A key that is not a plain relative path.
    #[error("key {key:?} is not a path inside {root}")]
    Key { key: String, root: PathBuf },
}

impl DurableError {
    /// Classifies an error of the operating system.
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

    /// Whether the same call may succeed later; not after a permission error or damage.
    pub fn retryable(&self) -> bool {
        match self {
            Self::StorageFull { .. } | Self::StoreMissing { .. } | Self::Unreachable { .. } => true,
            Self::Io { source, .. } => passes(source),
            _ => false,
        }
    }

    /// Whether it is a device error (EIO): of the network of a remote disk, or of a bad sector of a local one.
    pub fn is_device_error(&self) -> bool {
        let Self::Io { source, .. } = self else { return false };
        Errno::from_io_error(source) == Some(Errno::IO)
    }
}

/// Whether a file or a directory above it does not exist.
pub(crate) fn is_not_found(e: &std::io::Error) -> bool {
    matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory)
}

/// Whether an error of the operating system may pass: disk full, store unreachable (EIO of a device or network file system
/// included), shortage of a resource of the host.
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
    let unreachable = [Errno::IO, Errno::NODEV, Errno::NXIO, Errno::MFILE, Errno::NFILE];
    kind || Errno::from_io_error(error).is_some_and(|e| unreachable.contains(&e))
}

impl From<DurableError> for std::io::Error {
    fn from(e: DurableError) -> Self {
        let kind = match &e {
            DurableError::StorageFull { source, .. }
            | DurableError::Permission { source, .. }
            | DurableError::Io { source, .. } => source.kind(),
            DurableError::Unreachable { .. } => ErrorKind::TimedOut,
            DurableError::Rejected { .. } => ErrorKind::PermissionDenied,
            _ => ErrorKind::InvalidData,
        };
        Self::new(kind, e)
    }
}

/// The error of a store among the causes of an error of another library, if there is one.
pub(crate) fn store_error(
    doing: &'static str,
    path: &Path,
    error: &(dyn std::error::Error + 'static),
) -> Option<DurableError> {
    use std::io::Error as Io;
    let convert = |e: &Io| {
        let remote = |e: &DurableError| match e {
            DurableError::Unreachable { doing, path, reason } => {
                Some(DurableError::Unreachable { doing, path: path.clone(), reason: reason.clone() })
            }
            DurableError::Rejected { doing, path, reason, way_out } => {
                Some(DurableError::Rejected { doing, path: path.clone(), reason: reason.clone(), way_out })
            }
            _ => None,
        };
        let system =
            || e.raw_os_error().map(|code| DurableError::io(doing, path, 0, Io::from_raw_os_error(code)));
        e.get_ref().and_then(|inner| remote(inner.downcast_ref()?)).or_else(system)
    };
    std::iter::successors(Some(error), |e| e.source())
        .find_map(|e| convert(e.downcast_ref().or_else(|| e.downcast_ref::<Arc<Io>>().map(AsRef::as_ref))?))
}
