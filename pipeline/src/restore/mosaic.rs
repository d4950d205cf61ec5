//! Means of the samples behind one filter of a mosaic: the picture between them, and the mean charge that a pixel's noise is computed of.
//!
//! ```text
//! mean(y, x) = Σ t(Δy) t(Δx) sample / Σ t(Δy) t(Δx)        t(Δ) = reach + 1 − |Δ| over the samples within reach; NaN without any
//! ```
//! With a reach of the period less 1 it is bilinear between the samples of a Bayer mosaic. Rows, then columns: the weight is a product.

use crate::geometry::Rect;

/// A part of a mosaic.
#[derive(Clone, Copy, Debug)]
pub struct Samples<'a> {
    /// Values of `rect`, row by row.
    pub values: &'a [f32],
    /// Which of them are behind the filter.
    pub are_of_filter: &'a [bool],
    /// Pixels, on the sensor.
    pub rect: Rect,
}

impl Samples<'_> {
    /// Means at the pixels of `part`, of the samples within `reach` px.
    ///
    /// # Panics
    /// `part` is not inside the samples.
    pub fn means(&self, part: Rect, reach: usize) -> Vec<f32> {
        assert!(self.rect.contains(part), "{part} is inside {}", self.rect);
        let width = self.rect.width;
        let (left, top) = ((part.x - self.rect.x) as usize, (part.y - self.rect.y) as usize);
        let around = |at: usize, end: usize| {
            (at.saturating_sub(reach)..(at + reach + 1).min(end))
                .map(move |k| (k, (reach + 1 - k.abs_diff(at)) as f32))
        };
        let mut means = Vec::with_capacity(part.size().pixels());
        let (mut sums, mut weights) = (vec![0.0f32; width], vec![0.0f32; width]);
        for y in top..top + part.height {
            sums.fill(0.0);
            weights.fill(0.0);
            for (row, tent) in around(y, self.rect.height) {
                for x in 0..width {
                    let at = row * width + x;
                    let weight = if self.are_of_filter[at] { tent } else { 0.0 };
                    sums[x] += weight * self.values[at];
                    weights[x] += weight;
                }
            }
            for x in left..left + part.width {
                let (mut sum, mut weight) = (0.0, 0.0);
                for (column, tent) in around(x, width) {
                    sum += tent * sums[column];
                    weight += tent * weights[column];
                }
                means.push(if weight > 0.0 { sum / weight } else { f32::NAN });
            }
        }
        means
    }
}
