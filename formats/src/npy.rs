//! NumPy's file: `\x93NUMPY`, version (1 to 3), length of a Python dict in text (u16; from version 2 u32), the dict with the keys
//! `descr`, `fortran_order` and `shape`; then the samples (NEP 1). Parsed, never evaluated, and bounded before a sample is looked at.
//!
//! Taken: f2, f4, f8, u1 and u2 of either byte order, C order, at most 5 axes. Whoever reads says which of them it can use.

use crate::chart::{RasterSample, Sample};

/// Bytes that are read of a file for its header.
pub(crate) const LONGEST: u64 = (1 << 16) + 12;
const MAX_AXES: usize = 5;

/// What is wrong: the property, what it must be, what it is.
pub(crate) type Fault = (&'static str, String, String);

/// What the header tells.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Header {
    pub(crate) sample: RasterSample,
    pub(crate) little_endian: bool,
    /// Sizes of the axes, slowest first.
    pub(crate) shape: Vec<usize>,
    /// Bytes before the first sample.
    pub(crate) offset: usize,
}

/// The header that the first bytes of a file hold.
pub(crate) fn header(head: &[u8]) -> Result<Header, Fault> {
    let fault = |what, expected: &str, found: String| (what, expected.to_owned(), found);
    let cut = || fault("NPY header", "a whole header", format!("{} bytes", head.len()));
    if !head.starts_with(b"\x93NUMPY") {
        return Err(fault("first bytes", "\\x93NUMPY", "something else".into()));
    }
    let (&version, rest) = head.get(6).zip(head.get(8..)).ok_or_else(cut)?;
    let (length, start) = match version {
        1 => (usize::from(u16::from_le_bytes(rest.first_chunk().copied().ok_or_else(cut)?)), 10),
        2 | 3 => (u32::from_le_bytes(rest.first_chunk().copied().ok_or_else(cut)?) as usize, 12),
        other => return Err(fault("NPY version", "1 to 3", other.to_string())),
    };
    if (length + start) as u64 > LONGEST {
        return Err(fault("NPY header", "at most 65536 bytes", format!("{length}")));
    }
    let text = head.get(start..).and_then(|h| h.get(..length)).ok_or_else(cut)?;
    let text = std::str::from_utf8(text).map_err(|_| fault("NPY header", "text", "other bytes".into()))?;
    let after = |key: &'static str| {
        let at = text.find(&format!("'{key}'")).map(|i| text[i + key.len() + 2..].trim_start());
        let value = at.and_then(|t| t.strip_prefix(':')).map(str::trim_start);
        value.ok_or_else(|| fault("NPY header", "descr, fortran_order and shape", format!("no {key}")))
    };
    let descr = after("descr")?;
    let descr = descr.strip_prefix('\'').and_then(|d| d.split_once('\'')).map_or("", |d| d.0);
    let short = |t: &str| t.chars().take(40).collect::<String>();
    let (sample, little_endian) = sample(descr).ok_or_else(|| {
        fault("samples", "f2, f4, f8, u1 or u2 (numpy: astype)", format!("`{}`", short(descr)))
    })?;
    if !after("fortran_order")?.starts_with("False") {
        return Err(fault("order", "C order (numpy.ascontiguousarray)", "Fortran order".into()));
    }
    let shape = after("shape")?;
    let inner = shape.strip_prefix('(').and_then(|s| s.split_once(')')).map_or("?", |s| s.0);
    let words = inner.split(',').map(str::trim).filter(|w| !w.is_empty()).take(MAX_AXES + 1);
    match words.map(|w| w.parse().ok()).collect::<Option<Vec<usize>>>() {
        Some(shape) if shape.len() <= MAX_AXES => {
            Ok(Header { sample, little_endian, shape, offset: start + length })
        }
        _ => Err(fault("shape", "a list of up to 5 sizes", format!("({})", short(inner)))),
    }
}

/// The header of f32 samples, lowest byte first, C order; the samples begin at a multiple of 64 bytes, as NumPy has it.
pub(crate) fn header_of_f32(shape: &[usize]) -> Vec<u8> {
    let sides: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let mut text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}), }}", sides.trim_end());
    text.push_str(&" ".repeat(63 - (10 + text.len()) % 64));
    text.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes
}

/// `<f4`, `>u2`, `|u1`, `f4`: the type, and whether its lowest byte comes first (unsaid: it does).
pub fn sample(word: &str) -> Option<(RasterSample, bool)> {
    let (little, name) = match word.as_bytes().first()? {
        b'<' | b'|' => (true, &word[1..]),
        b'>' => (false, &word[1..]),
        b'=' => (cfg!(target_endian = "little"), &word[1..]),
        _ => (true, word),
    };
    let plain = match name {
        "u1" => Sample::U8,
        "u2" => Sample::U16,
        "f2" => Sample::F16,
        "f4" => Sample::F32,
        "f8" => Sample::F64,
        _ => return None,
    };
    Some((RasterSample::Plain(plain), little))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_written_are_read() {
        for shape in [&[3usize, 7, 5][..], &[14141, 14141], &[1], &[31, 14141, 14141]] {
            let bytes = header_of_f32(shape);
            assert_eq!(bytes.len() % 64, 0);
            let read = header(&bytes).unwrap();
            assert_eq!((read.shape.as_slice(), read.offset, read.little_endian), (shape, bytes.len(), true));
        }
    }
}
