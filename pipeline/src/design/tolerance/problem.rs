//! Errors of a list of tolerances.

use thiserror::Error;

/// A tolerance that cannot be, with its index in the given list.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{id}: {problem}")]
pub struct ToleranceError {
    /// Index of the tolerance.
    pub index: usize,
    /// Index of the one that it is at odds with.
    pub other: Option<usize>,
    /// Its identifier.
    pub id: String,
    /// What is wrong.
    pub problem: Problem,
}

/// What is wrong with a tolerance, and the way out.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum Problem {
    /// Limits that are not ascending numbers.
    #[error("limits {low} to {high}: expected two numbers, the lower one first")]
    Limits {
        /// Lower limit.
        low: f64,
        /// Upper limit.
        high: f64,
    },
    /// A surface that the lens does not have, or that cannot have this error.
    #[error("surface {surface}: expected {expected}")]
    Surface {
        /// Its number.
        surface: usize,
        /// The surfaces that it may be.
        expected: String,
    },
    /// The film in place of a surface.
    #[error("surface {surface} is the film: name surfaces before it; the film has errors of its own")]
    Film {
        /// Its number.
        surface: usize,
    },
    /// A range whose last surface is before its first.
    #[error("surfaces {first} to {last}: expected the first surface first")]
    Order {
        /// First surface.
        first: usize,
        /// Last surface.
        last: usize,
    },
    /// Two elements that share surfaces, neither of which contains the other.
    #[error(
        "its surfaces cross those of `{other}` and neither range contains the other: give a group all surfaces of its elements"
    )]
    Crossing {
        /// Identifier of the other one.
        other: String,
    },
    /// Two errors of one parameter.
    #[error("`{other}` draws the same parameter: keep one of them")]
    Twice {
        /// Identifier of the other one.
        other: String,
    },
    /// A glass error of air, or behind a mirror.
    #[error("there is no glass behind surface {surface}: name the surface in front of a glass")]
    NoGlass {
        /// Its number.
        surface: usize,
    },
    /// A radius of a plane in µm or percent.
    #[error("surface {surface} is flat and has no radius: give the error in fringes (`radius_fringes`)")]
    Flat {
        /// Its number.
        surface: usize,
    },
    /// Fringes on a surface of unknown size.
    #[error(
        "the design gives surface {surface} no semi-diameter, over which fringes and waves count: give it one"
    )]
    NoSemiDiameter {
        /// Its number.
        surface: usize,
    },
    /// An error that this kind of target does not have.
    #[error("this part has no such error")]
    Kind,
    /// A pivot that is not a number.
    #[error("pivot offset {offset_mm} mm: expected a number")]
    Offset {
        /// As given.
        offset_mm: f64,
    },
    /// A Zernike term that is not a figure error.
    #[error("Zernike term {term}: expected 4 to 231 (1 is piston, 2 and 3 are tilts)")]
    Term {
        /// Its number.
        term: u32,
    },
}
