//! Strips and tiles of a raw: uncompressed, lossless JPEG, or deflate.
//!
//! Uncompressed samples of 8 bits are bytes, of 16 bits words in the byte order of the file, of 9 to 15 bits (and 1 to 7) packed from the highest
//! bit on, each row beginning at a byte. Memory is allocated after the strips were found to be inside the file, and their data to be enough for
//! their pixels. Source: TIFF 6.0, sections 3 and 15; Digital Negative Specification 1.4, chapter 3.

use pipeline::geometry::Size;

use super::error::DngError;
use super::ifd::{Directory, Tiff};
use super::lossless_jpeg::{self, Problem};

/// Samples of a raw, at most: 1 GiB of memory.
const MAX_SAMPLES: usize = 1 << 29;
/// Greatest ratio of deflate (zlib.net/zlib_tech.html).
const MAX_DEFLATE_RATIO: u64 = 1032;
/// Way out for files that the program cannot decode.
const CONVERT: &str = "1 (none), 7 with lossless JPEG, or 8 (deflate) of integers; convert the file by Adobe DNG Converter without lossy compression, or to a linear TIFF of 16 bits by LibRaw's `dcraw_emu -4 -T`";

#[derive(Clone, Copy, Debug, PartialEq)]
enum Compression {
    None,
    Jpeg,
    Deflate,
}

/// How the samples of a directory are stored.
#[derive(Debug)]
pub(super) struct Layout {
    /// Size of the whole raw.
    pub(super) size: Size,
    /// Samples of a pixel.
    pub(super) samples: usize,
    /// Bits of a sample.
    pub(super) bits: u32,
    compression: Compression,
    /// Whether samples are differences to those on their left.
    has_differences: bool,
    /// Size of a tile, or of a strip.
    tile: Size,
    /// Whether the last strip ends with the picture.
    is_strips: bool,
    /// Offset and bytes of each.
    data: Vec<(u64, u64)>,
}

impl Layout {
    /// Reads and checks what a directory says.
    pub(super) fn read(tiff: &Tiff, raw: &Directory) -> Result<Self, DngError> {
        let unsupported = |what, expected: &str, found: String| DngError::Unsupported {
            path: tiff.path().into(),
            what,
            expected: expected.into(),
            found,
        };
        let whole = |tag: u16, default: Option<usize>| -> Result<usize, DngError> {
            let found = tiff.number(raw, tag)?.map(|v| v as usize).or(default);
            found.ok_or_else(|| tiff.damaged(format!("tag {tag} of its raw is missing")))
        };
        let size = Size::new(whole(257, None)?, whole(256, None)?);
        let samples = whole(277, Some(1))?;
        if samples != 1 && samples != 3 {
            return Err(unsupported("samples of a pixel", "1 or 3", samples.to_string()));
        }
        let count = size.height.checked_mul(size.width).and_then(|n| n.checked_mul(samples));
        if count.is_none_or(|n| n == 0 || n > MAX_SAMPLES) {
            let expected = "1 to 2^29 samples";
            return Err(unsupported("size", expected, format!("{size} pixels of {samples} samples")));
        }
        let compression = match whole(259, Some(1))? {
            1 => Compression::None,
            7 => Compression::Jpeg,
            8 => Compression::Deflate,
            34892 => return Err(unsupported("compression", CONVERT, "34892 (lossy JPEG)".into())),
            52546 => return Err(unsupported("compression", CONVERT, "52546 (JPEG XL)".into())),
            other => return Err(unsupported("compression", CONVERT, other.to_string())),
        };
        let bits = tiff.numbers(raw, 258)?.filter(|b| !b.is_empty()).unwrap_or(vec![1.0]);
        let formats = tiff.numbers(raw, 339)?.unwrap_or(vec![1.0]);
        let is_integer = formats.iter().all(|f| *f == 1.0);
        if !is_integer || bits.iter().any(|b| *b != bits[0]) || !(8.0..=16.0).contains(&bits[0]) {
            let kind = if is_integer { "integers" } else { "another kind" };
            return Err(unsupported(
                "samples",
                "integers of 8 to 16 bits",
                format!("{kind} of {bits:?} bits"),
            ));
        }
        let planar = whole(284, Some(1))?;
        if planar != 1 && samples > 1 {
            return Err(unsupported("planes", "samples side by side (1)", format!("configuration {planar}")));
        }
        let order = whole(266, Some(1))?;
        let predictor = whole(317, Some(1))?;
        let has_differences = predictor == 2 && compression == Compression::Deflate;
        for (what, found, expected) in [
            ("order of bits", order, "1 (highest first)"),
            ("interleaving of rows", whole(50975, Some(1))?, "1"),
            ("interleaving of columns", whole(52547, Some(1))?, "1"),
            ("predictor", if has_differences { 1 } else { predictor }, "1, or 2 of deflate"),
        ] {
            if found != 1 {
                return Err(unsupported(what, expected, found.to_string()));
            }
        }
        if tiff.numbers(raw, 50974)?.is_some_and(|block| block.iter().any(|side| *side != 1.0)) {
            return Err(unsupported("blocks inside tiles", "none", "SubTileBlockSize".into()));
        }
        let is_strips = !raw.has(324);
        let (tile, tags) = match is_strips {
            true => (Size::new(whole(278, Some(size.height))?.min(size.height), size.width), (273, 279)),
            false => (Size::new(whole(323, None)?, whole(322, None)?), (324, 325)),
        };
        if tile.height == 0
            || tile.width == 0
            || tile.height.checked_mul(tile.width).is_none_or(|n| n > MAX_SAMPLES)
        {
            return Err(tiff.damaged(format!("its tiles have {tile} pixels")));
        }
        let bits = bits[0] as u32;
        if has_differences && bits != 8 && bits != 16 {
            return Err(unsupported("predictor 2", "8 or 16 bits", bits.to_string()));
        }
        let list = |tag| {
            let all = tiff.numbers(raw, tag)?;
            all.ok_or_else(|| tiff.damaged(format!("tag {tag} of its raw is missing")))
        };
        let data = std::iter::zip(list(tags.0)?, list(tags.1)?).map(|(a, b)| (a as u64, b as u64)).collect();
        let layout = Self { size, samples, bits, compression, has_differences, tile, is_strips, data };
        layout.check(tiff)?;
        Ok(layout)
    }

    fn across(&self) -> usize {
        self.size.width.div_ceil(self.tile.width)
    }

    /// Rows and samples of a row that part `k` stores.
    fn stored(&self, k: usize) -> (usize, usize) {
        let first = k / self.across() * self.tile.height;
        let rows =
            if self.is_strips { self.tile.height.min(self.size.height - first) } else { self.tile.height };
        (rows, self.tile.width * self.samples)
    }

    fn packed_bytes(&self, (rows, width): (usize, usize)) -> u64 {
        (width as u64 * u64::from(self.bits)).div_ceil(8) * rows as u64
    }

    /// Fails unless all parts are inside the file, and long enough.
    fn check(&self, tiff: &Tiff) -> Result<(), DngError> {
        let parts = self.across() * self.size.height.div_ceil(self.tile.height);
        if self.data.len() != parts {
            return Err(tiff.damaged(format!("it has {} strips or tiles, expected {parts}", self.data.len())));
        }
        for (k, (at, bytes)) in self.data.iter().enumerate() {
            tiff.check(*at, *bytes)?;
            let stored = self.stored(k);
            let least = match self.compression {
                Compression::None => self.packed_bytes(stored),
                Compression::Deflate => self.packed_bytes(stored) / MAX_DEFLATE_RATIO,
                Compression::Jpeg => (stored.0 as u64 * stored.1 as u64) / 8,
            };
            if *bytes < least {
                return Err(tiff.damaged(format!(
                    "strip or tile {k} has {bytes} bytes, expected at least {least} for its pixels"
                )));
            }
        }
        Ok(())
    }

    /// All samples, row by row, those of a pixel side by side.
    pub(super) fn decode(&self, tiff: &Tiff) -> Result<Vec<u16>, DngError> {
        let width = self.size.width * self.samples;
        let mut out = vec![0u16; self.size.height * width];
        for (k, (at, bytes)) in self.data.iter().enumerate() {
            let (rows, stride) = self.stored(k);
            let part = self.part(tiff, k, &tiff.bytes(*at, *bytes)?)?;
            let (top, left) = (k / self.across() * self.tile.height, k % self.across() * stride);
            let columns = stride.min(width - left);
            for row in 0..rows.min(self.size.height - top) {
                out[(top + row) * width + left..][..columns]
                    .copy_from_slice(&part[row * stride..][..columns]);
            }
        }
        Ok(out)
    }

    fn part(&self, tiff: &Tiff, k: usize, data: &[u8]) -> Result<Vec<u16>, DngError> {
        let stored = self.stored(k);
        let damaged = |reason: &str| tiff.damaged(format!("strip or tile {k}: {reason}"));
        match self.compression {
            Compression::None => Ok(self.unpacked(tiff, data, stored)),
            Compression::Jpeg => lossless_jpeg::decode(data, stored.0 * stored.1).map_err(|e| match e {
                Problem::Damaged(reason) => damaged(reason),
                Problem::Lossy => DngError::Unsupported {
                    path: tiff.path().into(),
                    what: "compression",
                    expected: CONVERT.into(),
                    found: "7 with a JPEG that is not a lossless one".into(),
                },
            }),
            Compression::Deflate => {
                let mut bytes = vec![0; self.packed_bytes(stored) as usize];
                let found = crate::inflate::zlib(data, &mut bytes).map_err(|e| damaged(&e))?;
                if found != bytes.len() {
                    return Err(damaged("it ends before its pixels do"));
                }
                let mut samples = self.unpacked(tiff, &bytes, stored);
                if self.has_differences {
                    let mask = u16::MAX >> (16 - self.bits);
                    for row in samples.chunks_exact_mut(stored.1) {
                        for i in self.samples..row.len() {
                            row[i] = row[i].wrapping_add(row[i - self.samples]) & mask;
                        }
                    }
                }
                Ok(samples)
            }
        }
    }

    fn unpacked(&self, tiff: &Tiff, data: &[u8], (rows, width): (usize, usize)) -> Vec<u16> {
        let bytes = (self.packed_bytes((1, width)) as usize).max(1);
        let mut out = Vec::with_capacity(rows * width);
        for row in data.chunks_exact(bytes).take(rows) {
            match (self.bits, tiff.is_big_endian) {
                (8, _) => out.extend(row.iter().map(|v| u16::from(*v))),
                (16, true) => out.extend(row.as_chunks().0.iter().map(|b| u16::from_be_bytes(*b))),
                (16, false) => out.extend(row.as_chunks().0.iter().map(|b| u16::from_le_bytes(*b))),
                (bits, _) => {
                    let (mut held, mut count, mut from) = (0u32, 0, row.iter());
                    for _ in 0..width {
                        while count < bits {
                            held = held << 8 | u32::from(*from.next().unwrap_or(&0));
                            count += 8;
                        }
                        count -= bits;
                        out.push((held >> count & ((1 << bits) - 1)) as u16);
                    }
                }
            }
        }
        out
    }
}
