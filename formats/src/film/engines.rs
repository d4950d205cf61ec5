//! Which engines computed a film: its own, in its attributes, and others that were marked before their first shard.
//!
//! A mark is an empty file `runs/NAME.engine` (`runs/` is no part of the film's arrays and metadata): it is there before any shard
//! of that engine, whatever ends the run.

use super::{FilmError, FilmStore};
use serde_json::Value;

const ENDING: &str = ".engine";

impl FilmStore {
    /// The engine that the film was begun with; none if it does not say.
    pub fn engine(&self) -> Option<&str> {
        self.provenance().get("engine").and_then(Value::as_str)
    }

    /// All engines that may have computed shards of it, the film's own first (`unknown` if it does not say).
    ///
    /// # Errors
    /// [`FilmError::Storage`] if the store does not answer.
    pub fn engines(&self) -> Result<Vec<String>, FilmError> {
        let own = self.engine().unwrap_or("unknown").to_owned();
        let names = self.store.names("runs")?;
        let mut others: Vec<String> =
            names.iter().filter_map(|name| name.strip_suffix(ENDING)).map(str::to_owned).collect();
        others.retain(|name| *name != own);
        others.sort();
        Ok([vec![own], others].concat())
    }

    /// Marks that another engine than the film's own computes shards of it.
    ///
    /// # Errors
    /// [`FilmError::Storage`].
    pub fn mark_engine(&self, engine: &str) -> Result<(), FilmError> {
        self.write_beside(&format!("runs/{engine}{ENDING}"), b"")
    }
}
