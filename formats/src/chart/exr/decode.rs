//! Decoding of the blocks of an OpenEXR file to bands.

use std::collections::HashSet;
use std::fs::File;
use std::io::BufReader;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use ::exr::block::UncompressedBlock;
use ::exr::block::reader::ChunksReader;
use ::exr::meta::attribute::SampleType;
use ::exr::meta::header::Header;

use pipeline::geometry::Size;

use super::header::{check_header, content, named_channel};
use crate::chart::decoded_chart::{BandDecoder, Sink};
use crate::chart::error::ChartError;
use crate::durable::DurableError;
use crate::parallel::Progress;

/// The blocks of a file.
#[derive(Debug)]
pub(super) struct Blocks {
    pub(super) path: PathBuf,
    pub(super) size: Size,
    /// Channel of the file per band.
    pub(super) channels: Vec<usize>,
    /// Names of which the first one that exists is the only band; empty: the bands of the content.
    pub(super) wanted: Vec<String>,
    /// Size of the largest decoded block.
    pub(super) block_bytes: usize,
}

impl BandDecoder for Blocks {
    /// Blocks are read one after the other and decoded on `threads` threads that hold one each. Parts are pixels.
    fn decode(
        &self,
        bands: &[usize],
        threads: usize,
        progress: Progress<'_>,
        sink: Sink<'_>,
    ) -> Result<(), ChartError> {
        let damaged = |reason: String| ChartError::Damaged { path: self.path.clone(), reason };
        let file = File::open(&self.path).map_err(|e| DurableError::io("open", &self.path, 0, e))?;
        let open = || {
            let reader = ::exr::block::read(BufReader::with_capacity(1 << 20, file), false)?;
            reader.filter_chunks(false, |_, _, block| block.level == ::exr::prelude::Vec2(0, 0))
        };
        let reader = catch_unwind(AssertUnwindSafe(open))
            .unwrap_or_else(|_| Err(::exr::error::Error::Invalid("invalid blocks".into())))
            .map_err(|e| damaged(e.to_string()))?;
        let meta = reader.meta_data().clone();
        let header = meta.headers.first().ok_or_else(|| damaged("no layer".into()))?;
        // The file may have been replaced since it was opened.
        check_header(&self.path, header, u64::MAX)?;
        let channels = match self.wanted.is_empty() {
            true => content(&self.path, header)?.1,
            false => vec![named_channel(&self.path, header, &self.wanted)?],
        };
        if channels != self.channels
            || (header.layer_size.height(), header.layer_size.width()) != (self.size.height, self.size.width)
        {
            return Err(damaged("it changed after it was opened".into()));
        }
        let mut band_of = vec![None; header.channels.list.len()];
        bands.iter().for_each(|&band| band_of[self.channels[band]] = Some(band));
        let seen = Mutex::new(HashSet::new());
        let (reader, done, total) = (Mutex::new(reader), AtomicU64::new(0), self.size.pixels() as u64);
        let work = || -> Result<(), ChartError> {
            loop {
                let next = || reader.lock().unwrap_or_else(std::sync::PoisonError::into_inner).next();
                let block = || match next() {
                    None => Ok(None),
                    Some(chunk) => UncompressedBlock::decompress_chunk(chunk?, &meta, false).map(Some),
                };
                let block = catch_unwind(AssertUnwindSafe(block))
                    .unwrap_or_else(|_| {
                        Err(::exr::error::Error::Invalid("the decoder failed on a block".into()))
                    })
                    .map_err(|e| damaged(e.to_string()))?;
                let Some(block) = block else { return Ok(()) };
                let position = (block.index.pixel_position.x(), block.index.pixel_position.y());
                if !seen.lock().expect("no panic while held").insert(position) {
                    return Err(damaged(format!("two blocks at column {}, row {}", position.0, position.1)));
                }
                let pixels = self.write_block(header, &block, &band_of, sink)?;
                progress(done.fetch_add(pixels, Relaxed) + pixels, total);
            }
        };
        std::thread::scope(|s| {
            let threads: Vec<_> = (0..threads.max(1)).map(|_| s.spawn(work)).collect();
            threads.into_iter().try_for_each(|t| t.join().expect("workers return their errors"))
        })?;
        match done.into_inner() {
            n if n == total => Ok(()),
            n => Err(damaged(format!("it holds {n} pixels of {total}"))),
        }
    }

    /// A block: read, decompressed, and as values.
    fn thread_bytes(&self) -> usize {
        3 * self.block_bytes
    }
}

impl Blocks {
    /// Gives a block's rows to `sink` by band; returns the number of its pixels.
    fn write_block(
        &self,
        header: &Header,
        block: &UncompressedBlock,
        band_of: &[Option<usize>],
        sink: Sink<'_>,
    ) -> Result<u64, ChartError> {
        let (width, height) = (block.index.pixel_size.x(), block.index.pixel_size.y());
        let (x, y) = (block.index.pixel_position.x(), block.index.pixel_position.y());
        let bytes = header.channels.bytes_per_pixel * width * height;
        if x + width > self.size.width || y + height > self.size.height || block.data.len() != bytes {
            let reason = format!("a block of {width}x{height} px at column {x}, row {y}");
            return Err(ChartError::Damaged { path: self.path.clone(), reason });
        }
        let mut rest = &block.data[..];
        for row in y..y + height {
            for (channel, band) in header.channels.list.iter().zip(band_of) {
                let (line, after) = rest.split_at(width * channel.sample_type.bytes_per_sample());
                rest = after;
                let Some(band) = *band else { continue };
                let floats: Vec<u8>;
                let samples = match channel.sample_type {
                    SampleType::F16 => {
                        let halves = line.as_chunks().0.iter();
                        floats = halves
                            .flat_map(|b| half::f16::from_ne_bytes(*b).to_f32().to_ne_bytes())
                            .collect();
                        &floats[..]
                    }
                    _ => line,
                };
                sink(&self.path, band, row, x, samples)?;
            }
        }
        Ok((width * height) as u64)
    }
}
