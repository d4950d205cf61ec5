//! Map from film pixels to chart coordinates of a lens without rotational symmetry.
//!
//! ```text
//! row = offset + (dy + D_y(dy, dx))/scale,   column = offset + (dx + D_x(dy, dx))/scale,   gain = R(dy, dx)
//! (dy, dx) = the film place, px from the axis
//! ```
//! with D and R of [`crate::field::planar`]. The portable path evaluates the cubics of the film row at every pixel, in f64;
//! SIMD at one in sixteen, with their derivatives (`anchors`), and expands the others (`lanes`). `reach` bounds the map over
//! rectangles.
#![allow(clippy::needless_range_loop, reason = "lanes of several arrays at once")]

#[cfg(target_arch = "x86_64")]
pub(super) mod anchors;
#[cfg(target_arch = "x86_64")]
mod columns;
#[cfg(target_arch = "x86_64")]
pub(super) mod lanes;
mod reach;

use super::map::{Block, FillBlocks, Points, chart_of_ideal};
use crate::field::BLOCK;
use crate::field::planar::{FilmRow, PlanarField, value};
use crate::geometry::{Frame, Rect};
use crate::resample::Coordinate;
use crate::spline::tensor::clamped;

/// Map from film pixels to chart pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlanarChartMap<'a> {
    field: &'a PlanarField,
    axis_px: (f64, f64),
    /// Chart coordinates (row, column) of the axis.
    offset: (f64, f64),
    /// 1/scale: chart pixels per film pixel without displacement.
    per_scale: (f64, f64),
}

impl<'a> PlanarChartMap<'a> {
    pub(crate) fn new(frame: &Frame, field: &'a PlanarField) -> Self {
        let (offset, per_scale) = chart_of_ideal(frame);
        Self { field, axis_px: frame.axis_px, offset, per_scale }
    }

    /// Chart row, chart column and gain (R × film units) of the place (y, x), film pixels.
    #[inline]
    pub(crate) fn at_place(&self, y: f64, x: f64) -> (f64, f64, f64) {
        let (dy, dx) = (y - self.axis_px.0, x - self.axis_px.1);
        let [down, across, gain] = self.field.at(dy, dx);
        (self.row(dy, down), self.column(dx, across), gain)
    }

    #[inline(always)]
    fn row(&self, dy: f64, displacement: f64) -> f64 {
        self.offset.0 + (dy + displacement) * self.per_scale.0
    }

    #[inline(always)]
    fn column(&self, dx: f64, displacement: f64) -> f64 {
        self.offset.1 + (dx + displacement) * self.per_scale.1
    }

    /// Fills `to` with the pixels of `rect`; `row` is a buffer.
    pub(crate) fn fill(&self, rect: Rect, to: &mut Points, row: &mut FilmRow) {
        to.fill(rect, &mut Blocks { map: self, row });
    }

    /// Chart rows, chart columns and gains of the film pixels from (y, x) on; `row` is a buffer.
    pub(crate) fn fill_line(&self, y: i64, x: i64, to: &mut [(f64, f64, f64)], row: &mut FilmRow) {
        self.film_row(y, (x, x + to.len() as i64), row);
        for (x, to) in (x..).zip(to) {
            *to = self.pixel(row, y, x);
        }
    }

    /// Chart row, chart column and gain of the film pixel (y, x), a pixel of `row`.
    #[inline(always)]
    fn pixel(&self, row: &FilmRow, y: i64, x: i64) -> (f64, f64, f64) {
        let (dy, dx) = (y as f64 - self.axis_px.0, x as f64 - self.axis_px.1);
        let (cell, fraction) = self.field.column(dx);
        let [down, across, gain] = value(row.cubic(cell), fraction);
        (self.row(dy, down), self.column(dx, across), gain)
    }

    /// The cubics of film row `y` from column `x` to before `end`.
    #[inline(always)]
    fn film_row(&self, y: i64, (x, end): (i64, i64), row: &mut FilmRow) {
        let across = (x as f64 - self.axis_px.1, (end - 1) as f64 - self.axis_px.1);
        self.field.row(y as f64 - self.axis_px.0, across, row);
    }

    /// The `N` pixels from (y, x) on, one by one.
    #[cold]
    #[inline(never)]
    fn pixel_by_pixel<const N: usize>(&self, row: &FilmRow, y: i64, x: i64, to: &mut Block<'_, N>) {
        for i in 0..N {
            let (row, col, gain) = self.pixel(row, y, x + i as i64);
            let (row_at, col_at) = (Coordinate::new(row), Coordinate::new(col));
            (to.row[i], to.row_fraction[i]) = (row_at.cell, row_at.fraction);
            (to.col[i], to.col_fraction[i]) = (col_at.cell, col_at.fraction);
            to.gain[i] = gain as f32;
        }
    }
}

/// The map with the cubics of a film row.
struct Blocks<'a> {
    map: &'a PlanarChartMap<'a>,
    row: &'a mut FilmRow,
}

impl FillBlocks for Blocks<'_> {
    fn begin_row(&mut self, y: i64, x: i64, end: i64) {
        self.map.film_row(y, (x, end), self.row);
    }

    #[inline(always)]
    fn block(&mut self, y: i64, x: i64, to: &mut Block<'_, BLOCK>) {
        let map = self.map;
        let dy = y as f64 - map.axis_px.0;
        let (first, cells) = (x as f64, map.field.cells().1);
        let (mut dx, mut f) = ([0.0; BLOCK], [0.0; BLOCK]);
        for i in 0..BLOCK {
            dx[i] = first + i as f64 - map.axis_px.1;
        }
        let (cell, last) = (map.field.column(dx[0]).0, map.field.column(dx[BLOCK - 1]).0);
        if cell != last {
            return map.pixel_by_pixel(self.row, y, x, to);
        }
        for i in 0..BLOCK {
            f[i] = clamped(map.field.nodes_to(dx[i]), cells) - cell as f64;
        }
        let a = self.row.cubic(cell);
        let mut sum = [[0.0; BLOCK]; 3];
        for of in 0..3 {
            for i in 0..BLOCK {
                sum[of][i] = a[0][of] + f[i] * (a[1][of] + f[i] * (a[2][of] + f[i] * a[3][of]));
            }
        }
        for i in 0..BLOCK {
            let row = Coordinate::new(map.row(dy, sum[0][i]));
            (to.row[i], to.row_fraction[i]) = (row.cell, row.fraction);
        }
        for i in 0..BLOCK {
            let col = Coordinate::new(map.column(dx[i], sum[1][i]));
            (to.col[i], to.col_fraction[i]) = (col.cell, col.fraction);
        }
        for i in 0..BLOCK {
            to.gain[i] = sum[2][i] as f32;
        }
    }
}

#[cfg(test)]
mod tests;
