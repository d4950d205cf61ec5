//! Errors of developments.

use crate::geometry::Size;
use thiserror::Error;

/// A development that is not possible.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum DevelopError {
    /// A method for Bayer patterns on another one.
    #[error(
        "demosaicing by malvar: expected a Bayer pattern (2 x 2 pixels of R, G, G, B), found {columns} x {rows} pixels of {planes} planes; \
         use bilinear, or superpixel"
    )]
    NotBayer {
        /// Rows of the period.
        rows: usize,
        /// Columns of the period.
        columns: usize,
        /// Number of planes.
        planes: usize,
    },
    /// Blocks of 2 × 2 pixels that have several filters.
    #[error(
        "binning by 2: expected 2 x 2 pixels of one filter (a quad or monochrome pattern), found several filters in a block"
    )]
    Bin,
    /// A raw smaller than a period of its pattern.
    #[error("the raw of {size} pixels is smaller than the period of its pattern, {columns} x {rows}")]
    TooSmall {
        /// The raw, after binning.
        size: Size,
        /// Rows of the period.
        rows: usize,
        /// Columns of the period.
        columns: usize,
    },
    /// A matrix that does not exist or does not fit.
    #[error("colour matrix of sensor {sensor}: {problem}")]
    Matrix {
        /// The sensor.
        sensor: String,
        /// What is wrong.
        problem: String,
    },
}
