//! The reflectance of a film: `--sensor-reflectance`.

use crate::args::ReflectanceArg;
use anyhow::{Context, Result};
use formats::sensor::film_reflectance;
use pipeline::design::ghost::options::Reflectance;

/// The reflectance that the flag gives; a table is read.
///
/// # Errors
/// A file that cannot be read or is no table of ascending wavelengths and reflectances.
pub fn reflectance(given: &ReflectanceArg) -> Result<Reflectance> {
    let path = match given {
        ReflectanceArg::Number(share) => return Ok(Reflectance(vec![(0.0, *share)])),
        ReflectanceArg::File(path) => path,
    };
    let curve = film_reflectance(path).with_context(|| format!("--sensor-reflectance {}", path.display()))?;
    Ok(Reflectance(curve.wavelengths_nm.into_iter().zip(curve.values).collect()))
}
