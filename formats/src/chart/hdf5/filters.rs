//! Filters of HDF5 chunks, inverted: deflate, shuffle, fletcher32, LZF, zstd. Output never exceeds a limit.

use std::io::Read;

use hdf5_pure::Filter;

use crate::inflate;

const DEFLATE: u16 = 1;
const SHUFFLE: u16 = 2;
const FLETCHER32: u16 = 3;
const LZF: u16 = 32_000;
const ZSTD: u16 = 32_015;

/// Bytes that checksums may add to a chunk.
const MAX_ADDED_BYTES: usize = 64;

/// The first filter that is not supported.
pub(super) fn unsupported(filters: &[Filter]) -> Option<&Filter> {
    filters.iter().find(|f| ![DEFLATE, SHUFFLE, FLETCHER32, LZF, ZSTD].contains(&f.id))
}

/// Inverts `filters`, without those in `mask`, of a chunk of `samples` of `sample` bytes each; the error describes the defect.
pub(super) fn invert(
    filters: &[Filter],
    mask: u32,
    mut data: Vec<u8>,
    (samples, sample): (usize, usize),
) -> Result<Vec<u8>, String> {
    let limit = samples * sample + MAX_ADDED_BYTES;
    for (k, filter) in filters.iter().enumerate().rev() {
        if mask >> k.min(31) & 1 == 1 {
            continue;
        }
        data = match filter.id {
            DEFLATE => {
                let mut out = vec![0; limit];
                let length = inflate::zlib(&data, &mut out)?;
                out.truncate(length);
                out
            }
            ZSTD => {
                read_at_most(zstd::stream::read::Decoder::new(&data[..]).map_err(|e| e.to_string())?, limit)?
            }
            LZF => lzf(&data, limit)?,
            SHUFFLE => unshuffle(&data, sample),
            FLETCHER32 => without_checksum(data)?,
            other => return Err(format!("filter {other}")),
        };
    }
    match data.len() == samples * sample {
        true => Ok(data),
        false => Err(format!("{} bytes when decoded, expected {}", data.len(), samples * sample)),
    }
}

fn read_at_most(decoder: impl Read, limit: usize) -> Result<Vec<u8>, String> {
    let mut out = Vec::with_capacity(limit);
    decoder.take(limit as u64 + 1).read_to_end(&mut out).map_err(|e| e.to_string())?;
    if out.len() > limit { Err(format!("more than {limit} bytes when decoded")) } else { Ok(out) }
}

/// Byte k of every sample lies in run k; bytes after the last complete sample follow.
fn unshuffle(data: &[u8], sample: usize) -> Vec<u8> {
    let count = data.len() / sample;
    let mut out = vec![0; data.len()];
    match sample {
        1 => return data.to_vec(),
        2 => join::<2>(data, &mut out),
        4 => join::<4>(data, &mut out),
        _ => join::<8>(data, &mut out),
    }
    out[count * sample..].copy_from_slice(&data[count * sample..]);
    out
}

fn join<const N: usize>(data: &[u8], out: &mut [u8]) {
    let count = data.len() / N;
    let runs: [&[u8]; N] = std::array::from_fn(|k| &data[k * count..(k + 1) * count]);
    for (n, to) in out.as_chunks_mut::<N>().0.iter_mut().enumerate() {
        *to = std::array::from_fn(|k| runs[k][n]);
    }
}

/// Checks and removes the sum at the end: Fletcher's, of 16-bit big-endian words, stored in little-endian order.
fn without_checksum(mut data: Vec<u8>) -> Result<Vec<u8>, String> {
    let Some(at) = data.len().checked_sub(4) else { return Err("no checksum".into()) };
    let stored = u32::from_le_bytes(*data[at..].first_chunk().expect("four bytes"));
    data.truncate(at);
    let (mut first, mut second) = (0u32, 0u32);
    let fold = |sum: u32| (sum & 0xffff) + (sum >> 16);
    // 360 words fit in 32 bits.
    for block in data.chunks(720) {
        for word in block.chunks(2) {
            first += u32::from(word[0]) << 8 | u32::from(word.get(1).copied().unwrap_or(0));
            second += first;
        }
        (first, second) = (fold(first), fold(second));
    }
    let sum = fold(second) << 16 | fold(first);
    if sum == stored { Ok(data) } else { Err(format!("checksum {sum:08x}, expected {stored:08x}")) }
}

/// LibLZF: a control byte c below 32 precedes c + 1 literal bytes; else c >> 5 (7: plus the next byte) + 2 bytes are repeated from a distance of
/// ((c & 31) << 8 | next byte) + 1.
fn lzf(data: &[u8], limit: usize) -> Result<Vec<u8>, String> {
    let (mut out, mut at) = (Vec::with_capacity(limit), 0);
    let truncated = || "truncated LZF data".to_owned();
    let mut next = |count: usize| {
        let part = data.get(at..at + count);
        at += count;
        part
    };
    while let Some(&[control]) = next(1) {
        let control = usize::from(control);
        if control < 32 {
            out.extend_from_slice(next(control + 1).ok_or_else(truncated)?);
        } else {
            let mut length = control >> 5;
            if length == 7 {
                length += usize::from(next(1).ok_or_else(truncated)?[0]);
            }
            let low = usize::from(next(1).ok_or_else(truncated)?[0]);
            let distance = ((control & 31) << 8 | low) + 1;
            let start = out.len().checked_sub(distance).ok_or("an LZF distance beyond the start")?;
            (start..start + length + 2).for_each(|k| out.push(out[k]));
        }
        if out.len() > limit {
            return Err(format!("more than {limit} bytes when decoded"));
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shuffled_bytes_are_joined_and_the_rest_follows() {
        assert_eq!(unshuffle(&[1, 3, 2, 4, 9], 2), [1, 2, 3, 4, 9]);
        assert_eq!(unshuffle(&[1, 2, 3], 1), [1, 2, 3]);
    }

    #[test]
    fn lzf_repeats_and_rejects_what_lies_outside() {
        // Two literals, then five bytes from a distance of 2.
        assert_eq!(lzf(&[1, 7, 8, 0x60, 1], 100).unwrap(), [7, 8, 7, 8, 7, 8, 7]);
        for (damaged, words) in [
            (&[5, 1][..], "truncated"),
            (&[0x60], "truncated"),
            (&[0, 1, 0x60, 9], "beyond"),
            (&[0, 1, 0xe0, 255, 0], "more than"),
        ] {
            assert!(lzf(damaged, 20).unwrap_err().contains(words), "{damaged:?}");
        }
    }
}
