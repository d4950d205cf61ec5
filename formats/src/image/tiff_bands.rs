//! Bands of a TIFF 6.0 or BigTIFF file: samples of a pixel side by side (chunky), plane after plane (planar), or page after page.
//!
//! | | supported |
//! |---|---|
//! | samples | u8, u16, i16, f16, f32, f64; all bands of one type |
//! | layout | strips or tiles; chunky, planar, or one band per page |
//! | compression | none, LZW, deflate, PackBits, zstd; predictors |
//!
//! Reduced pages (overviews) and masks are skipped. A *chunk* is a strip or tile of one plane. Compressed chunks are decoded one at a
//! time, each at most 256 MiB; rows of uncompressed ones are read directly, so these may have any size.

use std::fs::File;
use std::io::BufReader;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;

use ::tiff::decoder::{ChunkType, Decoder, Limits};
use ::tiff::tags::{ByteOrder, Tag};
use ::tiff::{TiffError, TiffResult};
use pipeline::geometry::Size;

use super::header::{ImageError, MAX_DECODED_BYTES, guarded, header_error};
use crate::durable::DurableError;
use crate::sample::{RasterSample, Sample};

/// Maximum size of the value of a tag.
const MAX_TAG_BYTES: usize = 64 << 20;
/// Maximum number of pages.
const MAX_PAGES: usize = 65_536;
/// Ranges of chunks into which an image is divided for several threads.
const MAX_RANGES: usize = 64;
/// Bytes of an uncompressed chunk that are read at a time.
const READ_BYTES: usize = 4 << 20;
/// Tags of GDAL.
const GDAL_METADATA: Tag = Tag::Unknown(42112);
const GDAL_NODATA: Tag = Tag::GdalNodata;

/// A file whose headers have been read.
#[derive(Debug)]
pub(crate) struct TiffBands {
    pub(crate) size: Size,
    pub(crate) bands: usize,
    pub(crate) sample: RasterSample,
    /// GDAL's metadata: XML.
    pub(crate) metadata: Option<String>,
    /// GDAL's no-data sample.
    pub(crate) no_data: Option<String>,
    /// Encoded and decoded bytes of the largest unit of decoding.
    pub(crate) decoder_bytes: usize,
    order: Order,
}

#[derive(Clone, Debug, PartialEq)]
enum Order {
    Chunky,
    Planar,
    /// Page of each band.
    Pages(Vec<usize>),
}

/// Part of a file that one thread decodes.
#[derive(Clone, Debug)]
pub(crate) struct TiffPart {
    /// First band in it: the only one, except of a chunky file.
    pub(crate) first_band: usize,
    page: usize,
    /// Chunks of the plane.
    chunks: Range<usize>,
}

/// Receives a row, or part of one: (band, row, column, samples).
pub(crate) type BandSink<'a, E> = &'a mut dyn FnMut(usize, usize, usize, &[f64]) -> Result<(), E>;

/// Properties of a page that all bands share.
#[derive(Clone, Debug, PartialEq)]
struct PageLayout {
    size: Size,
    samples: usize,
    sample: RasterSample,
    planar: bool,
}

/// An open page.
struct Page {
    decoder: Decoder<BufReader<File>>,
    file: File,
    layout: PageLayout,
    /// Columns and rows of a chunk.
    chunk: (usize, usize),
    offsets: Vec<u64>,
    /// Whether chunks are neither compressed nor predicted.
    raw: bool,
    big_endian: bool,
}

fn open_decoder(path: &Path) -> Result<(Decoder<BufReader<File>>, File), ImageError> {
    let open = || File::open(path).map_err(|e| DurableError::io("open", path, 0, e));
    let (file, raw) = (open()?, open()?);
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MAX_DECODED_BYTES;
    limits.intermediate_buffer_size = MAX_DECODED_BYTES;
    limits.ifd_value_size = MAX_TAG_BYTES;
    let decoder = guarded(path, || match Decoder::new(BufReader::with_capacity(1 << 16, file)) {
        Err(TiffError::LimitsExceeded) => Ok(None),
        other => other.map(Some),
    })?;
    let decoder = decoder.ok_or_else(|| {
        header_error(
            path,
            "strips or tiles",
            "at most 131072 of them; store it in larger tiles (gdal_translate -co TILED=YES)",
            "more",
        )
    })?;
    Ok((decoder.with_limits(limits), raw))
}

impl TiffBands {
    /// Reads the headers.
    pub(crate) fn open(path: &Path) -> Result<Self, ImageError> {
        let (mut decoder, file) = open_decoder(path)?;
        let length = file.metadata().map_err(|e| DurableError::io("look up", path, 0, e))?.len();
        let (layout, mut decoder_bytes) = check_page(path, &mut decoder, length)?;
        let text = |decoder: &mut Decoder<_>, tag| guarded(path, || tag_text(decoder, tag));
        let (metadata, no_data) = (text(&mut decoder, GDAL_METADATA)?, text(&mut decoder, GDAL_NODATA)?);
        let mut pages = vec![0];
        for page in 1.. {
            if layout.samples > 1 || !decoder.more_images() {
                break;
            }
            if page == MAX_PAGES {
                return Err(header_error(path, "pages", format!("at most {MAX_PAGES}"), "more"));
            }
            let kind = guarded(path, || {
                decoder.next_image()?;
                decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType)
            })?;
            // Bit 0: a reduced image; bit 2: a mask.
            if kind.unwrap_or(0) & 0b101 != 0 {
                continue;
            }
            let (other, bytes) = check_page(path, &mut decoder, length)?;
            if other != layout {
                let expected = format!("{} of {:?} as on the first page", layout.size, layout.sample);
                let found =
                    format!("{} x {} of {:?} on page {page}", other.size, other.samples, other.sample);
                return Err(header_error(path, "pages", expected, found));
            }
            decoder_bytes = decoder_bytes.max(bytes);
            pages.push(page);
        }
        let (bands, order) = match layout {
            PageLayout { samples: 1, .. } => (pages.len(), Order::Pages(pages)),
            PageLayout { planar: true, samples, .. } => (samples, Order::Planar),
            PageLayout { samples, .. } => (samples, Order::Chunky),
        };
        let (size, sample) = (layout.size, layout.sample);
        Ok(Self { size, bands, sample, metadata, no_data, decoder_bytes, order })
    }

    /// The parts that hold `bands`, each to be decoded once, in any order.
    pub(crate) fn parts(&self, path: &Path, bands: &[usize]) -> Result<Vec<TiffPart>, ImageError> {
        if let Order::Pages(pages) = &self.order {
            let whole =
                |&band: &usize| TiffPart { first_band: band, page: pages[band], chunks: 0..usize::MAX };
            return Ok(bands.iter().map(whole).collect());
        }
        let page = Page::open(path, self, 0)?;
        let chunks = page.chunks_per_plane();
        if self.order == Order::Planar {
            let plane = |&band: &usize| TiffPart { first_band: band, page: 0, chunks: 0..chunks };
            return Ok(bands.iter().map(plane).collect());
        }
        let step = chunks.div_ceil(MAX_RANGES);
        let range = |first| TiffPart { first_band: 0, page: 0, chunks: first..(first + step).min(chunks) };
        Ok((0..chunks).step_by(step).map(range).collect())
    }

    /// Decodes a part.
    pub(crate) fn decode<E: From<ImageError>>(
        &self,
        path: &Path,
        part: &TiffPart,
        sink: BandSink<'_, E>,
    ) -> Result<(), E> {
        let mut page = Page::open(path, self, part.page)?;
        let plane = if self.order == Order::Planar { part.first_band } else { 0 };
        let chunks = page.chunks_per_plane();
        for chunk in part.chunks.start..part.chunks.end.min(chunks) {
            page.decode_chunk(path, plane * chunks + chunk, chunk, part.first_band, sink)?;
        }
        Ok(())
    }
}

/// Text of a tag.
fn tag_text(decoder: &mut Decoder<BufReader<File>>, tag: Tag) -> TiffResult<Option<String>> {
    let value = decoder.find_tag(tag)?;
    Ok(value.and_then(|v| v.into_string().ok()))
}

/// Checks the current page of a file of `length` bytes; returns its layout and the bytes of decoding a chunk.
fn check_page(
    path: &Path,
    decoder: &mut Decoder<BufReader<File>>,
    length: u64,
) -> Result<(PageLayout, usize), ImageError> {
    let tags = guarded(path, || {
        let dimensions = decoder.dimensions()?;
        let number = |decoder: &mut Decoder<_>, tag| decoder.find_tag_unsigned::<u32>(tag);
        let photometric = number(decoder, Tag::PhotometricInterpretation)?;
        let planar = number(decoder, Tag::PlanarConfiguration)?.unwrap_or(1);
        let compression = number(decoder, Tag::Compression)?.unwrap_or(1);
        let samples = number(decoder, Tag::SamplesPerPixel)?.unwrap_or(1);
        let bits = decoder.find_tag_unsigned_vec::<u16>(Tag::BitsPerSample)?.unwrap_or_default();
        let format = decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat)?.unwrap_or_default();
        Ok::<_, TiffError>((dimensions, photometric, planar, compression, samples, bits, format))
    })?;
    let ((width, height), photometric, planar, compression, samples, bits, format) = tags;
    match photometric {
        Some(1) => {}
        Some(2) if samples <= 4 => {
            let expected =
                "bands (grey with black as 0); a colour picture is converted by `lenscube chart image`";
            return Err(header_error(path, "colour", expected, "RGB"));
        }
        other => {
            let expected = "grey with black as 0 (1), e.g. by gdal_translate -co PHOTOMETRIC=MINISBLACK";
            let found = other.map_or("none".into(), |p| format!("{p} with {samples} samples per pixel"));
            return Err(header_error(path, "photometric interpretation", expected, found));
        }
    }
    if !matches!(compression, 1 | 5 | 8 | 32_773 | 32_946 | 50_000) {
        let expected = "none, LZW, deflate, PackBits or zstd";
        return Err(header_error(path, "compression", expected, compression.to_string()));
    }
    let bits = bits.first().copied().unwrap_or(1);
    let sample = match (format.first().copied().unwrap_or(1), bits) {
        (1, 8) => RasterSample::Plain(Sample::U8),
        (1, 16) => RasterSample::Plain(Sample::U16),
        (2, 16) => RasterSample::I16,
        (3, 16) => RasterSample::Plain(Sample::F16),
        (3, 32) => RasterSample::Plain(Sample::F32),
        (3, 64) => RasterSample::Plain(Sample::F64),
        (format, bits) => {
            let expected = "u8, u16, i16, f16, f32 or f64";
            let kind = ["unsigned", "signed", "float"].get(usize::from(format).wrapping_sub(1));
            let found = format!("{bits} bits, {}", kind.unwrap_or(&"another format"));
            return Err(header_error(path, "samples", expected, found));
        }
    };
    let layout = PageLayout {
        size: Size::new(height as usize, width as usize),
        samples: samples as usize,
        sample,
        planar: planar == 2,
    };
    let (across, down) = guarded(path, || Ok::<_, TiffError>(decoder.chunk_dimensions()))?;
    let is_strip = decoder.get_chunk_type() == ChunkType::Strip;
    let in_chunk = if layout.planar { 1 } else { layout.samples };
    let (across, down) =
        (across as usize, if is_strip { (down as usize).min(layout.size.height) } else { down as usize });
    let row = across.checked_mul(in_chunk * sample.bytes());
    let bytes = row.and_then(|n| n.checked_mul(down));
    let predictor = guarded(path, || decoder.find_tag_unsigned::<u16>(Tag::Predictor))?.unwrap_or(1);
    let raw = is_raw(compression, predictor);
    let limited = if raw { row } else { bytes };
    let Some(bytes) = bytes.filter(|_| limited.is_some_and(|n| n <= MAX_DECODED_BYTES)) else {
        let found = format!("{across}x{down} px of {in_chunk} samples");
        return Err(header_error(path, "strips or tiles", "at most 256 MiB each when decoded", found));
    };
    let (offsets, counts) = chunk_list(path, decoder)?;
    let mut encoded = 0;
    for (&offset, &count) in offsets.iter().zip(&counts) {
        let end = offset.checked_add(count);
        if end.is_none_or(|end| end > length) {
            let (path, expected) = (path.into(), end.unwrap_or(u64::MAX));
            return Err(ImageError::Short { path, expected, found: length });
        }
        encoded = encoded.max(count);
    }
    let pixels = 12 * across * in_chunk;
    let decoder_bytes = match raw {
        true => bytes.min(READ_BYTES.max(row.unwrap_or(0))) + pixels,
        false => bytes + usize::try_from(encoded).unwrap_or(usize::MAX).min(MAX_DECODED_BYTES) + pixels,
    };
    Ok((layout, decoder_bytes))
}

fn is_raw(compression: u32, predictor: u16) -> bool {
    compression == 1 && predictor == 1
}

/// Offsets and encoded sizes of the chunks of the current page.
fn chunk_list(
    path: &Path,
    decoder: &mut Decoder<BufReader<File>>,
) -> Result<(Vec<u64>, Vec<u64>), ImageError> {
    let (offsets, counts) = match decoder.get_chunk_type() {
        ChunkType::Strip => (Tag::StripOffsets, Tag::StripByteCounts),
        ChunkType::Tile => (Tag::TileOffsets, Tag::TileByteCounts),
    };
    guarded(path, || {
        let mut list = |tag| decoder.find_tag_unsigned_vec::<u64>(tag).map(Option::unwrap_or_default);
        Ok::<_, TiffError>((list(offsets)?, list(counts)?))
    })
}

impl Page {
    fn open(path: &Path, bands: &TiffBands, page: usize) -> Result<Self, ImageError> {
        let (mut decoder, file) = open_decoder(path)?;
        let length = file.metadata().map_err(|e| DurableError::io("look up", path, 0, e))?.len();
        guarded(path, || if page > 0 { decoder.seek_to_image(page) } else { Ok(()) })?;
        let (layout, _) = check_page(path, &mut decoder, length)?;
        if (layout.size, layout.sample) != (bands.size, bands.sample) {
            let reason = "it changed after it was opened".into();
            return Err(ImageError::Damaged { path: path.into(), reason });
        }
        let (offsets, _) = chunk_list(path, &mut decoder)?;
        let (compression, predictor) = guarded(path, || {
            let compression = decoder.find_tag_unsigned::<u32>(Tag::Compression)?.unwrap_or(1);
            Ok::<_, TiffError>((compression, decoder.find_tag_unsigned::<u16>(Tag::Predictor)?.unwrap_or(1)))
        })?;
        let (across, down) = decoder.chunk_dimensions();
        let down = (down as usize).min(match decoder.get_chunk_type() {
            ChunkType::Strip => layout.size.height,
            ChunkType::Tile => usize::MAX,
        });
        let big_endian = decoder.byte_order() == ByteOrder::BigEndian;
        let raw = is_raw(compression, predictor);
        Ok(Self { decoder, file, layout, chunk: (across as usize, down), offsets, raw, big_endian })
    }

    /// Samples of a pixel in a chunk.
    fn samples_in_chunk(&self) -> usize {
        if self.layout.planar { 1 } else { self.layout.samples }
    }

    fn chunks_across(&self) -> usize {
        self.layout.size.width.div_ceil(self.chunk.0)
    }

    fn chunks_per_plane(&self) -> usize {
        self.chunks_across() * self.layout.size.height.div_ceil(self.chunk.1)
    }

    /// Decodes the chunk `index` of the file, `place` of its plane, whose first sample belongs to `first_band`.
    fn decode_chunk<E: From<ImageError>>(
        &mut self,
        path: &Path,
        index: usize,
        place: usize,
        first_band: usize,
        sink: BandSink<'_, E>,
    ) -> Result<(), E> {
        let (across, down) = self.chunk;
        let (row, column) = (place / self.chunks_across() * down, place % self.chunks_across() * across);
        let height = down.min(self.layout.size.height - row);
        let width = across.min(self.layout.size.width - column);
        let (samples, sample) = (self.samples_in_chunk(), self.layout.sample);
        let pixel = samples * sample.bytes();
        let mut line = vec![0.0; width];
        let mut put = |first: usize, bytes: &[u8], stride: usize| -> Result<(), E> {
            for (y, bytes) in (first..).zip(bytes.chunks(stride)) {
                for band in 0..samples {
                    let values = bytes[..width * pixel].chunks_exact(pixel);
                    let values = values.map(|p| native(sample, &p[band * sample.bytes()..]));
                    line.iter_mut().zip(values).for_each(|(to, v)| *to = v);
                    sink(first_band + band, y, column, &line)?;
                }
            }
            Ok(())
        };
        if !self.raw {
            // Of planar files the decoder does not cut chunks of later planes at the image's edges.
            let (columns, rows) = self.decoder.chunk_data_dimensions(index as u32);
            let stride = (columns as usize).max(width) * pixel;
            let mut bytes = vec![0; (rows as usize).max(height) * stride];
            guarded(path, || self.decoder.read_chunk_bytes(index as u32, &mut bytes))?;
            return put(row, &bytes[..height * stride], stride);
        }
        let stride = across * pixel;
        let rows = (READ_BYTES / stride).clamp(1, height);
        let mut bytes = vec![0; rows * stride];
        for first in (0..height).step_by(rows) {
            let part = &mut bytes[..rows.min(height - first) * stride];
            let at = self.offsets[index] + (first * stride) as u64;
            match self.file.read_exact_at(part, at) {
                Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => {
                    let found = self.file.metadata().map_or(0, |m| m.len());
                    let expected = at + part.len() as u64;
                    return Err(ImageError::Short { path: path.into(), expected, found }.into());
                }
                other => {
                    other.map_err(|e| ImageError::Io(DurableError::io("read", path, part.len() as u64, e)))?
                }
            }
            if self.big_endian != cfg!(target_endian = "big") {
                part.chunks_exact_mut(sample.bytes()).for_each(<[u8]>::reverse);
            }
            put(row + first, part, stride)?;
        }
        Ok(())
    }
}

/// The first sample of `bytes`, in native byte order.
fn native(sample: RasterSample, bytes: &[u8]) -> f64 {
    match sample {
        RasterSample::I16 => f64::from(i16::from_ne_bytes(*bytes.first_chunk().expect("a complete sample"))),
        RasterSample::Plain(sample) => sample.read(bytes, 0),
    }
}
