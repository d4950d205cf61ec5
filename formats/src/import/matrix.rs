//! Numbers in lines: a rectangle of them, each line remembered so that an error can name it.

use super::text::number;
use super::{ImportError, WIDEST};
use std::path::Path;

/// A rectangle of numbers.
#[derive(Debug)]
pub(super) struct Matrix {
    pub rows: usize,
    pub columns: usize,
    pub values: Vec<f64>,
    /// Line in the file of every row.
    pub lines: Vec<usize>,
}

impl Matrix {
    /// Reads `lines` (number, text) to their end; empty ones are skipped.
    pub fn read<'a>(path: &Path, lines: impl Iterator<Item = (usize, &'a str)>) -> Result<Self, ImportError> {
        let mut m = Self { rows: 0, columns: 0, values: Vec::new(), lines: Vec::new() };
        for (line, text) in lines {
            let before = m.values.len();
            for word in text.split_whitespace() {
                let value = number(word).ok_or_else(|| {
                    ImportError::line(path, line, format!("`{}` is not a finite number", short(word)))
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
                return Err(ImportError::line(
                    path,
                    line,
                    format!("{columns} numbers, expected {expected} as above"),
                ));
            }
            if m.rows == WIDEST * WIDEST || columns > WIDEST {
                return Err(ImportError::line(path, line, format!("more than {WIDEST} rows or columns")));
            }
            m.rows += 1;
            m.lines.push(line);
        }
        Ok(m)
    }
}

/// The start of a word, short enough for an error line.
pub(super) fn short(word: &str) -> String {
    match word.char_indices().nth(24) {
        Some((end, _)) => format!("{}…", &word[..end]),
        None => word.into(),
    }
}
