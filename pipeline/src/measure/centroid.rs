//! Position of an isolated point.
//!
//! ```text
//! c = Σ (v − b)·p / Σ (v − b)
//! ```
//! over the pixels p of a square, b the mean of the square's outermost ring. Exact for a point whose image lies inside the ring.

use crate::geometry::Rect;

/// Centroid (row, column) in film pixels of `pixels` (row-major on `rect`) within ± `half` of the pixel nearest to `about`; `None` if
/// the square is not inside `rect` or its sum above the background is not positive.
pub fn centroid(pixels: &[f32], rect: Rect, about: (f64, f64), half: usize) -> Option<(f64, f64)> {
    let side = 2 * half + 1;
    let (y, x) = (about.0.round() as i64 - half as i64, about.1.round() as i64 - half as i64);
    let square = Rect::new(y, x, side, side);
    if half == 0 || !rect.contains(square) || pixels.len() != rect.size().pixels() {
        return None;
    }
    let at = |i: usize, j: usize| {
        let row = (square.y - rect.y) as usize + i;
        f64::from(pixels[row * rect.width + (square.x - rect.x) as usize + j])
    };
    let ring: f64 =
        (0..side - 1).map(|i| at(0, i) + at(i, side - 1) + at(side - 1, i + 1) + at(i + 1, 0)).sum();
    let background = ring / (4 * (side - 1)) as f64;
    let (mut sum, mut rows, mut cols) = (0.0, 0.0, 0.0);
    for (i, j) in (0..side).flat_map(|i| (0..side).map(move |j| (i, j))) {
        let value = at(i, j) - background;
        sum += value;
        rows += value * i as f64;
        cols += value * j as f64;
    }
    (sum > 0.0).then(|| (square.y as f64 + rows / sum, square.x as f64 + cols / sum))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centroid_of_a_gaussian_is_its_centre() {
        let rect = Rect::new(100, 200, 41, 45);
        for (cy, cx, sigma) in [(119.7, 221.2, 1.3), (120.0, 222.5, 2.0), (121.41, 219.93, 0.9)] {
            let pixels: Vec<f32> = (0..rect.size().pixels())
                .map(|i| {
                    let y = rect.y as f64 + (i / rect.width) as f64 - cy;
                    let x = rect.x as f64 + (i % rect.width) as f64 - cx;
                    (0.2 + (-(y * y + x * x) / (2.0 * sigma * sigma)).exp()) as f32
                })
                .collect();
            let (row, col) = centroid(&pixels, rect, (cy, cx), 12).unwrap();
            assert!((row - cy).abs() < 1e-3 && (col - cx).abs() < 1e-3, "{row} {col} for {cy} {cx}");
        }
        assert_eq!(centroid(&[0.0; 41 * 45], rect, (120.0, 220.0), 12), None);
        assert_eq!(centroid(&[1.0; 41 * 45], rect, (101.0, 220.0), 12), None);
    }
}
