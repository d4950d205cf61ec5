//! A film's pyramid: smaller and smaller films of the same light, so that programs show all of it without reading all of it.
//!
//!   level n (i, j) = mean of the finite ones of level n−1 (2i, 2j), (2i, 2j+1), (2i+1, 2j), (2i+1, 2j+1);  NaN if there is none
//! Level 0 is the film's own array, which stays as it is; sides are halved, odd ones rounded up (the last pixel then is the
//! mean of what there is), until both are at most 256. Level n is made of level n−1 as stored, so that what is there
//! already need not be made again and a pyramid has the same bytes however often it was interrupted.
//!
//! Layout: OME-Zarr 0.5 (ngff.openmicroscopy.org/0.5), one entry of `multiscales` for each array of the film, in the attributes of the
//! film's own group. Levels lie in `pyramid/<array>/<n>`, not in the film's group itself: xarray takes a group's arrays for
//! one dataset, in which `y` has one length. The group's `zarr.json` is written last: other programs see a whole pyramid or
//! none. `pyramid/zarr.json` keeps a STAMP of the film it was made of: what the film says of itself, and of every shard its
//! size, the table of its chunks and the checksum of its last chunk. A film with another stamp has no pyramid, but a stale one.

mod halve;
mod make;
mod ome;
#[cfg(test)]
mod tests;

use pipeline::geometry::{Rect, Size};
use serde_json::{Map, Value, json};

pub use halve::halve;

use super::{FilmError, FilmStore, Finding, SCHEMA, json};

/// What marks a group as a pyramid of ours.
const PYRAMID: &str = "lenscube/pyramid/1";
/// The group that holds the levels.
const PLACE: &str = "pyramid";
/// Both sides of the last level are at most this.
const SMALLEST: usize = 256;

/// What is there of a film's pyramid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PyramidState {
    /// Nothing.
    None,
    /// Begun and not ended: shards done, and in all.
    Unfinished(usize, usize),
    /// Made of other pixels than the film has now.
    Stale,
    /// All of it.
    Complete,
}

impl PyramidState {
    /// In one word.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Unfinished(..) => "unfinished",
            Self::Stale => "stale",
            Self::Complete => "complete",
        }
    }
}

/// Sizes of an image's levels, itself first.
pub fn level_sizes(size: Size) -> Vec<Size> {
    let half = |s: &Size| {
        let further = s.height.max(s.width) > SMALLEST;
        further.then(|| Size::new(s.height.div_ceil(2), s.width.div_ceil(2)))
    };
    std::iter::successors(Some(size), half).collect()
}

/// One level beyond the film itself.
#[derive(Clone, Copy, Debug)]
struct Level {
    output: usize,
    number: usize,
    size: Size,
    shard: (usize, usize),
}

impl Level {
    /// Shards (down, across).
    fn shards(&self) -> (usize, usize) {
        (self.size.height.div_ceil(self.shard.0), self.size.width.div_ceil(self.shard.1))
    }

    /// Pixels of a shard.
    fn rect(&self, (i, j): (usize, usize)) -> Rect {
        let (h, w) = self.shard;
        Rect::new((i * h) as i64, (j * w) as i64, h, w).intersect(self.size.rect())
    }

    /// Every shard: band, (row, column).
    fn every_shard(&self, bands: usize) -> impl Iterator<Item = (usize, (usize, usize))> + use<> {
        let (down, across) = self.shards();
        (0..bands).flat_map(move |b| (0..down).flat_map(move |i| (0..across).map(move |j| (b, (i, j)))))
    }
}

impl FilmStore {
    /// Path in the film of an output's level, 0 being the output itself.
    pub fn level_path(&self, output: usize, level: usize) -> String {
        let name = &self.spec.outputs[output].name;
        if level == 0 { name.clone() } else { format!("{PLACE}/{name}/{level}") }
    }

    /// What is there of its pyramid.
    ///
    /// # Errors
    /// [`FilmError::Storage`] if the store does not answer.
    pub fn pyramid(&self) -> Result<PyramidState, FilmError> {
        let group = json(&self.store, "zarr.json")?.unwrap_or_default();
        let Some(own) = json(&self.store, &format!("{PLACE}/zarr.json"))? else {
            let told = group["attributes"].get("ome").is_some();
            return Ok(if told { PyramidState::Stale } else { PyramidState::None });
        };
        if own != self.pyramid_group(&self.stamp()?) {
            return Ok(PyramidState::Stale);
        }
        for (key, metadata) in self.pyramid_metadata() {
            if json(&self.store, &format!("{key}/zarr.json"))?.as_ref() != Some(&metadata) {
                return Ok(PyramidState::Stale);
            }
        }
        let (mut done, mut all) = (0, 0);
        for level in self.levels() {
            for (band, shard) in level.every_shard(self.spec.wavelengths_nm.len()) {
                all += 1;
                done += usize::from(self.store.size_of(&self.level_key(&level, band, shard))?.is_some());
            }
        }
        let told = self.tells_pyramid(&group, &own);
        Ok(if told && done == all { PyramidState::Complete } else { PyramidState::Unfinished(done, all) })
    }

    /// Shards of the levels beyond the film itself.
    pub fn pyramid_shards(&self) -> usize {
        let of = |l: &Level| l.shards().0 * l.shards().1 * self.spec.wavelengths_nm.len();
        self.levels().iter().map(of).sum()
    }

    /// Shape and pixels of a level's shard `key`.
    pub(super) fn level_shard_named(&self, key: &str) -> Option<((usize, usize), Rect)> {
        let bands = self.spec.wavelengths_nm.len();
        self.levels().into_iter().find_map(|level| {
            let mut all = level.every_shard(bands);
            let (_, shard) = all.find(|&(band, shard)| self.level_key(&level, band, shard) == key)?;
            Some((level.shard, level.rect(shard)))
        })
    }

    /// The levels beyond the film itself, of all outputs, in the order in which they are made.
    fn levels(&self) -> Vec<Level> {
        let of = |output: usize| {
            let sizes = level_sizes(self.spec.outputs[output].rect.size());
            let level = move |(number, size)| Level { output, number, size, shard: self.spec.shard_of(size) };
            sizes.into_iter().enumerate().skip(1).map(level)
        };
        (0..self.spec.outputs.len()).flat_map(of).collect()
    }

    fn level_key(&self, level: &Level, band: usize, (i, j): (usize, usize)) -> String {
        format!("{}/c/{band}/{i}/{j}", self.level_path(level.output, level.number))
    }

    /// Metadata of the groups and arrays below the pyramid's own group, by path.
    fn pyramid_metadata(&self) -> Vec<(String, Value)> {
        let mut all = Vec::new();
        for level in self.levels() {
            let output = &self.spec.outputs[level.output];
            if level.number == 1 {
                all.push((format!("{PLACE}/{}", output.name), group(json!({}))));
            }
            all.push((self.level_path(level.output, level.number), self.spec.array_of(output, level.size)));
        }
        all
    }

    /// Every key that a pyramid of this film may have, below its own group.
    fn pyramid_keys(&self) -> Vec<String> {
        let bands = self.spec.wavelengths_nm.len();
        let metadata = self.pyramid_metadata().into_iter().map(|(key, _)| format!("{key}/zarr.json"));
        let levels = self.levels();
        let shards = levels.iter().flat_map(|level| {
            level.every_shard(bands).map(move |(band, shard)| self.level_key(level, band, shard))
        });
        let below = format!("{PLACE}/");
        metadata.chain(shards).filter_map(|key| key.strip_prefix(&below).map(str::to_owned)).collect()
    }

    fn pyramid_group(&self, stamp: &str) -> Value {
        group(json!({"schema": PYRAMID, "film_stamp": stamp}))
    }

    /// Whether the film's own metadata tell of all of the pyramid.
    fn tells_pyramid(&self, group: &Value, own: &Value) -> bool {
        let copies = &group["consolidated_metadata"]["metadata"];
        let all = self.pyramid_metadata();
        group["attributes"].get("ome").is_some()
            && copies.get(PLACE) == Some(own)
            && all.iter().all(|(key, metadata)| copies.get(key) == Some(metadata))
    }

    /// What the film is, without reading its pixels; see the head of this file.
    fn stamp(&self) -> Result<String, FilmError> {
        let mut hash = blake3::Hasher::new();
        hash.update(self.spec.attributes(SCHEMA, &self.provenance).to_string().as_bytes());
        for (output, band, shard) in self.every_shard() {
            let key = self.key(output, band, shard);
            let (sh, sw) = self.spec.shard_shape(output);
            let chunks = (sh / self.spec.chunk) * (sw / self.spec.chunk);
            // The table's (offset, length) pairs and its checksum, and before them the last chunk's checksum.
            let tail = (chunks * 16 + 8) as u64;
            let size = self.store.size_of(&key)?.unwrap_or(0);
            let tail = tail.min(size);
            let bytes = match tail {
                0 => None,
                _ => self.store.read_range(&key, -(tail as i64), tail)?,
            };
            hash.update(key.as_bytes());
            hash.update(&size.to_le_bytes());
            hash.update(&bytes.unwrap_or_default());
        }
        Ok(hash.finalize().to_hex().to_string())
    }

    /// What is wrong with the pyramid, if there is one; all its shards are read.
    pub(super) fn check_pyramid(&self) -> Result<(u64, Vec<Finding>), FilmError> {
        let mut findings = Vec::new();
        let place = format!("{PLACE}/zarr.json");
        let mut wrong = |reason: &str| {
            findings.push(Finding::Metadata { key: place.clone(), reason: reason.into() });
        };
        match self.pyramid()? {
            PyramidState::None => return Ok((0, findings)),
            PyramidState::Stale => {
                wrong(
                    "the pyramid was made of other pixels than the film has; `lenscube pyramid` makes it anew",
                );
                return Ok((0, findings));
            }
            PyramidState::Unfinished(done, all) if done == all => {
                wrong("the film's group does not tell of the pyramid; `lenscube pyramid` ends it");
            }
            PyramidState::Unfinished(..) | PyramidState::Complete => {}
        }
        let mut bytes = 0;
        for level in self.levels() {
            for (band, shard) in level.every_shard(self.spec.wavelengths_nm.len()) {
                let (rect, key) = (level.rect(shard), self.level_key(&level, band, shard));
                let (read, finding) = self.check_file(key, level.shard, rect)?;
                bytes += read;
                findings.extend(finding);
            }
        }
        Ok((bytes, findings))
    }
}

fn group(attributes: Value) -> Value {
    json!({"zarr_format": 3, "node_type": "group", "attributes": attributes})
}

/// The film's own metadata with `ome` and the pyramid's members, or without them.
fn film_group(mut group: Value, ome: Option<Value>, members: Vec<(String, Value)>) -> Value {
    if let Some(attributes) = group["attributes"].as_object_mut() {
        attributes.shift_remove("ome");
        attributes.extend(ome.map(|ome| ("ome".to_owned(), ome)));
    }
    if let Some(copies) = group["consolidated_metadata"]["metadata"].as_object_mut() {
        let below = format!("{PLACE}/");
        let kept: Map<String, Value> = std::mem::take(copies)
            .into_iter()
            .filter(|(key, _)| key != PLACE && !key.starts_with(&below))
            .chain(members)
            .collect();
        *copies = kept;
    }
    group
}
