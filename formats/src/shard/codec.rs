//! Compression and sample type of shards, and their Zarr v3 metadata.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// Compression of inner chunks; a crc32c follows in every case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Codec {
    /// No compression.
    None,
    /// blosc: shuffle, lz4.
    #[default]
    Lz4,
    /// blosc: shuffle, zstd level 1: smaller, and slower.
    Zstd,
}

/// Sample type of a film.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub enum SampleType {
    /// IEEE binary16; a value beyond ±65504 is an error.
    #[serde(rename = "float16")]
    F16,
    /// IEEE binary32.
    #[default]
    #[serde(rename = "float32")]
    F32,
    /// Digital numbers of a raw, never of a film.
    #[serde(skip)]
    U16,
}

impl SampleType {
    /// Bytes of one sample.
    pub const fn bytes(self) -> usize {
        match self {
            Self::F16 | Self::U16 => 2,
            Self::F32 => 4,
        }
    }

    /// Zarr data type.
    pub const fn name(self) -> &'static str {
        match self {
            Self::F16 => "float16",
            Self::F32 => "float32",
            Self::U16 => "uint16",
        }
    }

    /// The fill value in native byte order: NaN, or 0 of digital numbers.
    pub(super) fn fill(self) -> Vec<u8> {
        match self {
            Self::F16 => half::f16::NAN.to_ne_bytes().to_vec(),
            Self::F32 => f32::NAN.to_ne_bytes().to_vec(),
            Self::U16 => vec![0; 2],
        }
    }
}

impl Codec {
    /// Zarr v3 metadata of the codecs of an inner chunk. Of samples `rounded` to fewer bits the bits are shuffled instead of the bytes,
    /// which makes runs of zeros of the bits that are not kept: with lz4 a quarter smaller (scripts/bench/2026-11-21-codec).
    pub(super) fn metadata(self, sample: SampleType, rounded: bool) -> Value {
        let bytes = json!({"name": "bytes", "configuration": {"endian": "little"}});
        let crc = json!({"name": "crc32c"});
        let cname = match self {
            Self::None => return json!([bytes, crc]),
            Self::Lz4 => "lz4",
            Self::Zstd => "zstd",
        };
        // The low bits of digital numbers are noise: bit planes compress better than bytes.
        let by_bit = rounded || sample == SampleType::U16;
        let shuffle = if by_bit { "bitshuffle" } else { "shuffle" };
        let blosc = json!({"name": "blosc", "configuration": {
            "cname": cname, "clevel": 1, "shuffle": shuffle, "typesize": sample.bytes(), "blocksize": 0
        }});
        json!([bytes, blosc, crc])
    }
}

/// Zarr v3 metadata of the codecs of a shard's index.
pub(super) fn index_metadata() -> Value {
    json!([{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "crc32c"}])
}

/// Zarr v3 metadata of the codecs of an array whose shards have inner chunks (1, `chunk`, `chunk`).
pub(crate) fn sharding_metadata(codec: Codec, sample: SampleType, chunk: usize, rounded: bool) -> Value {
    sharding_of(codec, sample, &[1, chunk, chunk], rounded)
}

/// As [`sharding_metadata`], for inner chunks of any shape.
pub(crate) fn sharding_of(codec: Codec, sample: SampleType, chunk: &[usize], rounded: bool) -> Value {
    json!([{"name": "sharding_indexed", "configuration": {
        "chunk_shape": chunk,
        "codecs": codec.metadata(sample, rounded),
        "index_codecs": index_metadata(),
        "index_location": "end"
    }}])
}
