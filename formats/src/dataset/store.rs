//! The files of a data set: created, continued, read back.

mod verify;

use std::io::Write;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::recipe::Layout;
use super::tar::Tar;
pub use super::zarr::ArraySpec;
use super::zarr::{group, shard};
use crate::durable::{
    AtomicFile, Batch, Directory, DurableError, Removal, Store, create_directories, fault_point, sweep,
};
pub use verify::Finding;

const RECORD: &str = "dataset.json";
const UNITS: &str = "units";
const ALL: &str = "samples.jsonl";
const ZARR: &str = "data.zarr";
const SCHEMA: &str = "lenscube/dataset-store/1";
/// Largest record and largest file of lines that are read, bytes.
const MAX_RECORD: u64 = 16 << 20;
const MAX_LINES: u64 = 1 << 30;
/// Digits of a unit's number and of a key.
const UNIT_DIGITS: usize = 6;
const KEY_DIGITS: usize = 9;

/// A data set that cannot be created or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DatasetError {
    /// A file or folder.
    #[error("{0}")]
    Storage(#[source] DurableError),
    /// Made by another recipe.
    #[error(
        "{} is a data set of another recipe, of other pictures or of another version of lenscube; give another OUT, or --overwrite to replace it", .path.display()
    )]
    OtherRecipe {
        /// The data set.
        path: PathBuf,
        /// Its recipe and program, for people.
        record: Map<String, Value>,
    },
    /// Fewer samples than there are.
    #[error(
        "{} has {found} samples, the recipe {expected}; more can be added, but none removed: give another OUT, or --overwrite to replace it", .path.display()
    )]
    Fewer {
        /// The data set.
        path: PathBuf,
        /// Its samples.
        found: u64,
        /// Those of the recipe.
        expected: u64,
    },
    /// Replaced or removed since it was opened.
    #[error("{} was replaced or removed by another process meanwhile: what this one made since is lost", .path.display())]
    Replaced {
        /// The data set.
        path: PathBuf,
    },
    /// No data set, or not only one.
    #[error("{}: {problem}", .path.display())]
    Foreign {
        /// The folder.
        path: PathBuf,
        /// What is there.
        problem: String,
    },
}

impl From<DurableError> for DatasetError {
    fn from(e: DurableError) -> Self {
        Self::Storage(e)
    }
}

/// What a data set is.
#[derive(Clone, Debug, PartialEq)]
pub struct DatasetSpec {
    /// Digest of all that determines its samples, their number excepted.
    pub digest: String,
    /// Number of samples.
    pub samples: u64,
    /// Samples of a unit.
    pub per_unit: u64,
    /// How samples are stored.
    pub layout: Layout,
    /// Its arrays, of a Zarr store.
    pub arrays: Vec<ArraySpec>,
    /// Attributes of the Zarr group.
    pub attributes: Map<String, Value>,
    /// The recipe and the program, for people.
    pub record: Map<String, Value>,
}

/// An item of a sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Item {
    /// Its name, that of an array in a Zarr store.
    pub name: String,
    /// Ending of its file.
    pub ending: &'static str,
    /// The file; of an array its little-endian samples.
    pub bytes: Vec<u8>,
}

/// A sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Its number.
    pub number: u64,
    /// All that made it, its labels, or its error.
    pub line: Map<String, Value>,
    /// Its items; none after an error.
    pub items: Vec<Item>,
}

/// A data set. It works through a handle on its folder: if another one replaces it at its path, nothing is written to the new one.
#[derive(Clone, Debug)]
pub struct DatasetStore {
    path: PathBuf,
    files: Directory,
    spec: DatasetSpec,
}

/// Key of a sample.
pub fn key(sample: u64) -> String {
    format!("{sample:0KEY_DIGITS$}")
}

fn lines_key(unit: u64) -> String {
    format!("{UNITS}/{unit:0UNIT_DIGITS$}.jsonl")
}

impl DatasetSpec {
    /// Number of units.
    pub fn units(&self) -> u64 {
        self.samples.div_ceil(self.per_unit)
    }

    /// Samples of `unit`.
    pub fn of_unit(&self, unit: u64) -> std::ops::Range<u64> {
        unit * self.per_unit..((unit + 1) * self.per_unit).min(self.samples)
    }

    /// Metadata of its Zarr store by key.
    fn metadata(&self) -> Vec<(String, Vec<u8>)> {
        if self.layout != Layout::Zarr {
            return Vec::new();
        }
        let of_array = |array: &ArraySpec| {
            let metadata = array.metadata(self.samples, self.per_unit);
            (format!("{ZARR}/{}/zarr.json", array.name), pretty(&metadata))
        };
        let mut all: Vec<_> = self.arrays.iter().map(of_array).collect();
        all.push((format!("{ZARR}/zarr.json"), pretty(&group(self.attributes.clone()))));
        all
    }

    /// Its record, with the digests of `metadata`.
    fn to_json(&self, metadata: &[(String, Vec<u8>)]) -> Value {
        let digest =
            |(key, bytes): &(String, Vec<u8>)| (key.clone(), blake3::hash(bytes).to_hex().as_str().into());
        let arrays =
            self.arrays.iter().map(|a| json!({"name": a.name, "shape": a.shape, "bytes": a.bytes()}));
        json!({
            "schema": SCHEMA,
            "digest": self.digest,
            "samples": self.samples,
            "samples_per_unit": self.per_unit,
            "as": self.layout,
            "arrays": arrays.collect::<Vec<Value>>(),
            "metadata": metadata.iter().map(digest).collect::<Map<String, Value>>(),
            "record": self.record,
        })
    }
}

/// Whether there is a data set at `path`.
///
/// # Errors
/// The folder cannot be read.
pub fn is_one(path: &Path) -> Result<bool, DatasetError> {
    Ok(Directory::new(path).size_of(RECORD)?.is_some())
}

impl DatasetStore {
    /// Creates the data set at `path`, or continues the one that is there.
    ///
    /// # Errors
    /// [`DatasetError`].
    pub fn create(path: &Path, spec: DatasetSpec) -> Result<Self, DatasetError> {
        let found = recorded(path)?;
        let mut old_samples = spec.samples;
        match found {
            Some(record) if record["digest"] != spec.digest.as_str() => {
                return Err(other_recipe(path, &record));
            }
            Some(record) => {
                old_samples = record["samples"].as_u64().unwrap_or(0);
                if old_samples > spec.samples {
                    let (found, expected) = (old_samples, spec.samples);
                    return Err(DatasetError::Fewer { path: path.into(), found, expected });
                }
            }
            None => {
                check_empty(path)?;
                create_directories(path, true)?;
            }
        }
        let store = Self { path: path.into(), files: opened(path)?, spec };
        // Of killed processes.
        sweep(path)?;
        let begun = store.begin(old_samples);
        store.check_in_place()?;
        begun.map(|()| store)
    }

    /// Removes what `old_samples` samples had and those of now have not, and writes the metadata and the record.
    fn begin(&self, old_samples: u64) -> Result<(), DatasetError> {
        if old_samples < self.spec.samples {
            // The last unit had fewer samples than it has now.
            self.files.remove(ALL)?;
            if !old_samples.is_multiple_of(self.spec.per_unit) {
                self.files.remove(&lines_key(old_samples / self.spec.per_unit))?;
            }
        }
        let metadata = self.spec.metadata();
        for (key, bytes) in &metadata {
            self.files.write(key, bytes)?;
        }
        Ok(self.files.write(RECORD, &pretty(&self.spec.to_json(&metadata)))?)
    }

    /// Fails if another data set is at its path, or none.
    fn check_in_place(&self) -> Result<(), DatasetError> {
        let is_own = |record: Option<Value>| record.is_some_and(|r| r["digest"] == self.spec.digest.as_str());
        match self.files.is_at(&self.path)? && is_own(recorded(&self.path)?) {
            true => Ok(()),
            false => Err(DatasetError::Replaced { path: self.path.clone() }),
        }
    }

    /// Fails where [`DatasetStore::create`] would, and changes nothing.
    ///
    /// # Errors
    /// [`DatasetError`].
    pub fn check(path: &Path, digest: &str) -> Result<(), DatasetError> {
        match recorded(path)? {
            Some(record) if record["digest"] != digest => Err(other_recipe(path, &record)),
            Some(_) => Ok(()),
            None => check_empty(path),
        }
    }

    /// Its folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What it is.
    pub fn spec(&self) -> &DatasetSpec {
        &self.spec
    }

    /// Whether `unit` is complete.
    ///
    /// # Errors
    /// [`DatasetError::Storage`].
    pub fn has(&self, unit: u64) -> Result<bool, DatasetError> {
        Ok(self.files.size_of(&lines_key(unit))?.is_some())
    }

    /// Writes a unit: its items, then its lines.
    ///
    /// # Errors
    /// [`DatasetError::Storage`]; [`DatasetError::Replaced`].
    ///
    /// # Panics
    /// The samples are not those of the unit, in order.
    pub fn write_unit(&self, unit: u64, samples: Vec<Sample>) -> Result<(), DatasetError> {
        assert!(samples.iter().map(|s| s.number).eq(self.spec.of_unit(unit)), "the samples of unit {unit}");
        let mut lines = String::new();
        for sample in &samples {
            let items: Map<String, Value> = sample.items.iter().map(item_record).collect();
            let mut line = Map::new();
            line.insert("sample".into(), sample.number.into());
            line.insert("key".into(), key(sample.number).into());
            line.extend(sample.line.clone());
            line.insert("items".into(), items.into());
            lines.push_str(&Value::from(line).to_string());
            lines.push('\n');
        }
        let written = self.write_items(unit, &samples, &lines).and_then(|()| {
            fault_point("unit-written");
            Ok(self.files.write(&lines_key(unit), lines.as_bytes())?)
        });
        // Of a data set that was replaced, that is the error.
        self.check_in_place()?;
        written
    }

    /// Writes the items of a unit, durably.
    fn write_items(&self, unit: u64, samples: &[Sample], lines: &str) -> Result<(), DatasetError> {
        let mut batch = Batch::new(self.files.clone());
        let mut stage = |name: &str, bytes: &[u8]| {
            if batch.is_due() {
                batch.commit()?;
            }
            batch.stage(name, 0, bytes)
        };
        match self.spec.layout {
            Layout::Folders => {
                for (sample, item) in samples.iter().flat_map(|s| s.items.iter().map(move |item| (s, item))) {
                    let name =
                        format!("{unit:0UNIT_DIGITS$}/{}.{}.{}", key(sample.number), item.name, item.ending);
                    stage(&name, &item.bytes)?;
                }
            }
            Layout::Tar => stage(&format!("{unit:0UNIT_DIGITS$}.tar"), &tar_of(samples, lines))?,
            Layout::Zarr => {
                for array in &self.spec.arrays {
                    let name = format!("{ZARR}/{}", array.key(unit));
                    stage(&name, &self.shard_of(array, samples, &name)?)?;
                }
            }
        }
        Ok(batch.commit()?)
    }

    /// The shard `name` of `array`.
    fn shard_of(&self, array: &ArraySpec, samples: &[Sample], name: &str) -> Result<Vec<u8>, DatasetError> {
        let of = |sample: &Sample| sample.items.iter().position(|item| item.name == array.name);
        let all: Vec<&[u8]> = samples.iter().map(|s| of(s).map_or(&[][..], |i| &s.items[i].bytes)).collect();
        let encoded = shard(&all, self.spec.per_unit);
        Ok(encoded.map_err(|e| DurableError::io("encode", &self.path.join(name), 0, e))?)
    }

    /// Joins the lines of all units, if all are complete; whether they are.
    ///
    /// # Errors
    /// [`DatasetError`].
    pub fn finish(&self) -> Result<bool, DatasetError> {
        for unit in 0..self.spec.units() {
            if !self.has(unit)? {
                return Ok(false);
            }
        }
        self.check_in_place()?;
        let path = self.path.join(ALL);
        let file = AtomicFile::create(&path)?;
        for unit in 0..self.spec.units() {
            let lines = self.lines(unit)?;
            file.writer().write_all(lines.as_bytes()).map_err(|e| DurableError::io("write", &path, 0, e))?;
        }
        self.check_in_place()?;
        file.finish()?;
        self.check_in_place().map(|()| true)
    }

    /// Lines of a complete unit.
    ///
    /// # Errors
    /// [`DatasetError`].
    pub fn lines(&self, unit: u64) -> Result<String, DatasetError> {
        let key = lines_key(unit);
        let foreign =
            |problem: &str| DatasetError::Foreign { path: self.path.join(&key), problem: problem.into() };
        let bytes = self.files.read_at_most(&key, MAX_LINES)?.ok_or_else(|| foreign("no such file"))?;
        String::from_utf8(bytes).map_err(|_| foreign("expected lines of JSON, found other bytes"))
    }

    /// Removes the data set at `path`.
    ///
    /// # Errors
    /// [`DatasetError::Foreign`] if there are other files.
    pub fn remove(path: &Path) -> Result<(), DatasetError> {
        if recorded(path)?.is_none() {
            let problem = "expected a data set, found none: it is not removed".into();
            return Err(DatasetError::Foreign { path: path.into(), problem });
        }
        let Some(store) = Store::at(path)?.opened()? else { return Ok(()) };
        match store.remove_all(Vec::new(), is_own)? {
            Removal::Foreign(names) => Err(DatasetError::Foreign {
                path: path.into(),
                problem: format!(
                    "it contains files of yours and is not removed, e.g. {}",
                    names.first().map_or("", String::as_str)
                ),
            }),
            _ => Ok(()),
        }
    }
}

/// The data set at `path`, whose record is that of another recipe.
fn other_recipe(path: &Path, record: &Value) -> DatasetError {
    let record = record["record"].as_object().cloned().unwrap_or_default();
    DatasetError::OtherRecipe { path: path.into(), record }
}

/// A handle on the folder of the data set at `path`.
fn opened(path: &Path) -> Result<Directory, DatasetError> {
    Directory::new(path).opened()?.ok_or_else(|| DatasetError::Replaced { path: path.into() })
}

/// The archive of the samples of a unit with their `lines`.
fn tar_of(samples: &[Sample], lines: &str) -> Vec<u8> {
    let mut tar = Tar::default();
    for (sample, line) in samples.iter().zip(lines.lines()).filter(|(sample, _)| !sample.items.is_empty()) {
        for item in &sample.items {
            tar.add(&format!("{}.{}.{}", key(sample.number), item.name, item.ending), &item.bytes);
        }
        tar.add(&format!("{}.json", key(sample.number)), line.as_bytes());
    }
    tar.finish()
}

/// Fails if there are files of others in the folder at `path`. Those that a data set has are of a process that creates it at the same time.
fn check_empty(path: &Path) -> Result<(), DatasetError> {
    let names = if path.exists() { Directory::new(path).names("")? } else { Vec::new() };
    match names.iter().find(|name| !is_own(name)) {
        None => Ok(()),
        Some(first) => {
            let problem = format!("expected a data set or an empty folder, found `{first}`");
            Err(DatasetError::Foreign { path: path.into(), problem })
        }
    }
}

/// Name of an item's file after the key, and its length and digest.
fn item_record(item: &Item) -> (String, Value) {
    let digest = blake3::hash(&item.bytes).to_hex().to_string();
    (format!("{}.{}", item.name, item.ending), json!({"bytes": item.bytes.len(), "blake3": digest}))
}

fn pretty(value: &Value) -> Vec<u8> {
    let mut text = serde_json::to_vec_pretty(value).expect("JSON of text keys");
    text.push(b'\n');
    text
}

/// The record of the data set at `path`; none if there is none.
fn recorded(path: &Path) -> Result<Option<Value>, DatasetError> {
    let Some(bytes) = Directory::new(path).read_at_most(RECORD, MAX_RECORD)? else { return Ok(None) };
    let record: Option<Value> = serde_json::from_slice(&bytes).ok();
    match record.filter(|r| r["schema"] == SCHEMA) {
        Some(record) => Ok(Some(record)),
        None => Err(DatasetError::Foreign {
            path: path.join(RECORD),
            problem: format!("expected a record of the schema {SCHEMA}, found another file"),
        }),
    }
}

/// Whether a key is one that a data set has.
fn is_own(key: &str) -> bool {
    let is_number =
        |text: &str, digits: usize| text.len() >= digits && text.bytes().all(|b| b.is_ascii_digit());
    if key.rsplit('/').next().is_some_and(crate::durable::is_temp_name) {
        return true;
    }
    let (first, rest) = key.split_once('/').unwrap_or((key, ""));
    match first {
        RECORD | ALL => rest.is_empty(),
        UNITS => rest.is_empty() || rest.strip_suffix(".jsonl").is_some_and(|n| is_number(n, UNIT_DIGITS)),
        ZARR => true,
        unit => {
            let number = unit.strip_suffix(".tar").unwrap_or(unit);
            let names = rest.is_empty() || is_number(rest.split('.').next().unwrap_or(""), KEY_DIGITS);
            is_number(number, UNIT_DIGITS) && names
        }
    }
}

#[cfg(test)]
mod tests;
