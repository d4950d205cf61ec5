//! Where on the chart the pixels of a film line lie, eight at a time.
//!
//! Plain f64 arithmetic without fused operations, the same for every pixel: whatever instructions it is compiled for, and
//! wherever a line is cut, it gives the same bits.
#![allow(clippy::needless_range_loop, reason = "lanes of several arrays at once")]

#[cfg(target_arch = "x86_64")]
use super::anchors::{Exact, SIDE};
use crate::field::{BLOCK, Field};
use crate::geometry::{Frame, Rect};
use crate::resample::Coordinate;

/// Lines are padded to this many pixels: the widest register of f32.
pub(super) const PAD: usize = 16;

/// The pixels of a strip, line by line, each line padded with its last pixel.
#[derive(Debug, Default)]
pub(super) struct Points {
    pub(super) row: Vec<i32>,
    pub(super) col: Vec<i32>,
    pub(super) row_fraction: Vec<f32>,
    pub(super) col_fraction: Vec<f32>,
    pub(super) gain: Vec<f32>,
    pub(super) stride: usize,
}

/// Film pixel → chart pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Map<'a> {
    pub(super) field: &'a Field,
    pub(super) axis_px: (f64, f64),
    pub(super) offset: (f64, f64),
    pub(super) per_scale: (f64, f64),
}

impl<'a> Map<'a> {
    pub(super) fn new(frame: &Frame, field: &'a Field) -> Self {
        let centre = |n: usize| (n as f64 - 1.0) / 2.0;
        let pitch = frame.pitch_mm();
        Self {
            field,
            axis_px: frame.axis_px,
            offset: (
                centre(frame.chart.height) - frame.center_mm.0 / (pitch * frame.scale.0),
                centre(frame.chart.width) - frame.center_mm.1 / (pitch * frame.scale.1),
            ),
            per_scale: (1.0 / frame.scale.0, 1.0 / frame.scale.1),
        }
    }

    /// (row, column, R) of the pixel (y, x).
    #[inline]
    pub(super) fn at(&self, y: i64, x: i64) -> (f64, f64, f64) {
        let (dy, dx) = (y as f64 - self.axis_px.0, x as f64 - self.axis_px.1);
        let (magnification, gain) = self.field.at((dy * dy + dx * dx).sqrt());
        let row = self.offset.0 + dy * magnification * self.per_scale.0;
        let col = self.offset.1 + dx * magnification * self.per_scale.1;
        (row, col, gain)
    }

    /// Chart columns of a film column, to the nearest whole one.
    #[inline(always)]
    pub(super) fn whole_columns(&self) -> f64 {
        self.per_scale.1.round()
    }

    /// The pixels of the block of anchors from (y, x) on, one by one.
    #[cfg(target_arch = "x86_64")]
    pub(super) fn exactly(&self, y: i64, x: i64) -> Exact {
        let zero = [0.0; SIDE];
        let mut to =
            Exact { row: [0; SIDE], col: [0; SIDE], row_fraction: zero, col_fraction: zero, gain: zero };
        for i in 0..SIDE {
            let (row, col, gain) = self.at(y, x + i as i64);
            let (row, col) = (Coordinate::new(row), Coordinate::new(col));
            (to.row[i], to.row_fraction[i]) = (row.cell, row.fraction);
            (to.col[i], to.col_fraction[i]) = (col.cell, col.fraction);
            to.gain[i] = gain as f32;
        }
        to
    }

    /// The `BLOCK` pixels from (y, x) on, if the field has them together.
    #[inline(always)]
    fn block(&self, y: i64, x: i64, to: &mut Block<'_>) -> bool {
        let dy = y as f64 - self.axis_px.0;
        let first = x as f64;
        let (mut dx, mut r) = ([0.0; BLOCK], [0.0; BLOCK]);
        for i in 0..BLOCK {
            dx[i] = first + i as f64 - self.axis_px.1;
            r[i] = (dy * dy + dx[i] * dx[i]).sqrt();
        }
        let Some((magnification, gain)) = self.field.block(r) else { return false };
        for i in 0..BLOCK {
            let row = Coordinate::new(self.offset.0 + dy * magnification[i] * self.per_scale.0);
            (to.row[i], to.row_fraction[i]) = (row.cell, row.fraction);
        }
        for i in 0..BLOCK {
            let col = Coordinate::new(self.offset.1 + dx[i] * magnification[i] * self.per_scale.1);
            (to.col[i], to.col_fraction[i]) = (col.cell, col.fraction);
        }
        for i in 0..BLOCK {
            to.gain[i] = gain[i] as f32;
        }
        true
    }

    /// The same one by one.
    #[cold]
    #[inline(never)]
    fn singly(&self, y: i64, x: i64, to: &mut Block<'_>) {
        for i in 0..BLOCK {
            let (row, col, gain) = self.at(y, x + i as i64);
            let (row, col) = (Coordinate::new(row), Coordinate::new(col));
            (to.row[i], to.row_fraction[i]) = (row.cell, row.fraction);
            (to.col[i], to.col_fraction[i]) = (col.cell, col.fraction);
            to.gain[i] = gain as f32;
        }
    }

    /// Fills `to` with the pixels of `strip`.
    #[inline(always)]
    pub(super) fn strip(&self, strip: Rect, to: &mut Points) {
        let lines = (to.row.chunks_exact_mut(to.stride).zip(to.col.chunks_exact_mut(to.stride)))
            .zip(to.row_fraction.chunks_exact_mut(to.stride).zip(to.col_fraction.chunks_exact_mut(to.stride)))
            .zip(to.gain.chunks_exact_mut(to.stride));
        for (y, (((row, col), (row_fraction, col_fraction)), gain)) in (strip.y..strip.bottom()).zip(lines) {
            let blocks = (row.as_chunks_mut().0.iter_mut().zip(col.as_chunks_mut().0))
                .zip(row_fraction.as_chunks_mut().0.iter_mut().zip(col_fraction.as_chunks_mut().0))
                .zip(gain.as_chunks_mut::<BLOCK>().0);
            for (x, (((row, col), (row_fraction, col_fraction)), gain)) in
                (strip.x..).step_by(BLOCK).zip(blocks)
            {
                let mut to = Block { row, col, row_fraction, col_fraction, gain };
                if !self.block(y, x, &mut to) {
                    self.singly(y, x, &mut to);
                }
            }
            let last = (row[strip.width - 1], col[strip.width - 1]);
            row[strip.width..].fill(last.0);
            col[strip.width..].fill(last.1);
        }
    }
}

/// Neighbours in a line of [`Points`].
struct Block<'a> {
    row: &'a mut [i32; BLOCK],
    col: &'a mut [i32; BLOCK],
    row_fraction: &'a mut [f32; BLOCK],
    col_fraction: &'a mut [f32; BLOCK],
    gain: &'a mut [f32; BLOCK],
}

impl Points {
    /// Makes room for a strip.
    pub(super) fn resize(&mut self, strip: Rect) {
        self.stride = strip.width.next_multiple_of(PAD);
        let n = strip.height * self.stride;
        self.row.resize(n, 0);
        self.col.resize(n, 0);
        self.row_fraction.resize(n, 0.0);
        self.col_fraction.resize(n, 0.0);
        self.gain.resize(n, 0.0);
    }
}

/// The least and the greatest.
#[inline(always)]
pub(super) fn ends(of: &[i32]) -> (i64, i64) {
    let (mut low, mut high) = ([i32::MAX; PAD], [i32::MIN; PAD]);
    for v in of.as_chunks::<PAD>().0 {
        for i in 0..PAD {
            low[i] = low[i].min(v[i]);
            high[i] = high[i].max(v[i]);
        }
    }
    let least = low.into_iter().fold(i32::MAX, i32::min);
    let greatest = high.into_iter().fold(i32::MIN, i32::max);
    (i64::from(least), i64::from(greatest))
}
