//! Map from film pixels to chart coordinates, in f64.
//!
//! Plain f64 arithmetic without fused operations, the same for every pixel: the bits do not depend on the instruction set or on the
//! rectangle being computed.
#![allow(clippy::needless_range_loop, reason = "lanes of several arrays at once")]

use crate::field::{BLOCK, Field};
use crate::geometry::{Frame, Rect};
use crate::resample::Coordinate;

/// Film columns per anchor on the SIMD and CUDA paths (`anchors`, `remap.cu`).
pub(crate) const ANCHOR_SPACING_PX: usize = 16;
/// Anchors nearer to the axis than this are not expanded: their pixels are mapped one by one, px.
pub(crate) const NEAR_AXIS_PX: f64 = 256.0;

/// Rows of [`Points`] are padded to a multiple of this many pixels: the lanes of the widest register.
pub(super) const PAD: usize = 16;

/// Chart coordinates (cells and fractions) and gain of the pixels of a film rectangle, rows padded with their last pixel.
#[derive(Debug, Default)]
pub(crate) struct Points {
    pub(crate) row: Vec<i32>,
    pub(crate) col: Vec<i32>,
    pub(crate) row_fraction: Vec<f32>,
    pub(crate) col_fraction: Vec<f32>,
    pub(crate) gain: Vec<f32>,
    pub(crate) stride: usize,
}

/// Map from film pixels to chart pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Map<'a> {
    pub(super) field: &'a Field,
    pub(super) axis_px: (f64, f64),
    /// Chart coordinates (row, column) of the axis.
    pub(super) offset: (f64, f64),
    /// 1/scale: chart pixels per film pixel at magnification 1.
    pub(super) per_scale: (f64, f64),
}

/// Chart coordinates (row, column) of the axis, and chart pixels per film pixel at magnification 1.
pub(super) fn chart_of_ideal(frame: &Frame) -> ((f64, f64), (f64, f64)) {
    let centre = |n: usize| (n as f64 - 1.0) / 2.0;
    let pitch = frame.pitch_mm();
    let offset = (
        centre(frame.chart.height) - frame.center_mm.0 / (pitch * frame.scale.0),
        centre(frame.chart.width) - frame.center_mm.1 / (pitch * frame.scale.1),
    );
    (offset, (1.0 / frame.scale.0, 1.0 / frame.scale.1))
}

impl<'a> Map<'a> {
    pub(crate) fn new(frame: &Frame, field: &'a Field) -> Self {
        let (offset, per_scale) = chart_of_ideal(frame);
        Self { field, axis_px: frame.axis_px, offset, per_scale }
    }

    /// Chart row, chart column and gain (R × film units) of the film pixel (y, x).
    #[inline]
    pub(crate) fn at(&self, y: i64, x: i64) -> (f64, f64, f64) {
        self.at_place(y as f64, x as f64)
    }

    /// As [`Map::at`], between film pixels.
    #[inline]
    pub(crate) fn at_place(&self, y: f64, x: f64) -> (f64, f64, f64) {
        let (dy, dx) = (y - self.axis_px.0, x - self.axis_px.1);
        let (magnification, gain) = self.field.at((dy * dy + dx * dx).sqrt());
        let row = self.offset.0 + dy * magnification * self.per_scale.0;
        let col = self.offset.1 + dx * magnification * self.per_scale.1;
        (row, col, gain)
    }

    /// Chart columns per film column at magnification 1, rounded.
    #[inline(always)]
    pub(super) fn integer_columns(&self) -> f64 {
        self.per_scale.1.round()
    }

    /// The pixels of the anchor block from (y, x) on.
    #[cfg(target_arch = "x86_64")]
    pub(super) fn exact_block(&self, y: i64, x: i64) -> ExactBlock {
        let mut exact = ExactBlock::default();
        self.pixel_by_pixel(y, x, &mut exact.as_block());
        exact
    }

    /// The `BLOCK` pixels from (y, x) on, if the field can look them up together ([`Field::block`]); whether it can.
    #[inline(always)]
    fn block(&self, y: i64, x: i64, to: &mut Block<'_, BLOCK>) -> bool {
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

    /// The `N` pixels from (y, x) on, one by one.
    #[cold]
    #[inline(never)]
    fn pixel_by_pixel<const N: usize>(&self, y: i64, x: i64, to: &mut Block<'_, N>) {
        for i in 0..N {
            let (row, col, gain) = self.at(y, x + i as i64);
            let (row, col) = (Coordinate::new(row), Coordinate::new(col));
            (to.row[i], to.row_fraction[i]) = (row.cell, row.fraction);
            (to.col[i], to.col_fraction[i]) = (col.cell, col.fraction);
            to.gain[i] = gain as f32;
        }
    }

    /// Fills `to` with the pixels of `rect`.
    #[inline(always)]
    pub(crate) fn fill(&self, rect: Rect, to: &mut Points) {
        to.fill(rect, &mut MapBlocks(self));
    }
}

/// A map that computes the pixels of a film rectangle block by block.
pub(super) trait FillBlocks {
    /// Prepares film row `y` from column `x` to before `end`.
    fn begin_row(&mut self, y: i64, x: i64, end: i64);
    /// The [`BLOCK`] pixels from (y, x) on.
    fn block(&mut self, y: i64, x: i64, to: &mut Block<'_, BLOCK>);
}

struct MapBlocks<'a>(&'a Map<'a>);

impl FillBlocks for MapBlocks<'_> {
    #[inline(always)]
    fn begin_row(&mut self, _: i64, _: i64, _: i64) {}

    #[inline(always)]
    fn block(&mut self, y: i64, x: i64, to: &mut Block<'_, BLOCK>) {
        if !self.0.block(y, x, to) {
            self.0.pixel_by_pixel(y, x, to);
        }
    }
}

/// `N` neighbouring pixels of a row.
pub(super) struct Block<'a, const N: usize> {
    pub(super) row: &'a mut [i32; N],
    pub(super) col: &'a mut [i32; N],
    pub(super) row_fraction: &'a mut [f32; N],
    pub(super) col_fraction: &'a mut [f32; N],
    pub(super) gain: &'a mut [f32; N],
}

/// Chart coordinates and gain of the pixels of an anchor block, mapped one by one.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Debug, Default)]
pub(super) struct ExactBlock {
    pub(super) row: [i32; ANCHOR_SPACING_PX],
    pub(super) col: [i32; ANCHOR_SPACING_PX],
    pub(super) row_fraction: [f32; ANCHOR_SPACING_PX],
    pub(super) col_fraction: [f32; ANCHOR_SPACING_PX],
    pub(super) gain: [f32; ANCHOR_SPACING_PX],
}

#[cfg(target_arch = "x86_64")]
impl ExactBlock {
    pub(super) fn as_block(&mut self) -> Block<'_, ANCHOR_SPACING_PX> {
        let Self { row, col, row_fraction, col_fraction, gain } = self;
        Block { row, col, row_fraction, col_fraction, gain }
    }
}

impl Points {
    /// Computes the pixels of `rect` by `map`.
    #[inline(always)]
    pub(super) fn fill(&mut self, rect: Rect, map: &mut impl FillBlocks) {
        self.resize(rect);
        let stride = self.stride;
        let rows = (self.row.chunks_exact_mut(stride).zip(self.col.chunks_exact_mut(stride)))
            .zip(self.row_fraction.chunks_exact_mut(stride).zip(self.col_fraction.chunks_exact_mut(stride)))
            .zip(self.gain.chunks_exact_mut(stride));
        for (y, (((row, col), (row_fraction, col_fraction)), gain)) in (rect.y..rect.bottom()).zip(rows) {
            map.begin_row(y, rect.x, rect.x + stride as i64);
            let blocks = (row.as_chunks_mut().0.iter_mut().zip(col.as_chunks_mut().0))
                .zip(row_fraction.as_chunks_mut().0.iter_mut().zip(col_fraction.as_chunks_mut().0))
                .zip(gain.as_chunks_mut::<BLOCK>().0);
            for (x, (((row, col), (row_fraction, col_fraction)), gain)) in
                (rect.x..).step_by(BLOCK).zip(blocks)
            {
                map.block(y, x, &mut Block { row, col, row_fraction, col_fraction, gain });
            }
            let last = (row[rect.width - 1], col[rect.width - 1]);
            row[rect.width..].fill(last.0);
            col[rect.width..].fill(last.1);
        }
    }

    /// Makes room for the pixels of `rect`.
    pub(super) fn resize(&mut self, rect: Rect) {
        self.stride = rect.width.next_multiple_of(PAD);
        let n = rect.height * self.stride;
        self.row.resize(n, 0);
        self.col.resize(n, 0);
        self.row_fraction.resize(n, 0.0);
        self.col_fraction.resize(n, 0.0);
        self.gain.resize(n, 0.0);
    }
}

/// Minimum and maximum; the length is a multiple of [`PAD`].
#[inline(always)]
pub(crate) fn min_max(values: &[i32]) -> (i64, i64) {
    let (mut low, mut high) = ([i32::MAX; PAD], [i32::MIN; PAD]);
    for v in values.as_chunks::<PAD>().0 {
        for i in 0..PAD {
            low[i] = low[i].min(v[i]);
            high[i] = high[i].max(v[i]);
        }
    }
    let min = low.into_iter().fold(i32::MAX, i32::min);
    let max = high.into_iter().fold(i32::MIN, i32::max);
    (i64::from(min), i64::from(max))
}
