//! Which chart this is: a digest of all that its pixels follow from, the place where it lies excepted.

use std::path::Path;

use serde_json::json;

use super::ChartStore;
use super::layout::Layout;
use super::open::{canonical, sorted};
use super::stamps::modified_ns;
use crate::durable::{DurableError, Store};

/// Two BLAKE3 digests, 64 hexadecimal digits each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChartIdentity {
    /// Of [`ChartStore::description`] and of the name and size of every chunk's or shard's file of the array.
    pub content: String,
    /// Of the name and time of last change of each of those files, or the ETag of each of those objects.
    pub mtimes: String,
}

impl ChartStore {
    /// What the chart is, as JSON with sorted keys: the array's name in its store and its metadata (of its attributes what
    /// changes values: fill values, valid range, scale and offset), wavelengths, pitch, film size, units.
    pub fn description(&self) -> String {
        sorted(json!({
            "name": self.layout.name,
            "values": self.layout.values.identity(),
            "array": canonical(&self.layout.array),
            "wavelengths_nm": self.wavelengths_nm,
            "pitch_um": self.pitch_um,
            "film_size": self.film_size.map(|s| [s.height, s.width]),
            "units": self.units,
        }))
        .to_string()
    }

    /// What the chart is, in two digests. A copy of the chart has the same `content`, and one that keeps the files' times the
    /// same `mtimes`; pixels changed within a file of the same size show in `mtimes` only.
    ///
    /// # Errors
    /// [`DurableError`] if the files cannot be listed.
    pub fn identity(&self) -> Result<ChartIdentity, DurableError> {
        let mut files = self.chunks()?;
        files.sort();
        if let Store::Directory(_) = &*self.layout.store {
            self.stamps.keep(&files);
        }
        let mut content = blake3::Hasher::new();
        content.update(b"lenscube/chart-identity/2\n");
        content.update(self.description().as_bytes());
        let mut mtimes = blake3::Hasher::new();
        mtimes.update(b"lenscube/chart-mtimes/1\n");
        for (name, size, time) in files {
            content.update(format!("\n{name}\t{size}").as_bytes());
            mtimes.update(format!("\n{name}\t{time}").as_bytes());
        }
        let hex = |hash: blake3::Hasher| hash.finalize().to_hex().to_string();
        Ok(ChartIdentity { content: hex(content), mtimes: hex(mtimes) })
    }
}

impl ChartStore {
    /// Names in the array, sizes, and what changes with the bytes: time of last change in ns, or ETag. Objects are asked for
    /// by the keys that the array may have.
    fn chunks(&self) -> Result<Vec<(String, u64, String)>, DurableError> {
        let mut files = Vec::new();
        let objects = match &*self.layout.store {
            Store::Directory(_) => {
                list(&self.layout, &self.array_path(), "", &mut files)?;
                return Ok(files);
            }
            Store::Objects(objects) => objects,
        };
        let keys = self.layout.keys();
        let above = if self.layout.name.is_empty() { 0 } else { self.layout.name.len() + 1 };
        let found = std::iter::zip(&keys, objects.states(&keys)?);
        files
            .extend(found.filter_map(|(key, state)| state.map(|s| (key[above..].to_owned(), s.size, s.tag))));
        Ok(files)
    }
}

/// Keys of chunks below `directory`, sizes and times in ns. What else lies there (metadata, files of an operating system or an
/// editor) is no part of the pixels.
fn list(
    layout: &Layout,
    directory: &Path,
    prefix: &str,
    files: &mut Vec<(String, u64, String)>,
) -> Result<(), DurableError> {
    let failed = |e| DurableError::io("list", directory, 0, e);
    for entry in std::fs::read_dir(directory).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let Ok(name) = entry.file_name().into_string() else { continue };
        let path = entry.path();
        let look_up = || std::fs::metadata(&path).map_err(|e| DurableError::io("look up", &path, 0, e));
        let key = format!("{prefix}{name}");
        if layout.is_chunk_key(&key) {
            let meta = look_up()?;
            if meta.is_file() {
                files.push((key, meta.len(), modified_ns(&meta)));
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
