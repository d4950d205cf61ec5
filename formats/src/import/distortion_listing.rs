//! OpticStudio's text listings of distortion: Grid Distortion, and Field Curvature / Distortion.
//!
//! ```text
//! Listing of Grid Distortion Data               Listing of FIELD CURVATURE DISTORTION Data
//! Units are Millimeters.                        Data for wavelength : 0.5500 µm.
//! Field units are degrees                       Distortion focal length = 99.50
//! Wavelength: 0.55000 µm
//! Reference Coordinates: Xref = 0, Yref = 0
//!    i   j  X-Field … Real X  Real Y …          Y Angle (deg)  Tan Shift  Sag Shift  Real Height  …
//!  -32 -32  -1.94E+1 …                          0.00000  0.0000  0.0000  0.0000  …
//! ```
//! Of a grid the half diagonal i = j ≥ 0, from the axis to the corner, is used; all of its points may be compared with a
//! table. A grid must be complete; text after it (maximum, ABCD matrix) is not read; the last column may be cut off.
//! The grid format is that of real exports; field curvature listings follow descriptions, so columns are identified by title.

use super::ImportError;
use super::field_table::{Titles, row, wavelength_nm};
use super::text::{number, numbered_lines, numbers};
use pipeline::real;
use std::path::Path;

/// Real chief-ray heights over field angle, at one wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct Distortion {
    /// nm.
    pub wavelength_nm: f64,
    /// Paraxial focal length at this wavelength: f of f·tan(field) in the listing.
    pub focal_length_mm: Option<f64>,
    /// Field angle in degrees, ascending from 0.
    pub field_deg: Vec<f64>,
    /// Real image height, mm.
    pub image_height_mm: Vec<f64>,
}

/// A grid: predicted (paraxial) and real distance from the axis of every point, mm.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// The half diagonal.
    pub distortion: Distortion,
    /// (predicted, real) of all points.
    pub radii_mm: Vec<(f64, f64)>,
}

/// Reads a grid distortion listing.
///
/// # Errors
/// [`ImportError`] with the line.
pub fn grid(path: &Path, text: &str) -> Result<Grid, ImportError> {
    let (mut millimetres, mut degrees, mut wavelength, mut titles) = (false, false, None, None);
    for (line_number, line) in numbered_lines(text).take(60) {
        let lower = line.trim().to_lowercase();
        let bad = |problem: &str| ImportError::line(path, line_number, problem);
        if lower.starts_with("units are") {
            millimetres = lower.contains("millimeter");
        } else if lower.starts_with("field units are") {
            degrees = lower.contains("degree");
        } else if lower.starts_with("wavelength") {
            wavelength = Some(wavelength_nm(&lower).ok_or_else(|| bad("no wavelength in µm"))?);
        } else if lower.starts_with("reference coordinates") {
            let reference: Vec<f64> = lower.split(['=', ',', ' ']).filter_map(number).collect();
            if reference.iter().any(|v| v.abs() > 1e-9) {
                return Err(bad("the reference is not the axis; list the grid about field 0, 0"));
            }
        } else if lower.starts_with("i ") && lower.contains("real y") {
            titles = Some(line_number);
            break;
        }
    }
    let need = |what: &str| {
        ImportError::file(path, format!("is not a grid distortion listing: it has no line `{what}`"))
    };
    let titles = titles.ok_or_else(|| need("i j X-Field … Real Y"))?;
    let wavelength_nm = wavelength.ok_or_else(|| need("Wavelength: …"))?;
    if !(millimetres && degrees) {
        let problem = "has other units than millimeters and degrees, which are required";
        return Err(ImportError::file(path, problem));
    }
    let mut rows: Vec<(usize, Vec<f64>)> = Vec::new();
    for (line_number, line) in numbered_lines(text).skip(titles) {
        let first = line.split_whitespace().next().and_then(number);
        if first.is_none() {
            if line.trim().is_empty() && rows.is_empty() {
                continue;
            }
            break;
        }
        let values: Option<Vec<f64>> = line.split_whitespace().take(9).map(number).collect();
        match values {
            Some(values) if values.len() == 9 => rows.push((line_number, values)),
            _ => {
                let problem = "expected 9 numbers and the distortion in %";
                return Err(ImportError::line(path, line_number, problem));
            }
        }
    }
    check_complete(path, titles, &rows)?;
    let radii_mm = rows.iter().map(|(_, w)| (real::hypot(w[5], w[6]), real::hypot(w[7], w[8]))).collect();
    let diagonal = || rows.iter().filter(|(_, w)| w[0] == w[1] && w[0] >= 0.0);
    let (mut field_deg, mut image_height_mm, mut focal) = (Vec::new(), Vec::new(), None);
    for (line, w) in diagonal() {
        push_point(path, *line, (&mut field_deg, &mut image_height_mm), (w[4], real::hypot(w[7], w[8])))?;
        let tangent = real::tan(w[4].to_radians());
        focal = (tangent > 0.0).then(|| real::hypot(w[5], w[6]) / tangent);
    }
    let distortion = Distortion { wavelength_nm, focal_length_mm: focal, field_deg, image_height_mm };
    Ok(Grid { distortion, radii_mm })
}

/// A grid from −n to n must have (2n + 1)² points.
fn check_complete(path: &Path, titles: usize, rows: &[(usize, Vec<f64>)]) -> Result<(), ImportError> {
    let Some((first, w)) = rows.first() else {
        return Err(ImportError::line(path, titles, "no points follow"));
    };
    let n = -w[0];
    if n.fract() != 0.0 || !(1.0..=2048.0).contains(&n) || w[1] != w[0] {
        let problem = format!("the grid starts at {}, {}, expected -n, -n", w[0], w[1]);
        return Err(ImportError::line(path, *first, problem));
    }
    let expected = (2 * n as usize + 1).pow(2);
    if rows.len() == expected {
        return Ok(());
    }
    let last = rows.last().map_or(*first, |(line, _)| *line);
    let found = rows.len();
    Err(ImportError::line(
        path,
        last,
        format!("the grid ends after {found} points, expected {expected}; is the file cut short?"),
    ))
}

/// Appends a field point. The first must be on the axis, every other farther from it than the one before.
fn push_point(
    path: &Path,
    line: usize,
    (field, height): (&mut Vec<f64>, &mut Vec<f64>),
    (f, h): (f64, f64),
) -> Result<(), ImportError> {
    let bad = |problem: String| Err(ImportError::line(path, line, problem));
    match (field.last(), height.last()) {
        (Some(before), Some(above)) if !(f > *before && h > *above) => {
            return bad(format!("field {f}° at {h} mm does not ascend from {before}° at {above} mm"));
        }
        (None, None) if f != 0.0 || h.abs() > 1e-6 => {
            return bad(format!("the first field point is {f}° at {h} mm, expected the axis"));
        }
        _ => {}
    }
    if !(0.0..89.0).contains(&f) {
        return bad(format!("a field of {f}°, expected 0 to 89"));
    }
    field.push(f);
    height.push(if height.is_empty() { 0.0 } else { h });
    Ok(())
}

/// Reads a field curvature / distortion listing: one table per wavelength.
///
/// # Errors
/// [`ImportError`] with the line.
pub fn field_curvature(path: &Path, text: &str) -> Result<Vec<Distortion>, ImportError> {
    let mut tables: Vec<Distortion> = Vec::new();
    let mut columns: Option<(usize, usize)> = None;
    for (line_number, line) in numbered_lines(text) {
        let lower = line.trim().to_lowercase();
        let bad = |problem: String| ImportError::line(path, line_number, problem);
        if lower.starts_with("data for wavelength") {
            let wavelength_nm = wavelength_nm(&lower).ok_or_else(|| bad("no wavelength in µm".into()))?;
            tables.push(Distortion {
                wavelength_nm,
                focal_length_mm: None,
                field_deg: Vec::new(),
                image_height_mm: Vec::new(),
            });
            columns = None;
        } else if lower.starts_with("distortion focal length") {
            if let (Some(table), Some(f)) = (tables.last_mut(), numbers(&lower).first()) {
                table.focal_length_mm = Some(*f);
            }
        } else if lower.contains("real height") {
            columns = Titles::parse(line).map_err(bad)?.column(&["real height"]);
        } else if let (Some((real, count)), Some(table)) = (columns, tables.last_mut()) {
            if lower.is_empty() {
                continue;
            }
            let Some(row) = row(line) else {
                columns = None; // end of the table
                continue;
            };
            if row.len() != count {
                return Err(bad(format!(
                    "{} numbers, expected {count}, one for each column title",
                    row.len()
                )));
            }
            let point = (row[0], row[real].abs());
            push_point(path, line_number, (&mut table.field_deg, &mut table.image_height_mm), point)?;
        }
    }
    match tables.iter().find(|t| t.field_deg.len() < 2) {
        Some(t) => Err(ImportError::file(
            path,
            format!("has fewer than 2 field points with a `Real Height` at {} nm", t.wavelength_nm),
        )),
        None if tables.is_empty() => Err(ImportError::file(path, "has no line `Data for wavelength : …`")),
        None => Ok(tables),
    }
}
