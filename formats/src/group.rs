//! The Zarr groups that jobs write shard by shard: films ([`crate::film`]) and raws ([`crate::raw`]).
//!
//! All metadata of a group is published in one step. A shard is one file, absent or complete: a shard that exists is done. Group attribute
//! `schema` names the kind, `provenance` holds the digests of job and layout (`job_digest`, `layout_digest`) that identify the group; `runs/`
//! has records (`*.json`), locks (`*.lock`) and marks of engines (`*.engine`). Attribute `attributes_digest`: see module `derived`.
//!
//! # Groups that are replaced
//! In a directory a [`JobGroup`] works through a handle on the directory that was opened: if another group replaces it at its path
//! (`--overwrite`), nothing is written to the new one. Every commit and lock compares the digests at the path with those of the opened group
//! ([`JobGroup::check_in_place`]). At a URL there are no handles and no locks: a group that is removed and created again between the
//! comparison and the end of the following put receives that one object. Two jobs must not use the same URL at the same time.

mod derived;
mod error;
mod kind;
mod output;
mod removal;
mod verify;

use std::path::{Path, PathBuf};

use bytes::Bytes;
use serde_json::{Map, Value};

use crate::durable::{Batch, DurableError, Lock, LockOwner, Removal, Store, Sweep, fault_point, link_target};
use crate::hierarchy::NewGroup;

pub(crate) use derived::{Derived, OME, PYRAMID_GROUP, metadata_key};
pub use error::{Found, GroupError};
pub use kind::GroupKind;
pub(crate) use kind::LAYER_NAMES;
pub use output::Output;
pub(crate) use removal::ENGINE_EXTENSION;
pub(crate) use verify::ShardFile;
pub use verify::{Finding, VerifyReport};

/// Directory of records, locks and marks of engines.
const RUNS: &str = "runs";
const MAX_METADATA_BYTES: u64 = 64 << 20;

/// An open film or raw.
#[derive(Debug)]
pub struct JobGroup {
    pub(crate) store: Store,
    pub(crate) kind: GroupKind,
    identity: [Value; 2],
}

impl JobGroup {
    /// Lock of the complete group.
    pub const WHOLE: &str = "whole";

    /// Creates a group without shards: arrays and coordinates, group `attributes`. `fsync: false` is faster, but a power failure may lose
    /// committed shards.
    ///
    /// # Errors
    /// [`GroupError::Exists`] if something exists at `path`; [`GroupError::Storage`].
    pub(crate) fn create(
        kind: GroupKind,
        path: &Path,
        Derived { coordinates, arrays }: Derived,
        attributes: Value,
        fsync: bool,
    ) -> Result<Self, GroupError> {
        let exists = || GroupError::Exists { kind, path: path.into() };
        // Keys of a group whose creation did not finish: it has no shards.
        let keys = |name: &str| [metadata_key(name), derived::values_key(name)];
        let mut own_keys: Vec<String> = coordinates.iter().flat_map(|(name, _)| keys(name)).collect();
        own_keys.extend(arrays.iter().map(|(name, _)| metadata_key(name)));
        let mut group =
            NewGroup::begin(path, fsync, move |key| own_keys.iter().any(|k| k == key))?.ok_or_else(exists)?;
        for (name, coordinate) in coordinates {
            group.coordinate(&name, coordinate)?;
        }
        for (name, metadata) in arrays {
            group.array(&name, metadata)?;
        }
        let vanished =
            || DurableError::StoreMissing { path: group.store.root().into(), missing: "directory".into() };
        let store = group.opened()?.ok_or_else(vanished)?;
        let identity = identity(&attributes);
        if !group.publish(derived::with_digest(attributes))? {
            return Err(exists());
        }
        Ok(Self { store, kind, identity })
    }

    /// Opens the group at `path`, and reads its attributes, without those of its pyramid.
    ///
    /// # Errors
    /// [`GroupError::NotOfKind`] if there is no such group; [`GroupError::Storage`].
    pub(crate) fn open(
        kind: GroupKind,
        path: &Path,
        fsync: bool,
    ) -> Result<(Self, Map<String, Value>), GroupError> {
        let not = |found| GroupError::NotOfKind { kind, path: path.into(), found };
        let store = Store::at(path)?;
        let found = |exists| if exists { Found::Unreadable } else { Found::Nothing };
        let Some(store) = store.clone().opened()? else { return Err(not(found(store.exists()?))) };
        // Read before the query for existence: only reads report the store's error message.
        let Some(mut group) = read_json(&store, "zarr.json")? else {
            return Err(not(found(store.exists()?)));
        };
        let attributes = group.get_mut("attributes").map(Value::take);
        match attributes.as_ref().and_then(|a| a.get("schema")?.as_str()) {
            Some(schema) if schema == kind.schema() => {}
            Some(other) => return Err(not(Found::Schema(other.to_owned()))),
            None => return Err(not(Found::OtherProgram)),
        }
        let attributes = attributes.unwrap_or_default();
        let identity = identity(&attributes);
        let Value::Object(mut attributes) = attributes else { return Err(not(Found::OtherProgram)) };
        derived::without_own(&mut attributes);
        Ok((Self { store: store.with_fsync(fsync), kind, identity }, attributes))
    }

    /// Fails unless the stored metadata of `arrays` are as given.
    pub(crate) fn check_arrays(&self, arrays: &[(String, Value)]) -> Result<(), GroupError> {
        for (name, metadata) in arrays {
            let key = metadata_key(name);
            if read_json(&self.store, &key)?.as_ref() != Some(metadata) {
                return Err(GroupError::ArrayMetadata { kind: self.kind, path: self.path().into(), key });
            }
        }
        Ok(())
    }

    /// The error of a file that is not what it should be.
    pub(crate) fn damaged(&self, key: &str, expected: &'static str) -> GroupError {
        GroupError::Damaged { kind: self.kind, path: self.path().join(key), expected }
    }

    /// Removes the group at `path`, if there is one. A symbolic link at `path` stays. `content`: the keys of its shards and the names of
    /// its arrays, as far as they follow from its attributes.
    ///
    /// # Errors
    /// [`GroupError::NotOfKind`] for anything else; [`GroupError::Foreign`] if the directory contains other files;
    /// [`GroupError::Recreated`] if another run replaced it meanwhile. Nothing is removed then.
    pub(crate) fn remove(
        kind: GroupKind,
        path: &Path,
        content: impl FnOnce(Map<String, Value>) -> (Vec<String>, Vec<String>),
    ) -> Result<(), GroupError> {
        let target = link_target(path);
        if !Store::at(&target)?.exists()? {
            return Ok(());
        }
        let (group, attributes) = Self::open(kind, &target, true)?;
        let (shards, arrays) = content(attributes);
        match group.store.remove_all(shards, move |key| removal::is_own(kind, &arrays, key))? {
            Removal::Done => Ok(()),
            Removal::Foreign(names) => Err(GroupError::Foreign { kind, path: path.into(), names }),
            Removal::Replaced => Err(GroupError::Recreated { kind, path: path.into() }),
        }
    }

    /// Path or URL.
    pub fn path(&self) -> &Path {
        self.store.root()
    }

    /// Writes a shard, durably and atomically; from then on it is present.
    pub(crate) fn commit(&self, key: &str, bytes: Bytes) -> Result<(), GroupError> {
        fault_point("commit");
        self.check_in_place()?;
        fault_point("commit-checked");
        self.report_replacement(self.store.write(key, bytes))
    }

    /// As [`JobGroup::commit`], but the file is present only after [`JobGroup::commit_batch`].
    pub(crate) fn stage(
        &self,
        batch: &mut Batch,
        key: &str,
        rank: u8,
        bytes: &[u8],
    ) -> Result<(), GroupError> {
        fault_point("commit");
        self.check_in_place()?;
        fault_point("commit-checked");
        self.report_replacement(batch.stage(key, rank, bytes))
    }

    /// Commits the files of `batch`, durably; each is absent or complete, and present only beside all files of lower ranks.
    pub(crate) fn commit_batch(&self, batch: &mut Batch) -> Result<(), GroupError> {
        if batch.is_empty() {
            return Ok(());
        }
        fault_point("batch-staged");
        self.report_replacement(batch.flush())?;
        self.check_in_place()?;
        fault_point("batch-flushed");
        self.report_replacement(batch.publish())
    }

    /// Writes a file that does not belong to the arrays, such as `runs/….json`.
    ///
    /// # Errors
    /// [`GroupError::Storage`]; as [`JobGroup::check_in_place`].
    pub fn write_record(&self, key: &str, bytes: &[u8]) -> Result<(), GroupError> {
        self.check_in_place()?;
        self.report_replacement(self.store.write(key, bytes.to_vec()))
    }

    /// Replaces the error of a failed write by that of [`JobGroup::check_in_place`], if the group was removed or replaced.
    fn report_replacement<T>(&self, written: Result<T, DurableError>) -> Result<T, GroupError> {
        written.map_err(|e| self.check_in_place().err().unwrap_or(e.into()))
    }

    /// Checks that this group is still at its path: shards must not be written without metadata where a group was removed or unmounted,
    /// nor to the group of another job.
    ///
    /// # Errors
    /// [`GroupError::Replaced`], [`GroupError::Recreated`]; [`DurableError::StoreMissing`] if there is none at the path;
    /// [`GroupError::Storage`] if the store cannot be read.
    pub fn check_in_place(&self) -> Result<(), GroupError> {
        let in_place = self.store.is_in_place()?;
        let found = match in_place {
            true => read_json(&self.store, "zarr.json")?,
            false => read_json(&Store::at(self.path())?, "zarr.json")?,
        };
        let (kind, path) = (self.kind, || self.path().into());
        match found {
            None => Err(DurableError::StoreMissing { path: path(), missing: "zarr.json".into() }.into()),
            Some(group) if identity(&group["attributes"]) != self.identity => {
                Err(GroupError::Replaced { kind, path: path() })
            }
            Some(_) if in_place => Ok(()),
            Some(_) => Err(GroupError::Recreated { kind, path: path() }),
        }
    }

    /// Acquires the lock of a unit of work on this group ([`JobGroup::WHOLE`]: all of it); see [`Lock`]. `None` if the store has no locks. If
    /// another group replaced this one meanwhile, its lock is released again.
    ///
    /// # Errors
    /// [`GroupError::Locked`] if another process holds it; as [`JobGroup::check_in_place`].
    pub fn lock(&self, unit: &str, take_over: bool) -> Result<Option<Lock>, GroupError> {
        self.check_in_place()?;
        let lock = self.store.lock(RUNS, unit, take_over);
        self.check_in_place()?;
        Ok(lock?)
    }

    /// The locks on the group at `path`, each with its owner and whether that process is dead (`None`: unknown).
    ///
    /// # Errors
    /// [`GroupError::Storage`] if they cannot be read.
    #[allow(clippy::type_complexity, reason = "as `durable::locks`")]
    pub fn locks(path: &Path) -> Result<Vec<(PathBuf, Option<Box<LockOwner>>, Option<bool>)>, GroupError> {
        Ok(Store::at(path)?.locks(RUNS)?)
    }

    /// Removes leftover temporary files of dead processes of this host.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if the group cannot be listed or files cannot be removed.
    pub fn sweep(&self) -> Result<Sweep, GroupError> {
        Ok(self.store.sweep()?)
    }

    /// The records of runs, `runs/*.json`, oldest first; files that are no JSON objects are ignored.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if the records cannot be read.
    pub fn runs(&self) -> Result<Vec<Map<String, Value>>, GroupError> {
        let mut runs = Vec::new();
        for name in self.store.names(RUNS)?.into_iter().filter(|n| n.ends_with(".json")) {
            if let Some(Value::Object(run)) = read_json(&self.store, &format!("{RUNS}/{name}"))? {
                runs.push(run);
            }
        }
        runs.sort_by_key(|r| r.get("finished_unix_s").and_then(Value::as_u64));
        Ok(runs)
    }
}

/// The digests that identify a group: of its job and of the layout of its files.
fn identity(attributes: &Value) -> [Value; 2] {
    ["job_digest", "layout_digest"].map(|key| attributes["provenance"][key].clone())
}

/// The JSON value of `key`; `None` if it does not exist or is no JSON.
pub(crate) fn read_json(store: &Store, key: &str) -> Result<Option<Value>, DurableError> {
    let bytes = store.read_at_most(key, MAX_METADATA_BYTES)?;
    Ok(bytes.and_then(|b| serde_json::from_slice(&b).ok()))
}

#[cfg(test)]
mod tests;
