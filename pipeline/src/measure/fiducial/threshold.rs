//! Dark and light pixels of an unevenly lit picture.
//!
//! ```text
//! light(p) = v(p) > (low + high)/2,   low, high = minimum and maximum of v over 9 × 9 blocks about the block of p
//! ```
//! v is the mean over 3 × 3 pixels, which reduces the noise by 3. A block is 1/32 of the shorter side, so that the threshold follows changes of the
//! light over about a quarter of the picture, and a mark of up to a quarter of it has both levels in reach. Where high exceeds low by less
//! than [`MIN_CONTRAST`] of high, all is light. Costs one byte a pixel and two passes over the picture.

use crate::geometry::Size;

/// Smallest difference of light and dark, a share of light: noise of 5 % after the mean of 3 × 3 pixels stays below.
const MIN_CONTRAST: f32 = 0.2;
/// Blocks along the shorter side, and blocks in reach of one on each side.
const BLOCKS: usize = 32;
const REACH: usize = 4;

/// Which pixels are light.
pub(super) struct Bitmap {
    size: Size,
    light: Vec<bool>,
}

impl Bitmap {
    /// Of a picture of `size`, row by row.
    pub(super) fn new(luma: &[f32], size: Size) -> Self {
        let side = size.height.min(size.width).div_ceil(BLOCKS).max(8);
        let (rows, columns) = (size.height.div_ceil(side), size.width.div_ceil(side));
        let mut line = vec![0.0; size.width];
        let mut levels = vec![(f32::INFINITY, f32::NEG_INFINITY); rows * columns];
        for y in 0..size.height {
            smooth(luma, size, y, &mut line);
            let levels = &mut levels[(y / side) * columns..][..columns];
            for (level, part) in levels.iter_mut().zip(line.chunks(side)) {
                *level = part.iter().fold(*level, |(low, high), v| (low.min(*v), high.max(*v)));
            }
        }
        let thresholds: Vec<f32> =
            (0..rows * columns).map(|k| threshold(&levels, rows, columns, k)).collect();
        let mut light = Vec::with_capacity(size.pixels());
        for y in 0..size.height {
            smooth(luma, size, y, &mut line);
            let thresholds = &thresholds[(y / side) * columns..];
            for (part, threshold) in line.chunks(side).zip(thresholds) {
                light.extend(part.iter().map(|v| v > threshold));
            }
        }
        Self { size, light }
    }

    pub(super) const fn size(&self) -> Size {
        self.size
    }

    /// The pixels of a row.
    pub(super) fn row(&self, y: usize) -> &[bool] {
        &self.light[y * self.size.width..][..self.size.width]
    }

    /// Whether the pixel at a position is light; `None` outside.
    pub(super) fn at(&self, (row, column): (f64, f64)) -> Option<bool> {
        let (y, x) = ((row + 0.5).floor(), (column + 0.5).floor());
        let inside = y >= 0.0 && x >= 0.0 && y < self.size.height as f64 && x < self.size.width as f64;
        inside.then(|| self.light[y as usize * self.size.width + x as usize])
    }
}

/// Middle of the levels about block `k`; below all values if there is no contrast.
fn threshold(levels: &[(f32, f32)], rows: usize, columns: usize, k: usize) -> f32 {
    let near = |i: usize, end: usize| i.saturating_sub(REACH)..(i + REACH + 1).min(end);
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for i in near(k / columns, rows) {
        for j in near(k % columns, columns) {
            let level = levels[i * columns + j];
            (low, high) = (low.min(level.0), high.max(level.1));
        }
    }
    if high - low > MIN_CONTRAST * high { low + (high - low) / 2.0 } else { f32::NEG_INFINITY }
}

/// Means over 3 × 3 pixels of row `y`, over those inside at the picture's border.
fn smooth(luma: &[f32], size: Size, y: usize, out: &mut [f32]) {
    let rows = y.saturating_sub(1)..(y + 2).min(size.height);
    let weight = 1.0 / rows.len() as f32;
    let mut sums = rows.map(|y| &luma[y * size.width..][..size.width]);
    let first = sums.next().unwrap_or_default();
    out.copy_from_slice(first);
    sums.for_each(|row| out.iter_mut().zip(row).for_each(|(o, v)| *o += v));
    let (mut left, last) = (None, out.len() - 1);
    for x in 0..out.len() {
        let middle = out[x];
        let right = (x < last).then(|| out[x + 1]);
        let count = 1 + usize::from(left.is_some()) + usize::from(right.is_some());
        out[x] = (left.unwrap_or(0.0) + middle + right.unwrap_or(0.0)) * weight / count as f32;
        left = Some(middle);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smooth_rows_are_means_of_the_pixels_inside() {
        let size = Size::new(3, 4);
        let luma: Vec<f32> = (0..12).map(|i| (i * i) as f32).collect();
        let mut line = [0.0; 4];
        for y in 0..3usize {
            smooth(&luma, size, y, &mut line);
            for (x, smoothed) in line.iter().enumerate() {
                let (mut sum, mut count) = (0.0, 0.0);
                for v in y.saturating_sub(1)..(y + 2).min(3) {
                    for u in x.saturating_sub(1)..(x + 2).min(4) {
                        sum += luma[v * 4 + u];
                        count += 1.0;
                    }
                }
                assert!((smoothed - sum / count).abs() < 1e-4, "{y} {x}");
            }
        }
    }

    #[test]
    fn threshold_follows_the_light() {
        // Stripes of reflectance 0.5 and 1 under light that falls to a tenth: the lightest dark is brighter than the darkest light.
        let size = Size::new(64, 1280);
        let light = |x: usize| 1.0 - 0.9 * x as f32 / 1280.0;
        let paper = |x: usize| if (x / 10).is_multiple_of(2) { 1.0 } else { 0.5 };
        let luma: Vec<f32> = (0..size.pixels()).map(|i| paper(i % 1280) * light(i % 1280)).collect();
        let map = Bitmap::new(&luma, size);
        for x in (0..1280).filter(|x| (2..8).contains(&(x % 10))) {
            assert_eq!(map.at((30.4, x as f64)), Some(paper(x) == 1.0), "column {x}");
        }
        assert_eq!(map.at((-0.6, 3.0)), None);
    }
}
