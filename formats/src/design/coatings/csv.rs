//! Measured coatings: `wavelength_nm,angle_deg,rs,rp[,ts,tp]`, a row for each wavelength at each angle; without T, T = 1 − R.

use super::{MAX_ROWS, check_powers};
use pipeline::design::coating::CoatingTable;

/// Reads a table named `name`.
///
/// # Errors
/// The line and what is wrong with it.
pub(super) fn parse(name: &str, text: &str) -> Result<CoatingTable, String> {
    let rows = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    let mut rows = rows.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let (line, header) = rows.next().ok_or("the table is empty")?;
    let columns: Vec<String> = header.split(',').map(|c| c.trim().to_ascii_lowercase()).collect();
    let expected = ["wavelength_nm", "angle_deg", "rs", "rp", "ts", "tp"];
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    if columns != expected[..4] && columns != expected {
        return Err(format!(
            "line {line}: found the columns {header}, expected {}[,ts,tp]",
            expected[..4].join(",")
        ));
    }
    let mut values: Vec<(f64, f64, [f64; 4])> = Vec::new();
    for (line, row) in rows {
        if values.len() == MAX_ROWS {
            return Err(format!("line {line}: more than {MAX_ROWS} rows"));
        }
        let numbers: Option<Vec<f64>> =
            row.split(',').map(|cell| cell.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
        let numbers = numbers.filter(|n| n.len() == columns.len());
        let n = numbers.ok_or_else(|| format!("line {line}: expected {} numbers", columns.len()))?;
        let (rs, rp) = (n[2], n[3]);
        let powers = if n.len() == 6 { [rs, rp, n[4], n[5]] } else { [rs, rp, 1.0 - rs, 1.0 - rp] };
        check_powers(powers).map_err(|problem| format!("line {line}: {problem}"))?;
        values.push((n[0] / 1e3, n[1], powers));
    }
    grid(name, values)
}

/// The grid of `values` (wavelength in µm, angle in degrees, R_s, R_p, T_s, T_p), each wavelength at each angle once.
///
/// # Errors
/// A gap in the grid, or an angle beyond 0 to 90 degrees.
pub(super) fn grid(name: &str, mut values: Vec<(f64, f64, [f64; 4])>) -> Result<CoatingTable, String> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut wavelengths_um: Vec<f64> = values.iter().map(|v| v.0).collect();
    wavelengths_um.dedup();
    let mut angles_deg: Vec<f64> = values.iter().map(|v| v.1).collect();
    angles_deg.sort_by(f64::total_cmp);
    angles_deg.dedup();
    let at = |i: usize| (wavelengths_um[i / angles_deg.len()], angles_deg[i % angles_deg.len()]);
    let is_whole = values.len() == wavelengths_um.len() * angles_deg.len()
        && values.iter().enumerate().all(|(i, v)| (v.0, v.1) == at(i));
    if !is_whole || values.is_empty() {
        return Err(format!(
            "expected a value for each of {} wavelengths at each of {} angles, found {}",
            wavelengths_um.len(),
            angles_deg.len(),
            values.len()
        ));
    }
    if wavelengths_um[0] <= 0.0 || angles_deg[0] < 0.0 || angles_deg[angles_deg.len() - 1] > 90.0 {
        return Err("expected positive wavelengths and angles from 0 to 90 degrees".to_owned());
    }
    Ok(CoatingTable {
        name: name.to_owned(),
        wavelengths_um,
        angles_deg,
        values: values.into_iter().map(|v| v.2).collect(),
    })
}
