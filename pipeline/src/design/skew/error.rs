//! Errors of built lenses, and of their maps.

use thiserror::Error;

use crate::design::prescription::error::{DesignError, tidy};

/// A built lens that cannot be traced, or has no map.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum SkewError {
    /// Of its design, or of one of its rays.
    #[error(transparent)]
    Design(#[from] DesignError),
    /// An error that does not fit the design.
    #[error("the error of {what} {problem}")]
    Deviation {
        /// What has the error.
        what: String,
        /// What is wrong, and what is expected.
        problem: String,
    },
    /// A part of the design that lenses without symmetry do not have.
    #[error("surface {surface} has {part}, which is not supported in lenses without rotational symmetry")]
    Unsupported {
        /// Number of the surface, from 1.
        surface: usize,
        /// The part.
        part: &'static str,
    },
    /// A place of the film that no chief ray reaches.
    #[error(
        "no chief ray lands at ({x_mm:.4}, {y_mm:.4}) mm of the film at {um} µm: {problem}; use a smaller film",
        um = tidy(.wavelength_um)
    )]
    Place {
        /// Film place, mm.
        x_mm: f64,
        /// Film place, mm.
        y_mm: f64,
        /// Wavelength, µm.
        wavelength_um: f64,
        /// Why.
        problem: String,
    },
    /// Light whose directions at the film are not those of a cone in front of it.
    #[error("directions of the light at the film at {um} µm: {problem}", um = tidy(.wavelength_um))]
    Cones {
        /// Wavelength, µm.
        wavelength_um: f64,
        /// What is expected and found.
        problem: String,
    },
    /// Two places of the film that show the same field point.
    #[error(
        "the map from film to ideal plane folds at ({x_mm:.4}, {y_mm:.4}) mm at {um} µm; use a smaller film",
        um = tidy(.wavelength_um)
    )]
    Folds {
        /// Film place, mm.
        x_mm: f64,
        /// Film place, mm.
        y_mm: f64,
        /// Wavelength, µm.
        wavelength_um: f64,
    },
    /// A place of the film beyond the map.
    #[error(
        "({x_mm:.4}, {y_mm:.4}) mm of the film lies beyond the map of the lens; use a smaller film or a lens pack with more field"
    )]
    Beyond {
        /// Film place, mm.
        x_mm: f64,
        /// Film place, mm.
        y_mm: f64,
    },
}
