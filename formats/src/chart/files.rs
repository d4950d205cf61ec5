//! The files of a chart by its name on the command line, found without opening it.

use std::path::{Path, PathBuf};

use super::open::split_array;
use super::{any, pictures, raster};
use crate::durable::is_url;

/// Metadata of Zarr groups and arrays.
const ZARR_FILES: [&str; 5] = ["zarr.json", ".zgroup", ".zarray", ".zattrs", ".zmetadata"];

/// Files and directories that the chart `spec` (`PATH`, `PATH//array`, a pattern of pictures) is read from: both files of ENVI, each picture
/// of a pattern, and of an array inside a Zarr store the metadata of the groups above it. A path that does not exist is returned as it is; of
/// `gen:KIND?…` there are none.
pub fn files_of(spec: &str) -> Vec<PathBuf> {
    if spec.starts_with("gen:") {
        return Vec::new();
    }
    let group = spec.rsplit_once("//").map(|(group, _)| Path::new(group)).filter(|group| is_zarr(group));
    let path = group.unwrap_or(Path::new(split_array(spec).0));
    if is_url(path) {
        return vec![path.into()];
    }
    if let Some(files) = pictures::files_of_pattern(spec) {
        return files;
    }
    let beside = if path.is_dir() || any::is_one_file(path) { None } else { raster::beside(path) };
    [path.into()].into_iter().chain(beside).chain(metadata_above(path)).collect()
}

/// Whether a directory is a Zarr group or array.
fn is_zarr(directory: &Path) -> bool {
    ZARR_FILES.iter().any(|name| directory.join(name).is_file())
}

/// Metadata of the Zarr groups that the directory `path` lies in.
fn metadata_above(path: &Path) -> Vec<PathBuf> {
    let Ok(real) = path.canonicalize() else { return Vec::new() };
    let groups = real.ancestors().skip(1).take_while(|directory| is_zarr(directory));
    let files = groups.flat_map(|group| ZARR_FILES.map(|name| group.join(name)));
    files.filter(|file| file.is_file()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn headers_data_pictures_and_metadata_belong_to_a_chart() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().canonicalize().unwrap();
        let at = |name: &str| root.join(name);
        fs::create_dir_all(at("s.zarr/group/a")).unwrap();
        let names = ["c.hdr", "c.img", "c.tif", "d.npy", "d.hdr", "450.png", "500.png", "s.zarr/zarr.json"];
        for name in names.iter().chain(&["s.zarr/group/zarr.json", "s.zarr/group/a/zarr.json"]) {
            fs::write(at(name), if name.ends_with(".tif") { "II*\0" } else { "" }).unwrap();
        }
        for (spec, expected) in [
            ("c.hdr", &["c.hdr", "c.img"][..]),
            ("c.img", &["c.img", "c.hdr"]),
            ("c.tif", &["c.tif"]),
            ("d.npy", &["d.npy", "d.npy.attributes.json"]),
            ("*.png", &["450.png", "500.png"]),
            ("s.zarr", &["s.zarr"]),
            ("s.zarr//group/a", &["s.zarr"]),
            ("s.zarr/group/a", &["s.zarr/group/a", "s.zarr/group/zarr.json", "s.zarr/zarr.json"]),
            ("nowhere.zarr//a", &["nowhere.zarr"]),
        ] {
            let expected: Vec<_> = expected.iter().map(|name| at(name)).collect();
            assert_eq!(files_of(&format!("{}/{spec}", root.display())), expected, "{spec}");
        }
        assert_eq!(files_of("gen:uniform?size=9"), Vec::<PathBuf>::new());
        assert_eq!(files_of("s3://b/f.zarr//film"), [PathBuf::from("s3://b/f.zarr")]);
    }
}
