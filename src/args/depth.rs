//! Values of the depth flags.

use super::RunArgs;
use crate::failure::usage;
use anyhow::Result;

/// `--depth-unit`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the variants are the values of the flag")]
pub enum DepthUnit {
    Metre,
    Centimetre,
    Millimetre,
}

impl DepthUnit {
    /// The unit with the symbol `text`.
    pub fn from_symbol(text: &str) -> Option<Self> {
        match text {
            "m" => Some(Self::Metre),
            "cm" => Some(Self::Centimetre),
            "mm" => Some(Self::Millimetre),
            _ => None,
        }
    }

    /// Metres per unit.
    pub fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 1e-2,
            Self::Millimetre => 1e-3,
        }
    }
}

/// `--depth-kind`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthKind {
    /// Along the optical axis.
    Planar,
    /// Along the ray from the entrance pupil.
    Ray,
}

/// `--depth-miss`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthMiss {
    /// An error.
    Error,
    /// Infinity.
    Far,
}

/// `--hidden none`.
pub const NO_HIDDEN: &str = "none";

impl RunArgs {
    /// The surfaces of `--hidden`.
    ///
    /// # Errors
    /// `none` beside others.
    pub fn given_hidden(&self) -> Result<&[String]> {
        match &self.hidden[..] {
            [only] if only == NO_HIDDEN => Ok(&[]),
            all if all.iter().any(|group| group == NO_HIDDEN) => {
                Err(usage(format!("--hidden {NO_HIDDEN} beside other surfaces: expected one or the other")))
            }
            all => Ok(all),
        }
    }
}
