//! JSON as Python writes it: with the words Infinity, -Infinity and NaN.

use crate::design::error::LensFileError;
use crate::design::text::quote;
use serde_json::Value;

/// What stands for an infinite number; read and written as `Infinity`.
pub(super) const INFINITE: f64 = 1e300;

/// Parses a file.
///
/// # Errors
/// [`LensFileError::Line`] with the place of a syntax error.
pub(super) fn parse(text: &str) -> Result<Value, LensFileError> {
    let plain = without_words(text);
    serde_json::from_str(&plain).map_err(|e| {
        let line = text.lines().nth(e.line().saturating_sub(1)).unwrap_or_default();
        LensFileError::Line { line: e.line(), text: quote(line), problem: format!("is not JSON: {e}") }
    })
}

/// Replaces `Infinity` by [`INFINITE`] and `NaN` by null outside of strings.
fn without_words(text: &str) -> String {
    let (mut out, mut rest, mut is_string) = (String::with_capacity(text.len()), text, false);
    while let Some(c) = rest.chars().next() {
        if !is_string && let Some(after) = rest.strip_prefix("Infinity") {
            out.push_str("1e300");
            rest = after;
            continue;
        }
        if !is_string && let Some(after) = rest.strip_prefix("NaN") {
            out.push_str("null");
            rest = after;
            continue;
        }
        let mut length = c.len_utf8();
        match c {
            '"' => is_string = !is_string,
            '\\' if is_string => length += rest[length..].chars().next().map_or(0, char::len_utf8),
            _ => (),
        }
        out.push_str(&rest[..length]);
        rest = &rest[length..];
    }
    out
}

/// The text of a file.
pub(super) fn text(value: &Value) -> String {
    let text = serde_json::to_string_pretty(value).expect("a value of strings and numbers is JSON");
    // As serde_json of any version writes it.
    text.replace("1e+300", "Infinity").replace("1e300", "Infinity") + "\n"
}
