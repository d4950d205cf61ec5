//! Looks at a compressed chunk before any decoder does: the size that its header claims must be the size the array needs.
//!
//! Decoders allocate what the header says, so one flipped bit could ask for the whole memory. Formats: Zstandard, RFC 8878
//! section 3.1.1 (frame header and block headers); Blosc 1 chunk, README_CHUNK_FORMAT (nbytes at offset 4, u32 LE); gzip,
//! RFC 1952 section 2.3.1 (ISIZE, the last four bytes). The decoder still does its own checks afterwards.

const ZSTD_MAGIC: u32 = 0xFD2F_B528;
/// Largest block of a Zstandard frame.
const ZSTD_BLOCK: u64 = 128 * 1024;

/// Checks that `encoded` (codec `codec`) claims to decode to `expected` bytes.
pub(super) fn check(codec: &str, encoded: &[u8], expected: u64) -> Result<(), String> {
    let claim = match codec {
        "zstd" => zstd(encoded, expected)?,
        "blosc" => u64::from(le_u32(encoded, 4).ok_or("it is cut short")?),
        "gzip" => {
            let last = encoded.len().checked_sub(4).ok_or("it is cut short")?;
            u64::from(le_u32(encoded, last).ok_or("it is cut short")?)
        }
        _ => return Ok(()),
    };
    if claim == expected {
        Ok(())
    } else {
        Err(format!("its {codec} header claims {claim} bytes, expected {expected}"))
    }
}

fn le_u32(bytes: &[u8], at: usize) -> Option<u32> {
    let four = bytes.get(at..at.checked_add(4)?)?;
    Some(u32::from_le_bytes([four[0], four[1], four[2], four[3]]))
}

/// Content size of the single Zstandard frame; where the frame names none, `expected` if its blocks could make it.
fn zstd(bytes: &[u8], expected: u64) -> Result<u64, String> {
    let cut = || "its zstd frame is cut short".to_string();
    if le_u32(bytes, 0).ok_or_else(cut)? != ZSTD_MAGIC {
        return Err("it is not a zstd frame".into());
    }
    let descriptor = *bytes.get(4).ok_or_else(cut)?;
    let single_segment = descriptor >> 5 & 1;
    let mut at = 5 + usize::from(1 - single_segment) + [0, 1, 2, 4][usize::from(descriptor & 3)];
    let width = match descriptor >> 6 {
        0 => usize::from(single_segment),
        flag => 1 << flag,
    };
    let field = bytes.get(at..at + width).ok_or_else(cut)?;
    let size = field.iter().rev().fold(0u64, |size, &byte| size << 8 | u64::from(byte));
    at += width;
    let mut blocks = 0;
    loop {
        let header = bytes.get(at..at + 3).ok_or_else(cut)?;
        let header = u32::from_le_bytes([header[0], header[1], header[2], 0]);
        let (last, kind, length) = (header & 1, header >> 1 & 3, (header >> 3) as usize);
        at += 3 + if kind == 1 { 1 } else { length };
        blocks += 1;
        if at > bytes.len() {
            return Err(cut());
        }
        if last == 1 {
            break;
        }
    }
    at += if descriptor >> 2 & 1 == 1 { 4 } else { 0 };
    if at != bytes.len() {
        return Err("it is not one whole zstd frame".into());
    }
    match width {
        0 if blocks * ZSTD_BLOCK > 2 * expected + (1 << 20) => {
            Err(format!("its zstd frame has {blocks} blocks, too many for {expected} bytes"))
        }
        0 => Ok(expected),
        2 => Ok(size + 256),
        _ => Ok(size),
    }
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn a_frame_with_its_size_is_believed_only_if_it_fits() {
        // magic, single segment with a one-byte size of 3, one raw last block of 3 bytes
        let frame = [0x28, 0xB5, 0x2F, 0xFD, 0x20, 3, 0x19, 0, 0, 1, 2, 3];
        assert_eq!(check("zstd", &frame, 3), Ok(()));
        assert!(check("zstd", &frame, 4).unwrap_err().contains("claims 3 bytes, expected 4"));
        for n in 0..frame.len() {
            assert!(check("zstd", &frame[..n], 3).is_err(), "cut to {n}");
        }
    }
}
