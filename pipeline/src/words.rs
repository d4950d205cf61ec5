//! Similarity of names, for "did you mean".

/// Number of letters compared, longer than any name, so that no input is slow.
const MAX_LETTERS: usize = 64;

/// Levenshtein distance: the minimum number of letters to insert, delete or replace.
pub fn edit_distance(a: &str, b: &str) -> usize {
    let first = |text: &str| text.chars().take(MAX_LETTERS).collect::<String>();
    strsim::levenshtein(&first(a), &first(b))
}
