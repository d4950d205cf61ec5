//! OpticStudio's text listing of a Huygens or FFT PSF (Zemax of 2005 wrote the same one).
//!
//! ```text
//! HUYGENS PSF
//! 0.5500 µm at -27.38 deg.            several wavelengths ("0.4861 to 0.6563 µm") are an error
//! Data spacing is 0.25 µm.
//! Data area is 32.00 by 32.00 µm.
//! Image grid size: 128 by 128
//! Center point is: 65, 65             or "row 129, column 128"; from 1
//! Center coordinates: 0.00000000E+000, -9.59263593E-001      mm, the chief ray; FFT: "Reference Coordinates"
//! Values are relative intensity.
//! (blank) then one line a row of samples
//! ```
//! If the data area is smaller than the grid, only the middle of the grid is listed; the centre is counted in the full grid.
//! Samples are point values, not means over a square. "Center point is" with two different numbers without labels is ambiguous,
//! so it is an error. Row order is not stated; FFT listings of an even grid have their centre in row N/2 + 1, column N/2, where the
//! program's data (y ascending) has N/2 for both: the text has its top row first, the default here.

use super::field_table::WAVELENGTH_UM;
use super::matrix::Matrix;
use super::text::{number, numbered_lines, numbers};
use super::window::{Outward, Window};
use super::{ImportError, MAX_SIDE};
use pipeline::real;
use std::path::Path;

/// A listed PSF.
#[derive(Clone, Debug, PartialEq)]
pub struct PsfListing {
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// Sample pitch, µm.
    pub pitch_um: f64,
    /// The chief ray in the image plane (x, y), mm, if stated.
    pub chief_ray_mm: Option<(f64, f64)>,
    /// The field point (x, y), degrees, if stated in degrees.
    pub field_deg: Option<(f64, f64)>,
    /// The samples in the order of the file.
    pub window: Window,
}

/// Whether a text starts like a PSF listing.
pub(super) fn is_psf_listing(text: &str) -> bool {
    header(text).any(|(_, l)| l.contains("huygens psf") || l.contains("fft psf"))
}

/// Lower-case lines of the header with their numbers, to the line "Values are …" or the first row of samples.
fn header(text: &str) -> impl Iterator<Item = (usize, String)> {
    let mut ended = false;
    let lines = numbered_lines(text).take(60).map(|(n, l)| (n, l.trim().to_lowercase()));
    lines.take_while(move |(_, l)| {
        let in_header = !ended && !is_data(l);
        ended = l.starts_with("values are");
        in_header
    })
}

/// Whether a line is a row of samples: at least two numbers and nothing else.
fn is_data(line: &str) -> bool {
    line.split_whitespace().take(3).filter(|w| number(w).is_some()).count() >= 2
        && line.split_whitespace().take(8).all(|w| number(w).is_some())
}

/// Reads a listing.
///
/// # Errors
/// [`ImportError`] with the line.
pub fn parse(path: &Path, text: &str) -> Result<PsfListing, ImportError> {
    let (mut wavelength, mut pitch, mut grid, mut centre) = (None, None, None, None);
    let (mut chief_ray_mm, mut field_deg, mut area_um) = (None, None, None);
    let mut last = 0;
    for (line, lower) in header(text) {
        last = line;
        let bad = |problem: String| ImportError::line(path, line, problem);
        let found = numbers(&lower);
        if lower.starts_with("title") || lower.starts_with("file") || lower.starts_with("date") {
            continue;
        }
        if lower.starts_with("data spacing is") {
            pitch = Some(length_um(&lower, &found).ok_or_else(|| bad("no spacing in µm or mm".into()))?);
        } else if lower.starts_with("data area is") {
            area_um = length_um(&lower, &found);
        } else if lower.starts_with("image grid size") {
            grid = Some(pair(&found).ok_or_else(|| bad("no image grid size".into()))?);
        } else if lower.starts_with("center point is") {
            centre = Some(centre_sample(&lower, &found).map_err(bad)?);
        } else if lower.starts_with("center coordinates") || lower.starts_with("reference coordinates") {
            let [x, y] = found[..] else { return Err(bad("expected two coordinates in mm".into())) };
            chief_ray_mm = Some((x, y));
        } else if wavelength.is_none() && lower.contains(" at ") && is_micron(&lower) {
            let (um, field) = wavelength_and_field(&lower).map_err(bad)?;
            (wavelength, field_deg) = (Some(um), field);
        }
    }
    let need = |what: &str| ImportError::file(path, format!("is not a PSF listing: it has no line `{what}`"));
    let wavelength_nm = wavelength.ok_or_else(|| need("… µm at …"))? * 1e3;
    let pitch_um = pitch.ok_or_else(|| need("Data spacing is …"))?;
    let (rows, columns) = grid.ok_or_else(|| need("Image grid size: …"))?;
    let m = Matrix::read(path, numbered_lines(text).skip(last))?;
    // Side of the listed middle of the grid.
    let side =
        area_um.map(|area| (area / pitch_um).round() as usize).filter(|n| rows == columns && *n < rows);
    let (rows, columns, centre) = match side {
        Some(n) if (m.rows, m.columns) != (rows, columns) => (
            n,
            n,
            centre
                .map(|c| centre_in_middle(c, (rows, n)))
                .transpose()
                .map_err(|e| ImportError::file(path, e))?,
        ),
        _ => (rows, columns, centre),
    };
    if (m.rows, m.columns) != (rows, columns) {
        let end = m.lines.last().copied().unwrap_or(last);
        let (r, c) = (m.rows, m.columns);
        let problem = format!(
            "the samples end after {r} rows of {c}, expected {rows} rows of {columns}; is the file cut short?"
        );
        return Err(ImportError::line(path, end, problem));
    }
    let window = Window { rows, columns, samples: m.values, centre };
    Ok(PsfListing { wavelength_nm, pitch_um, chief_ray_mm, field_deg, window })
}

impl PsfListing {
    /// Side of the chief ray that points away from the axis, with the top row first; `None`: not stated, or on the axis.
    ///
    /// # Errors
    /// The field point lies on neither axis.
    pub fn outward(&self) -> Result<Option<Outward>, String> {
        let Some((x, y)) = self.chief_ray_mm.or(self.field_deg) else { return Ok(None) };
        let small = 1e-6 * real::hypot(x, y);
        match (x.abs() <= small, y.abs() <= small) {
            (true, true) => Ok(None),
            (true, false) => Ok(Some(if y > 0.0 { Outward::Up } else { Outward::Down })),
            (false, true) => Ok(Some(if x > 0.0 { Outward::Right } else { Outward::Left })),
            (false, false) => Err(format!(
                "is of a field point at ({x}, {y}), on neither axis; list it with the field along x or y"
            )),
        }
    }
}

/// Whether a text contains "µm", also with a µ damaged by wrong decoding.
fn is_micron(text: &str) -> bool {
    ["µm", "μm", "um", "\u{fffd}m", "micron"].iter().any(|unit| text.contains(unit))
}

/// The first number, a positive length in mm or µm, in µm.
fn length_um(line: &str, found: &[f64]) -> Option<f64> {
    let value = found.first()?;
    let scale = match line {
        l if is_micron(l) => 1.0,
        l if l.contains(" mm") || l.contains("millimeter") => 1e3,
        _ => return None,
    };
    let value = value * scale;
    (value.is_finite() && value > 0.0).then_some(value)
}

fn pair(found: &[f64]) -> Option<(usize, usize)> {
    let [a, b] = found[..] else { return None };
    let count = |v: f64| (v.fract() == 0.0 && (1.0..=MAX_SIDE as f64).contains(&v)).then_some(v as usize);
    Some((count(a)?, count(b)?))
}

/// "row 129, column 128" or "65, 65", from 1 → (row, column) from 0.
fn centre_sample(line: &str, found: &[f64]) -> Result<(usize, usize), String> {
    let (a, b) = pair(found).ok_or("expected two sample numbers from 1")?;
    match (line.find("row"), line.find("column")) {
        (Some(row), Some(column)) if row < column => Ok((a - 1, b - 1)),
        (Some(_), Some(_)) => Ok((b - 1, a - 1)),
        _ if a == b => Ok((a - 1, b - 1)),
        _ => Err(format!("`{a}, {b}` is ambiguous: which is the row? Write `row R, column C`")),
    }
}

/// A sample of the grid, counted in the n × n samples in its middle.
fn centre_in_middle((r, c): (usize, usize), (grid, n): (usize, usize)) -> Result<(usize, usize), String> {
    let first = (grid - n) / 2;
    match (r.checked_sub(first), c.checked_sub(first)) {
        (Some(r), Some(c)) if (grid - n).is_multiple_of(2) => Ok((r, c)),
        _ => Err(format!("lists {n} of {grid} rows, and its centre sample is not among them")),
    }
}

/// "0.5500 µm at -27.38 deg." → (µm, field in degrees).
fn wavelength_and_field(line: &str) -> Result<(f64, Option<(f64, f64)>), String> {
    let (waves, field) = line.split_once(" at ").unwrap_or((line, ""));
    let (waves, field_numbers) = (numbers(waves), numbers(field));
    let wavelength = match waves[..] {
        [one] => one,
        [a, b] if a == b => a,
        _ => return Err("several wavelengths in one PSF; list one at a time".into()),
    };
    if !WAVELENGTH_UM.contains(&wavelength) {
        return Err(format!("a wavelength of {wavelength} µm, expected 0.05 to 100"));
    }
    let degrees = field.contains("deg").then(|| match field_numbers[..] {
        [y] => Some((0.0, y)),
        [x, y] => Some((x, y)),
        _ => None,
    });
    Ok((wavelength, degrees.flatten()))
}
