//! Verification of a film: consistent metadata; every shard present, intact, and with finite pixels; the invented shares beside it.

use serde_json::Value;

use super::store::FilmStore;
use crate::group::{Finding, GroupError, VerifyReport, read_json};
use crate::parallel::Progress;

impl FilmStore {
    /// Checks the complete film on `threads` threads, each of which holds one shard; `progress` receives the numbers of shards done and
    /// in total.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if the store cannot be read. Defects of the film are findings, not errors.
    pub fn verify(&self, threads: usize, progress: Progress<'_>) -> Result<VerifyReport, GroupError> {
        let files = self.shard_files();
        let (bytes, of_shards) = self.group.check_files(&files, threads, progress)?;
        let (share_bytes, of_shares) = self.check_invented()?;
        let of_metadata = self.check_metadata()?;
        let (level_bytes, of_levels) = self.pyramid().check(threads)?;
        self.group.check_in_place()?;
        Ok(VerifyReport {
            shards: files.len(),
            bytes: bytes + share_bytes + level_bytes,
            findings: [of_metadata, of_shards, of_shares, of_levels].concat(),
            temp: self.group.store.temp_files()?,
        })
    }

    /// Removes a shard (of the film or its pyramid) that a check found to be bad, unless it is intact by now. Returns whether it did. With a bad chunk of
    /// the array `invented` the shard beside it is removed: a run writes both.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if it cannot be read or removed; as [`crate::group::JobGroup::check_in_place`].
    pub fn remove_bad(&self, key: &str) -> Result<bool, GroupError> {
        if let Some(removed) = self.remove_bad_invented(key)? {
            return Ok(removed);
        }
        let mut files = self.shard_files().into_iter().chain(self.pyramid().shard_files());
        files.find(|file| file.key == key).map_or(Ok(false), |file| self.group.remove_bad(&file))
    }

    /// Writes the values of a coordinate again if `key` is their file; whether it is.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if it cannot be written; as [`crate::group::JobGroup::check_in_place`].
    pub fn restore_coordinate(&self, key: &str) -> Result<bool, GroupError> {
        let coordinates = self.spec.coordinates();
        let Some((_, (_, bytes))) = coordinates.into_iter().find(|(name, _)| values_key(name) == key) else {
            return Ok(false);
        };
        self.group.commit(key, bytes.into()).map(|()| true)
    }

    /// Compares arrays, coordinates and consolidated metadata with the attributes.
    fn check_metadata(&self) -> Result<Vec<Finding>, GroupError> {
        let mut findings = Vec::new();
        let mut mismatch = |key: &str, reason: &str| {
            findings.push(Finding::Metadata { key: key.into(), reason: reason.into() });
        };
        let group = read_json(&self.group.store, "zarr.json")?.unwrap_or_default();
        let copies = &group["consolidated_metadata"]["metadata"];
        let mut check = |name: &str, expected: &Value| -> Result<(), GroupError> {
            let key = format!("{name}/zarr.json");
            if read_json(&self.group.store, &key)?.as_ref() != Some(expected) {
                mismatch(&key, "it differs from the metadata of this film's layout");
            }
            if copies.get(name) != Some(expected) {
                mismatch("zarr.json", &format!("its copy of {key} is missing or differs"));
            }
            Ok(())
        };
        for (name, metadata) in &self.spec.arrays() {
            check(name, metadata)?;
        }
        let coordinates = self.spec.coordinates();
        for (name, (metadata, _)) in &coordinates {
            check(name, metadata)?;
        }
        for (name, (_, bytes)) in &coordinates {
            let key = values_key(name);
            if self.group.store.read_at_most(&key, bytes.len() as u64).ok().flatten().as_ref() != Some(bytes)
            {
                mismatch(&key, "it differs from the coordinate of this film");
            }
        }
        Ok(findings)
    }
}

/// File of the values of a coordinate.
fn values_key(name: &str) -> String {
    format!("{name}/c/0")
}
