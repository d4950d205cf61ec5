//! Steps of an operation on a file: the verb in its error message, and its name for fault injection.

/// One step of a durable operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FileStep {
    /// Create the temporary file.
    Create,
    /// Write the bytes into it.
    Write,
    /// Flush them to the disk.
    Sync,
    /// Rename the file to its final name.
    Rename,
    /// Flush the directory.
    SyncDirectory,
    /// Remove a file.
    Remove,
    /// Read a file, or a part of it.
    Read,
    /// Rename a new directory to its final name.
    Publish,
    /// Remove a temporary file of an ended process.
    Sweep,
}

impl FileStep {
    /// Verb for error messages.
    pub(super) const fn verb(self) -> &'static str {
        match self {
            Self::Create => "create",
            Self::Write => "write",
            Self::Sync => "flush",
            Self::Rename | Self::Publish => "rename to",
            Self::SyncDirectory => "flush directory",
            Self::Remove | Self::Sweep => "remove",
            Self::Read => "read",
        }
    }

    /// Name in `LENSCUBE_FAULT`.
    #[cfg(debug_assertions)]
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Create => "create",
            Self::Write => "write",
            Self::Sync => "sync",
            Self::Rename => "rename",
            Self::SyncDirectory => "sync-directory",
            Self::Remove => "remove",
            Self::Read => "read",
            Self::Publish => "publish",
            Self::Sweep => "sweep",
        }
    }
}
