//! Materials of OBJ files (MTL).
//!
//! | statement | read as |
//! |---|---|
//! | `Kd r [g b]` | base colour, linear |
//! | `d a`, `Tr t` | opacity a, or 1 − t where there is no d |
//! | `Ke r [g b]` | emission, linear |
//! | `map_Kd`, `map_d`, `map_Ke` | textures; options `-s`, `-o`, `-clamp` are read, others ignored with a note |
//!
//! The rest is ignored with a note. Of several materials of one name the first is used.

use std::collections::hash_map::Entry;
use std::collections::{BTreeSet, HashMap, HashSet};
use std::path::{Path, PathBuf};

use super::super::context::Context;
use super::super::error::MeshError;
use super::super::grow;
use super::super::paths::{Found, resolve};
use super::super::text::{self, Lines, keyword, name, number, quote};
use super::findings::Findings;
use super::{invalid, numbers, single};

/// Memory of a material without its texts.
const DEFINITION_BYTES: u64 = 1024;

/// A texture of a material.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Map {
    pub reference: String,
    pub line: u64,
    /// u and v, as in the file: v goes up.
    pub scale: [f64; 2],
    pub offset: [f64; 2],
    pub clamp: bool,
}

/// A material as its file describes it.
#[derive(Clone, Debug, Default)]
pub(super) struct Definition {
    pub diffuse: Option<[f32; 3]>,
    pub emission: Option<[f32; 3]>,
    pub opacity: Option<f64>,
    pub transparency: Option<f64>,
    pub diffuse_map: Option<Map>,
    pub opacity_map: Option<Map>,
    pub emission_map: Option<Map>,
    /// The MTL file.
    pub path: PathBuf,
}

/// All materials of the MTL files.
#[derive(Default)]
pub(super) struct Library {
    pub definitions: HashMap<String, Definition>,
    pub findings: Findings,
}

impl Library {
    /// Reads the files of `mtllib` statements (line, text).
    pub fn read(context: &Context<'_>, statements: &[(u64, String)]) -> Result<Self, MeshError> {
        let mut library = Self::default();
        let mut left_out = BTreeSet::new();
        let mut known = HashSet::new();
        for (line, text) in statements {
            let place = format!("line {line}");
            for reference in file_names(context, &place, text) {
                if !known.insert(reference.clone()) {
                    continue;
                }
                match resolve(context, context.path, &place, &reference) {
                    Ok(found) => library.read_file(context, &reference, &found, &mut left_out)?,
                    Err(MeshError::Missing { .. }) if context.limits.missing_textures_grey => {
                        library.findings.add("missing material files", &reference);
                    }
                    Err(error) => return Err(error),
                }
            }
        }
        if !left_out.is_empty() {
            let names: Vec<_> = left_out.iter().map(String::as_str).collect();
            context.note(format!("material properties {} are ignored", names.join(", ")));
        }
        Ok(library)
    }

    fn read_file(
        &mut self,
        context: &Context<'_>,
        reference: &str,
        found: &Found,
        left_out: &mut BTreeSet<String>,
    ) -> Result<(), MeshError> {
        note_case(&mut self.findings, reference, found);
        let path = found.path.as_path();
        let text = text::read(context, path, path)?;
        let mut lines = Lines::new(&text);
        let mut current: Option<(String, Definition)> = None;
        let mut count = 0;
        while let Some((line, statement)) = lines.next() {
            let (word, rest) = keyword(statement);
            if word == b"newmtl" {
                context.charge(DEFINITION_BYTES + 4 * rest.len() as u64, || {
                    format!("material {}", quote(rest))
                })?;
                count += 1;
                self.add(current.take());
                current = Some((name(rest), Definition { path: path.into(), ..Definition::default() }));
            } else if !word.is_empty() && word[0] != b'#' {
                let Some((_, definition)) = &mut current else {
                    return Err(invalid(path, line, "newmtl before other statements", quote(statement)));
                };
                definition.set(context, line, word, rest, left_out)?;
            }
        }
        self.add(current);
        if count == 0 {
            self.findings.add("material files without materials", reference);
        }
        drop(lines);
        grow::free(context, text);
        Ok(())
    }

    fn add(&mut self, material: Option<(String, Definition)>) {
        let Some((name, definition)) = material else { return };
        match self.definitions.entry(name) {
            Entry::Vacant(entry) => {
                entry.insert(definition);
            }
            Entry::Occupied(entry) => {
                self.findings
                    .add("materials defined more than once, of which the first is used", entry.key());
            }
        }
    }
}

/// A note if a name was found in other case only.
pub(super) fn note_case(findings: &mut Findings, reference: &str, found: &Found) {
    if found.other_case {
        findings.add("file names that differ in upper and lower case from the files read", reference);
    }
}

/// The names of a `mtllib` statement: one with spaces if there is such a file, or unless names before the last end with `.mtl`.
fn file_names(context: &Context<'_>, place: &str, text: &str) -> Vec<String> {
    let text = text.trim();
    let lower = text.to_ascii_lowercase();
    let ends = lower.match_indices(".mtl").map(|(at, end)| at + end.len());
    let ends: Vec<usize> = ends.filter(|&end| lower[end..].starts_with([' ', '\t'])).collect();
    if ends.is_empty() || resolve(context, context.path, place, text).is_ok() {
        return vec![text.into()];
    }
    let mut names = Vec::new();
    let mut start = 0;
    for end in ends.into_iter().chain([text.len()]) {
        names.push(text[start..end].trim().to_string());
        start = end;
    }
    names
}

impl Definition {
    fn set(
        &mut self,
        context: &Context<'_>,
        line: u64,
        word: &[u8],
        rest: &[u8],
        left_out: &mut BTreeSet<String>,
    ) -> Result<(), MeshError> {
        let path = self.path.clone();
        match word {
            b"Kd" => self.diffuse = Some(colour(&path, line, rest)?),
            b"Ke" => self.emission = Some(colour(&path, line, rest)?),
            b"d" => {
                let (value, is_halo) = match rest.strip_prefix(b"-halo") {
                    Some(value) => (value, true),
                    None => (rest, false),
                };
                if is_halo {
                    context.note("option -halo of d is ignored");
                }
                self.opacity = Some(scalar(&path, line, value)?);
            }
            b"Tr" => self.transparency = Some(scalar(&path, line, rest)?),
            b"map_Kd" => self.diffuse_map = Some(map(context, &path, line, rest)?),
            b"map_d" => self.opacity_map = Some(map(context, &path, line, rest)?),
            b"map_Ke" => self.emission_map = Some(map(context, &path, line, rest)?),
            _ if left_out.len() < 32 => {
                left_out.insert(quote(word));
            }
            _ => {}
        }
        Ok(())
    }
}

fn colour(path: &Path, line: u64, text: &[u8]) -> Result<[f32; 3], MeshError> {
    if text.starts_with(b"spectral") || text.starts_with(b"xyz") {
        return Err(invalid(path, line, "a colour r g b; `spectral` and `xyz` are not read", quote(text)));
    }
    let [r, g, b] = match numbers::<3>(path, line, text)? {
        ([r, _, _], 1) => [r; 3],
        (rgb, 3) => rgb,
        _ => return Err(invalid(path, line, "a colour r g b", quote(text))),
    };
    Ok([single(path, line, r)?, single(path, line, g)?, single(path, line, b)?])
}

fn scalar(path: &Path, line: u64, text: &[u8]) -> Result<f64, MeshError> {
    match numbers::<3>(path, line, text)? {
        (_, 0) => Err(invalid(path, line, "a number of 0 to 1", quote(text))),
        ([value, ..], _) => Ok(value.clamp(0.0, 1.0)),
    }
}

/// Options and file name of a texture.
fn map(context: &Context<'_>, path: &Path, line: u64, text: &[u8]) -> Result<Map, MeshError> {
    let mut map = Map { reference: String::new(), line, scale: [1.0; 2], offset: [0.0; 2], clamp: false };
    let mut rest = text;
    loop {
        let (option, after) = keyword(rest);
        let words = match option {
            b"-s" | b"-o" | b"-t" => {
                let (values, after) = leading_numbers(after);
                for value in values.into_iter().flatten() {
                    single(path, line, value)?;
                }
                match option {
                    b"-s" => map.scale = [values[0].unwrap_or(1.0), values[1].unwrap_or(1.0)],
                    b"-o" => map.offset = [values[0].unwrap_or(0.0), values[1].unwrap_or(0.0)],
                    _ => context.note("option -t of textures is ignored"),
                }
                rest = after;
                continue;
            }
            b"-clamp" => {
                map.clamp = keyword(after).0 == b"on";
                1
            }
            b"-mm" => 2,
            b"-blendu" | b"-blendv" | b"-bm" | b"-boost" | b"-cc" | b"-imfchan" | b"-texres" | b"-type" => 1,
            _ => break,
        };
        if option != b"-clamp" {
            context.note(format!("option {} of textures is ignored", name(option)));
        }
        rest = (0..words).fold(after, |rest, _| keyword(rest).1);
    }
    map.reference = name(rest);
    match rest.is_empty() {
        false => Ok(map),
        true => Err(invalid(path, line, "the name of a texture file", quote(text))),
    }
}

/// Up to three numbers, but not the last word, which is a file name.
fn leading_numbers(mut text: &[u8]) -> ([Option<f64>; 3], &[u8]) {
    let mut values = [None; 3];
    for value in &mut values {
        let (word, after) = keyword(text);
        *value = number(word).filter(|_| !after.is_empty());
        if value.is_none() {
            break;
        }
        text = after;
    }
    (values, text)
}
