//! The film: what the lens throws, shard by shard, in a Zarr v3 group that other programs open as it is.
//!
//! Arrays (wavelength, y, x): `film`, or `roi_0`, `roi_1`, … for windows of it, with coordinates `wavelength` in nm and
//! `y`, `x` (`roi_0_y`, …) in mm from the optical axis, y down. Fill value NaN. A shard is one file, absent or whole:
//! present means done. [`FilmStore::create`] makes all metadata at once and in one rename, so a killed creation leaves
//! no film; the pixels of a shard follow from nothing but their values and the layout, so runs can be compared by file.

mod engines;
mod error;
mod pyramid;
mod spec;
mod verify;

use std::path::{Path, PathBuf};

use bytes::Bytes;
use pipeline::geometry::Rect;
use serde_json::{Map, Value};

pub use crate::shard::{Codec, SampleType};
pub use error::FilmError;
pub use pyramid::{PyramidState, halve, level_sizes};
pub use spec::{FilmOutput, FilmSpec};
pub use verify::{Finding, Verdict};

use crate::durable::{Directory, DurableError, Lock, LockError, Owner, Store, Sweep, is_url};
use crate::hierarchy::NewGroup;
use crate::shard::{ShardEncoder, ShardError};

/// What marks a group as a film of ours.
const SCHEMA: &str = "lenscube/film/1";
const LARGEST_METADATA: u64 = 64 << 20;

/// A film on disk. Encoding and committing may go on on many threads.
#[derive(Debug)]
pub struct FilmStore {
    store: Store,
    spec: FilmSpec,
    provenance: Map<String, Value>,
    encoder: ShardEncoder,
}

/// A shard ready to be committed.
#[derive(Debug)]
pub struct EncodedShard {
    key: String,
    bytes: Bytes,
}

impl EncodedShard {
    /// Its path in the film.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// Its bytes, all of them.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

impl FilmStore {
    /// Creates an empty film at `path`, its `provenance` among the attributes. `fsync: false` trades safety against a
    /// power cut for speed.
    ///
    /// # Errors
    /// [`FilmError::Exists`] if something is there; [`FilmError`] if the spec cannot be, or the files not be written.
    pub fn create(
        path: &Path,
        spec: FilmSpec,
        provenance: Map<String, Value>,
        fsync: bool,
    ) -> Result<Self, FilmError> {
        spec.check()?;
        let exists = || FilmError::Exists { path: path.into() };
        // A film that was not created to its end has no shards.
        let of = |name: &str| [format!("{name}/zarr.json"), format!("{name}/c/0")];
        let mut ours: Vec<String> = spec.coordinates().iter().flat_map(|(name, _)| of(name)).collect();
        ours.extend(spec.outputs.iter().map(|output| format!("{}/zarr.json", output.name)));
        let mut group =
            NewGroup::begin(path, fsync, move |key| ours.iter().any(|k| k == key))?.ok_or_else(exists)?;
        for (name, coordinate) in spec.coordinates() {
            group.coordinate(&name, coordinate)?;
        }
        for output in &spec.outputs {
            group.array(&output.name, spec.array(output))?;
        }
        if !group.publish(spec.attributes(SCHEMA, &provenance))? {
            return Err(exists());
        }
        Self::with(Store::at(path)?.with_fsync(fsync), spec, provenance)
    }

    /// Opens the film at `path`, to go on with it or to look at it.
    ///
    /// # Errors
    /// [`FilmError::NotFilm`] if there is none; [`FilmError::Damaged`] if its metadata contradict each other.
    pub fn open(path: &Path, fsync: bool) -> Result<Self, FilmError> {
        let store = Store::at(path)?;
        let attributes = film_attributes(&store)?;
        let (spec, provenance) = FilmSpec::from_attributes(path, attributes)?;
        for output in &spec.outputs {
            let key = format!("{}/zarr.json", output.name);
            let found = json(&store, &key)?;
            if found.as_ref() != Some(&spec.array(output)) {
                return Err(FilmError::Damaged {
                    path: path.join(key),
                    expected: "the metadata of its film's layout",
                });
            }
        }
        Self::with(store.with_fsync(fsync), spec, provenance)
    }

    fn with(store: Store, spec: FilmSpec, provenance: Map<String, Value>) -> Result<Self, FilmError> {
        let encoder = ShardEncoder::new(spec.codec, spec.sample, spec.chunk)
            .map_err(|e| FilmError::Codec { reason: e.to_string() })?;
        Ok(Self { store, spec, provenance, encoder })
    }

    /// The same film over another directory object, for tests that make writes fail.
    pub fn with_directory(mut self, change: impl FnOnce(Directory) -> Directory) -> Self {
        self.store = match self.store {
            Store::Directory(directory) => Store::Directory(change(directory)),
            Store::Objects(_) => unreachable!("tests of a directory"),
        };
        self
    }

    /// Removes the film at `path` with all its pixels; nothing there is fine.
    ///
    /// # Errors
    /// [`FilmError::NotFilm`] for anything but a film of this program.
    pub fn remove_film(path: &Path) -> Result<(), FilmError> {
        let store = Store::at(path)?;
        if !store.exists()? {
            return Ok(());
        }
        let attributes = film_attributes(&store)?;
        let film = FilmSpec::from_attributes(path, attributes)
            .and_then(|(spec, p)| Self::with(store.clone(), spec, p));
        // One whose layout cannot be read has no shards that anybody could count.
        let known =
            film.map_or_else(|_| Vec::new(), |f| f.every_shard().map(|(o, b, s)| f.key(o, b, s)).collect());
        Ok(store.remove_all(known)?)
    }

    /// Shards of the film at `path` to write at once: enough to keep a disk busy, or to hide the way to a store and back, some
    /// 0.2 s for 10 MB.
    pub fn writers(path: &Path) -> usize {
        if is_url(path) { 6 } else { 2 }
    }

    /// Where it lies.
    pub fn path(&self) -> &Path {
        self.store.root()
    }

    /// What it is.
    pub fn spec(&self) -> &FilmSpec {
        &self.spec
    }

    /// How it came to be, as the caller told.
    pub fn provenance(&self) -> &Map<String, Value> {
        &self.provenance
    }

    /// Removes what dead processes of this host left in it.
    ///
    /// # Errors
    /// [`FilmError::Storage`] if it cannot be listed, or files not removed.
    pub fn sweep(&self) -> Result<Sweep, FilmError> {
        Ok(self.store.sweep()?)
    }

    /// Shards (down, across) of output `output`.
    pub fn shards(&self, output: usize) -> (usize, usize) {
        let (sh, sw) = self.spec.shard_shape(output);
        let rect = self.spec.outputs[output].rect;
        (rect.height.div_ceil(sh), rect.width.div_ceil(sw))
    }

    /// Pixels of the film in shard (`sy`, `sx`) of `output`, in film coordinates.
    pub fn shard_rect(&self, output: usize, (sy, sx): (usize, usize)) -> Rect {
        let (sh, sw) = self.spec.shard_shape(output);
        let rect = self.spec.outputs[output].rect;
        Rect::new(rect.y + (sy * sh) as i64, rect.x + (sx * sw) as i64, sh, sw).intersect(rect)
    }

    /// Every shard of the film: output, band, (row, column).
    pub fn every_shard(&self) -> impl Iterator<Item = (usize, usize, (usize, usize))> + '_ {
        let of = |output: usize| {
            let (down, across) = self.shards(output);
            (0..self.spec.wavelengths_nm.len()).flat_map(move |band| {
                (0..down).flat_map(move |i| (0..across).map(move |j| (output, band, (i, j))))
            })
        };
        (0..self.spec.outputs.len()).flat_map(of)
    }

    /// Path of a shard in the film.
    pub fn key(&self, output: usize, band: usize, (sy, sx): (usize, usize)) -> String {
        format!("{}/c/{band}/{sy}/{sx}", self.spec.outputs[output].name)
    }

    /// Whether the shard is there, and so done.
    ///
    /// # Errors
    /// [`FilmError::Storage`] if the file system does not answer.
    pub fn shard_present(
        &self,
        output: usize,
        band: usize,
        shard: (usize, usize),
    ) -> Result<bool, FilmError> {
        Ok(self.shard_bytes(output, band, shard)?.is_some())
    }

    /// Encodes a shard, `data` being its pixels inside the film ([`FilmStore::shard_rect`]) row by row. Works on the
    /// calling thread only; the same pixels give the same bytes.
    ///
    /// # Errors
    /// [`FilmError::NotFinite`] for a value that is no number, [`FilmError::Overflow`] for one that f16 cannot hold; [`FilmError::Request`] for a shard that is not there or
    /// `data` of another length.
    pub fn encode_shard(
        &self,
        output: usize,
        band: usize,
        shard: (usize, usize),
        data: &[f32],
    ) -> Result<EncodedShard, FilmError> {
        let bands = self.spec.wavelengths_nm.len();
        let there = output < self.spec.outputs.len() && band < bands && {
            let (down, across) = self.shards(output);
            shard.0 < down && shard.1 < across
        };
        let rect = if there { self.shard_rect(output, shard) } else { Rect::new(0, 0, 0, 0) };
        if !there || data.len() != rect.size().pixels() {
            return Err(FilmError::Request {
                output,
                band,
                shard,
                expected: rect.size().pixels(),
                found: data.len(),
            });
        }
        let (sh, sw) = self.spec.shard_shape(output);
        let grid = (sh / self.spec.chunk, sw / self.spec.chunk);
        let bytes = self.encoder.encode(data, (rect.height, rect.width), grid).map_err(|e| match e {
            ShardError::Overflow { row, column, value } => FilmError::Overflow {
                output: self.spec.outputs[output].name.clone(),
                band,
                row: rect.y + row as i64,
                column: rect.x + column as i64,
                value,
            },
            ShardError::NotFinite { row, column, value } => FilmError::NotFinite {
                shard: self.key(output, band, shard),
                band,
                row: rect.y + row as i64,
                column: rect.x + column as i64,
                value,
            },
            ShardError::Codec(reason) => FilmError::Codec { reason },
        })?;
        Ok(EncodedShard { key: self.key(output, band, shard), bytes: bytes.into() })
    }

    /// Writes a shard, durably and all at once; from then on it is present.
    ///
    /// # Errors
    /// [`FilmError::Storage`]; the shard then is as it was before.
    pub fn commit(&self, shard: &EncodedShard) -> Result<(), FilmError> {
        self.still_there()?;
        self.store
            .write(&shard.key, shard.bytes.clone())
            .map_err(|e| self.still_there().err().unwrap_or(e.into()))
    }

    /// Writes a file that is no part of the film's arrays, such as `runs/….json`.
    ///
    /// # Errors
    /// [`FilmError::Storage`].
    pub fn write_beside(&self, key: &str, bytes: &[u8]) -> Result<(), FilmError> {
        self.still_there()?;
        Ok(self.store.write(key, bytes.to_vec())?)
    }

    /// A film that was removed or unmounted meanwhile must not come back as shards without metadata.
    fn still_there(&self) -> Result<(), FilmError> {
        let there = match &self.store {
            Store::Directory(_) => self.store.size_of("zarr.json")?.is_some(),
            // Without locks another run may have removed the film and begun its own.
            Store::Objects(_) => match json(&self.store, "zarr.json")? {
                Some(group)
                    if digest(group["attributes"]["provenance"].as_object())
                        != digest(Some(&self.provenance)) =>
                {
                    return Err(FilmError::Replaced { path: self.path().into() });
                }
                group => group.is_some(),
            },
        };
        match there {
            true => Ok(()),
            false => {
                Err(DurableError::Vanished { path: self.path().into(), missing: "zarr.json".into() }.into())
            }
        }
    }

    /// Takes the lock of a unit of work on this film; see [`Lock`]. `None`: the store knows no locks.
    ///
    /// # Errors
    /// [`LockError`] if another has it.
    pub fn lock(&self, unit: &str, take_over: bool) -> Result<Option<Lock>, LockError> {
        self.store.lock("runs", unit, take_over)
    }

    /// The locks on the film at `path`, each with its owner and whether that one is dead, as far as can be known.
    ///
    /// # Errors
    /// [`FilmError::Storage`] if they cannot be read.
    #[allow(clippy::type_complexity, reason = "as `locks`")]
    pub fn locks(path: &Path) -> Result<Vec<(PathBuf, Option<Box<Owner>>, Option<bool>)>, FilmError> {
        Ok(Store::at(path)?.locks("runs")?)
    }

    /// What runs have left in `runs/*.json`, oldest first; files that are no JSON objects are passed over.
    ///
    /// # Errors
    /// [`FilmError::Storage`] if the records cannot be read.
    pub fn runs(&self) -> Result<Vec<Map<String, Value>>, FilmError> {
        let mut runs = Vec::new();
        for name in self.store.names("runs")?.into_iter().filter(|n| n.ends_with(".json")) {
            if let Some(Value::Object(run)) = json(&self.store, &format!("runs/{name}"))? {
                runs.push(run);
            }
        }
        runs.sort_by_key(|r| r.get("finished_unix_s").and_then(Value::as_u64));
        Ok(runs)
    }

    /// Bytes of a shard on the disk; `None` if it is not there.
    ///
    /// # Errors
    /// [`FilmError::Storage`] if the file system does not answer.
    pub fn shard_bytes(
        &self,
        output: usize,
        band: usize,
        shard: (usize, usize),
    ) -> Result<Option<u64>, FilmError> {
        Ok(self.store.size_of(&self.key(output, band, shard))?)
    }

    /// As [`FilmStore::shard_bytes`], of many shards, asked about at once where the way is long.
    ///
    /// # Errors
    /// As [`FilmStore::shard_bytes`].
    pub fn shards_bytes(
        &self,
        shards: &[(usize, usize, (usize, usize))],
    ) -> Result<Vec<Option<u64>>, FilmError> {
        let keys: Vec<String> = shards.iter().map(|&(o, b, s)| self.key(o, b, s)).collect();
        Ok(self.store.sizes_of(&keys)?)
    }

    /// Removes a shard; one that is not there is fine.
    ///
    /// # Errors
    /// [`FilmError::Storage`] if it cannot be removed.
    pub fn remove(&self, output: usize, band: usize, shard: (usize, usize)) -> Result<(), FilmError> {
        Ok(self.store.remove(&self.key(output, band, shard))?)
    }
}

/// What tells one job's film from another's.
fn digest(provenance: Option<&Map<String, Value>>) -> Option<&Value> {
    provenance?.get("job_digest")
}

fn json(store: &Store, key: &str) -> Result<Option<Value>, FilmError> {
    let bytes = store.read_at_most(key, LARGEST_METADATA)?;
    Ok(bytes.and_then(|b| serde_json::from_slice(&b).ok()))
}

fn film_attributes(store: &Store) -> Result<Map<String, Value>, FilmError> {
    let path = store.root();
    let not = |found: &str| FilmError::NotFilm { path: path.into(), found: found.into() };
    // Read first: a store far away says what is wrong only to those who read.
    let mut group = match json(store, "zarr.json")? {
        Some(group) => group,
        None if store.exists()? => return Err(not("no readable zarr.json")),
        None => return Err(not("nothing")),
    };
    match group.get("attributes").and_then(|a| a.get("schema")).and_then(Value::as_str) {
        Some(SCHEMA) => {}
        Some(other) => return Err(not(&format!("schema {other:?}"))),
        None => return Err(not("a Zarr node of another program")),
    }
    match group["attributes"].take() {
        Value::Object(m) => Ok(m),
        _ => Err(not("no attributes")),
    }
}

#[cfg(test)]
mod tests;
