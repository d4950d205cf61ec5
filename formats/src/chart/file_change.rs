//! Detection of files that change while a chart is in use.
//!
//! Flat files ([`WatchedFile`]): the complete [`FileState`] of a data file, a digest of a header. A memory mapping stays on the file
//! that was opened; replacement of the file by a rename changes the inode at the path only, and a rewrite within the clock step of
//! the file system only the time of last status change.
//!
//! Chunks of a Zarr array in a directory ([`ChunkFileStates`]): size and modification time, as listed for the chart's identity and
//! compared after each read. So a killed run leaves no shard computed from a file that changed after that, and the film can be
//! resumed once the chart is restored. Objects are replaced as one, and their ETags are compared at the end of a run.
//!
//! A write through a memory mapping to a page that the system has not yet written back changes no time: `content` compares the bytes.

use std::collections::HashMap;
use std::fs::{File, Metadata};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{Error, Read};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde_json::{Value, json};

use super::error::ChartError;
use crate::durable::{DurableError, FileState};

/// Time of last modification in ns since 1970, negative before.
pub(super) fn modified_ns(meta: &Metadata) -> i128 {
    i128::from(meta.mtime()) * 1_000_000_000 + i128::from(meta.mtime_nsec())
}

/// [`modified_ns`] for a chart's identity.
pub(super) fn modified_json(meta: &Metadata) -> Value {
    let ns = modified_ns(meta);
    if ns < 0 { json!(ns as i64) } else { json!(ns as u64) }
}

fn look_up_error(path: &Path, e: Error) -> DurableError {
    DurableError::io("look up", path, 0, e)
}

/// A file and its state when the chart was opened.
#[derive(Debug)]
pub(super) struct WatchedFile {
    path: PathBuf,
    state: State,
}

#[derive(Debug)]
enum State {
    /// Of a data file, too large to be read twice.
    Data(FileState),
    /// Digest of the first `limit` bytes of a header.
    Header { limit: u64, digest: blake3::Hash },
}

impl WatchedFile {
    /// A data file, by the metadata of the open file.
    pub(super) fn data(path: &Path, meta: &Metadata) -> Self {
        Self { path: path.into(), state: State::Data(FileState::from_metadata(meta)) }
    }

    /// A header file, of whose first `limit` bytes `text` was read.
    pub(super) fn header(path: &Path, limit: u64, text: &[u8]) -> Self {
        Self { path: path.into(), state: State::Header { limit, digest: blake3::hash(text) } }
    }

    /// Path of a data file; `None` for a header.
    pub(super) fn data_path(&self) -> Option<&Path> {
        matches!(self.state, State::Data(_)).then_some(&*self.path)
    }

    /// State of a data file when the chart was opened; `None` for a header.
    pub(super) fn data_state(&self) -> Option<FileState> {
        match self.state {
            State::Data(state) => Some(state),
            State::Header { .. } => None,
        }
    }

    /// Checks that the path still leads to the same file in the same state.
    ///
    /// # Errors
    /// [`ChartError::Changed`] if it does not; [`ChartError::Io`] if that cannot be determined.
    pub(super) fn check_unchanged(&self) -> Result<(), ChartError> {
        let changed = |what| Err(ChartError::Changed { path: self.path.clone(), what });
        let is_removed = |e: &Error| e.kind() == std::io::ErrorKind::NotFound;
        let failed = |e| look_up_error(&self.path, e);
        match &self.state {
            State::Data(then) => {
                let now = match std::fs::metadata(&self.path) {
                    Err(e) if is_removed(&e) => return changed("it was removed"),
                    meta => FileState::from_metadata(&meta.map_err(failed)?),
                };
                match () {
                    () if now == *then => Ok(()),
                    () if now.inode != then.inode => changed("it was replaced by another file"),
                    () if now.bytes != then.bytes => changed("its size changed"),
                    () => changed("it was written to, or its status changed"),
                }
            }
            State::Header { limit, digest } => {
                let mut text = Vec::new();
                match File::open(&self.path) {
                    Err(e) if is_removed(&e) => return changed("it was removed"),
                    file => file.map_err(failed)?.take(*limit).read_to_end(&mut text).map_err(failed)?,
                };
                if blake3::hash(&text) == *digest { Ok(()) } else { changed("its text changed") }
            }
        }
    }
}

/// A file with pixels of a Zarr array, or such an object.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct ChunkFile {
    /// Key relative to the array.
    pub(super) key: String,
    /// Size in bytes.
    pub(super) bytes: u64,
    /// Modification time in ns since 1970, or ETag.
    pub(super) version: String,
}

/// Sizes and modification times of the chunk files of an array; by hashes, since there may be millions of files.
#[derive(Debug, Default)]
pub(super) struct ChunkFileStates(OnceLock<HashMap<u64, ChunkFileState>>);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct ChunkFileState {
    bytes: u64,
    version: u64,
}

fn hash(value: impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    value.hash(&mut hasher);
    hasher.finish()
}

impl ChunkFileStates {
    /// Records the states of `files`. Only the first call has an effect.
    pub(super) fn record(&self, files: &[ChunkFile]) {
        let state =
            |f: &ChunkFile| (hash(&f.key), ChunkFileState { bytes: f.bytes, version: hash(&f.version) });
        self.0.get_or_init(|| files.iter().map(state).collect());
    }

    /// Checks that the file of `key`, at `path`, is in the recorded state, or still absent. Succeeds if no states were recorded.
    ///
    /// # Errors
    /// [`ChartError::Changed`] if it is not; [`ChartError::Io`] if that cannot be determined.
    pub(super) fn check_unchanged(&self, key: &str, path: &Path) -> Result<(), ChartError> {
        let Some(recorded) = self.0.get() else { return Ok(()) };
        let now = match std::fs::metadata(path) {
            Ok(meta) => {
                Some(ChunkFileState { bytes: meta.len(), version: hash(modified_ns(&meta).to_string()) })
            }
            Err(e) if crate::durable::is_not_found(&e) => None,
            Err(e) => return Err(look_up_error(path, e).into()),
        };
        let what = match (recorded.get(&hash(key)), now) {
            (Some(then), Some(now)) if *then == now => return Ok(()),
            (None, None) => return Ok(()),
            (Some(_), None) => "it was removed",
            (None, Some(_)) => "it was added",
            (Some(then), Some(now)) if then.bytes != now.bytes => "its size changed",
            _ => "it was written to",
        };
        Err(ChartError::Changed { path: path.into(), what })
    }
}
