//! State of a file by its metadata, which changes when the file is written, replaced or touched.
//!
//! A program cannot set the time of the last status change (ctime), so equal states mean equal bytes, to the resolution of the
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
    /// State by the metadata of an open file or a path.
    pub(crate) fn from_metadata(meta: &Metadata) -> Self {
        Self {
            inode: (meta.dev(), meta.ino()),
            bytes: meta.len(),
            modified: (meta.mtime(), meta.mtime_nsec()),
            status_changed: (meta.ctime(), meta.ctime_nsec()),
        }
    }

    /// Time of the last change of content or status, s since 1970.
    pub(crate) fn changed_s(&self) -> i64 {
        self.modified.0.max(self.status_changed.0)
    }

    /// State of the file at `path`; `None` if there is none.
    pub(crate) fn from_path(path: &Path) -> Option<Self> {
        std::fs::metadata(path).ok().map(|meta| Self::from_metadata(&meta))
    }
}
