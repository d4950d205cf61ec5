//! Decoding of chunks, as many side by side as fit in a buffer (a *strip*), so that rows are given in long runs.
//!
//! Uncompressed chunks are read directly, some rows at a time. Deflated ones are decoded whole by [`crate::inflate`]; what that cannot decode, and
//! every other compression, is decoded by the crate `tiff`, whose error is reported.

use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;

use super::BandSink;
use super::page::{Coding, Page, READ_BYTES};
use super::predictor::{Predictor, add_horizontally, join_floats};
use crate::durable::DurableError;
use crate::image::header::{ImageError, MAX_DECODED_BYTES, guarded};

/// Bytes of the decoded chunks of a strip, unless one is larger; rows of such a one are given in parts of this size.
pub(super) const STRIP_BYTES: usize = 8 << 20;

/// Chunks of `bytes` side by side in a strip of an image of `across` of them.
pub(super) fn strip_chunks(bytes: usize, across: usize) -> usize {
    (STRIP_BYTES / bytes.max(1)).clamp(1, across.max(1))
}

/// Buffers that chunks of a page are decoded to.
#[derive(Default)]
pub(super) struct Buffers {
    encoded: Vec<u8>,
    /// Rows of a chunk, in native byte order.
    chunk: Vec<u8>,
    /// Bytes of one of them.
    stride: usize,
    /// Rows of the wanted bands, band after band.
    strip: Vec<u8>,
}

impl Buffers {
    /// Sets `rows` rows of the chunk to the sample `fill`.
    fn fill(&mut self, fill: &[u8], rows: usize) {
        self.chunk.resize(rows * self.stride, 0);
        self.chunk.chunks_exact_mut(fill.len()).for_each(|sample| sample.copy_from_slice(fill));
    }
}

impl Page {
    fn strip_chunks(&self) -> usize {
        let (across, down) = self.chunk;
        strip_chunks(across.saturating_mul(down).saturating_mul(self.pixel_bytes()), self.chunks_across())
    }

    fn strips_across(&self) -> usize {
        self.chunks_across().div_ceil(self.strip_chunks())
    }

    pub(super) fn strips_per_plane(&self) -> usize {
        self.strips_across() * self.chunk_rows()
    }

    /// Decodes a strip of a plane whose first sample belongs to `first_band`; only samples of `bands` are given to `sink`.
    pub(super) fn decode_strip<E: From<ImageError>>(
        &mut self,
        path: &Path,
        (plane, strip): (usize, usize),
        first_band: usize,
        bands: &[usize],
        sink: BandSink<'_, E>,
    ) -> Result<(), E> {
        let (across, down) = self.chunk;
        let size = self.layout.size;
        let (chunk_row, first) =
            (strip / self.strips_across(), strip % self.strips_across() * self.strip_chunks());
        let columns = first..(first + self.strip_chunks()).min(self.chunks_across());
        let (y, x) = (chunk_row * down, first * across);
        let height = down.min(size.height - y);
        let width = (columns.len() * across).min(size.width - x);
        let (samples, sample) = (self.samples_in_chunk(), self.layout.sample.bytes());
        let wanted: &[usize] = if samples == 1 { &[0] } else { bands };
        let rows = match self.coding {
            Coding::Raw => (READ_BYTES / (columns.len() * across * self.pixel_bytes())).clamp(1, height),
            _ if columns.len() == 1 => (STRIP_BYTES / (across * self.pixel_bytes())).clamp(1, height),
            _ => height,
        };
        let mut buffers = std::mem::take(&mut self.buffers);
        for start in (0..height).step_by(rows) {
            let part = start..(start + rows).min(height);
            let count = part.len();
            buffers.strip.resize(wanted.len() * count * width * sample, 0);
            for j in columns.clone() {
                let left = j * across - x;
                let index = plane * self.chunks_per_plane() + chunk_row * self.chunks_across() + j;
                let in_image = (across.min(width - left), height);
                let first = match self.coding {
                    Coding::Raw => {
                        self.read_rows(path, index, part.clone(), &mut buffers)?;
                        0
                    }
                    _ => {
                        if start == 0 {
                            self.decode_chunk(path, index, in_image, &mut buffers)?;
                        }
                        start
                    }
                };
                let lines = buffers.chunk.chunks_exact(buffers.stride).skip(first).take(count);
                for (line, from) in lines.enumerate() {
                    for (k, position) in wanted.iter().enumerate() {
                        let at = ((k * count + line) * width + left) * sample;
                        let to = &mut buffers.strip[at..at + in_image.0 * sample];
                        self.layout.sample.gather(&from[position * sample..], samples, to);
                    }
                }
            }
            for (position, pixels) in wanted.iter().zip(buffers.strip.chunks_exact(count * width * sample)) {
                let (band, row) = (first_band + position, y + start);
                if width == size.width {
                    sink(band, row, 0, pixels)?;
                    continue;
                }
                for (row, pixels) in (row..).zip(pixels.chunks_exact(width * sample)) {
                    sink(band, row, x, pixels)?;
                }
            }
        }
        self.buffers = buffers;
        Ok(())
    }

    /// Reads `rows` of the uncompressed chunk `index`.
    fn read_rows(
        &self,
        path: &Path,
        index: usize,
        rows: Range<usize>,
        buffers: &mut Buffers,
    ) -> Result<(), ImageError> {
        buffers.stride = self.chunk.0 * self.pixel_bytes();
        if self.is_sparse(index) {
            buffers.fill(&self.fill, rows.len());
            return Ok(());
        }
        buffers.chunk.resize(rows.len() * buffers.stride, 0);
        let at = self.offsets[index] + (rows.start * buffers.stride) as u64;
        self.read_at(path, at, &mut buffers.chunk)?;
        self.to_native_order(&mut buffers.chunk);
        Ok(())
    }

    /// Decodes the chunk `index`, of which (`width`, `height`) lie inside the image.
    fn decode_chunk(
        &mut self,
        path: &Path,
        index: usize,
        (width, height): (usize, usize),
        buffers: &mut Buffers,
    ) -> Result<(), ImageError> {
        if self.is_sparse(index) {
            buffers.stride = self.chunk.0 * self.pixel_bytes();
            buffers.fill(&self.fill, height);
            return Ok(());
        }
        if let Coding::Deflate(predictor) = self.coding
            && self.inflate(path, index, height, predictor, buffers)?
        {
            return Ok(());
        }
        // Of planar files the decoder does not cut chunks of later planes at the image's edges.
        let (columns, rows) = self.decoder.chunk_data_dimensions(index as u32);
        buffers.stride = (columns as usize).max(width) * self.pixel_bytes();
        buffers.chunk.clear();
        buffers.chunk.resize((rows as usize).max(height) * buffers.stride, 0);
        guarded(path, || self.decoder.read_chunk_bytes(index as u32, &mut buffers.chunk)).map(drop)
    }

    /// Decodes a deflated chunk; `false` if its stream is damaged or not of the expected size.
    fn inflate(
        &self,
        path: &Path,
        index: usize,
        height: usize,
        predictor: Predictor,
        buffers: &mut Buffers,
    ) -> Result<bool, ImageError> {
        let (across, down) = self.chunk;
        let stride = across * self.pixel_bytes();
        buffers.stride = stride;
        let bytes = if self.is_tiled { down * stride } else { height * stride };
        let Some(encoded) = usize::try_from(self.counts[index]).ok().filter(|n| *n <= MAX_DECODED_BYTES)
        else {
            return Ok(false);
        };
        buffers.encoded.resize(encoded, 0);
        self.read_at(path, self.offsets[index], &mut buffers.encoded)?;
        buffers.chunk.resize(bytes, 0);
        if crate::inflate::zlib(&buffers.encoded, &mut buffers.chunk) != Ok(bytes) {
            return Ok(false);
        }
        let (samples, sample) = (self.samples_in_chunk(), self.layout.sample.bytes());
        let Buffers { encoded, chunk, .. } = buffers;
        if predictor != Predictor::Float {
            self.to_native_order(chunk);
        }
        for row in chunk.chunks_exact_mut(stride) {
            match predictor {
                Predictor::None => break,
                Predictor::Horizontal => add_horizontally(row, samples, sample),
                Predictor::Float => join_floats(row, samples, sample, encoded),
            }
        }
        Ok(true)
    }

    fn read_at(&self, path: &Path, offset: u64, out: &mut [u8]) -> Result<(), ImageError> {
        match self.file.read_exact_at(out, offset) {
            Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => {
                let found = self.file.metadata().map_or(0, |m| m.len());
                Err(ImageError::Short { path: path.into(), expected: offset + out.len() as u64, found })
            }
            other => Ok(other.map_err(|e| DurableError::io("read", path, out.len() as u64, e))?),
        }
    }

    fn to_native_order(&self, samples: &mut [u8]) {
        if self.big_endian != cfg!(target_endian = "big") {
            samples.chunks_exact_mut(self.layout.sample.bytes()).for_each(<[u8]>::reverse);
        }
    }
}
