//! Errors of chart specifications.

use crate::colour::{FIRST_NM, LAST_NM};
use crate::wavelengths::WavelengthError;

/// A chart specification that cannot be drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ChartError {
    /// Unknown kind.
    #[error("no generated chart is called '{name}'; did you mean '{nearest}'? Kinds: {valid}")]
    UnknownKind {
        /// The given name.
        name: String,
        /// The kind of the nearest name.
        nearest: &'static str,
        /// All kinds.
        valid: String,
    },
    /// Unknown setting.
    #[error("a {kind} chart has no setting '{name}'; did you mean '{nearest}'? Settings: {valid}")]
    UnknownKey {
        /// The chart's kind.
        kind: &'static str,
        /// The given name.
        name: String,
        /// The setting of the nearest name.
        nearest: &'static str,
        /// All settings of this kind.
        valid: String,
    },
    /// Text between `&` without `=`.
    #[error("'{text}' in the chart's settings is not key=value; write KIND?key=value&key=value")]
    NotASetting {
        /// The text.
        text: String,
    },
    /// A repeated setting.
    #[error("the chart's setting '{key}' is given twice")]
    Twice {
        /// The setting.
        key: String,
    },
    /// A value that the setting does not admit.
    #[error("chart setting {key}={value}: it must be {expected}")]
    BadValue {
        /// The setting.
        key: &'static str,
        /// The given value.
        value: String,
        /// The admissible values.
        expected: String,
    },
    /// An invalid list of wavelengths.
    #[error("chart setting wavelengths: {0}")]
    Wavelengths(#[from] WavelengthError),
    /// A wavelength beyond the tables of reflectance and illuminants.
    #[error(
        "the colours of the chart are tabulated from {FIRST_NM} to {LAST_NM} nm, not at {wavelength_nm} nm; only the uniform chart has no such limit"
    )]
    NoColour {
        /// The requested wavelength.
        wavelength_nm: f64,
    },
    /// Details too close to each other.
    #[error(
        "{count} {what} are {spacing_px:.1} px apart and need {needed_px:.1} px: reduce the number or size, or enlarge the film"
    )]
    Crowded {
        /// Name of the details.
        what: &'static str,
        /// Their number, along a side or in all.
        count: usize,
        /// Their distance in pixels.
        spacing_px: f64,
        /// The distance they need.
        needed_px: f64,
    },
}

/// [`ChartError::BadValue`].
pub(super) fn bad_value(key: &'static str, value: &str, expected: &str) -> ChartError {
    ChartError::BadValue { key, value: value.into(), expected: expected.into() }
}
