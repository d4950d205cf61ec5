//! OpticStudio's text listing of relative illumination (RI).
//!
//! ```text
//! Listing of Relative Illumination Data
//! Wavelength: 0.5500 µm
//! Y Field (deg)    Rel. Ill.    Eff. F/#
//!   0.000000       1.000000     …
//! ```
//! No public example was found, so columns are identified by their titles: the first is the field angle in degrees, another
//! one contains "rel" and "ill". RI must be 1 on the axis.

use super::ImportError;
use super::field_table::{Titles, row, wavelength_nm};
use super::text::numbered_lines;
use std::path::Path;

/// RI over field angle, at one wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct Illumination {
    /// nm.
    pub wavelength_nm: f64,
    /// Field angle in degrees, ascending from 0.
    pub field_deg: Vec<f64>,
    /// Relative illumination.
    pub relative_illumination: Vec<f64>,
}

/// Reads a listing.
///
/// # Errors
/// [`ImportError`] with the line.
pub fn parse(path: &Path, text: &str) -> Result<Illumination, ImportError> {
    let (mut wavelength, mut columns) = (None, None);
    let mut out =
        Illumination { wavelength_nm: 0.0, field_deg: Vec::new(), relative_illumination: Vec::new() };
    for (number, line) in numbered_lines(text) {
        let lower = line.trim().to_lowercase();
        let bad = |problem: String| ImportError::line(path, number, problem);
        match columns {
            None if lower.starts_with("wavelength") => {
                wavelength = Some(wavelength_nm(&lower).ok_or_else(|| bad("no wavelength in µm".into()))?);
            }
            None if lower.contains("rel") && lower.contains("ill") && lower.contains("field") => {
                let titles = Titles::parse(line).map_err(bad)?;
                columns = titles.column(&["rel", "ill"]).filter(|(ri, _)| *ri > 0);
            }
            None => {}
            Some(_) if lower.is_empty() => {}
            Some((ri, count)) => {
                let Some(row) = row(line).filter(|row| row.len() == count) else {
                    return Err(bad(format!("expected {count} finite numbers, one for each column title")));
                };
                let (f, before) = (row[0], out.field_deg.last());
                if before.map_or(f != 0.0, |before| f <= *before) || f >= 89.0 {
                    return Err(bad(format!("field {f}° does not ascend from 0 to 89")));
                }
                out.field_deg.push(f);
                out.relative_illumination.push(row[ri]);
            }
        }
    }
    out.wavelength_nm = wavelength.ok_or_else(|| {
        ImportError::file(path, "has no line `Wavelength: … µm`: list one wavelength at a time")
    })?;
    match out.field_deg.len() {
        0 | 1 => Err(ImportError::file(path, "has fewer than 2 field points under a title with `Rel. Ill.`")),
        _ => Ok(out),
    }
}
