//! Curves over wavelength: CSV with a header, a column `wavelength_nm` (nm) and columns of values.

use std::path::Path;

use pipeline::bounds::WAVELENGTH_NM;
use pipeline::sensor::Curve;

use super::error::SensorError;

/// Rows of a table.
const MAX_ROWS: usize = 100_000;

/// What the values of a column are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Quantity {
    /// A share, 0 to 1, above 0 somewhere.
    Share(&'static str),
    /// A reflectance, 0 to 1.
    Reflectance,
    /// Relative response per unit of energy, not negative.
    Response,
}

/// Reads column `column` of the CSV `text`.
pub(super) fn curve(path: &Path, text: &str, column: &str, quantity: Quantity) -> Result<Curve, SensorError> {
    let fail = |problem: String| SensorError::Table { path: path.into(), problem };
    let mut lines = text.lines().enumerate().map(|(i, l)| (i + 1, l.trim())).filter(|(_, l)| !l.is_empty());
    let (_, head) =
        lines.next().ok_or_else(|| fail("is empty, expected a header line with wavelength_nm".into()))?;
    let names: Vec<&str> = head.trim_start_matches('\u{feff}').split(',').map(str::trim).collect();
    let find = |name: &str| {
        names.iter().position(|n| *n == name).ok_or_else(|| {
            fail(format!("expected a column `{name}`, found the columns {}", names.join(", ")))
        })
    };
    let (nm, value) = (find("wavelength_nm")?, find(column)?);
    let mut curve = Curve::default();
    for (line, text) in lines {
        let cells: Vec<&str> = text.split(',').map(str::trim).collect();
        if cells.len() != names.len() {
            return Err(fail(format!(
                "line {line}: expected {} columns, found {}",
                names.len(),
                cells.len()
            )));
        }
        let number = |k: usize| match cells[k].parse::<f64>() {
            Ok(v) if v.is_finite() => Ok(v),
            _ => Err(fail(format!(
                "line {line}, column {}: expected a number, found `{}`",
                names[k], cells[k]
            ))),
        };
        let (nm, value) = (number(nm)?, number(value)?);
        WAVELENGTH_NM.check(nm).map_err(|e| fail(format!("line {line}: {e}")))?;
        if let Some(last) = curve.wavelengths_nm.last().filter(|last| **last >= nm) {
            return Err(fail(format!(
                "line {line}: expected a wavelength above {last} nm, the row before, found {nm} nm"
            )));
        }
        match quantity {
            Quantity::Share(_) | Quantity::Reflectance if !(0.0..=1.0).contains(&value) => {
                let percent =
                    if value > 1.0 && value <= 100.0 { "; did you mean percent? Divide by 100" } else { "" };
                return Err(fail(format!(
                    "line {line}, column {column}: expected a {} from 0 to 1, found {value}{percent}",
                    if let Quantity::Share(what) = quantity { what } else { "reflectance" }
                )));
            }
            // Interpolated tables of observers reach -1e-21.
            Quantity::Response if value < -1e-9 => {
                return Err(fail(format!(
                    "line {line}, column {column}: expected a response of 0 or more, found {value}"
                )));
            }
            _ => {}
        }
        if curve.values.len() == MAX_ROWS {
            return Err(fail(format!("line {line}: more than {MAX_ROWS} rows")));
        }
        curve.wavelengths_nm.push(nm);
        curve.values.push(value.max(0.0));
    }
    if curve.values.len() < 2 {
        return Err(fail(format!("expected two rows of numbers or more, found {}", curve.values.len())));
    }
    if quantity != Quantity::Reflectance && curve.values.iter().all(|v| *v == 0.0) {
        return Err(fail(format!("column {column}: expected a value above 0, found none")));
    }
    Ok(curve)
}
