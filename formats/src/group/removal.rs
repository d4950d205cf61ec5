//! The files that belong to a film, raw or scene: all that `--overwrite` may remove.
//!
//!   zarr.json                           the group
//!   NAME/zarr.json, NAME/c/…            its arrays and coordinates
//!   pyramid/…                           the same of its levels
//!   hidden/1/…                          the same of a scene's hidden surfaces
//!   runs/…                              records and locks of runs, marks of engines
//!   .tmp-…                              temporary files, anywhere

use super::kind::{GroupKind, LAYER_NAMES};
use crate::durable::is_temp_name;

/// Extension of the marks of engines.
pub(crate) const ENGINE_EXTENSION: &str = ".engine";

/// Whether the file `key` belongs to the group whose arrays are `arrays` (coordinates included).
pub(super) fn is_own(kind: GroupKind, arrays: &[String], key: &str) -> bool {
    let parts: Vec<&str> = key.split('/').collect();
    if parts.iter().any(|part| is_temp_name(part)) {
        return true;
    }
    let array = |name: &str| arrays.iter().any(|array| array == name) || is_array_name(kind, name);
    match parts[..] {
        ["zarr.json"] | ["pyramid", "zarr.json"] => true,
        ["runs", name] => {
            let engine = kind == GroupKind::Film && name.ends_with(ENGINE_EXTENSION);
            engine || name.ends_with(".lock") || is_record(name)
        }
        ["pyramid", name, "zarr.json"] => array(name),
        ["pyramid", name, level, ref rest @ ..] => array(name) && is_number(level) && in_array(rest),
        ["hidden", "zarr.json"] => kind == GroupKind::Scene,
        ["hidden", number, ref rest @ ..] if kind == GroupKind::Scene && is_number(number) => match rest {
            ["zarr.json"] => true,
            [name, rest @ ..] => array(name) && in_array(rest),
            [] => false,
        },
        [name, ref rest @ ..] => array(name) && in_array(rest),
        [] => false,
    }
}

/// Whether `name` is that of an array of any group of a kind, for a group whose attributes cannot be read.
fn is_array_name(kind: GroupKind, name: &str) -> bool {
    let region = |name: &str| name.strip_prefix("roi_").is_some_and(is_number);
    let invented = kind == GroupKind::Film && name.strip_suffix("_invented").is_some_and(region);
    let coordinate = name.strip_suffix("_y").or_else(|| name.strip_suffix("_x"));
    let own = match kind {
        GroupKind::Film => {
            matches!(name, "film" | "invented" | "wavelength" | "y" | "x") || LAYER_NAMES.contains(&name)
        }
        GroupKind::Raw => matches!(name, "raw" | "signal" | "frame" | "exposure_s" | "y" | "x"),
        GroupKind::Scene => matches!(name, "weights" | "depth" | "coverage" | "object" | "basis" | "y" | "x"),
    };
    own || invented || region(name) || coordinate.is_some_and(region)
}

/// Whether `rest`, below an array, is its metadata or a chunk.
fn in_array(rest: &[&str]) -> bool {
    match rest {
        ["zarr.json"] => true,
        ["c", indices @ ..] => !indices.is_empty() && indices.iter().all(|i| is_number(i)),
        _ => false,
    }
}

/// Whether `name` is that of a record of a run: `SECONDS-HOST-PROCESS.json`.
fn is_record(name: &str) -> bool {
    let Some(name) = name.strip_suffix(".json") else { return false };
    let parts: Vec<&str> = name.split('-').collect();
    matches!(parts[..], [seconds, _, process] if is_number(seconds) && is_number(process))
}

/// Whether `text` consists of decimal digits.
fn is_number(text: &str) -> bool {
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
            "veil/c/3/0/0",
            "veil_tail/zarr.json",
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
            assert!(is_own(GroupKind::Film, &arrays, key), "{key}");
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
            assert!(!is_own(GroupKind::Film, &arrays, foreign), "{foreign}");
        }
    }

    #[test]
    fn files_of_a_raw_are_distinguished_from_others() {
        for own in [
            "zarr.json",
            "raw/zarr.json",
            "raw/c/0/1/2",
            "signal/c/0/0",
            "roi_3/c/0/0/0",
            "roi_3_x/c/0",
            "exposure_s/c/0",
            "runs/whole.lock",
            "runs/17-h-3.json",
            "raw/c/0/.tmp-x",
            "pyramid/zarr.json",
            "pyramid/raw/zarr.json",
            "pyramid/roi_2/1/zarr.json",
            "pyramid/raw/3/c/0/1/2",
        ] {
            assert!(is_own(GroupKind::Raw, &[], own), "{own}");
        }
        for foreign in [
            "notes.txt",
            "raw/notes",
            "film/c/0/0/0",
            "raw/c",
            "raw/c/x",
            "runs/notes.json",
            "runs/cuda-sm_90.engine",
            "runs/a/b.lock",
            "pyramid/notes",
            "pyramid/film/1/c/0/0/0",
            "pyramid/raw/x/c/0/0/0",
        ] {
            assert!(!is_own(GroupKind::Raw, &[], foreign), "{foreign}");
        }
    }

    #[test]
    fn files_of_a_scene_are_distinguished_from_others() {
        for own in [
            "weights/c/2/0/1",
            "depth/zarr.json",
            "hidden/zarr.json",
            "hidden/1/zarr.json",
            "hidden/2/coverage/c/0/3",
            "object/c/0/0",
            "basis/c/0",
            "runs/whole.lock",
        ] {
            assert!(is_own(GroupKind::Scene, &[], own), "{own}");
        }
        for foreign in
            ["hidden/x/depth/c/0/0", "hidden/1/notes", "hidden/1/chart/c/0/0/0", "film/zarr.json", "hidden"]
        {
            assert!(!is_own(GroupKind::Scene, &[], foreign), "{foreign}");
        }
        assert!(!is_own(GroupKind::Film, &[], "hidden/1/depth/c/0/0"));
    }
}
