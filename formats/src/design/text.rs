//! Text of design files: encodings, line ends, numbers.
//!
//! UTF-16 with or without BOM, UTF-8 with or without BOM, else Latin-1. Lines end with LF, CR LF or CR. Numbers have a decimal point; exponents
//! are written with E or, by Fortran programs, D; a minus may be U+2212 or an en dash.

/// Decodes any bytes: invalid UTF-16, and invalid UTF-8 with BOM, is replaced by U+FFFD. Lines end with LF or CR LF.
pub fn decode(bytes: &[u8]) -> String {
    let text = match (bytes, utf16_without_mark(bytes)) {
        ([0xFF, 0xFE, rest @ ..], _) => utf16(rest, u16::from_le_bytes),
        ([0xFE, 0xFF, rest @ ..], _) => utf16(rest, u16::from_be_bytes),
        (_, Some(unit)) => utf16(bytes, unit),
        ([0xEF, 0xBB, 0xBF, rest @ ..], _) => String::from_utf8_lossy(rest).into_owned(),
        _ => match std::str::from_utf8(bytes) {
            Ok(text) => text.to_owned(),
            Err(_) => bytes.iter().map(|b| char::from(*b)).collect(),
        },
    };
    // Some writers end a file of CR lines with LF.
    let has_lf = text.trim_end_matches(['\r', '\n']).contains('\n');
    if text.contains('\r') && !has_lf { text.replace("\r\n", "\n").replace('\r', "\n") } else { text }
}

/// Characters of a line that errors quote.
const MAX_QUOTE_CHARS: usize = 80;

/// The part of a line that errors quote.
pub fn quote(line: &str) -> String {
    line.trim().chars().take(MAX_QUOTE_CHARS).collect()
}

/// Whether bytes are no text in any of these encodings: a NUL in other than UTF-16.
pub fn is_binary(bytes: &[u8]) -> bool {
    let is_marked = bytes.starts_with(&[0xFF, 0xFE]) || bytes.starts_with(&[0xFE, 0xFF]);
    !is_marked && utf16_without_mark(bytes).is_none() && bytes.contains(&0)
}

type Unit = fn([u8; 2]) -> u16;

/// The byte order of UTF-16 without BOM: its first four characters are ASCII, so every other byte is 0.
fn utf16_without_mark(bytes: &[u8]) -> Option<Unit> {
    let first = bytes.get(..8)?;
    let zeros = |offset: usize| first.iter().skip(offset).step_by(2).filter(|b| **b == 0).count();
    match (zeros(0), zeros(1)) {
        (0, 4) => Some(u16::from_le_bytes),
        (4, 0) => Some(u16::from_be_bytes),
        _ => None,
    }
}

fn utf16(bytes: &[u8], unit: Unit) -> String {
    let units: Vec<u16> = bytes.chunks_exact(2).map(|c| unit([c[0], c[1]])).collect();
    String::from_utf16_lossy(&units)
}

/// A finite number; none if `word` is not one.
pub(super) fn number(word: &str) -> Option<f64> {
    let finite = |text: &str| text.parse().ok().filter(|v: &f64| v.is_finite());
    finite(word).or_else(|| {
        let plain = word.replace(['−', '–'], "-").replace(['D', 'd'], "E");
        finite(&plain.strip_prefix('-').map_or(plain.clone(), |digits| format!("-{}", digits.trim_start())))
    })
}

/// Whether `word` is a spelling of infinity, without regard to its sign.
pub(super) fn is_infinite(word: &str) -> bool {
    let plain = word.trim_start_matches(['+', '-', '−', '–']).to_ascii_uppercase();
    matches!(plain.as_str(), "INF" | "INFINITY" | "INFINITE" | "∞" | "1.#INF" | "1.#INF00")
}

/// The problem of a word that is not a number.
pub(super) fn not_a_number(word: &str) -> String {
    let has_comma = word.contains(',') && number(&word.replace(',', "")).is_some();
    let problem = if has_comma { ": write it with a decimal point and without commas" } else { "" };
    format!("`{word}` is not a number{problem}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_encoding_gives_the_same_text() {
        let text = "MODE SEQ\nNAME Gauß 1\n";
        let le = || text.encode_utf16().flat_map(u16::to_le_bytes);
        let be = || text.encode_utf16().flat_map(u16::to_be_bytes);
        let latin1: Vec<u8> = text.chars().map(|c| c as u8).collect();
        for bytes in [
            text.as_bytes().to_vec(),
            [0xEF, 0xBB, 0xBF].into_iter().chain(text.bytes()).collect(),
            [0xFF, 0xFE].into_iter().chain(le()).collect(),
            [0xFE, 0xFF].into_iter().chain(be()).collect(),
            le().collect(),
            be().collect(),
            latin1,
            text.replace('\n', "\r").into_bytes(),
            "MODE SEQ\rNAME Gauß 1\r\n".as_bytes().to_vec(),
        ] {
            assert_eq!(decode(&bytes), text);
            assert!(!is_binary(&bytes));
        }
        assert!(is_binary(&[0; 16]) && is_binary(b"PK\x03\x04\x14\0\0\0\0\0") && !is_binary(b""));
    }

    #[test]
    fn numbers_of_programs_and_patents_are_read() {
        for (word, value) in
            [("1.5D-02", 0.015), ("-1d3", -1e3), ("−2.5", -2.5), ("–2.5", -2.5), ("- 2.5", -2.5), ("+3", 3.0)]
        {
            assert_eq!(number(word), Some(value), "{word}");
        }
        for word in ["", "x", "nan", "1e999", "inf", "1,5", "--2", "-D"] {
            assert_eq!(number(word), None, "{word}");
        }
        assert!(is_infinite("-Infinity") && is_infinite("1.#INF") && !is_infinite("1e10"));
        assert!(not_a_number("3,5E1").contains("decimal point") && !not_a_number("3;5").contains("point"));
    }
}
