//! The raw: digital numbers of a sensor, shard by shard, in a Zarr v3 group that other programs open as it is.
//!
//! Arrays `raw` (frame, y, x) of u16, or `roi_0`, `roi_1`, … for windows of it; coordinates `frame`, `y` and `x` (mm) (`roi_0_y`, …), `exposure_s`
//! (frame); optionally `signal` (y, x) f32, the electrons per second that every frame starts from. Shards (1, 2048, 2048), chunks of 512,
//! blosc zstd 1 with bit shuffle and crc32c. Digital numbers have no NaN: the fill value is 0, empty chunks are kept, so present means done.
//! `pyramid/` holds smaller levels on request. Created in one rename, opened and held, compared with its path before each commit: as films ([`crate::film`]).

mod contents;
mod error;
mod pyramid;
mod spec;
mod verify;

use std::path::{Path, PathBuf};

use pipeline::geometry::Rect;
use serde_json::{Map, Value};

pub use error::RawError;
pub use pyramid::mosaic::{Period, halve_mosaic, mosaic_below};
pub use spec::{RawOutput, RawSpec};
pub use verify::RawFinding;

use crate::durable::{DurableError, Lock, LockOwner, Removal, Store, Sweep, fault_point, link_target};
use crate::film::read_json;
use crate::hierarchy::NewGroup;
use crate::shard::{Codec, SampleType, ShardEncoder, ShardError};

/// What marks a group as a raw of ours.
const SCHEMA: &str = "lenscube/raw/1";
/// The array of the kept signal.
pub const SIGNAL: &str = "signal";

/// A raw on disk. Shards are encoded and committed on any number of threads.
#[derive(Debug)]
pub struct RawStore {
    store: Store,
    spec: RawSpec,
    attributes: Map<String, Value>,
    counts: ShardEncoder,
    signal: ShardEncoder,
}

/// A file of a raw: a shard of an array, by frame, or of its signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RawShard {
    /// Output of the spec; the signal is of output 0.
    pub output: usize,
    /// Frame; none: the signal.
    pub frame: Option<usize>,
    /// Row and column in the grid of shards.
    pub place: (usize, usize),
}

impl RawStore {
    /// Creates an empty raw at `path` with further `attributes`, among them `provenance` with `job_digest` and `layout_digest`.
    ///
    /// # Errors
    /// [`RawError::Exists`] if something is there; [`RawError`] if files cannot be written.
    pub fn create(
        path: &Path,
        spec: RawSpec,
        attributes: Map<String, Value>,
        fsync: bool,
    ) -> Result<Self, RawError> {
        let exists = || RawError::Exists { path: path.into() };
        let coordinates = spec.coordinates();
        let mut ours: Vec<String> =
            coordinates.iter().flat_map(|(n, _)| [format!("{n}/zarr.json"), format!("{n}/c/0")]).collect();
        ours.extend(spec.arrays().into_iter().map(|(name, _)| format!("{name}/zarr.json")));
        let mut group =
            NewGroup::begin(path, fsync, move |key| ours.iter().any(|k| k == key))?.ok_or_else(exists)?;
        for (name, coordinate) in coordinates {
            group.coordinate(&name, coordinate)?;
        }
        for (name, metadata) in spec.arrays() {
            group.array(&name, metadata)?;
        }
        let absent =
            || DurableError::StoreMissing { path: group.store.root().into(), missing: "directory".into() };
        let store = group.opened()?.ok_or_else(absent)?;
        let all = spec.attributes(SCHEMA, &attributes);
        if !group.publish(Value::Object(all))? {
            return Err(exists());
        }
        Self::with(store, spec, attributes)
    }

    /// Opens the raw at `path`.
    ///
    /// # Errors
    /// [`RawError::NotRaw`] if there is none; [`RawError::Damaged`] if its metadata contradict each other.
    pub fn open(path: &Path, fsync: bool) -> Result<Self, RawError> {
        let store = open_store(path)?;
        let mut all = raw_attributes(&store)?;
        // Of the pyramid, and no part of the raw's identity.
        all.shift_remove("ome");
        let damaged = |key: &str| RawError::Damaged { path: path.join(key) };
        let (spec, attributes) = RawSpec::from_attributes(all).ok_or_else(|| damaged("zarr.json"))?;
        for (name, metadata) in spec.arrays() {
            let key = format!("{name}/zarr.json");
            if read_json(&store, &key)?.as_ref() != Some(&metadata) {
                return Err(damaged(&key));
            }
        }
        Self::with(store.with_fsync(fsync), spec, attributes)
    }

    /// Whether a raw of this program is at `path`.
    ///
    /// # Errors
    /// [`RawError`] if the store does not answer.
    pub fn is_one(path: &Path) -> Result<bool, RawError> {
        match open_store(path).and_then(|store| raw_attributes(&store)) {
            Ok(_) => Ok(true),
            Err(RawError::NotRaw { .. }) => Ok(false),
            Err(e) => Err(e),
        }
    }

    fn with(store: Store, spec: RawSpec, attributes: Map<String, Value>) -> Result<Self, RawError> {
        let encoder = |sample| {
            ShardEncoder::new(Codec::Zstd, sample, spec.chunk, None)
                .map_err(|e| RawError::Codec { reason: e.to_string() })
        };
        Ok(Self {
            counts: encoder(SampleType::U16)?,
            signal: encoder(SampleType::F32)?,
            store,
            spec,
            attributes,
        })
    }

    /// Removes the raw at `path`; nothing there is fine.
    ///
    /// # Errors
    /// [`RawError::NotRaw`] for anything but a raw of this program; [`RawError::Foreign`] if it holds what it did not make.
    pub fn remove_raw(path: &Path) -> Result<(), RawError> {
        let place = link_target(path);
        if !Store::at(&place)?.exists()? {
            return Ok(());
        }
        let store = open_store(&place)?;
        let known = match RawSpec::from_attributes(raw_attributes(&store)?) {
            Some((spec, _)) => spec.all_shards().into_iter().map(|s| spec.key(s)).collect(),
            None => Vec::new(),
        };
        match store.remove_all(known, contents::is_own)? {
            Removal::Done => Ok(()),
            Removal::Foreign(names) => Err(RawError::Foreign { path: path.into(), names }),
            Removal::Replaced => Err(RawError::Recreated { path: path.into() }),
        }
    }

    /// Its path or URL.
    pub fn path(&self) -> &Path {
        self.store.root()
    }

    /// What it is.
    pub fn spec(&self) -> &RawSpec {
        &self.spec
    }

    /// All that it records of sensor, film and exposure.
    pub fn attributes(&self) -> &Map<String, Value> {
        &self.attributes
    }

    /// Those of `shards` that are missing.
    ///
    /// # Errors
    /// [`RawError::Storage`] if the store does not answer.
    pub fn missing(&self, shards: &[RawShard]) -> Result<Vec<RawShard>, RawError> {
        let keys: Vec<String> = shards.iter().map(|&s| self.spec.key(s)).collect();
        let found = self.store.sizes_of(&keys)?;
        Ok(std::iter::zip(shards, found).filter(|(_, size)| size.is_none()).map(|(s, _)| *s).collect())
    }

    /// Encodes and writes a shard of digital numbers, the pixels of [`RawSpec::shard_rect`] row by row. Returns the bytes written.
    ///
    /// # Errors
    /// [`RawError::Storage`]; the shard then is as it was before. [`RawError::Replaced`] if another raw has taken its place.
    pub fn commit_counts(&self, shard: RawShard, data: &[u16]) -> Result<u64, RawError> {
        let rect = self.spec.shard_rect(shard);
        let bytes = self.counts.encode_counts(data, (rect.height, rect.width), self.spec.grid(shard.output));
        self.commit(shard, bytes)
    }

    /// The same of the signal.
    ///
    /// # Errors
    /// As [`RawStore::commit_counts`].
    pub fn commit_signal(&self, shard: RawShard, data: &[f32]) -> Result<u64, RawError> {
        let rect = self.spec.shard_rect(shard);
        let bytes = self.signal.encode(data, (rect.height, rect.width), self.spec.grid(shard.output));
        self.commit(shard, bytes)
    }

    fn commit(&self, shard: RawShard, bytes: Result<Vec<u8>, ShardError>) -> Result<u64, RawError> {
        let bytes = bytes.map_err(|e| RawError::Codec { reason: e.to_string() })?;
        fault_point("commit");
        self.check_in_place()?;
        let size = bytes.len() as u64;
        self.in_place(self.store.write(&self.spec.key(shard), bytes))?;
        Ok(size)
    }

    /// Writes a file that is no part of the arrays, such as `runs/….json`.
    ///
    /// # Errors
    /// As [`RawStore::commit_counts`].
    pub fn write_record(&self, key: &str, bytes: &[u8]) -> Result<(), RawError> {
        self.check_in_place()?;
        self.in_place(self.store.write(key, bytes.to_vec()))
    }

    fn in_place<T>(&self, written: Result<T, DurableError>) -> Result<T, RawError> {
        written.map_err(|e| self.check_in_place().err().unwrap_or(e.into()))
    }

    /// Fails unless this raw is still at its path.
    ///
    /// # Errors
    /// [`RawError::Replaced`], [`RawError::Recreated`]; [`DurableError::StoreMissing`] if none is there.
    pub fn check_in_place(&self) -> Result<(), RawError> {
        let in_place = self.store.is_in_place()?;
        let there = match in_place {
            true => read_json(&self.store, "zarr.json")?,
            false => read_json(&Store::at(self.path())?, "zarr.json")?,
        };
        let path = || self.path().into();
        let own = Value::Object(self.attributes.clone());
        match there {
            None => Err(DurableError::StoreMissing { path: path(), missing: "zarr.json".into() }.into()),
            Some(group) if identity(&group["attributes"]) != identity(&own) => {
                Err(RawError::Replaced { path: path() })
            }
            Some(_) if in_place => Ok(()),
            Some(_) => Err(RawError::Recreated { path: path() }),
        }
    }

    /// Takes the lock of the raw. `None`: the store has no locks.
    ///
    /// # Errors
    /// [`RawError::Locked`] if another process has it; as [`RawStore::check_in_place`].
    pub fn lock(&self, take_over: bool) -> Result<Option<Lock>, RawError> {
        self.check_in_place()?;
        let lock = self.store.lock("runs", "whole", take_over);
        self.check_in_place()?;
        Ok(lock?)
    }

    /// The locks on the raw at `path`.
    ///
    /// # Errors
    /// [`RawError::Storage`] if they cannot be read.
    #[allow(clippy::type_complexity, reason = "as `durable::locks`")]
    pub fn locks(path: &Path) -> Result<Vec<(PathBuf, Option<Box<LockOwner>>, Option<bool>)>, RawError> {
        Ok(Store::at(path)?.locks("runs")?)
    }

    /// Removes what dead processes of this host left in it.
    ///
    /// # Errors
    /// [`RawError::Storage`] if it cannot be listed.
    pub fn sweep(&self) -> Result<Sweep, RawError> {
        Ok(self.store.sweep()?)
    }

    /// Pixels of an output in sensor coordinates.
    pub fn rect(&self, output: usize) -> Rect {
        self.spec.outputs[output].rect
    }
}

/// What distinguishes one job's raw from another's.
fn identity(attributes: &Value) -> [&Value; 2] {
    ["job_digest", "layout_digest"].map(|key| &attributes["provenance"][key])
}

fn open_store(path: &Path) -> Result<Store, RawError> {
    let store = Store::at(path)?;
    match store.clone().opened()? {
        Some(open) => Ok(open),
        None => {
            let found = if store.exists()? { "no readable zarr.json" } else { "nothing" };
            Err(RawError::NotRaw { path: path.into(), found: found.into() })
        }
    }
}

fn raw_attributes(store: &Store) -> Result<Map<String, Value>, RawError> {
    let path = store.root();
    let not = |found: String| RawError::NotRaw { path: path.into(), found };
    let mut group = match read_json(store, "zarr.json")? {
        Some(group) => group,
        None if store.exists()? => return Err(not("no readable zarr.json".into())),
        None => return Err(not("nothing".into())),
    };
    match group["attributes"]["schema"].as_str() {
        Some(SCHEMA) => {}
        Some(other) => return Err(not(format!("schema {other:?}"))),
        None => return Err(not("a Zarr node of another program".into())),
    }
    match group["attributes"].take() {
        Value::Object(m) => Ok(m),
        _ => Err(not("no attributes".into())),
    }
}

#[cfg(test)]
mod tests;
