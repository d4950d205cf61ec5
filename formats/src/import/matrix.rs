//! A rectangular table of numbers, with the line of each row for error messages.

use super::text::number;
use super::{ImportError, MAX_SIDE};
use std::path::Path;

/// A rectangular table of numbers.
#[derive(Debug)]
pub(super) struct Matrix {
    pub rows: usize,
    pub columns: usize,
    pub values: Vec<f64>,
    /// Line number of every row.
    pub lines: Vec<usize>,
}

impl Matrix {
    /// Reads all `lines` (number, text); empty ones are skipped.
    pub fn read<'a>(path: &Path, lines: impl Iterator<Item = (usize, &'a str)>) -> Result<Self, ImportError> {
        let mut m = Self { rows: 0, columns: 0, values: Vec::new(), lines: Vec::new() };
        for (line, text) in lines {
            let before = m.values.len();
            for field in text.split_whitespace() {
                let value = number(field).ok_or_else(|| {
                    ImportError::line(path, line, format!("`{}` is not a finite number", short(field)))
                })?;
                m.values.push(value);
            }
            let columns = m.values.len() - before;
            if columns == 0 {
                continue;
            }
            if m.rows == 0 {
                m.columns = columns;
            }
            if columns != m.columns {
                let expected = m.columns;
                let problem = format!("{columns} numbers, expected {expected} as in the rows above");
                return Err(ImportError::line(path, line, problem));
            }
            if m.rows == MAX_SIDE * MAX_SIDE || columns > MAX_SIDE {
                return Err(ImportError::line(path, line, format!("more than {MAX_SIDE} rows or columns")));
            }
            m.rows += 1;
            m.lines.push(line);
        }
        Ok(m)
    }
}

/// The start of a text, short enough for an error message.
pub(super) fn short(text: &str) -> String {
    match text.char_indices().nth(24) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.into(),
    }
}
