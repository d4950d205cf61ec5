//! Tables in CSV: a header with names, rows of numbers whose first wanted column ascends. Curves over wavelength have a column `wavelength_nm` (nm).

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

/// Rows of numbers of the columns `wanted` of the CSV `text`, and the lines they stand in.
pub(super) fn columns<const N: usize>(
    path: &Path,
    text: &str,
    wanted: [&str; N],
) -> Result<Vec<(usize, [f64; N])>, SensorError> {
    let rows = rows(path, text, &wanted, 2)?;
    Ok(rows.into_iter().map(|(line, row)| (line, std::array::from_fn(|k| row[k]))).collect())
}

/// [`columns`], at least `least` rows.
pub(super) fn rows(
    path: &Path,
    text: &str,
    wanted: &[&str],
    least: usize,
) -> Result<Vec<(usize, Vec<f64>)>, SensorError> {
    let fail = |problem: String| SensorError::Table { path: path.into(), problem };
    let mut lines = text.lines().enumerate().map(|(i, l)| (i + 1, l.trim())).filter(|(_, l)| !l.is_empty());
    let (_, head) =
        lines.next().ok_or_else(|| fail(format!("is empty, expected a header line with {}", wanted[0])))?;
    let names = names_of(head);
    let place = |name: &&str| {
        names.iter().position(|n| n == name).ok_or_else(|| {
            fail(format!("expected a column `{name}`, found the columns {}", names.join(", ")))
        })
    };
    let places: Vec<usize> = wanted.iter().map(place).collect::<Result<_, _>>()?;
    let mut rows: Vec<(usize, Vec<f64>)> = Vec::new();
    for (line, text) in lines {
        let cells: Vec<&str> = text.split(',').map(str::trim).collect();
        if cells.len() != names.len() {
            return Err(fail(format!(
                "line {line}: expected {} columns, found {}",
                names.len(),
                cells.len()
            )));
        }
        if rows.len() == MAX_ROWS {
            return Err(fail(format!("line {line}: more than {MAX_ROWS} rows")));
        }
        let number = |k: &usize| match cells[*k].parse::<f64>() {
            Ok(v) if v.is_finite() => Ok(v),
            _ => Err(fail(format!(
                "line {line}, column {}: expected a number, found `{}`",
                names[*k], cells[*k]
            ))),
        };
        let numbers: Vec<f64> = places.iter().map(number).collect::<Result<_, _>>()?;
        if let Some((_, last)) = rows.last().filter(|(_, last)| last[0] >= numbers[0]) {
            return Err(fail(format!(
                "line {line}: expected a {} above {}, the row before, found {}",
                wanted[0], last[0], numbers[0]
            )));
        }
        rows.push((line, numbers));
    }
    let expected = if least == 1 { "a row of numbers" } else { "two rows of numbers" };
    match rows.len() < least {
        true => Err(fail(format!("expected {expected} or more, found {}", rows.len()))),
        false => Ok(rows),
    }
}

/// Names of the columns in a header line.
pub(super) fn names_of(head: &str) -> Vec<&str> {
    head.trim_start_matches('\u{feff}').split(',').map(str::trim).collect()
}

/// Reads column `column` of the CSV `text`.
pub(super) fn curve(path: &Path, text: &str, column: &str, quantity: Quantity) -> Result<Curve, SensorError> {
    let fail = |problem: String| SensorError::Table { path: path.into(), problem };
    let mut curve = Curve::default();
    for (line, [nm, value]) in columns(path, text, ["wavelength_nm", column])? {
        WAVELENGTH_NM.check(nm).map_err(|e| fail(format!("line {line}: {e}")))?;
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
        curve.wavelengths_nm.push(nm);
        curve.values.push(value.max(0.0));
    }
    if quantity != Quantity::Reflectance && curve.values.iter().all(|v| *v == 0.0) {
        return Err(fail(format!("column {column}: expected a value above 0, found none")));
    }
    Ok(curve)
}
