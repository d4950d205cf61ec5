//! Text files of design programs: Latin-1, UTF-8 or UTF-16, decimal point or comma, names in any case.

use super::{ImportError, MAX_FILE, MAX_TEXT};
use pipeline::design::text::decode;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Bytes that tell what a file is.
const START: u64 = 1 << 14;

/// The bytes of a file that is not absurdly large.
pub(super) fn bytes(path: &Path) -> Result<Vec<u8>, ImportError> {
    at_most(path, MAX_FILE)
}

fn at_most(path: &Path, most: u64) -> Result<Vec<u8>, ImportError> {
    let io = |source| ImportError::Io { path: path.into(), action: "read", source };
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(io)?;
    file.take(most + 1).read_to_end(&mut bytes).map_err(io)?;
    match bytes.len() as u64 > most {
        true => Err(ImportError::file(path, format!("is larger than {most} bytes, so it is no export"))),
        false => Ok(bytes),
    }
}

/// The characters of a text file.
pub(super) fn read(path: &Path) -> Result<String, ImportError> {
    Ok(decode(&at_most(path, MAX_TEXT)?))
}

/// The first characters of a file, to see what it is.
pub(super) fn start(path: &Path) -> Result<String, ImportError> {
    let io = |source| ImportError::Io { path: path.into(), action: "read", source };
    let mut bytes = Vec::new();
    File::open(path).map_err(io)?.take(START).read_to_end(&mut bytes).map_err(io)?;
    Ok(decode(&bytes))
}

/// Names of the files in a folder, sorted.
pub(super) fn names(folder: &Path) -> Result<Vec<String>, ImportError> {
    let io = |source| ImportError::Io { path: folder.into(), action: "list", source };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let entry = entry.map_err(io)?;
        if !entry.path().is_dir() {
            names.push(entry.file_name().to_string_lossy().into_owned());
        }
    }
    names.sort();
    Ok(names)
}

/// The file of that name in whatever case.
pub(super) fn find(folder: &Path, names: &[String], wanted: &str) -> Option<PathBuf> {
    let exact = names.iter().find(|n| *n == wanted);
    exact.or_else(|| names.iter().find(|n| n.eq_ignore_ascii_case(wanted))).map(|n| folder.join(n))
}

/// A number with a decimal point or a decimal comma, finite; a `%` behind it is dropped.
///
/// Both signs in one word (thousands and decimals) are no number.
pub(super) fn number(word: &str) -> Option<f64> {
    let word = word.strip_suffix('%').unwrap_or(word);
    let first = word.bytes().next()?;
    if !(first.is_ascii_digit() || matches!(first, b'+' | b'-' | b'.' | b',')) {
        return None; // `nan`, `inf`
    }
    let value: f64 = match word.split_once(',') {
        None => word.parse().ok()?,
        Some((_, rest)) if !rest.starts_with(|c: char| c.is_ascii_digit()) || rest.contains([',', '.']) => {
            return None;
        }
        Some((whole, _)) if whole.contains('.') => return None,
        Some((whole, rest)) => format!("{whole}.{rest}").parse().ok()?,
    };
    value.is_finite().then_some(value)
}

/// Numbers of a header line, in order; a comma or full stop that ends a word belongs to the sentence.
pub(super) fn numbers(line: &str) -> Vec<f64> {
    line.split_whitespace()
        .filter_map(|w| number(w.trim_end_matches([',', '.', ';', ')']).trim_start_matches('(')))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_either_kind() {
        for (word, value) in [
            ("1.5", 1.5),
            ("1,5", 1.5),
            ("-9.59263593E-001", -0.959263593),
            ("3,52988E+00", 3.52988),
            ("-4.5%", -4.5),
        ] {
            assert_eq!(number(word), Some(value), "{word}");
        }
        for word in ["", "nan", "inf", "-inf", "1.234,5", "1,234.5", "1,2,3", "x", "1e999", "-nan"] {
            assert_eq!(number(word), None, "{word}");
        }
        assert_eq!(numbers("0,5430 to 0,5430 µm at 10,00, 20,00 (deg)."), [0.543, 0.543, 10.0, 20.0]);
    }
}
