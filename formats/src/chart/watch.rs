//! Whether a file of a chart is still what it was when the chart was opened.
//!
//! A mapping stays on the file that was opened: a file put in its place by rename shows in the inode behind the path only, one
//! rewritten within the file system's clock step in the time of its last status change.

use std::fs::{File, Metadata};
use std::io::Read;
use std::path::{Path, PathBuf};

use super::ChartError;
use crate::durable::{DurableError, FileState};

/// A file and its state at opening.
#[derive(Debug)]
pub(super) struct Watched {
    path: PathBuf,
    state: State,
}

#[derive(Debug, PartialEq)]
enum State {
    /// Of data, which are too many to be read twice.
    Data(FileState),
    /// Of a header: a digest of its first bytes.
    Header { limit: u64, digest: blake3::Hash },
}

impl Watched {
    /// A data file, by the metadata of the open file.
    pub(super) fn data(path: &Path, meta: &Metadata) -> Self {
        Self { path: path.into(), state: State::Data(FileState::of(meta)) }
    }

    /// A header, of whose first `limit` bytes `text` was read.
    pub(super) fn header(path: &Path, limit: u64, text: &[u8]) -> Self {
        Self { path: path.into(), state: State::Header { limit, digest: blake3::hash(text) } }
    }

    /// Whether the path still leads to the file in that state.
    ///
    /// # Errors
    /// [`ChartError::Changed`] if it does not; [`ChartError::Io`] if that cannot be found out.
    pub(super) fn unchanged(&self) -> Result<(), ChartError> {
        let changed = |what| Err(ChartError::Changed { path: self.path.clone(), what });
        let failed = |e: std::io::Error| DurableError::io("look up", &self.path, 0, e);
        match &self.state {
            State::Data(then) => {
                let now = match std::fs::metadata(&self.path) {
                    Err(e) if e.kind() == std::io::ErrorKind::NotFound => return changed("it was removed"),
                    other => FileState::of(&other.map_err(failed)?),
                };
                match () {
                    () if now == *then => Ok(()),
                    () if now.inode != then.inode => changed("another file has taken its place"),
                    () if now.bytes != then.bytes => changed("it has another size"),
                    () => changed("it was written to, or its status changed"),
                }
            }
            State::Header { limit, digest } => {
                let mut text = Vec::new();
                match File::open(&self.path) {
                    Err(e) if e.kind() == std::io::ErrorKind::NotFound => return changed("it was removed"),
                    file => file.map_err(failed)?.take(*limit).read_to_end(&mut text).map_err(failed)?,
                };
                if blake3::hash(&text) == *digest { Ok(()) } else { changed("it has other words") }
            }
        }
    }
}
