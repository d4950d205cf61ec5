//! Text of files and arguments as it may be printed on a terminal.
//!
//! Names in files and paths may contain any character. A terminal obeys control characters, such as those of escape sequences, and
//! reorders text by bidirectional controls; neither may be printed as it stands.

use std::borrow::Cow;
use std::fmt::Write;

/// Whether a terminal shows `character` as such, or acts on it.
fn acts(character: char) -> bool {
    matches!(character,
        '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
        || character.is_control()
}

/// `text` with the characters that `kept` does not accept in the form `\u001b`, which is that of JSON as well: a printed JSON document
/// remains one.
fn replaced(text: &str, kept: fn(char) -> bool) -> Cow<'_, str> {
    let is_kept = |c: char| !acts(c) || kept(c);
    if text.chars().all(is_kept) {
        return text.into();
    }
    let mut out = String::with_capacity(text.len() + 16);
    for character in text.chars() {
        match character {
            c if is_kept(c) => out.push(c),
            '\n' => out.push_str("\\n"),
            '\t' => out.push_str("\\t"),
            '\r' => out.push_str("\\r"),
            // Writing to a string does not fail. All of them have four digits at most.
            c => drop(write!(out, "\\u{:04x}", u32::from(c))),
        }
    }
    out.into()
}

/// `text` for a terminal: control characters except line ends and tabs, and bidirectional controls, are escaped.
pub fn lines(text: &str) -> Cow<'_, str> {
    replaced(text, |c| matches!(c, '\n' | '\t'))
}

/// As [`lines()`], in one line: line ends and tabs are escaped as well.
pub fn one_line(text: &str) -> Cow<'_, str> {
    replaced(text, |_| false)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn characters_that_a_terminal_obeys_are_escaped() {
        assert_eq!(lines("a\u{1b}]0;b\u{7}\u{9b}2J\r\u{7f}"), "a\\u001b]0;b\\u0007\\u009b2J\\r\\u007f");
        assert_eq!(lines("\u{202e}\u{2066}\u{200f}\u{2028}"), "\\u202e\\u2066\\u200f\\u2028");
        assert_eq!(one_line("a\n\tb"), "a\\n\\tb");
    }

    #[test]
    fn other_text_is_kept_as_it_is() {
        for text in ["550 nm, 2 µm", "a\n\tb", "Größe 寸法 גודל – 1:2", ""] {
            assert!(matches!(lines(text), Cow::Borrowed(same) if same == text), "{text}");
        }
        assert!(matches!(one_line("גודל 寸法"), Cow::Borrowed(_)));
    }

    #[test]
    fn escaped_json_has_the_same_value() {
        let value = serde_json::json!({ "na\u{9b}me": "\u{1b}[2J\u{202e}\u{7f}\n" });
        let text = serde_json::to_string_pretty(&value).unwrap();
        let escaped = lines(&text);
        assert!(!escaped.chars().any(|c| acts(c) && c != '\n'), "{escaped}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&escaped).unwrap(), value);
    }
}
