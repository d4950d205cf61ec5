//! Traced bands kept from run to run: each a lens pack of one band, one file in the user's cache directory.
//!
//! `RECIPE-CONTENT.lens.zip`: both are the first 32 hex digits of a blake3. RECIPE is all that the band's numbers follow from
//! (design, wavelength, options, version of the tracer); CONTENT is of the file's own bytes, so an entry that was cut, damaged
//! or edited does not bear its own name and is traced again. An entry appears whole or not at all: temp name, then rename.
//! Several programs may trace the same band at once: they write the same bytes. Anything in here may be deleted any time.

use crate::progress::say;
use anyhow::{Context, Result, bail};
use formats::durable;
use formats::lens::{LensPack, LensPackWriter, PackAttributes, SealedFile};
use pipeline::design::System;
use pipeline::design::trace::{TRACER_VERSION, TraceOptions, TracedBand};
use pipeline::lens::Lens;
use serde_json::json;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Digits of a digest in an entry's name.
const DIGITS: usize = 32;
const ENDING: &str = ".lens.zip";
/// In an entry's `source`: the recipe that it was made by.
const RECIPE: &str = "recipe";

/// Where traced bands lie.
pub struct Cache {
    dir: PathBuf,
    /// Removed when dropped: there was no other place.
    temporary: bool,
}

/// Where the user's cache is: `XDG_CACHE_HOME`, else `~/.cache`.
pub fn directory() -> Option<PathBuf> {
    let absolute = |v: OsString| Some(PathBuf::from(v)).filter(|p| p.is_absolute());
    let base = std::env::var_os("XDG_CACHE_HOME").and_then(absolute);
    let base =
        base.or_else(|| std::env::var_os("HOME").and_then(absolute).map(|home| home.join(".cache")))?;
    Some(base.join("lenscube").join("lenses"))
}

/// All that a traced band's numbers follow from, as text. `options` must hold its wavelength alone.
pub fn recipe(system: &System, options: &TraceOptions) -> String {
    // What people call it changes no number.
    let system = System { name: String::new(), notes: Vec::new(), ..system.clone() };
    let text = format!("lenscube traced band, tracer {TRACER_VERSION}\n{system:?}\n{options:?}\n");
    blake3::hash(text.as_bytes()).to_hex().to_string()
}

impl Cache {
    /// The user's cache, or a temporary directory, with a note, where that cannot be written.
    pub fn open() -> Result<Self> {
        let problem = match directory() {
            None => "neither XDG_CACHE_HOME nor HOME names a directory".to_owned(),
            Some(dir) => match prepare(&dir) {
                Ok(()) => return Ok(Self { dir, temporary: false }),
                Err(e) => format!("{}: {e}", dir.display()),
            },
        };
        Self::aside(&problem)
    }

    fn aside(problem: &str) -> Result<Self> {
        say(format!("note: traced bands cannot be kept ({problem}); they are traced for this run only"));
        let temp = std::env::temp_dir();
        // What killed runs left there.
        durable::sweep_entries(&temp)?;
        let dir = temp.join(durable::temp_name());
        prepare(&dir).with_context(|| format!("creating {} for traced bands", dir.display()))?;
        Ok(Self { dir, temporary: true })
    }

    /// The directory.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// The band of `recipe` at `wavelength_nm`, if it is there and sound. An entry that is damaged, or not this band's, is removed.
    pub fn find(&self, recipe: &str, wavelength_nm: f64) -> Option<LensPack> {
        let start = &recipe[..DIGITS];
        for entry in std::fs::read_dir(&self.dir).ok()?.flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let content = name.strip_suffix(ENDING).and_then(|n| n.strip_prefix(start)?.strip_prefix('-'));
            let Some(content) = content else { continue };
            let path = entry.path();
            match open(&path, content, recipe, wavelength_nm) {
                Ok(pack) => return Some(pack),
                Err(problem) => {
                    say(format!(
                        "note: {} cannot be used ({problem}); its band is traced again",
                        path.display()
                    ));
                    // If it stays, the next find says so again.
                    let _ = std::fs::remove_file(&path);
                }
            }
        }
        None
    }

    /// Keeps a band, and opens what was kept. Where the disk refuses, a temporary directory takes over.
    pub fn keep(
        &mut self,
        recipe: &str,
        lens: &Lens,
        attributes: &PackAttributes,
        band: &TracedBand,
    ) -> Result<LensPack> {
        let kept = store(&self.dir, recipe, lens, attributes, band);
        match kept {
            Err(e) if !self.temporary => {
                *self = Self::aside(&crate::failure::line(&e))?;
                store(&self.dir, recipe, lens, attributes, band)
            }
            kept => kept,
        }
    }
}

impl Drop for Cache {
    fn drop(&mut self) {
        if self.temporary {
            // The run is over either way; the system clears its temporary directory some time.
            let _ = std::fs::remove_dir_all(&self.dir);
        }
    }
}

/// Makes the directory, clears what died in it, and makes sure that files can be written.
fn prepare(dir: &Path) -> Result<()> {
    std::fs::create_dir_all(dir)?;
    durable::sweep(dir)?;
    let probe = dir.join(durable::temp_name());
    std::fs::write(&probe, b"lenscube")?;
    Ok(std::fs::remove_file(&probe)?)
}

/// Opens an entry whose bytes are those that its name tells, and whose band is the recipe's.
fn open(path: &Path, content: &str, recipe: &str, wavelength_nm: f64) -> Result<LensPack> {
    let sealed = SealedFile::open(path)?;
    if sealed.digest()[..DIGITS] != *content {
        bail!("it is damaged: its bytes are not those that its name tells");
    }
    let pack = LensPack::open_sealed(sealed)?;
    let told = pack.attributes().source.as_ref().and_then(|s| s[RECIPE].as_str());
    let bands = &pack.lens().bands;
    match told == Some(recipe) && bands.len() == 1 && bands[0].wavelength_nm == wavelength_nm {
        true => Ok(pack),
        false => bail!("it was not traced for this band"),
    }
}

fn store(
    dir: &Path,
    recipe: &str,
    lens: &Lens,
    attributes: &PackAttributes,
    band: &TracedBand,
) -> Result<LensPack> {
    let temp = dir.join(format!("{}.zip", durable::temp_name()));
    let kept = written(&temp, recipe, lens, attributes, band).and_then(|sealed| {
        let name = format!("{}-{}{ENDING}", &recipe[..DIGITS], &sealed.digest()[..DIGITS]);
        // Opened before it has its name: then another process may remove it.
        let pack = LensPack::open_sealed(sealed)?;
        std::fs::rename(&temp, dir.join(name))?;
        Ok(pack)
    });
    kept.inspect_err(|_| {
        // The error that matters is already in hand.
        let _ = std::fs::remove_file(&temp);
    })
}

fn written(
    temp: &Path,
    recipe: &str,
    lens: &Lens,
    attributes: &PackAttributes,
    band: &TracedBand,
) -> Result<SealedFile> {
    let mut attributes = attributes.clone();
    attributes.source.get_or_insert_with(|| json!({}))[RECIPE] = json!(recipe);
    let mut writer = LensPackWriter::create(temp)?;
    writer.psf(0, &band.psf)?;
    writer.finish(lens, &attributes)?;
    Ok(SealedFile::open(temp)?)
}
