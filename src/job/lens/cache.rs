//! Cache of traced bands in the user's cache directory: one lens pack of one band per file. Beside them lie depth nodes and reduced charts.
//!
//! Files are named `RECIPE-CONTENT.lens.zip`, each part the first 32 hex digits of a blake3 digest. RECIPE is the digest of all
//! inputs of the trace (design, wavelength, options, version of the tracer). CONTENT is the digest of the file, so a truncated,
//! damaged or edited entry does not match its name and is traced again. An entry is written under a temporary name and renamed.
//! Processes that trace the same band at the same time write the same bytes. Entries may be deleted at any time. Wide PSFs are stored as
//! their pupil functions, a hundredth of the bytes. Beside them: depth nodes ([`placements`]) and the operators of ghosts ([`operators`]).

pub mod entries;
pub mod failures;
pub mod operators;
mod placements;
pub mod reduced;

use crate::machine::user_cache;
use crate::progress::log_line;
use anyhow::{Context, Result, bail};
use formats::durable::{self, HashedFile};
use formats::lens::{LensPack, LensPackWriter, PackAttributes};
use pipeline::design::depth::trace::DepthOptions;
use pipeline::design::skew::grid::GRID_VERSION;
use pipeline::design::skew::map::FilmRange;
use pipeline::design::skew::system::BuiltLens;
use pipeline::design::skew::tables::SKEW_VERSION;
use pipeline::design::trace::{BandRange, NODES_VERSION, TAILS_VERSION, TRACER_VERSION, TraceOptions};
use pipeline::design::{DesignError, System};
use pipeline::lens::Lens;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Hex digits of each digest in the name of an entry.
const DIGITS: usize = 32;
const EXTENSION: &str = ".lens.zip";
/// Keys of the recipe and of the digest of the values in the `source` attribute of an entry.
const RECIPE: &str = "recipe";
const VALUES: &str = "values";

/// Incremented when the digest of the same values of a band with depth nodes changes.
const DEPTH_VALUES_VERSION: u32 = 2;

/// Directory of traced bands.
pub struct Cache {
    dir: PathBuf,
    /// Whether the directory is removed when the cache is dropped.
    temporary: bool,
}

/// Directory of the traced bands in the user's cache.
pub fn directory() -> Option<PathBuf> {
    Some(user_cache()?.join("lenses"))
}

/// What [`Cache::insert`] calls to write the PSFs of a band: its lens, attributes, and the digest of its values if it is known.
pub type WriteBand<'a> =
    &'a mut dyn FnMut(&mut LensPackWriter) -> Result<(Lens, PackAttributes, Option<String>)>;

/// Digest of all inputs of a traced band. `options` must hold its wavelength only; `range`: its tables and PSFs are means over this; `depth`: it is traced at
/// depth nodes of these vergences, or, without any, its nodes are placed; `tails`: it has tails.
pub fn recipe(
    system: &System,
    options: &TraceOptions,
    range: Option<BandRange>,
    depth: Option<(&DepthOptions, &[f64])>,
    tails: bool,
) -> String {
    let system = system.identity();
    let mut text = format!(
        "lenscube traced band, tracer {TRACER_VERSION}, nodes {NODES_VERSION}\n{system}\n{options:?}\n"
    );
    if let Some(range) = range {
        text.push_str(&format!("{range:?}\n"));
    }
    if let Some((depth, nodes)) = depth {
        text.push_str(&format!("{depth:?}\n{nodes:?}\n"));
        if !nodes.is_empty() {
            text.push_str(&format!("values {DEPTH_VALUES_VERSION}\n"));
        }
    }
    // Without tails the recipe is that of programs without them.
    if tails {
        text.push_str(&format!("tails {TAILS_VERSION}\n"));
    }
    blake3::hash(text.as_bytes()).to_hex().to_string()
}

/// Digest of all inputs of a traced band of `lens`, which has no rotational symmetry, with a map over `range`. `options` must hold its wavelength only.
pub fn planar_recipe(lens: &BuiltLens, options: &TraceOptions, range: &FilmRange) -> String {
    let kind = match lens.is_asymmetric_design() {
        true => format!("without symmetry, grid {GRID_VERSION}, rays {SKEW_VERSION}"),
        false => format!("as built, tracer {TRACER_VERSION}, nodes {NODES_VERSION}, built {SKEW_VERSION}"),
    };
    let text =
        format!("lenscube traced band of a lens {kind}\n{}\n{options:?}\n{range:?}\n", lens.identity());
    blake3::hash(text.as_bytes()).to_hex().to_string()
}

impl Cache {
    /// Opens the user's cache; if it cannot be written, prints a note and opens a temporary directory.
    pub fn open() -> Result<Self> {
        let problem = match directory() {
            None => "neither XDG_CACHE_HOME nor HOME names a directory".to_owned(),
            Some(dir) => match prepare(&dir) {
                Ok(()) => return Ok(Self { dir, temporary: false }),
                Err(e) => format!("{}: {e}", dir.display()),
            },
        };
        Self::open_temporary(&problem)
    }

    fn open_temporary(problem: &str) -> Result<Self> {
        log_line(format!(
            "note: traced bands cannot be stored in the cache ({problem}); they are traced for this run only"
        ));
        let temp = std::env::temp_dir();
        // Leftover directories of killed runs.
        durable::sweep_entries(&temp)?;
        let dir = temp.join(durable::temp_name());
        prepare(&dir).with_context(|| format!("creating {} for traced bands", dir.display()))?;
        Ok(Self { dir, temporary: true })
    }

    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Cached band of `recipe` at `wavelength_nm`. An entry that is damaged or of another band is removed with a note.
    pub fn find(&self, recipe: &str, wavelength_nm: f64) -> Option<LensPack> {
        find_entry(&self.dir, recipe, EXTENSION, "its band is traced again", |path, content| {
            open(path, content, recipe, wavelength_nm).map_err(|problem| Unusable::Bad(problem.to_string()))
        })
    }

    /// Stores the band that `write` writes and opens its entry. If the directory cannot be written, changes to a temporary directory and calls
    /// `write` again.
    pub fn insert(&mut self, recipe: &str, write: WriteBand<'_>) -> Result<LensPack> {
        match store(&self.dir, recipe, write) {
            Err(e) if !self.temporary && is_of_disk(&e) => {
                *self = Self::open_temporary(&crate::failure::line(&e))?;
                store(&self.dir, recipe, write)
            }
            stored => stored,
        }
    }
}

/// Why an entry is not used.
enum Unusable {
    /// What is wrong with it, for which it is removed with a note.
    Bad(String),
    /// It cannot be read, as another process may have removed it.
    Unreadable,
}

impl Unusable {
    fn damaged() -> Self {
        Self::Bad("it is damaged".into())
    }
}

/// The first entry of `recipe` in `dir` that `open` opens, by its path and the digest of its content in its name. Bad ones are removed with a note, which says what
/// is done `instead`.
fn find_entry<T>(
    dir: &Path,
    recipe: &str,
    extension: &str,
    instead: &str,
    open: impl Fn(&Path, &str) -> Result<T, Unusable>,
) -> Option<T> {
    for entry in std::fs::read_dir(dir).ok()?.flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let of_recipe = name.strip_suffix(extension).and_then(|name| name.strip_prefix(&recipe[..DIGITS]));
        let Some(content) = of_recipe.and_then(|name| name.strip_prefix('-')) else { continue };
        let path = entry.path();
        match open(&path, content) {
            Ok(found) => return Some(found),
            Err(Unusable::Unreadable) => {}
            Err(Unusable::Bad(problem)) => {
                log_line(format!("note: {} cannot be used ({problem}); {instead}", path.display()));
                // If the removal fails, the next look-up prints the note again.
                let _ = std::fs::remove_file(&path);
            }
        }
    }
    None
}

/// Name of the entry of `recipe` with the content of digest `content`.
fn entry_name(recipe: &str, content: &str, extension: &str) -> String {
    format!("{}-{}{extension}", &recipe[..DIGITS], &content[..DIGITS])
}

/// Digest of the content of an entry, as its name has it.
fn content_digest(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex()[..DIGITS].to_owned()
}

/// Whether an error is one of writing, not of tracing.
fn is_of_disk(error: &anyhow::Error) -> bool {
    match error.downcast_ref() {
        Some(DesignError::Sink { .. }) => true,
        Some(_) => false,
        None => true,
    }
}

impl Drop for Cache {
    fn drop(&mut self) {
        if self.temporary {
            // An error is ignored: the next run removes the directory.
            let _ = std::fs::remove_dir_all(&self.dir);
        }
    }
}

/// Creates the directory, removes leftover temporary files, and checks that files can be written.
fn prepare(dir: &Path) -> Result<()> {
    std::fs::create_dir_all(dir)?;
    durable::sweep(dir)?;
    let probe = dir.join(durable::temp_name());
    std::fs::write(&probe, b"lenscube")?;
    Ok(std::fs::remove_file(&probe)?)
}

/// Digest of the values of an entry, as recorded in it: its bytes were verified when it was opened, so its PSFs need not be read.
pub fn values(entry: &LensPack) -> Option<&str> {
    entry.attributes().source.as_ref()?[VALUES].as_str()
}

/// Opens an entry; an error if its digest differs from its name or its recipe or wavelength from the requested ones.
fn open(path: &Path, content: &str, recipe: &str, wavelength_nm: f64) -> Result<LensPack> {
    let sealed = HashedFile::open(path)?;
    if sealed.digest()[..DIGITS] != *content {
        bail!("it is damaged: its digest differs from its name");
    }
    let pack = LensPack::open_hashed(sealed)?;
    let stored = pack.attributes().source.as_ref().and_then(|s| s[RECIPE].as_str());
    let bands = &pack.lens().bands;
    match stored == Some(recipe) && bands.len() == 1 && bands[0].wavelength_nm == wavelength_nm {
        true => Ok(pack),
        false => bail!("it was not traced for this band"),
    }
}

fn store(dir: &Path, recipe: &str, write_band: WriteBand<'_>) -> Result<LensPack> {
    let temp = dir.join(format!("{}.zip", durable::temp_name()));
    let stored = write(&temp, recipe, write_band).and_then(|sealed| {
        let name = entry_name(recipe, sealed.digest(), EXTENSION);
        // Opened before the rename: after it another process may remove the file.
        let pack = LensPack::open_hashed(sealed)?;
        std::fs::rename(&temp, dir.join(name))?;
        Ok(pack)
    });
    stored.inspect_err(|_| {
        // The first error is returned.
        let _ = std::fs::remove_file(&temp);
    })
}

fn write(temp: &Path, recipe: &str, write_band: WriteBand<'_>) -> Result<HashedFile> {
    let mut writer = LensPackWriter::create(temp)?;
    let (lens, mut attributes, values) = write_band(&mut writer)?;
    let source = attributes.source.get_or_insert_with(|| json!({}));
    source[RECIPE] = json!(recipe);
    if let Some(values) = values {
        source[VALUES] = json!(values);
    }
    writer.finish(&lens, &attributes)?;
    Ok(HashedFile::open(temp)?)
}
