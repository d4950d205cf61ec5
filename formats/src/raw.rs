//! The raw: digital numbers of a sensor, shard by shard, in a Zarr v3 group that other programs open as it is.
//!
//! Arrays `raw` (frame, y, x) of u16, or `roi_0`, `roi_1`, … for regions of it; coordinates `frame`, `y` and `x` (mm) (`roi_0_y`, …), `exposure_s`
//! (frame); optionally `signal` (y, x) f32, the electrons per second that every frame starts from. Shards (1, 2048, 2048), chunks of 512,
//! blosc zstd 1 with bit shuffle and crc32c. Digital numbers have no NaN: the fill value is 0, empty chunks are kept, so present means done.
//! `pyramid/` holds smaller levels on request ([`crate::pyramid`]). Creation, locks, replacement: [`crate::group`].

mod levels;
mod mosaic;
mod ome;
mod spec;

use std::path::Path;

use pipeline::geometry::Rect;
use serde_json::{Map, Value};

pub use mosaic::{Period, halve_mosaic, mosaic_below};
pub use spec::{RawShard, RawSpec, SIGNAL};

use crate::group::{GroupError, GroupKind, JobGroup, ShardFile, VerifyReport};
use crate::parallel::Progress;
use crate::shard::{Codec, SampleType, ShardEncoder, ShardError};

/// A raw on disk. Shards are encoded and committed on any number of threads.
#[derive(Debug)]
pub struct RawStore {
    group: JobGroup,
    spec: RawSpec,
    attributes: Map<String, Value>,
    counts: ShardEncoder,
    signal: ShardEncoder,
}

impl RawStore {
    /// Creates an empty raw at `path` with further `attributes`, among them `provenance` with `job_digest` and `layout_digest`.
    ///
    /// # Errors
    /// [`GroupError::Exists`] if something exists at `path`; [`GroupError`] if files cannot be written.
    pub fn create(
        path: &Path,
        spec: RawSpec,
        attributes: Map<String, Value>,
        fsync: bool,
    ) -> Result<Self, GroupError> {
        let all = Value::Object(spec.attributes(&attributes));
        let group = JobGroup::create(GroupKind::Raw, path, spec.derived(), all, fsync)?;
        Self::new(group, spec, attributes)
    }

    /// Opens the raw at `path`.
    ///
    /// # Errors
    /// [`GroupError::NotOfKind`] if there is none; [`GroupError::Damaged`] or [`GroupError::ArrayMetadata`] if its metadata are inconsistent.
    pub fn open(path: &Path, fsync: bool) -> Result<Self, GroupError> {
        let raw = Self::open_to_verify(path, fsync)?;
        raw.group.check_arrays(&raw.spec.arrays())?;
        Ok(raw)
    }

    /// As [`RawStore::open`], with any metadata of the arrays: [`RawStore::verify`] checks them.
    ///
    /// # Errors
    /// As [`RawStore::open`].
    pub fn open_to_verify(path: &Path, fsync: bool) -> Result<Self, GroupError> {
        let (group, attributes) = JobGroup::open(GroupKind::Raw, path, fsync)?;
        let (spec, attributes) = RawSpec::from_attributes(attributes)
            .ok_or_else(|| group.damaged("zarr.json", "the attributes of a raw"))?;
        Self::new(group, spec, attributes)
    }

    /// Whether a raw of this program is at `path`.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if the store cannot be read.
    pub fn is_one(path: &Path) -> Result<bool, GroupError> {
        match JobGroup::open(GroupKind::Raw, path, true) {
            Ok(_) => Ok(true),
            Err(GroupError::NotOfKind { .. }) => Ok(false),
            Err(e) => Err(e),
        }
    }

    fn new(group: JobGroup, spec: RawSpec, attributes: Map<String, Value>) -> Result<Self, GroupError> {
        let encoder = |sample| ShardEncoder::new(Codec::Zstd, sample, spec.chunk, None).map_err(codec_error);
        Ok(Self {
            counts: encoder(SampleType::U16)?,
            signal: encoder(SampleType::F32)?,
            group,
            spec,
            attributes,
        })
    }

    /// Removes the raw at `path`, if there is one. A symbolic link at `path` stays.
    ///
    /// # Errors
    /// [`GroupError::NotOfKind`] for anything but a raw of this program; [`GroupError::Foreign`] if the raw's directory contains other files;
    /// [`GroupError::Recreated`] if another run replaced it meanwhile. Nothing is removed then.
    pub fn remove(path: &Path) -> Result<(), GroupError> {
        JobGroup::remove(GroupKind::Raw, path, |attributes| {
            let spec = RawSpec::from_attributes(attributes).map(|(spec, _)| spec);
            let keys = |spec: RawSpec| spec.all_shards().into_iter().map(|s| spec.key(s)).collect();
            (spec.map(keys).unwrap_or_default(), Vec::new())
        })
    }

    /// The raw's files: lock, records, whether it is still at its path.
    pub fn group(&self) -> &JobGroup {
        &self.group
    }

    /// Path or URL of the raw.
    pub fn path(&self) -> &Path {
        self.group.path()
    }

    /// Layout of the raw.
    pub fn spec(&self) -> &RawSpec {
        &self.spec
    }

    /// Attributes except those of the layout: sensor, film, exposure, provenance.
    pub fn attributes(&self) -> &Map<String, Value> {
        &self.attributes
    }

    /// Those of `shards` that are missing.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if the store cannot be read.
    pub fn missing(&self, shards: &[RawShard]) -> Result<Vec<RawShard>, GroupError> {
        let keys: Vec<String> = shards.iter().map(|&s| self.spec.key(s)).collect();
        let found = self.group.store.sizes_of(&keys)?;
        Ok(std::iter::zip(shards, found).filter(|(_, size)| size.is_none()).map(|(s, _)| *s).collect())
    }

    /// Encodes and writes a shard of digital numbers, the pixels of [`RawSpec::shard_rect`] row by row. Returns the bytes written.
    ///
    /// # Errors
    /// [`GroupError::Storage`]; the shard is then unchanged. [`GroupError::Replaced`] or [`GroupError::Recreated`] if another raw has replaced
    /// this one.
    pub fn commit_counts(&self, shard: RawShard, data: &[u16]) -> Result<u64, GroupError> {
        let file = self.shard_file(shard);
        let size = (file.rect.height, file.rect.width);
        self.commit(&file, self.counts.encode_counts(data, size, self.counts.chunks_of(file.shape)))
    }

    /// As [`RawStore::commit_counts`], of the signal.
    ///
    /// # Errors
    /// As [`RawStore::commit_counts`].
    pub fn commit_signal(&self, shard: RawShard, data: &[f32]) -> Result<u64, GroupError> {
        let file = self.shard_file(shard);
        let size = (file.rect.height, file.rect.width);
        self.commit(&file, self.signal.encode(data, size, self.signal.chunks_of(file.shape)))
    }

    fn commit(&self, file: &ShardFile<'_>, bytes: Result<Vec<u8>, ShardError>) -> Result<u64, GroupError> {
        let bytes = bytes.map_err(codec_error)?;
        let size = bytes.len() as u64;
        self.group.commit(&file.key, bytes.into())?;
        Ok(size)
    }

    /// A shard, as it is stored.
    fn shard_file(&self, shard: RawShard) -> ShardFile<'_> {
        let grid = self.spec.shard_grid(shard.output);
        ShardFile {
            key: self.spec.key(shard),
            encoder: if shard.frame.is_some() { &self.counts } else { &self.signal },
            shape: grid.shard,
            rect: grid.shard_rect(shard.place.0, shard.place.1),
        }
    }

    /// Checks metadata, coordinates and every shard, of the raw and of its pyramid, on `threads` threads, each of which holds one shard;
    /// `progress` receives the numbers of shards of the raw done and in total.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if the store cannot be read. Defects of the raw are findings, not errors.
    pub fn verify(&self, threads: usize, progress: Progress<'_>) -> Result<VerifyReport, GroupError> {
        let files: Vec<_> = self.spec.all_shards().into_iter().map(|s| self.shard_file(s)).collect();
        let (bytes, of_shards) = self.group.check_files(&files, threads, progress)?;
        let of_metadata = self.group.check_derived(&self.spec.derived())?;
        let is_intact = of_shards.is_empty() && of_metadata.is_empty();
        let (level_bytes, of_levels) = self.pyramid().check(threads, is_intact)?;
        self.group.check_in_place()?;
        Ok(VerifyReport {
            shards: files.len(),
            bytes: bytes + level_bytes,
            findings: [of_metadata, of_shards, of_levels].concat(),
            temp: self.group.store.temp_files()?,
        })
    }

    /// Removes a shard (of the raw or its pyramid) that a check found to be bad, unless it is intact by now. Returns whether it did.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if it cannot be read or removed; as [`JobGroup::check_in_place`].
    pub fn remove_bad(&self, key: &str) -> Result<bool, GroupError> {
        let of_raw = self.spec.all_shards().into_iter().map(|s| self.shard_file(s));
        let mut files = of_raw.chain(self.pyramid().shard_files());
        files.find(|file| file.key == key).map_or(Ok(false), |file| self.group.remove_bad(&file))
    }

    /// Writes metadata or values of a coordinate again if `key` is a file that follows from the attributes, of the raw or its pyramid; whether
    /// it does.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if it cannot be written; as [`JobGroup::check_in_place`].
    pub fn restore(&self, key: &str) -> Result<bool, GroupError> {
        let of_raw = self.group.restore_derived(key, &self.spec.derived())?;
        Ok(self.pyramid().restore(key)? || of_raw)
    }

    /// Pixels of an output in sensor coordinates.
    pub fn rect(&self, output: usize) -> Rect {
        self.spec.outputs[output].rect
    }
}

fn codec_error(e: ShardError) -> GroupError {
    GroupError::Codec { reason: e.to_string() }
}

#[cfg(test)]
mod tests;
