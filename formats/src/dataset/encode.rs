//! Pictures and arrays of samples, encoded in memory.

use std::io::Cursor;

use pipeline::geometry::Size;
use png::{BitDepth, ColorType, Compression, Encoder, SrgbRenderingIntent};
use tiff::encoder::{TiffEncoder, colortype};

use crate::shard::SampleType;

/// A picture or an array that cannot be encoded.
#[derive(Debug, thiserror::Error)]
#[error("encoding {format}: {problem}")]
pub struct EncodeError {
    format: &'static str,
    problem: String,
}

/// Integers of a picture, pixel by pixel.
#[derive(Clone, Copy, Debug)]
pub struct Codes<'a> {
    /// Size in pixels.
    pub size: Size,
    /// 3 (red, green, blue) or 1.
    pub channels: usize,
    /// Values, as many as pixels times channels.
    pub values: &'a [u16],
}

/// A PNG of `bits` (8 or 16) a sample; `srgb`: whether the values are those of sRGB.
///
/// # Errors
/// [`EncodeError`]: a side that PNG does not have.
pub fn png(codes: Codes<'_>, bits: u8, srgb: bool) -> Result<Vec<u8>, EncodeError> {
    let fail = |e: png::EncodingError| EncodeError { format: "PNG", problem: e.to_string() };
    let mut out = Vec::new();
    let mut encoder = Encoder::new(&mut out, codes.size.width as u32, codes.size.height as u32);
    encoder.set_color(if codes.channels == 3 { ColorType::Rgb } else { ColorType::Grayscale });
    encoder.set_depth(if bits == 8 { BitDepth::Eight } else { BitDepth::Sixteen });
    encoder.set_compression(Compression::Fast);
    if srgb {
        encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric);
    }
    let bytes: Vec<u8> = match bits {
        8 => codes.values.iter().map(|v| *v as u8).collect(),
        _ => codes.values.iter().flat_map(|v| v.to_be_bytes()).collect(),
    };
    let mut writer = encoder.write_header().map_err(fail)?;
    writer.write_image_data(&bytes).map_err(fail)?;
    writer.finish().map_err(fail)?;
    Ok(out)
}

/// A TIFF of 16 bits a sample.
///
/// # Errors
/// [`EncodeError`]: a size that TIFF does not have.
pub fn tiff(codes: Codes<'_>) -> Result<Vec<u8>, EncodeError> {
    let fail = |e: tiff::TiffError| EncodeError { format: "TIFF", problem: e.to_string() };
    let mut out = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut out).map_err(fail)?;
    let (width, height) = (codes.size.width as u32, codes.size.height as u32);
    match codes.channels {
        3 => encoder.write_image::<colortype::RGB16>(width, height, codes.values),
        _ => encoder.write_image::<colortype::Gray16>(width, height, codes.values),
    }
    .map_err(fail)?;
    Ok(out.into_inner())
}

/// An NPY file of `samples`, little-endian, in C order.
pub fn npy(sample: SampleType, shape: &[usize], samples: &[u8]) -> Vec<u8> {
    let mut out = crate::npy::header_of(sample, shape);
    out.extend(samples);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_read_back_by_their_decoders() {
        let values: Vec<u16> = (0..2 * 3 * 3).map(|v| v * 13).collect();
        let size = Size::new(2, 3);
        for (bits, channels) in [(8, 3), (16, 3), (16, 1)] {
            let codes = Codes { size, channels, values: &values[..6 * channels] };
            let bytes = png(codes, bits, bits == 8).unwrap();
            let mut reader = png::Decoder::new(Cursor::new(bytes)).read_info().unwrap();
            let mut found = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut found).unwrap();
            let expected: Vec<u8> = match bits {
                8 => codes.values.iter().map(|v| *v as u8).collect(),
                _ => codes.values.iter().flat_map(|v| v.to_be_bytes()).collect(),
            };
            assert_eq!(found, expected);
        }
        let bytes = tiff(Codes { size, channels: 3, values: &values }).unwrap();
        let mut decoder = tiff::decoder::Decoder::new(Cursor::new(bytes)).unwrap();
        assert!(
            matches!(decoder.read_image().unwrap(), tiff::decoder::DecodingResult::U16(v) if v == values)
        );
    }

    #[test]
    fn arrays_are_read_back_as_npy() {
        let samples: Vec<u8> = (0..24u16).flat_map(u16::to_le_bytes).collect();
        let bytes = npy(SampleType::U16, &[2, 3, 4], &samples);
        let header = crate::npy::header(&bytes).unwrap();
        assert_eq!((header.shape, header.fortran, header.offset % 64), (vec![2, 3, 4], false, 0));
        assert_eq!(bytes[header.offset..], samples);
    }
}
