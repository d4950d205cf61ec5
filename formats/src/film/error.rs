//! Why a film cannot be made, opened or written.

use std::path::PathBuf;

use pipeline::bounds::OutOfBounds;

use crate::durable::{DurableError, LockError};

/// A film cannot be made, opened or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FilmError {
    /// Something lies where the film is to be.
    #[error(
        "creating film {path}: it exists already; choose another path, resume it, or --overwrite a film of this program"
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
        /// What lies there.
        found: String,
    },
    /// The film's directory holds what the film did not make.
    #[error(
        "removing film {path}: it holds what the film did not make: {}; nothing was removed: move that away, or choose another path",
        .names.join(", ")
    )]
    Foreign {
        /// The film.
        path: PathBuf,
        /// Paths in the film, the first few.
        names: Vec<String>,
    },
    /// Another run began another film in its place.
    #[error(
        "film {path}: another job's film has replaced it since this command opened it; nothing was written into that one; \
         choose another path for one of the two"
    )]
    Replaced {
        /// The film.
        path: PathBuf,
    },
    /// Another run of the same job began the film anew.
    #[error(
        "film {path}: a run of the same job has begun it anew since this command opened it; run the same command again"
    )]
    Renewed {
        /// The film.
        path: PathBuf,
    },
    /// Another process holds the lock.
    #[error(transparent)]
    Locked(#[from] LockError),
    /// Metadata that do not fit together.
    #[error(
        "opening film {path}: expected {expected}, found something else; restore the file, or make the film anew with --overwrite"
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What it must hold.
        expected: &'static str,
    },
    /// A film that cannot be.
    #[error("laying out the film: {what}: expected {expected}, found {found}")]
    Spec {
        /// Which property.
        what: &'static str,
        /// What it must be.
        expected: &'static str,
        /// What it is.
        found: String,
    },
    /// Attributes that no film has.
    #[error(
        "opening film {path}: its attributes cannot be: {reason}; restore its zarr.json, or make the film anew with --overwrite"
    )]
    Attributes {
        /// The film.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A number of the film beyond its bounds.
    #[error("laying out the film: {0}")]
    Bounds(#[from] OutOfBounds),
    /// A value too large for f16.
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
    /// A value that is no number.
    #[error(
        "encoding shard {shard}, band {band}: {value} at row {row}, column {column} of the film, so the shard is not written; the arithmetic overflowed: use smaller chart values or film units"
    )]
    NotFinite {
        /// Its path in the film.
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
    /// A shard that is not in the film, or pixels of another shard; the caller's fault.
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
    /// A pyramid is asked of a film that is not all there.
    #[error(
        "making the pyramid of {path}: {missing} of {shards} shards of the film are missing ({first} is the first); finish it by the same `lenscube run`, then make its pyramid"
    )]
    Incomplete {
        /// The film.
        path: PathBuf,
        /// Shards missing.
        missing: usize,
        /// Shards that it must have.
        shards: usize,
        /// The first that is missing.
        first: String,
    },
    /// Pixels that a pyramid is to be made of cannot be read.
    #[error(
        "making the pyramid: reading {array}, band {band}, {rect}: {reason}; `lenscube verify` tells more"
    )]
    Level {
        /// The array.
        array: String,
        /// Band.
        band: usize,
        /// Its pixels.
        rect: pipeline::geometry::Rect,
        /// What is wrong.
        reason: String,
    },
    /// The film changed while its pyramid was made.
    #[error("making the pyramid of {path}: the film changed meanwhile; make it again")]
    Changed {
        /// The film.
        path: PathBuf,
    },
    /// The codec refuses.
    #[error("encoding the film: {reason}")]
    Codec {
        /// In its words.
        reason: String,
    },
    /// The files.
    #[error("writing the film: {0}")]
    Storage(#[from] DurableError),
}

impl FilmError {
    /// Whether the disk is full.
    pub fn is_storage_full(&self) -> bool {
        matches!(self, Self::Storage(e) if e.is_storage_full())
    }

    /// Whether the same call may succeed a moment later with nobody's help.
    pub fn retryable(&self) -> bool {
        match self {
            Self::Storage(e) => e.retryable(),
            Self::Locked(e) => e.retryable(),
            Self::Renewed { .. } => true,
            _ => false,
        }
    }
}
