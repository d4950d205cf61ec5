//! The spectrum of white light, and spectra of tables.

use crate::args::SceneArgs;
use crate::failure::usage;
use anyhow::{Context, Result};
use formats::sensor::relative_power;
use pipeline::colour::Illuminant;
use pipeline::scene::weights::{SceneIlluminant, Spectrum};
use pipeline::sensor::Curve;
use std::path::Path;

/// The spectrum of a table in the file `file`, of values up to `max`.
///
/// # Errors
/// Values beyond it.
pub fn spectrum(file: &Path, curve: Curve, max: f64) -> Result<Spectrum> {
    let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy();
    Ok(Spectrum::new(name, curve.wavelengths_nm, curve.values, max)?)
}

/// The spectrum of white light.
///
/// # Errors
/// Neither a known illuminant nor a table that can be read.
pub fn illuminant(args: &SceneArgs) -> Result<SceneIlluminant> {
    let text = &args.look.illuminant;
    match args.look.illuminant_file() {
        None => {
            let light = text.parse::<Illuminant>().map_err(|e| usage(format!("--illuminant {text}: {e}")))?;
            Ok(SceneIlluminant::Cie(light))
        }
        Some(path) => {
            let flag = || format!("--illuminant {text}");
            let curve = relative_power(path).with_context(flag)?;
            Ok(SceneIlluminant::Measured(spectrum(path, curve, f64::INFINITY).with_context(flag)?))
        }
    }
}
