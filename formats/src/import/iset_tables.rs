//! DI and RI tables of the ISET macros: read, checked, and compared with a grid distortion listing.

use super::dense::{Parity, Spline};
use super::matrix::Matrix;
use super::{ImportError, distortion_listing, text};
use std::path::Path;

/// Maximum difference of the chief rays of a listing and of the DI table, mm.
pub(super) const MAX_RAY_DIFFERENCE_MM: f64 = 1e-3;

/// A DI or RI table: heights × wavelengths.
pub(super) struct Table {
    pub values: Vec<f64>,
    /// Line of every number.
    lines: Vec<usize>,
}

/// Reads a table.
pub(super) fn table(path: &Path, (heights, wavelengths): (usize, usize)) -> Result<Table, ImportError> {
    let text = text::read(path)?;
    let m = Matrix::read(path, text::numbered_lines(&text))?;
    if m.rows > 0 && m.columns != 1 && m.columns != wavelengths {
        let problem =
            format!("{} numbers, expected one per line or {wavelengths}, one per wavelength", m.columns);
        return Err(ImportError::line(path, m.lines[0], problem));
    }
    if m.values.len() != heights * wavelengths {
        let problem = format!(
            "the table ends after {} numbers, expected {} ({heights} heights × {wavelengths} wavelengths)",
            m.values.len(),
            heights * wavelengths
        );
        return Err(ImportError::line(path, m.lines.last().copied().unwrap_or(1), problem));
    }
    let lines = m.lines.iter().flat_map(|&line| std::iter::repeat_n(line, m.columns)).collect();
    Ok(Table { values: m.values, lines })
}

/// Image heights of one wavelength, made positive and checked to ascend from 0.
pub(super) fn image_heights(
    path: &Path,
    t: &Table,
    (w, waves): (usize, usize),
    heights_mm: Vec<f64>,
) -> Result<Vec<f64>, ImportError> {
    let sign = if heights_mm.iter().all(|h| *h <= 0.0) { -1.0 } else { 1.0 };
    let heights_mm: Vec<f64> = heights_mm.iter().map(|h| sign * h + 0.0).collect();
    let bad = |h: usize, problem: String| {
        Err(ImportError::line(path, t.lines[h * waves + w], format!("wavelength {}: {problem}", w + 1)))
    };
    if heights_mm[0].abs() > 1e-6 {
        return bad(0, format!("the first height is {} mm, expected 0", heights_mm[0]));
    }
    match heights_mm.windows(2).position(|pair| pair[1] <= pair[0]) {
        Some(h) => {
            bad(h + 1, format!("height {} mm does not ascend from {} mm", heights_mm[h + 1], heights_mm[h]))
        }
        None => Ok(std::iter::once(0.0).chain(heights_mm[1..].iter().copied()).collect()),
    }
}

/// Compares a grid listing with the spline through the DI table, by predicted radius.
pub(super) fn compare_grid(
    path: &Path,
    (ideal, image): (&[f64], &[f64]),
    focal: f64,
    nm: f64,
) -> Result<String, ImportError> {
    let grid = distortion_listing::grid(path, &text::read(path)?)?;
    let found = grid.distortion.wavelength_nm;
    if (found - nm).abs() > 0.5 {
        return Err(ImportError::file(path, format!("is of {found} nm, expected {nm} nm")));
    }
    let spline = Spline::mirrored(ideal, image, Parity::Odd);
    let last = ideal[ideal.len() - 1] * (1.0 + 1e-4);
    // The f of the listing may be that of another wavelength; both have the same field angles.
    let scale = grid.distortion.focal_length_mm.map_or(1.0, |f| focal / f);
    let inside = grid.radii_mm.iter().map(|(p, r)| (p * scale, *r)).filter(|(p, _)| *p <= last);
    let worst = inside.map(|(p, r)| (spline.at(p) - r).abs()).fold(0.0, f64::max);
    match worst < MAX_RAY_DIFFERENCE_MM {
        true => Ok(format!("{}: agrees with the DI table within {worst:.1e} mm", path.display())),
        false => Err(ImportError::file(path, format!("differs from the DI table by up to {worst:.2e} mm"))),
    }
}
