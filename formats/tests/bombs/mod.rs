//! Compressed zeros of an extreme compression ratio, and headers that state such a size.
#![allow(dead_code, reason = "shared by tests that each use a part")]

use std::io::Write;

use flate2::Compression;

/// A zstd frame without its content size (RFC 8878): `blocks` run-length blocks of 128 KiB in 4 bytes each.
pub fn zstd_without_content_size(blocks: usize) -> Vec<u8> {
    // Magic number; descriptor: no size, no checksum; window of 128 KiB.
    let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x38];
    for block in 0..blocks {
        let last = u32::from(block + 1 == blocks);
        let header = last | 1 << 1 | (128 << 10) << 3;
        frame.extend(&header.to_le_bytes()[..3]);
        frame.push(0);
    }
    frame
}

/// A zstd frame of one segment that states a content size; its data is one byte.
pub fn zstd_with_stated_size(size: u64) -> Vec<u8> {
    // Descriptor: size in 8 bytes, one segment; then one raw block of one byte, the last.
    let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0xe0];
    frame.extend(size.to_le_bytes());
    frame.extend([0x09, 0, 0, 7]);
    frame
}

/// `size` zeros as gzip.
pub fn gzip_zeros(size: usize) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), Compression::fast());
    write_zeros(&mut encoder, size);
    encoder.finish().unwrap()
}

/// `size` zeros as zlib.
pub fn zlib_zeros(size: usize) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), Compression::fast());
    write_zeros(&mut encoder, size);
    encoder.finish().unwrap()
}

/// A blosc chunk of one block (README_CHUNK_FORMAT) whose header states `size` bytes; `compressor`: 0 blosclz, 1 lz4, 2 snappy,
/// 3 zlib, 4 zstd.
pub fn blosc_with_stated_size(size: u32, compressor: u8) -> Vec<u8> {
    let mut chunk = vec![2, 1, compressor << 5, 1];
    chunk.extend(size.to_le_bytes());
    chunk.extend(size.to_le_bytes());
    chunk.extend(32u32.to_le_bytes());
    chunk.extend(20u32.to_le_bytes());
    chunk.extend([8, 0, 0, 0]);
    chunk.extend([0; 8]);
    chunk
}

fn write_zeros(to: &mut impl Write, size: usize) {
    let zeros = vec![0; 1 << 20];
    let mut left = size;
    while left > 0 {
        let n = left.min(zeros.len());
        to.write_all(&zeros[..n]).unwrap();
        left -= n;
    }
}
