//! Tables in OpticStudio's text listings: a wavelength line, a line of column titles, rows of numbers over field angle.

use super::text::{number, numbers};

/// Accepted wavelengths, µm.
pub(super) const WAVELENGTH_UM: std::ops::RangeInclusive<f64> = 0.05..=100.0;

/// The wavelength in nm of a lower-case line that gives it in µm.
pub(super) fn wavelength_nm(line: &str) -> Option<f64> {
    let um = *numbers(&line.replace(':', " ")).first()?;
    WAVELENGTH_UM.contains(&um).then_some(um * 1e3)
}

/// Titles of the columns of a table whose first column is the field angle in degrees.
pub(super) struct Titles(Vec<String>);

impl Titles {
    /// Reads a line of titles, which are two blanks or a tab apart.
    pub fn parse(line: &str) -> Result<Self, String> {
        let parts = line.trim().split('\t').flat_map(|part| part.split("  "));
        let titles: Vec<_> = parts.map(|t| t.trim().to_lowercase()).filter(|t| !t.is_empty()).collect();
        match titles.first() {
            Some(first) if first.contains("deg") => Ok(Self(titles)),
            _ => Err("the first column is no field angle in degrees; list it with fields as angles".into()),
        }
    }

    /// Index of the first column whose title has all of these texts, and the number of columns.
    pub fn column(&self, texts: &[&str]) -> Option<(usize, usize)> {
        let column = self.0.iter().position(|title| texts.iter().all(|t| title.contains(t)));
        column.map(|c| (c, self.0.len()))
    }
}

/// The numbers of a row, if it has nothing else.
pub(super) fn row(line: &str) -> Option<Vec<f64>> {
    line.split_whitespace().map(number).collect()
}
