//! PNG whose strips of rows are filtered and deflated on all threads.
//!
//! A strip is deflated for itself and ends with an empty stored block (a *sync flush*, RFC 1951), so strips follow each other as one stream;
//! Adler-32 of the stream is combined from those of the strips. The first row of a strip has the filter Sub, the others Up. Each strip is one
//! IDAT chunk. At most 3 % larger than one stream of the same level, as matches do not reach into the strip before.

use std::io::{BufWriter, Write};
use std::ops::Range;

use flate2::{Compress, Compression, Crc, FlushCompress, Status};

use super::Developed;
use crate::durable::{AtomicFile, DurableError};
use crate::export::ExportError;
use crate::export::in_order::in_order;
use crate::parallel::Progress;

const ADLER: u32 = 65521;
/// Bytes that are summed before the remainder is taken: the largest count without overflow of u32.
const ADLER_RUN: usize = 5552;

/// Writes a PNG; `make` gives the samples (codes of the depth) of a strip of rows.
///
/// # Errors
/// [`ExportError`] of the file, or the caller's; no file is created then.
pub fn write_png<E: From<ExportError> + Send>(
    picture: &Developed<'_>,
    progress: Progress<'_>,
    make: impl Fn(Range<usize>) -> Result<Vec<u16>, E> + Sync,
) -> Result<(), E> {
    picture.check("PNG", i32::MAX as usize)?;
    let file = AtomicFile::create(picture.path).map_err(ExportError::from)?;
    let mut out = BufWriter::with_capacity(1 << 20, file.writer());
    let failed = |e| E::from(ExportError::from(DurableError::io("write", picture.path, 0, e)));
    out.write_all(&header(picture)).map_err(failed)?;
    let strips = picture.strips();
    let mut sum = Sum { adler: 1, bytes: 0 };
    let encode = |k: usize| {
        let rows = picture.strip(k);
        let samples = make(rows)?;
        Ok::<_, E>(Strip::new(picture, &samples, k == 0))
    };
    in_order(strips, picture.threads, encode, |k, mut strip: Strip| {
        sum = sum.followed_by(strip.sum);
        if k + 1 == strips {
            // An empty last block, and the checksum of all.
            strip.data.extend([3, 0]);
            strip.data.extend(sum.adler.to_be_bytes());
        }
        out.write_all(&chunk(b"IDAT", &strip.data)).map_err(failed)?;
        progress(picture.strip(k).end as u64, picture.size.height as u64);
        Ok(())
    })?;
    out.write_all(&chunk(b"IEND", &[])).map_err(failed)?;
    out.into_inner().map_err(|e| failed(e.into_error()))?;
    Ok(file.finish().map_err(ExportError::from)?)
}

fn header(p: &Developed<'_>) -> Vec<u8> {
    let mut ihdr = Vec::new();
    ihdr.extend((p.size.width as u32).to_be_bytes());
    ihdr.extend((p.size.height as u32).to_be_bytes());
    let colour = if p.channels == 3 { 2 } else { 0 };
    ihdr.extend([p.depth as u8, colour, 0, 0, 0]);
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    bytes.extend(chunk(b"IHDR", &ihdr));
    bytes.extend(match p.linear {
        true => chunk(b"gAMA", &100_000u32.to_be_bytes()),
        false => chunk(b"sRGB", &[1]),
    });
    let latin1 = |c: char| u8::try_from(u32::from(c)).ok().filter(|b| *b != 0).unwrap_or(b'?');
    let text: Vec<u8> = b"Comment\0".iter().copied().chain(p.comment.chars().map(latin1)).collect();
    bytes.extend(chunk(b"tEXt", &text));
    bytes
}

fn chunk(name: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let mut bytes = (data.len() as u32).to_be_bytes().to_vec();
    bytes.extend(name);
    bytes.extend(data);
    let mut crc = Crc::new();
    crc.update(&bytes[4..]);
    bytes.extend(crc.sum().to_be_bytes());
    bytes
}

/// Adler-32 of some bytes, and their number.
#[derive(Clone, Copy, Debug)]
struct Sum {
    adler: u32,
    bytes: u64,
}

impl Sum {
    fn of(data: &[u8]) -> Self {
        let (mut a, mut b) = (1u32, 0u32);
        for run in data.chunks(ADLER_RUN) {
            for byte in run {
                a += u32::from(*byte);
                b += a;
            }
            (a, b) = (a % ADLER, b % ADLER);
        }
        Self { adler: b << 16 | a, bytes: data.len() as u64 }
    }

    /// Of these bytes and then `next`.
    fn followed_by(self, next: Self) -> Self {
        let modulus = u64::from(ADLER);
        let (a1, b1) = (u64::from(self.adler & 0xffff), u64::from(self.adler >> 16));
        let (a2, b2) = (u64::from(next.adler & 0xffff), u64::from(next.adler >> 16));
        // `next` was summed from (1, 0) instead of (a1, b1).
        let a = (a1 + a2 + modulus - 1) % modulus;
        let b = (b1 + b2 + (next.bytes % modulus) * (a1 + modulus - 1)) % modulus;
        Self { adler: (b as u32) << 16 | a as u32, bytes: self.bytes + next.bytes }
    }
}

/// An encoded strip.
struct Strip {
    data: Vec<u8>,
    sum: Sum,
}

impl Strip {
    fn new(p: &Developed<'_>, samples: &[u16], first: bool) -> Self {
        let filtered = filtered(p, samples);
        let mut data = Vec::with_capacity(filtered.len() / 2 + 64);
        if first {
            data.extend([0x78, 0x01]);
        }
        let mut deflate = Compress::new(Compression::new(1), false);
        let mut rest = &filtered[..];
        loop {
            let before = deflate.total_in();
            data.reserve(rest.len() / 2 + 1024);
            let status = deflate.compress_vec(rest, &mut data, FlushCompress::Sync);
            rest = &rest[(deflate.total_in() - before) as usize..];
            // Free space after the call: nothing is pending in the encoder.
            if rest.is_empty() && data.len() < data.capacity() || matches!(status, Ok(Status::BufError)) {
                break;
            }
        }
        Self { data, sum: Sum::of(&filtered) }
    }
}

/// Rows with their filters.
fn filtered(p: &Developed<'_>, samples: &[u16]) -> Vec<u8> {
    let bytes: Vec<u8> = match p.depth {
        8 => samples.iter().map(|v| *v as u8).collect(),
        _ => samples.iter().flat_map(|v| v.to_be_bytes()).collect(),
    };
    let (width, pixel) = (p.row_bytes(), p.channels * p.depth as usize / 8);
    let mut out = Vec::with_capacity(bytes.len() + bytes.len() / width);
    for (y, row) in bytes.chunks_exact(width).enumerate() {
        if y == 0 {
            out.push(1);
            out.extend_from_slice(&row[..pixel]);
            out.extend(std::iter::zip(&row[pixel..], row).map(|(v, left)| v.wrapping_sub(*left)));
        } else {
            out.push(2);
            let above = &bytes[(y - 1) * width..][..width];
            out.extend(std::iter::zip(row, above).map(|(v, above)| v.wrapping_sub(*above)));
        }
    }
    out
}
