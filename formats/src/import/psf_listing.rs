//! OpticStudio's text listing of a Huygens or FFT PSF (Zemax of 2005 wrote the same one).
//!
//! ```text
//! HUYGENS PSF
//! 0.5500 µm at -27.38 deg.            several wavelengths: "0.4861 to 0.6563 µm", refused
//! Data spacing is 0.25 µm.
//! Data area is 32.00 by 32.00 µm.
//! Image grid size: 128 by 128
//! Center point is: 65, 65             or "row 129, column 128"; from 1
//! Center coordinates: 0.00000000E+000, -9.59263593E-001      mm, the chief ray; FFT: "Reference Coordinates"
//! Values are relative intensity.
//! (blank) then one line a row of samples
//! ```
//! A data area smaller than the grid means that only the middle of the grid is listed; the centre is counted in the grid.
//! Samples are points, not means over a square. Of two different numbers in the unlabelled "Center point is" none can tell which
//! is the row, so that is an error. Row order is not told; FFT listings of an even grid name row N/2 + 1, column N/2 where the
//! program's own data (y ascending) has N/2 for both: the text has its top row first, the default here.

use super::matrix::Matrix;
use super::text::{number, numbers};
use super::window::{Outward, Window};
use super::{ImportError, WIDEST};
use std::path::Path;

/// A PSF as listed.
#[derive(Clone, Debug, PartialEq)]
pub struct PsfListing {
    /// nm.
    pub wavelength_nm: f64,
    /// µm.
    pub pitch_um: f64,
    /// The chief ray in the image plane (x, y), mm, where told.
    pub chief_ray_mm: Option<(f64, f64)>,
    /// The field point (x, y) in degrees, where told so.
    pub field_deg: Option<(f64, f64)>,
    /// The samples, first row first.
    pub window: Window,
}

/// Does this text start as a PSF listing does?
pub(super) fn is_psf(text: &str) -> bool {
    head(text).any(|(_, l)| l.contains("huygens psf") || l.contains("fft psf"))
}

/// Lower-case lines before the samples, numbered from 1; "Values are …" is the last one wherever it stands.
pub(super) fn head(text: &str) -> impl Iterator<Item = (usize, String)> {
    let mut over = false;
    let lines = text.lines().take(60).enumerate().map(|(i, l)| (i + 1, l.trim().to_lowercase()));
    lines.take_while(move |(_, l)| {
        let before = !over && !is_data(l);
        over = l.starts_with("values are");
        before
    })
}

/// A row of samples: at least two words, all of them numbers.
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
    for (line, words) in head(text) {
        last = line;
        let bad = |problem: String| ImportError::line(path, line, problem);
        let found = numbers(&words);
        if words.starts_with("title") || words.starts_with("file") || words.starts_with("date") {
            continue;
        }
        if words.starts_with("data spacing is") {
            pitch = Some(length(&words, &found, 1.0).ok_or_else(|| bad("no spacing in µm or mm".into()))?);
        } else if words.starts_with("data area is") {
            area_um = length(&words, &found, 1.0);
        } else if words.starts_with("image grid size") {
            grid = Some(pair(&found).ok_or_else(|| bad("no image grid size".into()))?);
        } else if words.starts_with("center point is") {
            centre = Some(centre_sample(&words, &found).map_err(bad)?);
        } else if words.starts_with("center coordinates") || words.starts_with("reference coordinates") {
            let [x, y] = found[..] else { return Err(bad("expected two coordinates in mm".into())) };
            chief_ray_mm = Some((x, y));
        } else if wavelength.is_none() && words.contains(" at ") && is_micron(&words) {
            (wavelength, field_deg) = spectrum(&words).map_err(bad)?;
        }
    }
    let need = |what: &str| ImportError::file(path, format!("is no PSF listing: it has no line `{what}`"));
    let wavelength_nm = wavelength.ok_or_else(|| need("… µm at …"))? * 1e3;
    let pitch_um = pitch.ok_or_else(|| need("Data spacing is …"))?;
    let (rows, columns) = grid.ok_or_else(|| need("Image grid size: …"))?;
    let numbered = text.lines().enumerate().map(|(i, l)| (i + 1, l)).skip(last);
    let m = Matrix::read(path, numbered)?;
    // The middle of the grid, as wide as the data area.
    let part =
        area_um.map(|area| (area / pitch_um).round() as usize).filter(|n| rows == columns && *n < rows);
    let (rows, columns, centre) = match part {
        Some(n) if (m.rows, m.columns) != (rows, columns) => {
            (n, n, centre.map(|c| middle(c, (rows, n))).transpose().map_err(|e| ImportError::file(path, e))?)
        }
        _ => (rows, columns, centre),
    };
    if (m.rows, m.columns) != (rows, columns) {
        let end = m.lines.last().copied().unwrap_or(last);
        let (r, c) = (m.rows, m.columns);
        return Err(ImportError::line(
            path,
            end,
            format!(
                "the samples end after {r} rows of {c}, expected {rows} rows of {columns}; is the file cut short?"
            ),
        ));
    }
    let window = Window { rows, columns, samples: m.values, centre };
    Ok(PsfListing { wavelength_nm, pitch_um, chief_ray_mm, field_deg, window })
}

impl PsfListing {
    /// Side of the chief ray away from the axis with the top row first; `None`: not told, or on the axis.
    ///
    /// # Errors
    /// The field point lies on neither axis.
    pub fn outward(&self) -> Result<Option<Outward>, String> {
        let Some((x, y)) = self.chief_ray_mm.or(self.field_deg) else { return Ok(None) };
        let small = 1e-6 * x.hypot(y);
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

/// "µm", also where the µ was lost on the way.
fn is_micron(words: &str) -> bool {
    ["µm", "μm", "um", "\u{fffd}m", "micron"].iter().any(|unit| words.contains(unit))
}

/// First number as µm.
fn length(words: &str, found: &[f64], scale: f64) -> Option<f64> {
    let value = found.first()?;
    let scale = match words {
        w if is_micron(w) => scale,
        w if w.contains(" mm") || w.contains("millimeter") => scale * 1e3,
        _ => return None,
    };
    let value = value * scale;
    (value.is_finite() && value > 0.0).then_some(value)
}

fn pair(found: &[f64]) -> Option<(usize, usize)> {
    let [a, b] = found[..] else { return None };
    let whole = |v: f64| (v.fract() == 0.0 && (1.0..=WIDEST as f64).contains(&v)).then_some(v as usize);
    Some((whole(a)?, whole(b)?))
}

/// "row 129, column 128" or "65, 65", from 1 → (row, column) from 0.
fn centre_sample(words: &str, found: &[f64]) -> Result<(usize, usize), String> {
    let (a, b) = pair(found).ok_or("expected two sample numbers from 1")?;
    match (words.find("row"), words.find("column")) {
        (Some(row), Some(column)) if row < column => Ok((a - 1, b - 1)),
        (Some(_), Some(_)) => Ok((b - 1, a - 1)),
        _ if a == b => Ok((a - 1, b - 1)),
        _ => Err(format!("`{a}, {b}` does not tell which is the row; write `row R, column C`")),
    }
}

/// A sample of the whole grid, counted in the n × n in its middle.
fn middle((r, c): (usize, usize), (grid, n): (usize, usize)) -> Result<(usize, usize), String> {
    let first = (grid - n) / 2;
    match (r.checked_sub(first), c.checked_sub(first)) {
        (Some(r), Some(c)) if (grid - n).is_multiple_of(2) => Ok((r, c)),
        _ => Err(format!("lists {n} of {grid} rows, and its centre is not among them")),
    }
}

/// "0.5500 µm at -27.38 deg." → (µm, field in degrees).
#[allow(clippy::type_complexity, reason = "two values of one line")]
fn spectrum(words: &str) -> Result<(Option<f64>, Option<(f64, f64)>), String> {
    let (waves, field) = words.split_once(" at ").unwrap_or((words, ""));
    let (waves, field_numbers) = (numbers(waves), numbers(field));
    let wavelength = match waves[..] {
        [one] => one,
        [a, b] if a == b => a,
        _ => return Err("several wavelengths in one PSF; list one at a time".into()),
    };
    if !(0.05..=100.0).contains(&wavelength) {
        return Err(format!("a wavelength of {wavelength} µm, expected 0.05 to 100"));
    }
    let degrees = field.contains("deg").then(|| match field_numbers[..] {
        [y] => Some((0.0, y)),
        [x, y] => Some((x, y)),
        _ => None,
    });
    Ok((Some(wavelength), degrees.flatten()))
}
