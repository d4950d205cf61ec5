//! The light of a chart on coarse cells, by which the tails of every point keep their place.
//!
//! ```text
//! c(k, l) = Σ_y Σ_x w_k(y) w_l(x) chart(y, x) / (s_y s_x)      w_k(y): four-tap cubic Lagrange weight of cell k at u = (y + ½)/s_y − ½
//! ```
//! the transpose of the interpolation from cells to pixels, over the chart and its surroundings (none if they are black). A point keeps its light, its
//! place and its moments up to the third, which means over cells do not: they move it by up to half a cell.
//!
//! Read back between cells by the same interpolation ([`ChartCells::at`]). Cells at the edge of a chart with surroundings hold [`MARGIN`] cells beyond.
//!
//! Rows of the chart are summed in strips, in f32, each strip in the same order by one thread; a cell has parts of at most two strips, so the bits do not
//! depend on the number of threads. Each chart pixel is read once, in rectangles of at most 512 px squared that begin at multiples of it.

use super::axis::{CellGrid, CellWeights, REACH, with_pixels};
use super::curve::{Curve, place_on};
use super::lanes::{AddAcross, AddRows, Interpolate, dot};
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Rect, Size};
use crate::parts::for_each_part;
use crate::reduced_chart::Stopped;
use crate::resample::Surround;
use crate::simd::lanes::MAX_LANES;
use crate::simd::{Simd, UnfusedOp};
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// Side of the rectangles that are read, chart pixels.
const BLOCK_PX: usize = 512;
/// The light of a band of a chart on cells.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartCells {
    grid: CellGrid,
    /// Row-major, margin included.
    values: Vec<f32>,
}

impl ChartCells {
    /// Bytes of the cells of `side` (rows, columns) px of a chart of `chart` px, and of what `threads` threads need to compute them.
    pub fn bytes(chart: Size, side: (usize, usize), threads: usize) -> (usize, usize) {
        let grid = CellGrid::new(chart, side, Surround::Black);
        let block = BLOCK_PX * BLOCK_PX.min(chart.width);
        let strip = strip_px(side.0).min(chart.height).div_ceil(side.0) + 2 * REACH;
        let of_thread = 4 * (block + strip * (BLOCK_PX + grid.columns.cells()));
        let weights = 96 * (chart.height + chart.width);
        (4 * grid.count(), weights + of_thread * threads)
    }

    /// Reads band `band` of `chart` into cells of `side` (rows, columns) px on `threads` threads; `cancel` stops it.
    ///
    /// # Errors
    /// Those of `chart`; [`Stopped`].
    pub fn read(
        (chart, band): (&dyn ChartSource, usize),
        side: (usize, usize),
        surround: Surround,
        simd: Simd,
        threads: usize,
        cancel: &AtomicBool,
    ) -> Result<Self, SourceSinkError> {
        let grid = CellGrid::new(chart.size(), side, surround);
        let (of_rows, of_columns) = grid.weights();
        let width = grid.columns.cells();
        let values = Mutex::new(crate::buffer::zeros(grid.count()));
        for_each_part(
            threads,
            (0..chart.size().height).step_by(strip_px(side.0)),
            || StripReader::new((chart, band), simd, (&of_rows, &of_columns)),
            |reader, top| {
                if cancel.load(Ordering::Relaxed) {
                    return Err(Stopped.into());
                }
                reader.read(top, strip_px(side.0).min(chart.size().height - top))?;
                // A row of cells that two strips have is a sum of two numbers, in either order.
                let mut values = values.lock().expect("no panic while held");
                let to = &mut values[reader.first_cell * width..][..reader.cells.len()];
                to.iter_mut().zip(&reader.cells).for_each(|(to, v)| *to += v);
                Ok::<_, SourceSinkError>(())
            },
        )?;
        Ok(Self { grid, values: values.into_inner().expect("no panic while held") })
    }

    /// The light at chart coordinates (row, column), times a gain (third element), of places 0, 1, … of `out`: polynomials of the place, of which `curve`
    /// has the coefficients. In f32 where no surroundings need folding.
    pub(super) fn along(&self, curve: Curve, simd: Simd, out: &mut [f32; MAX_LANES]) {
        let mut has_all = true;
        Interpolate { grid: &self.grid, cells: &self.values, curve: &curve, has_all: &mut has_all, out }
            .run_unfused(simd);
        if has_all {
            return;
        }
        for (i, to) in out.iter_mut().enumerate() {
            let [row, column, gain] = place_on(&curve, i);
            *to = (gain * self.at(row, column)) as f32;
        }
    }

    /// The light at chart coordinates (row, column), pixel centres at integers.
    #[inline]
    pub fn at(&self, row: f64, column: f64) -> f64 {
        let ((top, down), (left, across)) = self.grid.around(row, column);
        let width = self.grid.columns.cells();
        let line = |i: usize| {
            let v: &[f32; 4] =
                self.values[(top + i) * width + left..][..4].try_into().expect("four cells of a row");
            across[0] * f64::from(v[0])
                + across[1] * f64::from(v[1])
                + across[2] * f64::from(v[2])
                + across[3] * f64::from(v[3])
        };
        down[0] * line(0) + down[1] * line(1) + down[2] * line(2) + down[3] * line(3)
    }
}

/// Rows of chart pixels of a strip: more than the cells that a pixel contributes to, mirrored ones included.
fn strip_px(side: usize) -> usize {
    BLOCK_PX * ((2 * REACH * side).div_ceil(BLOCK_PX))
}

/// Sums a strip of the chart into cells.
struct StripReader<'a> {
    chart: &'a dyn ChartSource,
    band: usize,
    simd: Simd,
    /// Of the chart's rows and columns.
    weights: (&'a [CellWeights], &'a [CellWeights]),
    pixels: Vec<f32>,
    /// Rows of cells by columns of pixels of a block.
    down: Vec<f32>,
    /// First row of cells of the strip.
    first_cell: usize,
    /// Rows of cells of the strip.
    cells: Vec<f32>,
}

impl<'a> StripReader<'a> {
    fn new(
        (chart, band): (&'a dyn ChartSource, usize),
        simd: Simd,
        weights: (&'a [CellWeights], &'a [CellWeights]),
    ) -> Self {
        let (pixels, down, cells) = Default::default();
        Self { chart, band, simd, weights, pixels, down, first_cell: 0, cells }
    }

    /// Sums the `height` rows from `top` on.
    fn read(&mut self, top: usize, height: usize) -> Result<(), SourceSinkError> {
        let (of_rows, of_columns) = self.weights;
        let rows = with_pixels(of_rows, top, top + height);
        self.first_cell = rows.start;
        let of_rows = &of_rows[rows];
        self.cells.clear();
        self.cells.resize(of_rows.len() * of_columns.len(), 0.0);
        let chart_width = self.chart.size().width;
        for left in (0..chart_width).step_by(BLOCK_PX) {
            let width = BLOCK_PX.min(chart_width - left);
            self.down.clear();
            self.down.resize(of_rows.len() * width, 0.0);
            for row in (top..top + height).step_by(BLOCK_PX) {
                let rows = BLOCK_PX.min(top + height - row);
                let rect = Rect::new(row as i64, left as i64, rows, width);
                crate::buffer::resize_exact(&mut self.pixels, rows * width);
                self.chart.read(self.band, rect, &mut self.pixels)?;
                for (to, cell) in self.down.chunks_exact_mut(width).zip(of_rows) {
                    let (first, weights) = cell.within(row, row + rows);
                    if !weights.is_empty() {
                        let pixels = &self.pixels[(first - row) * width..];
                        AddRows { to, pixels, weights }.run_unfused(self.simd);
                    }
                }
            }
            let columns = with_pixels(of_columns, left, left + width);
            let first = columns.start;
            let parts: Vec<_> =
                of_columns[columns].iter().map(|cell| cell.within(left, left + width)).collect();
            let alike = Alike::of(&parts);
            for (to, sums) in self.cells.chunks_exact_mut(of_columns.len()).zip(self.down.chunks_exact(width))
            {
                let to = &mut to[first..];
                for k in (0..alike.cells.start).chain(alike.cells.end..parts.len()) {
                    let (pixel, weights) = parts[k];
                    to[k] += dot(&sums[pixel - left..][..weights.len()], weights);
                }
                if let Some((pixel, _)) = parts.get(alike.cells.start) {
                    let Alike { side, weights, .. } = alike;
                    let (to, pixels) = (&mut to[alike.cells.clone()], &sums[pixel - left..]);
                    AddAcross { to, pixels, side, weights }.run_unfused(self.simd);
                }
            }
        }
        Ok(())
    }
}

/// Cells of a row that have the same weights, complete quads, each the same number of pixels behind the one before.
struct Alike<'a> {
    cells: Range<usize>,
    side: usize,
    weights: &'a [[f32; 4]],
}

impl<'a> Alike<'a> {
    /// Those about the middle of `cells`, of which each has its first pixel and the weights from there on.
    fn of(cells: &[(usize, &'a [f32])]) -> Self {
        let middle = cells.len() / 2;
        let none = Self { cells: middle..middle, side: 0, weights: &[] };
        let Some([(first, weights), (next, _)]) = cells[middle..].first_chunk() else { return none };
        let ((quads, rest), Some(side)) = (weights.as_chunks(), next.checked_sub(*first)) else {
            return none;
        };
        if !rest.is_empty() {
            return none;
        }
        let is_alike = |k: &usize| cells[*k].1 == *weights && cells[*k].0 + middle * side == first + k * side;
        let start = (0..middle).rev().take_while(is_alike).last().unwrap_or(middle);
        let last = (middle..cells.len()).take_while(is_alike).last().unwrap_or(middle);
        Self { cells: start..last + 1, side, weights: quads }
    }
}

#[cfg(test)]
mod tests;
