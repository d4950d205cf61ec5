//! Files that follow from the attributes of a group: metadata of its arrays, its coordinates, and the copies of the metadata in the group's
//! `zarr.json`. They are compared with what they must hold, and written again where they differ.
//!
//! The attributes themselves follow from nothing. Attribute `attributes_digest` is the BLAKE3 digest of the others, except `ome`, which a
//! pyramid adds; groups of earlier versions have none.

use serde_json::{Map, Value};

use super::{Finding, GroupError, JobGroup, MAX_METADATA_BYTES, read_json};
use crate::hierarchy::{group_metadata, pretty};

const ATTRIBUTES_DIGEST: &str = "attributes_digest";
/// Attribute of a pyramid.
pub(crate) const OME: &str = "ome";
/// Group of the levels of a pyramid.
pub(crate) const PYRAMID_GROUP: &str = "pyramid";

/// Arrays and coordinates of a group.
pub(crate) struct Derived {
    /// Name, metadata and chunk of each coordinate.
    pub(crate) coordinates: Vec<(String, (Value, Vec<u8>))>,
    /// Name and metadata of each other array.
    pub(crate) arrays: Vec<(String, Value)>,
}

impl Derived {
    /// Name and metadata of every array, in the order of creation.
    fn metadata(&self) -> impl Iterator<Item = (&String, &Value)> {
        let coordinates = self.coordinates.iter().map(|(name, (metadata, _))| (name, metadata));
        coordinates.chain(self.arrays.iter().map(|(name, metadata)| (name, metadata)))
    }
}

/// File of the values of a coordinate.
pub(crate) fn values_key(name: &str) -> String {
    format!("{name}/c/0")
}

/// File of the metadata of an array or group.
pub(crate) fn metadata_key(name: &str) -> String {
    format!("{name}/zarr.json")
}

/// `attributes` with their digest.
pub(super) fn with_digest(mut attributes: Value) -> Value {
    attributes[ATTRIBUTES_DIGEST] = digest(&attributes).into();
    attributes
}

fn digest(attributes: &Value) -> String {
    blake3::hash(attributes.to_string().as_bytes()).to_hex().to_string()
}

/// Removes the attributes that are not the caller's.
pub(super) fn without_own(attributes: &mut Map<String, Value>) {
    attributes.shift_remove(OME);
    attributes.shift_remove(ATTRIBUTES_DIGEST);
}

/// Whether `attributes` are those that the group was created with; true without a digest.
fn has_created_attributes(attributes: &Value) -> bool {
    let Some(recorded) = attributes.get(ATTRIBUTES_DIGEST) else { return true };
    let mut others = attributes.clone();
    others.as_object_mut().into_iter().for_each(without_own);
    recorded.as_str() == Some(&digest(&others))
}

impl JobGroup {
    /// Compares the attributes with their digest, and every file of `derived` with what it must hold.
    pub(crate) fn check_derived(&self, derived: &Derived) -> Result<Vec<Finding>, GroupError> {
        let mut findings = Vec::new();
        let group = read_json(&self.store, "zarr.json")?.unwrap_or_default();
        if !has_created_attributes(&group["attributes"]) {
            let reason = format!("the attributes do not match their digest, {ATTRIBUTES_DIGEST}");
            findings.push(Finding::Attributes { reason });
        }
        let copies = &group["consolidated_metadata"]["metadata"];
        let differing = derived.metadata().find(|(name, metadata)| copies.get(name) != Some(metadata));
        if let Some((name, _)) = differing {
            let reason = format!("its copy of {} is missing or differs", metadata_key(name));
            findings.push(Finding::Metadata { key: "zarr.json".into(), reason });
        } else if group != self.corrected(&group, derived)? {
            let reason = "it is not the metadata of a group with its arrays".into();
            findings.push(Finding::Metadata { key: "zarr.json".into(), reason });
        }
        for (name, metadata) in derived.metadata() {
            findings.extend(self.check_json(&metadata_key(name), metadata)?);
        }
        for (name, (_, values)) in &derived.coordinates {
            let is_same = |bytes: &[u8]| bytes == values;
            findings.extend(self.check_content(&values_key(name), values.len() as u64, is_same)?);
        }
        Ok(findings)
    }

    /// Writes the file `key` again if it is one of `derived`; whether it is.
    pub(crate) fn restore_derived(&self, key: &str, derived: &Derived) -> Result<bool, GroupError> {
        let of_array = derived.metadata().find(|(name, _)| metadata_key(name) == key);
        let of_coordinate = derived.coordinates.iter().find(|(name, _)| values_key(name) == key);
        let bytes = match (of_array, of_coordinate) {
            _ if key == "zarr.json" => match read_json(&self.store, key)? {
                Some(group) => pretty(&self.corrected(&group, derived)?),
                None => return Ok(false),
            },
            (Some((_, metadata)), _) => pretty(metadata),
            (None, Some((_, (_, values)))) => values.clone(),
            (None, None) => return Ok(false),
        };
        self.commit(key, bytes.into()).map(|()| true)
    }

    /// `group`, the contents of `zarr.json`, with everything but its attributes as it must be. Copies of the pyramid's metadata stay, which the
    /// pyramid checks, and those of nodes of other programs that exist.
    fn corrected(&self, group: &Value, derived: &Derived) -> Result<Value, GroupError> {
        let mut copies: Map<String, Value> =
            derived.metadata().map(|(name, metadata)| (name.clone(), metadata.clone())).collect();
        for (name, metadata) in group["consolidated_metadata"]["metadata"].as_object().into_iter().flatten() {
            let is_of_pyramid = name.split('/').next() == Some(PYRAMID_GROUP);
            let is_kept = || Ok::<_, GroupError>(self.store.size_of(&metadata_key(name))?.is_some());
            if !copies.contains_key(name) && (is_of_pyramid || is_kept()?) {
                copies.insert(name.clone(), metadata.clone());
            }
        }
        Ok(group_metadata(group["attributes"].clone(), copies))
    }

    /// The defect of the metadata file `key`, which must hold `expected`.
    pub(crate) fn check_json(&self, key: &str, expected: &Value) -> Result<Option<Finding>, GroupError> {
        let is_same =
            |bytes: &[u8]| serde_json::from_slice::<Value>(bytes).is_ok_and(|found| found == *expected);
        self.check_content(key, MAX_METADATA_BYTES, is_same)
    }

    /// The defect of the file `key` of at most `limit` bytes, for which `is_same` must be true.
    fn check_content(
        &self,
        key: &str,
        limit: u64,
        is_same: impl Fn(&[u8]) -> bool,
    ) -> Result<Option<Finding>, GroupError> {
        let metadata = |reason: String| Some(Finding::Metadata { key: key.into(), reason });
        Ok(match self.read_to_check(key, limit)? {
            Ok(bytes) if is_same(&bytes) => None,
            Ok(_) => metadata(format!("it differs from that of this {}'s attributes", self.kind)),
            Err(Finding::Missing { .. }) => metadata("no such file".into()),
            Err(Finding::Bad { reason, .. }) => metadata(reason),
            Err(unreadable) => Some(unreadable),
        })
    }
}
