//! Pictures of a mesh as textures: PNG (ISO/IEC 15948), JPEG (ISO/IEC 10918, baseline and progressive, 8 bits), WebP (RFC 9649).
//!
//! A texel is red, green, blue and straight alpha, 8 bits, sRGB coded. Colour profiles, gamma and orientation are ignored, as glTF 2.0,
//! 3.8.3, demands. 16 bits are rounded to 8. The size is checked by the header before anything is decoded.

use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use image_webp::WebPDecoder;
use png::{BitDepth, Limits, Transformations};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::context::Context;
use super::error::MeshError;
use pipeline::scene::description::Texture;

/// Maximum width and height in texels.
const MAX_SIDE: usize = 1 << 15;
/// Memory of a decoder per byte of the picture: the picture, coefficients of a progressive JPEG (16 bits) or planes of a WebP.
const DECODER_BYTES_PER_BYTE: u64 = 4;

/// A picture about to be decoded.
struct Picture<'a> {
    context: &'a Context<'a>,
    /// The mesh, or the picture's own file.
    path: &'a Path,
    place: &'a str,
    bytes: &'a [u8],
}

/// Decodes a picture by its signature. `path` is its file, or the mesh that holds it; `place` names it in the mesh. The texels count as in use.
///
/// # Errors
/// Another format, a damaged picture, a size beyond the limits.
pub(super) fn decode(
    context: &Context<'_>,
    path: &Path,
    place: &str,
    name: String,
    bytes: &[u8],
) -> Result<Texture, MeshError> {
    let picture = Picture { context, path, place, bytes };
    let decoded = match format(bytes) {
        "PNG" => picture.png(),
        "JPEG" => picture.jpeg(),
        "WebP" => picture.webp(),
        other => Err(picture.unsupported(other)),
    }?;
    let (width, height, texels) = decoded;
    Ok(Texture { name, width, height, texels })
}

/// Format by the first bytes.
fn format(bytes: &[u8]) -> &'static str {
    let starts = |signature: &[u8]| bytes.starts_with(signature);
    match () {
        () if starts(b"\x89PNG\r\n\x1a\n") => "PNG",
        () if starts(b"\xff\xd8\xff") => "JPEG",
        () if starts(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") => "WebP",
        () if starts(b"\xabKTX 20\xbb") => "a KTX2 picture",
        () if starts(b"\xabKTX 11\xbb") => "a KTX picture",
        () if starts(b"DDS ") => "a DDS picture",
        () if starts(b"GIF8") => "a GIF picture",
        () if starts(b"BM") => "a BMP picture",
        () if starts(b"II*\0") || starts(b"MM\0*") => "a TIFF picture",
        () if starts(b"\x76\x2f\x31\x01") => "an OpenEXR picture",
        () if starts(b"#?RADIANCE") => "a Radiance picture",
        () if bytes.get(4..8) == Some(b"ftyp") => "an AVIF or HEIF picture",
        () => "a picture of unknown format",
    }
}

/// Columns, rows, texels.
type Decoded = (usize, usize, Vec<[u8; 4]>);

impl Picture<'_> {
    fn png(&self) -> Result<Decoded, MeshError> {
        let bytes = usize::try_from(self.context.limits.max_bytes).unwrap_or(usize::MAX);
        let mut decoder = png::Decoder::new_with_limits(Cursor::new(self.bytes), Limits { bytes });
        decoder.set_ignore_text_chunk(true);
        decoder.set_ignore_iccp_chunk(true);
        // Palettes are converted to RGB, 1 to 4 bits to 8, transparent colours to an alpha channel.
        decoder.set_transformations(Transformations::EXPAND);
        let info =
            self.guarded(|| decoder.read_header_info().map(|i| (i.width as usize, i.height as usize)))?;
        self.check_size(info.0, info.1)?;
        let mut reader = self.guarded(|| decoder.read_info())?;
        let (colour, depth) = reader.output_color_type();
        let raw_bytes = reader.output_buffer_size().ok_or_else(|| self.damaged("it is too large"))?;
        self.decoded(info, colour.samples(), depth == BitDepth::Sixteen, raw_bytes, 1, |raw| {
            self.guarded(|| reader.next_frame(raw).map(|_| ()))
        })
    }

    fn jpeg(&self) -> Result<Decoded, MeshError> {
        // Without `unsafe` the decoder is the same on every machine. A truncated file is an error.
        let options = DecoderOptions::new_safe().set_strict_mode(true).set_use_unsafe(false);
        let options = options.set_max_width(usize::from(u16::MAX)).set_max_height(usize::from(u16::MAX));
        let mut decoder = JpegDecoder::new_with_options(Cursor::new(self.bytes), options);
        self.guarded(|| decoder.decode_headers())?;
        let (width, height) = decoder.dimensions().unwrap_or_default();
        self.check_size(width, height)?;
        let (channels, out) = match decoder.input_colorspace() {
            Some(ColorSpace::Luma) => (1, ColorSpace::Luma),
            Some(ColorSpace::YCbCr | ColorSpace::RGB) => (3, ColorSpace::RGB),
            _ => return Err(self.unsupported("a JPEG of another colour model than grey, YCbCr and RGB")),
        };
        decoder.set_options(options.jpeg_set_out_colorspace(out));
        let raw_bytes = width * height * channels;
        self.decoded((width, height), channels, false, raw_bytes, DECODER_BYTES_PER_BYTE, |raw| {
            self.guarded(|| decoder.decode_into(raw))
        })
    }

    fn webp(&self) -> Result<Decoded, MeshError> {
        let mut decoder = self.guarded(|| WebPDecoder::new(Cursor::new(self.bytes)))?;
        if decoder.is_animated() {
            return Err(self.unsupported("an animated WebP picture"));
        }
        decoder.set_memory_limit(usize::try_from(self.context.limits.max_bytes).unwrap_or(usize::MAX));
        let (width, height) = decoder.dimensions();
        let (width, height) = (width as usize, height as usize);
        self.check_size(width, height)?;
        let channels = if decoder.has_alpha() { 4 } else { 3 };
        let raw_bytes = width * height * channels;
        self.decoded((width, height), channels, false, raw_bytes, DECODER_BYTES_PER_BYTE, |raw| {
            self.guarded(|| decoder.read_image(raw))
        })
    }

    fn check_size(&self, width: usize, height: usize) -> Result<(), MeshError> {
        if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
            let expected = format!("a picture of 1 to {MAX_SIDE} texels a side");
            let (path, place, found) = (self.path.into(), self.place.into(), format!("{width}x{height}"));
            return Err(MeshError::Invalid { path, place, expected, found });
        }
        self.context.check_single(4 * width as u64 * height as u64, self.place)
    }

    /// Texels of a picture of `channels` channels, of 8 or big-endian 16 bits, that `decode` writes into `raw_bytes` bytes.
    fn decoded(
        &self,
        (width, height): (usize, usize),
        channels: usize,
        is_16_bit: bool,
        raw_bytes: usize,
        decoder_bytes_per_byte: u64,
        decode: impl FnOnce(&mut [u8]) -> Result<(), MeshError>,
    ) -> Result<Decoded, MeshError> {
        let transient = raw_bytes as u64 * decoder_bytes_per_byte;
        self.context.charge(transient + 4 * width as u64 * height as u64, || self.place.into())?;
        let mut raw = vec![0; raw_bytes];
        decode(&mut raw)?;
        let texels: Vec<[u8; 4]> = match is_16_bit {
            false => raw.chunks_exact(channels).map(|p| texel(p.len(), |c| p[c])).collect(),
            true => {
                let wide = |p: &[u8], c: usize| u32::from(u16::from_be_bytes([p[2 * c], p[2 * c + 1]]));
                // Exact for 257 v, the 16-bit form of the 8-bit v; the quotient is at most 255.
                let rounded = |v: u32| u8::try_from((v * 255 + 32767) / 65535).unwrap_or(u8::MAX);
                raw.chunks_exact(2 * channels).map(|p| texel(channels, |c| rounded(wide(p, c)))).collect()
            }
        };
        self.context.release(transient);
        match texels.len() == width * height {
            true => Ok((width, height, texels)),
            false => Err(self.damaged("it decodes to another size than its header states")),
        }
    }

    /// Runs a decoder; an error or a panic of it means a damaged picture.
    fn guarded<T, E: std::fmt::Display>(
        &self,
        decode: impl FnOnce() -> Result<T, E>,
    ) -> Result<T, MeshError> {
        match catch_unwind(AssertUnwindSafe(decode)) {
            Ok(done) => done.map_err(|e| self.damaged(&e.to_string())),
            Err(_) => Err(self.damaged("the decoder failed on it")),
        }
    }

    fn damaged(&self, reason: &str) -> MeshError {
        MeshError::Picture { path: self.path.into(), place: self.place.into(), reason: reason.into() }
    }

    fn unsupported(&self, found: &str) -> MeshError {
        MeshError::Unsupported {
            path: self.path.into(),
            place: self.place.into(),
            found: found.into(),
            way_out: "convert it to PNG, JPEG or WebP".into(),
        }
    }
}

/// Texel of 1 (grey), 2 (grey, alpha), 3 or 4 samples.
fn texel(channels: usize, sample: impl Fn(usize) -> u8) -> [u8; 4] {
    match channels {
        1 => [sample(0), sample(0), sample(0), 255],
        2 => [sample(0), sample(0), sample(0), sample(1)],
        3 => [sample(0), sample(1), sample(2), 255],
        _ => [sample(0), sample(1), sample(2), sample(3)],
    }
}
