//! What all readers of designs are given beside the file.

/// How to read a design.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Make unknown keywords, and optics that would be ignored, an error.
    pub strict: bool,
    /// Number of the configuration from 1; none is the first.
    pub configuration: Option<usize>,
}

impl ReadOptions {
    /// Checks that a format without configurations is not read in another than the first.
    ///
    /// # Errors
    /// [`LensFileError::Incomplete`](super::error::LensFileError::Incomplete).
    pub(super) fn only_one_configuration(&self) -> Result<(), super::error::LensFileError> {
        match self.configuration {
            None | Some(1) => Ok(()),
            Some(n) => Err(super::error::LensFileError::Incomplete {
                problem: format!("has one configuration, and --configuration is {n}"),
            }),
        }
    }
}
