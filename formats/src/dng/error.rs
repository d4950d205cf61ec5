//! Errors of reading a DNG.

use std::path::PathBuf;

/// A DNG that cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DngError {
    /// The file cannot be read.
    #[error("reading the DNG {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The file is damaged.
    #[error("the DNG {} is damaged: {reason}; copy it again from the camera, or convert it again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A property that is not supported.
    #[error("{what} of the DNG {}: expected {expected}, found {found}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The property.
        what: &'static str,
        /// What is supported, and the way out.
        expected: String,
        /// What the file has.
        found: String,
    },
}
