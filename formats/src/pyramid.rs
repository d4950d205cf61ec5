//! Pyramids of films and raws: smaller and smaller images, so that viewers can show a complete one without reading all of it.
//!
//! Level 0 is the array itself; level n is computed from level n−1 as stored, so an interrupted pyramid is resumed without repeating work
//! and ends with the same bytes. Sides are halved, odd ones rounded up, until both are at most 256. How pixels are halved is the group's
//! ([`mod@crate::film`]: means over 2 × 2 pixels; [`mod@crate::raw`]: mosaics of half the resolution).
//!
//! ```text
//! zarr.json                        attribute `ome` (OME-Zarr 0.5, ngff.openmicroscopy.org/0.5): one entry of `multiscales` per array
//! pyramid/zarr.json                group attributes `schema` = "lenscube/pyramid/1" (raw: "lenscube/raw-pyramid/1") and `film_stamp`
//!                                  (`raw_stamp`)
//! pyramid/ARRAY/zarr.json          group
//! pyramid/ARRAY/N                  level N: an array like ARRAY
//! ```
//!
//! Levels are not in the film's group itself, since xarray reads the arrays of a group as one dataset, in which `y` has one length. The
//! group's `zarr.json` is written last, so other programs see a complete pyramid or none. The stamp is a digest of the group's attributes
//! and of each shard's size, index, and checksum of the last chunk; a pyramid with another one is stale.

mod halve;
mod level;
mod make;
pub(crate) mod ome;
mod verify;

use pipeline::geometry::{Rect, Size};
use pipeline::tiling::FilmRegion;
use serde_json::{Map, Value, json};

use crate::chart::{ChartOptions, ChartStore};
use crate::group::{GroupError, GroupKind, JobGroup, OME, PYRAMID_GROUP, ShardFile, metadata_key, read_json};
use crate::hierarchy::pretty;
use crate::shard::ShardEncoder;
pub use halve::halve;
use level::Level;
pub use level::level_sizes;

/// State of a pyramid.
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

/// Halves pixels of one band: from those of `Rect` of the level before (the first argument) to the encoded shard of pixels `Rect` of a
/// level, in a shard of shape `Size`.
pub(crate) type Halving<'a> =
    Box<dyn Fn(&LevelReader<'_>, Rect, Size) -> Result<Vec<u8>, GroupError> + Sync + 'a>;

/// What a film or raw provides for its pyramid.
pub(crate) trait PyramidSource: Sync {
    fn group(&self) -> &JobGroup;
    /// Names and sizes of the arrays.
    fn arrays(&self) -> Vec<(&str, Size)>;
    /// Images of each array: bands, or frames.
    fn bands(&self) -> usize;
    /// The shards that the levels are made of.
    fn source_files(&self) -> Vec<ShardFile<'_>>;
    /// Group attributes without those of the pyramid.
    fn own_attributes(&self) -> Value;
    /// Encoder of the levels.
    fn encoder(&self) -> &ShardEncoder;
    /// Shards of an image of `size`.
    fn level_grid(&self, size: Size) -> FilmRegion;
    /// Metadata of a level of `size` of array `output`.
    fn level_array(&self, output: usize, size: Size) -> Value;
    /// How levels are read.
    fn reader_options(&self) -> ChartOptions;
    /// Memory of a worker in bytes.
    fn worker_bytes(&self) -> usize;
    /// How pixels are halved.
    fn halving(&self) -> Result<Halving<'_>, GroupError>;
    /// Attribute `ome`, of the complete pyramid.
    fn ome_attribute(&self) -> Result<Value, GroupError>;
}

/// One band of a stored level.
pub(crate) struct LevelReader<'a> {
    store: &'a ChartStore,
    array: &'a str,
    band: usize,
}

impl LevelReader<'_> {
    /// Size of the level.
    pub(crate) fn size(&self) -> Size {
        self.store.size()
    }

    /// Its array and band, for errors.
    pub(crate) fn place(&self) -> String {
        format!("{}, band {}", self.array, self.band)
    }

    /// Reads `rect`.
    pub(crate) fn read(&self, rect: Rect, pixels: &mut Vec<f32>) -> Result<(), GroupError> {
        pixels.resize(rect.size().pixels(), 0.0);
        self.store.read_rect(self.band, rect, pixels).map_err(|e| GroupError::Level {
            place: format!("{}, {rect}", self.place()),
            reason: e.to_string(),
        })
    }
}

/// The pyramid of a film or raw; it need not exist.
pub struct Pyramid<'a>(pub(crate) &'a dyn PyramidSource);

impl<'a> Pyramid<'a> {
    /// The film or raw.
    pub fn group(&self) -> &'a JobGroup {
        self.0.group()
    }

    /// Names and sizes of the arrays that have levels.
    pub fn arrays(&self) -> Vec<(&'a str, Size)> {
        self.0.arrays()
    }

    /// Path in the group of a level of an array; level 0 is the array itself.
    pub fn level_path(&self, output: usize, level: usize) -> String {
        let name = self.0.arrays()[output].0;
        if level == 0 { name.into() } else { format!("{PYRAMID_GROUP}/{name}/{level}") }
    }

    /// State of the pyramid.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if the store cannot be read.
    pub fn state(&self) -> Result<PyramidState, GroupError> {
        let store = &self.group().store;
        let group = read_json(store, "zarr.json")?.unwrap_or_default();
        let Some(pyramid_group) = read_json(store, &metadata_key(PYRAMID_GROUP))? else {
            let has_ome = group["attributes"].get(OME).is_some();
            return Ok(if has_ome { PyramidState::Stale } else { PyramidState::None });
        };
        if pyramid_group != self.pyramid_group(&self.stamp()?) {
            return Ok(PyramidState::Stale);
        }
        let metadata = self.metadata();
        for (key, metadata) in &metadata {
            if read_json(store, &metadata_key(key))?.as_ref() != Some(metadata) {
                return Ok(PyramidState::Stale);
            }
        }
        let keys: Vec<String> = self.shard_files().into_iter().map(|file| file.key).collect();
        let done = store.sizes_of(&keys)?.iter().flatten().count();
        let copies = &group["consolidated_metadata"]["metadata"];
        let is_listed = group["attributes"].get(OME).is_some()
            && copies.get(PYRAMID_GROUP) == Some(&pyramid_group)
            && metadata.iter().all(|(key, metadata)| copies.get(key) == Some(metadata));
        Ok(if is_listed && done == keys.len() {
            PyramidState::Complete
        } else {
            PyramidState::Unfinished(done, keys.len())
        })
    }

    /// Number of shards of all levels except the arrays themselves.
    pub fn shards(&self) -> usize {
        self.levels().iter().map(|level| level.shards(self.0.bands()).count()).sum()
    }

    /// The levels of all arrays except the arrays themselves, in the order in which they are made.
    fn levels(&self) -> Vec<Level> {
        let arrays = self.arrays().into_iter().enumerate();
        let of_array = |(output, (_, size)): (usize, (&str, Size))| {
            let sizes = level_sizes(size).into_iter().enumerate().skip(1);
            sizes.map(move |(number, size)| Level { output, number, grid: self.0.level_grid(size) })
        };
        arrays.flat_map(of_array).collect()
    }

    fn shard_file(&self, level: &Level, (band, (row, column)): (usize, (usize, usize))) -> ShardFile<'a> {
        ShardFile {
            key: format!("{}/c/{band}/{row}/{column}", self.level_path(level.output, level.number)),
            encoder: self.0.encoder(),
            shape: level.grid.shard,
            rect: level.grid.shard_rect(row, column),
        }
    }

    /// All shards of the levels.
    pub(crate) fn shard_files(&self) -> Vec<ShardFile<'a>> {
        let of_level =
            |l: Level| l.shards(self.0.bands()).map(move |s| self.shard_file(&l, s)).collect::<Vec<_>>();
        self.levels().into_iter().flat_map(of_level).collect()
    }

    /// Metadata of the groups and arrays below the pyramid's group, by path.
    pub(crate) fn metadata(&self) -> Vec<(String, Value)> {
        let mut all = Vec::new();
        for level in self.levels() {
            if level.number == 1 {
                let name = self.arrays()[level.output].0;
                all.push((format!("{PYRAMID_GROUP}/{name}"), zarr_group(json!({}))));
            }
            let path = self.level_path(level.output, level.number);
            all.push((path, self.0.level_array(level.output, level.grid.rect.size())));
        }
        all
    }

    /// All keys that the pyramid may have, relative to its group.
    pub(crate) fn keys(&self) -> Vec<String> {
        let metadata = self.metadata().into_iter().map(|(key, _)| format!("{key}/zarr.json"));
        let all = metadata.chain(self.shard_files().into_iter().map(|file| file.key));
        let below = format!("{PYRAMID_GROUP}/");
        all.filter_map(|key| key.strip_prefix(&below).map(str::to_owned)).collect()
    }

    fn pyramid_group(&self, stamp: &str) -> Value {
        zarr_group(match self.group().kind {
            GroupKind::Film => json!({"schema": "lenscube/pyramid/1", "film_stamp": stamp}),
            GroupKind::Raw => json!({"schema": "lenscube/raw-pyramid/1", "raw_stamp": stamp}),
            GroupKind::Scene => unreachable!("scenes have no pyramid"),
        })
    }

    /// Digest of the group's attributes and of the checksums in its shards, without reading pixels; see the head of this file.
    fn stamp(&self) -> Result<String, GroupError> {
        let store = &self.group().store;
        let mut hash = blake3::Hasher::new();
        hash.update(self.0.own_attributes().to_string().as_bytes());
        for file in self.0.source_files() {
            let (rows, columns) = file.encoder.chunks_of(file.shape);
            let size = store.size_of(&file.key)?.unwrap_or(0);
            // The index, its checksum, and before them the checksum of the last chunk.
            let tail = ((rows * columns * 16 + 8) as u64).min(size);
            let bytes = match tail {
                0 => None,
                _ => store.read_range(&file.key, -(tail as i64), tail)?,
            };
            hash.update(file.key.as_bytes());
            hash.update(&size.to_le_bytes());
            hash.update(&bytes.unwrap_or_default());
        }
        Ok(hash.finalize().to_hex().to_string())
    }

    /// Writes the metadata of a new pyramid, last that of its group, without which the pyramid is started again. Removes an earlier
    /// pyramid, first from the list of the film or raw.
    fn write_metadata(&self, stamp: &str) -> Result<(), GroupError> {
        let store = &self.group().store;
        let group = read_json(store, "zarr.json")?.unwrap_or_default();
        if group["attributes"].get(OME).is_some() {
            store.write("zarr.json", pretty(&listed(group, None, Vec::new())))?;
        }
        if !store.names(PYRAMID_GROUP)?.is_empty() {
            store.remove_tree(PYRAMID_GROUP, self.keys())?;
        }
        for (key, metadata) in self.metadata() {
            store.write(&metadata_key(&key), pretty(&metadata))?;
        }
        Ok(store.write(&metadata_key(PYRAMID_GROUP), pretty(&self.pyramid_group(stamp)))?)
    }

    /// `group`, the metadata of the film or raw, with the complete pyramid.
    fn listed(&self, group: Value, stamp: &str) -> Result<Value, GroupError> {
        let mut members = vec![(PYRAMID_GROUP.to_owned(), self.pyramid_group(stamp))];
        members.extend(self.metadata());
        Ok(listed(group, Some(self.0.ome_attribute()?), members))
    }

    /// Adds the complete pyramid to the metadata of the film or raw.
    fn list(&self, stamp: &str) -> Result<(), GroupError> {
        let store = &self.group().store;
        let group = read_json(store, "zarr.json")?.unwrap_or_default();
        let new = self.listed(group.clone(), stamp)?;
        if new != group {
            store.write("zarr.json", pretty(&new))?;
        }
        self.group().check_in_place()
    }
}

/// Metadata of a Zarr group with `attributes`.
fn zarr_group(attributes: Value) -> Value {
    json!({"zarr_format": 3, "node_type": "group", "attributes": attributes})
}

/// Metadata of a film or raw with the attribute `ome` and the consolidated metadata `members` of its pyramid, or without them.
fn listed(mut group: Value, ome: Option<Value>, members: Vec<(String, Value)>) -> Value {
    if let Some(attributes) = group["attributes"].as_object_mut() {
        attributes.shift_remove(OME);
        attributes.extend(ome.map(|ome| (OME.to_owned(), ome)));
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
