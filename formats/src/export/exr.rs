//! Spectral OpenEXR: one channel per band, in tiles (Fichet, Pacanowski, Wilkie, "An OpenEXR Layout for Spectral Images", JCGT 10(3),
//! 2021).
//!
//! Channels `S0.400,000000nm` (Stokes component 0 of emissive light; the wavelength with a decimal comma, because a point separates layer
//! names), sorted by name as OpenEXR requires; attributes `spectralLayoutVersion` "1.0" and `emissiveUnits`. f32 samples are
//! exact; `half` (IEEE binary16) rounds to 11 bits (2⁻¹¹ of the value; below 6.1e-5 steps of 6e-8), and a value above 65504 is an
//! error. ZIP (16 lines at a time) and PIZ (wavelets, faster) are lossless.
//! A tile contains all bands, so samples are read in [`super::regions`]. Tiles of a region are compressed on all threads; their order in
//! the file depends on the regions, their contents do not.
//! Not written: the optional RGB channels for viewers without spectral support, reflective (`T`) and polarised (`S1`-`S3`) channels.

use std::collections::HashMap;
use std::io::BufWriter;
use std::path::Path;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};

use ::exr::block::chunk::Chunk;
use ::exr::block::writer::ChunksWriter;
use ::exr::block::{BlockIndex, UncompressedBlock};
use ::exr::meta::attribute::{
    AttributeValue, ChannelDescription, LevelMode, SampleType, Text, TileDescription,
};
use ::exr::meta::header::{Header, LayerAttributes};
use ::exr::meta::{BlockDescription, attribute::LineOrder};
use ::exr::prelude::{Compression, SmallVec, Vec2};
use half::f16;
use half::slice::HalfFloatSliceExt;
use pipeline::geometry::Rect;

use super::in_order::in_order;
use super::regions::{Regions, split};
use super::{ExportError, Progress, Samples, Written};
use crate::durable::{AtomicFile, DurableError};

/// Lossless compression of tiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum ExrCompression {
    /// Deflate, 16 lines at a time.
    #[default]
    Zip,
    /// Wavelets and Huffman codes.
    Piz,
    /// Uncompressed.
    None,
}

/// Options of an EXR file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExrOptions {
    /// 16-bit floats.
    pub half: bool,
    /// Compression of tiles.
    pub compression: ExrCompression,
    /// Plan of the reads.
    pub regions: Regions,
}

impl ExrOptions {
    /// Bytes of a sample.
    pub const fn sample_bytes(half: bool) -> usize {
        if half { 2 } else { 4 }
    }
}

/// Channel name of a wavelength.
pub fn channel_name(nm: f64) -> String {
    format!("S0.{nm:.6}nm").replacen('.', "\u{1}", 1).replace('.', ",").replace('\u{1}', ".")
}

/// Writes the file.
///
/// # Errors
/// [`ExportError`]; no file is created then.
pub fn write_exr(
    path: &Path,
    samples: &Samples<'_>,
    options: &ExrOptions,
    progress: Progress<'_>,
) -> Result<Written, ExportError> {
    let (header, order) = header(path, samples, options)?;
    let file = AtomicFile::create(path)?;
    let out = BufWriter::with_capacity(1 << 20, file.writer());
    // The encoder's error type cannot carry an ExportError: it is stored here.
    let mut first_error = None;
    let mut missing = 0;
    let headers = SmallVec::from_vec(vec![header]);
    let result = ::exr::block::write(out, headers, true, |meta, writer| {
        let encoder = Encoder { path, samples, options, order: &order, headers: &meta.headers };
        encoder.write(writer, progress).map(|n| missing = n).map_err(|e| {
            first_error = Some(e);
            ::exr::error::Error::Aborted
        })
    });
    if let Some(error) = first_error {
        return Err(error);
    }
    result.map_err(|e| failed(path, e))?;
    let bytes = file.file().metadata().map_err(|e| DurableError::io("look up", path, 0, e))?.len();
    file.finish()?;
    Ok(Written { bytes, missing })
}

/// The header, and the band index of each channel.
fn header(
    path: &Path,
    samples: &Samples<'_>,
    options: &ExrOptions,
) -> Result<(Header, Vec<usize>), ExportError> {
    let unsupported = |what, expected: &str, found: String| ExportError::Format {
        path: path.into(),
        what,
        expected: expected.into(),
        found,
    };
    let rect = samples.rect;
    if rect.height.max(rect.width) > i32::MAX as usize {
        return Err(unsupported("side in pixels", "at most 2147483647", format!("{}", rect.size())));
    }
    let mut order: Vec<usize> = (0..samples.bands()).collect();
    let names: Vec<String> = samples.wavelengths_nm.iter().map(|&nm| channel_name(nm)).collect();
    order.sort_by(|&a, &b| names[a].cmp(&names[b]));
    if let Some(two) = order.windows(2).find(|two| names[two[0]] == names[two[1]]) {
        let found = format!("bands {} and {} at {}", two[0], two[1], samples.wavelengths_nm[two[0]]);
        return Err(unsupported("wavelengths", "different for every band", found));
    }
    let sample = if options.half { SampleType::F16 } else { SampleType::F32 };
    let channels = order.iter().map(|&b| ChannelDescription::new(names[b].as_str(), sample, true));
    let compression = match options.compression {
        ExrCompression::Zip => Compression::ZIP16,
        ExrCompression::Piz => Compression::PIZ,
        ExrCompression::None => Compression::Uncompressed,
    };
    let tile = TileDescription {
        tile_size: Vec2(options.regions.tile, options.regions.tile),
        level_mode: LevelMode::Singular,
        rounding_mode: ::exr::math::RoundingMode::Down,
    };
    let size = Vec2(rect.width, rect.height);
    let text = |t: &str| AttributeValue::Text(Text::new_or_panic(latin1(t)));
    let comments = Some(Text::new_or_panic(latin1(samples.description)));
    let mut attributes = LayerAttributes { comments, ..LayerAttributes::default() };
    let mut own = vec![("emissiveUnits", text(samples.units.unwrap_or("unknown")))];
    if let Some(pitch_um) = samples.pitch_um {
        let origin = Vec2(rect.x as i32, rect.y as i32);
        own.extend([
            ("originPx", AttributeValue::IntVec2(origin)),
            ("pixelPitchUm", AttributeValue::F64(pitch_um)),
        ]);
    }
    own.push(("spectralLayoutVersion", text("1.0")));
    attributes.other = in_order_of_names(own);
    let header = Header::new(Text::new_or_panic("spectrum"), size, channels.collect())
        .with_encoding(compression, BlockDescription::Tiles(tile), LineOrder::Unspecified)
        .with_attributes(attributes);
    Ok((header, order))
}

/// The attributes as a map that iterates in the given order, in which they are written. The order of a map follows from a random state of its own, so
/// files of equal films would differ: maps are made until one has this order, for four attributes 24 on average.
fn in_order_of_names(attributes: Vec<(&'static str, AttributeValue)>) -> HashMap<Text, AttributeValue> {
    loop {
        let pairs = attributes.iter().map(|(name, value)| (Text::new_or_panic(name), value.clone()));
        let map: HashMap<Text, AttributeValue> = pairs.collect();
        if map.keys().zip(&attributes).all(|(key, (name, _))| key.eq(name)) {
            return map;
        }
    }
}

/// Texts of the format consist of Latin characters of one byte.
fn latin1(text: &str) -> String {
    text.chars().map(|c| if c.is_ascii() || c == 'µ' || c == '²' { c } else { '?' }).collect()
}

struct Encoder<'a> {
    path: &'a Path,
    samples: &'a Samples<'a>,
    options: &'a ExrOptions,
    order: &'a [usize],
    headers: &'a [Header],
}

impl Encoder<'_> {
    /// Writes all regions and returns the number of NaN samples.
    fn write(&self, writer: &mut impl ChunksWriterSend, progress: Progress<'_>) -> Result<u64, ExportError> {
        let (samples, regions) = (self.samples, self.options.regions);
        let all = samples.rect;
        let total = (samples.bands() * all.size().pixels()) as u64;
        let across = all.width.div_ceil(regions.tile);
        let (mut missing, mut done) = (0, 0);
        let mut pixels = Vec::new();
        for region in regions.rects(all) {
            missing += self.read(region, &mut pixels)?;
            let tiles: Vec<Rect> =
                split(region, pipeline::geometry::Size::new(regions.tile, regions.tile), false).collect();
            let make = |n: usize| self.compress(region, tiles[n], &pixels);
            in_order(tiles.len(), samples.threads, make, |n, chunk: Chunk| {
                let tile = tiles[n];
                let (row, column) = ((tile.y - all.y) as usize, (tile.x - all.x) as usize);
                let index = row / regions.tile * across + column / regions.tile;
                writer.write_chunk(index, chunk).map_err(|e| failed(self.path, e))?;
                done += (tile.size().pixels() * samples.bands()) as u64;
                progress(done, total);
                Ok(())
            })?;
        }
        Ok(missing)
    }

    /// Reads all bands of a region, one after the other in `pixels`, and returns the number of NaN samples.
    fn read(&self, region: Rect, pixels: &mut Vec<f32>) -> Result<u64, ExportError> {
        let n = region.size().pixels();
        pixels.resize(n * self.samples.bands(), 0.0);
        let bands: Vec<_> = pixels.chunks_exact_mut(n).map(std::sync::Mutex::new).collect();
        let (next, missing) = (AtomicUsize::new(0), AtomicU64::new(0));
        let work = || -> Result<(), ExportError> {
            loop {
                let band = next.fetch_add(1, Relaxed);
                let Some(out) = bands.get(band) else { return Ok(()) };
                let mut out = out.lock().expect("each band has one reader");
                let count = self
                    .samples
                    .read(band, region, &mut out)
                    .inspect_err(|_| next.store(bands.len(), Relaxed))?;
                missing.fetch_add(count, Relaxed);
            }
        };
        std::thread::scope(|s| {
            let threads: Vec<_> = (0..self.samples.threads.max(1)).map(|_| s.spawn(work)).collect();
            threads.into_iter().try_for_each(|t| t.join().expect("readers return their errors"))
        })?;
        Ok(missing.into_inner())
    }

    /// Compresses one tile of a region: line by line, in each line channel by channel.
    fn compress(&self, region: Rect, tile: Rect, pixels: &[f32]) -> Result<Chunk, ExportError> {
        let n = region.size().pixels();
        let bytes = ExrOptions::sample_bytes(self.options.half);
        let mut data = Vec::with_capacity(tile.size().pixels() * self.order.len() * bytes);
        let mut halves = vec![f16::ZERO; tile.width];
        for y in tile.y..tile.bottom() {
            for &band in self.order {
                let first = band * n + (y - region.y) as usize * region.width + (tile.x - region.x) as usize;
                let line = &pixels[first..first + tile.width];
                if !self.options.half {
                    line.iter().for_each(|v| data.extend(v.to_ne_bytes()));
                    continue;
                }
                halves.convert_from_f32_slice(line);
                if let Some(k) = (0..line.len()).find(|&k| halves[k].is_infinite() && line[k].is_finite()) {
                    let (path, row, value) = (self.path.into(), y as usize, line[k]);
                    return Err(ExportError::Half { path, band, row, column: tile.x as usize + k, value });
                }
                halves.iter().for_each(|v| data.extend(v.to_ne_bytes()));
            }
        }
        let all = self.samples.rect;
        let index = BlockIndex {
            layer: 0,
            pixel_position: Vec2((tile.x - all.x) as usize, (tile.y - all.y) as usize),
            pixel_size: Vec2(tile.width, tile.height),
            level: Vec2(0, 0),
        };
        UncompressedBlock { index, data }.compress_to_chunk(self.headers).map_err(|e| failed(self.path, e))
    }
}

/// A writer shared by threads.
trait ChunksWriterSend: ChunksWriter + Send {}
impl<W: ChunksWriter + Send> ChunksWriterSend for W {}

fn failed(path: &Path, error: ::exr::error::Error) -> ExportError {
    match error {
        ::exr::error::Error::Io(e) => DurableError::io("write", path, 0, e).into(),
        other => ExportError::Format {
            path: path.into(),
            what: "encoding",
            expected: "supported by EXR".into(),
            found: other.to_string(),
        },
    }
}
