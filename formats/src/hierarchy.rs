//! New Zarr v3 groups: images with their coordinates, written aside and published by one rename.
//!
//! The metadata is written as zarr-python 3 writes it, consolidated copies in the group's `zarr.json` included, so that
//! xarray, zarr-python, tensorstore and napari open the group as it is. A group is made in a temp directory beside its
//! place and renamed when all of it is on the disk: the place holds nothing or a whole group, also when the process is
//! killed, and of two that create it at once one wins and the other is told. Objects cannot be renamed: there they lie in
//! their place from the beginning, and the group's own `zarr.json`, without which nothing is a group, comes last.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use crate::durable::{
    DurableError, Store, create_directories, link_target, parent_of, publish, replace_directory,
    sweep_entries, temp_name,
};

fn bytes_and_crc() -> Value {
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

/// A 1-D coordinate: its metadata and its one chunk.
pub(crate) fn coordinate(name: &str, unit: &str, long_name: &str, values: &[f64]) -> (Value, Vec<u8>) {
    let n = values.len();
    let attributes = json!({"units": unit, "long_name": long_name});
    let metadata = array(&[n], &[n], "float64", bytes_and_crc(), &[name], attributes);
    let mut bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend_from_slice(&crc32c(&bytes).to_le_bytes());
    (metadata, bytes)
}

/// CRC-32C (Castagnoli), bit by bit: coordinates are small.
fn crc32c(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc: u32, &b| {
        (0..8).fold(crc ^ u32::from(b), |c, _| if c & 1 == 1 { c >> 1 ^ 0x82f6_3b78 } else { c >> 1 })
    })
}

/// A group that is being made. Dropped before [`NewGroup::publish`], it leaves no group: no file, and of objects at most
/// such as the next attempt writes again.
#[derive(Debug)]
pub(crate) struct NewGroup {
    pub(crate) store: Store,
    place: PathBuf,
    fsync: bool,
    arrays: Map<String, Value>,
    /// A directory that is at the place stays until the new one replaces it.
    replace: bool,
}

impl NewGroup {
    /// Begins a group that is to be at `place`. `None`: something is there already, objects of an earlier attempt excepted,
    /// which `ours` knows by their keys.
    pub(crate) fn begin(
        place: &Path,
        fsync: bool,
        ours: impl Fn(&str) -> bool + Send + Sync + 'static,
    ) -> Result<Option<Self>, DurableError> {
        // A link stays a link: what it leads to is made.
        let place = &link_target(place);
        let store = match Store::at(place)? {
            Store::Objects(objects) => {
                // Read, not asked about: only then a store says what is wrong.
                let taken = objects.read_at_most("zarr.json", u64::MAX)?.is_some();
                if taken || objects.first_key(move |key| !ours(key))?.is_some() {
                    return Ok(None);
                }
                Store::Objects(objects)
            }
            there @ Store::Directory(_) => {
                if there.exists()? {
                    return Ok(None);
                }
                let parent = parent_of(place);
                create_directories(parent, fsync)?;
                sweep_entries(parent)?;
                Store::at(&parent.join(temp_name()))?.with_fsync(fsync)
            }
        };
        Ok(Some(Self { store, place: place.into(), fsync, arrays: Map::new(), replace: false }))
    }

    /// Begins a group that replaces the directory at `place` when it is complete.
    pub(crate) fn replacing(place: &Path, fsync: bool) -> Result<Self, DurableError> {
        let place = &link_target(place);
        let parent = parent_of(place);
        sweep_entries(parent)?;
        let store = Store::at(&parent.join(temp_name()))?.with_fsync(fsync);
        Ok(Self { store, place: place.into(), fsync, arrays: Map::new(), replace: true })
    }

    /// Writes an array's metadata.
    pub(crate) fn array(&mut self, name: &str, metadata: Value) -> Result<(), DurableError> {
        self.store.write(&format!("{name}/zarr.json"), pretty(&metadata))?;
        self.arrays.insert(name.into(), metadata);
        Ok(())
    }

    /// Writes a coordinate.
    pub(crate) fn coordinate(
        &mut self,
        name: &str,
        (metadata, bytes): (Value, Vec<u8>),
    ) -> Result<(), DurableError> {
        self.store.write(&format!("{name}/c/0"), bytes)?;
        self.array(name, metadata)
    }

    /// The group's store, held open so that it stays this group after it has its place, whatever takes that place later.
    pub(crate) fn opened(&self) -> Result<Option<Store>, DurableError> {
        let place = &self.place;
        Ok(self.store.clone().opened()?.map(|store| match store {
            Store::Directory(directory) => Store::Directory(directory.renamed(place)),
            objects @ Store::Objects(_) => objects,
        }))
    }

    /// Writes the group's own metadata and gives the group its place. `false`: another has taken it meanwhile.
    pub(crate) fn publish(mut self, attributes: Value) -> Result<bool, DurableError> {
        let metadata = json!({
            "zarr_format": 3,
            "node_type": "group",
            "attributes": attributes,
            "consolidated_metadata": {
                "kind": "inline",
                "must_understand": false,
                "metadata": std::mem::take(&mut self.arrays)
            }
        });
        let bytes = pretty(&metadata);
        match &self.store {
            Store::Objects(objects) => objects.write_new("zarr.json", bytes.into()),
            Store::Directory(directory) => {
                directory.write("zarr.json", &bytes)?;
                if self.replace {
                    replace_directory(directory.root(), &self.place)?;
                    return Ok(true);
                }
                publish(directory.root(), &self.place, self.fsync)
            }
        }
    }
}

impl Drop for NewGroup {
    fn drop(&mut self) {
        if let Store::Directory(directory) = &self.store {
            // Published, it is not there any more; otherwise what stays is swept later.
            let _ = std::fs::remove_dir_all(directory.root());
        }
    }
}

pub(crate) fn pretty(v: &Value) -> Vec<u8> {
    serde_json::to_vec_pretty(v).expect("JSON values are JSON")
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_checksum_is_castagnolis() {
        // RFC 3720, B.4, and the usual check value.
        assert_eq!(super::crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(super::crc32c(b"123456789"), 0xe306_9283);
    }
}
