//! The pyramid of a film: smaller and smaller images, so that viewers can show the complete film without reading all of it.
//!
//!     level n (i, j) = mean of the finite ones of level n−1 (2i, 2j), (2i, 2j+1), (2i+1, 2j), (2i+1, 2j+1);  NaN if there is none
//!
//! Level 0 is the film's array. Sides are halved, odd ones rounded up, until both are at most 256. Level n is computed from level n−1 as
//! stored, so an interrupted pyramid is resumed without repeating work and ends with the same bytes.
//!
//!     zarr.json                        attribute `ome` (OME-Zarr 0.5, ngff.openmicroscopy.org/0.5): one entry of `multiscales` per array
//!     pyramid/zarr.json                group attributes `schema` = "lenscube/pyramid/1" and `film_stamp`
//!     pyramid/ARRAY/zarr.json          group
//!     pyramid/ARRAY/N                  level N: an array like the film's
//!
//! Levels are not in the film's group itself, since xarray reads the arrays of a group as one dataset, in which `y` has one length. The
//! film's `zarr.json` is written last, so other programs see a complete pyramid or none. `film_stamp` is a digest of the film's attributes
//! and of each shard's size, index, and checksum of the last chunk; a pyramid with another one is stale.

pub(super) mod halve;
pub(super) mod level;
mod make;
mod ome;
#[cfg(test)]
mod tests;

use pipeline::geometry::{Rect, Size};
use serde_json::{Map, Value, json};

use super::error::FilmError;
use super::store::{FilmStore, SCHEMA, read_json};
use super::verify::Finding;
use crate::durable::{DurableError, Store};
use crate::hierarchy::pretty;
use level::{Level, level_sizes};

/// Attribute `schema` of the pyramid's group.
const PYRAMID_SCHEMA: &str = "lenscube/pyramid/1";
/// Group of the levels.
pub(crate) const PYRAMID_GROUP: &str = "pyramid";

/// State of a film's pyramid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PyramidState {
    /// There is none.
    None,
    /// Incomplete: shards done, and in total.
    Unfinished(usize, usize),
    /// Made of pixels that have changed since.
    Stale,
    /// Complete.
    Complete,
}

impl PyramidState {
    /// Name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Unfinished(..) => "unfinished",
            Self::Stale => "stale",
            Self::Complete => "complete",
        }
    }
}

impl FilmStore {
    /// Path in the film of a level of an output; level 0 is the output itself.
    pub fn level_path(&self, output: usize, level: usize) -> String {
        let name = &self.spec.outputs[output].name;
        if level == 0 { name.clone() } else { format!("{PYRAMID_GROUP}/{name}/{level}") }
    }

    /// State of the pyramid.
    ///
    /// # Errors
    /// [`FilmError::Storage`] if the store cannot be read.
    pub fn pyramid(&self) -> Result<PyramidState, FilmError> {
        let group = read_json(&self.store, "zarr.json")?.unwrap_or_default();
        let Some(pyramid_group) = read_json(&self.store, &format!("{PYRAMID_GROUP}/zarr.json"))? else {
            let has_ome = group["attributes"].get("ome").is_some();
            return Ok(if has_ome { PyramidState::Stale } else { PyramidState::None });
        };
        if pyramid_group != self.pyramid_group(&self.fingerprint()?) {
            return Ok(PyramidState::Stale);
        }
        for (key, metadata) in self.pyramid_metadata() {
            if read_json(&self.store, &format!("{key}/zarr.json"))?.as_ref() != Some(&metadata) {
                return Ok(PyramidState::Stale);
            }
        }
        let (mut done, mut all) = (0, 0);
        for level in self.levels() {
            for (band, shard) in level.all_shards(self.spec.wavelengths_nm.len()) {
                all += 1;
                done += usize::from(self.store.size_of(&self.level_key(&level, band, shard))?.is_some());
            }
        }
        let is_listed = self.lists_pyramid(&group, &pyramid_group);
        Ok(if is_listed && done == all {
            PyramidState::Complete
        } else {
            PyramidState::Unfinished(done, all)
        })
    }

    /// Number of shards of all levels except the film itself.
    pub fn pyramid_shards(&self) -> usize {
        let shards = |l: &Level| l.all_shards(self.spec.wavelengths_nm.len()).count();
        self.levels().iter().map(shards).sum()
    }

    /// Shape and pixels of the shard `key` of a level.
    pub(super) fn level_shard_of_key(&self, key: &str) -> Option<(Size, Rect)> {
        let bands = self.spec.wavelengths_nm.len();
        self.levels().into_iter().find_map(|level| {
            let mut all = level.all_shards(bands);
            let (_, shard) = all.find(|&(band, shard)| self.level_key(&level, band, shard) == key)?;
            Some((level.grid.shard, level.grid.shard_rect(shard.0, shard.1)))
        })
    }

    /// The levels of all outputs except the film itself, in the order in which they are made.
    fn levels(&self) -> Vec<Level> {
        let of_output = |output: usize| {
            let sizes = level_sizes(self.spec.outputs[output].rect.size());
            let level = move |(number, size): (usize, Size)| Level {
                output,
                number,
                grid: self.spec.grid_of(size.rect()),
            };
            sizes.into_iter().enumerate().skip(1).map(level)
        };
        (0..self.spec.outputs.len()).flat_map(of_output).collect()
    }

    fn level_key(&self, level: &Level, band: usize, (i, j): (usize, usize)) -> String {
        format!("{}/c/{band}/{i}/{j}", self.level_path(level.output, level.number))
    }

    /// Metadata of the groups and arrays below the pyramid's group, by path.
    fn pyramid_metadata(&self) -> Vec<(String, Value)> {
        let mut all = Vec::new();
        for level in self.levels() {
            let output = &self.spec.outputs[level.output];
            if level.number == 1 {
                all.push((format!("{PYRAMID_GROUP}/{}", output.name), group(json!({}))));
            }
            all.push((
                self.level_path(level.output, level.number),
                self.spec.array_of(output, level.grid.rect.size()),
            ));
        }
        all
    }

    /// All keys that a pyramid of this film may have, relative to its group.
    fn pyramid_keys(&self) -> Vec<String> {
        let bands = self.spec.wavelengths_nm.len();
        let metadata = self.pyramid_metadata().into_iter().map(|(key, _)| format!("{key}/zarr.json"));
        let levels = self.levels();
        let shards = levels.iter().flat_map(|level| {
            level.all_shards(bands).map(move |(band, shard)| self.level_key(level, band, shard))
        });
        let below = format!("{PYRAMID_GROUP}/");
        metadata.chain(shards).filter_map(|key| key.strip_prefix(&below).map(str::to_owned)).collect()
    }

    fn pyramid_group(&self, fingerprint: &str) -> Value {
        group(json!({"schema": PYRAMID_SCHEMA, "film_stamp": fingerprint}))
    }

    /// Whether the film's group metadata list the complete pyramid.
    fn lists_pyramid(&self, group: &Value, pyramid_group: &Value) -> bool {
        let copies = &group["consolidated_metadata"]["metadata"];
        let all = self.pyramid_metadata();
        group["attributes"].get("ome").is_some()
            && copies.get(PYRAMID_GROUP) == Some(pyramid_group)
            && all.iter().all(|(key, metadata)| copies.get(key) == Some(metadata))
    }

    /// Digest of the film's attributes and of the checksums in its shards, without reading pixels; see the head of this file.
    fn fingerprint(&self) -> Result<String, FilmError> {
        let attributes = self.spec.attributes(SCHEMA, &self.provenance).to_string();
        let shards = self.all_shards().map(|(output, band, shard)| {
            let (rows, columns) = self.spec.chunks_of(self.spec.shard_grid(output).shard);
            (self.key(output, band, shard), rows * columns)
        });
        Ok(stamp(&self.store, &attributes, shards)?)
    }

    /// Checks all shards of the pyramid, if there is one; returns the bytes read and the defects.
    pub(super) fn check_pyramid(&self) -> Result<(u64, Vec<Finding>), FilmError> {
        let mut findings = Vec::new();
        let key = format!("{PYRAMID_GROUP}/zarr.json");
        let mut finding = |reason: &str| {
            findings.push(Finding::Metadata { key: key.clone(), reason: reason.into() });
        };
        match self.pyramid()? {
            PyramidState::None => return Ok((0, findings)),
            PyramidState::Stale => {
                finding(
                    "the pyramid was made of pixels that have changed since; run `lenscube pyramid` again",
                );
                return Ok((0, findings));
            }
            PyramidState::Unfinished(done, all) if done == all => {
                finding("the film's group does not list the pyramid; `lenscube pyramid` completes it");
            }
            PyramidState::Unfinished(..) | PyramidState::Complete => {}
        }
        let mut bytes = 0;
        for level in self.levels() {
            for (band, shard) in level.all_shards(self.spec.wavelengths_nm.len()) {
                let (rect, key) =
                    (level.grid.shard_rect(shard.0, shard.1), self.level_key(&level, band, shard));
                let (read, finding) = self.check_file(key, level.grid.shard, rect)?;
                bytes += read;
                findings.extend(finding);
            }
        }
        Ok((bytes, findings))
    }
}

/// Digest of attributes and, for each shard (key, number of inner chunks), of its size, index, and checksum of the last chunk.
pub(crate) fn stamp(
    store: &Store,
    attributes: &str,
    shards: impl Iterator<Item = (String, usize)>,
) -> Result<String, DurableError> {
    let mut hash = blake3::Hasher::new();
    hash.update(attributes.as_bytes());
    for (key, chunks) in shards {
        // The index, its checksum, and before them the checksum of the last chunk.
        let tail = (chunks * 16 + 8) as u64;
        let size = store.size_of(&key)?.unwrap_or(0);
        let tail = tail.min(size);
        let bytes = match tail {
            0 => None,
            _ => store.read_range(&key, -(tail as i64), tail)?,
        };
        hash.update(key.as_bytes());
        hash.update(&size.to_le_bytes());
        hash.update(&bytes.unwrap_or_default());
    }
    Ok(hash.finalize().to_hex().to_string())
}

/// Metadata of a group with `attributes`.
pub(crate) fn group(attributes: Value) -> Value {
    json!({"zarr_format": 3, "node_type": "group", "attributes": attributes})
}

/// Writes the metadata of a new pyramid of the film or raw in `store`: `metadata` by path, and `pyramid_group` last, without which the pyramid is
/// started again. Removes an earlier pyramid, first from the list of the film or raw; `keys`: all that it may have, relative to its group.
pub(crate) fn write_metadata(
    store: &Store,
    pyramid_group: &Value,
    metadata: Vec<(String, Value)>,
    keys: Vec<String>,
) -> Result<(), DurableError> {
    let group = read_json(store, "zarr.json")?.unwrap_or_default();
    if group["attributes"].get("ome").is_some() {
        store.write("zarr.json", pretty(&listed(group, None, Vec::new())))?;
    }
    if !store.names(PYRAMID_GROUP)?.is_empty() {
        store.remove_tree(PYRAMID_GROUP, keys)?;
    }
    for (key, metadata) in metadata {
        store.write(&format!("{key}/zarr.json"), pretty(&metadata))?;
    }
    store.write(&format!("{PYRAMID_GROUP}/zarr.json"), pretty(pyramid_group))
}

/// Adds a complete pyramid to the group metadata of the film or raw in `store`.
pub(crate) fn list(
    store: &Store,
    ome: Value,
    pyramid_group: Value,
    metadata: Vec<(String, Value)>,
) -> Result<(), DurableError> {
    let mut members = vec![(PYRAMID_GROUP.to_owned(), pyramid_group)];
    members.extend(metadata);
    let group = read_json(store, "zarr.json")?.unwrap_or_default();
    let new = listed(group.clone(), Some(ome), members);
    if new == group {
        return Ok(());
    }
    store.write("zarr.json", pretty(&new))
}

/// Group metadata of a film or raw with the attribute `ome` and the consolidated metadata `members` of its pyramid, or without them.
fn listed(mut group: Value, ome: Option<Value>, members: Vec<(String, Value)>) -> Value {
    if let Some(attributes) = group["attributes"].as_object_mut() {
        attributes.shift_remove("ome");
        attributes.extend(ome.map(|ome| ("ome".to_owned(), ome)));
    }
    if let Some(copies) = group["consolidated_metadata"]["metadata"].as_object_mut() {
        let below = format!("{PYRAMID_GROUP}/");
        let kept: Map<String, Value> = std::mem::take(copies)
            .into_iter()
            .filter(|(key, _)| key != PYRAMID_GROUP && !key.starts_with(&below))
            .chain(members)
            .collect();
        *copies = kept;
    }
    group
}
