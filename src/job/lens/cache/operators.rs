//! Cache of the ring operators of ghosts, a band per file.
//!
//! Files are named `RECIPE-CONTENT.ghosts` as the bands beside them. A line of JSON (the recipe and the notes of the band), then the values of the operator, f32, little-endian.

use super::{Cache, Unusable, content_digest, directory, entry_name, find_entry, prepare};
use anyhow::{Context, Result};
use formats::durable::{AtomicFile, read_file_at_most};
use pipeline::design::System;
use pipeline::design::ghost::operator::GHOSTS_VERSION;
use pipeline::design::ghost::options::GhostOptions;
use pipeline::design::ghost::rings::{RingOperator, RingSizes};
use pipeline::design::trace::TRACER_VERSION;
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;

pub(super) const EXTENSION: &str = ".ghosts";
/// Largest line of an entry, bytes.
const MAX_LINE: usize = 1 << 16;

/// Ghosts of a band.
#[derive(Clone, Debug, PartialEq)]
pub struct CachedGhosts {
    /// Its operator.
    pub operator: RingOperator,
    /// Its notes.
    pub notes: Vec<String>,
}

/// Digest of all inputs of the ghosts of a band.
pub fn ghosts_recipe(system: &System, wavelength_nm: f64, options: &GhostOptions) -> String {
    let text = format!(
        "lenscube ghosts, version {GHOSTS_VERSION}, tracer {TRACER_VERSION}\n{}\n{wavelength_nm:?} {options:?}\n",
        system.identity()
    );
    blake3::hash(text.as_bytes()).to_hex().to_string()
}

impl Cache {
    /// The user's cache; none if it cannot be written, of which [`Cache::open`] has printed a note.
    pub fn open_if_usable() -> Option<Self> {
        let dir = directory().filter(|dir| prepare(dir).is_ok())?;
        Some(Self { dir, temporary: false })
    }

    /// Ghosts of `recipe` on rings of `sizes`. A damaged entry is removed with a note.
    pub fn find_ghosts(&self, recipe: &str, sizes: RingSizes) -> Option<CachedGhosts> {
        find_entry(&self.dir, recipe, EXTENSION, "its ghosts are traced again", |path, content| {
            read(path, content, recipe, sizes).ok_or_else(Unusable::damaged)
        })
    }

    /// Stores the ghosts of `recipe`.
    ///
    /// # Errors
    /// The directory cannot be written.
    pub fn insert_ghosts(&self, recipe: &str, ghosts: &CachedGhosts) -> Result<()> {
        let mut bytes = json!({ "recipe": recipe, "notes": ghosts.notes }).to_string().into_bytes();
        bytes.push(b'\n');
        bytes.extend(ghosts.operator.values.iter().flat_map(|v| v.to_le_bytes()));
        let path = self.dir.join(entry_name(recipe, &content_digest(&bytes), EXTENSION));
        let file = AtomicFile::create(&path)?;
        file.writer().write_all(&bytes).with_context(|| format!("writing {}", path.display()))?;
        Ok(file.finish()?)
    }
}

fn read(path: &Path, content: &str, recipe: &str, sizes: RingSizes) -> Option<CachedGhosts> {
    let values = (sizes.orders() + 1) * sizes.rings * sizes.source_rings;
    let limit = 4 * values + MAX_LINE;
    let bytes = read_file_at_most(path, limit as u64).ok()??;
    if content_digest(&bytes) != content {
        return None;
    }
    let end = bytes.iter().position(|b| *b == b'\n')?;
    let head: Value = serde_json::from_slice(&bytes[..end]).ok()?;
    let values_of = bytes[end + 1..].as_chunks::<4>();
    if head["recipe"] != recipe || values_of.0.len() != values || !values_of.1.is_empty() {
        return None;
    }
    let notes: Option<Vec<String>> =
        head["notes"].as_array()?.iter().map(|note| Some(note.as_str()?.to_owned())).collect();
    let values = values_of.0.iter().map(|v| f32::from_le_bytes(*v)).collect();
    Some(CachedGhosts { operator: RingOperator { sizes, values }, notes: notes? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ghosts_are_found_again_and_damaged_ones_removed() {
        let dir = tempfile::tempdir().unwrap();
        let cache = Cache { dir: dir.path().into(), temporary: false };
        let sizes = RingSizes::new(3.0, 16);
        let count = (sizes.orders() + 1) * sizes.rings * sizes.source_rings;
        let values = (0..count).map(|k| (k as f32 / 3.0).sin()).collect();
        let ghosts =
            CachedGhosts { operator: RingOperator { sizes, values }, notes: vec!["small".to_owned()] };
        let [recipe, other] = ["a", "b"].map(|c| c.repeat(64));
        cache.insert_ghosts(&recipe, &ghosts).unwrap();
        assert_eq!(cache.find_ghosts(&recipe, sizes), Some(ghosts));
        assert_eq!(cache.find_ghosts(&other, sizes), None);
        let file = std::fs::read_dir(dir.path()).unwrap().next().unwrap().unwrap().path();
        let mut bytes = std::fs::read(&file).unwrap();
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        std::fs::write(&file, bytes).unwrap();
        assert_eq!(cache.find_ghosts(&recipe, sizes), None);
        assert!(!file.exists());
    }

    #[test]
    fn every_input_of_ghosts_is_in_their_recipe() {
        use pipeline::design::ghost::options::Reflectance;
        let system = System::double_gauss_28();
        let options =
            GhostOptions { corner_mm: 20.0, rings: 64, film_reflectance: Reflectance(vec![(0.0, 0.05)]) };
        let mut recipes =
            vec![ghosts_recipe(&system, 550.0, &options), ghosts_recipe(&system, 551.0, &options)];
        for changed in [
            GhostOptions { corner_mm: 20.1, ..options.clone() },
            GhostOptions { rings: 65, ..options.clone() },
            GhostOptions { film_reflectance: Reflectance(vec![(0.0, 0.06)]), ..options.clone() },
        ] {
            recipes.push(ghosts_recipe(&system, 550.0, &changed));
        }
        let mut narrower = system.clone();
        narrower.surfaces[1].semi_diameter_mm *= 0.99;
        let mut coated = system.clone();
        coated.surfaces[0].coating = Some(pipeline::design::prescription::coating::Coating::Bare);
        for changed in [narrower, coated] {
            recipes.push(ghosts_recipe(&changed, 550.0, &options));
        }
        let count = recipes.len();
        recipes.sort();
        recipes.dedup();
        assert_eq!(recipes.len(), count);
    }
}
