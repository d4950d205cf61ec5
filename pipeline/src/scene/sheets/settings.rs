//! What sheets are made of a scene.

use crate::scratch::ScratchError;
use std::fmt;

/// Light behind all surfaces.
#[derive(Clone, Debug, PartialEq)]
pub struct Background {
    /// Its vergence, 1/m; 0 is infinity.
    pub vergence: f64,
    /// Its weights, one per basis, that are the same in all directions.
    pub weights: Vec<f64>,
}

/// Samples, sheets and limits.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Samples per pixel: 1, 4, 16 or 64.
    pub samples: usize,
    /// Largest number of sheets, 1 to 8.
    pub sheets: usize,
    /// Surfaces whose vergences differ by no more are one sheet, 1/m.
    pub gap_dioptre: f64,
    /// Samples that see a nearer surface are counted, m.
    pub near_m: f64,
    /// Surfaces nearer than `near_m` are left out.
    pub is_near_cut: bool,
    /// Light where no surface is; `None`: black.
    pub background: Option<Background>,
}

/// Largest number of sheets.
pub(super) const MAX_SHEETS: usize = 8;

/// Settings that no sheets can have.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum SettingsError {
    /// Not 1, 4, 16 or 64.
    Samples(usize),
    /// Not 1 to 8.
    Sheets(usize),
    /// Negative or not finite, 1/m.
    Gap(f64),
    /// Negative or not finite, m.
    Near(f64),
    /// A background of another number of weights, or of a vergence or weight that is negative or not finite.
    Background {
        /// Bases of the shader.
        bases: usize,
    },
    /// The chart has no pixels, or a length or scale of it is not positive.
    Frame,
    /// There is no disk space for lists of triangles that do not fit into memory.
    Scratch(ScratchError),
}

impl fmt::Display for SettingsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Samples(n) => write!(f, "{n} samples per pixel, expected 1, 4, 16 or 64"),
            Self::Sheets(n) => write!(f, "{n} sheets, expected 1 to {MAX_SHEETS}"),
            Self::Gap(gap) => write!(f, "a gap of {gap} dioptres, expected 0 or more"),
            Self::Near(near) => write!(f, "a nearest distance of {near} m, expected 0 or more"),
            Self::Background { bases } => {
                write!(f, "the background must have a vergence and {bases} weights of 0 or more")
            }
            Self::Frame => f.write_str("the chart has no pixels, or a length or scale of it is not positive"),
            Self::Scratch(e) => e.fmt(f),
        }
    }
}

impl std::error::Error for SettingsError {}

impl Settings {
    /// Checks all but the number of samples, for a shader of `bases` bases.
    pub(super) fn check(&self, bases: usize) -> Result<(), SettingsError> {
        let is_valid = |v: f64| v >= 0.0 && v.is_finite();
        if !(1..=MAX_SHEETS).contains(&self.sheets) {
            return Err(SettingsError::Sheets(self.sheets));
        }
        if !is_valid(self.gap_dioptre) {
            return Err(SettingsError::Gap(self.gap_dioptre));
        }
        if !is_valid(self.near_m) {
            return Err(SettingsError::Near(self.near_m));
        }
        match &self.background {
            Some(b)
                if b.weights.len() != bases
                    || ![b.vergence].iter().chain(&b.weights).all(|&v| is_valid(v)) =>
            {
                Err(SettingsError::Background { bases })
            }
            _ => Ok(()),
        }
    }
}
