//! What the program knows of a format of lens files, and the lists of formats in help and messages.

use super::FORMATS;
use super::error::LensFileError;
use super::options::ReadOptions;
use super::writing::Written;
use super::zar::Member;
use pipeline::design::System;
use pipeline::design::glass_library::GlassLibrary;

/// Reads the bytes of a file, with the glasses that it may name.
pub type Read = fn(&[u8], &GlassLibrary, &ReadOptions) -> Result<System, LensFileError>;

/// Writes a lens; its glasses that are not built in go into a catalogue of that name beside it.
pub type Write = fn(&System, &str) -> Result<Written, LensFileError>;

/// The file of the lens in an archive, and its glass catalogues and coating files.
pub type Unpack = fn(&[u8]) -> Result<(Member, Vec<Member>), LensFileError>;

/// A format of lens files.
pub struct LensFormat {
    /// As help names it, with its usual ending.
    pub name: &'static str,
    /// Endings of its files, in lower case.
    pub endings: &'static [&'static str],
    /// Whether the content of a file with such an ending is of this format; `None`: what no other format of the ending claims is.
    pub is_it: Option<fn(&[u8]) -> bool>,
    /// What its files are.
    pub content: Content,
    /// Writes a file; the endings belong to no other format that is written.
    pub write: Option<Write>,
}

/// What the files of a format are.
pub enum Content {
    /// The text of a lens.
    Text(TextFormat),
    /// An archive with the file of a lens in another format.
    Archive(Unpack),
    /// Not read; the error says what to do.
    Refused(&'static str),
}

/// A format of text.
#[derive(Clone, Copy)]
pub struct TextFormat {
    /// Reads it.
    pub read: Read,
    /// The glass catalogues that a file names, in its order.
    pub catalogues: fn(&[u8]) -> Vec<String>,
    /// The coating file that a file names.
    pub coating_file: fn(&[u8]) -> Option<String>,
}

/// Of a format whose files name no catalogues.
pub(super) const NO_CATALOGUES: fn(&[u8]) -> Vec<String> = |_| Vec::new();

/// Of a format whose files name no coating file.
pub(super) const NO_COATING_FILE: fn(&[u8]) -> Option<String> = |_| None;

impl LensFormat {
    fn is_read(&self) -> bool {
        !matches!(self.content, Content::Refused(_))
    }
}

/// The endings of formats, each once.
pub(super) fn endings(formats: impl Iterator<Item = &'static LensFormat>) -> Vec<&'static str> {
    let mut endings = Vec::new();
    for ending in formats.flat_map(|format| format.endings) {
        if !endings.contains(ending) {
            endings.push(*ending);
        }
    }
    endings
}

/// `.a, .b, .c` of endings.
pub(super) fn with_dots(endings: &[&str]) -> String {
    endings.iter().map(|ending| format!(".{ending}")).collect::<Vec<_>>().join(", ")
}

/// `a, b or c` of `a, b, c`.
fn with_or(list: &str) -> String {
    list.rsplit_once(", ").map_or(list.to_owned(), |(first, last)| format!("{first} or {last}"))
}

fn names(formats: impl Iterator<Item = &'static LensFormat>) -> String {
    formats.map(|format| format.name).collect::<Vec<_>>().join(", ")
}

/// The endings that are read: `.zmx, .seq, …`.
pub fn endings_read() -> String {
    with_dots(&endings(FORMATS.iter().filter(|format| format.is_read())))
}

/// The endings that are written: `.zmx, … or .json`.
pub fn endings_written() -> String {
    with_or(&with_dots(&endings(FORMATS.iter().filter(|format| format.write.is_some()))))
}

/// The formats that are read: `.zmx, CODE V .seq, …`.
pub fn names_read() -> String {
    names(FORMATS.iter().filter(|format| format.is_read()))
}

/// The formats that are written: `.zmx, … or Optiland .json`.
pub fn names_written() -> String {
    with_or(&names(FORMATS.iter().filter(|format| format.write.is_some())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_ending_has_one_format_for_what_no_other_claims_and_one_writer() {
        for ending in endings(FORMATS.iter()) {
            let all: Vec<_> = FORMATS.iter().filter(|format| format.endings.contains(&ending)).collect();
            assert_eq!(all.iter().filter(|format| format.is_it.is_none()).count(), 1, "{ending}");
            assert!(all.iter().filter(|format| format.write.is_some()).count() <= 1, "{ending}");
        }
    }

    #[test]
    fn lists_of_formats_are_words_for_help() {
        assert!(endings_read().starts_with(".zmx, .seq, .len, .csv, .zar, .json"), "{}", endings_read());
        assert!(!endings_read().contains(".zos") && !names_read().contains("binary"));
        assert!(endings_written().starts_with(".zmx, .csv") && endings_written().contains(" or ."));
        assert!(names_read().contains("OSLO .len") && names_written().contains("lens table .csv"));
        assert_eq!((with_or(".a").as_str(), with_or(".a, .b, .c").as_str()), (".a", ".a, .b or .c"));
    }
}
