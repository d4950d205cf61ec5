//! Checks that charts in single files share.

use std::path::Path;

use pipeline::bounds;

use super::error::ChartError;

/// An error of a file header.
pub(super) fn header_error(
    path: &Path,
    what: &'static str,
    expected: impl Into<String>,
    found: impl Into<String>,
) -> ChartError {
    ChartError::Header { path: path.into(), what, expected: expected.into(), found: found.into() }
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
