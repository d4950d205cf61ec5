//! Commands of an OSLO lens file: separated by line ends or `;`, commented by `//`; words in quotes may hold blanks.

use crate::design::error::LensFileError;
use crate::design::text;

/// A command with its words.
pub(super) struct Command<'a> {
    pub(super) line: usize,
    pub(super) text: &'a str,
    pub(super) words: Vec<&'a str>,
}

impl Command<'_> {
    pub(super) fn error(&self, problem: impl Into<String>) -> LensFileError {
        LensFileError::Line { line: self.line, text: self.quote(), problem: problem.into() }
    }

    /// The text for an error.
    pub(super) fn quote(&self) -> String {
        text::quote(self.text)
    }

    pub(super) fn value(&self, i: usize) -> Result<f64, LensFileError> {
        let word =
            self.words.get(i).ok_or_else(|| self.error(format!("expected a number as word {}", i + 1)))?;
        text::number(word).ok_or_else(|| self.error(text::not_a_number(word)))
    }

    /// All values from word `first` on.
    pub(super) fn values(&self, first: usize) -> Result<Vec<f64>, LensFileError> {
        (first..self.words.len()).map(|i| self.value(i)).collect()
    }

    /// Whether a switch is on: without word, ON, Y or a number other than 0.
    pub(super) fn is_on(&self) -> bool {
        self.words.get(1).is_none_or(|w| !["OFF", "N", "NO", "0"].contains(&w.to_ascii_uppercase().as_str()))
    }
}

/// Splits a file into commands.
pub(super) fn commands(text: &str) -> impl Iterator<Item = Command<'_>> {
    text.lines().enumerate().flat_map(|(i, line)| {
        split(line).into_iter().filter_map(move |part| {
            let words = words(part);
            (!words.is_empty()).then_some(Command { line: i + 1, text: part, words })
        })
    })
}

/// Parts of a line between `;`, up to a comment.
fn split(line: &str) -> Vec<&str> {
    let (mut parts, mut start, mut is_quoted) = (Vec::new(), 0, false);
    for (i, c) in line.char_indices() {
        match c {
            '"' => is_quoted = !is_quoted,
            ';' if !is_quoted => {
                parts.push(&line[start..i]);
                start = i + 1;
            }
            '/' if !is_quoted && line[i..].starts_with("//") => {
                parts.push(&line[start..i]);
                return parts;
            }
            _ => (),
        }
    }
    parts.push(&line[start..]);
    parts
}

fn words(part: &str) -> Vec<&str> {
    let (mut words, mut start, mut is_quoted) = (Vec::new(), None, false);
    for (i, c) in part.char_indices() {
        is_quoted ^= c == '"';
        match (c.is_whitespace() && !is_quoted, start) {
            (true, Some(from)) => {
                words.push(&part[from..i]);
                start = None;
            }
            (false, None) => start = Some(i),
            _ => (),
        }
    }
    words.extend(start.map(|from| &part[from..]));
    words
}
