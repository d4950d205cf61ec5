//! Units in the names of columns and settings: `radius (cm)`, `object distance [m]`, `wavelengths (nm)`.
//!
//! Values are read in the unit of the table, degrees or nm. A name with another unit is an error, not a conversion.

use super::line::Line;
use crate::design::error::LensFileError;

/// A unit by its name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Unit {
    /// A length, mm; also of its powers, such as 1/mm.
    Length(f64),
    Degrees,
    /// Another unit of angles.
    Angle,
}

/// The unit that a name ends with; none without brackets, or if they hold something else.
pub(super) fn unit_of(name: &str) -> Option<Unit> {
    let name = name.to_lowercase();
    let name = name.trim().trim_end_matches(':').trim();
    let Some(start) = name.find(['(', '[']) else {
        return name.ends_with(" mm").then_some(Unit::Length(1.0));
    };
    let inner = name[start + 1..].split([')', ']']).next().unwrap_or_default().trim();
    let inner = inner.strip_prefix("in ").or(inner.strip_prefix("1/")).unwrap_or(inner).trim();
    // Without its power: mm^-1, mm⁻³.
    Some(match inner.split(['^', '⁻', '*', '-']).next().unwrap_or_default().trim() {
        "nm" => Unit::Length(1e-6),
        "µm" | "μm" | "um" | "micron" | "microns" => Unit::Length(1e-3),
        "mm" | "millimetres" | "millimeters" => Unit::Length(1.0),
        "cm" => Unit::Length(10.0),
        "m" => Unit::Length(1000.0),
        "in" | "inch" | "inches" => Unit::Length(25.4),
        "deg" | "degree" | "degrees" | "°" => Unit::Degrees,
        "rad" | "radian" | "radians" | "mrad" | "arcmin" | "arcsec" => Unit::Angle,
        _ => return None,
    })
}

/// Checks that a name has no other unit than `expected`.
///
/// # Errors
/// [`LensFileError::Line`] names both.
pub(super) fn check(line: &Line<'_>, name: &str, expected: Unit) -> Result<(), LensFileError> {
    match unit_of(name) {
        Some(unit) if unit != expected => Err(line.error(match expected {
            Unit::Length(1e-6) => format!("`{name}`: expected wavelengths in nm"),
            Unit::Length(mm) => format!(
                "`{name}`: lengths of this table are in units of {mm} mm; a line `unit, cm` (mm, cm, m, in) before the header row sets its unit"
            ),
            _ => format!("`{name}`: expected degrees"),
        })),
        _ => Ok(()),
    }
}
