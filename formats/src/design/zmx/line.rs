//! A line of a .zmx file: a keyword and its values.

use crate::design::error::LensFileError;
use crate::design::text;

/// What a note says of optics or a keyword that is not read; an error where the caller is strict.
pub(super) const IGNORED: &str = "was ignored";

/// A line split into words, the first of which is the keyword.
pub(super) struct Line<'a> {
    pub(super) number: usize,
    pub(super) text: &'a str,
    pub(super) words: &'a [&'a str],
}

impl Line<'_> {
    pub(super) fn error(&self, problem: impl Into<String>) -> LensFileError {
        LensFileError::Line { line: self.number, text: self.quote(), problem: problem.into() }
    }

    /// Note on a keyword that is neither read nor known not to matter.
    pub(super) fn ignored(&self) -> String {
        format!("line {}: `{}` is not a known keyword and {IGNORED}", self.number, self.quote())
    }

    /// The text for an error.
    pub(super) fn quote(&self) -> String {
        text::quote(self.text)
    }

    /// Value `i` (the keyword is 0).
    pub(super) fn value(&self, i: usize) -> Result<f64, LensFileError> {
        let word =
            self.words.get(i).ok_or_else(|| self.error(format!("expected a number as word {}", i + 1)))?;
        self.finite(word)
    }

    /// Value `i`, or `missing` in older files without it.
    pub(super) fn value_or(&self, i: usize, missing: f64) -> Result<f64, LensFileError> {
        self.words.get(i).map_or(Ok(missing), |w| self.finite(w))
    }

    fn finite(&self, word: &str) -> Result<f64, LensFileError> {
        text::number(word).ok_or_else(|| self.error(text::not_a_number(word)))
    }

    pub(super) fn values(&self) -> Result<Vec<f64>, LensFileError> {
        self.words[1..].iter().map(|w| self.finite(w)).collect()
    }
}
