//! JPEG (ISO/IEC 10918, baseline and progressive, 8 bits) and WebP (RFC 9649): formats that are decoded as a whole, at most 256 MiB.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use image_webp::WebPDecoder;
use pipeline::geometry::Size;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::header::{
    ALPHA_NOTE, ImageError, ImageHeader, MAX_DECODED_BYTES, PROFILE_NOTE, RowSink, guarded, header_error,
    orientation_note, without_alpha,
};
use crate::durable::DurableError;

/// Memory of a decoder per byte of the image: the image, coefficients of a progressive JPEG (16 bits) or planes of a WebP.
const DECODER_BYTES_PER_BYTE: usize = 4;

/// A file whose header has been read.
pub(crate) struct WholeImage {
    decoder: Decoder,
    has_alpha: bool,
    bytes: usize,
}

enum Decoder {
    Jpeg(Box<JpegDecoder<BufReader<File>>>),
    Webp(Box<WebPDecoder<BufReader<File>>>),
}

fn reader(path: &Path) -> Result<BufReader<File>, ImageError> {
    let file = File::open(path).map_err(|e| DurableError::io("open", path, 0, e))?;
    Ok(BufReader::with_capacity(1 << 20, file))
}

/// Checks the size; returns the bytes of the decoded image of `stored` channels.
fn decoded_bytes(path: &Path, size: Size, stored: usize) -> Result<usize, ImageError> {
    let bytes = size.height.checked_mul(size.width).and_then(|n| n.checked_mul(stored));
    bytes.filter(|n| (1..=MAX_DECODED_BYTES).contains(n)).ok_or_else(|| {
        let expected = "at most 256 MiB when decoded; convert it to TIFF or PNG, which are read row by row";
        header_error(path, "size", expected, format!("{size} px"))
    })
}

/// Reads the header of a JPEG.
pub(crate) fn open_jpeg(path: &Path) -> Result<(ImageHeader, WholeImage), ImageError> {
    // Without `unsafe` the decoder is the same on every machine. A truncated file is an error.
    let options = DecoderOptions::new_safe().set_strict_mode(true).set_use_unsafe(false);
    let options = options.set_max_width(usize::from(u16::MAX)).set_max_height(usize::from(u16::MAX));
    let mut decoder = JpegDecoder::new_with_options(reader(path)?, options);
    guarded(path, || decoder.decode_headers())?;
    let (width, height) = decoder.dimensions().unwrap_or_default();
    let size = Size::new(height, width);
    let (channels, out) = match decoder.input_colorspace() {
        Some(ColorSpace::Luma) => (1, ColorSpace::Luma),
        Some(ColorSpace::YCbCr | ColorSpace::RGB) => (3, ColorSpace::RGB),
        other => {
            return Err(header_error(path, "colour", "grey, YCbCr or RGB", colour_name(other)));
        }
    };
    decoder.set_options(options.jpeg_set_out_colorspace(out));
    let bytes = decoded_bytes(path, size, channels)?;
    let mut notes = Vec::new();
    if decoder.icc_profile().is_some() {
        notes.push(PROFILE_NOTE.into());
    }
    let orientation = decoder.exif().and_then(|exif| orientation(exif));
    notes.extend(orientation.and_then(|o| orientation_note("Exif", o.into())));
    let header = ImageHeader { size, channels, white: 255, notes };
    Ok((header, WholeImage { decoder: Decoder::Jpeg(Box::new(decoder)), has_alpha: false, bytes }))
}

/// Reads the header of a WebP.
pub(crate) fn open_webp(path: &Path) -> Result<(ImageHeader, WholeImage), ImageError> {
    let reader = reader(path)?;
    let mut decoder = guarded(path, || WebPDecoder::new(reader))?;
    if decoder.is_animated() {
        return Err(header_error(path, "frames", "one", "an animation"));
    }
    decoder.set_memory_limit(MAX_DECODED_BYTES);
    let ((width, height), has_alpha) = (decoder.dimensions(), decoder.has_alpha());
    let size = Size::new(height as usize, width as usize);
    let bytes = decoded_bytes(path, size, if has_alpha { 4 } else { 3 })?;
    let mut notes = Vec::new();
    if guarded(path, || decoder.icc_profile())?.is_some() {
        notes.push(PROFILE_NOTE.into());
    }
    if has_alpha {
        notes.push(ALPHA_NOTE.into());
    }
    let header = ImageHeader { size, channels: 3, white: 255, notes };
    Ok((header, WholeImage { decoder: Decoder::Webp(Box::new(decoder)), has_alpha, bytes }))
}

impl WholeImage {
    /// Memory of decoding.
    pub(crate) fn decoder_bytes(&self) -> usize {
        self.bytes * DECODER_BYTES_PER_BYTE
    }

    /// Decodes all rows.
    pub(crate) fn for_each_row<E: From<ImageError>>(
        self,
        path: &Path,
        header: &ImageHeader,
        sink: RowSink<'_, E>,
    ) -> Result<(), E> {
        let mut bytes = vec![0; self.bytes];
        match self.decoder {
            Decoder::Jpeg(mut jpeg) => guarded(path, || jpeg.decode_into(&mut bytes))?,
            Decoder::Webp(mut webp) => guarded(path, || webp.read_image(&mut bytes))?,
        }
        let mut samples = Vec::new();
        let stored = header.channels + usize::from(self.has_alpha);
        for (row, line) in bytes.chunks_exact(stored * header.size.width).enumerate() {
            samples.clear();
            samples.extend(line.iter().map(|&v| u16::from(v)));
            if self.has_alpha {
                without_alpha(path, header, row, &mut samples)?;
            }
            sink(row, &samples)?;
        }
        Ok(())
    }
}

/// Exif tag 274 of the first directory: TIFF, after an optional `Exif\0\0`.
fn orientation(exif: &[u8]) -> Option<u16> {
    let tiff = exif.strip_prefix(b"Exif\0\0").unwrap_or(exif);
    let big = tiff.starts_with(b"MM");
    let u16_at = |at: usize| {
        let bytes: [u8; 2] = tiff.get(at..at.checked_add(2)?)?.try_into().ok()?;
        Some(if big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    };
    let u32_at = |at: usize| {
        let bytes: [u8; 4] = tiff.get(at..at.checked_add(4)?)?.try_into().ok()?;
        Some(if big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    };
    let first = u32_at(4)? as usize;
    let entries = usize::from(u16_at(first)?);
    let entry = (0..entries).map(|k| first + 2 + 12 * k).find(|&at| u16_at(at) == Some(274))?;
    u16_at(entry + 8)
}

/// Name of a colour model that is not supported.
fn colour_name(colour: Option<ColorSpace>) -> &'static str {
    match colour {
        Some(ColorSpace::CMYK | ColorSpace::YCCK) => "CMYK",
        Some(_) => "another colour model",
        None => "none",
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn orientation_is_found_in_both_byte_orders() {
        let little = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
        assert_eq!(super::orientation(little), Some(6));
        let big = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x08\0\0\0\0\0\0";
        assert_eq!(super::orientation(big), Some(8));
        for end in 0..little.len() - 6 {
            let _ = super::orientation(&little[..end]);
        }
    }
}
