//! Verification of a film: consistent metadata; every shard present, intact, and with finite pixels.

use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use pipeline::geometry::{Rect, Size};
use serde_json::Value;

use super::error::FilmError;
use super::store::{FilmStore, read_json};
use crate::durable::{DurableError, Store, fault_point, temp_name};
use crate::parallel;
use crate::shard::ShardDefect;

/// A defect of a film.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Finding {
    /// A missing shard.
    Missing {
        /// Its key.
        key: String,
    },
    /// A shard that cannot be read because of an error of the system; it may be intact.
    Unreadable {
        /// Its key.
        key: String,
        /// The error.
        reason: String,
    },
    /// A shard that does not decode, or has a NaN or infinite pixel.
    Bad {
        /// Its key.
        key: String,
        /// The defect.
        reason: String,
    },
    /// Metadata or coordinates that contradict the film's attributes.
    Metadata {
        /// The file.
        key: String,
        /// The defect.
        reason: String,
    },
}

/// Result of [`FilmStore::verify`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct VerifyReport {
    /// Shards that the film must have.
    pub shards: usize,
    /// Bytes of shards read.
    pub bytes: u64,
    /// Defects, in the order of the shards.
    pub findings: Vec<Finding>,
    /// Temporary files, and whether the process that wrote them has ended (`None`: unknown).
    pub temp: Vec<(PathBuf, Option<bool>)>,
}

impl FilmStore {
    /// Checks the complete film on `threads` threads, each of which holds one shard; `progress` receives the numbers of shards done and
    /// in total.
    ///
    /// # Errors
    /// [`FilmError::Storage`] if the store cannot be read. Defects of the film are findings, not errors.
    pub fn verify(
        &self,
        threads: usize,
        progress: &(dyn Fn(u64, u64) + Sync),
    ) -> Result<VerifyReport, FilmError> {
        let all: Vec<_> = self.all_shards().collect();
        let (bytes, found) = (AtomicU64::new(0), Mutex::new(Vec::new()));
        parallel::for_each::<FilmError>(threads, all.len(), progress, |n| {
            let (output, band, shard) = all[n];
            let (read, finding) = self.check_shard(output, band, shard)?;
            bytes.fetch_add(read, Relaxed);
            found.lock().expect("no panic while held").extend(finding.map(|f| (n, f)));
            Ok(())
        })?;
        let mut found = found.into_inner().expect("no panic while held");
        found.sort_by_key(|f| f.0);
        let mut findings = self.check_metadata()?;
        findings.extend(found.into_iter().map(|f| f.1));
        let (level_bytes, level_findings) = self.check_pyramid()?;
        findings.extend(level_findings);
        let bytes = bytes.into_inner() + level_bytes;
        self.check_in_place()?;
        Ok(VerifyReport { shards: all.len(), bytes, findings, temp: self.store.temp_files()? })
    }

    /// Removes a shard (of the film or its pyramid) that a check found to be bad, and returns whether it did: another process may have
    /// replaced it by an intact one since. No lock prevents that, so a file is renamed, checked again under its new name, which no
    /// writer uses, and removed only then; an intact one is renamed back. An object cannot be renamed: it is checked again and
    /// removed, and one that is put in between is lost and computed again by the next run.
    ///
    /// # Errors
    /// [`FilmError::Storage`] if it cannot be read or removed; as [`FilmStore::check_in_place`].
    pub fn remove_bad(&self, key: &str) -> Result<bool, FilmError> {
        let Some((shape, rect)) = self.shard_of_key(key) else { return Ok(false) };
        self.check_in_place()?;
        let Store::Directory(directory) = &self.store else {
            let (_, finding) = self.check_file(key.to_owned(), shape, rect)?;
            let bad = matches!(finding, Some(Finding::Bad { .. }));
            return if bad { Ok(self.store.remove(key).map(|()| true)?) } else { Ok(false) };
        };
        let aside = match key.rsplit_once('/') {
            Some((parent, _)) => format!("{parent}/{}", temp_name()),
            None => temp_name(),
        };
        if !directory.rename(key, &aside)? {
            return Ok(false);
        }
        fault_point("shard-aside");
        let (_, finding) = self.check_file(aside.clone(), shape, rect)?;
        let bad = matches!(finding, Some(Finding::Bad { .. }));
        if !bad && directory.size_of(key)?.is_none() {
            directory.rename(&aside, key)?;
        } else {
            // Either bad, or an intact copy already exists.
            directory.remove(&aside)?;
        }
        Ok(bad)
    }

    /// Shape and pixels of the shard `key`, of the film or of its pyramid.
    fn shard_of_key(&self, key: &str) -> Option<(Size, Rect)> {
        let of_film = self.all_shards().find(|&(o, b, s)| self.key(o, b, s) == key);
        let of_film = of_film.map(|(o, _, s)| (self.spec.shard_grid(o).shard, self.shard_rect(o, s)));
        of_film.or_else(|| self.level_shard_of_key(key))
    }

    /// Reads and decodes one shard: its size in bytes, and its defect.
    pub(super) fn check_shard(
        &self,
        output: usize,
        band: usize,
        shard: (usize, usize),
    ) -> Result<(u64, Option<Finding>), FilmError> {
        let key = self.key(output, band, shard);
        self.check_file(key, self.spec.shard_grid(output).shard, self.shard_rect(output, shard))
    }

    /// As [`FilmStore::check_shard`], for the file `key` with the pixels of `rect`, in a shard of shape `shard`.
    pub(super) fn check_file(
        &self,
        key: String,
        shard: Size,
        rect: Rect,
    ) -> Result<(u64, Option<Finding>), FilmError> {
        // Codecs lengthen incompressible data slightly; a longer file is not read.
        let limit = (shard.pixels() * self.spec.sample.bytes()) as u64 * 2 + (1 << 20);
        let bytes = match self.store.read_at_most(&key, limit) {
            Ok(Some(bytes)) => bytes,
            Ok(None) => {
                self.check_in_place()?;
                return Ok((0, Some(Finding::Missing { key })));
            }
            Err(e @ DurableError::Length { .. }) => {
                return Ok((0, Some(Finding::Bad { key, reason: e.to_string() })));
            }
            Err(e) if e.is_device_error() || !e.retryable() => {
                return Ok((0, Some(Finding::Unreadable { key, reason: e.to_string() })));
            }
            Err(e) => return Err(e.into()),
        };
        let chunks = self.spec.chunks_of(shard);
        let defect = self.encoder.check(&bytes, (rect.height, rect.width), chunks).err();
        let finding = defect.map(|defect| {
            let reason = match defect {
                ShardDefect::Damaged(reason) => reason,
                ShardDefect::NotFinite { row, column, value } => {
                    format!(
                        "{value} at row {}, column {} of the film",
                        rect.y + row as i64,
                        rect.x + column as i64
                    )
                }
            };
            Finding::Bad { key, reason }
        });
        Ok((bytes.len() as u64, finding))
    }

    /// Compares arrays, coordinates and consolidated metadata with the attributes.
    fn check_metadata(&self) -> Result<Vec<Finding>, FilmError> {
        let mut findings = Vec::new();
        let mut mismatch = |key: &str, reason: &str| {
            findings.push(Finding::Metadata { key: key.into(), reason: reason.into() });
        };
        let group = read_json(&self.store, "zarr.json")?.unwrap_or_default();
        let copies = &group["consolidated_metadata"]["metadata"];
        let mut check = |name: &str, expected: &Value| -> Result<(), FilmError> {
            let key = format!("{name}/zarr.json");
            if read_json(&self.store, &key)?.as_ref() != Some(expected) {
                mismatch(&key, "it differs from the metadata of this film's layout");
            }
            if copies.get(name) != Some(expected) {
                mismatch("zarr.json", &format!("its copy of {key} is missing or differs"));
            }
            Ok(())
        };
        for output in &self.spec.outputs {
            check(&output.name, &self.spec.array(output))?;
        }
        let coordinates = self.spec.coordinates();
        for (name, (metadata, _)) in &coordinates {
            check(name, metadata)?;
        }
        for (name, (_, bytes)) in &coordinates {
            let key = format!("{name}/c/0");
            if self.store.read_at_most(&key, bytes.len() as u64).ok().flatten().as_ref() != Some(bytes) {
                mismatch(&key, "it differs from the coordinate of this film");
            }
        }
        Ok(findings)
    }
}
