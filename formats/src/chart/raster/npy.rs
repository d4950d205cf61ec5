//! The header of a NumPy file: `\x93NUMPY`, version (1 to 3), length of a Python dict in text (u16; from version 2 u32), the dict
//! with the keys `descr`, `fortran_order` and `shape`; then the samples (NEP 1). Parsed, never evaluated.
//!
//! Taken: f2, f4, f8, u1 and u2 of either byte order, C order, (bands, rows, columns) or (rows, columns).

use super::{Interleave, RasterLayout, RasterSample};
use crate::chart::Sample;

/// Bytes that are read of a file for its header.
pub(super) const LONGEST: u64 = (1 << 16) + 12;

/// What is wrong: the property, what it must be, what it is.
pub(super) type Fault = (&'static str, String, String);

/// The layout that the first bytes of a file tell.
pub(super) fn layout(head: &[u8]) -> Result<RasterLayout, Fault> {
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
    let sides: Option<Vec<usize>> =
        inner.split(',').map(str::trim).filter(|w| !w.is_empty()).take(4).map(|w| w.parse().ok()).collect();
    let shape = match sides.as_deref() {
        Some(&[rows, columns]) => [1, rows, columns],
        Some(&[bands, rows, columns]) => [bands, rows, columns],
        _ => {
            return Err(fault(
                "shape",
                "(bands, rows, columns) or (rows, columns)",
                format!("({})", short(inner)),
            ));
        }
    };
    let offset = (start + length) as u64;
    Ok(RasterLayout { shape, interleave: Interleave::Bsq, sample, little_endian, offset })
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
