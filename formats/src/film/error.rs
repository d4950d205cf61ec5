//! Errors of creating, opening and writing a film.

use std::path::PathBuf;

use pipeline::bounds::OutOfBounds;

use crate::durable::{DurableError, LockError};

/// A film cannot be created, opened or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FilmError {
    /// Something exists at the path.
    #[error(
        "creating film {path}: it already exists: to resume it, run the command that created it; to replace it, add --overwrite"
    )]
    Exists {
        /// The film.
        path: PathBuf,
    },
    /// Not a film of this program.
    #[error(
        "opening film {path}: found {found}, expected a film of this program (group attribute schema = \"lenscube/film/1\"); nothing was changed"
    )]
    NotFilm {
        /// The film.
        path: PathBuf,
        /// What was found.
        found: String,
    },
    /// The film's directory contains files that do not belong to the film.
    #[error(
        "removing film {path}: it contains files that do not belong to the film: {}; nothing was removed: move them elsewhere, or choose another path",
        .names.join(", ")
    )]
    Foreign {
        /// The film.
        path: PathBuf,
        /// The first few of them.
        names: Vec<String>,
    },
    /// Another job's film replaced it.
    #[error(
        "film {path}: another job's film has replaced it since this command opened it; nothing was written to the other film; \
         choose another path for one of the two"
    )]
    Replaced {
        /// The film.
        path: PathBuf,
    },
    /// Another run of the same job created it again.
    #[error(
        "film {path}: a run of the same job has created it again since this command opened it; run the same command again"
    )]
    Recreated {
        /// The film.
        path: PathBuf,
    },
    /// Another process holds the lock.
    #[error(transparent)]
    Locked(#[from] LockError),
    /// Inconsistent metadata.
    #[error(
        "opening film {path}: expected {expected}, which the file does not match; restore it from a backup, or create the film again with --overwrite"
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Its expected content.
        expected: &'static str,
    },
    /// An invalid layout.
    #[error("layout of the film: {what}: expected {expected}, found {found}")]
    Spec {
        /// Property.
        what: &'static str,
        /// Its expected value.
        expected: &'static str,
        /// Its found value.
        found: String,
    },
    /// Invalid group attributes.
    #[error(
        "opening film {path}: its attributes are invalid: {reason}; restore its zarr.json, or create the film again with --overwrite"
    )]
    Attributes {
        /// The film.
        path: PathBuf,
        /// The defect.
        reason: String,
    },
    /// A number of the layout outside its bounds.
    #[error("layout of the film: {0}")]
    Bounds(#[from] OutOfBounds),
    /// A value beyond the range of f16.
    #[error(
        "encoding {output}, band {band}, row {row}, column {column}: {value} does not fit float16 (at most 65504); write float32"
    )]
    Overflow {
        /// The array.
        output: String,
        /// Band.
        band: usize,
        /// Row of the film.
        row: i64,
        /// Column of the film.
        column: i64,
        /// The value.
        value: f32,
    },
    /// NaN or infinity.
    #[error(
        "encoding shard {shard}, band {band}: {value} at row {row}, column {column} of the film, so the shard is not written; the arithmetic overflowed: use smaller chart values or film units"
    )]
    NotFinite {
        /// Key of the shard.
        shard: String,
        /// Band.
        band: usize,
        /// Row of the film.
        row: i64,
        /// Column of the film.
        column: i64,
        /// The value.
        value: f32,
    },
    /// A shard outside the film, or pixels of another shard: an error of the caller.
    #[error(
        "encoding output {output}, band {band}, shard {shard:?}: expected {expected} pixels, found {found}"
    )]
    Request {
        /// Output.
        output: usize,
        /// Band.
        band: usize,
        /// Shard (row, column).
        shard: (usize, usize),
        /// Pixels of that shard; 0 if there is no such shard.
        expected: usize,
        /// Pixels given.
        found: usize,
    },
    /// A pyramid was requested of an incomplete film.
    #[error(
        "building the pyramid of {path}: {missing} of {shards} shards of the film are missing ({first} is the first); complete it by the same `lenscube run`, then make its pyramid"
    )]
    Incomplete {
        /// The film.
        path: PathBuf,
        /// Shards missing.
        missing: usize,
        /// Shards in total.
        shards: usize,
        /// Key of the first missing shard.
        first: String,
    },
    /// Pixels of a level, or of the film, cannot be read.
    #[error("building the pyramid: reading {array}, band {band}, {rect}: {reason}; see `lenscube verify`")]
    Level {
        /// The array.
        array: String,
        /// Band.
        band: usize,
        /// Its pixels.
        rect: pipeline::geometry::Rect,
        /// The defect.
        reason: String,
    },
    /// The film changed while its pyramid was made.
    #[error("building the pyramid of {path}: the film changed meanwhile; run the command again")]
    Changed {
        /// The film.
        path: PathBuf,
    },
    /// The codec failed.
    #[error("encoding the film: {reason}")]
    Codec {
        /// Its error.
        reason: String,
    },
    /// Error of the file system or object store.
    #[error("writing the film: {0}")]
    Storage(#[from] DurableError),
}

impl FilmError {
    /// Whether the disk is full.
    pub fn is_storage_full(&self) -> bool {
        matches!(self, Self::Storage(e) if e.is_storage_full())
    }

    /// Whether the same call may succeed later without a change by the user.
    pub fn retryable(&self) -> bool {
        match self {
            Self::Storage(e) => e.retryable(),
            Self::Locked(e) => e.retryable(),
            Self::Recreated { .. } => true,
            _ => false,
        }
    }
}
