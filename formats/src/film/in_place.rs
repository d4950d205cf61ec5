//! Whether an opened film is still the one at its path.

use serde_json::{Map, Value};

use super::error::FilmError;
use super::store::{FilmStore, read_json};
use crate::durable::{DurableError, Store};

impl FilmStore {
    /// Replaces the error of a failed write by that of [`FilmStore::check_in_place`], if the film was removed or replaced.
    pub(super) fn report_replacement<T>(&self, written: Result<T, DurableError>) -> Result<T, FilmError> {
        written.map_err(|e| self.check_in_place().err().unwrap_or(e.into()))
    }

    /// Checks that this film is still at its path: shards must not be written without metadata where a film was removed or unmounted,
    /// nor to the film of another job.
    ///
    /// # Errors
    /// [`FilmError::Replaced`], [`FilmError::Recreated`]; [`DurableError::StoreMissing`] if there is no film at the path;
    /// [`FilmError::Storage`] if the store cannot be read.
    pub fn check_in_place(&self) -> Result<(), FilmError> {
        let in_place = self.store.is_in_place()?;
        let found = match in_place {
            true => read_json(&self.store, "zarr.json")?,
            false => read_json(&Store::at(self.path())?, "zarr.json")?,
        };
        let path = || self.path().into();
        match found {
            None => Err(DurableError::StoreMissing { path: path(), missing: "zarr.json".into() }.into()),
            Some(group)
                if identity(group["attributes"]["provenance"].as_object())
                    != identity(Some(&self.provenance)) =>
            {
                Err(FilmError::Replaced { path: path() })
            }
            Some(_) if in_place => Ok(()),
            Some(_) => Err(FilmError::Recreated { path: path() }),
        }
    }
}

/// The digests that identify a film: of its job and of the layout of its files.
fn identity(provenance: Option<&Map<String, Value>>) -> [Option<&Value>; 2] {
    ["job_digest", "layout_digest"].map(|key| provenance?.get(key))
}
