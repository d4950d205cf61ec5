//! Flags of ghosts.

use super::values::number;
use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

/// Rings to the film's corner by default.
pub const RINGS: usize = 64;

/// `--sensor-reflectance`.
#[derive(Clone, Debug, PartialEq)]
pub enum ReflectanceArg {
    /// At all wavelengths.
    Number(f64),
    /// A table `wavelength_nm,reflectance`.
    File(PathBuf),
}

impl Default for ReflectanceArg {
    fn default() -> Self {
        Self::Number(0.0)
    }
}

impl Display for ReflectanceArg {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(share) => share.fmt(f),
            Self::File(path) => path.display().fmt(f),
        }
    }
}

/// A reflectance from 0 to below 1, as a share or in %, or a file.
pub(super) fn reflectance(text: &str) -> Result<ReflectanceArg, String> {
    let share = match text.strip_suffix('%') {
        Some(percent) => number(percent)? / 100.0,
        None if text.ends_with(".csv") => return Ok(ReflectanceArg::File(text.into())),
        None => number(text).map_err(|e| format!("{e}, nor a file (.csv)"))?,
    };
    match (0.0..1.0).contains(&share) {
        true => Ok(ReflectanceArg::Number(share)),
        false => Err(format!("{text} is no reflectance from 0 to below 1")),
    }
}

/// Rings to the film's corner.
pub(super) fn rings(text: &str) -> Result<usize, String> {
    let rings = text.trim().parse().ok().filter(|n| (16..=256).contains(n));
    rings.ok_or_else(|| "expected a number of rings from 16 to 256".to_owned())
}
