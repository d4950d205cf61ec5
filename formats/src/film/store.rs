//! Creating, opening and removing films.

use std::path::Path;

use serde_json::{Map, Value};

use super::spec::FilmSpec;
use crate::group::{GroupError, GroupKind, JobGroup};
use crate::shard::ShardEncoder;

/// A film on disk. Shards may be encoded and committed on many threads.
#[derive(Debug)]
pub struct FilmStore {
    pub(super) group: JobGroup,
    pub(super) spec: FilmSpec,
    pub(super) provenance: Map<String, Value>,
    pub(super) encoder: ShardEncoder,
}

impl FilmStore {
    /// Creates an empty film at `path` with `provenance` among its attributes. `fsync: false` is faster, but a power failure may lose
    /// committed shards.
    ///
    /// # Errors
    /// [`GroupError::Exists`] if something exists at `path`; [`GroupError`] if the spec is invalid or files cannot be written.
    pub fn create(
        path: &Path,
        spec: FilmSpec,
        provenance: Map<String, Value>,
        fsync: bool,
    ) -> Result<Self, GroupError> {
        spec.check()?;
        let attributes = spec.attributes(&provenance);
        let group = JobGroup::create(GroupKind::Film, path, spec.derived(), attributes, fsync)?;
        Self::new(group, spec, provenance)
    }

    /// Opens the film at `path`.
    ///
    /// # Errors
    /// [`GroupError::NotOfKind`] if there is none; [`GroupError::Damaged`] or [`GroupError::ArrayMetadata`] if its metadata are inconsistent.
    pub fn open(path: &Path, fsync: bool) -> Result<Self, GroupError> {
        let film = Self::open_to_verify(path, fsync)?;
        film.group.check_arrays(&film.spec.arrays())?;
        Ok(film)
    }

    /// As [`FilmStore::open`], with any metadata of the arrays: [`FilmStore::verify`] checks them.
    ///
    /// # Errors
    /// As [`FilmStore::open`].
    pub fn open_to_verify(path: &Path, fsync: bool) -> Result<Self, GroupError> {
        let (group, attributes) = JobGroup::open(GroupKind::Film, path, fsync)?;
        let (spec, provenance) = FilmSpec::from_attributes(path, attributes)?;
        Self::new(group, spec, provenance)
    }

    fn new(group: JobGroup, spec: FilmSpec, provenance: Map<String, Value>) -> Result<Self, GroupError> {
        let encoder = ShardEncoder::new(spec.codec, spec.sample, spec.chunk, spec.keep_bits)
            .map_err(|e| GroupError::Codec { reason: e.to_string() })?;
        Ok(Self { group, spec, provenance, encoder })
    }

    /// Removes the film at `path`, if there is one. A symbolic link at `path` stays.
    ///
    /// # Errors
    /// [`GroupError::NotOfKind`] for anything but a film of this program; [`GroupError::Foreign`] if the film's directory contains other
    /// files; [`GroupError::Recreated`] if another run replaced it meanwhile. Nothing is removed then.
    pub fn remove(path: &Path) -> Result<(), GroupError> {
        JobGroup::remove(GroupKind::Film, path, |attributes| {
            let Ok((spec, _)) = FilmSpec::from_attributes(path, attributes) else {
                return Default::default();
            };
            let invented = spec.all_shards().filter(|_| spec.has_invented);
            let invented = invented.map(|(o, b, s)| spec.invented_key(o, b, s)).chain(spec.layer_keys());
            let shards = spec.all_shards().map(|(o, b, s)| spec.key(o, b, s)).chain(invented).collect();
            let coordinates = spec.coordinates().into_iter().map(|(name, _)| name);
            (shards, spec.arrays().into_iter().map(|(name, _)| name).chain(coordinates).collect())
        })
    }

    /// The same film with another [`crate::durable::Directory`], with injected faults.
    #[cfg(test)]
    pub(crate) fn with_directory(
        mut self,
        change: impl FnOnce(crate::durable::Directory) -> crate::durable::Directory,
    ) -> Self {
        use crate::durable::Store;
        self.group.store = match self.group.store {
            Store::Directory(directory) => Store::Directory(change(directory)),
            Store::Objects(_) => unreachable!("tests of a directory"),
        };
        self
    }

    /// The film's files: lock, records, whether it is still at its path.
    pub fn group(&self) -> &JobGroup {
        &self.group
    }

    /// Path or URL of the film.
    pub fn path(&self) -> &Path {
        self.group.path()
    }

    /// Layout of the film.
    pub fn spec(&self) -> &FilmSpec {
        &self.spec
    }

    /// Attribute `provenance`.
    pub fn provenance(&self) -> &Map<String, Value> {
        &self.provenance
    }
}
