//! Text files of design programs: Latin-1, UTF-8 or UTF-16, decimal point or comma, names in any case.

use super::{ImportError, MAX_ARRAY_BYTES, MAX_TEXT_BYTES};
use crate::design::text::decode;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Bytes by which the type of a file is recognised.
const START_BYTES: u64 = 1 << 14;

/// The bytes of an array file.
pub(super) fn read_bytes(path: &Path) -> Result<Vec<u8>, ImportError> {
    read_bounded(path, MAX_ARRAY_BYTES)
}

fn read_bounded(path: &Path, max_bytes: u64) -> Result<Vec<u8>, ImportError> {
    let mut bytes = Vec::new();
    let read = |file: File| file.take(max_bytes + 1).read_to_end(&mut bytes);
    File::open(path).and_then(read).map_err(ImportError::io(path, "read"))?;
    match bytes.len() as u64 > max_bytes {
        true => Err(ImportError::file(path, format!("is larger than {max_bytes} bytes, the maximum"))),
        false => Ok(bytes),
    }
}

/// The decoded text of a file.
pub(super) fn read(path: &Path) -> Result<String, ImportError> {
    Ok(decode(&read_bounded(path, MAX_TEXT_BYTES)?))
}

/// The decoded start of a file, by which its type is recognised.
pub(super) fn read_start(path: &Path) -> Result<String, ImportError> {
    let mut bytes = Vec::new();
    let read = |file: File| file.take(START_BYTES).read_to_end(&mut bytes);
    File::open(path).and_then(read).map_err(ImportError::io(path, "read"))?;
    Ok(decode(&bytes))
}

/// Names of the files in a folder, sorted.
pub(super) fn file_names(folder: &Path) -> Result<Vec<String>, ImportError> {
    let io = ImportError::io(folder, "list");
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(&io)? {
        let entry = entry.map_err(&io)?;
        if !entry.path().is_dir() {
            names.push(entry.file_name().to_string_lossy().into_owned());
        }
    }
    names.sort();
    Ok(names)
}

/// The file of that name, an exact match before one in other case.
pub(super) fn find(folder: &Path, names: &[String], name: &str) -> Option<PathBuf> {
    let exact = names.iter().find(|n| *n == name);
    exact.or_else(|| names.iter().find(|n| n.eq_ignore_ascii_case(name))).map(|n| folder.join(n))
}

/// Lines with their numbers, from 1.
pub(super) fn numbered_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().map(|(i, line)| (i + 1, line))
}

/// A finite number with a decimal point or a decimal comma; a `%` at its end is dropped.
///
/// `None` for a comma and a point together (thousands and decimals).
pub(super) fn number(text: &str) -> Option<f64> {
    let text = text.strip_suffix('%').unwrap_or(text);
    let first = text.bytes().next()?;
    if !(first.is_ascii_digit() || matches!(first, b'+' | b'-' | b'.' | b',')) {
        return None; // `nan`, `inf`
    }
    let value: f64 = match text.split_once(',') {
        None => text.parse().ok()?,
        Some((_, rest)) if !rest.starts_with(|c: char| c.is_ascii_digit()) || rest.contains([',', '.']) => {
            return None;
        }
        Some((integer, _)) if integer.contains('.') => return None,
        Some((integer, rest)) => format!("{integer}.{rest}").parse().ok()?,
    };
    value.is_finite().then_some(value)
}

/// Numbers of a header line, in order; a comma or full stop at the end of a word is punctuation.
pub(super) fn numbers(line: &str) -> Vec<f64> {
    line.split_whitespace()
        .filter_map(|w| number(w.trim_end_matches([',', '.', ';', ')']).trim_start_matches('(')))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimal_points_and_commas_are_read_and_thousands_separators_are_not() {
        for (text, value) in [
            ("1.5", 1.5),
            ("1,5", 1.5),
            ("-9.59263593E-001", -0.959263593),
            ("3,52988E+00", 3.52988),
            ("-4.5%", -4.5),
        ] {
            assert_eq!(number(text), Some(value), "{text}");
        }
        for text in ["", "nan", "inf", "-inf", "1.234,5", "1,234.5", "1,2,3", "x", "1e999", "-nan"] {
            assert_eq!(number(text), None, "{text}");
        }
        assert_eq!(numbers("0,5430 to 0,5430 µm at 10,00, 20,00 (deg)."), [0.543, 0.543, 10.0, 20.0]);
    }
}
