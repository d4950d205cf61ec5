//! Creation of Zarr v3 groups: arrays with their coordinates, published in one step.
//!
//! The metadata has the form that zarr-python 3 writes, with consolidated metadata in the group's `zarr.json`, so that xarray,
//! zarr-python, tensorstore and napari open the group. In a directory the group is written to a temp directory beside its final
//! path, metadata and coordinates as a [`Batch`], and renamed when it is complete on disk: the path holds nothing or a complete
//! group, also if the process is killed; of two processes that create it at once, one succeeds and the other gets an error. Objects
//! cannot be renamed: they are written to their final keys, the group's `zarr.json`, without which there is no group, last.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use crate::durable::{
    Batch, DurableError, Store, create_directories, link_target, parent_of, publish, replace_directory,
    sweep_entries, temp_name,
};

/// Codecs of small arrays: samples in little-endian order and their checksum.
pub(crate) fn bytes_and_crc() -> Value {
    json!([{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "crc32c"}])
}

/// Metadata of a Zarr v3 array with fill value NaN.
pub(crate) fn array(
    shape: &[usize],
    chunk: &[usize],
    sample: &str,
    codecs: Value,
    dimensions: &[&str],
    attributes: Value,
) -> Value {
    json!({
        "zarr_format": 3,
        "node_type": "array",
        "shape": shape,
        "data_type": sample,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": chunk}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": "NaN",
        "codecs": codecs,
        "attributes": attributes,
        "dimension_names": dimensions,
        "storage_transformers": []
    })
}

/// A 1-D coordinate array: metadata and the bytes of its single chunk.
pub(crate) fn coordinate(name: &str, unit: &str, long_name: &str, values: &[f64]) -> (Value, Vec<u8>) {
    let n = values.len();
    let attributes = json!({"units": unit, "long_name": long_name});
    let metadata = array(&[n], &[n], "float64", bytes_and_crc(), &[name], attributes);
    (metadata, with_crc(values.iter().flat_map(|v| v.to_le_bytes()).collect()))
}

/// `bytes` with their checksum, CRC-32C, behind them.
pub(crate) fn with_crc(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.extend_from_slice(&crc32c::crc32c(&bytes).to_le_bytes());
    bytes
}

/// A group under construction. If it is dropped before [`NewGroup::publish`], no file stays; objects may stay, which the next
/// attempt overwrites.
#[derive(Debug)]
pub(crate) struct NewGroup {
    pub(crate) store: Store,
    /// Final path or URL.
    path: PathBuf,
    fsync: bool,
    /// Metadata and coordinates that are not committed yet, in a directory.
    batch: Option<Batch>,
    /// Metadata of the arrays by name.
    arrays: Map<String, Value>,
    /// Whether to replace an existing directory when the group is published.
    replace: bool,
}

impl NewGroup {
    /// Begins a group at `path`. `None` if something exists there; objects of an earlier attempt, for whose keys `is_own` is
    /// true, do not count.
    pub(crate) fn begin(
        path: &Path,
        fsync: bool,
        is_own: impl Fn(&str) -> bool + Send + Sync + 'static,
    ) -> Result<Option<Self>, DurableError> {
        // A symbolic link is kept; its target is created.
        let path = &link_target(path);
        let store = match Store::at(path)? {
            Store::Objects(objects) => {
                // A read rather than a query of the size: only reads report the store's error message.
                let taken = objects.read_at_most("zarr.json", u64::MAX)?.is_some();
                if taken || objects.first_key(move |key| !is_own(key))?.is_some() {
                    return Ok(None);
                }
                Store::Objects(objects)
            }
            existing @ Store::Directory(_) => {
                if existing.exists()? {
                    return Ok(None);
                }
                let parent = parent_of(path);
                create_directories(parent, fsync)?;
                sweep_entries(parent)?;
                Store::at(&parent.join(temp_name()))?.with_fsync(fsync)
            }
        };
        Ok(Some(Self::new(store, path, fsync, false)))
    }

    /// Begins a group that replaces the directory at `path` when it is published.
    pub(crate) fn replacing(path: &Path, fsync: bool) -> Result<Self, DurableError> {
        let path = &link_target(path);
        let parent = parent_of(path);
        sweep_entries(parent)?;
        let store = Store::at(&parent.join(temp_name()))?.with_fsync(fsync);
        Ok(Self::new(store, path, fsync, true))
    }

    fn new(store: Store, path: &Path, fsync: bool, replace: bool) -> Self {
        let batch = match &store {
            Store::Directory(directory) => Some(Batch::new(directory.clone())),
            Store::Objects(_) => None,
        };
        Self { store, path: path.into(), fsync, batch, arrays: Map::new(), replace }
    }

    fn write(&mut self, key: &str, bytes: Vec<u8>) -> Result<(), DurableError> {
        let Some(batch) = &mut self.batch else { return self.store.write(key, bytes) };
        batch.stage(key, 0, &bytes)?;
        if batch.is_due() { batch.commit() } else { Ok(()) }
    }

    /// Writes an array's metadata.
    pub(crate) fn array(&mut self, name: &str, metadata: Value) -> Result<(), DurableError> {
        self.write(&format!("{name}/zarr.json"), pretty(&metadata))?;
        self.arrays.insert(name.into(), metadata);
        Ok(())
    }

    /// Writes a coordinate array.
    pub(crate) fn coordinate(
        &mut self,
        name: &str,
        (metadata, bytes): (Value, Vec<u8>),
    ) -> Result<(), DurableError> {
        self.write(&format!("{name}/c/0"), bytes)?;
        self.array(name, metadata)
    }

    /// The group's store, open: it stays this group even if another one later replaces the path.
    pub(crate) fn opened(&self) -> Result<Option<Store>, DurableError> {
        let path = &self.path;
        Ok(self.store.clone().opened()?.map(|store| match store {
            Store::Directory(directory) => Store::Directory(directory.renamed(path)),
            objects @ Store::Objects(_) => objects,
        }))
    }

    /// Writes the group's metadata and moves the group to its path. `false` if the path was taken meanwhile.
    pub(crate) fn publish(mut self, attributes: Value) -> Result<bool, DurableError> {
        let bytes = pretty(&group_metadata(attributes, std::mem::take(&mut self.arrays)));
        if let Store::Objects(objects) = &self.store {
            return objects.write_new("zarr.json", bytes.into());
        }
        self.write("zarr.json", bytes)?;
        self.batch.iter_mut().try_for_each(Batch::commit)?;
        let directory = self.store.root();
        if self.replace {
            replace_directory(directory, &self.path)?;
            return Ok(true);
        }
        publish(directory, &self.path, self.fsync)
    }
}

impl Drop for NewGroup {
    fn drop(&mut self) {
        if let Store::Directory(directory) = &self.store {
            // Absent once published. A failure is harmless: a later sweep removes temp directories.
            let _ = std::fs::remove_dir_all(directory.root());
        }
    }
}

/// Metadata of a group with `attributes` and the copies `members` of the metadata of its nodes.
pub(crate) fn group_metadata(attributes: Value, members: Map<String, Value>) -> Value {
    json!({
        "zarr_format": 3,
        "node_type": "group",
        "attributes": attributes,
        "consolidated_metadata": { "kind": "inline", "must_understand": false, "metadata": members }
    })
}

pub(crate) fn pretty(v: &Value) -> Vec<u8> {
    serde_json::to_vec_pretty(v).expect("a JSON value serializes")
}

#[cfg(test)]
mod tests {
    #[test]
    fn crc32c_of_known_inputs_equals_the_published_values() {
        // RFC 3720, B.4, and the usual check value.
        let crc = |bytes: &[u8]| super::with_crc(bytes.to_vec()).split_off(bytes.len());
        assert_eq!(crc(&[0; 32]), 0x8a91_36aa_u32.to_le_bytes());
        assert_eq!(crc(b"123456789"), 0xe306_9283_u32.to_le_bytes());
    }
}
