//! Cache of the depth nodes of bands: where they lie, which takes long to find and is needed before the nodes of a scene are traced.
//!
//! Files are named `RECIPE-CONTENT.nodes.json` as the bands beside them.

use super::{Cache, Unusable, content_digest, entry_name, find_entry};
use anyhow::{Context, Result};
use formats::durable;
use pipeline::design::depth::nodes::Placement;
use serde_json::{Value, json};
use std::path::Path;

pub(super) const EXTENSION: &str = ".nodes.json";

impl Cache {
    /// Nodes of `recipe`. A damaged entry is removed with a note.
    pub fn find_nodes(&self, recipe: &str) -> Option<Placement> {
        let again = "its depth nodes are determined again";
        find_entry(&self.dir, recipe, EXTENSION, again, |path, content| {
            read(path, content, recipe).ok_or_else(Unusable::damaged)
        })
    }

    /// Stores the nodes of `recipe`. If the directory cannot be written, changes to a temporary directory.
    ///
    /// # Errors
    /// The temporary directory cannot be written either.
    pub fn insert_nodes(&mut self, recipe: &str, placement: &Placement) -> Result<()> {
        let Placement { vergence, l1, esf } = placement;
        let text = json!({ "recipe": recipe, "vergence": vergence, "l1": l1, "esf": esf }).to_string();
        match write(&self.dir, recipe, &text) {
            Err(e) if !self.temporary => {
                *self = Self::open_temporary(&e.to_string())?;
                write(&self.dir, recipe, &text)
            }
            written => written,
        }
        .with_context(|| format!("storing depth nodes in {}", self.dir.display()))
    }
}

fn read(path: &Path, content: &str, recipe: &str) -> Option<Placement> {
    let text =
        std::fs::read_to_string(path).ok().filter(|text| content_digest(text.as_bytes()) == content)?;
    let value: Value = serde_json::from_str(&text).ok()?;
    let vergence: Option<Vec<f64>> = value["vergence"].as_array()?.iter().map(Value::as_f64).collect();
    let is_valid = |v: &Vec<f64>| !v.is_empty() && v.windows(2).all(|w| w[0] < w[1]);
    let vergence = vergence.filter(|v| value["recipe"] == recipe && is_valid(v))?;
    Some(Placement { vergence, l1: value["l1"].as_f64()?, esf: value["esf"].as_f64()? })
}

fn write(dir: &Path, recipe: &str, text: &str) -> std::io::Result<()> {
    let temp = dir.join(durable::temp_name());
    std::fs::write(&temp, text)?;
    let name = entry_name(recipe, &content_digest(text.as_bytes()), EXTENSION);
    std::fs::rename(&temp, dir.join(name)).inspect_err(|_| {
        // The first error is returned.
        let _ = std::fs::remove_file(&temp);
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_found_again_and_damaged_ones_removed() {
        let dir = tempfile::tempdir().unwrap();
        let mut cache = Cache { dir: dir.path().into(), temporary: false };
        let placement = Placement { vergence: vec![0.1, 1.0 / 3.0, 0.7], l1: 0.0193, esf: 4e-4 };
        let [recipe, other] = ["a", "b"].map(|c| c.repeat(64));
        cache.insert_nodes(&recipe, &placement).unwrap();
        assert_eq!(cache.find_nodes(&recipe), Some(placement));
        assert_eq!(cache.find_nodes(&other), None);
        let file = std::fs::read_dir(dir.path()).unwrap().next().unwrap().unwrap().path();
        let text = std::fs::read_to_string(&file).unwrap().replace("0.7", "0.8");
        std::fs::write(&file, text).unwrap();
        assert_eq!(cache.find_nodes(&recipe), None);
        assert!(!file.exists());
    }
}
