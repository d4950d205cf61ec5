//! Zlib streams (RFC 1950), whole, into buffers of known size: libdeflate, which takes half the time of stream decoders.

use libdeflater::{DecompressionError, Decompressor};

/// Decompresses `data` to the start of `out`; returns the number of bytes.
///
/// # Errors
/// A description: the stream is damaged, its checksum differs, or it holds more than `out`.
pub(crate) fn zlib(data: &[u8], out: &mut [u8]) -> Result<usize, String> {
    Decompressor::new().zlib_decompress(data, out).map_err(|e| match e {
        DecompressionError::BadData => "a damaged zlib stream".into(),
        DecompressionError::InsufficientSpace => format!("more than {} bytes when decoded", out.len()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn streams_are_decoded_and_damaged_or_larger_ones_are_errors() {
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::new(6));
        encoder.write_all(&[7; 1000]).unwrap();
        let mut data = encoder.finish().unwrap();
        let mut out = [0; 1004];
        assert_eq!(zlib(&data, &mut out), Ok(1000));
        assert_eq!(out[..1000], [7; 1000]);
        assert_eq!(zlib(&data, &mut out[..999]).unwrap_err(), "more than 999 bytes when decoded");
        assert_eq!(zlib(&data[..data.len() - 1], &mut out).unwrap_err(), "a damaged zlib stream");
        *data.last_mut().unwrap() ^= 1;
        assert_eq!(zlib(&data, &mut out).unwrap_err(), "a damaged zlib stream");
    }
}
