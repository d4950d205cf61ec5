//! Creating and opening films.

use std::path::Path;

use serde_json::{Map, Value};

use super::error::FilmError;
use super::spec::FilmSpec;
use crate::durable::{Directory, DurableError, Store, Sweep};
use crate::hierarchy::NewGroup;
use crate::shard::ShardEncoder;

/// Attribute `schema` of a film.
pub(super) const SCHEMA: &str = "lenscube/film/1";
const MAX_METADATA_BYTES: u64 = 64 << 20;

/// A film on disk. Shards may be encoded and committed on many threads.
#[derive(Debug)]
pub struct FilmStore {
    pub(super) store: Store,
    pub(super) spec: FilmSpec,
    pub(super) provenance: Map<String, Value>,
    pub(super) encoder: ShardEncoder,
}

impl FilmStore {
    /// Creates an empty film at `path` with `provenance` among its attributes. `fsync: false` is faster, but a power failure may lose
    /// committed shards.
    ///
    /// # Errors
    /// [`FilmError::Exists`] if something exists at `path`; [`FilmError`] if the spec is invalid or files cannot be written.
    pub fn create(
        path: &Path,
        spec: FilmSpec,
        provenance: Map<String, Value>,
        fsync: bool,
    ) -> Result<Self, FilmError> {
        spec.check()?;
        let exists = || FilmError::Exists { path: path.into() };
        // Keys of a film whose creation did not finish: it has no shards.
        let keys = |name: &str| [format!("{name}/zarr.json"), format!("{name}/c/0")];
        let mut own_keys: Vec<String> = spec.coordinates().iter().flat_map(|(name, _)| keys(name)).collect();
        own_keys.extend(spec.outputs.iter().map(|output| format!("{}/zarr.json", output.name)));
        let mut group =
            NewGroup::begin(path, fsync, move |key| own_keys.iter().any(|k| k == key))?.ok_or_else(exists)?;
        for (name, coordinate) in spec.coordinates() {
            group.coordinate(&name, coordinate)?;
        }
        for output in &spec.outputs {
            group.array(&output.name, spec.array(output))?;
        }
        let vanished =
            || DurableError::StoreMissing { path: group.store.root().into(), missing: "directory".into() };
        let store = group.opened()?.ok_or_else(vanished)?;
        if !group.publish(spec.attributes(SCHEMA, &provenance))? {
            return Err(exists());
        }
        Self::new(store, spec, provenance)
    }

    /// Opens the film at `path`.
    ///
    /// # Errors
    /// [`FilmError::NotFilm`] if there is none; [`FilmError::Damaged`] if its metadata are inconsistent.
    pub fn open(path: &Path, fsync: bool) -> Result<Self, FilmError> {
        let store = open_store(path)?;
        let attributes = film_attributes(&store)?;
        let (spec, provenance) = FilmSpec::from_attributes(path, attributes)?;
        for output in &spec.outputs {
            let key = format!("{}/zarr.json", output.name);
            let found = read_json(&store, &key)?;
            if found.as_ref() != Some(&spec.array(output)) {
                return Err(FilmError::Damaged {
                    path: path.join(key),
                    expected: "the metadata of its film's layout",
                });
            }
        }
        Self::new(store.with_fsync(fsync), spec, provenance)
    }

    pub(super) fn new(
        store: Store,
        spec: FilmSpec,
        provenance: Map<String, Value>,
    ) -> Result<Self, FilmError> {
        let encoder = ShardEncoder::new(spec.codec, spec.sample, spec.chunk, spec.keep_bits)
            .map_err(|e| FilmError::Codec { reason: e.to_string() })?;
        Ok(Self { store, spec, provenance, encoder })
    }

    /// The same film with another [`Directory`], for tests with injected faults.
    pub fn with_directory(mut self, change: impl FnOnce(Directory) -> Directory) -> Self {
        self.store = match self.store {
            Store::Directory(directory) => Store::Directory(change(directory)),
            Store::Objects(_) => unreachable!("tests of a directory"),
        };
        self
    }

    /// Path or URL of the film.
    pub fn path(&self) -> &Path {
        self.store.root()
    }

    /// Layout of the film.
    pub fn spec(&self) -> &FilmSpec {
        &self.spec
    }

    /// Attribute `provenance`.
    pub fn provenance(&self) -> &Map<String, Value> {
        &self.provenance
    }

    /// Removes leftover temporary files of dead processes of this host.
    ///
    /// # Errors
    /// [`FilmError::Storage`] if the film cannot be listed or files cannot be removed.
    pub fn sweep(&self) -> Result<Sweep, FilmError> {
        Ok(self.store.sweep()?)
    }
}

/// Opens the store at `path`.
pub(super) fn open_store(path: &Path) -> Result<Store, FilmError> {
    let store = Store::at(path)?;
    let found = |exists| if exists { "no readable zarr.json" } else { "nothing" };
    match store.clone().opened()? {
        Some(open) => Ok(open),
        None => Err(FilmError::NotFilm { path: path.into(), found: found(store.exists()?).into() }),
    }
}

/// The JSON value of `key`; `None` if it does not exist or is no JSON.
pub(crate) fn read_json(store: &Store, key: &str) -> Result<Option<Value>, DurableError> {
    let bytes = store.read_at_most(key, MAX_METADATA_BYTES)?;
    Ok(bytes.and_then(|b| serde_json::from_slice(&b).ok()))
}

/// The group attributes of the film in `store`.
pub(super) fn film_attributes(store: &Store) -> Result<Map<String, Value>, FilmError> {
    let path = store.root();
    let not_film = |found: &str| FilmError::NotFilm { path: path.into(), found: found.into() };
    // Read before the query for existence: only reads report the store's error message.
    let mut group = match read_json(store, "zarr.json")? {
        Some(group) => group,
        None if store.exists()? => return Err(not_film("no readable zarr.json")),
        None => return Err(not_film("nothing")),
    };
    match group.get("attributes").and_then(|a| a.get("schema")).and_then(Value::as_str) {
        Some(SCHEMA) => {}
        Some(other) => return Err(not_film(&format!("schema {other:?}"))),
        None => return Err(not_film("a Zarr node of another program")),
    }
    match group["attributes"].take() {
        Value::Object(m) => Ok(m),
        _ => Err(not_film("no attributes")),
    }
}
