//! A lens file: its format, chosen by ending and content.

use super::error::LensFileError;
use super::format::{Content, LensFormat, TextFormat, Write, endings, with_dots};
use super::options::ReadOptions;
use super::zar::Member;
use super::{FORMATS, text};
use pipeline::design::System;
use pipeline::design::glass_library::GlassLibrary;
use std::path::Path;

/// Maximum size of the text of a design; a lens of a thousand surfaces has less than 1 MB.
const MAX_TEXT_BYTES: usize = 8 << 20;

/// The text of a lens, with its format and the glass catalogues and coating files of its archive.
pub struct LensFile {
    format: TextFormat,
    bytes: Vec<u8>,
    /// Catalogues that lie in the same archive.
    pub catalogues: Vec<Member>,
    /// Coating files there.
    pub coating_files: Vec<Member>,
}

fn ending(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

fn formats_of(ending: &str) -> impl Iterator<Item = &'static LensFormat> {
    FORMATS.iter().filter(move |format| format.endings.contains(&ending))
}

/// Whether a file of this name is a lens file.
pub fn is_lens_file(path: &Path) -> bool {
    formats_of(&ending(path)).next().is_some()
}

/// Writes the format of a file of this name; none if it is not written.
pub fn writer(path: &Path) -> Option<Write> {
    formats_of(&ending(path)).find_map(|format| format.write)
}

fn content_error(problem: impl Into<String>) -> LensFileError {
    LensFileError::Content { problem: problem.into() }
}

impl LensFile {
    /// The lens file of this name and content.
    ///
    /// # Errors
    /// The ending is not known, or the content is not what it says.
    pub fn new(path: &Path, bytes: Vec<u8>) -> Result<Self, LensFileError> {
        let ending = ending(path);
        let claims = |format: &&LensFormat| format.is_it.is_some_and(|is_it| is_it(&bytes));
        let format = formats_of(&ending)
            .find(claims)
            .or_else(|| formats_of(&ending).find(|format| format.is_it.is_none()))
            .ok_or_else(|| LensFileError::Ending {
                ending: ending.clone(),
                known: with_dots(&endings(FORMATS.iter())),
            })?;
        match &format.content {
            Content::Refused(problem) => Err(content_error(*problem)),
            Content::Text(format) => {
                check_text(&bytes)?;
                Ok(Self { format: *format, bytes, catalogues: Vec::new(), coating_files: Vec::new() })
            }
            Content::Archive(unpack) => {
                check_file(&bytes)?;
                let (lens, beside) = unpack(&bytes)?;
                let (coating_files, catalogues) =
                    beside.into_iter().partition(|m| m.name.to_lowercase().ends_with(".dat"));
                let name = lens.name.clone();
                let inner = Self::new(Path::new(&lens.name), lens.data)
                    .map_err(|source| LensFileError::Member { name, source: Box::new(source) })?;
                Ok(Self { catalogues, coating_files, ..inner })
            }
        }
    }

    /// Name of the coating file that it names.
    pub fn coating_file(&self) -> Option<String> {
        (self.format.coating_file)(&self.bytes)
    }

    /// Names of the glass catalogues that it lists.
    pub fn catalogue_names(&self) -> Vec<String> {
        (self.format.catalogues)(&self.bytes)
    }

    /// Reads it.
    ///
    /// # Errors
    /// A line that is wrong or not supported, a missing part, a glass that is not known.
    pub fn read(&self, glasses: &GlassLibrary, options: &ReadOptions) -> Result<System, LensFileError> {
        (self.format.read)(&self.bytes, glasses, options)
    }
}

/// Refuses files that are empty or an archive of another kind.
fn check_file(bytes: &[u8]) -> Result<(), LensFileError> {
    if bytes.is_empty() {
        return Err(content_error("the file is empty"));
    }
    if is_zip(bytes) {
        return Err(content_error("the file is a zip archive; unpack it and give the lens file in it"));
    }
    Ok(())
}

fn check_text(bytes: &[u8]) -> Result<(), LensFileError> {
    check_file(bytes)?;
    if bytes.len() > MAX_TEXT_BYTES {
        let problem = format!("the file has more than {MAX_TEXT_BYTES} bytes, so it is not a lens design");
        return Err(content_error(problem));
    }
    if text::is_binary(bytes) {
        return Err(content_error("the file is binary, expected the text of a lens design"));
    }
    Ok(())
}

/// Whether the bytes are those of a zip archive.
pub(super) fn is_zip(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04")
}
