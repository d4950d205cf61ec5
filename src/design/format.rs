//! File formats of designs: chosen by extension, read from bytes.

use crate::failure::usage;
use anyhow::{Context, Result, bail};
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::zar::{self, Member};
use pipeline::design::{DesignError, ReadOptions, System, codev, optiland, oslo, table, text, zmx};
use std::path::Path;

/// Extensions of designs, in lower case; those that are read are listed in [`crate::args::DESIGN_FILES`], `.zos` is an error.
const EXTENSIONS: [&str; 7] = ["zmx", "seq", "len", "csv", "json", "zar", "zos"];

/// Maximum size of the text of a design; a lens of a thousand surfaces has less than 1 MB.
const MAX_TEXT_BYTES: usize = 8 << 20;

/// A format with a reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Zmx,
    CodeV,
    Oslo,
    Table,
    Optiland,
}

/// A design's bytes, in the format that its reader expects, with the glass catalogues of its archive.
pub struct Design {
    format: Format,
    bytes: Vec<u8>,
    /// Catalogues that lie in the same archive.
    pub catalogues: Vec<Member>,
}

fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// Whether a file of this name is a design.
pub fn has_design_extension(path: &Path) -> bool {
    EXTENSIONS.contains(&extension(path).as_str())
}

impl Design {
    /// The design in a file of this name and content.
    pub fn new(path: &Path, bytes: Vec<u8>) -> Result<Self> {
        let plain = |format, bytes| Ok(Self { format, bytes, catalogues: Vec::new() });
        check_content(&extension(path), &bytes)?;
        match extension(path).as_str() {
            "zmx" => plain(Format::Zmx, bytes),
            "seq" => plain(Format::CodeV, bytes),
            "len" => plain(format_of_len(&bytes)?, bytes),
            "csv" => plain(Format::Table, bytes),
            "json" => plain(Format::Optiland, bytes),
            "zar" => {
                let (lens, catalogues) = zar::lens(&bytes)?;
                check_content("zmx", &lens.data).with_context(|| lens.name.clone())?;
                Ok(Self { format: Format::Zmx, bytes: lens.data, catalogues })
            }
            "zos" => bail!("files .zos are not read; save the lens as .zmx (in OpticStudio: File, Save As)"),
            other => Err(usage(format!(
                "a design ending with `.{other}` is not known; expected {}",
                EXTENSIONS.map(|e| format!(".{e}")).join(", ")
            ))),
        }
    }

    /// Names of the glass catalogues that the design lists.
    pub fn catalogue_names(&self) -> Vec<String> {
        match self.format {
            Format::Zmx => zmx::catalogues(&self.bytes),
            Format::Table => table::catalogues(&self.bytes),
            Format::CodeV | Format::Oslo | Format::Optiland => Vec::new(),
        }
    }

    /// Reads the design.
    pub fn read(&self, glasses: &GlassLibrary, options: &ReadOptions) -> Result<System, DesignError> {
        let parse = match self.format {
            Format::Zmx => zmx::parse,
            Format::CodeV => codev::parse,
            Format::Oslo => oslo::parse,
            Format::Table => table::parse,
            Format::Optiland => optiland::parse,
        };
        parse(&self.bytes, glasses, options)
    }
}

/// Refuses files that are empty, or binary where a text is expected.
fn check_content(extension: &str, bytes: &[u8]) -> Result<()> {
    const ZIP: &[u8] = b"PK\x03\x04";
    match extension {
        "zos" => Ok(()),
        _ if bytes.is_empty() => bail!("the file is empty"),
        _ if bytes.starts_with(ZIP) => {
            bail!("the file is a zip archive; unpack it and give the lens file in it")
        }
        "zar" => Ok(()),
        _ if bytes.len() > MAX_TEXT_BYTES => {
            bail!("the file has more than {MAX_TEXT_BYTES} bytes, so it is not a lens design")
        }
        "len" => Ok(()),
        _ if text::is_binary(bytes) => bail!("the file is binary, expected the text of a lens design"),
        _ => Ok(()),
    }
}

/// Lens files named .len belong to two design programs: text of OSLO, or a list of CODE V commands; CODE V's own are binary.
fn format_of_len(bytes: &[u8]) -> Result<Format> {
    if bytes.contains(&0) && !bytes.starts_with(&[0xFF, 0xFE]) {
        bail!("a binary .len file of CODE V is not read; save the lens as a sequence file (.seq) with WRL");
    }
    let text = text::decode(bytes);
    let is_oslo =
        |line: &str| line.starts_with("// OSLO") || line.trim_start().to_uppercase().starts_with("LEN NEW");
    Ok(if text.lines().take(20).any(is_oslo) { Format::Oslo } else { Format::CodeV })
}

#[cfg(test)]
mod tests {
    #[test]
    fn extensions_that_are_read_are_those_of_the_help() {
        let mut named: Vec<&str> = crate::args::DESIGN_FILES.split(", ").chain([".zos"]).collect();
        let mut own: Vec<String> = super::EXTENSIONS.iter().map(|e| format!(".{e}")).collect();
        named.sort_unstable();
        own.sort_unstable();
        assert_eq!(named, own);
    }
}
