//! The scene: chart, distances and coverages of the surfaces of a mesh as a pinhole at the lens's entrance pupil sees them, shard by shard, in a
//! Zarr v3 group that other programs open as it is.
//!
//! | array | shape, type | meaning |
//! |---|---|---|
//! | `weights` | (basis, y, x) f32, or f16 | radiance of band λ = Σ_b weights_b · S_b(λ); 0 where the coverage is 0 |
//! | `depth` | (y, x) f32 | distance along the axis in m; 0, without meaning, where the coverage is 0 |
//! | `coverage` | (y, x) f32 | share of the pixel that the surface covers, of what the surfaces before it leave |
//! | `object` | (y, x) u32 | optional: number of the object that is seen first + 1; 0 where there is none |
//! | `hidden/1/weights`, `hidden/1/depth`, `hidden/1/coverage`, … | the same | the surfaces behind, the nearest first |
//!
//! Coordinates `basis` (its number), `y` and `x` (mm on the ideal image plane, or with the attribute `film_projection` where the lens puts each direction on the film, [`pipeline::projection`]). Shards of 512 × 2048 px, chunks of 512, blosc zstd 1 with byte shuffle
//! and crc32c. The fill value is 0, of the first coverage 1; chunks of it are left out of their shard, whose file is always there: present means done.
//! A distance of [`FAR_M`] is infinity. Attributes `bases`, `illuminant` and `illuminance_lx` ([`SceneLight`]) give the spectra S_b; `focal_mm` is the distortion focal length of the lens. Creation, locks,
//! replacement: [`crate::group`].

mod bases;
mod spec;

use std::path::Path;

use serde_json::{Map, Value};

pub use bases::SceneLight;
pub use spec::{Plane, SceneShard, SceneSpec};

use crate::group::{GroupError, GroupKind, JobGroup, ShardFile, VerifyReport};
use crate::parallel::Progress;
use crate::shard::{Codec, SampleType, ShardEncoder, ShardError};

/// Distance of a surface at infinity, m: arrays hold finite numbers, and readers take 10⁶ m or more for infinity.
pub const FAR_M: f32 = 1e9;

/// Numbers of objects are smaller: their bits are those of a finite float.
const MAX_OBJECT: u32 = f32::MAX.to_bits();

/// The float whose bits are the number of the object `node` + 1; `None`: of no object.
pub fn object_bits(node: Option<u32>) -> f32 {
    f32::from_bits(node.map_or(0, |node| node.saturating_add(1).min(MAX_OBJECT)))
}

/// Encoders of a scene's arrays.
#[derive(Debug)]
struct Encoders {
    /// With fill value 0. Numbers of objects as well, as the floats of the same bits: encoded, their bytes are those of u32.
    zero: ShardEncoder,
    /// With fill value 1.
    one: ShardEncoder,
    weights: ShardEncoder,
}

/// A scene on disk. Shards are encoded and committed on any number of threads.
#[derive(Debug)]
pub struct SceneStore {
    group: JobGroup,
    spec: SceneSpec,
    attributes: Map<String, Value>,
    encoders: Encoders,
}

impl SceneStore {
    /// Creates an empty scene at `path` with further `attributes`, among them `provenance` with `job_digest` and `layout_digest`.
    ///
    /// # Errors
    /// [`GroupError::Exists`] if something exists at `path`; [`GroupError`] if files cannot be written.
    pub fn create(
        path: &Path,
        spec: SceneSpec,
        attributes: Map<String, Value>,
        fsync: bool,
    ) -> Result<Self, GroupError> {
        let all = Value::Object(spec.attributes(&attributes));
        let group = JobGroup::create(GroupKind::Scene, path, spec.derived(), all, fsync)?;
        Self::new(group, spec, attributes)
    }

    /// Opens the scene at `path`.
    ///
    /// # Errors
    /// [`GroupError::NotOfKind`] if there is none; [`GroupError::Damaged`] or [`GroupError::ArrayMetadata`] if its metadata are inconsistent.
    pub fn open(path: &Path, fsync: bool) -> Result<Self, GroupError> {
        let scene = Self::open_to_verify(path, fsync)?;
        scene.group.check_arrays(&scene.spec.nodes())?;
        Ok(scene)
    }

    /// As [`SceneStore::open`], with any metadata of the arrays: [`SceneStore::verify`] checks them.
    ///
    /// # Errors
    /// As [`SceneStore::open`].
    pub fn open_to_verify(path: &Path, fsync: bool) -> Result<Self, GroupError> {
        let (group, attributes) = JobGroup::open(GroupKind::Scene, path, fsync)?;
        let (spec, attributes) = SceneSpec::from_attributes(attributes)
            .ok_or_else(|| group.damaged("zarr.json", "the attributes of a scene"))?;
        Self::new(group, spec, attributes)
    }

    /// Whether a scene of this program is at `path`.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if the store cannot be read.
    pub fn is_one(path: &Path) -> Result<bool, GroupError> {
        match JobGroup::open(GroupKind::Scene, path, true) {
            Ok(_) => Ok(true),
            Err(GroupError::NotOfKind { .. }) => Ok(false),
            Err(e) => Err(e),
        }
    }

    fn new(group: JobGroup, spec: SceneSpec, attributes: Map<String, Value>) -> Result<Self, GroupError> {
        let encoder = |sample, fill| match ShardEncoder::new(Codec::Zstd, sample, spec.chunk, None) {
            Ok(encoder) => Ok(encoder.leaving_out(fill)),
            Err(e) => Err(GroupError::Codec { reason: e.to_string() }),
        };
        let encoders = Encoders {
            zero: encoder(SampleType::F32, 0.0)?,
            one: encoder(SampleType::F32, 1.0)?,
            weights: encoder(spec.weight_sample(), 0.0)?,
        };
        Ok(Self { encoders, group, spec, attributes })
    }

    /// Removes the scene at `path`, if there is one. A symbolic link at `path` stays.
    ///
    /// # Errors
    /// [`GroupError::NotOfKind`] for anything but a scene of this program; [`GroupError::Foreign`] if its directory contains other files;
    /// [`GroupError::Recreated`] if another run replaced it meanwhile. Nothing is removed then.
    pub fn remove(path: &Path) -> Result<(), GroupError> {
        JobGroup::remove(GroupKind::Scene, path, |attributes| {
            let spec = SceneSpec::from_attributes(attributes).map(|(spec, _)| spec);
            let keys = |spec: SceneSpec| spec.all_shards().map(|shard| shard.key()).collect();
            (spec.map(keys).unwrap_or_default(), Vec::new())
        })
    }

    /// The scene's files: lock, records, whether it is still at its path.
    pub fn group(&self) -> &JobGroup {
        &self.group
    }

    /// Path or URL of the scene.
    pub fn path(&self) -> &Path {
        self.group.path()
    }

    /// Layout of the scene.
    pub fn spec(&self) -> &SceneSpec {
        &self.spec
    }

    /// Attributes except those of the layout.
    pub fn attributes(&self) -> &Map<String, Value> {
        &self.attributes
    }

    /// Those of `shards` that are missing.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if the store cannot be read.
    pub fn missing(&self, shards: &[SceneShard]) -> Result<Vec<SceneShard>, GroupError> {
        let keys: Vec<String> = shards.iter().map(SceneShard::key).collect();
        let found = self.group.store.sizes_of(&keys)?;
        Ok(std::iter::zip(shards, found).filter(|(_, size)| size.is_none()).map(|(s, _)| *s).collect())
    }

    /// Encodes and writes a shard, whose rows ([`SceneSpec::shard_rect`]) `row` returns; of numbers of objects the floats of their bits ([`object_bits`]). Returns the bytes written.
    ///
    /// # Errors
    /// [`GroupError::Storage`]; the shard is then unchanged. [`GroupError::Replaced`] or [`GroupError::Recreated`] if another scene has replaced
    /// this one.
    pub fn commit<'a>(&self, shard: SceneShard, row: &dyn Fn(usize) -> &'a [f32]) -> Result<u64, GroupError> {
        let file = self.shard_file(shard);
        let size = (file.rect.height, file.rect.width);
        let bytes = file.encoder.encode_rows(row, size, file.encoder.chunks_of(file.shape));
        let bytes = bytes.map_err(|e| match e {
            ShardError::Overflow { .. } => {
                GroupError::Codec { reason: format!("{e}; make the scene without --half") }
            }
            e => GroupError::Codec { reason: e.to_string() },
        })?;
        let count = bytes.len() as u64;
        self.group.commit(&file.key, bytes.into())?;
        Ok(count)
    }

    /// A shard, as it is stored.
    fn shard_file(&self, shard: SceneShard) -> ShardFile<'_> {
        ShardFile {
            key: shard.key(),
            encoder: match shard.plane {
                Plane::Weight(_) => &self.encoders.weights,
                _ if shard.fill_value() == 1.0 => &self.encoders.one,
                _ => &self.encoders.zero,
            },
            shape: self.spec.shard_shape(),
            rect: self.spec.shard_rect(shard.place),
        }
    }

    /// Checks metadata, coordinates and every shard on `threads` threads, each of which holds one shard; `progress` receives the numbers of
    /// shards done and in total.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if the store cannot be read. Defects are findings, not errors.
    pub fn verify(&self, threads: usize, progress: Progress<'_>) -> Result<VerifyReport, GroupError> {
        let files: Vec<_> = self.spec.all_shards().map(|shard| self.shard_file(shard)).collect();
        let (bytes, of_shards) = self.group.check_files(&files, threads, progress)?;
        let of_metadata = self.group.check_derived(&self.spec.derived())?;
        self.group.check_in_place()?;
        Ok(VerifyReport {
            shards: files.len(),
            bytes,
            findings: [of_metadata, of_shards].concat(),
            temp: self.group.store.temp_files()?,
        })
    }

    /// Removes a shard that a check found to be bad, unless it is intact by now. Returns whether it did.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if it cannot be read or removed; as [`JobGroup::check_in_place`].
    pub fn remove_bad(&self, key: &str) -> Result<bool, GroupError> {
        let mut files = self.spec.all_shards().map(|shard| self.shard_file(shard));
        files.find(|file| file.key == key).map_or(Ok(false), |file| self.group.remove_bad(&file))
    }

    /// Writes metadata or values of a coordinate again if `key` is a file that follows from the attributes; whether it is.
    ///
    /// # Errors
    /// [`GroupError::Storage`] if it cannot be written; as [`JobGroup::check_in_place`].
    pub fn restore(&self, key: &str) -> Result<bool, GroupError> {
        self.group.restore_derived(key, &self.spec.derived())
    }
}

#[cfg(test)]
mod tests;
