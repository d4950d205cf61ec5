//! Text of files in messages: quoted, on one line, shortened.

/// Characters of a text in a message.
const SHOWN_CHARACTERS: usize = 80;

/// `text` in quotation marks, control characters escaped, at most [`SHOWN_CHARACTERS`] of it.
pub(super) fn shown(text: &str) -> String {
    match text.char_indices().nth(SHOWN_CHARACTERS) {
        None => format!("{text:?}"),
        Some((end, _)) => format!("{:?}… ({} bytes)", &text[..end], text.len()),
    }
}

/// `noun` with its number and an `s` unless the number is 1.
pub(super) fn counted(number: usize, noun: &str) -> String {
    format!("{number} {noun}{}", if number == 1 { "" } else { "s" })
}
