//! Flags of ghosts.

use super::values::number;
use clap::{Args, ValueEnum};
use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};

/// Group of the flags of a job in help.
const HEADING: &str = "Light beside the image";
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

/// Light of two reflections. Without flags as by default: none.
#[derive(Clone, Debug, Default, PartialEq, Args)]
pub struct GhostArgs {
    /// Light that two surfaces of the lens reflect, or the film and one of them: of a design with --coatings, or of a pack that has it
    #[arg(long, value_enum, default_value_t = Switch::Off, help_heading = HEADING)]
    pub ghosts: Switch,
    /// Share that the film reflects like a mirror, for its ghosts: a number (0.05, 5%) or a table `wavelength_nm,reflectance` (.csv) [default: 0]
    #[arg(long, value_name = "R|FILE", value_parser = reflectance, help_heading = HEADING)]
    pub sensor_reflectance: Option<ReflectanceArg>,
    /// Rings from the axis to the film's corner on which ghosts are computed, 16 to 256: details below two rings are blurred to them [default: 64]
    #[arg(long, value_name = "N", value_parser = rings, help_heading = HEADING)]
    pub ghost_rings: Option<usize>,
}

/// `--ghosts`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Switch {
    /// None
    #[default]
    Off,
    /// All paths of two reflections
    On,
}

impl GhostArgs {
    /// Whether there are ghosts.
    pub fn is_on(&self) -> bool {
        self.ghosts == Switch::On
    }

    /// The table of the film's reflectance, if it is given as one.
    pub fn reflectance_file(&self) -> Option<&Path> {
        match &self.sensor_reflectance {
            Some(ReflectanceArg::File(path)) => Some(path),
            _ => None,
        }
    }

    /// A flag of how ghosts are traced that is given, if one is.
    pub fn tracing_flag(&self) -> Option<&'static str> {
        let flags = [
            ("--sensor-reflectance", self.sensor_reflectance.is_some()),
            ("--ghost-rings", self.ghost_rings.is_some()),
        ];
        flags.into_iter().find(|(_, is_given)| *is_given).map(|(flag, _)| flag)
    }

    /// What is wrong with a flag that is given without ghosts, if one is.
    pub fn contradiction(&self) -> Option<String> {
        let flag = self.tracing_flag().filter(|_| !self.is_on())?;
        Some(format!("{flag} requires --ghosts on"))
    }
}
