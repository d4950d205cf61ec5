//! Bands that could not be traced: the next job does not try them again before it takes a smaller reach.
//!
//! Files are named `RECIPE-CONTENT.failure` as the bands beside them: a line of JSON, the recipe and the error.

use super::{Cache, Unusable, content_digest, entry_name, find_entry};
use anyhow::Result;
use formats::durable::{AtomicFile, read_file_at_most};
use pipeline::design::DesignError;
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;

pub(super) const EXTENSION: &str = ".failure";
/// Largest entry that is read, bytes.
const MAX_BYTES: u64 = 1 << 16;

/// A band that could not be traced before.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct KnownFailure(String);

impl Cache {
    /// Why the band of `recipe` could not be traced; none if that is not known.
    pub fn find_failure(&self, recipe: &str) -> Option<KnownFailure> {
        find_entry(&self.dir, recipe, EXTENSION, "its band is traced again", |path, content| {
            read(path, content, recipe).ok_or_else(Unusable::damaged)
        })
    }

    /// Stores that the band of `recipe` cannot be traced up to its reach. The next job tries again if it cannot be stored.
    pub fn remember(&self, recipe: &str, error: &DesignError) {
        // How far the lens can be traced is found at once.
        if !matches!(error, DesignError::Height { .. } | DesignError::Sink { .. }) {
            let _ = self.insert_failure(recipe, &error.to_string());
        }
    }

    fn insert_failure(&self, recipe: &str, problem: &str) -> Result<()> {
        let bytes = json!({ "recipe": recipe, "problem": problem }).to_string().into_bytes();
        let name = entry_name(recipe, &content_digest(&bytes), EXTENSION);
        let file = AtomicFile::create(&self.dir.join(name))?;
        file.writer().write_all(&bytes)?;
        Ok(file.finish()?)
    }
}

fn read(path: &Path, content: &str, recipe: &str) -> Option<KnownFailure> {
    let bytes = read_file_at_most(path, MAX_BYTES).ok()??;
    let entry: Value = serde_json::from_slice(&bytes).ok()?;
    let is_own = content_digest(&bytes) == content && entry["recipe"] == recipe;
    Some(KnownFailure(entry["problem"].as_str().filter(|_| is_own)?.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failures_are_found_again_and_damaged_ones_removed() {
        let directory = tempfile::tempdir().unwrap();
        let cache = Cache { dir: directory.path().into(), temporary: false };
        let (recipe, other) = ("a".repeat(64), "b".repeat(64));
        cache.insert_failure(&recipe, "a ray misses surface 9").unwrap();
        assert_eq!(cache.find_failure(&recipe).unwrap().to_string(), "a ray misses surface 9");
        assert!(cache.find_failure(&other).is_none());
        let path = std::fs::read_dir(directory.path()).unwrap().next().unwrap().unwrap().path();
        std::fs::write(&path, "{}").unwrap();
        assert!(cache.find_failure(&recipe).is_none() && !path.exists());
    }
}
