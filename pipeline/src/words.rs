//! How alike two words are, for "did you mean".

/// Letters of a word that are compared: more than any name has, so that no input makes the comparison slow.
const LONGEST: usize = 64;

/// Levenshtein's distance, by rows: the fewest letters to add, drop or replace.
pub(crate) fn changes(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().take(LONGEST).collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().take(LONGEST).enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}
