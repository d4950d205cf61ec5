//! Mean over 2 x 2 pixels.

use pipeline::geometry::Size;

/// Writes to `out` (⌈h/2⌉ × ⌈w/2⌉) the means over 2 x 2 pixels of `pixels` (`size`), row by row: of the finite ones, NaN if there is none.
/// At odd sides the last row or column is the mean of two pixels or one. Sums are in f64, so the mean of equal values is that value.
///
/// # Panics
/// If a slice is not of its size.
pub fn halve(pixels: &[f32], size: Size, out: &mut [f32]) {
    let width = size.width.div_ceil(2);
    assert_eq!((pixels.len(), out.len()), (size.pixels(), size.height.div_ceil(2) * width));
    let rows = pixels.chunks(2 * size.width.max(1));
    for (pair, means) in rows.zip(out.chunks_exact_mut(width.max(1))) {
        let (upper, lower) = pair.split_at(size.width);
        let even = size.width / 2 * 2;
        if !lower.is_empty() {
            let (upper, lower) = (upper[..even].as_chunks().0, lower[..even].as_chunks().0);
            for ((&[a, b], &[c, d]), mean) in upper.iter().zip(lower).zip(&mut *means) {
                let sum = f64::from(a) + f64::from(b) + (f64::from(c) + f64::from(d));
                *mean = if sum.is_finite() { (sum * 0.25) as f32 } else { finite_mean(&[a, b, c, d]) };
            }
        } else {
            for (two, mean) in upper[..even].chunks_exact(2).zip(&mut *means) {
                *mean = finite_mean(two);
            }
        }
        if even < size.width {
            let last = [Some(&upper[even]), lower.get(even)];
            let last: Vec<f32> = last.into_iter().flatten().copied().collect();
            means[width - 1] = finite_mean(&last);
        }
    }
}

fn finite_mean(values: &[f32]) -> f32 {
    let finite = values.iter().filter(|v| v.is_finite());
    let (sum, n) = finite.fold((0.0, 0.0), |(sum, n), &v| (sum + f64::from(v), n + 1.0));
    (sum / n) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn halved(pixels: &[f32], height: usize, width: usize) -> Vec<f32> {
        let mut out = vec![f32::INFINITY; height.div_ceil(2) * width.div_ceil(2)];
        halve(pixels, Size::new(height, width), &mut out);
        out
    }

    #[test]
    fn mean_ignores_non_finite_pixels_and_pixels_beyond_the_edge() {
        let nan = f32::NAN;
        assert_eq!(halved(&[1.0, 2.0, 3.0, 6.0], 2, 2), [3.0]);
        assert_eq!(halved(&[1.0, nan, 3.0, f32::NEG_INFINITY], 2, 2), [2.0]);
        assert_eq!(halved(&[7.5], 1, 1), [7.5]);
        assert_eq!(halved(&[1.0, 2.0, 5.0], 1, 3), [1.5, 5.0]);
        assert_eq!(halved(&[1.0, 2.0, 5.0], 3, 1), [1.5, 5.0]);
        assert_eq!(halved(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, nan], 3, 3)[..3], [3.0, 4.5, 7.5]);
        assert!(halved(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, nan], 3, 3)[3].is_nan());
        assert!(halved(&[nan; 4], 2, 2)[0].is_nan());
        assert_eq!(halved(&[f32::MAX; 4], 2, 2), [f32::MAX]);
    }

    #[test]
    fn any_size_agrees_with_the_definition() {
        for (height, width) in [(1, 1), (1, 2), (2, 1), (4, 6), (5, 6), (4, 7), (9, 11), (3, 1)] {
            let at =
                |y: usize, x: usize| if (y * 7 + x * 3) % 5 == 4 { f32::NAN } else { (y * 31 + x) as f32 };
            let pixels: Vec<f32> = (0..height * width).map(|i| at(i / width, i % width)).collect();
            let out = halved(&pixels, height, width);
            let (h, w) = (height.div_ceil(2), width.div_ceil(2));
            for (i, j) in (0..h).flat_map(|i| (0..w).map(move |j| (i, j))) {
                let four = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(a, b)| (2 * i + a, 2 * j + b));
                let finite: Vec<f64> = four
                    .iter()
                    .filter(|(y, x)| *y < height && *x < width)
                    .map(|&(y, x)| f64::from(at(y, x)))
                    .filter(|v| v.is_finite())
                    .collect();
                let expected = (finite.iter().sum::<f64>() / finite.len() as f64) as f32;
                let found = out[i * w + j];
                assert!(
                    found == expected || (found.is_nan() && expected.is_nan()),
                    "{height}x{width} {i} {j}: {found} {expected}"
                );
            }
        }
    }
}
