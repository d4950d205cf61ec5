//! What can go wrong between a prescription and its tables.

use thiserror::Error;

/// A design that cannot be read or traced.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum DesignError {
    /// A line of a .zmx file that is wrong, or that would change the optics and is not understood.
    #[error("line {line} of the design: `{text}`: {problem}")]
    Line {
        /// Line number from 1.
        line: usize,
        /// The line.
        text: String,
        /// What is wrong, and the way out.
        problem: String,
    },
    /// The whole prescription lacks something.
    #[error("the design {problem}")]
    Incomplete {
        /// What it lacks.
        problem: String,
    },
    /// A line of a glass catalogue that is wrong.
    #[error("line {line} of the glass catalogue: {problem}")]
    Catalogue {
        /// Line number from 1.
        line: usize,
        /// What is wrong.
        problem: String,
    },
    /// A glass that no catalogue at hand holds.
    #[error("no glass `{name}` in the catalogues at hand{}; give its catalogue (.agf)", nearest_words(.nearest))]
    UnknownGlass {
        /// The name in the design.
        name: String,
        /// The nearest names known.
        nearest: Vec<String>,
    },
    /// A wavelength outside the range that a glass's formula is good for.
    #[error("{wavelength_um} µm lies outside the {first_um}..{last_um} µm that glass {glass} is known for")]
    Wavelength {
        /// The glass.
        glass: String,
        /// Wanted, µm.
        wavelength_um: f64,
        /// First of the glass, µm.
        first_um: f64,
        /// Last of the glass, µm.
        last_um: f64,
    },
    /// The paraxial system has no finite focal length, pupil or image.
    #[error("the design has no usable {what} at {wavelength_um} µm: {problem}")]
    Paraxial {
        /// Which figure.
        what: &'static str,
        /// Wavelength, µm.
        wavelength_um: f64,
        /// Why.
        problem: String,
    },
    /// A ray that the tables need does not reach the image.
    #[error(
        "the ray at pupil ({px:.4}, {py:.4}) of the field point at tan(angle) = {field_tan:.6}, {wavelength_um} µm, {problem}; use a smaller field, or real ray aiming"
    )]
    Ray {
        /// Pupil coordinates.
        px: f64,
        /// Pupil coordinates.
        py: f64,
        /// Tangent of the field angle.
        field_tan: f64,
        /// Wavelength, µm.
        wavelength_um: f64,
        /// What happened, and at which surface.
        problem: String,
    },
    /// The lens does not reach a height that was asked for.
    #[error(
        "the lens reaches no further than {reached_mm:.4} mm of real image height at {wavelength_um} µm, {wanted_mm:.4} mm asked for: {problem}"
    )]
    Height {
        /// Wanted, mm.
        wanted_mm: f64,
        /// Reached, mm.
        reached_mm: f64,
        /// Wavelength, µm.
        wavelength_um: f64,
        /// Why.
        problem: String,
    },
    /// An option that makes no sense.
    #[error("{option} is {value}, expected {expected}")]
    Option {
        /// Which option.
        option: &'static str,
        /// Its value.
        value: String,
        /// What would do.
        expected: &'static str,
    },
    /// The receiver of the traced bands refused one.
    #[error("storing the band at {wavelength_nm} nm: {problem}")]
    Sink {
        /// The band.
        wavelength_nm: f64,
        /// In the receiver's words.
        problem: String,
    },
}

fn nearest_words(nearest: &[String]) -> String {
    if nearest.is_empty() { String::new() } else { format!(" (nearest: {})", nearest.join(", ")) }
}
