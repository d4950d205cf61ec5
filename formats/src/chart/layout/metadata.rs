//! Layout of an array from its Zarr metadata, with bounds on every size before memory is allocated.

use std::num::NonZeroU64;
use std::sync::Arc;

use pipeline::bounds;
use pipeline::geometry::Size;
use zarrs::array::codec::CodecChain;
use zarrs::array::{
    Array, ArrayMetadata, ArrayToBytesCodecTraits, BytesRepresentation, FillValue, data_type,
};
use zarrs::metadata_ext::codec::sharding::{ShardingCodecConfigurationV1, ShardingIndexLocation};

use super::{Layout, ShardIndex};
use crate::bounded::{BoundedChain, MAX_CODECS};
use crate::chart::axes::AxisOrder;
use crate::chart::conventions;
use crate::chart::error::ChartError;
use crate::durable::Store;
use crate::sample::{RasterSample, Sample};

/// Maximum size of a decoded chunk: each thread holds one.
const MAX_CHUNK_BYTES: u64 = 1 << 30;
/// Maximum size of a shard index: 16 million inner chunks.
const MAX_INDEX_BYTES: u64 = 256 << 20;
/// Maximum number of files of an array: their names and sizes are listed in memory.
const MAX_FILES: u64 = 1 << 24;

impl Layout {
    /// Checks the metadata of `array`, whose path in `store` is `name` and whose axes have `order`.
    pub(crate) fn new(
        store: Arc<Store>,
        name: &str,
        array: Array<Store>,
        order: AxisOrder,
    ) -> Result<Self, ChartError> {
        let root = store.root().to_path_buf();
        let invalid = |what, expected: &str, found: String| ChartError::Metadata {
            path: root.clone(),
            array: name.into(),
            what,
            expected: expected.into(),
            found,
        };
        let rank = array.shape().len();
        if !(2..=3).contains(&rank) {
            return Err(invalid(
                "dimensions",
                "(wavelength, y, x) or (y, x)",
                format!("{:?}", array.shape()),
            ));
        }
        let sides: Vec<usize> = array.shape().iter().map(|&n| n as usize).collect();
        let [bands, rows, columns] = order.to_chart(&sides, 1);
        if let Err(e) = bounds::chart_size(bands, Size::new(rows, columns)) {
            return Err(invalid("shape", &e.bound.to_string(), format!("{}: {}", e.bound.name, e.found)));
        }
        let sample = Sample::from_zarr(array.data_type()).ok_or_else(|| {
            invalid(
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
            return Err(invalid("chunk grid", "regular", grid));
        }
        let file_shape = array
            .chunk_shape(&vec![0; rank])
            .map_err(|e| invalid("chunks", "a regular chunk grid", e.to_string()))?;
        let file_shape: Vec<u64> = file_shape.iter().map(|n| n.get()).collect();
        let files =
            array.shape().iter().zip(&file_shape).try_fold(1u64, |n, (s, c)| n.checked_mul(s.div_ceil(*c)));
        if files.is_none_or(|n| n > MAX_FILES) {
            let found = format!("{:?} in chunks of {file_shape:?}", array.shape());
            return Err(invalid(
                "chunks",
                "at most 2^24 files; re-chunk the array, or put it in shards",
                found,
            ));
        }
        let bounded = |chain: &CodecChain| {
            let expected = format!(
                "bytes (and transpose) under zstd, gzip, zlib, blosc, shuffle and crc32c, at most {MAX_CODECS} in all"
            );
            BoundedChain::new(chain).map_err(|found| invalid("codecs", &expected, found))
        };
        let (mut chunk_shape, mut chain, mut index) = (file_shape.clone(), None, None);
        if let ArrayMetadata::V3(m) = array.metadata()
            && let [codec] = m.codecs.as_slice()
            && codec.name() == "sharding_indexed"
        {
            let c: ShardingCodecConfigurationV1 = codec
                .to_typed_configuration()
                .map_err(|e| invalid("sharding", "a sharding codec", e.to_string()))?;
            chunk_shape = c.chunk_shape.iter().map(|n| n.get()).collect();
            let divides =
                chunk_shape.len() == rank && chunk_shape.iter().zip(&file_shape).all(|(c, f)| f % c == 0);
            if !divides {
                let found = format!("{chunk_shape:?} in shards {file_shape:?}");
                return Err(invalid("inner chunks", "a divisor of the shard", found));
            }
            let build = |m: &[_]| {
                CodecChain::from_metadata(m).map_err(|e| invalid("codecs", "known codecs", e.to_string()))
            };
            chain = Some(bounded(&build(&c.codecs)?)?);
            let index_codecs = build(&c.index_codecs)?;
            index = Some(
                ShardIndex::new(
                    &index_codecs,
                    bounded(&index_codecs)?,
                    matches!(c.index_location, ShardingIndexLocation::Start),
                    &file_shape,
                    &chunk_shape,
                )
                .map_err(|found| invalid("shard index", "at most 256 MiB, of fixed size", found))?,
            );
        }
        let bytes = chunk_shape.iter().try_fold(sample.bytes() as u64, |n, &s| n.checked_mul(s));
        if bytes.is_none_or(|b| b > MAX_CHUNK_BYTES) {
            let found = format!("{chunk_shape:?}");
            let expected = "at most 1 GiB when decoded; re-chunk the array, e.g. into (1, 512, 512)";
            return Err(invalid("chunk", expected, found));
        }
        let chain = match chain {
            Some(chain) => chain,
            None => bounded(&array.codecs())?,
        };
        let three = |v: &[u64]| order.to_chart(v, 1).map(|n| n as usize);
        let fill = array.fill_value().as_ne_bytes();
        if fill.len() != sample.bytes() {
            return Err(invalid("fill value", "one sample", format!("{} bytes", fill.len())));
        }
        let fill = sample.read(fill, 0);
        let written_by_xarray = matches!(array.metadata(), ArrayMetadata::V2(_))
            && array.attributes().contains_key("_ARRAY_DIMENSIONS")
            && fill != 0.0;
        let values = conventions::parse_values(
            array.attributes(),
            RasterSample::Plain(sample),
            written_by_xarray.then_some(fill),
        )
        .map_err(|(what, expected, found)| invalid(what, expected, found))?;
        let (shape, name) = (three(array.shape()), name.into());
        let (file_shape, chunk_shape) = (three(&file_shape), three(&chunk_shape));
        Ok(Self {
            store,
            name,
            array,
            order,
            shape,
            file_shape,
            chunk_shape,
            sample,
            fill,
            values,
            chain,
            index,
        })
    }
}

impl ShardIndex {
    /// Fails with a description if the index is too large or of variable size.
    fn new(
        codecs: &CodecChain,
        chain: BoundedChain,
        at_start: bool,
        file_shape: &[u64],
        chunk_shape: &[u64],
    ) -> Result<Self, String> {
        let chunks: Vec<u64> = file_shape.iter().zip(chunk_shape).map(|(f, c)| f / c).collect();
        let bytes = chunks.iter().try_fold(16u64, |n, &s| n.checked_mul(s));
        if bytes.is_none_or(|b| b > MAX_INDEX_BYTES) {
            return Err(format!("{chunks:?} inner chunks a shard"));
        }
        let shape = index_shape(&chunks);
        match codecs.encoded_representation(&shape, &data_type::uint64(), &FillValue::from(u64::MAX)) {
            Ok(BytesRepresentation::FixedSize(bytes)) => Ok(Self { chain, at_start, bytes }),
            Ok(_) => Err("an index of variable size".into()),
            Err(e) => Err(e.to_string()),
        }
    }
}

/// Shape of the index of a shard of `chunks` inner chunks.
pub(super) fn index_shape(chunks: &[u64]) -> Vec<NonZeroU64> {
    chunks.iter().copied().chain([2]).filter_map(NonZeroU64::new).collect()
}
