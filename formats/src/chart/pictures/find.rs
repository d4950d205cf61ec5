//! The files of a folder or pattern.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::names::natural_order;
use super::{ChartError, DurableError, header_error, name_of};

/// Extensions of pictures in a folder.
const EXTENSIONS: [&str; 3] = ["png", "tif", "tiff"];
/// Metadata of Zarr stores.
const ZARR_FILES: [&str; 3] = ["zarr.json", ".zgroup", ".zarray"];

/// Format of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Png,
    Tiff,
}

/// Pictures in the order of the bands.
pub(super) struct Found {
    pub(super) paths: Vec<PathBuf>,
    /// Files in the folder that are not pictures.
    pub(super) ignored: usize,
}

/// The format by the first bytes.
pub(super) fn kind(path: &Path) -> Result<Kind, ChartError> {
    let mut first = Vec::new();
    let file = File::open(path).map_err(|e| DurableError::io("open", path, 0, e))?;
    file.take(8).read_to_end(&mut first).map_err(|e| DurableError::io("read", path, 0, e))?;
    match &first[..] {
        [0x89, b'P', b'N', b'G', ..] => Ok(Kind::Png),
        [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Ok(Kind::Tiff),
        _ => Err(header_error(path, "first bytes", "those of a PNG or TIFF picture", "something else")),
    }
}

/// Whether `spec` has wildcards and is not the name of a file.
pub(super) fn is_pattern(spec: &str) -> bool {
    spec.contains(['*', '?', '[']) && !Path::new(spec).exists() && !crate::durable::is_url(Path::new(spec))
}

/// Whether `path` is a folder with pictures that is not a Zarr store.
pub(super) fn is_folder(path: &Path) -> bool {
    path.is_dir()
        && !ZARR_FILES.iter().any(|f| path.join(f).exists())
        && std::fs::read_dir(path).is_ok_and(|entries| entries.flatten().any(|e| is_picture(&e.path())))
}

fn is_picture(path: &Path) -> bool {
    let known = |e: &std::ffi::OsStr| EXTENSIONS.iter().any(|known| e.eq_ignore_ascii_case(known));
    path.extension().is_some_and(known) && !name_of(path).starts_with('.') && path.is_file()
}

/// The pictures of a folder or pattern.
pub(super) fn pictures(spec: &str) -> Result<Found, ChartError> {
    let path = Path::new(spec);
    let mut found = Found { paths: Vec::new(), ignored: 0 };
    if path.is_dir() {
        let failed = |e| DurableError::io("list", path, 0, e);
        for entry in std::fs::read_dir(path).map_err(failed)? {
            match entry.map_err(failed)?.path() {
                picture if is_picture(&picture) => found.paths.push(picture),
                other => found.ignored += usize::from(other.is_file()),
            }
        }
    } else {
        let invalid =
            |e: glob::PatternError| header_error(path, "pattern", "a pattern such as 'FOLDER/*.png'", e.msg);
        for entry in glob::glob(spec).map_err(invalid)? {
            let entry = entry.map_err(|e| DurableError::io("list", path, 0, e.into()))?;
            if entry.is_file() {
                found.paths.push(entry);
            }
        }
    }
    if found.paths.is_empty() {
        return Err(header_error(
            path,
            "pictures",
            "PNG or TIFF files, one per band",
            "no file of that name",
        ));
    }
    found.paths.sort_by(|a, b| natural_order(&name_of(a), &name_of(b)).then_with(|| a.cmp(b)));
    Ok(found)
}
