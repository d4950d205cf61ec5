//! TIFF 6.0 and BigTIFF: uncompressed strips row by row from the file, whatever their size; others strip by strip or by rows of tiles.

use std::fs::File;
use std::io::BufReader;
use std::os::unix::fs::FileExt;
use std::path::Path;

use ::tiff::ColorType;
use ::tiff::decoder::{ChunkType, Decoder, DecodingResult, Limits};
use ::tiff::tags::{ByteOrder, Tag};
use pipeline::geometry::Size;

use super::{Head, MAX_DECODED, Take, alpha, guarded, wrong};
use crate::chart::ChartError;
use crate::durable::DurableError;

/// Longest list of offsets.
const MAX_TAG: usize = 64 << 20;

/// A file whose header has been read.
pub(super) struct Rows {
    decoder: Decoder<BufReader<File>>,
    file: File,
    plain: Option<Plain>,
}

/// Uncompressed strips.
struct Plain {
    offsets: Vec<u64>,
    rows_per_strip: usize,
    big_endian: bool,
}

pub(super) fn open(path: &Path) -> Result<(Head, Rows), ChartError> {
    let open = || File::open(path).map_err(|e| DurableError::io("open", path, 0, e));
    let (file, again) = (open()?, open()?);
    let length = again.metadata().map_err(|e| DurableError::io("look up", path, 0, e))?.len();
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MAX_DECODED;
    limits.intermediate_buffer_size = MAX_DECODED;
    limits.ifd_value_size = MAX_TAG;
    let read = || {
        let mut decoder = Decoder::new(BufReader::with_capacity(1 << 20, file))?.with_limits(limits);
        let (size, colour) = (decoder.dimensions()?, decoder.colortype()?);
        let number = |decoder: &mut Decoder<_>, tag| decoder.find_tag_unsigned::<u32>(tag);
        let photometric = number(&mut decoder, Tag::PhotometricInterpretation)?;
        let planar = number(&mut decoder, Tag::PlanarConfiguration)?.unwrap_or(1);
        let compression = number(&mut decoder, Tag::Compression)?.unwrap_or(1);
        let format = decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat)?.unwrap_or_default();
        let extra = decoder.find_tag_unsigned_vec::<u16>(Tag::ExtraSamples)?.unwrap_or_default();
        let plain = match (compression, decoder.get_chunk_type()) {
            (1, ChunkType::Strip) => Some(Plain {
                offsets: decoder.find_tag_unsigned_vec(Tag::StripOffsets)?.unwrap_or_default(),
                rows_per_strip: decoder.chunk_dimensions().1 as usize,
                big_endian: decoder.byte_order() == ByteOrder::BigEndian,
            }),
            _ => None,
        };
        let profile = decoder.find_tag(Tag::IccProfile).is_ok_and(|t| t.is_some());
        let facts = (size, colour, photometric, planar, format, extra, profile);
        Ok::<_, ::tiff::TiffError>((decoder, facts, plain))
    };
    let (decoder, (size, colour, photometric, planar, format, extra, profile), plain) = guarded(path, read)?;
    if !extra.is_empty() || matches!(colour, ColorType::RGBA(_) | ColorType::GrayA(_)) {
        return Err(alpha(path));
    }
    let (channels, bits) = match colour {
        ColorType::Gray(bits @ (8 | 16)) => (1, bits),
        ColorType::RGB(bits @ (8 | 16)) => (3, bits),
        other => return Err(wrong(path, "colour", "grey or RGB of 8 or 16 bits", format!("{other:?}"))),
    };
    if photometric != Some(if channels == 3 { 2 } else { 1 }) {
        let found = format!("photometric interpretation {photometric:?}");
        return Err(wrong(path, "colour", "grey with black as 0 (1), or RGB (2)", found));
    }
    if planar != 1 && channels > 1 {
        return Err(wrong(
            path,
            "planes",
            "channels side by side (1)",
            format!("planar configuration {planar}"),
        ));
    }
    if format.iter().any(|f| *f != 1) {
        let expected = "whole numbers; an OpenEXR image holds floats";
        return Err(wrong(path, "samples", expected, format!("sample format {format:?}")));
    }
    let mut notes = Vec::new();
    if profile {
        notes.push("it has a colour profile, which is not applied: its samples are taken as sRGB".into());
    }
    if decoder.more_images() {
        notes.push("it has more pages; the first is taken".into());
    }
    let size = Size::new(size.1 as usize, size.0 as usize);
    let head = Head { size, channels, white: if bits == 8 { 255 } else { u16::MAX }, notes };
    if let Some(plain) = &plain {
        plain.check(path, &head, length)?;
    }
    Ok((head, Rows { decoder, file: again, plain }))
}

/// Bytes of a row.
fn row_bytes(head: &Head) -> u64 {
    let sample = if head.white == 255 { 1 } else { 2 };
    head.size.width as u64 * head.channels as u64 * sample
}

impl Plain {
    /// Strips that lie in the file, and enough of them.
    fn check(&self, path: &Path, head: &Head, length: u64) -> Result<(), ChartError> {
        let (rows, bytes) = (self.rows_per_strip.max(1), row_bytes(head));
        let strips = head.size.height.div_ceil(rows);
        if head.size.pixels() == 0 || self.offsets.len() != strips || bytes > MAX_DECODED as u64 {
            let found = format!("{} for {} px", self.offsets.len(), head.size);
            return Err(wrong(path, "strips", format!("{strips}, rows of at most 256 MiB"), found));
        }
        for (strip, &offset) in self.offsets.iter().enumerate() {
            let held = rows.min(head.size.height - strip * rows) as u64;
            let end = held.checked_mul(bytes).and_then(|n| n.checked_add(offset));
            if end.is_none_or(|end| end > length) {
                let (path, expected) = (path.into(), end.unwrap_or(u64::MAX));
                return Err(ChartError::Short { path, expected, found: length });
            }
        }
        Ok(())
    }
}

impl Rows {
    pub(super) fn each(mut self, path: &Path, head: &Head, take: Take<'_>) -> Result<(), ChartError> {
        match self.plain.take() {
            Some(plain) => self.plain_rows(&plain, path, head, take),
            None => self.chunks(path, head, take),
        }
    }

    fn plain_rows(&self, plain: &Plain, path: &Path, head: &Head, take: Take<'_>) -> Result<(), ChartError> {
        let mut bytes = vec![0; row_bytes(head) as usize];
        let mut samples = Vec::with_capacity(bytes.len());
        for row in 0..head.size.height {
            let (strip, inside) = (row / plain.rows_per_strip, row % plain.rows_per_strip);
            let at = plain.offsets[strip] + inside as u64 * bytes.len() as u64;
            self.file
                .read_exact_at(&mut bytes, at)
                .map_err(|e| DurableError::io("read", path, bytes.len() as u64, e))?;
            samples.clear();
            match (head.white, plain.big_endian) {
                (255, _) => samples.extend(bytes.iter().map(|&v| u16::from(v))),
                (_, true) => samples.extend(bytes.as_chunks().0.iter().map(|&b| u16::from_be_bytes(b))),
                (_, false) => samples.extend(bytes.as_chunks().0.iter().map(|&b| u16::from_le_bytes(b))),
            }
            take(row, &samples)?;
        }
        Ok(())
    }

    /// Rows of chunks: a strip, or tiles side by side.
    fn chunks(mut self, path: &Path, head: &Head, take: Take<'_>) -> Result<(), ChartError> {
        let (width, height) = (head.size.width, head.size.height);
        let (across, down) = self.decoder.chunk_dimensions();
        let (across, down) = (across as usize, (down as usize).min(height));
        let room = width.checked_mul(down).and_then(|n| n.checked_mul(head.channels * 2));
        if across == 0 || down == 0 || room.is_none_or(|n| n > MAX_DECODED) {
            let found = format!("{across}x{down} px in an image of {}", head.size);
            return Err(wrong(path, "strips or tiles", "at most 256 MiB in a row of them", found));
        }
        let per_row = width.div_ceil(across);
        let mut block = vec![0u16; width * down * head.channels];
        for (i, first) in (0..height).step_by(down).enumerate() {
            let rows = down.min(height - first);
            for j in 0..per_row {
                let held = across.min(width - j * across);
                let samples = self.chunk(path, head, i * per_row + j)?;
                // Some decoders hand out whole tiles, some what lies in the image.
                let stride = match samples.len() / head.channels {
                    n if n == held * rows => held,
                    n if n == across * down || n == across * rows => across,
                    n => {
                        let reason = format!("strip or tile {} holds {n} pixels", i * per_row + j);
                        return Err(ChartError::Damaged { path: path.into(), reason });
                    }
                };
                for row in 0..rows {
                    let from = &samples[row * stride * head.channels..][..held * head.channels];
                    block[(row * width + j * across) * head.channels..][..from.len()].copy_from_slice(from);
                }
            }
            for row in 0..rows {
                take(first + row, &block[row * width * head.channels..][..width * head.channels])?;
            }
        }
        Ok(())
    }

    fn chunk(&mut self, path: &Path, head: &Head, index: usize) -> Result<Vec<u16>, ChartError> {
        let result = guarded(path, || self.decoder.read_chunk(index as u32))?;
        match result {
            DecodingResult::U8(v) if head.white == 255 => Ok(v.into_iter().map(u16::from).collect()),
            DecodingResult::U16(v) if head.white == u16::MAX => Ok(v),
            _ => {
                let reason = format!("strip or tile {index} holds other samples than the header says");
                Err(ChartError::Damaged { path: path.into(), reason })
            }
        }
    }
}
