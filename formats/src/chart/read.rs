//! Reading rectangles of a chart by way of a cache of decoded chunks.

use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};

use super::band_chunks::BandChunkFile;
use super::decoded::DecodedChunk;
use super::error::ChartError;
use super::store::ChartStore;
use super::values::InvalidSample;
use crate::durable::Store;

impl ChartStore {
    /// A chunk, from the cache or decoded.
    fn chunk(&self, chunk_index: [usize; 3]) -> Result<Arc<DecodedChunk>, ChartError> {
        self.cache.get(self.layout.chunk_number(chunk_index), || {
            let chunk = self.load(chunk_index)?;
            let bytes = chunk.data.len() * 4 + size_of::<DecodedChunk>();
            Ok((chunk, bytes))
        })
    }

    /// Reads, decodes and checks a chunk.
    pub(super) fn load(&self, chunk_index: [usize; 3]) -> Result<DecodedChunk, ChartError> {
        let index = self.shard_index(chunk_index)?;
        let index = index.as_ref().and_then(|i| i.as_deref());
        let number = self.layout.chunk_number(chunk_index);
        let encoded = match self.read_ahead.as_ref().and_then(|ahead| ahead.take(number)) {
            Some(read) => self.layout.encoded(chunk_index, read)?,
            None if self.read_ahead.is_some() => self.layout.read_direct(chunk_index, index)?,
            None => self.layout.read_encoded(chunk_index, index)?,
        };
        // After the read, so that the bytes are of the file that the identity describes.
        self.check_file_unchanged(chunk_index)?;
        let Some(encoded) = encoded else {
            self.layout.check_exists()?;
            return Ok(self.missing_chunk(chunk_index));
        };
        self.counters.bytes_read.fetch_add(encoded.len() as u64, Relaxed);
        let start = Instant::now();
        let decoded = self.layout.decode_chunk(chunk_index, &encoded)?;
        let chunk = self.convert(chunk_index, &decoded);
        self.counters.chunks_decoded.fetch_add(1, Relaxed);
        self.counters.decode_ns.fetch_add(start.elapsed().as_nanos() as u64, Relaxed);
        Ok(chunk)
    }

    /// Checks the file of a chunk against the state recorded by [`ChartStore::identity`].
    fn check_file_unchanged(&self, chunk_index: [usize; 3]) -> Result<(), ChartError> {
        let file = self.layout.file_path(chunk_index);
        let array = self.array_path();
        let key = file.strip_prefix(&array).unwrap_or(&file).to_string_lossy();
        self.file_states.check_unchanged(&key, &file).or_else(|changed| {
            self.layout.check_exists()?;
            Err(changed)
        })
    }

    /// The index of the shard that holds a chunk: outer `None` if the array is not sharded, inner `None` if the shard is missing.
    #[allow(clippy::type_complexity, reason = "a shared, optional value of the cache")]
    fn shard_index(&self, chunk_index: [usize; 3]) -> Result<Option<Arc<Option<Vec<u64>>>>, ChartError> {
        let read = || {
            let index = self.layout.read_index(chunk_index)?;
            let bytes = index.as_ref().map_or(0, |i| i.len() * 8);
            self.counters.bytes_read.fetch_add(bytes as u64, Relaxed);
            Ok::<_, ChartError>((index, bytes + 64))
        };
        let sharded = self.layout.is_sharded();
        sharded.then(|| self.indexes.get(self.layout.file_number(chunk_index), read)).transpose()
    }

    /// The chunks that hold the pixels of `rect` of `band`, row by row; those of an empty one are none, wherever it lies.
    fn chunks_of(&self, band: usize, rect: Rect) -> impl Iterator<Item = [usize; 3]> + use<> {
        let [bands, rows, columns] = self.layout.chunk_shape;
        let is_empty = rect.is_empty();
        let range = |first: i64, end: i64, side: usize| {
            if is_empty { 0..0 } else { first as usize / side..(end as usize).div_ceil(side) }
        };
        let (down, across) = (range(rect.y, rect.bottom(), rows), range(rect.x, rect.right(), columns));
        down.flat_map(move |i| across.clone().map(move |j| [band / bands, i, j]))
    }

    /// A chunk of fill values.
    fn missing_chunk(&self, chunk_index: [usize; 3]) -> DecodedChunk {
        let (bands, rect) = self.layout.chunk_extent(chunk_index);
        let number = self.layout.chunk_number(chunk_index);
        let pixels = (bands.len() * rect.size().pixels()) as u64;
        self.counters.missing.lock().expect("no panic while counting").insert(number, pixels);
        let values = &self.layout.values;
        let mut errors = Vec::new();
        let mut replaced = Vec::new();
        // A store has one scale for all bands.
        let mut fill = [values.converter(bands.start)(self.layout.fill)];
        let checked = values.check(bands.start, &mut fill, |_| self.layout.fill, self.options.nan);
        if let Some((_, error)) = checked.error {
            errors.extend(bands.clone().map(|b| (b, rect.y as usize, rect.x as usize, error)));
        }
        if checked.replaced > 0 {
            replaced.extend(bands.clone().map(|b| (b, rect.size().pixels() as u64)));
        }
        DecodedChunk { bands, rect, data: Vec::new(), fill: fill[0], missing: true, errors, replaced }
    }

    /// Converts the decoded samples of a chunk to values, and checks them.
    fn convert(&self, chunk_index: [usize; 3], decoded: &[u8]) -> DecodedChunk {
        let (bands, rect) = self.layout.chunk_extent(chunk_index);
        let [per_band, per_row, step] = self.layout.chunk_strides();
        let (sample, values) = (self.layout.sample, &self.layout.values);
        let mut gathered = Vec::new();
        let (height, width) = (rect.height, rect.width);
        let mut data = Vec::with_capacity(bands.len() * height * width);
        let (mut errors, mut replaced) = (Vec::new(), Vec::new());
        for band in bands.clone() {
            let (mut first, mut count) = (None, 0);
            for row in 0..height {
                let start = (band - bands.start) * per_band + row * per_row;
                let from = data.len();
                let line = &decoded[start * sample.bytes()..];
                let line = match step {
                    1 => &line[..width * sample.bytes()],
                    _ => {
                        gathered.clear();
                        let pixels = line.chunks(step * sample.bytes()).take(width);
                        pixels.for_each(|p| gathered.extend_from_slice(&p[..sample.bytes()]));
                        &gathered[..]
                    }
                };
                match values.is_identity() {
                    true => sample.append(&mut data, line),
                    false => sample.append_converted(&mut data, line, values.converter(band)),
                }
                let checked =
                    values.check(band, &mut data[from..], |k| sample.read(line, k), self.options.nan);
                count += checked.replaced;
                if let Some((column, error)) = checked.error {
                    first.get_or_insert((band, rect.y as usize + row, rect.x as usize + column, error));
                }
            }
            errors.extend(first);
            replaced.extend(Some((band, count)).filter(|r| r.1 > 0));
        }
        DecodedChunk { bands, rect, data, fill: 0.0, missing: false, errors, replaced }
    }

    /// The first error of `band` in a chunk; counts its samples without data.
    pub(super) fn check(
        &self,
        chunk_index: [usize; 3],
        chunk: &DecodedChunk,
        band: usize,
    ) -> Result<(), ChartError> {
        if let Some(&(_, pixels)) = chunk.replaced.iter().find(|r| r.0 == band) {
            let key = (self.layout.chunk_number(chunk_index), band);
            self.counters.replaced.lock().expect("no panic while counting").insert(key, pixels);
        }
        let Some(&(band, row, column, error)) = chunk.errors.iter().find(|b| b.0 == band) else {
            return Ok(());
        };
        let fill = self.layout.fill;
        Err(match error {
            InvalidSample::NotFinite(_) | InvalidSample::NoData(_) if chunk.missing => {
                ChartError::MissingChunk {
                    path: self.layout.file_path(chunk_index),
                    band,
                    region: chunk.rect,
                    fill,
                }
            }
            error => {
                error.into_error(self.array_path(), (band, row, column), self.layout.values.max_magnitude)
            }
        })
    }

    /// [`ChartSource::read`] with its own error type.
    ///
    /// # Errors
    /// [`ChartError`] if the rectangle is not in the chart, or its pixels cannot be read.
    pub fn read_rect(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), ChartError> {
        let size = self.layout.size();
        let inside = size.rect().contains(rect) && band < self.bands();
        if !inside || out.len() != rect.size().pixels() {
            return Err(ChartError::Request {
                path: self.array_path(),
                band,
                rect,
                buffer: out.len(),
                bands: self.bands(),
                size,
            });
        }
        if rect.is_empty() {
            return Ok(());
        }
        let band_chunks = self.band_chunks.get().filter(|f| f.contains(band));
        for chunk_index in self.chunks_of(band, rect) {
            let chunk = match band_chunks {
                Some(file) => self.band_chunk(file, band, chunk_index)?,
                None => self.chunk(chunk_index)?,
            };
            self.check(chunk_index, &chunk, band)?;
            let part = rect.intersect(chunk.rect);
            for y in part.y..part.bottom() {
                let start = (y - rect.y) as usize * rect.width + (part.x - rect.x) as usize;
                chunk.copy_row(band, y, part.x, &mut out[start..start + part.width]);
            }
        }
        Ok(())
    }

    /// A chunk of one band, from the temporary file of a re-chunked chart.
    fn band_chunk(
        &self,
        file: &BandChunkFile,
        band: usize,
        chunk_index: [usize; 3],
    ) -> Result<Arc<DecodedChunk>, ChartError> {
        // Cache keys of chunks of single bands follow those of the store's chunks.
        let n = self.layout.chunk_counts();
        let first = n.iter().product::<usize>() as u64;
        let number = first + ((band * n[1] + chunk_index[1]) * n[2] + chunk_index[2]) as u64;
        self.cache.get(number, || {
            let (_, rect) = self.layout.chunk_extent(chunk_index);
            let data = file.read(band, [chunk_index[1], chunk_index[2]], rect.size().pixels())?;
            self.counters.bytes_read.fetch_add(data.len() as u64 * 4, Relaxed);
            let bytes = data.len() * 4 + size_of::<DecodedChunk>();
            let chunk = DecodedChunk {
                bands: band..band + 1,
                rect,
                data,
                fill: 0.0,
                missing: false,
                errors: Vec::new(),
                replaced: Vec::new(),
            };
            Ok((chunk, bytes))
        })
    }
}

impl ChartSource for ChartStore {
    fn size(&self) -> Size {
        self.layout.size()
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        Ok(self.read_rect(band, rect, out)?)
    }

    fn prefetch(&self, band: usize, rect: Rect) {
        let is_local = matches!(&*self.layout.store, Store::Directory(_));
        if band >= self.bands() || self.band_chunks.get().is_some() || !is_local {
            return;
        }
        for chunk_index in self.chunks_of(band, rect.intersect(self.size().rect())) {
            let number = self.layout.chunk_number(chunk_index);
            if self.cache.contains(number) {
                continue;
            }
            let index = self.shard_index(chunk_index).ok().flatten();
            let place = self.layout.place(chunk_index, index.as_ref().and_then(|i| i.as_deref()));
            match (place, &self.read_ahead) {
                (Ok(Some(place)), Some(ahead)) => ahead.request(number, place),
                (Ok(Some(place)), None) => {
                    self.layout.store.will_read(&place.key, place.offset, place.length)
                }
                // The later read reports what is missing or damaged.
                (Ok(None) | Err(_), _) => {}
            }
        }
    }
}
