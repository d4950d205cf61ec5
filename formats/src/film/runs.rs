//! The directory `runs/` of a film: records and locks of runs.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::error::FilmError;
use super::store::{FilmStore, read_json};
use crate::durable::{Lock, LockOwner, Store};

impl FilmStore {
    /// Writes a file that does not belong to the film's arrays, such as `runs/….json`.
    ///
    /// # Errors
    /// As [`FilmStore::commit`].
    pub fn write_record(&self, key: &str, bytes: &[u8]) -> Result<(), FilmError> {
        self.check_in_place()?;
        self.report_replacement(self.store.write(key, bytes.to_vec()))
    }

    /// Acquires the lock of a unit of work on this film; see [`Lock`]. `None` if the store has no locks. If another film replaced this
    /// one meanwhile, its lock is released again.
    ///
    /// # Errors
    /// [`FilmError::Locked`] if another process holds it; as [`FilmStore::check_in_place`].
    pub fn lock(&self, unit: &str, take_over: bool) -> Result<Option<Lock>, FilmError> {
        self.check_in_place()?;
        let lock = self.store.lock("runs", unit, take_over);
        self.check_in_place()?;
        Ok(lock?)
    }

    /// The locks on the film at `path`, each with its owner and whether that process is dead (`None`: unknown).
    ///
    /// # Errors
    /// [`FilmError::Storage`] if they cannot be read.
    #[allow(clippy::type_complexity, reason = "as `locks`")]
    pub fn locks(path: &Path) -> Result<Vec<(PathBuf, Option<Box<LockOwner>>, Option<bool>)>, FilmError> {
        Ok(Store::at(path)?.locks("runs")?)
    }

    /// The records of runs, `runs/*.json`, oldest first; files that are no JSON objects are ignored.
    ///
    /// # Errors
    /// [`FilmError::Storage`] if the records cannot be read.
    pub fn runs(&self) -> Result<Vec<Map<String, Value>>, FilmError> {
        let mut runs = Vec::new();
        for name in self.store.names("runs")?.into_iter().filter(|n| n.ends_with(".json")) {
            if let Some(Value::Object(run)) = read_json(&self.store, &format!("runs/{name}"))? {
                runs.push(run);
            }
        }
        runs.sort_by_key(|r| r.get("finished_unix_s").and_then(Value::as_u64));
        Ok(runs)
    }
}
