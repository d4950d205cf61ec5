//! Pixels of a mosaic that differ from their neighbours by more than noise does: hot pixels and those of telegraph noise.
//!
//! A pixel is compared with the eight nearest pixels of the same place in the mosaic's period, one period away (at the edges of an array with those that are there):
//!
//! ```text
//! v > high + 4 σ(high)  or  v < low − 4 σ(low):   v becomes the median of the neighbours        σ(v): noise of a pixel of the digital number v
//! ```
//!
//! high and low are the second largest and second smallest neighbour, so that one of them may be a defect as well. Noise alone changes about one pixel in a million, and edges and gradients none. A point of light that is smaller than a period of the mosaic looks
//! like a hot pixel and is lost, as is the end of a line of that width.

use crate::geometry::Rect;

/// Standard deviations that a pixel is beyond its neighbours.
const SIGMAS: f64 = 4.0;

/// Pixels that a part of an array depends on: one period of the mosaic (rows, columns) around it, the longer side everywhere, within the array.
pub fn needs(part: Rect, period: (usize, usize), array: Rect) -> Rect {
    part.grown(period.0.max(period.1)).intersect(array)
}

/// The pixels `part` without defects, from the digital numbers of [`needs`]; `sigma_dn` is the noise of a digital number.
///
/// # Panics
/// If `read` is not that of `part`.
pub fn corrected(
    numbers: &[f32],
    (part, read): (Rect, Rect),
    period: (usize, usize),
    sigma_dn: impl Fn(f64) -> f64,
) -> Vec<f32> {
    assert!(numbers.len() == read.size().pixels() && read.contains(part));
    let (first_row, first_column) = ((part.y - read.y) as usize, (part.x - read.x) as usize);
    let mut out = Vec::with_capacity(part.size().pixels());
    let mut around = Vec::with_capacity(8);
    for y in first_row..first_row + part.height {
        for x in first_column..first_column + part.width {
            let v = numbers[y * read.width + x];
            around.clear();
            for i in [-1, 0, 1] {
                for j in [-1, 0, 1] {
                    let there = |at: usize, by: isize, n: usize| at.checked_add_signed(by).filter(|v| *v < n);
                    let row = there(y, i * period.0 as isize, read.height);
                    let column = there(x, j * period.1 as isize, read.width);
                    if let (Some(row), Some(column), true) = (row, column, (i, j) != (0, 0)) {
                        around.push(numbers[row * read.width + column]);
                    }
                }
            }
            around.sort_unstable_by(f32::total_cmp);
            let last = around.len().saturating_sub(1);
            // An array of one period has no neighbours.
            let (Some(low), Some(high)) = (around.get(1.min(last)), around.get(last.saturating_sub(1)))
            else {
                out.push(v);
                continue;
            };
            let limit = |from: f32| (SIGMAS * sigma_dn(f64::from(from))) as f32;
            let is_beyond = (v > *high && v > high + limit(*high)) || (v < *low && v < low - limit(*low));
            out.push(if is_beyond { median(&around) } else { v });
        }
    }
    out
}

/// The middle of some ascending numbers, the mean of the two middle ones if their count is even.
fn median(of: &[f32]) -> f32 {
    let n = of.len();
    if n.is_multiple_of(2) { 0.5 * (of[n / 2 - 1] + of[n / 2]) } else { of[n / 2] }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: (usize, usize) = (2, 2);

    #[test]
    fn single_pixels_are_replaced_and_edges_stay() {
        let array = Rect::new(0, 0, 12, 14);
        let of = |y: i64, x: i64| if x < 6 { 100.0 } else { 900.0 } + 10.0 * (y % 2) as f32;
        let mut numbers: Vec<f32> = (0..12 * 14).map(|k| of(k / 14, k % 14)).collect();
        let clean = numbers.clone();
        for k in [0, 3 * 14 + 2, 7 * 14 + 9, 7 * 14 + 11, 11 * 14 + 13] {
            numbers[k] = 4000.0;
        }
        numbers[9 * 14 + 11] = 0.0;
        let sigma = |_| 5.0;
        assert_eq!(corrected(&numbers, (array, array), PERIOD, sigma), clean);
        // A part has the pixels of the whole.
        let part = Rect::new(3, 8, 5, 5);
        let read = needs(part, PERIOD, array);
        assert_eq!(read, Rect::new(1, 6, 9, 8));
        let own: Vec<f32> =
            (0..read.size().pixels()).map(|k| numbers[(1 + k / 8) * 14 + 6 + k % 8]).collect();
        let expected: Vec<f32> = (0..25).map(|k| clean[(3 + k / 5) * 14 + 8 + k % 5]).collect();
        assert_eq!(corrected(&own, (part, read), PERIOD, sigma), expected);
        assert_eq!(needs(Rect::new(0, 12, 2, 2), PERIOD, array), Rect::new(0, 10, 4, 4));
    }

    #[test]
    fn noise_is_left_alone() {
        let array = Rect::new(0, 0, 300, 300);
        let mut state = 1u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f32 / (1u64 << 53) as f32
        };
        let numbers: Vec<f32> =
            (0..90_000).map(|_| 500.0 + 10.0 * ((0..12).map(|_| uniform()).sum::<f32>() - 6.0)).collect();
        let got = corrected(&numbers, (array, array), PERIOD, |_| 10.0);
        let changed = std::iter::zip(&got, &numbers).filter(|(a, b)| a != b).count();
        assert!(changed <= 2, "{changed}");
    }
}
