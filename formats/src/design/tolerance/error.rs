//! Errors of descriptions of manufacturing errors.

use std::path::PathBuf;

use pipeline::design::tolerance::ToleranceError;

use crate::toml_table::TableError;

/// A description that cannot be used.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum ToleranceFileError {
    /// Not TOML, or an entry that cannot be.
    #[error("tolerances {0}")]
    Text(#[from] TableError),
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
