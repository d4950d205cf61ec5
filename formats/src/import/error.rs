//! What can be wrong with an export: which file, which line, what was expected, the way out.

use crate::lens::LensPackError;
use pipeline::lens::LensError;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// An export that cannot be made a lens pack.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ImportError {
    /// The operating system refused.
    #[error("{path}: cannot {action}: {source}")]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was being done.
        action: &'static str,
        /// What it said.
        source: std::io::Error,
    },
    /// A line cannot be used.
    #[error("{path}, line {line}: {problem}")]
    Line {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What was found, what was expected.
        problem: String,
    },
    /// A file as a whole cannot be used.
    #[error("{path}: {problem}")]
    File {
        /// The file or folder.
        path: PathBuf,
        /// What was found, what was expected.
        problem: String,
    },
    /// What the source does not tell and nobody may guess.
    #[error("{path} does not tell {what}; say it by `{option}`")]
    Ask {
        /// The file or folder.
        path: PathBuf,
        /// What is not known.
        what: &'static str,
        /// The option that tells it.
        option: &'static str,
    },
    /// An option that this source has no use for, or cannot obey.
    #[error("`{option}`: {problem}")]
    Option {
        /// The option.
        option: &'static str,
        /// Why.
        problem: String,
    },
    /// The tables break the lens's contract.
    #[error("{path}: {source}")]
    Table {
        /// The source.
        path: PathBuf,
        /// Which table, and how.
        source: LensError,
    },
    /// The pack cannot be written.
    #[error(transparent)]
    Pack(#[from] LensPackError),
}

impl ImportError {
    pub(super) fn file(path: &Path, problem: impl Into<String>) -> Self {
        Self::File { path: path.into(), problem: problem.into() }
    }

    pub(super) fn line(path: &Path, line: usize, problem: impl Into<String>) -> Self {
        Self::Line { path: path.into(), line, problem: problem.into() }
    }

    /// The command line is to blame, not the files.
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::Ask { .. } | Self::Option { .. })
    }
}
