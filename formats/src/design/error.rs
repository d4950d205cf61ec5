//! Errors of lens files and glass catalogues.

use pipeline::design::DesignError;
use thiserror::Error;

/// A lens file or glass catalogue that cannot be read or written.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum LensFileError {
    /// A line that is wrong or not supported.
    #[error("line {line} of the design: `{text}`: {problem}")]
    Line {
        /// Line number from 1.
        line: usize,
        /// The line.
        text: String,
        /// What is wrong, and the way out.
        problem: String,
    },
    /// A part of the prescription is missing, impossible or not supported.
    #[error("the design {problem}")]
    Incomplete {
        /// What is missing or impossible.
        problem: String,
    },
    /// A line of a glass catalogue that is wrong.
    #[error("line {line} of the glass catalogue: {problem}")]
    Catalogue {
        /// Line number from 1.
        line: usize,
        /// What is wrong.
        problem: String,
    },
    /// A coating that is not known or cannot be used, or a coating file that cannot be read.
    #[error("{problem}")]
    Coating {
        /// What is wrong.
        problem: String,
    },
    /// A file that is not what its ending says, or is not read.
    #[error("{problem}")]
    Content {
        /// What is wrong, and the way out.
        problem: String,
    },
    /// An ending that no format has.
    #[error("a design ending with `.{ending}` is not known; expected {known}")]
    Ending {
        /// The ending.
        ending: String,
        /// Those of the formats.
        known: String,
    },
    /// A file in an archive.
    #[error("{name}")]
    Member {
        /// Its name.
        name: String,
        /// What is wrong with it.
        source: Box<LensFileError>,
    },
    /// A prescription that cannot be traced, or a glass that is not known.
    #[error(transparent)]
    Design(#[from] DesignError),
}
