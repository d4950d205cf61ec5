//! Which files of a film's directory the film made: all that `--overwrite` may remove.
//!
//!   zarr.json                           the group
//!   NAME/zarr.json, NAME/c/…            its arrays and coordinates
//!   pyramid/…                           the same of its levels
//!   runs/…                              records and locks of runs
//!   .tmp-…                              what a process was writing, anywhere

use crate::durable::is_temp_name;

/// Whether the film whose arrays are `arrays` (coordinates included) made the file `key`.
pub(super) fn is_own(arrays: &[String], key: &str) -> bool {
    let parts: Vec<&str> = key.split('/').collect();
    if parts.iter().any(|part| is_temp_name(part)) {
        return true;
    }
    let array = |name: &str| arrays.iter().any(|own| own == name) || is_array(name);
    match parts[..] {
        ["zarr.json"] | ["pyramid", "zarr.json"] => true,
        ["runs", name] => name.ends_with(".lock") || is_record(name),
        ["pyramid", name, "zarr.json"] => array(name),
        ["pyramid", name, level, ref rest @ ..] => array(name) && is_number(level) && in_array(rest),
        [name, ref rest @ ..] => array(name) && in_array(rest),
        [] => false,
    }
}

/// Arrays of any film, for one whose attributes cannot be read.
fn is_array(name: &str) -> bool {
    let window = |name: &str| name.strip_prefix("roi_").is_some_and(is_number);
    let coordinate = name.strip_suffix("_y").or_else(|| name.strip_suffix("_x"));
    matches!(name, "film" | "wavelength" | "y" | "x") || window(name) || coordinate.is_some_and(window)
}

fn in_array(rest: &[&str]) -> bool {
    match rest {
        ["zarr.json"] => true,
        ["c", indices @ ..] => !indices.is_empty() && indices.iter().all(|i| is_number(i)),
        _ => false,
    }
}

/// `SECONDS-HOST-PROCESS.json`.
fn is_record(name: &str) -> bool {
    let Some(name) = name.strip_suffix(".json") else { return false };
    let parts: Vec<&str> = name.split('-').collect();
    matches!(parts[..], [seconds, _, process] if is_number(seconds) && is_number(process))
}

fn is_number(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_a_film_are_distinguished_from_others() {
        let arrays = ["film".to_owned()];
        for own in [
            "zarr.json",
            "film/zarr.json",
            "film/c/0/1/2",
            "wavelength/c/0",
            "roi_12/c/0/0/0",
            "roi_12_y/c/0",
            "runs/1763740000-host_1-77.json",
            "runs/units-0123456789ab-3-9,12.lock",
            "pyramid/zarr.json",
            "pyramid/film/zarr.json",
            "pyramid/film/2/c/0/0/0",
            "film/c/0/.tmp-host-boot-1-2-3-4",
            ".tmp-host-boot-1-2-3-4/film/1/c/0",
        ] {
            assert!(is_own(&arrays, own), "{own}");
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
