//! Errors of descriptions of manufacturing errors.

use std::path::PathBuf;

use pipeline::design::tolerance::ToleranceError;

/// A description that cannot be used.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum ToleranceFileError {
    /// Not TOML; the message has line and column.
    #[error("tolerances {}: {message}", .path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// A key that is not known.
    #[error("tolerances {}: line {line}: {table} has no key `{key}`; did you mean `{nearest}`? Keys: {known}", .path.display())]
    Key {
        /// The file.
        path: PathBuf,
        /// Line of the key.
        line: usize,
        /// Its table.
        table: String,
        /// The key.
        key: String,
        /// The known one that differs in the fewest letters.
        nearest: &'static str,
        /// All known ones.
        known: String,
    },
    /// A value that cannot be, or is missing.
    #[error("tolerances {}: line {line}: {field}: expected {expected}, found {found}", .path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// Line of the value, or of its table.
        line: usize,
        /// Table and key.
        field: String,
        /// What it must be.
        expected: String,
        /// What it is.
        found: String,
    },
    /// An error that does not fit the lens, or another error.
    #[error("tolerances {}: line {line}: {source}{}", .path.display(), .other_line.map_or(String::new(), |l| format!(" (the other one: line {l})")))]
    Tolerance {
        /// The file.
        path: PathBuf,
        /// Its line.
        line: usize,
        /// Line of the error that it is at odds with.
        other_line: Option<usize>,
        /// What is wrong.
        source: Box<ToleranceError>,
    },
}
