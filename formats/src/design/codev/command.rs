//! Commands of a sequence file: separated by line ends or `;`, continued by `&`, commented by `!`.

use crate::design::error::LensFileError;
use crate::design::text;
use std::ops::RangeInclusive;

/// Highest number of a field or wavelength.
const MAX_NUMBERED: usize = 1000;

/// A command with its words.
pub(super) struct Command<'a> {
    pub(super) line: usize,
    pub(super) text: &'a str,
    pub(super) words: Vec<&'a str>,
}

impl Command<'_> {
    pub(super) fn error(&self, problem: impl Into<String>) -> LensFileError {
        let text = text::quote(self.text);
        LensFileError::Line { line: self.line, text, problem: problem.into() }
    }

    pub(super) fn value(&self, i: usize) -> Result<f64, LensFileError> {
        let word =
            *self.words.get(i).ok_or_else(|| self.error(format!("expected a number as word {}", i + 1)))?;
        if word.starts_with('^') {
            return Err(self.error("a variable: this is a CODE V macro, expected a saved lens"));
        }
        text::number(word).ok_or_else(|| self.error(text::not_a_number(word)))
    }

    /// As `value`; `INF` and `INFINITY` are infinite.
    pub(super) fn value_or_infinite(&self, i: usize) -> Result<f64, LensFileError> {
        match self.words.get(i).is_some_and(|w| w.to_ascii_uppercase().starts_with("INF")) {
            true => Ok(f64::INFINITY),
            false => self.value(i),
        }
    }

    /// Whether word `i` is the name of a solve for a thickness or curvature, or of a pickup.
    pub(super) fn is_solve(&self, i: usize) -> bool {
        const SOLVES: [&str; 7] = ["HMY", "HCY", "UMY", "UCY", "IMY", "ICY", "PIK"];
        self.words.get(i).is_some_and(|w| SOLVES.contains(&w.to_ascii_uppercase().as_str()))
    }

    /// Reads values in order, or numbered by words such as `F2` before them, into `list`.
    pub(super) fn read_list(&self, label: char, list: &mut Vec<f64>) -> Result<(), LensFileError> {
        let number = |word: &str| {
            let digits = word.strip_prefix([label, label.to_ascii_lowercase()])?;
            digits.parse().ok().filter(|n| (1..=MAX_NUMBERED).contains(n))
        };
        let mut at = None;
        let mut fresh = Vec::new();
        for i in 1..self.words.len() {
            if let Some(n) = number(self.words[i]) {
                at = Some(n);
                continue;
            }
            let value = self.value(i)?;
            match at.take() {
                Some(n) => {
                    list.resize(list.len().max(n), 0.0);
                    list[n - 1] = value;
                }
                None => fresh.push(value),
            }
        }
        if !fresh.is_empty() {
            *list = fresh;
        }
        Ok(())
    }

    /// The surface number of a word such as `S3`.
    pub(super) fn surface(&self, i: usize) -> Option<usize> {
        let word = self.words.get(i)?;
        word.strip_prefix(['S', 's'])?.parse().ok()
    }

    /// The numbers of the surfaces that a word names: `S3`, `SO` (object), `SI` (image, number `image`), or a range such as `S1..5`.
    pub(super) fn surfaces(&self, i: usize, image: Option<usize>) -> Option<RangeInclusive<usize>> {
        let word = self.words.get(i)?.to_ascii_uppercase();
        let number = |name: &str| match name {
            "O" => Some(0),
            "I" => image,
            digits => digits.parse().ok(),
        };
        let names = word.strip_prefix('S')?;
        let (first, last) = names.split_once("..").unwrap_or((names, names));
        Some(number(first)?..=number(last.strip_prefix('S').unwrap_or(last))?)
    }
}

/// Splits a file into commands.
pub(super) fn commands(text: &str) -> Vec<Command<'_>> {
    let mut commands: Vec<Command<'_>> = Vec::new();
    let mut is_continued = false;
    for (i, raw) in text.lines().enumerate() {
        let line = before_comment(raw);
        let trimmed = line.trim_end();
        let (line, continues) = trimmed.strip_suffix('&').map_or((trimmed, false), |l| (l, true));
        for (k, part) in split_outside_quotes(line).into_iter().enumerate() {
            let words: Vec<&str> = part.split_whitespace().collect();
            match commands.last_mut() {
                Some(last) if is_continued && k == 0 => last.words.extend(words),
                _ if words.is_empty() => (),
                _ => commands.push(Command { line: i + 1, text: part, words }),
            }
        }
        is_continued = continues;
    }
    commands
}

fn before_comment(line: &str) -> &str {
    let mut quote = None;
    for (i, c) in line.char_indices() {
        match (quote, c) {
            (None, '!') => return &line[..i],
            (None, '\'' | '"') => quote = Some(c),
            (Some(q), c) if c == q => quote = None,
            _ => (),
        }
    }
    line
}

fn split_outside_quotes(line: &str) -> Vec<&str> {
    let (mut parts, mut start, mut quote) = (Vec::new(), 0, None);
    for (i, c) in line.char_indices() {
        match (quote, c) {
            (None, ';') => {
                parts.push(&line[start..i]);
                start = i + 1;
            }
            (None, '\'' | '"') => quote = Some(c),
            (Some(q), c) if c == q => quote = None,
            _ => (),
        }
    }
    parts.push(&line[start..]);
    parts
}

/// Whether all curved surfaces have values above 1: radii, since lenses of curvatures above 1 per lens unit are smaller than that unit.
pub(super) fn cannot_be_curvatures(commands: &[Command<'_>]) -> bool {
    let is_surface = |c: &&Command<'_>| {
        c.words[0].eq_ignore_ascii_case("S") || (c.words[0].len() > 1 && c.surface(0).is_some())
    };
    let values = commands.iter().filter(is_surface).filter_map(|c| c.value(1).ok()).filter(|v| *v != 0.0);
    let values: Vec<f64> = values.collect();
    !values.is_empty() && values.iter().all(|v| v.abs() > 1.0)
}
