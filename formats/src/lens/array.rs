//! One Zarr v3 array of a pack, validated and read completely.
//!
//! The metadata is validated before it is passed to zarrs: regular grid, number type, supported codecs (transpose, bytes, one of blosc,
//! zstd, gzip, and crc32c; no shards), sizes within bounds. Contrary to the Zarr specification a missing chunk is an error, not the fill
//! value. Decoding stops at the chunk's size ([`BoundedChain`]).

use super::error::LensPackError;
use super::number::Number;
use super::store::{MAX_METADATA_BYTES, PackStore};
use crate::bounded::BoundedChain;
use pipeline::bounds::Bound;
use serde_json::Value;
use std::num::NonZeroU64;
use std::ops::Range;
use std::sync::Arc;
use zarrs::array::Array;
use zarrs::metadata::ArrayMetadata;

/// Maximum number of samples of an array (2 GiB of f32); a traced band has 15 million, one of a fast lens up to 500 million.
pub const MAX_SAMPLES: u64 = 1 << 29;
/// Maximum number of chunks of an array.
const MAX_CHUNKS: u64 = 1 << 18;
/// Maximum compression ratio of the codecs: zstd stores a run of 128 KiB in 4 bytes.
const MAX_RATIO: u64 = 1 << 15;

/// An array with validated metadata.
pub(super) struct PackArray<'a> {
    store: &'a PackStore,
    name: String,
    pub(super) shape: Vec<u64>,
    chunk: Vec<NonZeroU64>,
    number: Number,
    fill_is_zero: bool,
    array: Array<()>,
    chain: BoundedChain,
}

/// Samples in C order, and the key of the first missing chunk (its samples are 0).
pub(super) struct Samples<T> {
    pub(super) values: Vec<T>,
    pub(super) missing: Option<String>,
}

impl<'a> PackArray<'a> {
    /// Reads and validates the metadata; `None`: no such array.
    pub(super) fn open_optional(store: &'a PackStore, name: &str) -> Result<Option<Self>, LensPackError> {
        let invalid = |problem: String| LensPackError::Metadata {
            path: store.path.clone(),
            array: name.into(),
            problem,
        };
        let key = format!("{name}/zarr.json");
        let Some(bytes) = store
            .read(&key, MAX_METADATA_BYTES)
            .map_err(|e| store.read_error(e, |e| invalid(format!("its zarr.json cannot be read: {e}"))))?
        else {
            return Ok(None);
        };
        let json: Value =
            serde_json::from_slice(&bytes).map_err(|e| invalid(format!("its zarr.json is not JSON: {e}")))?;
        if json["zarr_format"] != 3 || json["node_type"] != "array" {
            return Err(invalid(format!(
                "is zarr_format {}, node_type {}, expected 3, \"array\"",
                json["zarr_format"], json["node_type"]
            )));
        }
        let shape = sizes(&json["shape"]).ok_or_else(|| invalid(format!("has shape {}", json["shape"])))?;
        let grid = &json["chunk_grid"];
        let chunk = sizes(&grid["configuration"]["chunk_shape"])
            .filter(|chunk| grid["name"] == "regular" && chunk.len() == shape.len())
            .and_then(|chunk| chunk.into_iter().map(NonZeroU64::new).collect::<Option<Vec<_>>>())
            .ok_or_else(|| invalid(format!("has chunk grid {grid}, expected a regular one of its rank")))?;
        let type_name = &json["data_type"];
        let number =
            type_name.as_str().and_then(Number::from_name).ok_or_else(|| LensPackError::DataType {
                path: store.path.clone(),
                array: name.into(),
                found: type_name.to_string(),
                expected: "float32, float64 or an integer",
            })?;
        check_codecs(&json["codecs"]).map_err(invalid)?;
        let keys = &json["chunk_key_encoding"]["name"];
        if keys != "default" && keys != "v2" {
            return Err(invalid(format!("has chunk key encoding {keys}, expected \"default\" or \"v2\"")));
        }
        if json["storage_transformers"].as_array().is_some_and(|list| !list.is_empty()) {
            return Err(invalid("has storage transformers, which are not supported".into()));
        }
        let too_large = |stated: String, limit: String| LensPackError::TooLarge {
            path: store.path.clone(),
            array: name.into(),
            stated,
            limit,
        };
        let chunks = shape.iter().zip(&chunk).map(|(n, c)| n.div_ceil(c.get()));
        if product(shape.iter().copied()).is_none_or(|n| n > MAX_SAMPLES) {
            return Err(too_large(format!("shape {shape:?}"), format!("{MAX_SAMPLES} samples")));
        }
        if product(chunk.iter().map(|c| c.get())).is_none_or(|n| n > MAX_SAMPLES) {
            return Err(too_large(format!("chunks of {chunk:?}"), format!("{MAX_SAMPLES} samples")));
        }
        if product(chunks).is_none_or(|n| n > MAX_CHUNKS) {
            return Err(too_large(
                format!("shape {shape:?} in chunks of {chunk:?}"),
                format!("{MAX_CHUNKS} chunks"),
            ));
        }
        let fill_is_zero = json["fill_value"].as_f64() == Some(0.0);
        let metadata: ArrayMetadata =
            serde_json::from_value(json).map_err(|e| invalid(format!("its zarr.json is invalid: {e}")))?;
        let array = Array::new_with_metadata(Arc::new(()), &format!("/{name}"), metadata)
            .map_err(|e| invalid(e.to_string()))?;
        let chain = BoundedChain::new(&array.codecs())
            .map_err(|found| invalid(format!("has {found}, which is not supported")))?;
        let name = name.into();
        Ok(Some(Self { store, name, shape, chunk, number, fill_is_zero, array, chain }))
    }

    /// As [`open_optional`](Self::open_optional); a missing array is an error.
    pub(super) fn open(store: &'a PackStore, name: &str) -> Result<Self, LensPackError> {
        Self::open_optional(store, name)?
            .ok_or_else(|| LensPackError::MissingArray { path: store.path.clone(), array: name.into() })
    }

    /// Requires a shape; `axes` describes it in the error.
    pub(super) fn expect_shape(&self, shape: &[usize], axes: &str) -> Result<(), LensPackError> {
        if self.shape.iter().copied().eq(shape.iter().map(|&n| n as u64)) {
            return Ok(());
        }
        Err(self.shape_error(format!("{shape:?} ({axes})")))
    }

    /// Requires that array and chunk have no more samples than a bound.
    pub(super) fn expect_at_most(&self, bound: &Bound) -> Result<(), LensPackError> {
        let sides: Vec<usize> = self.shape.iter().map(|&n| n as usize).collect();
        let chunk: Vec<usize> = self.chunk.iter().map(|c| c.get() as usize).collect();
        let checked = bound.check_product(&sides).and_then(|_| bound.check_product(&chunk));
        checked.map(drop).map_err(|e| LensPackError::TooLarge {
            path: self.store.path.clone(),
            array: self.name.clone(),
            stated: e.found,
            limit: bound.to_string(),
        })
    }

    /// Bytes of one decoded chunk.
    pub(super) fn chunk_bytes(&self) -> u64 {
        self.chunk.iter().map(|c| c.get()).product::<u64>() * self.number.bytes() as u64
    }

    pub(super) fn shape_error(&self, expected: String) -> LensPackError {
        LensPackError::Shape {
            path: self.store.path.clone(),
            array: self.name.clone(),
            found: self.shape.clone(),
            expected,
        }
    }

    /// Requires floating point samples.
    pub(super) fn expect_float(&self) -> Result<(), LensPackError> {
        if matches!(self.number, Number::F32 | Number::F64) {
            return Ok(());
        }
        Err(LensPackError::DataType {
            path: self.store.path.clone(),
            array: self.name.clone(),
            found: "an integer type".into(),
            expected: "float32 or float64",
        })
    }

    /// All samples; a missing chunk is an error.
    pub(super) fn read(&self) -> Result<Vec<f64>, LensPackError> {
        let samples = self.read_as(|v| v)?;
        match samples.missing {
            None => Ok(samples.values),
            Some(chunk) => Err(self.missing_chunk(chunk)),
        }
    }

    pub(super) fn missing_chunk(&self, chunk: String) -> LensPackError {
        LensPackError::MissingChunk { path: self.store.path.clone(), array: self.name.clone(), chunk }
    }

    /// All samples, converted. A missing chunk is an error, or with fill value 0 is returned in [`Samples::missing`].
    pub(super) fn read_as<T: Copy + Default>(
        &self,
        convert: impl Fn(f64) -> T,
    ) -> Result<Samples<T>, LensPackError> {
        self.read_rows(0..self.shape[0] as usize, convert)
    }

    /// As [`read_as`](Self::read_as), of `rows` of the first axis, all of them for an array with one axis; other chunks are not read.
    pub(super) fn read_rows<T: Copy + Default>(
        &self,
        rows: Range<usize>,
        convert: impl Fn(f64) -> T,
    ) -> Result<Samples<T>, LensPackError> {
        let rows = rows.start as u64..rows.end as u64;
        let mut chunks = self.chunk_indices();
        let along = self.chunk[0].get();
        chunks.retain(|index| index[0] * along < rows.end && rows.start < (index[0] + 1) * along);
        let samples: u64 = (rows.end - rows.start) * self.shape[1..].iter().product::<u64>();
        let mut stored_bytes = 0u64;
        let mut missing = None;
        for index in &chunks {
            match self.store.size(&self.key(index)) {
                Ok(Some(bytes)) => stored_bytes = stored_bytes.saturating_add(bytes),
                Ok(None) if self.fill_is_zero => missing = missing.or(Some(self.key(index))),
                Ok(None) => return Err(self.missing_chunk(self.key(index))),
                Err(e) => return Err(self.store.read_error(e, |e| self.damaged(index, e))),
            }
        }
        if let (0, Some(chunk)) = (stored_bytes, &missing) {
            return Err(self.missing_chunk(chunk.clone()));
        }
        if samples * self.number.bytes() as u64 > stored_bytes.saturating_mul(MAX_RATIO) {
            return Err(LensPackError::TooLarge {
                path: self.store.path.clone(),
                array: self.name.clone(),
                stated: format!("shape {:?}", self.shape),
                limit: format!("its chunks of {stored_bytes} bytes in total can decode to"),
            });
        }
        let mut values = vec![T::default(); samples as usize];
        for index in &chunks {
            if let Some(decoded) = self.decode(index)? {
                self.copy_chunk(index, &decoded, &rows, &convert, &mut values);
            }
        }
        Ok(Samples { values, missing })
    }

    fn key(&self, index: &[u64]) -> String {
        self.array.chunk_key(index).as_str().to_owned()
    }

    fn damaged(&self, index: &[u64], problem: String) -> LensPackError {
        LensPackError::Chunk {
            path: self.store.path.clone(),
            array: self.name.clone(),
            chunk: self.key(index),
            problem,
        }
    }

    /// Indices of every chunk, in C order.
    fn chunk_indices(&self) -> Vec<Vec<u64>> {
        let mut all = vec![Vec::new()];
        for (n, c) in self.shape.iter().zip(&self.chunk) {
            let along = n.div_ceil(c.get());
            all = all
                .into_iter()
                .flat_map(|head| (0..along).map(move |i| [head.as_slice(), &[i]].concat()))
                .collect();
        }
        all
    }

    fn decode(&self, index: &[u64]) -> Result<Option<Vec<u8>>, LensPackError> {
        let expected = self.chunk_bytes();
        let encoded = self
            .store
            .read(&self.key(index), 2 * expected + (64 << 10))
            .map_err(|e| self.store.read_error(e, |e| self.damaged(index, e)))?;
        let Some(encoded) = encoded else { return Ok(None) };
        let decoded = self
            .chain
            .decode(encoded.into(), &self.chunk, self.array.data_type(), self.array.fill_value())
            .map_err(|problem| self.damaged(index, problem))?;
        if decoded.len() as u64 != expected {
            return Err(
                self.damaged(index, format!("it decodes to {} bytes, expected {expected}", decoded.len()))
            );
        }
        Ok(Some(decoded))
    }

    /// Copies the rows of a decoded chunk that lie in `range` of the first axis into `values`; samples beyond the array's edge are dropped.
    fn copy_chunk<T>(
        &self,
        index: &[u64],
        decoded: &[u8],
        range: &Range<u64>,
        convert: &impl Fn(f64) -> T,
        values: &mut [T],
    ) {
        let width = self.number.bytes();
        let rank = self.shape.len();
        let chunk: Vec<u64> = self.chunk.iter().map(|c| c.get()).collect();
        let row = chunk[rank - 1];
        let rows: u64 = chunk[..rank - 1].iter().product();
        'rows: for r in 0..rows {
            let (mut rest, mut to, mut stride) = (r, 0, self.shape[rank - 1]);
            for axis in (0..rank - 1).rev() {
                let mut at = index[axis] * chunk[axis] + rest % chunk[axis];
                rest /= chunk[axis];
                if at >= self.shape[axis] {
                    continue 'rows;
                }
                if axis == 0 {
                    if !range.contains(&at) {
                        continue 'rows;
                    }
                    at -= range.start;
                }
                to += at * stride;
                stride *= self.shape[axis];
            }
            let first = index[rank - 1] * row;
            let count = row.min(self.shape[rank - 1] - first) as usize;
            let from = &decoded[(r * row) as usize * width..][..count * width];
            let to = &mut values[(to + first) as usize..][..count];
            for (value, bytes) in to.iter_mut().zip(from.chunks_exact(width)) {
                *value = convert(self.number.value(bytes));
            }
        }
    }
}

fn product(mut sizes: impl Iterator<Item = u64>) -> Option<u64> {
    sizes.try_fold(1u64, u64::checked_mul)
}

/// One to three sizes, none 0.
fn sizes(json: &Value) -> Option<Vec<u64>> {
    let list: Vec<u64> = json.as_array()?.iter().map(Value::as_u64).collect::<Option<_>>()?;
    ((1..=3).contains(&list.len()) && !list.contains(&0)).then_some(list)
}

/// Validates the chain of codecs.
fn check_codecs(json: &Value) -> Result<(), String> {
    let list = json.as_array().ok_or("has no list of codecs")?;
    let names: Vec<&str> = list.iter().map(|c| c["name"].as_str().or(c.as_str()).unwrap_or("?")).collect();
    let mut rest = names.as_slice();
    while let ["transpose", tail @ ..] = rest {
        rest = tail;
    }
    match rest {
        ["bytes"]
        | ["bytes", "crc32c" | "blosc" | "zstd" | "gzip"]
        | ["bytes", "blosc" | "zstd" | "gzip", "crc32c"] => Ok(()),
        _ => Err(format!(
            "has codecs {names:?}, expected [transpose], bytes, one of blosc, zstd, gzip or none, [crc32c]"
        )),
    }
}
