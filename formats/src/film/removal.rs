//! Removal of a film, and the files that belong to it: all that `--overwrite` may remove.
//!
//!   zarr.json                           the group
//!   NAME/zarr.json, NAME/c/…            its arrays and coordinates
//!   pyramid/…                           the same of its levels
//!   runs/…                              records and locks of runs, marks of engines
//!   .tmp-…                              temporary files, anywhere

use std::path::Path;

use super::engines::ENGINE_EXTENSION;
use super::error::FilmError;
use super::spec::FilmSpec;
use super::store::{FilmStore, film_attributes, open_store};
use crate::durable::{Removal, Store, is_temp_name, link_target};

impl FilmStore {
    /// Removes the film at `path`, if there is one. A symbolic link at `path` stays.
    ///
    /// # Errors
    /// [`FilmError::NotFilm`] for anything but a film of this program; [`FilmError::Foreign`] if the film's directory contains other
    /// files; [`FilmError::Recreated`] if another run replaced it meanwhile. Nothing is removed then.
    pub fn remove_film(path: &Path) -> Result<(), FilmError> {
        let target = link_target(path);
        if !Store::at(&target)?.exists()? {
            return Ok(());
        }
        let store = open_store(&target)?;
        let attributes = film_attributes(&store)?;
        let film = FilmSpec::from_attributes(&target, attributes)
            .and_then(|(spec, p)| Self::new(store.clone(), spec, p));
        // Without a readable layout, files are recognized by the names of arrays of any film.
        let (known, arrays) = film.map_or_else(
            |_| (Vec::new(), Vec::new()),
            |film| {
                let known = film.all_shards().map(|(o, b, s)| film.key(o, b, s)).collect();
                let coordinates = film.spec.coordinates().into_iter().map(|(name, _)| name);
                (known, film.spec.outputs.iter().map(|o| o.name.clone()).chain(coordinates).collect())
            },
        );
        let is_own = move |key: &str| is_own(&arrays, key);
        match store.remove_all(known, is_own)? {
            Removal::Done => Ok(()),
            Removal::Foreign(names) => Err(FilmError::Foreign { path: path.into(), names }),
            Removal::Replaced => Err(FilmError::Recreated { path: path.into() }),
        }
    }
}

/// Whether the file `key` belongs to the film whose arrays are `arrays` (coordinates included).
fn is_own(arrays: &[String], key: &str) -> bool {
    let parts: Vec<&str> = key.split('/').collect();
    if parts.iter().any(|part| is_temp_name(part)) {
        return true;
    }
    let array = |name: &str| arrays.iter().any(|array| array == name) || is_array_name(name);
    match parts[..] {
        ["zarr.json"] | ["pyramid", "zarr.json"] => true,
        ["runs", name] => name.ends_with(".lock") || name.ends_with(ENGINE_EXTENSION) || is_record(name),
        ["pyramid", name, "zarr.json"] => array(name),
        ["pyramid", name, level, ref rest @ ..] => array(name) && is_number(level) && in_array(rest),
        [name, ref rest @ ..] => array(name) && in_array(rest),
        [] => false,
    }
}

/// Whether `name` is that of an array of any film, for a film whose attributes cannot be read.
fn is_array_name(name: &str) -> bool {
    let region = |name: &str| name.strip_prefix("roi_").is_some_and(is_number);
    let coordinate = name.strip_suffix("_y").or_else(|| name.strip_suffix("_x"));
    matches!(name, "film" | "wavelength" | "y" | "x") || region(name) || coordinate.is_some_and(region)
}

/// Whether `rest`, below an array, is its metadata or a chunk.
pub(crate) fn in_array(rest: &[&str]) -> bool {
    match rest {
        ["zarr.json"] => true,
        ["c", indices @ ..] => !indices.is_empty() && indices.iter().all(|i| is_number(i)),
        _ => false,
    }
}

/// Whether `name` is that of a record of a run: `SECONDS-HOST-PROCESS.json`.
pub(crate) fn is_record(name: &str) -> bool {
    let Some(name) = name.strip_suffix(".json") else { return false };
    let parts: Vec<&str> = name.split('-').collect();
    matches!(parts[..], [seconds, _, process] if is_number(seconds) && is_number(process))
}

/// Whether `text` consists of decimal digits.
pub(crate) fn is_number(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_a_film_are_distinguished_from_foreign_files() {
        let arrays = ["film".to_owned()];
        for key in [
            "zarr.json",
            "film/zarr.json",
            "film/c/0/1/2",
            "wavelength/c/0",
            "roi_12/c/0/0/0",
            "roi_12_y/c/0",
            "runs/1763740000-host_1-77.json",
            "runs/units-0123456789ab-3-9,12.lock",
            "runs/cuda-sm_90.engine",
            "pyramid/zarr.json",
            "pyramid/film/zarr.json",
            "pyramid/film/2/c/0/0/0",
            "film/c/0/.tmp-host-boot-1-2-3-4",
            ".tmp-host-boot-1-2-3-4/film/1/c/0",
        ] {
            assert!(is_own(&arrays, key), "{key}");
        }
        for foreign in [
            "chart.npy",
            "lens.zip",
            "job.json",
            "film/notes.txt",
            "film/c/readme",
            "film/c",
            "film",
            "roi_x/c/0",
            "roi_1_z/c/0",
            "runs/notes.json",
            "runs/1/2.lock",
            "pyramid/film/notes",
            "pack.lens.zarr/zarr.json",
            ".hidden",
        ] {
            assert!(!is_own(&arrays, foreign), "{foreign}");
        }
    }
}
