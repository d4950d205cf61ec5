//! ZAR archives of the lens design program: a lens with its catalogues, coatings and settings.
//!
//! The archive is a sequence of members, each a header of 648 bytes and the data; integers are little-endian:
//!
//! ```text
//! 0    u16   0x03EC
//! 8    u32   1 if the data are packed (the name then ends with `.LZW`)
//! 16   u64   length of the data in the archive
//! 24   u64   length of the unpacked data
//! 48   [u16] name, UTF-16, ended by 0
//! ```
//!
//! Packed data are LZW codes, most significant bit first, without clear or end code: 256 single bytes, then one entry a code; a code has 9 bits, and one
//! more from the code on before which the reader's table has 2ⁿ entries. Found by comparing archives with their contents. Archives of before 2010
//! have other headers and are not read.

use super::error::LensFileError;

/// A file in an archive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    /// Its name, without `.LZW`.
    pub name: String,
    /// Its bytes.
    pub data: Vec<u8>,
}

const SIGNATURE: [u8; 2] = [0xEC, 0x03];
const HEADER_BYTES: usize = 648;
const NAME_AT: usize = 48;

/// Maximum length of all unpacked members, bytes; a catalogue has 1 MB.
const MAX_UNPACKED_BYTES: u64 = 64 << 20;

fn incomplete(problem: impl Into<String>) -> LensFileError {
    LensFileError::Incomplete { problem: problem.into() }
}

/// The members whose names end with one of `extensions`, letter case aside; others are not unpacked.
///
/// # Errors
/// [`LensFileError::Incomplete`] for bytes that are not such an archive.
pub fn members(archive: &[u8], extensions: &[&str]) -> Result<Vec<Member>, LensFileError> {
    let mut found = Vec::new();
    let (mut rest, mut total) = (archive, 0_u64);
    while !rest.is_empty() {
        let at = archive.len() - rest.len();
        if rest.len() < HEADER_BYTES || rest[..2] != SIGNATURE {
            let problem = match at {
                0 => "is not a ZAR archive of 2010 or later; save the lens as .zmx".to_owned(),
                _ => format!("is a ZAR archive that is damaged at byte {at}"),
            };
            return Err(incomplete(problem));
        }
        let (header, body) = rest.split_at(HEADER_BYTES);
        let integer = |i: usize| u64::from_le_bytes(header[i..i + 8].try_into().expect("eight bytes"));
        let (is_packed, packed, unpacked) = (integer(8) as u32 == 1, integer(16), integer(24));
        let units = header[NAME_AT..].chunks_exact(2).map(|c| u16::from_le_bytes([c[0], c[1]]));
        let name: Vec<u16> = units.take_while(|u| *u != 0).collect();
        let name = String::from_utf16_lossy(&name);
        let Some(data) = usize::try_from(packed).ok().and_then(|n| body.get(..n)) else {
            let problem =
                format!("is a ZAR archive cut short: member {name} at byte {at} has {packed} bytes");
            return Err(incomplete(problem));
        };
        rest = &body[data.len()..];
        let name = if is_packed { name.strip_suffix(".LZW").unwrap_or(&name).to_owned() } else { name };
        let lower = name.to_lowercase();
        if !extensions.iter().any(|e| lower.ends_with(&e.to_lowercase())) {
            continue;
        }
        total = total.saturating_add(if is_packed { unpacked } else { packed });
        if total > MAX_UNPACKED_BYTES {
            let problem = format!(
                "is a ZAR archive whose files up to {name} have {total} bytes, more than {MAX_UNPACKED_BYTES}"
            );
            return Err(incomplete(problem));
        }
        let data = match is_packed {
            false => data.to_vec(),
            true => unpack(data, unpacked as usize)
                .ok_or_else(|| incomplete(format!("is a ZAR archive with a damaged member {name}")))?,
        };
        found.push(Member { name, data });
    }
    Ok(found)
}

/// Unpacks LZW codes to `length` bytes; none if they are damaged.
fn unpack(packed: &[u8], length: usize) -> Option<Vec<u8>> {
    // Entry i of the table is the range of the output that it was first written to.
    let mut table: Vec<(u32, u32)> = Vec::new();
    let mut out: Vec<u8> = Vec::new();
    let mut bits = Bits { bytes: packed, at: 0 };
    let mut previous: Option<(u32, u32)> = None;
    let mut width = 9;
    while out.len() < length {
        let code = bits.take(width)? as usize;
        let start = out.len() as u32;
        match code {
            0..256 => out.push(code as u8),
            code if code - 256 < table.len() => {
                let (from, to) = table[code - 256];
                extend(&mut out, from as usize, to as usize, length)?;
            }
            // The entry that this code makes: the previous string and its first byte.
            code if code - 256 == table.len() => {
                let (from, to) = previous?;
                extend(&mut out, from as usize, to as usize, length)?;
                let first = out[from as usize];
                out.push(first);
            }
            _ => return None,
        }
        let written = (start, out.len() as u32);
        if let Some((from, to)) = previous {
            // The previous string and the first byte of this one, which follows it in the output.
            debug_assert_eq!(to, start);
            table.push((from, to + 1));
        }
        previous = Some(written);
        if table.len() + 256 >= 1 << width {
            width += 1;
        }
    }
    out.truncate(length);
    Some(out)
}

/// Appends a part of the output to itself, unless that gives far more than expected.
fn extend(out: &mut Vec<u8>, from: usize, to: usize, length: usize) -> Option<()> {
    let is_bounded = out.len() + (to - from) <= length;
    is_bounded.then(|| out.extend_from_within(from..to))
}

/// Bits of a slice, most significant first.
struct Bits<'a> {
    bytes: &'a [u8],
    /// Position, bits.
    at: usize,
}

impl Bits<'_> {
    fn take(&mut self, count: u32) -> Option<u32> {
        let end = self.at + count as usize;
        if end > 8 * self.bytes.len() {
            return None;
        }
        let mut value = 0u64;
        let (first, last) = (self.at / 8, end.div_ceil(8));
        for byte in &self.bytes[first..last] {
            value = value << 8 | u64::from(*byte);
        }
        value >>= 8 * last - end;
        self.at = end;
        Some((value & ((1 << count) - 1)) as u32)
    }
}

/// The lens of an archive, and its glass catalogues and coating files.
///
/// # Errors
/// [`LensFileError::Incomplete`] if there is not one lens.
pub fn lens(archive: &[u8]) -> Result<(Member, Vec<Member>), LensFileError> {
    let all = members(archive, &[".zmx", ".agf", ".zos"])?;
    let (mut beside, lenses): (Vec<_>, Vec<_>) =
        all.into_iter().partition(|m| m.name.to_lowercase().ends_with(".agf"));
    // A coating file that is damaged matters only where its coatings are asked for: it is then missing.
    beside.extend(members(archive, &[".dat"]).unwrap_or_default());
    let (zmx, others): (Vec<_>, Vec<_>) =
        lenses.into_iter().partition(|m| m.name.to_lowercase().ends_with(".zmx"));
    match <[Member; 1]>::try_from(zmx) {
        Ok([lens]) => Ok((lens, beside)),
        Err(several) if several.is_empty() && !others.is_empty() => {
            Err(incomplete(format!("is a ZAR archive of {}; save the lens as .zmx", others[0].name)))
        }
        Err(several) => {
            Err(incomplete(format!("is a ZAR archive with {} .zmx files, expected one", several.len())))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Packs as the design program does: the longest known string each time.
    fn pack(data: &[u8]) -> Vec<u8> {
        use std::collections::HashMap;
        let mut table: HashMap<Vec<u8>, usize> = (0..=255u8).map(|b| (vec![b], usize::from(b))).collect();
        let (mut bits, mut string) = (Vec::new(), Vec::new());
        let mut emitted = 0;
        let mut emit = |code: usize| {
            // The reader's table lags one entry behind.
            let entries = 256 + emitted.max(1) - 1;
            let width = (9..).find(|w| entries < 1 << w).unwrap();
            emitted += 1;
            bits.extend((0..width).rev().map(|i| code >> i & 1 == 1));
        };
        for byte in data {
            let mut longer = string.clone();
            longer.push(*byte);
            if table.contains_key(&longer) {
                string = longer;
                continue;
            }
            emit(table[&string]);
            let next = table.len();
            table.insert(longer, next);
            string = vec![*byte];
        }
        emit(table[&string]);
        bits.chunks(8)
            .map(|c| c.iter().enumerate().fold(0, |v, (i, b)| v | u8::from(*b) << (7 - i)))
            .collect()
    }

    fn member(name: &str, data: &[u8], is_packed: bool) -> Vec<u8> {
        let body = if is_packed { pack(data) } else { data.to_vec() };
        let mut header = vec![0; HEADER_BYTES];
        header[..2].copy_from_slice(&SIGNATURE);
        header[8] = u8::from(is_packed);
        header[16..24].copy_from_slice(&(body.len() as u64).to_le_bytes());
        header[24..32].copy_from_slice(&(data.len() as u64).to_le_bytes());
        let name = if is_packed { format!("{name}.LZW") } else { name.to_owned() };
        for (i, unit) in name.encode_utf16().enumerate() {
            header[NAME_AT + 2 * i..][..2].copy_from_slice(&unit.to_le_bytes());
        }
        [header, body].concat()
    }

    #[test]
    fn packed_and_stored_members_are_unpacked() {
        let long: Vec<u8> = (0..40_000u32).map(|i| (i * i / 7 % 97) as u8).chain([b'x'; 3000]).collect();
        let archive = [
            member("a.zmx", b"MODE SEQ\nSURF 0\n", false),
            member("a.ZDA", b"skipped", true),
            member("SCHOTT.AGF", &long, true),
        ]
        .concat();
        let (zmx, glasses) = lens(&archive).unwrap();
        assert_eq!((zmx.name.as_str(), zmx.data.as_slice()), ("a.zmx", b"MODE SEQ\nSURF 0\n".as_slice()));
        assert_eq!((glasses.len(), glasses[0].name.as_str()), (1, "SCHOTT.AGF"));
        assert!(glasses[0].data == long);
    }

    #[test]
    fn damaged_archives_are_errors() {
        let whole = member("a.zmx", b"MODE SEQ\nMODE SEQ\nMODE SEQ\n", true);
        assert!(lens(&whole).is_ok());
        for (bytes, word) in [
            (whole[..whole.len() - 1].to_vec(), "cut short"),
            (b"PK\x03\x04".to_vec(), "not a ZAR"),
            ([whole.clone(), b"tail".to_vec()].concat(), "damaged at byte"),
            ([whole.clone(), whole.clone()].concat(), "2 .zmx files"),
            (member("a.zos", b"", false), "save the lens as .zmx"),
        ] {
            let error = lens(&bytes).unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
        let mut huge = whole;
        huge[24..32].copy_from_slice(&u64::MAX.to_le_bytes());
        assert!(lens(&huge).unwrap_err().to_string().contains("more than"));
    }
}
