//! The engines that computed a film: the one that it was created with, in its attributes, and others.
//!
//! Another engine is marked by an empty file `runs/NAME.engine`, written before its first shard, so the mark exists however the run
//! ends. `runs/` does not belong to the film's arrays and metadata.

use serde_json::Value;

use super::store::FilmStore;
use crate::group::{ENGINE_EXTENSION, GroupError};

impl FilmStore {
    /// The engine that the film was created with; `None` if not recorded.
    pub fn engine(&self) -> Option<&str> {
        self.provenance().get("engine").and_then(Value::as_str)
    }

    /// All engines that may have computed shards of the film, that of [`FilmStore::engine`] first (`unknown` if not recorded).
    ///
    /// # Errors
    /// [`GroupError::Storage`] if the store cannot be read.
    pub fn engines(&self) -> Result<Vec<String>, GroupError> {
        let first = self.engine().unwrap_or("unknown").to_owned();
        let names = self.group.store.names("runs")?;
        let mut others: Vec<String> =
            names.iter().filter_map(|name| name.strip_suffix(ENGINE_EXTENSION)).map(str::to_owned).collect();
        others.retain(|name| *name != first);
        others.sort();
        Ok([vec![first], others].concat())
    }

    /// Records that an engine other than [`FilmStore::engine`] computes shards.
    ///
    /// # Errors
    /// [`GroupError::Storage`].
    pub fn mark_engine(&self, engine: &str) -> Result<(), GroupError> {
        self.group.write_record(&format!("runs/{engine}{ENGINE_EXTENSION}"), b"")
    }
}
