//! Chunked storage: places of the chunks, and their decoding.
//!
//! A thread decodes the chunks of a *strip*: the same bands and rows, as many columns as fit in a buffer, so that rows are written in long runs.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use hdf5_pure::Filter;

use super::super::axes::AxisOrder;
use super::super::decoded_chart::{BandDecoder, Sink};
use super::super::error::ChartError;
use super::super::header::header_error;
use super::filters;
use super::guard::guarded;
use super::variables::Variable;
use crate::durable::DurableError;
use crate::image::header::MAX_DECODED_BYTES;
use crate::parallel::{self, Progress};
use crate::sample::RasterSample;

/// Bytes of a strip, unless one chunk is larger.
const STRIP_BYTES: usize = 8 << 20;
/// Maximum number of chunks.
const MAX_CHUNKS: usize = 1 << 20;

/// A stored chunk.
#[derive(Clone, Copy, Debug)]
struct Stored {
    number: usize,
    address: u64,
    bytes: u32,
    /// Filters that were not applied.
    mask: u32,
}

/// The chunks of an array. Shapes are (bands, rows, columns).
#[derive(Debug)]
pub(super) struct ChunkGrid {
    path: PathBuf,
    file: File,
    order: AxisOrder,
    shape: [usize; 3],
    chunk: [usize; 3],
    sample: RasterSample,
    little_endian: bool,
    /// A sample of chunks that are not stored, in native byte order.
    fill: Vec<u8>,
    filters: Vec<Filter>,
    /// Ascending.
    stored: Vec<Stored>,
}

impl ChunkGrid {
    /// The chunks of `variable`, of `chunk_shape` and with the array's `sides`, in a `file` of `length` bytes.
    pub(super) fn new(
        path: &Path,
        file: File,
        length: u64,
        variable: &Variable,
        (chunk_shape, sides): (&[u64], &[usize]),
        (sample, little_endian): (RasterSample, bool),
        order: AxisOrder,
    ) -> Result<Self, ChartError> {
        let invalid = |what, expected: &str, found: String| header_error(path, what, expected, found);
        let limit = MAX_DECODED_BYTES as u64;
        let bytes = chunk_shape.iter().try_fold(sample.bytes() as u64, |n, side| n.checked_mul(*side));
        if chunk_shape.len() != sides.len() || bytes.is_none_or(|n| n == 0 || n > limit) {
            let expected = "at most 256 MiB each; h5repack -l CHUNK=1x512x512 IN OUT makes smaller ones";
            return Err(invalid("chunks", expected, format!("{chunk_shape:?} of {}", sample.name())));
        }
        let chunk_sides: Vec<usize> = chunk_shape.iter().map(|&n| n as usize).collect();
        let (shape, chunk) = (order.to_chart(sides, 1), order.to_chart(&chunk_sides, 1));
        let counts: [usize; 3] = std::array::from_fn(|k| shape[k].div_ceil(chunk[k]));
        let count = counts.iter().try_fold(1usize, |n, c| n.checked_mul(*c));
        if count.is_none_or(|n| n > MAX_CHUNKS) {
            let expected = "at most 2^20; h5repack -l CHUNK=1x512x512 IN OUT makes larger ones";
            return Err(invalid("number of chunks", expected, format!("{counts:?}")));
        }
        let filters = variable.dataset.filter_pipeline();
        if let Some(filter) = filters::unsupported(&filters) {
            let expected = "deflate, shuffle, fletcher32, LZF or zstd; h5repack -f GZIP=4 IN OUT rewrites it";
            return Err(invalid("filter", expected, filter.to_string()));
        }
        let fill = guarded(path, || variable.dataset.fill_value::<f64>())?.unwrap_or(0.0);
        let mut stored = Vec::new();
        for found in guarded(path, || variable.dataset.chunks())? {
            let places: Vec<usize> = found.offset.iter().map(|&o| o as usize).collect();
            let first = order.to_chart(&places, 0);
            let index: [usize; 3] = std::array::from_fn(|k| first[k] / chunk[k]);
            let at_corner = (0..3).all(|k| first[k].is_multiple_of(chunk[k])) && places.len() == sides.len();
            let end = found.address.checked_add(found.storage_size);
            if end.is_none_or(|end| end > length) {
                let expected = end.unwrap_or(u64::MAX);
                return Err(ChartError::Short { path: path.into(), expected, found: length });
            }
            let bytes = u32::try_from(found.storage_size).ok().filter(|n| u64::from(*n) <= limit);
            let Some(bytes) = bytes.filter(|_| at_corner) else {
                let found = format!("{} bytes at {places:?}", found.storage_size);
                return Err(invalid("chunk", "at most 256 MiB, at a corner of the grid", found));
            };
            // Chunks beyond the array remain after it is made smaller.
            if (0..3).all(|k| index[k] < counts[k]) {
                let number = (index[0] * counts[1] + index[1]) * counts[2] + index[2];
                stored.push(Stored { number, address: found.address, bytes, mask: found.filter_mask });
            }
        }
        stored.sort_by_key(|s| s.number);
        let fill = sample.to_ne_bytes(fill);
        let path = path.into();
        Ok(Self { path, file, order, shape, chunk, sample, little_endian, fill, filters, stored })
    }

    /// Everything that determines values except the samples.
    pub(super) fn description(&self) -> String {
        let Self { order, shape, chunk, sample, little_endian, fill, .. } = self;
        let filters: Vec<u16> = self.filters.iter().map(|f| f.id).collect();
        let bytes = if *little_endian { "little" } else { "big" };
        format!(
            "{shape:?}, {order}, chunks {chunk:?}, {}, {bytes} endian, fill {fill:?}, filters {filters:?}",
            sample.code()
        )
    }

    fn chunk_bytes(&self) -> usize {
        self.chunk.iter().product::<usize>() * self.sample.bytes()
    }

    fn counts(&self) -> [usize; 3] {
        std::array::from_fn(|k| self.shape[k].div_ceil(self.chunk[k]))
    }

    /// Chunks side by side in a strip.
    fn strip_chunks(&self) -> usize {
        (STRIP_BYTES / self.chunk_bytes()).clamp(1, self.counts()[2])
    }

    /// The samples of a chunk, complete and in native byte order; `None` if it is not stored.
    fn read(&self, number: usize) -> Result<Option<Vec<u8>>, ChartError> {
        let Ok(at) = self.stored.binary_search_by_key(&number, |s| s.number) else { return Ok(None) };
        let Stored { address, bytes, mask, .. } = self.stored[at];
        let mut data = vec![0; bytes as usize];
        self.file
            .read_exact_at(&mut data, address)
            .map_err(|e| DurableError::io("read", &self.path, u64::from(bytes), e))?;
        let sample = self.sample.bytes();
        let shape = (self.chunk_bytes() / sample, sample);
        let mut data =
            filters::invert(&self.filters, mask, data, shape).map_err(|reason| ChartError::Damaged {
                path: self.path.clone(),
                reason: format!("the chunk at byte {address}: {reason}"),
            })?;
        if self.little_endian != cfg!(target_endian = "little") {
            data.chunks_exact_mut(sample).for_each(<[u8]>::reverse);
        }
        Ok(Some(data))
    }

    /// Decodes the strip of chunk columns from `column` on, of chunk row `row`, of the chunks that hold `bands`.
    fn strip(&self, bands: &[usize], row: usize, column: usize, sink: Sink<'_>) -> Result<(), ChartError> {
        let [chunk_bands, chunk_rows, chunk_columns] = self.chunk;
        let [_, down, across] = self.counts();
        let sample = self.sample.bytes();
        let (y, x) = (row * chunk_rows, column * chunk_columns);
        let columns = column..(column + self.strip_chunks()).min(across);
        let height = chunk_rows.min(self.shape[1] - y);
        let width = (columns.len() * chunk_columns).min(self.shape[2] - x);
        let group = bands[0] / chunk_bands;
        let mut strip = vec![0; bands.len() * height * width * sample];
        for j in columns {
            let data = self.read((group * down + row) * across + j)?;
            let left = j * chunk_columns - x;
            let count = chunk_columns.min(width - left);
            for (k, band) in bands.iter().enumerate() {
                let rows = strip[k * height * width * sample..].chunks_exact_mut(width * sample).take(height);
                for (line, to) in rows.enumerate() {
                    let to = &mut to[left * sample..(left + count) * sample];
                    match &data {
                        None => to.chunks_exact_mut(sample).for_each(|p| p.copy_from_slice(&self.fill)),
                        Some(data) => self.copy_row(data, band % chunk_bands, line, to),
                    }
                }
            }
        }
        for (&band, pixels) in std::iter::zip(bands, strip.chunks_exact(height * width * sample)) {
            if width == self.shape[2] {
                sink(&self.path, band, y, 0, pixels)?;
                continue;
            }
            for (line, pixels) in (y..).zip(pixels.chunks_exact(width * sample)) {
                sink(&self.path, band, line, x, pixels)?;
            }
        }
        Ok(())
    }

    /// Copies the start of a row of a band of a chunk.
    fn copy_row(&self, chunk: &[u8], band: usize, row: usize, out: &mut [u8]) {
        let sides = self.order.to_array(&self.chunk);
        let strides: Vec<usize> = (0..sides.len()).map(|k| sides[k + 1..].iter().product()).collect();
        let [per_band, per_row, step] = self.order.to_chart(&strides, 0);
        let sample = self.sample.bytes();
        let from = &chunk[(band * per_band + row * per_row) * sample..];
        self.sample.gather(from, step, out);
    }
}

impl BandDecoder for ChunkGrid {
    fn decode(
        &self,
        bands: &[usize],
        threads: usize,
        progress: Progress<'_>,
        sink: Sink<'_>,
    ) -> Result<(), ChartError> {
        let [_, down, across] = self.counts();
        let groups: Vec<&[usize]> = bands.chunk_by(|a, b| a / self.chunk[0] == b / self.chunk[0]).collect();
        let strips = across.div_ceil(self.strip_chunks());
        parallel::for_each(threads, groups.len() * down * strips, progress, |n| {
            let (group, row, strip) = (groups[n / (down * strips)], n / strips % down, n % strips);
            self.strip(group, row, strip * self.strip_chunks(), sink)
        })
    }

    fn thread_bytes(&self) -> usize {
        let encoded = self.stored.iter().map(|s| s.bytes as usize).max().unwrap_or(0);
        let strip = self.strip_chunks() * self.chunk_bytes();
        // Two steps of the filters.
        encoded + 2 * self.chunk_bytes() + strip
    }
}
