//! Which files of a raw's directory the raw made: all that `--overwrite` may remove.

use crate::durable::is_temp_name;
use crate::film::removal::{in_array, is_number, is_record};

/// Whether a raw made the file `key`.
pub(super) fn is_own(key: &str) -> bool {
    let parts: Vec<&str> = key.split('/').collect();
    if parts.iter().any(|part| is_temp_name(part)) {
        return true;
    }
    match parts[..] {
        ["zarr.json"] | ["pyramid", "zarr.json"] => true,
        ["runs", name] => name.ends_with(".lock") || is_record(name),
        ["pyramid", name, "zarr.json"] => is_array(name),
        ["pyramid", name, level, ref rest @ ..] => is_array(name) && is_number(level) && in_array(rest),
        [name, ref rest @ ..] => is_array(name) && in_array(rest),
        [] => false,
    }
}

fn is_array(name: &str) -> bool {
    let window = |name: &str| name.strip_prefix("roi_").is_some_and(is_number);
    let coordinate = name.strip_suffix("_y").or_else(|| name.strip_suffix("_x"));
    let own = matches!(name, "raw" | "signal" | "frame" | "exposure_s" | "y" | "x");
    own || window(name) || coordinate.is_some_and(window)
}

#[cfg(test)]
mod tests {
    use super::is_own;

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
            assert!(is_own(own), "{own}");
        }
        for foreign in [
            "notes.txt",
            "raw/notes",
            "film/c/0/0/0",
            "raw/c",
            "raw/c/x",
            "runs/notes.json",
            "runs/a/b.lock",
            "pyramid/notes",
            "pyramid/film/1/c/0/0/0",
            "pyramid/raw/x/c/0/0/0",
        ] {
            assert!(!is_own(foreign), "{foreign}");
        }
    }
}
