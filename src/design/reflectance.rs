//! The reflectance of a film: `--sensor-reflectance`.

use super::bytes::read_bytes;
use crate::args::ReflectanceArg;
use anyhow::{Context, Result, bail};
use pipeline::design::ghost::operator::Reflectance;

/// First line of a table.
const HEADER: &str = "wavelength_nm,reflectance";
/// Largest number of its lines.
const MAX_LINES: usize = 10_000;

/// The reflectance that the flag gives; a table is read.
///
/// # Errors
/// A file that cannot be read or is no table of ascending wavelengths and reflectances from 0 to below 1.
pub fn reflectance(given: &ReflectanceArg) -> Result<Reflectance> {
    let path = match given {
        ReflectanceArg::Number(share) => return Ok(Reflectance(vec![(0.0, *share)])),
        ReflectanceArg::File(path) => path,
    };
    let text = String::from_utf8(read_bytes(path)?).ok();
    let of_table = || format!("--sensor-reflectance {}", path.display());
    table(&text.unwrap_or_default()).with_context(of_table)
}

fn table(text: &str) -> Result<Reflectance> {
    let mut lines = text.lines().map(str::trim).filter(|l| !l.is_empty());
    if lines.next().map(|l| l.replace(' ', "")).as_deref() != Some(HEADER) {
        bail!("the first line must be `{HEADER}`, then a wavelength in nm and a reflectance per line");
    }
    let mut entries: Vec<(f64, f64)> = Vec::new();
    for line in lines {
        let pair = line.split_once(',').and_then(|(nm, r)| Some((number(nm)?, number(r)?)));
        let Some((nm, r)) = pair.filter(|(nm, r)| *nm > 0.0 && (0.0..1.0).contains(r)) else {
            bail!("`{line}` is not a wavelength in nm and a reflectance from 0 to below 1");
        };
        if entries.last().is_some_and(|(last, _)| *last >= nm) {
            bail!("the wavelengths must ascend; {nm} nm does not");
        }
        if entries.len() == MAX_LINES {
            bail!("more than {MAX_LINES} lines");
        }
        entries.push((nm, r));
    }
    match entries.is_empty() {
        true => bail!("the table has no lines"),
        false => Ok(Reflectance(entries)),
    }
}

fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|v: &f64| v.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_is_read_and_wrong_lines_are_named() {
        let read = table("wavelength_nm, reflectance\n400, 0.1\n500,0.2\n").unwrap();
        assert!((read.at(450.0).unwrap() - 0.15).abs() < 1e-12 && read.at(399.0).is_err());
        for (text, problem) in [
            ("400,0.1", "first line"),
            ("wavelength_nm,reflectance\n400,1.0", "`400,1.0`"),
            ("wavelength_nm,reflectance\n400,0.1\n400,0.2", "ascend"),
            ("wavelength_nm,reflectance\n", "no lines"),
        ] {
            let error = table(text).unwrap_err().to_string();
            assert!(error.contains(problem), "{error}");
        }
    }
}
