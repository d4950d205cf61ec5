//! Half the resolution of a mosaic: means over pixels of one filter.
//!
//! ```text
//! level n (I·P + a) = mean of level n−1 (2I·P + a) and (2I·P + a + P),   a = 0 … P − 1, down and across alike
//! ```
//!
//! P is the period of the mosaic, 1 without one. A level is a mosaic of the same pattern, so it is read and developed as the raw is.
//! Of a last period that has no partner the pixel itself is taken. Means of the integers are rounded to integers, ties to even, which
//! leaves the mean of many pixels unbiased.

use pipeline::geometry::{Rect, Size};

/// Rows and columns of the period of a mosaic.
pub type Period = (usize, usize);

/// First of the two rows (or columns) below row `i`; the second is `period` further.
const fn first_below(i: usize, period: usize) -> usize {
    2 * (i / period) * period + i % period
}

/// Rows (or columns) of a level of `n` that `first..end` of the next level are made of.
fn below(first: usize, end: usize, period: usize, n: usize) -> (usize, usize) {
    let start = 2 * (first / period) * period;
    (start, (2 * end.div_ceil(period) * period).min(n))
}

/// Pixels of a level of size `size` that the part `out` of the next level is made of.
///
/// # Panics
/// If `out` begins before the first pixel.
pub fn mosaic_below(out: Rect, size: Size, period: Period) -> Rect {
    let at = |v: i64| usize::try_from(v).expect("pixels of a level");
    let (top, bottom) = below(at(out.y), at(out.bottom()), period.0, size.height);
    let (left, right) = below(at(out.x), at(out.right()), period.1, size.width);
    Rect::new(top as i64, left as i64, bottom - top, right - left)
}

/// The pixels `out` of a level from the pixels `rect` ([`mosaic_below`]) of the level before.
///
/// # Panics
/// If `pixels` or `means` are not as many as their rectangles have.
pub fn halve_mosaic(pixels: &[f32], rect: Rect, period: Period, out: Rect, means: &mut [f32]) {
    assert_eq!((pixels.len(), means.len()), (rect.size().pixels(), out.size().pixels()));
    // Of each row or column: one or two of those below, counted from the rectangle's first.
    let pairs = |first: i64, n: usize, period: usize, start: i64, count: usize| -> Vec<(usize, usize)> {
        let pair = |i: usize| {
            let one = first_below(first as usize + i, period) - start as usize;
            (one, if one + period < count { one + period } else { one })
        };
        (0..n).map(pair).collect()
    };
    let columns = pairs(out.x, out.width, period.1, rect.x, rect.width);
    let rows = pairs(out.y, out.height, period.0, rect.y, rect.height);
    for (line, (upper, lower)) in means.chunks_exact_mut(out.width.max(1)).zip(rows) {
        let (upper, lower) = (&pixels[upper * rect.width..][..rect.width], &pixels[lower * rect.width..]);
        for (mean, &(a, b)) in line.iter_mut().zip(&columns) {
            *mean = ((upper[a] + upper[b] + (lower[a] + lower[b])) * 0.25).round_ties_even();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By the definition, from the indices of the whole level.
    fn expected(pixels: &[f32], size: Size, period: Period, (i, j): (usize, usize)) -> f32 {
        let two = |i: usize, p: usize, n: usize| -> Vec<usize> {
            let first = 2 * (i / p) * p + i % p;
            [first, first + p].into_iter().filter(|k| *k < n).collect()
        };
        let (rows, columns) = (two(i, period.0, size.height), two(j, period.1, size.width));
        let all: Vec<f32> =
            rows.iter().flat_map(|y| columns.iter().map(move |x| pixels[y * size.width + x])).collect();
        (all.iter().sum::<f32>() / all.len() as f32).round_ties_even()
    }

    #[test]
    fn any_part_of_any_size_and_period_agrees_with_the_definition() {
        for period in [(1, 1), (2, 2), (3, 2), (4, 4), (5, 8)] {
            for (height, width) in [(1, 1), (5, 6), (16, 16), (23, 19), (2, 31)] {
                let size = Size::new(height, width);
                let pixels: Vec<f32> = (0..size.pixels()).map(|k| (k * 7919 % 4096) as f32).collect();
                let half = Size::new(height.div_ceil(2), width.div_ceil(2));
                let parts =
                    [half.rect(), Rect::new(0, 0, 1, 1), Rect::new(1, 2, 7, 5).intersect(half.rect())];
                for part in parts.into_iter().filter(|p| p.size().pixels() > 0) {
                    let rect = mosaic_below(part, size, period);
                    let rows = rect.y as usize..rect.bottom() as usize;
                    let inside: Vec<f32> = rows
                        .flat_map(|y| pixels[y * width + rect.x as usize..][..rect.width].to_vec())
                        .collect();
                    let mut means = vec![f32::NAN; part.size().pixels()];
                    halve_mosaic(&inside, rect, period, part, &mut means);
                    for (k, mean) in means.iter().enumerate() {
                        let at = (part.y as usize + k / part.width, part.x as usize + k % part.width);
                        assert_eq!(*mean, expected(&pixels, size, period, at), "{period:?} {size} {at:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn filters_stay_apart_and_ties_go_to_even() {
        // Rows of two filters: 10 and 900.
        let pixels: Vec<f32> = (0..8).flat_map(|_| [10.0, 900.0, 10.0, 900.0]).collect();
        let mut means = [0.0; 8];
        halve_mosaic(&pixels, Rect::new(0, 0, 8, 4), (2, 2), Rect::new(0, 0, 4, 2), &mut means);
        assert_eq!(means, [10.0, 900.0, 10.0, 900.0, 10.0, 900.0, 10.0, 900.0]);
        let mut mean = [0.0];
        for (four, rounded) in
            [([0.0, 0.0, 1.0, 1.0], 0.0), ([1.0, 1.0, 2.0, 2.0], 2.0), ([0.0, 0.0, 0.0, 1.0], 0.0)]
        {
            halve_mosaic(&four, Rect::new(0, 0, 2, 2), (1, 1), Rect::new(0, 0, 1, 1), &mut mean);
            assert_eq!(mean, [rounded]);
        }
    }
}
