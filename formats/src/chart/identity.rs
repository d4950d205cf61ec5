//! Identity of a chart: digests of everything that determines its pixels, except its location.

use std::path::Path;

use serde_json::{Value, json};
use zarrs::array::{Array, ArrayMetadata};

use super::file_change::{ChunkFile, modified_ns};
use super::layout::Layout;
use super::store::ChartStore;
use crate::durable::{DurableError, Store};

/// Two BLAKE3 digests, 64 hexadecimal digits each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChartIdentity {
    /// Digest of [`ChartStore::description`] and of the name and size of every file with pixels of the array.
    pub content: String,
    /// Digest of the name and modification time (objects: ETag) of each of those files.
    pub mtimes: String,
}

impl ChartStore {
    /// JSON with sorted keys: the array's name in its store, its metadata (of the attributes those that change values: fill values,
    /// valid range, scale and offset), wavelengths, pitch, film size, units.
    pub fn description(&self) -> String {
        let mut description = json!({
            "name": self.layout.name,
            "values": self.layout.values.identity(),
            "array": canonical(&self.layout.array),
            "wavelengths_nm": self.wavelengths_nm,
            "pitch_um": self.pitch_um,
            "film_size": self.film_size.map(|s| [s.height, s.width]),
            "units": self.units,
        });
        if !self.layout.order.is_standard() {
            description["axes"] = json!(self.layout.order.to_string());
        }
        sorted(description).to_string()
    }

    /// The chart's identity. A copy of the chart has the same `content`, and a copy that preserves modification times the same `mtimes`;
    /// pixels changed within a file of the same size change `mtimes` only.
    ///
    /// # Errors
    /// [`DurableError`] if the files cannot be listed.
    pub fn identity(&self) -> Result<ChartIdentity, DurableError> {
        let mut files = self.chunk_files()?;
        files.sort();
        if let Store::Directory(_) = &*self.layout.store {
            self.file_states.record(&files);
        }
        let mut content = blake3::Hasher::new();
        content.update(b"lenscube/chart-identity/2\n");
        content.update(self.description().as_bytes());
        let mut mtimes = blake3::Hasher::new();
        mtimes.update(b"lenscube/chart-mtimes/1\n");
        for ChunkFile { key, bytes, version } in files {
            content.update(format!("\n{key}\t{bytes}").as_bytes());
            mtimes.update(format!("\n{key}\t{version}").as_bytes());
        }
        let hex = |hash: blake3::Hasher| hash.finalize().to_hex().to_string();
        Ok(ChartIdentity { content: hex(content), mtimes: hex(mtimes) })
    }

    /// The files with pixels of the array. A directory is listed; objects are looked up by the keys that the array may have.
    pub(super) fn chunk_files(&self) -> Result<Vec<ChunkFile>, DurableError> {
        let mut files = Vec::new();
        let objects = match &*self.layout.store {
            Store::Directory(_) => {
                list(&self.layout, &self.array_path(), "", &mut files)?;
                return Ok(files);
            }
            Store::Objects(objects) => objects,
        };
        let keys = self.layout.file_keys();
        let prefix = if self.layout.name.is_empty() { 0 } else { self.layout.name.len() + 1 };
        let found = std::iter::zip(&keys, objects.states(&keys)?);
        files.extend(found.filter_map(|(key, state)| {
            state.map(|s| ChunkFile { key: key[prefix..].to_owned(), bytes: s.size, version: s.tag })
        }));
        Ok(files)
    }
}

/// Lists the files with pixels below `directory`; other files (metadata, files of an operating system or an editor) are ignored.
fn list(
    layout: &Layout,
    directory: &Path,
    prefix: &str,
    files: &mut Vec<ChunkFile>,
) -> Result<(), DurableError> {
    let failed = |e| DurableError::io("list", directory, 0, e);
    for entry in std::fs::read_dir(directory).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let Ok(name) = entry.file_name().into_string() else { continue };
        let path = entry.path();
        let look_up = || std::fs::metadata(&path).map_err(|e| DurableError::io("look up", &path, 0, e));
        let key = format!("{prefix}{name}");
        if layout.is_file_key(&key) {
            let meta = look_up()?;
            if meta.is_file() {
                files.push(ChunkFile { key, bytes: meta.len(), version: modified_ns(&meta).to_string() });
                continue;
            }
        }
        // Directories of chunk keys are named `c` or by a number.
        if (name == "c" || name.bytes().all(|b| b.is_ascii_digit())) && look_up()?.is_dir() {
            list(layout, &path, &(key + "/"), files)?;
        }
    }
    Ok(())
}

/// The metadata of `array` without its attributes, as JSON with sorted keys.
fn canonical(array: &Array<Store>) -> Value {
    let mut v = match array.metadata() {
        ArrayMetadata::V3(m) => serde_json::to_value(m),
        ArrayMetadata::V2(m) => serde_json::to_value(m),
    }
    .unwrap_or_default();
    if let Value::Object(m) = &mut v {
        m.remove("attributes");
    }
    sorted(v)
}

/// `v` with the keys of every object sorted.
fn sorted(v: Value) -> Value {
    match v {
        Value::Object(m) => {
            let mut pairs: Vec<_> = m.into_iter().map(|(k, v)| (k, sorted(v))).collect();
            pairs.sort_by(|a, b| a.0.cmp(&b.0));
            Value::Object(pairs.into_iter().collect())
        }
        Value::Array(a) => Value::Array(a.into_iter().map(sorted).collect()),
        other => other,
    }
}
