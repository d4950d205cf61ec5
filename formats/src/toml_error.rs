//! Errors of TOML texts, without the text: a line may be long.

use std::ops::Range;

/// An error with its line and column.
pub(crate) fn located(error: &toml::de::Error, text: &str) -> String {
    let message = error.message().trim().replace('\n', " ");
    match error.span() {
        Some(span) => {
            let before = &text[..span.start.min(text.len())];
            let column = before.rsplit('\n').next().unwrap_or("").chars().count() + 1;
            format!("line {}, column {column}: {message}", line(text, &span))
        }
        None => message,
    }
}

/// The line, from 1, at which a span of `text` starts.
pub(crate) fn line(text: &str, span: &Range<usize>) -> usize {
    text.bytes().take(span.start).filter(|b| *b == b'\n').count() + 1
}
