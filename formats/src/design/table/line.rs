//! A line of a table.

use crate::design::error::LensFileError;
use crate::design::text;

/// A line of the file, split into cells.
pub(super) struct Line<'a> {
    pub(super) number: usize,
    pub(super) text: &'a str,
    pub(super) cells: Vec<String>,
    /// Whether a comma may be a decimal point.
    pub(super) has_decimal_commas: bool,
}

impl Line<'_> {
    pub(super) fn error(&self, problem: impl Into<String>) -> LensFileError {
        LensFileError::Line { line: self.number, text: text::quote(self.text), problem: problem.into() }
    }

    pub(super) fn cell(&self, i: usize) -> &str {
        self.cells.get(i).map_or("", String::as_str)
    }

    /// A number, possibly infinite.
    pub(super) fn number(&self, cell: &str) -> Result<f64, LensFileError> {
        if text::is_infinite(cell) {
            return Ok(if cell.starts_with(['-', '−', '–']) { f64::NEG_INFINITY } else { f64::INFINITY });
        }
        let plain = if self.has_decimal_commas { cell.replace(',', ".") } else { cell.to_owned() };
        text::number(&plain).ok_or_else(|| self.error(text::not_a_number(cell)))
    }
}
