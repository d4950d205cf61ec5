//! Letters of 5 × 7 dots for the charts' legends: drawn in whole pixels, so even the smallest is sharp on the chart.

/// Columns from one letter to the next, in dots.
pub(super) const ADVANCE: usize = 6;
/// Rows of a letter, in dots.
pub(super) const HEIGHT: usize = 7;

/// Rows from the top, bit 4 on the left. What has no letter is a blank.
#[rustfmt::skip]
const fn rows(letter: char) -> [u8; HEIGHT] {
    match letter {
        '0' => [14, 17, 19, 21, 25, 17, 14], '1' => [4, 12, 4, 4, 4, 4, 14],
        '2' => [14, 17, 1, 2, 4, 8, 31],     '3' => [31, 2, 4, 2, 1, 17, 14],
        '4' => [2, 6, 10, 18, 31, 2, 2],     '5' => [31, 16, 30, 1, 1, 17, 14],
        '6' => [6, 8, 16, 30, 17, 17, 14],   '7' => [31, 1, 2, 4, 8, 8, 8],
        '8' => [14, 17, 17, 14, 17, 17, 14], '9' => [14, 17, 17, 15, 1, 2, 12],
        'A' => [14, 17, 17, 31, 17, 17, 17], 'B' => [30, 17, 17, 30, 17, 17, 30],
        'C' => [14, 17, 16, 16, 16, 17, 14], 'D' => [28, 18, 17, 17, 17, 18, 28],
        'E' => [31, 16, 16, 30, 16, 16, 31], 'F' => [31, 16, 16, 30, 16, 16, 16],
        'G' => [14, 17, 16, 23, 17, 17, 15], 'H' => [17, 17, 17, 31, 17, 17, 17],
        'I' => [14, 4, 4, 4, 4, 4, 14],      'J' => [7, 2, 2, 2, 2, 18, 12],
        'K' => [17, 18, 20, 24, 20, 18, 17], 'L' => [16, 16, 16, 16, 16, 16, 31],
        'M' => [17, 27, 21, 21, 17, 17, 17], 'N' => [17, 17, 25, 21, 19, 17, 17],
        'O' => [14, 17, 17, 17, 17, 17, 14], 'P' => [30, 17, 17, 30, 16, 16, 16],
        'Q' => [14, 17, 17, 17, 21, 18, 13], 'R' => [30, 17, 17, 30, 20, 18, 17],
        'S' => [15, 16, 16, 14, 1, 1, 30],   'T' => [31, 4, 4, 4, 4, 4, 4],
        'U' => [17, 17, 17, 17, 17, 17, 14], 'V' => [17, 17, 17, 17, 17, 10, 4],
        'W' => [17, 17, 17, 21, 21, 21, 10], 'X' => [17, 17, 10, 4, 10, 17, 17],
        'Y' => [17, 17, 17, 10, 4, 4, 4],    'Z' => [31, 1, 2, 4, 8, 16, 31],
        '.' => [0, 0, 0, 0, 0, 12, 12],      '-' => [0, 0, 0, 31, 0, 0, 0],
        '/' => [0, 1, 2, 4, 8, 16, 0],       '+' => [0, 4, 4, 31, 4, 4, 0],
        'm' => [0, 0, 26, 21, 21, 17, 17],   'n' => [0, 0, 22, 25, 17, 17, 17],
        'p' => [0, 0, 30, 17, 30, 16, 16],   'x' => [0, 0, 17, 10, 4, 10, 17],
        'y' => [0, 0, 17, 17, 15, 1, 14],
        _ => [0; HEIGHT],
    }
}

/// Width of a line of text in dots, without the last gap.
pub(super) fn width(text: &str) -> usize {
    (text.chars().count() * ADVANCE).saturating_sub(1)
}

/// Runs of dots (row, first column, end column) of a line of text, from its top left.
pub(super) fn runs(text: &str) -> Vec<(usize, usize, usize)> {
    let mut runs = Vec::new();
    for (i, letter) in text.chars().enumerate() {
        for (row, bits) in rows(letter).into_iter().enumerate() {
            let set = |column: usize| column < 5 && bits >> (4 - column) & 1 == 1;
            for first in (0..5).filter(|&c| set(c) && (c == 0 || !set(c - 1))) {
                let end = (first..=5).find(|&c| !set(c)).unwrap_or(5);
                runs.push((row, i * ADVANCE + first, i * ADVANCE + end));
            }
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_letter_is_its_runs() {
        assert_eq!(runs("T")[..2], [(0, 0, 5), (1, 2, 3)]);
        assert_eq!(runs(" L").iter().filter(|r| r.1 == 6).count(), 7);
        assert_eq!((width("AB"), width("")), (11, 0));
    }
}
