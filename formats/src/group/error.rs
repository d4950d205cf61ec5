//! Errors of creating, opening and writing films and raws.

use std::fmt;
use std::path::PathBuf;

use pipeline::bounds::OutOfBounds;

use super::kind::GroupKind;
use crate::durable::{DurableError, LockError};

/// What is found instead of a film or raw.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Found {
    /// Nothing.
    Nothing,
    /// Files without readable metadata of a group.
    Unreadable,
    /// A group of another schema.
    Schema(String),
    /// A Zarr node of another program.
    OtherProgram,
}

impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => f.write_str("nothing"),
            Self::Unreadable => f.write_str("no readable zarr.json"),
            Self::Schema(schema) => write!(f, "schema {schema:?}"),
            Self::OtherProgram => f.write_str("a Zarr node of another program"),
        }
    }
}

/// A film or raw cannot be created, opened or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GroupError {
    /// Something exists at the path.
    #[error(
        "creating {kind} {path}: it already exists: to resume it, run the command that created it; to replace it, add --overwrite"
    )]
    Exists {
        /// Kind.
        kind: GroupKind,
        /// Its path.
        path: PathBuf,
    },
    /// Not a group of this kind.
    #[error(
        "opening {kind} {path}: found {found}, expected a {kind} of this program (group attribute schema = {:?}); nothing was changed",
        .kind.schema()
    )]
    NotOfKind {
        /// Kind.
        kind: GroupKind,
        /// Its path.
        path: PathBuf,
        /// What was found.
        found: Found,
    },
    /// The directory contains files that do not belong to the group.
    #[error(
        "removing {kind} {path}: it contains files that do not belong to the {kind}: {}; nothing was removed: move them elsewhere, or choose another path",
        .names.join(", ")
    )]
    Foreign {
        /// Kind.
        kind: GroupKind,
        /// Its path.
        path: PathBuf,
        /// The first few of them.
        names: Vec<String>,
    },
    /// Another job's group replaced it.
    #[error(
        "{kind} {path}: another job's {kind} has replaced it since this command opened it; nothing was written to the other {kind}; \
         choose another path for one of the two"
    )]
    Replaced {
        /// Kind.
        kind: GroupKind,
        /// Its path.
        path: PathBuf,
    },
    /// Another run of the same job created it again.
    #[error(
        "{kind} {path}: a run of the same job has created it again since this command opened it; run the same command again"
    )]
    Recreated {
        /// Kind.
        kind: GroupKind,
        /// Its path.
        path: PathBuf,
    },
    /// Another process holds the lock.
    #[error(transparent)]
    Locked(#[from] LockError),
    /// Inconsistent metadata.
    #[error(
        "opening {kind} {path}: expected {expected}, which the file does not match; restore it from a backup, or create the {kind} again with --overwrite"
    )]
    Damaged {
        /// Kind.
        kind: GroupKind,
        /// The file.
        path: PathBuf,
        /// Its expected content.
        expected: &'static str,
    },
    /// Metadata of an array that differ from those of the attributes.
    #[error(
        "opening {kind} {path}: {key} is missing or is not the metadata of its layout; `lenscube verify {path} --repair` writes it again",
        path = .path.display()
    )]
    ArrayMetadata {
        /// Kind.
        kind: GroupKind,
        /// Its path.
        path: PathBuf,
        /// The file.
        key: String,
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
    /// A pyramid was requested of an incomplete group.
    #[error(
        "building the pyramid of {path}: {missing} of {shards} shards of the {kind} are missing ({first} is the first); \
         complete it by the same `lenscube {}`, then make its pyramid",
        .kind.command()
    )]
    Incomplete {
        /// Kind.
        kind: GroupKind,
        /// Its path.
        path: PathBuf,
        /// Shards missing.
        missing: usize,
        /// Shards in total.
        shards: usize,
        /// Key of the first missing shard.
        first: String,
    },
    /// Pixels of a level, or of the film or raw, cannot be read.
    #[error("building the pyramid: reading {place}: {reason}; see `lenscube verify`")]
    Level {
        /// Array, and where in it.
        place: String,
        /// The defect.
        reason: String,
    },
    /// The group changed while its pyramid was made.
    #[error("building the pyramid of {path}: the {kind} changed meanwhile; run the command again")]
    Changed {
        /// Kind.
        kind: GroupKind,
        /// Its path.
        path: PathBuf,
    },
    /// A stored layer of light is damaged.
    #[error(
        "reading {key} of {film}: {reason}; `lenscube verify {film} --repair` removes it with the shards of its band",
        film = .film.display()
    )]
    Layer {
        /// The film.
        film: PathBuf,
        /// Key of the chunk.
        key: String,
        /// The defect.
        reason: String,
    },
    /// The codec failed.
    #[error("encoding a shard: {reason}")]
    Codec {
        /// Its error.
        reason: String,
    },
    /// Error of the file system or object store.
    #[error(transparent)]
    Storage(#[from] DurableError),
}

impl GroupError {
    /// Whether the disk is full.
    pub fn is_storage_full(&self) -> bool {
        matches!(self, Self::Storage(e) if e.is_storage_full())
    }

    /// Whether the same call may succeed later without a change by the user.
    pub fn retryable(&self) -> bool {
        match self {
            Self::Storage(e) => e.retryable(),
            Self::Locked(e) => e.retryable(),
            Self::Recreated { .. } | Self::Changed { .. } => true,
            _ => false,
        }
    }
}
