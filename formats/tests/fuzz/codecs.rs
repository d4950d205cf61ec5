//! Compressed chunks written byte by byte: valid, with other sizes in the header than in the data, or of an extreme compression ratio. Formats: RFC 8878 (zstd), RFC 1950-1952 (zlib, gzip), Blosc 1 chunks (c-blosc README_CHUNK_FORMAT), Zarr v3
//! sharding_indexed.

use crate::fuzz_support::extreme::{integer, magnitude};
use crate::fuzz_support::{Random, damage};
use std::io::Write;

/// Maximum bytes of a zstd block.
const ZSTD_BLOCK: usize = 128 << 10;

/// `count` samples of `bytes` each, little endian: a ramp with some extreme magnitudes, sometimes of another length.
pub fn samples(count: usize, bytes: usize, r: &mut Random) -> Vec<u8> {
    let mut values: Vec<f64> = (0..count).map(|i| i as f64 * 0.01).collect();
    for _ in 0..r.below(4) {
        let at = r.below(count);
        values[at] = magnitude(r);
    }
    let count = match r.below(12) {
        0 => r.below(count),
        1 => count + 1 + r.below(1000),
        _ => count,
    };
    let values = values.iter().cycle().take(count);
    match bytes {
        8 => values.flat_map(|v| v.to_le_bytes()).collect(),
        4 => values.flat_map(|v| (*v as f32).to_le_bytes()).collect(),
        2 => values.flat_map(|v| half::f16::from_f64(*v).to_le_bytes()).collect(),
        _ => values.map(|v| *v as u8).collect(),
    }
}

/// A zstd frame of raw blocks, or of run-length blocks that decode to up to 2 GiB.
pub fn zstd(data: &[u8], r: &mut Random) -> Vec<u8> {
    let mut out = 0xFD2F_B528_u32.to_le_bytes().to_vec();
    let size = match r.below(4) {
        0 => integer(r),
        _ => data.len() as u64,
    };
    match r.below(3) {
        // Single segment with a content size of 8 bytes.
        0 => {
            out.push(0xE0);
            out.extend(size.to_le_bytes());
        }
        // A window descriptor and no content size.
        1 => out.extend([0, if r.below(4) == 0 { r.next() as u8 } else { 0x58 }]),
        // Window descriptor and a content size of 4 bytes.
        _ => {
            out.extend([0x80, 0x58]);
            out.extend((size as u32).to_le_bytes());
        }
    }
    let block = |out: &mut Vec<u8>, last: bool, kind: u32, size: usize, bytes: &[u8]| {
        let header = u32::from(last) | kind << 1 | (size as u32) << 3;
        out.extend(&header.to_le_bytes()[..3]);
        out.extend(bytes);
    };
    let (raw, run) = (0, 1);
    if r.below(8) == 0 {
        let blocks = 1usize << r.below(15);
        (0..blocks).for_each(|i| block(&mut out, i + 1 == blocks, run, ZSTD_BLOCK, &[0]));
    } else {
        let parts: Vec<&[u8]> = data.chunks(ZSTD_BLOCK).collect();
        parts.iter().enumerate().for_each(|(i, p)| block(&mut out, i + 1 == parts.len(), raw, p.len(), p));
    }
    match r.below(16) {
        // A skippable frame before, the same frame again, a missing end.
        0 => {
            let mut skippable = 0x184D_2A50_u32.to_le_bytes().to_vec();
            skippable.extend((integer(r) as u32).to_le_bytes());
            out.splice(0..0, skippable);
        }
        1 => out.extend(out.clone()),
        2 => out.truncate(r.below(out.len())),
        _ => {}
    }
    out
}

/// Deflated zeros: each byte decodes to about a thousand.
pub struct Bombs {
    gzip: Vec<Vec<u8>>,
    zlib: Vec<Vec<u8>>,
}

impl Bombs {
    pub fn new() -> Self {
        let zeros = vec![0; 64 << 20];
        let sizes = [1 << 16, 1 << 22, 64 << 20];
        let gzip = sizes.map(|n| deflate_gzip(&zeros[..n], 9)).into();
        Self { gzip, zlib: sizes.map(|n| deflate_zlib(&zeros[..n], 9)).into() }
    }

    /// One or two gzip members; the size in the trailer may be wrong.
    pub fn gzip(&self, data: &[u8], r: &mut Random) -> Vec<u8> {
        let mut out = match r.below(8) {
            0 => self.gzip[r.below(self.gzip.len())].clone(),
            _ => deflate_gzip(data, 1),
        };
        match r.below(8) {
            0 => {
                let at = out.len() - 4;
                out[at..].copy_from_slice(&(integer(r) as u32).to_le_bytes());
            }
            1 => out.extend(self.gzip[0].clone()),
            // Flags of a name, a comment, extra fields, a checksum.
            2 => out[3] = r.next() as u8,
            3 => out.truncate(r.below(out.len())),
            4 => damage(&mut out, r),
            _ => {}
        }
        out
    }

    pub fn zlib(&self, data: &[u8], r: &mut Random) -> Vec<u8> {
        let mut out = match r.below(8) {
            0 => self.zlib[r.below(self.zlib.len())].clone(),
            _ => deflate_zlib(data, 1),
        };
        match r.below(8) {
            0 => out.truncate(r.below(out.len())),
            1 => damage(&mut out, r),
            _ => {}
        }
        out
    }
}

fn deflate_gzip(data: &[u8], level: u32) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::new(level));
    encoder.write_all(data).unwrap();
    encoder.finish().unwrap()
}

fn deflate_zlib(data: &[u8], level: u32) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::new(level));
    encoder.write_all(data).unwrap();
    encoder.finish().unwrap()
}

/// A Blosc 1 chunk of uncompressed data, sometimes with the flag of compressed data; sizes in the header may be wrong.
pub fn blosc(data: &[u8], typesize: usize, r: &mut Random) -> Vec<u8> {
    const STORED: u8 = 2;
    let flags = match r.below(6) {
        // Shuffled, bit-shuffled, any codec number in the upper three bits.
        0 => r.next() as u8,
        _ => STORED,
    };
    let mut out = vec![2, 1, flags, typesize as u8];
    let (n, with_header) = (data.len() as u32, data.len() as u32 + 16);
    for correct in [n, n.max(1), with_header] {
        let value = if r.below(6) == 0 { integer(r) as u32 } else { correct };
        out.extend(value.to_le_bytes());
    }
    out.extend(data);
    match r.below(12) {
        0 => out.truncate(r.below(out.len())),
        1 => out[r.below(4)] = r.next() as u8,
        2 => damage(&mut out, r),
        _ => {}
    }
    out
}

/// Replaces one size in the header of a chunk of another program.
pub fn damage_blosc_header(chunk: &mut [u8], r: &mut Random) {
    if chunk.len() >= 16 {
        let at = 4 * (1 + r.below(3));
        chunk[at..at + 4].copy_from_slice(&(integer(r) as u32).to_le_bytes());
    }
}

/// A shard of these inner chunks, with its index at the end or the beginning and a valid CRC-32C; entries may point anywhere.
pub fn shard(chunks: &[Vec<u8>], index_first: bool, r: &mut Random) -> Vec<u8> {
    let index_bytes = chunks.len() * 16 + 4;
    let (mut body, mut index) = (Vec::new(), Vec::new());
    for chunk in chunks {
        let start = body.len() + if index_first { index_bytes } else { 0 };
        let mut entry = [start as u64, chunk.len() as u64];
        match r.below(10) {
            0 => entry[r.below(2)] = integer(r),
            1 => entry = [u64::MAX, if r.below(2) == 0 { u64::MAX } else { chunk.len() as u64 }],
            2 => entry = [0, (body.len() + chunk.len()) as u64],
            _ => {}
        }
        index.extend(entry.iter().flat_map(|v| v.to_le_bytes()));
        body.extend(chunk);
    }
    let sum = crc32c(&index);
    index.extend(sum.to_le_bytes());
    let mut out = if index_first { [index, body].concat() } else { [body, index].concat() };
    match r.below(12) {
        0 => out.truncate(r.below(out.len() + 1)),
        1 => damage(&mut out, r),
        _ => {}
    }
    out
}

/// CRC-32C (Castagnoli polynomial), bit by bit (RFC 3720, B.4).
pub fn crc32c(bytes: &[u8]) -> u32 {
    let step = |crc: u32| if crc & 1 == 1 { crc >> 1 ^ 0x82F6_3B78 } else { crc >> 1 };
    !bytes.iter().fold(!0, |crc, b| (0..8).fold(crc ^ u32::from(*b), |crc, _| step(crc)))
}

#[test]
fn crc32c_matches_rfc_3720() {
    assert_eq!(crc32c(&[0; 32]), 0x8A91_36AA);
    assert_eq!(crc32c(b"123456789"), 0xE306_9283);
}
