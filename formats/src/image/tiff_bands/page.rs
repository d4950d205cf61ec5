//! A page of a TIFF: its layout, checked before memory is allocated, and its chunks.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use ::tiff::TiffError;
use ::tiff::decoder::{ChunkType, Decoder, Limits};
use ::tiff::tags::{ByteOrder, Tag};
use pipeline::geometry::Size;

use super::TiffBands;
use super::predictor::Predictor;
use super::strip::{Buffers, STRIP_BYTES, strip_chunks};
use crate::durable::DurableError;
use crate::image::header::{ImageError, MAX_DECODED_BYTES, guarded, header_error};
use crate::sample::{RasterSample, Sample};

/// Maximum size of the value of a tag.
const MAX_TAG_BYTES: usize = 64 << 20;
/// Bytes of uncompressed chunks that are read at a time.
pub(super) const READ_BYTES: usize = 4 << 20;

/// Properties of a page that all bands share.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PageLayout {
    pub(super) size: Size,
    pub(super) samples: usize,
    pub(super) sample: RasterSample,
    pub(super) planar: bool,
}

/// How the samples of chunks are stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Coding {
    /// As they are.
    Raw,
    /// Zlib streams.
    Deflate(Predictor),
    /// Otherwise, for the crate `tiff`.
    Other,
}

/// An open page.
pub(super) struct Page {
    pub(super) decoder: Decoder<BufReader<File>>,
    pub(super) file: File,
    pub(super) layout: PageLayout,
    /// Columns and rows of a chunk.
    pub(super) chunk: (usize, usize),
    /// Whether chunks are tiles, complete at the image's edges, rather than strips of rows.
    pub(super) is_tiled: bool,
    pub(super) offsets: Vec<u64>,
    /// Encoded bytes of the chunks.
    pub(super) counts: Vec<u64>,
    /// A sample of the chunks that are not stored, native byte order.
    pub(super) fill: Vec<u8>,
    pub(super) coding: Coding,
    pub(super) big_endian: bool,
    pub(super) buffers: Buffers,
}

/// Opens a file twice: for the decoder, and for samples that need no decoding.
pub(super) fn open_decoder(path: &Path) -> Result<(Decoder<BufReader<File>>, File), ImageError> {
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

/// Checks the current page of a file of `length` bytes; returns its layout and the bytes of decoding a chunk.
pub(super) fn check_page(
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
    let coding = coding(compression, predictor, sample);
    let limited = if coding == Coding::Raw { row } else { bytes };
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
        if offset == 0 && count > 0 {
            let reason = format!("a strip or tile of {count} bytes at the position 0 of the file");
            return Err(ImageError::Damaged { path: path.into(), reason });
        }
        encoded = encoded.max(count);
    }
    let side_by_side = strip_chunks(bytes, layout.size.width.div_ceil(across.max(1)));
    let strip_row = row.unwrap_or(0) * side_by_side;
    let part = |limit: usize| (bytes * side_by_side).min(limit.max(strip_row));
    let decoder_bytes = match coding {
        Coding::Raw => 2 * part(READ_BYTES),
        _ => {
            bytes + usize::try_from(encoded).unwrap_or(usize::MAX).min(MAX_DECODED_BYTES) + part(STRIP_BYTES)
        }
    };
    Ok((layout, decoder_bytes))
}

fn coding(compression: u32, predictor: u16, sample: RasterSample) -> Coding {
    let is_float = !sample.is_integer();
    match (compression, predictor) {
        (1, 1) => Coding::Raw,
        (8 | 32_946, 1) => Coding::Deflate(Predictor::None),
        (8 | 32_946, 2) if !is_float => Coding::Deflate(Predictor::Horizontal),
        (8 | 32_946, 3) if is_float => Coding::Deflate(Predictor::Float),
        _ => Coding::Other,
    }
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
    /// Opens a page, which must be as `bands`.
    pub(super) fn open(path: &Path, bands: &TiffBands, page: usize) -> Result<Self, ImageError> {
        let (mut decoder, file) = open_decoder(path)?;
        let length = file.metadata().map_err(|e| DurableError::io("look up", path, 0, e))?.len();
        guarded(path, || if page > 0 { decoder.seek_to_image(page) } else { Ok(()) })?;
        let (layout, _) = check_page(path, &mut decoder, length)?;
        let is_as_opened = (layout.size, layout.sample) == (bands.size, bands.sample);
        if !is_as_opened || layout.samples != bands.samples() {
            let reason = "it changed after it was opened".into();
            return Err(ImageError::Damaged { path: path.into(), reason });
        }
        let (offsets, counts) = chunk_list(path, &mut decoder)?;
        let (compression, predictor) = guarded(path, || {
            let compression = decoder.find_tag_unsigned::<u32>(Tag::Compression)?.unwrap_or(1);
            Ok::<_, TiffError>((compression, decoder.find_tag_unsigned::<u16>(Tag::Predictor)?.unwrap_or(1)))
        })?;
        let (across, down) = decoder.chunk_dimensions();
        let is_tiled = decoder.get_chunk_type() == ChunkType::Tile;
        let down = (down as usize).min(if is_tiled { usize::MAX } else { layout.size.height });
        let big_endian = decoder.byte_order() == ByteOrder::BigEndian;
        let coding = coding(compression, predictor, layout.sample);
        let (chunk, buffers) = ((across as usize, down), Buffers::default());
        // A text that is not a number was an error of the file.
        let fill = layout.sample.to_ne_bytes(bands.no_data_value().ok().flatten().unwrap_or(0.0));
        Ok(Self {
            decoder,
            file,
            layout,
            chunk,
            is_tiled,
            offsets,
            counts,
            fill,
            coding,
            big_endian,
            buffers,
        })
    }

    /// Whether the file does not store the chunk `index`.
    pub(super) fn is_sparse(&self, index: usize) -> bool {
        (self.offsets.get(index), self.counts.get(index)) == (Some(&0), Some(&0))
    }

    /// Samples of a pixel in a chunk.
    pub(super) fn samples_in_chunk(&self) -> usize {
        if self.layout.planar { 1 } else { self.layout.samples }
    }

    /// Bytes of a pixel in a chunk.
    pub(super) fn pixel_bytes(&self) -> usize {
        self.samples_in_chunk() * self.layout.sample.bytes()
    }

    pub(super) fn chunks_across(&self) -> usize {
        self.layout.size.width.div_ceil(self.chunk.0)
    }

    pub(super) fn chunk_rows(&self) -> usize {
        self.layout.size.height.div_ceil(self.chunk.1)
    }

    pub(super) fn chunks_per_plane(&self) -> usize {
        self.chunks_across() * self.chunk_rows()
    }
}
