//! Verification of a film: consistent metadata; every shard present, intact, and with finite pixels; the invented shares and layers beside it.

use super::store::FilmStore;
use crate::group::{GroupError, VerifyReport};
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
        let (layer_bytes, of_layers_of_light) = self.check_layers()?;
        let of_metadata = self.group.check_derived(&self.spec.derived())?;
        let is_intact = of_shards.is_empty() && of_metadata.is_empty();
        let (level_bytes, of_levels) = self.pyramid().check(threads, is_intact)?;
        self.group.check_in_place()?;
        Ok(VerifyReport {
            shards: files.len(),
            bytes: bytes + share_bytes + layer_bytes + level_bytes,
            findings: [of_metadata, of_shards, of_shares, of_layers_of_light, of_levels].concat(),
            temp: self.group.store.temp_files()?,
        })
    }

    /// Removes a shard (of the film or its pyramid) that a check found to be bad, unless it is intact by now. Returns whether it did. With a bad chunk of
    /// the array `invented` the shard beside it is removed: a run writes both; with a bad chunk of a layer all shards of its band.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if it cannot be read or removed; as [`crate::group::JobGroup::check_in_place`].
    pub fn remove_bad(&self, key: &str) -> Result<bool, GroupError> {
        if let Some(removed) = self.remove_bad_invented(key)? {
            return Ok(removed);
        }
        if let Some(removed) = self.remove_bad_layer(key)? {
            return Ok(removed);
        }
        let mut files = self.shard_files().into_iter().chain(self.pyramid().shard_files());
        files.find(|file| file.key == key).map_or(Ok(false), |file| self.group.remove_bad(&file))
    }

    /// Writes metadata or values of a coordinate again if `key` is a file that follows from the attributes, of the film or its pyramid; whether
    /// it does.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if it cannot be written; as [`crate::group::JobGroup::check_in_place`].
    pub fn restore(&self, key: &str) -> Result<bool, GroupError> {
        let of_film = self.group.restore_derived(key, &self.spec.derived())?;
        Ok(self.pyramid().restore(key)? || of_film)
    }
}
