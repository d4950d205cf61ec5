//! Decoded chunks, as they are cached.

use pipeline::geometry::Rect;

use super::values::InvalidSample;

/// A decoded chunk: f32, band by band, without the part beyond the chart's edge.
#[derive(Debug)]
pub(super) struct DecodedChunk {
    pub(super) bands: std::ops::Range<usize>,
    pub(super) rect: Rect,
    /// Empty if every pixel has the value `fill`.
    pub(super) data: Vec<f32>,
    pub(super) fill: f32,
    /// Whether the chunk is not stored.
    pub(super) missing: bool,
    /// First erroneous sample of each band that has one: (band, row, column, error).
    pub(super) errors: Vec<(usize, usize, usize, InvalidSample)>,
    /// (band, samples without data that were replaced by 0) of each band that has some.
    pub(super) replaced: Vec<(usize, u64)>,
}

impl DecodedChunk {
    /// Copies pixels of one row of `band`, from (`y`, `x`) on, to `out`.
    pub(super) fn copy_row(&self, band: usize, y: i64, x: i64, out: &mut [f32]) {
        if self.data.is_empty() {
            out.fill(self.fill);
            return;
        }
        let Rect { height, width, .. } = self.rect;
        let row = (band - self.bands.start) * height + (y - self.rect.y) as usize;
        out.copy_from_slice(&self.data[row * width + (x - self.rect.x) as usize..][..out.len()]);
    }
}
