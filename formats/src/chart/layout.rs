//! Where a chart's pieces lie in its files, and how one is decoded.

use std::borrow::Cow;
use std::num::NonZeroU64;
use std::path::PathBuf;
use std::sync::Arc;

use pipeline::bounds;
use pipeline::geometry::{Rect, Size};
use zarrs::array::codec::CodecChain;
use zarrs::array::{
    Array, ArrayMetadata, ArrayToBytesCodecTraits, BytesRepresentation, DataType, FillValue, data_type,
};
use zarrs::metadata_ext::codec::sharding::{ShardingCodecConfigurationV1, ShardingIndexLocation};

use super::values::Values;
use super::{ChartError, conventions};
use crate::bounded::BoundedChain;
use crate::durable::Store;

/// Largest piece that is decoded: one per thread must fit in memory.
const MAX_PIECE: u64 = 1 << 30;
/// Largest shard index: 16 million inner chunks.
const MAX_INDEX: u64 = 256 << 20;
/// Most files of an array: their names and sizes are listed in memory.
const MAX_FILES: u64 = 1 << 24;

/// Sample type of a chart in its store.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Sample {
    /// Unsigned 8-bit integer.
    U8,
    /// Unsigned 16-bit integer.
    U16,
    /// IEEE binary16.
    F16,
    /// IEEE binary32.
    F32,
    /// IEEE binary64.
    F64,
}

impl Sample {
    fn of(t: &DataType) -> Option<Self> {
        let known = [
            (data_type::uint8(), Self::U8),
            (data_type::uint16(), Self::U16),
            (data_type::float16(), Self::F16),
            (data_type::float32(), Self::F32),
            (data_type::float64(), Self::F64),
        ];
        known.into_iter().find(|(d, _)| d == t).map(|(_, s)| s)
    }

    /// Bytes of one sample.
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::F16 => 2,
            Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Appends `value` of each sample in `bytes` (of this machine's byte order).
    pub(super) fn extend_by(self, out: &mut Vec<f32>, bytes: &[u8], value: impl Fn(f64) -> f32) {
        match self {
            Self::U8 => out.extend(bytes.iter().map(|&b| value(f64::from(b)))),
            Self::U16 => {
                out.extend(bytes.as_chunks().0.iter().map(|&b| value(f64::from(u16::from_ne_bytes(b)))));
            }
            Self::F16 => {
                let samples = bytes.as_chunks().0.iter().map(|&b| half::f16::from_ne_bytes(b).to_f64());
                out.extend(samples.map(value));
            }
            Self::F32 => {
                out.extend(bytes.as_chunks().0.iter().map(|&b| value(f64::from(f32::from_ne_bytes(b)))));
            }
            Self::F64 => out.extend(bytes.as_chunks().0.iter().map(|&b| value(f64::from_ne_bytes(b)))),
        }
    }

    /// Sample `k` of `bytes`.
    pub(super) fn raw(self, bytes: &[u8], k: usize) -> f64 {
        match self {
            Self::U8 => f64::from(bytes[k]),
            Self::U16 => f64::from(u16::from_ne_bytes(bytes.as_chunks().0[k])),
            Self::F16 => half::f16::from_ne_bytes(bytes.as_chunks().0[k]).to_f64(),
            Self::F32 => f64::from(f32::from_ne_bytes(bytes.as_chunks().0[k])),
            Self::F64 => f64::from_ne_bytes(bytes.as_chunks().0[k]),
        }
    }

    /// What a float array stores for `value`; the number itself for integers, which may equal none of their samples.
    pub(super) fn nearest(self, value: f64) -> f64 {
        match self {
            Self::U8 | Self::U16 | Self::F64 => value,
            Self::F16 => half::f16::from_f64(value).to_f64(),
            Self::F32 => f64::from(value as f32),
        }
    }

    /// Appends the samples in `bytes` (of this machine's byte order) as f32.
    pub(super) fn extend(self, out: &mut Vec<f32>, bytes: &[u8]) {
        match self {
            Self::U8 => out.extend(bytes.iter().map(|&b| f32::from(b))),
            Self::U16 => out.extend(bytes.as_chunks().0.iter().map(|&b| f32::from(u16::from_ne_bytes(b)))),
            Self::F16 => {
                out.extend(bytes.as_chunks().0.iter().map(|&b| half::f16::from_ne_bytes(b).to_f32()));
            }
            Self::F32 => out.extend(bytes.as_chunks().0.iter().map(|&b| f32::from_ne_bytes(b))),
            Self::F64 => out.extend(bytes.as_chunks().0.iter().map(|&b| f64::from_ne_bytes(b) as f32)),
        }
    }
}

/// How the inner chunks of a shard are found.
#[derive(Debug)]
struct ShardIndex {
    chain: BoundedChain,
    at_start: bool,
    bytes: u64,
}

/// The array: its files, their parts, their codecs. Shapes are (bands, rows, columns).
#[derive(Debug)]
pub(super) struct Layout {
    pub(super) store: Arc<Store>,
    /// The array's path in the store; empty for a bare array.
    pub(super) name: String,
    pub(super) array: Array<Store>,
    pub(super) shape: [usize; 3],
    /// One file.
    pub(super) chunk: [usize; 3],
    /// What is decoded at once.
    pub(super) piece: [usize; 3],
    pub(super) sample: Sample,
    /// Raw sample of pixels that are not stored.
    pub(super) fill: f64,
    /// What raw samples mean.
    pub(super) values: Values,
    chain: BoundedChain,
    index: Option<ShardIndex>,
}

impl Layout {
    pub(super) fn new(store: Arc<Store>, name: &str, array: Array<Store>) -> Result<Self, ChartError> {
        let root = store.root().to_path_buf();
        let wrong = |what, expected: &str, found: String| ChartError::Metadata {
            path: root.clone(),
            array: name.into(),
            what,
            expected: expected.into(),
            found,
        };
        let rank = array.shape().len();
        if !(2..=3).contains(&rank) {
            return Err(wrong("dimensions", "(wavelength, y, x) or (y, x)", format!("{:?}", array.shape())));
        }
        let sides: Vec<usize> = array.shape().iter().map(|&n| n as usize).collect();
        let bands = if rank == 3 { sides[0] } else { 1 };
        let pixels = Size::new(sides[rank - 2], sides[rank - 1]);
        if let Err(e) = bounds::chart_size(bands, pixels) {
            return Err(wrong("shape", &e.bound.to_string(), format!("{}: {}", e.bound.name, e.found)));
        }
        let sample = Sample::of(array.data_type()).ok_or_else(|| {
            wrong(
                "sample type",
                "float16, float32, float64, uint8 or uint16",
                format!("{:?}", array.data_type().to_string()),
            )
        })?;
        let grid = match array.metadata() {
            ArrayMetadata::V3(m) => m.chunk_grid.name().to_owned(),
            ArrayMetadata::V2(_) => "regular".to_owned(),
        };
        if grid != "regular" {
            return Err(wrong("chunk grid", "regular", grid));
        }
        let chunk = array
            .chunk_shape(&vec![0; rank])
            .map_err(|e| wrong("chunks", "a regular chunk grid", e.to_string()))?;
        let chunk: Vec<u64> = chunk.iter().map(|n| n.get()).collect();
        let files =
            array.shape().iter().zip(&chunk).try_fold(1u64, |n, (s, c)| n.checked_mul(s.div_ceil(*c)));
        if files.is_none_or(|n| n > MAX_FILES) {
            let found = format!("{:?} in chunks of {chunk:?}", array.shape());
            return Err(wrong(
                "chunks",
                "at most 2^24 files; re-chunk the array, or put it in shards",
                found,
            ));
        }
        let bounded = |chain: &CodecChain| {
            let expected = "bytes (and transpose) under zstd, gzip, zlib, blosc, shuffle and crc32c";
            BoundedChain::new(chain).map_err(|found| wrong("codecs", expected, found))
        };
        let (mut piece, mut chain, mut index) = (chunk.clone(), None, None);
        if let ArrayMetadata::V3(m) = array.metadata()
            && let [codec] = m.codecs.as_slice()
            && codec.name() == "sharding_indexed"
        {
            let c: ShardingCodecConfigurationV1 = codec
                .to_typed_configuration()
                .map_err(|e| wrong("sharding", "a sharding codec", e.to_string()))?;
            piece = c.chunk_shape.iter().map(|n| n.get()).collect();
            let divides = piece.len() == rank && piece.iter().zip(&chunk).all(|(p, c)| c % p == 0);
            if !divides {
                let found = format!("{piece:?} in shards {chunk:?}");
                return Err(wrong("inner chunks", "a divisor of the shard", found));
            }
            let build = |m: &[_]| {
                CodecChain::from_metadata(m).map_err(|e| wrong("codecs", "known codecs", e.to_string()))
            };
            chain = Some(bounded(&build(&c.codecs)?)?);
            let index_codecs = build(&c.index_codecs)?;
            index = Some(
                ShardIndex::new(
                    &index_codecs,
                    bounded(&index_codecs)?,
                    matches!(c.index_location, ShardingIndexLocation::Start),
                    &chunk,
                    &piece,
                )
                .map_err(|found| wrong("shard index", "at most 256 MiB, of fixed size", found))?,
            );
        }
        let bytes = piece.iter().try_fold(sample.bytes() as u64, |n, &s| n.checked_mul(s));
        if bytes.is_none_or(|b| b > MAX_PIECE) {
            let found = format!("{piece:?}");
            let expected = "at most 1 GiB when decoded; re-chunk the array, e.g. into (1, 512, 512)";
            return Err(wrong("chunk", expected, found));
        }
        let chain = match chain {
            Some(chain) => chain,
            None => bounded(&array.codecs())?,
        };
        let three = |v: &[u64]| -> [usize; 3] {
            let first = if rank == 3 { v[0] } else { 1 };
            [first as usize, v[rank - 2] as usize, v[rank - 1] as usize]
        };
        let fill = array.fill_value().as_ne_bytes();
        if fill.len() != sample.bytes() {
            return Err(wrong("fill value", "one sample", format!("{} bytes", fill.len())));
        }
        let fill = sample.raw(fill, 0);
        let written_by_xarray = matches!(array.metadata(), ArrayMetadata::V2(_))
            && array.attributes().contains_key("_ARRAY_DIMENSIONS")
            && fill != 0.0;
        let values = conventions::values(array.attributes(), sample, written_by_xarray.then_some(fill))
            .map_err(|(what, expected, found)| wrong(what, expected, found))?;
        let (shape, chunk, piece) = (three(array.shape()), three(&chunk), three(&piece));
        let name = name.into();
        Ok(Self { store, name, array, shape, chunk, piece, sample, fill, values, chain, index })
    }

    /// Number of pieces along each axis.
    pub(super) fn pieces(&self) -> [usize; 3] {
        std::array::from_fn(|k| self.shape[k].div_ceil(self.piece[k]))
    }

    /// One number per piece.
    pub(super) fn number(&self, p: [usize; 3]) -> u64 {
        let n = self.pieces().map(|n| n as u64);
        (p[0] as u64 * n[1] + p[1] as u64) * n[2] + p[2] as u64
    }

    /// Bands and pixels of piece `p` that lie inside the chart.
    pub(super) fn extent(&self, p: [usize; 3]) -> (std::ops::Range<usize>, Rect) {
        let start: [usize; 3] = std::array::from_fn(|k| p[k] * self.piece[k]);
        let count: [usize; 3] = std::array::from_fn(|k| self.piece[k].min(self.shape[k] - start[k]));
        let rect = Rect::new(start[1] as i64, start[2] as i64, count[1], count[2]);
        (start[0]..start[0] + count[0], rect)
    }

    fn file_of(&self, p: [usize; 3]) -> [usize; 3] {
        std::array::from_fn(|k| p[k] / (self.chunk[k] / self.piece[k]))
    }

    /// The key of the file that holds piece `p`, relative to the store.
    pub(super) fn key(&self, p: [usize; 3]) -> String {
        let indices = self.file_of(p).map(|i| i as u64);
        self.array.chunk_key(self.trim(&indices)).as_str().to_owned()
    }

    /// The keys of all files that the array may have.
    pub(super) fn keys(&self) -> Vec<String> {
        let files: [usize; 3] = std::array::from_fn(|k| self.shape[k].div_ceil(self.chunk[k]));
        let per = self.per_file();
        let all = (0..files.iter().product()).map(|n: usize| {
            let file = [n / (files[1] * files[2]), n / files[2] % files[1], n % files[2]];
            self.key(std::array::from_fn(|k| file[k] * per[k]))
        });
        all.collect()
    }

    /// Whether `key`, relative to the array, is that of one of its files, in whatever key encoding the array has.
    pub(super) fn is_chunk_key(&self, key: &str) -> bool {
        let rank = self.array.shape().len();
        let numbers = key.split(|c: char| !c.is_ascii_digit()).filter(|digits| !digits.is_empty());
        let Ok(index) = numbers.take(rank).map(str::parse).collect::<Result<Vec<u64>, _>>() else {
            return false;
        };
        let files = std::iter::zip(&self.shape, &self.chunk).map(|(n, c)| n.div_ceil(*c) as u64);
        let there = std::iter::zip(&index, files.skip(3 - rank)).all(|(i, n)| *i < n);
        let slash = if self.name.is_empty() { "" } else { "/" };
        let own = || format!("{}{slash}{key}", self.name);
        index.len() == rank && there && self.array.chunk_key(&index).as_str() == own()
    }

    /// The path of that file.
    pub(super) fn file(&self, p: [usize; 3]) -> PathBuf {
        self.store.root().join(self.key(p))
    }

    /// A chunk may be missing from a chart, but not because the chart itself has been removed or unmounted.
    pub(super) fn still_there(&self) -> Result<(), ChartError> {
        let slash = if self.name.is_empty() { "" } else { "/" };
        for file in ["zarr.json", ".zarray"] {
            if self.store.size_of(&format!("{}{slash}{file}", self.name))?.is_some() {
                return Ok(());
            }
        }
        let path = self.store.root().join(&self.name);
        Err(crate::durable::DurableError::Vanished { path, missing: "metadata".into() }.into())
    }

    /// One number per file.
    pub(super) fn file_number(&self, p: [usize; 3]) -> u64 {
        let n: [u64; 3] = std::array::from_fn(|k| self.shape[k].div_ceil(self.chunk[k]) as u64);
        let f = self.file_of(p).map(|i| i as u64);
        (f[0] * n[1] + f[1]) * n[2] + f[2]
    }

    /// Drops the band axis that a 2-D array does not have.
    fn trim<'a, T>(&self, v: &'a [T; 3]) -> &'a [T] {
        &v[3 - self.array.shape().len()..]
    }

    pub(super) fn size(&self) -> Size {
        Size::new(self.shape[1], self.shape[2])
    }

    /// Whether pieces are found through a shard's index.
    pub(super) fn is_sharded(&self) -> bool {
        self.index.is_some()
    }

    /// Reads the index of the shard that holds `p`: (offset, length) of every inner chunk. `None`: no such shard.
    pub(super) fn read_index(&self, p: [usize; 3]) -> Result<Option<Vec<u64>>, ChartError> {
        let Some(index) = &self.index else { return Ok(None) };
        let offset = if index.at_start { 0 } else { -(index.bytes as i64) };
        let bytes = match self.store.read_range(&self.key(p), offset, index.bytes) {
            Err(e @ crate::durable::DurableError::Range { .. }) => return Err(self.corrupt(p, e.to_string())),
            other => other?,
        };
        let Some(bytes) = bytes else { return Ok(None) };
        let shape = index_shape(&self.per_file().map(|n| n as u64));
        let decoded =
            self.decode(p, &index.chain, bytes, &shape, &data_type::uint64(), &FillValue::from(u64::MAX))?;
        Ok(Some(decoded.as_chunks().0.iter().map(|&b| u64::from_ne_bytes(b)).collect()))
    }

    fn per_file(&self) -> [usize; 3] {
        std::array::from_fn(|k| self.chunk[k] / self.piece[k])
    }

    /// The encoded bytes of piece `p`, given its shard's index. `None`: not stored.
    pub(super) fn read_encoded(
        &self,
        p: [usize; 3],
        index: Option<&[u64]>,
    ) -> Result<Option<Vec<u8>>, ChartError> {
        // Codecs may lengthen a little what they cannot shorten; more than that is no chunk of ours.
        let decoded = self.piece.iter().product::<usize>() as u64 * self.sample.bytes() as u64;
        let limit = decoded * 2 + (1 << 20);
        let read = match index {
            None if self.is_sharded() => return Ok(None),
            None => self.store.read_at_most(&self.key(p), limit),
            Some(index) => {
                let slot = self.slot(p);
                let (offset, length) = (index[slot], index[slot + 1]);
                if offset == u64::MAX && length == u64::MAX {
                    return Ok(None);
                }
                let Some(offset) = i64::try_from(offset).ok().filter(|_| length <= limit) else {
                    let reason = format!("its index says {length} bytes at offset {offset}");
                    return Err(self.corrupt(p, reason));
                };
                self.store.read_range(&self.key(p), offset, length)
            }
        };
        use crate::durable::DurableError::{Length, Range};
        match read {
            Err(e @ (Length { .. } | Range { .. })) => Err(self.corrupt(p, e.to_string())),
            other => Ok(other?),
        }
    }

    /// Tells the system that piece `p` will be read, by its shard's index if it has one.
    pub(super) fn will_read(&self, p: [usize; 3], index: Option<&[u64]>) {
        let range = match index {
            None if self.is_sharded() => return,
            None => Some((0, 0)),
            Some(index) => {
                let slot = self.slot(p);
                (index[slot] != u64::MAX).then_some((index[slot], index[slot + 1]))
            }
        };
        if let Some((offset, length)) = range {
            self.store.will_read(&self.key(p), offset, length);
        }
    }

    /// Where piece `p` stands in its shard's index: (offset, length).
    fn slot(&self, p: [usize; 3]) -> usize {
        let per = self.per_file();
        let [b, i, j]: [usize; 3] = std::array::from_fn(|k| p[k] % per[k]);
        ((b * per[1] + i) * per[2] + j) * 2
    }

    /// Decodes piece `p` into samples of this machine's byte order, the part beyond the chart's edge included.
    pub(super) fn decode_piece(&self, p: [usize; 3], encoded: Vec<u8>) -> Result<Vec<u8>, ChartError> {
        let samples = self.piece.iter().product::<usize>() * self.sample.bytes();
        let shape = self.piece.map(|n| NonZeroU64::new(n as u64).expect("chunks are not empty"));
        let shape = self.trim(&shape).to_vec();
        let (t, fill) = (self.array.data_type().clone(), self.array.fill_value().clone());
        let decoded = self.decode(p, &self.chain, encoded, &shape, &t, &fill)?;
        if decoded.len() != samples {
            return Err(self.corrupt(p, format!("it holds {} bytes, expected {samples}", decoded.len())));
        }
        Ok(decoded)
    }

    fn decode(
        &self,
        p: [usize; 3],
        chain: &BoundedChain,
        bytes: Vec<u8>,
        shape: &[NonZeroU64],
        t: &DataType,
        fill: &FillValue,
    ) -> Result<Vec<u8>, ChartError> {
        chain.decode(Cow::Owned(bytes), shape, t, fill).map_err(|reason| self.corrupt(p, reason))
    }

    pub(super) fn corrupt(&self, p: [usize; 3], reason: String) -> ChartError {
        let (bands, region) = self.extent(p);
        ChartError::Corrupt {
            path: self.file(p),
            first_band: bands.start,
            end_band: bands.end,
            region,
            reason,
        }
    }
}

impl ShardIndex {
    fn new(
        codecs: &CodecChain,
        chain: BoundedChain,
        at_start: bool,
        chunk: &[u64],
        piece: &[u64],
    ) -> Result<Self, String> {
        let per: Vec<u64> = chunk.iter().zip(piece).map(|(c, p)| c / p).collect();
        let bytes = per.iter().try_fold(16u64, |n, &s| n.checked_mul(s));
        if bytes.is_none_or(|b| b > MAX_INDEX) {
            return Err(format!("{per:?} inner chunks a shard"));
        }
        let shape = index_shape(&per);
        match codecs.encoded_representation(&shape, &data_type::uint64(), &FillValue::from(u64::MAX)) {
            Ok(BytesRepresentation::FixedSize(bytes)) => Ok(Self { chain, at_start, bytes }),
            Ok(other) => Err(format!("{other:?}")),
            Err(e) => Err(e.to_string()),
        }
    }
}

fn index_shape(per: &[u64]) -> Vec<NonZeroU64> {
    per.iter().copied().chain([2]).filter_map(NonZeroU64::new).collect()
}
