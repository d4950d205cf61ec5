//! The pyramid of a raw: smaller and smaller mosaics, for distant views.
//!
//! Every level is a mosaic of the same pattern of half the resolution, made of means over pixels of one filter ([`mosaic`]), in digital
//! numbers, frame by frame: a viewer shows it as it shows the raw, and it is developed as the raw is. Sides are halved, odd ones rounded
//! up, until both are at most 256. Keys, order of writing, resumption and staleness are those of a film's pyramid:
//!
//!     zarr.json                        attribute `ome` (OME-Zarr 0.5): one entry of `multiscales` per array, a channel per frame
//!     pyramid/zarr.json                group attributes `schema` = "lenscube/raw-pyramid/1" and `raw_stamp`
//!     pyramid/ARRAY/zarr.json          group
//!     pyramid/ARRAY/N                  level N: an array like the raw's
//!
//! The kept signal has no levels.

mod make;
pub mod mosaic;
mod ome;
#[cfg(test)]
mod tests;

use pipeline::geometry::Size;
use serde_json::{Value, json};

use super::{RawError, RawFinding, RawStore};
use crate::film::{PYRAMID_GROUP, PyramidState, group, level_sizes, read_json as read, stamp};
use mosaic::Period;

/// Attribute `schema` of the pyramid's group.
const PYRAMID_SCHEMA: &str = "lenscube/raw-pyramid/1";

/// A level other than the raw itself.
#[derive(Clone, Copy, Debug)]
struct Level {
    output: usize,
    /// From 1.
    number: usize,
    size: Size,
}

/// A shard of a level: frame, (row, column).
type LevelShard = (usize, (usize, usize));

impl RawStore {
    /// Path in the raw of a level of an output; level 0 is the output itself.
    pub fn level_path(&self, output: usize, level: usize) -> String {
        let name = &self.spec.outputs[output].name;
        if level == 0 { name.clone() } else { format!("{PYRAMID_GROUP}/{name}/{level}") }
    }

    /// Rows and columns of the period of its mosaic.
    ///
    /// # Errors
    /// [`RawError::Damaged`] if it does not record its pattern.
    pub fn period(&self) -> Result<Period, RawError> {
        let pattern = self.attributes.get("cfa").and_then(|cfa| cfa["pattern"].as_array());
        let rows = pattern.map_or(0, Vec::len);
        let columns = pattern.and_then(|p| p.first()?.as_array()).map_or(0, Vec::len);
        match (1..=8).contains(&rows) && (1..=8).contains(&columns) {
            true => Ok((rows, columns)),
            false => Err(RawError::Damaged { path: self.path().join("zarr.json") }),
        }
    }

    /// State of the pyramid.
    ///
    /// # Errors
    /// [`RawError::Storage`] if the store cannot be read.
    pub fn pyramid(&self) -> Result<PyramidState, RawError> {
        let group = read(&self.store, "zarr.json")?.unwrap_or_default();
        let Some(pyramid_group) = read(&self.store, &format!("{PYRAMID_GROUP}/zarr.json"))? else {
            let has_ome = group["attributes"].get("ome").is_some();
            return Ok(if has_ome { PyramidState::Stale } else { PyramidState::None });
        };
        if pyramid_group != pyramid_group_of(&self.stamp()?) {
            return Ok(PyramidState::Stale);
        }
        let metadata = self.pyramid_metadata();
        for (key, expected) in &metadata {
            if read(&self.store, &format!("{key}/zarr.json"))?.as_ref() != Some(expected) {
                return Ok(PyramidState::Stale);
            }
        }
        let keys: Vec<String> = self.pyramid_shard_keys();
        let done = self.store.sizes_of(&keys)?.iter().flatten().count();
        let copies = &group["consolidated_metadata"]["metadata"];
        let is_listed = group["attributes"].get("ome").is_some()
            && copies.get(PYRAMID_GROUP) == Some(&pyramid_group)
            && metadata.iter().all(|(key, metadata)| copies.get(key) == Some(metadata));
        Ok(if is_listed && done == keys.len() {
            PyramidState::Complete
        } else {
            PyramidState::Unfinished(done, keys.len())
        })
    }

    /// Number of shards of all levels except the raw itself.
    pub fn pyramid_shards(&self) -> usize {
        self.levels().iter().map(|level| self.level_shards(level).len()).sum()
    }

    /// The levels of all outputs except the raw itself, in the order in which they are made.
    fn levels(&self) -> Vec<Level> {
        let of_output = |output: usize| {
            let sizes = level_sizes(self.spec.outputs[output].rect.size());
            sizes.into_iter().enumerate().skip(1).map(move |(number, size)| Level { output, number, size })
        };
        (0..self.spec.outputs.len()).flat_map(of_output).collect()
    }

    fn level_shards(&self, level: &Level) -> Vec<LevelShard> {
        let (rows, columns) = self.spec.shard_shape_of(level.size);
        let (down, across) = (level.size.height.div_ceil(rows), level.size.width.div_ceil(columns));
        let places = move |frame| (0..down * across).map(move |k| (frame, (k / across, k % across)));
        (0..self.spec.exposure_s.len()).flat_map(places).collect()
    }

    fn level_key(&self, level: &Level, (frame, (i, j)): LevelShard) -> String {
        format!("{}/c/{frame}/{i}/{j}", self.level_path(level.output, level.number))
    }

    fn pyramid_shard_keys(&self) -> Vec<String> {
        let levels = self.levels();
        let keys = |l: &Level| -> Vec<String> {
            self.level_shards(l).into_iter().map(|shard| self.level_key(l, shard)).collect()
        };
        levels.iter().flat_map(keys).collect()
    }

    /// Metadata of the groups and arrays below the pyramid's group, by path.
    fn pyramid_metadata(&self) -> Vec<(String, Value)> {
        let mut all = Vec::new();
        for level in self.levels() {
            let output = &self.spec.outputs[level.output];
            if level.number == 1 {
                all.push((format!("{PYRAMID_GROUP}/{}", output.name), group(json!({}))));
            }
            let path = self.level_path(level.output, level.number);
            all.push((path, self.spec.counts_array(output, level.size)));
        }
        all
    }

    /// All keys that a pyramid of this raw may have, relative to its group.
    fn pyramid_keys(&self) -> Vec<String> {
        let metadata = self.pyramid_metadata().into_iter().map(|(key, _)| format!("{key}/zarr.json"));
        let below = format!("{PYRAMID_GROUP}/");
        let all = metadata.chain(self.pyramid_shard_keys());
        all.filter_map(|key| key.strip_prefix(&below).map(str::to_owned)).collect()
    }

    /// Digest of the raw's attributes and of the checksums in the shards of its frames, without reading pixels.
    fn stamp(&self) -> Result<String, RawError> {
        let attributes = Value::Object(self.spec.attributes(super::SCHEMA, &self.attributes)).to_string();
        let frames = self.spec.all_shards().into_iter().filter(|shard| shard.frame.is_some());
        let shards = frames.map(|shard| {
            let (rows, columns) = self.spec.grid(shard.output);
            (self.spec.key(shard), rows * columns)
        });
        Ok(stamp(&self.store, &attributes, shards)?)
    }

    /// Checks all shards of the pyramid, if there is one; returns the bytes read and the defects.
    pub(super) fn check_pyramid(&self) -> Result<(u64, Vec<RawFinding>), RawError> {
        let key = format!("{PYRAMID_GROUP}/zarr.json");
        let stale = "the pyramid was made of pixels that have changed since; run `lenscube pyramid` again";
        match self.pyramid()? {
            PyramidState::None => return Ok((0, Vec::new())),
            PyramidState::Stale => {
                let finding = RawFinding { key, reason: Some(stale.into()), removable: false };
                return Ok((0, vec![finding]));
            }
            PyramidState::Unfinished(..) | PyramidState::Complete => {}
        }
        let (mut bytes, mut findings) = (0, Vec::new());
        for level in self.levels() {
            for shard in self.level_shards(&level) {
                let (rows, columns) = self.spec.shard_shape_of(level.size);
                let rect = self.spec.rect_of_shard(level.size, shard.1);
                let key = self.level_key(&level, shard);
                let (read, finding) = self.check_key(key, &self.counts, (rows, columns), rect.size())?;
                bytes += read;
                findings.extend(finding);
            }
        }
        Ok((bytes, findings))
    }
}

fn pyramid_group_of(stamp: &str) -> Value {
    group(json!({"schema": PYRAMID_SCHEMA, "raw_stamp": stamp}))
}
