//! Text of OBJ, MTL and ascii PLY: encodings, lines, words, numbers.
//!
//! UTF-8 or UTF-16 with a byte order mark, else bytes whose names are UTF-8 or, where that is invalid, Latin-1. Lines end with LF or CR LF;
//! in a file without LF, with CR. A number has a decimal point, an optional exponent, and is finite.

use std::path::Path;

use super::context::Context;
use super::error::MeshError;
use super::shown::shown;
use super::source::read_file;
use pipeline::scratch::List;

/// The text of the file `opened`, listed as `named`. The memory of its capacity counts as in use.
///
/// # Errors
/// Those of [`read_file`].
pub(super) fn read(context: &Context<'_>, named: &Path, opened: &Path) -> Result<List<u8>, MeshError> {
    let bytes = read_file(context, named, opened)?;
    if !is_utf16(&bytes) {
        return Ok(decode(bytes));
    }
    let before = bytes.memory_bytes() as u64;
    context.charge(bytes.len() as u64 / 2 * 3, || format!("text of {}", named.display()))?;
    let text = decode(bytes);
    context.release(before);
    Ok(text)
}

/// The bytes of a text in UTF-8 or an encoding that agrees with it in ASCII, without byte order mark. Invalid UTF-16 becomes U+FFFD.
fn decode(mut bytes: List<u8>) -> List<u8> {
    let utf16 = |unit: fn([u8; 2]) -> u16| {
        let units = bytes[2..].as_chunks().0.iter().map(|&pair| unit(pair));
        let mut text = String::with_capacity(bytes.len() / 2 * 3);
        text.extend(char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)));
        text.into_bytes().into()
    };
    match &bytes[..] {
        [0xFF, 0xFE, ..] => utf16(u16::from_le_bytes),
        [0xFE, 0xFF, ..] => utf16(u16::from_be_bytes),
        [0xEF, 0xBB, 0xBF, ..] => {
            bytes.copy_within(3.., 0);
            bytes.resize(bytes.len() - 3, 0);
            bytes
        }
        _ => bytes,
    }
}

/// Whether [`decode`] makes a copy, of at most 3/2 of the size.
fn is_utf16(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0xFF, 0xFE]) || bytes.starts_with(&[0xFE, 0xFF])
}

/// A name: UTF-8, else Latin-1.
pub(super) fn name(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.into(),
        Err(_) => bytes.iter().map(|&b| char::from(b)).collect(),
    }
}

/// A word or line of a file in messages.
pub(super) fn quote(bytes: &[u8]) -> String {
    shown(&name(bytes.trim_ascii()))
}

/// A finite number.
pub(super) fn number(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok().filter(|v: &f64| v.is_finite())
}

/// What a number must be, for errors: names the likely defect of `word`.
pub(super) fn expected_number(word: &[u8]) -> &'static str {
    let has = |c| word.contains(&c);
    match word.iter().find(|b| !matches!(b, b'+' | b'-')) {
        Some(b'0'..=b'9' | b'.') if has(b',') => {
            "a number with a decimal point, not a comma; export the file again in an English locale"
        }
        Some(b'0'..=b'9' | b'.') if has(b'#') => {
            "a finite number (the program that wrote it computed no valid number)"
        }
        _ => "a finite number",
    }
}

/// Words of a line, separated by spaces and tabs.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

/// Lines with their numbers, from 1. A line whose end is a backslash continues on the next one, unless it is a comment.
pub(super) struct Lines<'a> {
    rest: &'a [u8],
    end: u8,
    next: u64,
    joined: Vec<u8>,
}

impl<'a> Lines<'a> {
    pub fn new(text: &'a [u8]) -> Self {
        let end = if text.contains(&b'\n') { b'\n' } else { b'\r' };
        Self { rest: text, end, next: 1, joined: Vec::new() }
    }

    /// The number of the next line's start and the line, without white space around it.
    pub fn next(&mut self) -> Option<(u64, &[u8])> {
        let number = self.next;
        let line = self.physical()?.trim_ascii();
        if !line.ends_with(b"\\") || line.starts_with(b"#") {
            return Some((number, line));
        }
        self.joined.clear();
        let mut part = Some(line);
        while let Some(line) = part {
            let Some(continued) = line.strip_suffix(b"\\") else {
                self.joined.extend_from_slice(line);
                break;
            };
            self.joined.extend_from_slice(continued);
            self.joined.push(b' ');
            part = self.physical().map(<[u8]>::trim_ascii);
        }
        Some((number, self.joined.trim_ascii()))
    }

    fn physical(&mut self) -> Option<&'a [u8]> {
        if self.rest.is_empty() {
            return None;
        }
        self.next += 1;
        let end = self.rest.iter().position(|&b| b == self.end);
        let line = &self.rest[..end.unwrap_or(self.rest.len())];
        self.rest = end.map_or(&[], |end| &self.rest[end + 1..]);
        Some(line)
    }
}

/// A line as its first word and the text after it.
pub(super) fn keyword(line: &[u8]) -> (&[u8], &[u8]) {
    let end = line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len());
    (&line[..end], line[end..].trim_ascii())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &[u8]) -> Vec<(u64, String)> {
        let mut lines = Lines::new(text);
        let mut all = Vec::new();
        while let Some((number, line)) = lines.next() {
            all.push((number, name(line)));
        }
        all
    }

    #[test]
    fn lines_end_with_lf_crlf_or_cr() {
        let expected = [(1, "a".to_string()), (2, String::new()), (3, "b".to_string())];
        for text in ["a\n\nb\n", "a\r\n\r\nb", "a\r\rb\r"] {
            assert_eq!(lines(text.as_bytes()), expected, "{text:?}");
        }
    }

    #[test]
    fn backslash_continues_a_line_but_not_a_comment() {
        let found = lines(b"f 1 2 \\\n 3\\\r\n4\n# C:\\\nv 1\\");
        let expected = [(1, "f 1 2  3 4"), (4, "# C:\\"), (5, "v 1")];
        assert_eq!(found, expected.map(|(n, t)| (n, t.to_string())));
    }

    #[test]
    fn encodings_are_recognised_by_their_mark() {
        let text = "v 1 é€𝄞";
        let utf16 = |to: fn(u16) -> [u8; 2]| {
            std::iter::once(0xFEFF).chain(text.encode_utf16()).flat_map(to).collect::<Vec<_>>()
        };
        let decode = |bytes: Vec<u8>| decode(bytes.into()).to_vec();
        assert_eq!(decode(utf16(u16::to_le_bytes)), text.as_bytes());
        assert_eq!(decode(utf16(u16::to_be_bytes)), text.as_bytes());
        assert_eq!(decode([b"\xEF\xBB\xBF", text.as_bytes()].concat()), text.as_bytes());
        assert_eq!(name(b"caf\xe9"), "café");
        assert_eq!(name("café".as_bytes()), "café");
        assert_eq!(decode(vec![0xFF, 0xFE, 0x31]), b"");
    }

    #[test]
    fn numbers_are_finite_and_have_a_point() {
        for (word, value) in [("1", 1.0), ("+1.", 1.0), ("-.5", -0.5), ("2.e1", 20.0), ("1E-2", 0.01)] {
            assert_eq!(number(word.as_bytes()), Some(value), "{word}");
        }
        for word in ["1,5", "1.#QNAN", "nan", "inf", "-Infinity", "1e999", "3.1+e2", "", "0x10", "1_0"] {
            assert_eq!(number(word.as_bytes()), None, "{word}");
        }
        assert!(expected_number(b"-1,5").contains("comma"));
        assert!(expected_number(b"-1.#IND").contains("no valid number"));
        assert_eq!(expected_number(b"abc,#"), "a finite number");
    }
}
