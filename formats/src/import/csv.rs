//! Plain CSV: a header line of names, then rows of numbers; `#` starts a comment; columns in any order.

use super::matrix::short;
use super::{ImportError, MOST, text};
use std::path::{Path, PathBuf};

/// A table by column names.
pub(super) struct Csv {
    pub path: PathBuf,
    names: Vec<String>,
    /// (line, words).
    pub rows: Vec<(usize, Vec<String>)>,
}

impl Csv {
    pub fn read(path: &Path) -> Result<Self, ImportError> {
        Self::parse(path, &text::read(path)?)
    }

    pub fn parse(path: &Path, text: &str) -> Result<Self, ImportError> {
        let mut lines =
            text.lines().enumerate().map(|(i, l)| (i + 1, l.split('#').next().unwrap_or("").trim()));
        let words = |l: &str| l.split(',').map(|w| w.trim().to_string()).collect::<Vec<_>>();
        let head = lines.by_ref().find(|(_, l)| !l.is_empty());
        let (_, head) =
            head.ok_or_else(|| ImportError::file(path, "is empty, expected a line of column names"))?;
        let names = words(head);
        let mut rows = Vec::new();
        for (line, text) in lines.filter(|(_, l)| !l.is_empty()) {
            let row = words(text);
            if row.len() != names.len() {
                let (found, expected) = (row.len(), names.len());
                return Err(ImportError::line(
                    path,
                    line,
                    format!("{found} columns, expected {expected}; numbers here have decimal points"),
                ));
            }
            if rows.len() == MOST * MOST {
                return Err(ImportError::line(path, line, format!("more than {} rows", MOST * MOST)));
            }
            rows.push((line, row));
        }
        Ok(Self { path: path.into(), names, rows })
    }

    /// Index of a required column.
    pub fn column(&self, name: &str) -> Result<usize, ImportError> {
        self.names.iter().position(|n| n == name).ok_or_else(|| {
            ImportError::file(
                &self.path,
                format!("has no column `{name}`; its columns are {}", short_list(&self.names)),
            )
        })
    }

    /// The number at row `r`, column `c`.
    pub fn number(&self, r: usize, c: usize) -> Result<f64, ImportError> {
        let (line, row) = &self.rows[r];
        text::number(&row[c]).ok_or_else(|| {
            ImportError::line(
                &self.path,
                *line,
                format!("{} is `{}`, not a finite number", self.names[c], short(&row[c])),
            )
        })
    }
}

fn short_list(names: &[String]) -> String {
    names.iter().take(12).map(|n| short(n)).collect::<Vec<_>>().join(", ")
}
