//! The film: what the lens throws, shard by shard, in a Zarr v3 group that other programs open as it is.
//!
//! Arrays (wavelength, y, x): `film`, or `roi_0`, `roi_1`, … for windows of it, with coordinates `wavelength` in nm and
//! `y`, `x` (`roi_0_y`, …) in mm from the optical axis, y down. Fill value NaN. A shard is one file, absent or whole:
//! present means done. [`FilmStore::create`] makes all metadata at once and in one rename, so a killed creation leaves
//! no film; the pixels of a shard follow from nothing but their values and the layout, so runs can be compared by file.
//!
//! A film that was opened stays that film. In a directory all is read and written through a handle on the directory that was
//! opened ([`Directory::opened`]): when another film takes its path (`--overwrite`), nothing of this one can reach the new one.
//! Every commit, and every lock once it is taken, compares the digests of job and layout at the path with those that
//! were opened ([`FilmStore::check_in_place`]). At a URL there are no handles and the comparison is all there is: between it
//! and the end of the put that follows, a film that is removed and begun anew there still gets the one object of that put,
//! and a lock does not exist. Two jobs must not share a URL at the same time.

mod contents;
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

use crate::durable::{
    Directory, DurableError, Lock, Owner, Removal, Store, Sweep, fault_point, is_url, link_target,
};
use crate::hierarchy::NewGroup;
use crate::shard::{ShardEncoder, ShardError};

/// What marks a group as a film of ours.
const SCHEMA: &str = "lenscube/film/1";
const MAX_METADATA: u64 = 64 << 20;

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
        let vanished =
            || DurableError::Vanished { path: group.store.root().into(), missing: "directory".into() };
        let store = group.opened()?.ok_or_else(vanished)?;
        if !group.publish(spec.attributes(SCHEMA, &provenance))? {
            return Err(exists());
        }
        Self::with(store, spec, provenance)
    }

    /// Opens the film at `path`, to go on with it or to look at it.
    ///
    /// # Errors
    /// [`FilmError::NotFilm`] if there is none; [`FilmError::Damaged`] if its metadata contradict each other.
    pub fn open(path: &Path, fsync: bool) -> Result<Self, FilmError> {
        let store = open_store(path)?;
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

    /// Removes the film at `path` with all its pixels; nothing there is fine. Where `path` is a link, it stays.
    ///
    /// # Errors
    /// [`FilmError::NotFilm`] for anything but a film of this program; [`FilmError::Foreign`] if the film's directory holds
    /// something that the film did not make; [`FilmError::Renewed`] if another run replaced it meanwhile. Nothing is removed then.
    pub fn remove_film(path: &Path) -> Result<(), FilmError> {
        let place = link_target(path);
        if !Store::at(&place)?.exists()? {
            return Ok(());
        }
        let store = open_store(&place)?;
        let attributes = film_attributes(&store)?;
        let film = FilmSpec::from_attributes(&place, attributes)
            .and_then(|(spec, p)| Self::with(store.clone(), spec, p));
        // One whose layout cannot be read has no shards that could be counted.
        let (known, arrays) = film.map_or_else(
            |_| (Vec::new(), Vec::new()),
            |film| {
                let known = film.every_shard().map(|(o, b, s)| film.key(o, b, s)).collect();
                let coordinates = film.spec.coordinates().into_iter().map(|(name, _)| name);
                (known, film.spec.outputs.iter().map(|o| o.name.clone()).chain(coordinates).collect())
            },
        );
        let own = move |key: &str| contents::is_own(&arrays, key);
        match store.remove_all(known, own)? {
            Removal::Done => Ok(()),
            Removal::Foreign(names) => Err(FilmError::Foreign { path: path.into(), names }),
            Removal::Replaced => Err(FilmError::Renewed { path: path.into() }),
        }
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
    /// [`FilmError::Storage`]; the shard then is as it was before. [`FilmError::Replaced`] or [`FilmError::Renewed`] if another
    /// film has taken its place; that one is as it was before.
    pub fn commit(&self, shard: &EncodedShard) -> Result<(), FilmError> {
        fault_point("commit");
        self.check_in_place()?;
        fault_point("commit-checked");
        self.in_place(self.store.write(&shard.key, shard.bytes.clone()))
    }

    /// Writes a file that is no part of the film's arrays, such as `runs/….json`.
    ///
    /// # Errors
    /// As [`FilmStore::commit`].
    pub fn write_beside(&self, key: &str, bytes: &[u8]) -> Result<(), FilmError> {
        self.check_in_place()?;
        self.in_place(self.store.write(key, bytes.to_vec()))
    }

    /// What a write gave; an error of a film that is gone says that it is gone.
    fn in_place<T>(&self, written: Result<T, DurableError>) -> Result<T, FilmError> {
        written.map_err(|e| self.check_in_place().err().unwrap_or(e.into()))
    }

    /// Fails unless this film still lies at its path: one that was removed or unmounted must not come back as shards without
    /// metadata, and one that was replaced by another job's must not get shards of this one.
    ///
    /// # Errors
    /// [`FilmError::Replaced`], [`FilmError::Renewed`]; [`DurableError::Vanished`] if no film is there;
    /// [`FilmError::Storage`] if the store does not answer.
    pub fn check_in_place(&self) -> Result<(), FilmError> {
        let in_place = self.store.is_in_place()?;
        let there = match in_place {
            true => json(&self.store, "zarr.json")?,
            false => json(&Store::at(self.path())?, "zarr.json")?,
        };
        let path = || self.path().into();
        match there {
            None => Err(DurableError::Vanished { path: path(), missing: "zarr.json".into() }.into()),
            Some(group)
                if identity(group["attributes"]["provenance"].as_object())
                    != identity(Some(&self.provenance)) =>
            {
                Err(FilmError::Replaced { path: path() })
            }
            Some(_) if in_place => Ok(()),
            Some(_) => Err(FilmError::Renewed { path: path() }),
        }
    }

    /// Takes the lock of a unit of work on this film; see [`Lock`]. `None`: the store knows no locks. A lock of another film
    /// that has taken its place meanwhile is released again.
    ///
    /// # Errors
    /// [`FilmError::Locked`] if another has it; as [`FilmStore::check_in_place`].
    pub fn lock(&self, unit: &str, take_over: bool) -> Result<Option<Lock>, FilmError> {
        self.check_in_place()?;
        let lock = self.store.lock("runs", unit, take_over);
        self.check_in_place()?;
        Ok(lock?)
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
    #[cfg(test)]
    fn remove(&self, output: usize, band: usize, shard: (usize, usize)) -> Result<(), FilmError> {
        Ok(self.store.remove(&self.key(output, band, shard))?)
    }
}

/// What distinguishes one job's film from another's: the digests of the job and of the layout of its files.
fn identity(provenance: Option<&Map<String, Value>>) -> [Option<&Value>; 2] {
    ["job_digest", "layout_digest"].map(|key| provenance?.get(key))
}

/// The store at `path`, held open.
fn open_store(path: &Path) -> Result<Store, FilmError> {
    let store = Store::at(path)?;
    let found = |exists| if exists { "no readable zarr.json" } else { "nothing" };
    match store.clone().opened()? {
        Some(open) => Ok(open),
        None => Err(FilmError::NotFilm { path: path.into(), found: found(store.exists()?).into() }),
    }
}

fn json(store: &Store, key: &str) -> Result<Option<Value>, FilmError> {
    let bytes = store.read_at_most(key, MAX_METADATA)?;
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
