//! Errors of an import: file, line, expectation, and the option that helps.

use crate::lens::LensPackError;
use crate::toml_table::TableError;
use pipeline::lens::LensError;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// An export that cannot be converted to a lens pack.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ImportError {
    /// Error of the operating system.
    #[error("{path}: cannot {action}: {source}")]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The operation, a verb.
        action: &'static str,
        /// Its cause.
        source: std::io::Error,
    },
    /// Invalid line.
    #[error("{path}, line {line}: {problem}")]
    Line {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Found and expected content.
        problem: String,
    },
    /// Invalid or missing file.
    #[error("{path}: {problem}")]
    File {
        /// The file or folder.
        path: PathBuf,
        /// Found and expected content.
        problem: String,
    },
    /// A property that the files do not state, and that has no safe default.
    #[error("{path} does not state {what}; give it by `{option}`")]
    MissingOption {
        /// The file or folder.
        path: PathBuf,
        /// The property.
        what: &'static str,
        /// The option that states it.
        option: &'static str,
    },
    /// Invalid value of an option, or options that exclude each other.
    #[error("`{option}`: {problem}")]
    Option {
        /// The option.
        option: &'static str,
        /// The cause.
        problem: String,
    },
    /// Tables that are not those of a valid lens.
    #[error("{path}: {source}")]
    Table {
        /// The source.
        path: PathBuf,
        /// The table and its error.
        source: LensError,
    },
    /// The pack cannot be written.
    #[error(transparent)]
    Pack(#[from] LensPackError),
}

impl ImportError {
    /// Conversion of an operating system error; `action` is a verb.
    pub(super) fn io(path: &Path, action: &'static str) -> impl Fn(std::io::Error) -> Self {
        move |source| Self::Io { path: path.into(), action, source }
    }

    pub(super) fn file(path: &Path, problem: impl Into<String>) -> Self {
        Self::File { path: path.into(), problem: problem.into() }
    }

    pub(super) fn line(path: &Path, line: usize, problem: impl Into<String>) -> Self {
        Self::Line { path: path.into(), line, problem: problem.into() }
    }

    /// Whether the command line is to be corrected, not the files.
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::MissingOption { .. } | Self::Option { .. })
    }
}

impl From<TableError> for ImportError {
    fn from(TableError { path, line, problem }: TableError) -> Self {
        match line {
            Some(line) => Self::Line { path, line, problem },
            None => Self::File { path, problem },
        }
    }
}
