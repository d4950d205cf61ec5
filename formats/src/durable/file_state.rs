//! State of a file, from its metadata: a file that was written, replaced or touched has another one.
//!
//! The time of last status change (ctime) cannot be set by a program, so equal states mean equal bytes, to the resolution of the
//! file system's clock.

use std::fs::Metadata;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Device and inode, size and times of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FileState {
    /// Device and inode.
    pub(crate) inode: (u64, u64),
    /// Size in bytes.
    pub(crate) bytes: u64,
    modified: (i64, i64),
    status_changed: (i64, i64),
}

impl FileState {
    /// Of an open file or a path, by its metadata.
    pub(crate) fn of(meta: &Metadata) -> Self {
        Self {
            inode: (meta.dev(), meta.ino()),
            bytes: meta.len(),
            modified: (meta.mtime(), meta.mtime_nsec()),
            status_changed: (meta.ctime(), meta.ctime_nsec()),
        }
    }

    /// Of the file at `path`; `None` if there is none.
    pub(crate) fn at(path: &Path) -> Option<Self> {
        std::fs::metadata(path).ok().map(|meta| Self::of(&meta))
    }
}
