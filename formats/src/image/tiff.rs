//! TIFF 6.0 and BigTIFF. Rows of uncompressed strips are read directly from the file, so strips may have any size; other images are
//! decoded strip by strip, or one row of tiles at a time.

use std::fs::File;
use std::io::BufReader;
use std::os::unix::fs::FileExt;
use std::path::Path;

use ::tiff::decoder::{ChunkType, Decoder, DecodingResult, Limits};
use ::tiff::tags::{ByteOrder, Tag};
use ::tiff::{ColorType, TiffError};
use pipeline::geometry::Size;

use super::header::{
    ALPHA_NOTE, ImageError, ImageHeader, MAX_DECODED_BYTES, RowSink, guarded, header_error, orientation_note,
    without_alpha,
};
use crate::durable::DurableError;

/// Maximum size of the value of a tag, such as the list of strip offsets.
const MAX_TAG_BYTES: usize = 64 << 20;

/// A file whose header has been read.
pub(crate) struct TiffRows {
    decoder: Decoder<BufReader<File>>,
    file: File,
    strips: Option<RawStrips>,
    /// Channels of a stored pixel: those of the header, and alpha.
    stored: usize,
}

/// Uncompressed strips.
struct RawStrips {
    offsets: Vec<u64>,
    rows_per_strip: usize,
    big_endian: bool,
}

/// Reads the header.
pub(crate) fn open(path: &Path) -> Result<(ImageHeader, TiffRows), ImageError> {
    let open = || File::open(path).map_err(|e| DurableError::io("open", path, 0, e));
    let (file, raw_file) = (open()?, open()?);
    let length = raw_file.metadata().map_err(|e| DurableError::io("look up", path, 0, e))?.len();
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MAX_DECODED_BYTES;
    limits.intermediate_buffer_size = MAX_DECODED_BYTES;
    limits.ifd_value_size = MAX_TAG_BYTES;
    let read = || {
        let mut decoder = Decoder::new(BufReader::with_capacity(1 << 20, file))?.with_limits(limits);
        let (size, colour) = (decoder.dimensions()?, decoder.colortype()?);
        let number = |decoder: &mut Decoder<_>, tag| decoder.find_tag_unsigned::<u32>(tag);
        let photometric = number(&mut decoder, Tag::PhotometricInterpretation)?;
        let planar = number(&mut decoder, Tag::PlanarConfiguration)?.unwrap_or(1);
        let compression = number(&mut decoder, Tag::Compression)?.unwrap_or(1);
        let format = decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat)?.unwrap_or_default();
        let extra = decoder.find_tag_unsigned_vec::<u16>(Tag::ExtraSamples)?.unwrap_or_default();
        let strips = match (compression, decoder.get_chunk_type()) {
            (1, ChunkType::Strip) => Some(RawStrips {
                offsets: decoder.find_tag_unsigned_vec(Tag::StripOffsets)?.unwrap_or_default(),
                rows_per_strip: decoder.chunk_dimensions().1 as usize,
                big_endian: decoder.byte_order() == ByteOrder::BigEndian,
            }),
            _ => None,
        };
        let profile = decoder.find_tag(Tag::IccProfile).is_ok_and(|t| t.is_some());
        let orientation = number(&mut decoder, Tag::Orientation)?;
        let tags = (size, colour, photometric, planar, format, extra, profile, orientation);
        Ok::<_, TiffError>((decoder, tags, strips))
    };
    let read = guarded(path, || match read() {
        Err(TiffError::UnsupportedError(reason)) => Ok(Err(reason)),
        other => other.map(Ok),
    })?;
    let (decoder, tags, strips) = read.map_err(|reason| {
        let expected = "grey or RGB of 8 or 16 bits; `magick IN -type TrueColor OUT.tif` converts others";
        header_error(path, "colour", expected, reason.to_string())
    })?;
    let (size, colour, photometric, planar, format, extra, profile, orientation) = tags;
    if extra.len() > 1 {
        let found = format!("{} beside the colours", extra.len());
        return Err(header_error(path, "channels", "at most one beside the colours, opaque alpha", found));
    }
    let (channels, stored, bits) = match colour {
        ColorType::Gray(bits @ (8 | 16)) => (1, 1, bits),
        ColorType::RGB(bits @ (8 | 16)) => (3, 3, bits),
        ColorType::GrayA(bits @ (8 | 16)) => (1, 2, bits),
        ColorType::RGBA(bits @ (8 | 16)) => (3, 4, bits),
        ColorType::Multiband { bit_depth: bits @ (8 | 16), num_samples: 2 } if !extra.is_empty() => {
            (1, 2, bits)
        }
        other => {
            return Err(header_error(path, "colour", "grey or RGB of 8 or 16 bits", colour_name(other)));
        }
    };
    if photometric != Some(if channels == 3 { 2 } else { 1 }) {
        let found = photometric.map_or("none".into(), |p| format!("photometric interpretation {p}"));
        return Err(header_error(path, "colour", "grey with black as 0 (1), or RGB (2)", found));
    }
    if planar != 1 && channels > 1 {
        return Err(header_error(
            path,
            "planes",
            "channels side by side (1)",
            format!("planar configuration {planar}"),
        ));
    }
    if format.iter().any(|f| *f != 1) {
        let expected = "integers; store floats as OpenEXR";
        return Err(header_error(path, "samples", expected, "another sample format"));
    }
    let mut notes = Vec::new();
    if stored > channels {
        notes.push(ALPHA_NOTE.into());
    }
    if profile {
        notes.push(
            "it has a colour profile, which is not applied: its samples are interpreted as sRGB".into(),
        );
    }
    notes.extend(orientation.and_then(|o| orientation_note("TIFF", o)));
    if decoder.more_images() {
        notes.push("it has more pages; only the first is read".into());
    }
    let size = Size::new(size.1 as usize, size.0 as usize);
    let header = ImageHeader { size, channels, white: if bits == 8 { 255 } else { u16::MAX }, notes };
    if let Some(strips) = &strips {
        strips.check(path, (&header, stored), length)?;
    }
    Ok((header, TiffRows { decoder, file: raw_file, strips, stored }))
}

/// Bytes of a row of `stored` channels.
fn row_bytes(header: &ImageHeader, stored: usize) -> u64 {
    let sample = if header.white == 255 { 1 } else { 2 };
    header.size.width as u64 * stored as u64 * sample
}

impl RawStrips {
    /// Checks that the strips are complete and lie inside the file of `length` bytes.
    fn check(
        &self,
        path: &Path,
        (header, stored): (&ImageHeader, usize),
        length: u64,
    ) -> Result<(), ImageError> {
        let (rows, bytes) = (self.rows_per_strip.max(1), row_bytes(header, stored));
        let strips = header.size.height.div_ceil(rows);
        if header.size.pixels() == 0 || self.offsets.len() != strips || bytes > MAX_DECODED_BYTES as u64 {
            let found = format!("{} for {} px", self.offsets.len(), header.size);
            return Err(header_error(path, "strips", format!("{strips}, rows of at most 256 MiB"), found));
        }
        for (strip, &offset) in self.offsets.iter().enumerate() {
            if offset == 0 {
                let expected = "all stored; `gdal_translate IN OUT` writes those of a sparse file";
                return Err(header_error(path, "strips", expected, format!("strip {strip} is not stored")));
            }
            let strip_rows = rows.min(header.size.height - strip * rows) as u64;
            let end = strip_rows.checked_mul(bytes).and_then(|n| n.checked_add(offset));
            if end.is_none_or(|end| end > length) {
                let (path, expected) = (path.into(), end.unwrap_or(u64::MAX));
                return Err(ImageError::Short { path, expected, found: length });
            }
        }
        Ok(())
    }
}

impl TiffRows {
    /// Decodes all rows.
    pub(crate) fn for_each_row<E: From<ImageError>>(
        mut self,
        path: &Path,
        header: &ImageHeader,
        sink: RowSink<'_, E>,
    ) -> Result<(), E> {
        let has_alpha = self.stored > header.channels;
        let mut colours = |row: usize, samples: &[u16]| {
            if !has_alpha {
                return sink(row, samples);
            }
            let mut samples = samples.to_vec();
            without_alpha(path, header, row, &mut samples)?;
            sink(row, &samples)
        };
        match self.strips.take() {
            Some(strips) => self.read_raw_rows(&strips, path, header, &mut colours),
            None => self.decode_rows(path, header, &mut colours),
        }
    }

    fn read_raw_rows<E: From<ImageError>>(
        &self,
        strips: &RawStrips,
        path: &Path,
        header: &ImageHeader,
        sink: RowSink<'_, E>,
    ) -> Result<(), E> {
        let mut bytes = vec![0; row_bytes(header, self.stored) as usize];
        let mut samples = Vec::with_capacity(bytes.len());
        for row in 0..header.size.height {
            let (strip, inside) = (row / strips.rows_per_strip, row % strips.rows_per_strip);
            let at = strips.offsets[strip] + inside as u64 * bytes.len() as u64;
            self.file
                .read_exact_at(&mut bytes, at)
                .map_err(|e| ImageError::Io(DurableError::io("read", path, bytes.len() as u64, e)))?;
            samples.clear();
            match (header.white, strips.big_endian) {
                (255, _) => samples.extend(bytes.iter().map(|&v| u16::from(v))),
                (_, true) => samples.extend(bytes.as_chunks().0.iter().map(|&b| u16::from_be_bytes(b))),
                (_, false) => samples.extend(bytes.as_chunks().0.iter().map(|&b| u16::from_le_bytes(b))),
            }
            sink(row, &samples)?;
        }
        Ok(())
    }

    /// Decodes a strip, or a row of tiles, at a time.
    fn decode_rows<E: From<ImageError>>(
        mut self,
        path: &Path,
        header: &ImageHeader,
        sink: RowSink<'_, E>,
    ) -> Result<(), E> {
        let (width, height, stored) = (header.size.width, header.size.height, self.stored);
        let (across, down) = self.decoder.chunk_dimensions();
        let (across, down) = (across as usize, (down as usize).min(height));
        let bytes = width.checked_mul(down).and_then(|n| n.checked_mul(stored * 2));
        if across == 0 || down == 0 || bytes.is_none_or(|n| n > MAX_DECODED_BYTES) {
            let found = format!("{across}x{down} px in an image of {}", header.size);
            return Err(
                header_error(path, "strips or tiles", "at most 256 MiB in a row of them", found).into()
            );
        }
        let per_row = width.div_ceil(across);
        let mut block = vec![0u16; width * down * stored];
        for (i, first) in (0..height).step_by(down).enumerate() {
            let rows = down.min(height - first);
            for j in 0..per_row {
                let columns = across.min(width - j * across);
                let samples = self.decode_chunk(path, header, i * per_row + j)?;
                // Depending on the compression, tiles are decoded with or without the part beyond the image.
                let stride = match samples.len() / stored {
                    n if n == columns * rows => columns,
                    n if n == across * down || n == across * rows => across,
                    n => {
                        let reason = format!("strip or tile {} holds {n} pixels", i * per_row + j);
                        return Err(ImageError::Damaged { path: path.into(), reason }.into());
                    }
                };
                for row in 0..rows {
                    let from = &samples[row * stride * stored..][..columns * stored];
                    block[(row * width + j * across) * stored..][..from.len()].copy_from_slice(from);
                }
            }
            for row in 0..rows {
                sink(first + row, &block[row * width * stored..][..width * stored])?;
            }
        }
        Ok(())
    }

    /// Decodes a strip or tile.
    fn decode_chunk(
        &mut self,
        path: &Path,
        header: &ImageHeader,
        index: usize,
    ) -> Result<Vec<u16>, ImageError> {
        let result = guarded(path, || self.decoder.read_chunk(index as u32))?;
        match result {
            DecodingResult::U8(v) if header.white == 255 => Ok(v.into_iter().map(u16::from).collect()),
            DecodingResult::U16(v) if header.white == u16::MAX => Ok(v),
            _ => {
                let reason = format!("strip or tile {index} does not have the sample type of the header");
                Err(ImageError::Damaged { path: path.into(), reason })
            }
        }
    }
}
/// Name and bits of a colour model that is not supported.
fn colour_name(colour: ColorType) -> String {
    let (name, bits) = match colour {
        ColorType::Gray(bits) => ("grey", bits),
        ColorType::RGB(bits) => ("RGB", bits),
        ColorType::Palette(bits) => ("palette", bits),
        ColorType::CMYK(bits) => ("CMYK", bits),
        ColorType::YCbCr(bits) => ("YCbCr", bits),
        ColorType::Lab(bits) => ("Lab", bits),
        ColorType::Multiband { bit_depth, num_samples } => {
            return format!("{num_samples} samples of {bit_depth} bits");
        }
        _ => return "another colour model".into(),
    };
    format!("{name} of {bits} bits")
}
