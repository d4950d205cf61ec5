//! Arrays (sample, …) of a data set as Zarr v3: a shard a unit, an inner chunk a sample, bytes → zstd → crc32c; a sample that was left out has no chunk.

use serde_json::{Map, Value, json};

use crate::hierarchy::{array, bytes_and_crc, with_crc};
use crate::shard::SampleType;

/// Level of zstd.
const LEVEL: i32 = 3;
/// Offset and length of a chunk that is not there.
const ABSENT: [u64; 2] = [u64::MAX; 2];

/// An array of a data set.
#[derive(Clone, Debug, PartialEq)]
pub struct ArraySpec {
    /// Its name.
    pub name: &'static str,
    /// Names of its axes after `sample`.
    pub axes: Vec<&'static str>,
    /// Sides of a sample.
    pub shape: Vec<usize>,
    /// Its values.
    pub sample: SampleType,
}

impl ArraySpec {
    /// Bytes of a sample.
    pub fn bytes(&self) -> usize {
        self.shape.iter().product::<usize>() * self.sample.bytes()
    }

    /// Metadata of the array of `samples` samples, `per_unit` in a shard.
    pub(super) fn metadata(&self, samples: u64, per_unit: u64) -> Value {
        let with = |first: u64| [&[first as usize], &self.shape[..]].concat();
        let codecs = json!([{"name": "sharding_indexed", "configuration": {
            "chunk_shape": with(1),
            "codecs": [
                {"name": "bytes", "configuration": {"endian": "little"}},
                {"name": "zstd", "configuration": {"level": LEVEL, "checksum": false}},
                {"name": "crc32c"},
            ],
            "index_codecs": bytes_and_crc(),
            "index_location": "end",
        }}]);
        let axes = [&["sample"], &self.axes[..]].concat();
        let mut metadata =
            array(&with(samples), &with(per_unit), self.sample.name(), codecs, &axes, json!({}));
        metadata["fill_value"] = 0.into();
        metadata
    }

    /// Key of the shard of `unit`.
    pub(super) fn key(&self, unit: u64) -> String {
        format!("{}/c/{unit}{}", self.name, "/0".repeat(self.shape.len()))
    }
}

/// Metadata of the group.
pub(super) fn group(attributes: Map<String, Value>) -> Value {
    json!({"zarr_format": 3, "node_type": "group", "attributes": attributes})
}

/// A shard of the little-endian `samples` of a unit of `per_unit`; an empty one is left out.
pub(super) fn shard(samples: &[&[u8]], per_unit: u64) -> std::io::Result<Vec<u8>> {
    let mut out = Vec::new();
    let mut index = vec![ABSENT; per_unit as usize];
    for (sample, entry) in samples.iter().zip(&mut index) {
        if sample.is_empty() {
            continue;
        }
        let offset = out.len();
        out.extend(with_crc(zstd::bulk::compress(sample, LEVEL)?));
        *entry = [offset as u64, (out.len() - offset) as u64];
    }
    out.extend(with_crc(index.iter().flatten().flat_map(|v| v.to_le_bytes()).collect()));
    Ok(out)
}

/// The samples of a shard of `per_unit` samples of `bytes` each; none if it is damaged.
pub(super) fn samples(shard: &[u8], per_unit: u64, bytes: usize) -> Option<Vec<Vec<u8>>> {
    let start = shard.len().checked_sub(16 * per_unit as usize + 4)?;
    let (index, sum) = shard[start..].split_at(16 * per_unit as usize);
    if crc32c::crc32c(index).to_le_bytes() != sum {
        return None;
    }
    let sample = |entry: &[u8]| {
        let [offset, length] =
            [0, 8].map(|at| u64::from_le_bytes(entry[at..at + 8].try_into().expect("8 bytes")));
        if [offset, length] == ABSENT {
            return Some(Vec::new());
        }
        let end = offset.checked_add(length).filter(|end| *end <= start as u64)?;
        let chunk = &shard[offset as usize..end as usize];
        let (packed, sum) = chunk.split_at_checked(chunk.len().checked_sub(4)?)?;
        if crc32c::crc32c(packed).to_le_bytes() != sum {
            return None;
        }
        zstd::bulk::decompress(packed, bytes).ok().filter(|sample| sample.len() == bytes)
    };
    index.chunks_exact(16).map(sample).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_hold_samples_and_gaps_and_show_damage() {
        let (a, b) = ([7u8; 40], [9u8; 40]);
        let mut bytes = shard(&[&a, &[], &b], 4).unwrap();
        let found = samples(&bytes, 4, 40).unwrap();
        assert_eq!(found, [a.to_vec(), Vec::new(), b.to_vec(), Vec::new()]);
        assert_eq!(samples(&bytes, 5, 40), None);
        bytes[2] ^= 1;
        assert_eq!(samples(&bytes, 4, 40), None);
    }
}
