//! Errors of creating, opening and writing raws.

use std::path::PathBuf;

use crate::durable::{DurableError, LockError};

/// A raw cannot be made, opened or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RawError {
    /// The path exists.
    #[error("creating raw {}: it already exists; choose another path, resume it, or --overwrite a raw of this program", .path.display())]
    Exists {
        /// The raw.
        path: PathBuf,
    },
    /// Not a raw of this program.
    #[error(
        "opening raw {}: found {found}, expected a raw of this program (group attribute schema = \"lenscube/raw/1\"); nothing was changed",
        .path.display()
    )]
    NotRaw {
        /// The raw.
        path: PathBuf,
        /// What was found there.
        found: String,
    },
    /// The raw's directory contains other files than the raw's.
    #[error(
        "removing raw {}: it contains files that are not the raw's: {}; nothing was removed: move them away, or choose another path",
        .path.display(), .names.join(", ")
    )]
    Foreign {
        /// The raw.
        path: PathBuf,
        /// Paths in the raw, the first few.
        names: Vec<String>,
    },
    /// Another run replaced it by a raw of another job.
    #[error(
        "raw {}: another job's raw has replaced it since this command opened it; nothing was written into the new one; choose another path \
         for one of the two", .path.display()
    )]
    Replaced {
        /// The raw.
        path: PathBuf,
    },
    /// Another run of the same job replaced the raw.
    #[error("raw {}: a run of the same job has replaced it since this command opened it; run the same command again", .path.display())]
    Recreated {
        /// The raw.
        path: PathBuf,
    },
    /// Another process holds the lock.
    #[error(transparent)]
    Locked(#[from] LockError),
    /// Metadata that do not fit together.
    #[error(
        "opening raw {}: expected the metadata of a raw's layout, found something else; restore the file, or replace the raw with --overwrite",
        .path.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
    },
    /// Shards of the raw are missing.
    #[error(
        "raw {}: {missing} of {shards} shards are missing, {first} first; the same `lenscube sensor` makes them",
        .path.display()
    )]
    Incomplete {
        /// The raw.
        path: PathBuf,
        /// Shards missing.
        missing: usize,
        /// Shards in total.
        shards: usize,
        /// Key of the first missing shard.
        first: String,
    },
    /// Pixels of a level, or of the raw, cannot be read.
    #[error("making the pyramid: reading {array}: {reason}; see `lenscube verify`")]
    Level {
        /// The array.
        array: String,
        /// What is wrong.
        reason: String,
    },
    /// The raw changed while its pyramid was made.
    #[error("raw {}: it changed while its pyramid was made; run the same command again", .path.display())]
    Changed {
        /// The raw.
        path: PathBuf,
    },
    /// The codec failed.
    #[error("encoding the raw: {reason}")]
    Codec {
        /// Its message.
        reason: String,
    },
    /// The files.
    #[error("writing the raw: {0}")]
    Storage(#[from] DurableError),
}

impl RawError {
    /// Whether the same call may succeed later.
    pub fn retryable(&self) -> bool {
        match self {
            Self::Storage(e) => e.retryable(),
            Self::Locked(e) => e.retryable(),
            Self::Recreated { .. } | Self::Changed { .. } => true,
            _ => false,
        }
    }
}
