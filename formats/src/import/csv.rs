//! Plain CSV: a header line of names, then rows of numbers; `#` starts a comment; columns in any order.

use super::matrix::short;
use super::{ImportError, MAX_COUNT, text};
use std::path::{Path, PathBuf};

/// A table by column names.
pub(super) struct Csv {
    pub path: PathBuf,
    names: Vec<String>,
    /// Line number and fields.
    pub rows: Vec<(usize, Vec<String>)>,
}

impl Csv {
    pub fn read(path: &Path) -> Result<Self, ImportError> {
        let content = &text::read(path)?;
        let mut lines =
            text::numbered_lines(content).map(|(n, l)| (n, l.split('#').next().unwrap_or("").trim()));
        let fields = |l: &str| l.split(',').map(|f| f.trim().to_string()).collect::<Vec<_>>();
        let head = lines.by_ref().find(|(_, l)| !l.is_empty());
        let (_, head) =
            head.ok_or_else(|| ImportError::file(path, "is empty, expected a line of column names"))?;
        let names = fields(head);
        let mut rows = Vec::new();
        for (line, text) in lines.filter(|(_, l)| !l.is_empty()) {
            let row = fields(text);
            if row.len() != names.len() {
                let (found, expected) = (row.len(), names.len());
                let problem =
                    format!("{found} columns, expected {expected}; numbers must have decimal points");
                return Err(ImportError::line(path, line, problem));
            }
            if rows.len() == MAX_COUNT * MAX_COUNT {
                let problem = format!("more than {} rows", MAX_COUNT * MAX_COUNT);
                return Err(ImportError::line(path, line, problem));
            }
            rows.push((line, row));
        }
        Ok(Self { path: path.into(), names, rows })
    }

    /// Index of a column, if there is one of the name.
    pub fn optional_column(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| n == name)
    }

    /// Index of a required column.
    pub fn column(&self, name: &str) -> Result<usize, ImportError> {
        self.optional_column(name).ok_or_else(|| {
            let names: Vec<_> = self.names.iter().take(12).map(|n| short(n)).collect();
            ImportError::file(&self.path, format!("has no column `{name}`, only {}", names.join(", ")))
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
