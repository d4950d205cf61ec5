//! Checks that charts in single files share.

use std::fs::File;
use std::path::Path;

use pipeline::bounds;
use serde_json::{Map, Value};

use super::error::ChartError;
use crate::durable::DurableError;

/// The array of an HDF5 file that a chart was opened from.
#[derive(Clone, Debug)]
pub struct FileArray {
    /// Its path in the file.
    pub path: String,
    pub(super) attributes: Map<String, Value>,
}

impl FileArray {
    /// An attribute that is text.
    pub fn text_attribute(&self, key: &str) -> Option<&str> {
        self.attributes.get(key)?.as_str()
    }
}

/// An error of a file header.
pub(super) fn header_error(
    path: &Path,
    what: &'static str,
    expected: impl Into<String>,
    found: impl Into<String>,
) -> ChartError {
    ChartError::Header { path: path.into(), what, expected: expected.into(), found: found.into() }
}

/// Opens a file, which must not be a pipe or device: opening these could wait forever.
pub(super) fn open_regular(path: &Path) -> Result<File, ChartError> {
    match std::fs::metadata(path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Err(ChartError::NotFound { path: path.into() }),
        Err(e) => Err(DurableError::io("look up", path, 0, e).into()),
        Ok(meta) if !meta.is_file() => {
            let found = if meta.is_dir() { "a directory" } else { "a pipe, socket or device" };
            Err(header_error(path, "file", "a regular file; copy the data to one", found))
        }
        Ok(_) => File::open(path).map_err(|e| DurableError::io("open", path, 0, e).into()),
    }
}

/// Checks that every wavelength is within [`bounds::WAVELENGTH_NM`].
pub(super) fn check_wavelengths(path: &Path, nm: &[f64]) -> Result<(), ChartError> {
    bounds::WAVELENGTH_NM.check_all(nm).map_err(|(band, e)| {
        header_error(path, e.bound.name, e.bound.to_string(), format!("{} for band {band}", e.found))
    })
}

/// Checks wavelengths that the caller declares for `bands` bands.
pub(super) fn check_declared_wavelengths(path: &Path, bands: usize, nm: &[f64]) -> Result<(), ChartError> {
    if nm.len() != bands {
        let (expected, found) = (format!("{bands}, one per band"), nm.len().to_string());
        return Err(header_error(path, "number of wavelengths", expected, found));
    }
    check_wavelengths(path, nm)
}
