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

use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Rect, Size};
use crate::layer::Taps;
use crate::parts::for_each_part;
use crate::reduced_chart::Stopped;
use crate::resample::Surround;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// Side of the rectangles that are read, chart pixels.
const BLOCK_PX: usize = 512;
/// Cells around those of the chart. Black surroundings have no light in the outermost; other ones are even along the last.
const MARGIN: usize = 4;
/// Surroundings that the cells of the margin read, cells.
const REACH: usize = MARGIN + 2;

/// The light of a band of a chart on cells.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartCells {
    rows: CellAxis,
    columns: CellAxis,
    surround: Surround,
    /// Row-major, margin included.
    values: Vec<f32>,
}

/// Cells and their weights of each chart pixel along an axis.
type PixelWeights = Vec<Vec<(u32, f32)>>;

/// Cells along one axis of the chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct CellAxis {
    /// Chart pixels.
    pixels: usize,
    /// Side of a cell, chart pixels.
    side: usize,
}

impl CellAxis {
    /// Cells, margin included.
    fn cells(&self) -> usize {
        self.pixels.div_ceil(self.side) + 2 * MARGIN
    }

    /// The weights of the chart pixels: for each, cells and their weights. A pixel that surroundings repeat has those of its copies too.
    fn weights(&self, surround: Surround) -> PixelWeights {
        let reach = match surround {
            Surround::Black => 0,
            Surround::Edge | Surround::Mirror => (REACH * self.side) as i64,
        };
        let (n, side, cells) = (self.pixels, self.side as f64, self.cells());
        let mut all: Vec<Vec<(u32, f64)>> = vec![Vec::with_capacity(4); n];
        for place in -reach..n as i64 + reach {
            let Some(pixel) = surround.index(place, n) else { continue };
            let u = (place as f64 + 0.5) / side - 0.5;
            let cell = u.floor();
            for (tap, w) in Taps::Lagrange.weights(u - cell).into_iter().enumerate() {
                let to = cell as i64 - 1 + tap as i64 + MARGIN as i64;
                let Some(to) = u32::try_from(to).ok().filter(|to| (*to as usize) < cells) else { continue };
                match all[pixel].iter_mut().find(|(cell, _)| *cell == to) {
                    Some((_, sum)) => *sum += w / side,
                    None if w != 0.0 => all[pixel].push((to, w / side)),
                    None => {}
                }
            }
        }
        all.into_iter().map(|taps| taps.into_iter().map(|(cell, w)| (cell, w as f32)).collect()).collect()
    }

    /// First of the four cells around the chart coordinate `at`, margin included, and their weights.
    #[inline]
    fn around(&self, at: f64, surround: Surround) -> (usize, [f64; 4]) {
        let n = self.pixels as f64;
        let at = match surround {
            Surround::Mirror if !(-0.5..=n - 0.5).contains(&at) => {
                let m = (at + 0.5).rem_euclid(2.0 * n);
                m.min(2.0 * n - m) - 0.5
            }
            _ => at,
        };
        let last = (self.cells() - 2 * MARGIN) as f64 + (MARGIN - 2) as f64;
        let u = ((at + 0.5) / self.side as f64 - 0.5).clamp(1.0 - MARGIN as f64, last);
        let cell = u.floor().min(last - 1.0);
        ((cell + (MARGIN - 1) as f64) as usize, Taps::Lagrange.weights(u - cell))
    }
}

impl ChartCells {
    /// Bytes of the cells of `side` (rows, columns) px of a chart of `chart` px, and of what `threads` threads need to compute them.
    pub fn bytes(chart: Size, side: (usize, usize), threads: usize) -> (usize, usize) {
        let (rows, columns) = axes(chart, side);
        let block = BLOCK_PX * BLOCK_PX.min(chart.width);
        let strip = strip_px(side.0).min(chart.height).div_ceil(side.0) + 2 * REACH;
        let of_thread = 4 * (block + strip * (BLOCK_PX + columns.cells()));
        let weights = 64 * (chart.height + chart.width);
        (4 * rows.cells() * columns.cells(), weights + of_thread * threads)
    }

    /// Reads band `band` of `chart` into cells of `side` (rows, columns) px on `threads` threads; `cancel` stops it.
    ///
    /// # Errors
    /// Those of `chart`; [`Stopped`].
    pub fn read(
        chart: &dyn ChartSource,
        band: usize,
        side: (usize, usize),
        surround: Surround,
        threads: usize,
        cancel: &AtomicBool,
    ) -> Result<Self, SourceSinkError> {
        let (rows, columns) = axes(chart.size(), side);
        let width = columns.cells();
        let (of_rows, of_columns) = (rows.weights(surround), columns.weights(surround));
        let values = Mutex::new(vec![0f32; rows.cells() * width]);
        for_each_part(
            threads,
            (0..chart.size().height).step_by(strip_px(side.0)),
            || StripReader::new(chart, band, (&of_rows, &of_columns), width),
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
        let values = values.into_inner().expect("no panic while held");
        Ok(Self { rows, columns, surround, values })
    }

    /// The light at chart coordinates (row, column), pixel centres at integers.
    #[inline]
    pub fn at(&self, row: f64, column: f64) -> f64 {
        let ((top, down), (left, across)) =
            (self.rows.around(row, self.surround), self.columns.around(column, self.surround));
        let width = self.columns.cells();
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

fn axes(chart: Size, side: (usize, usize)) -> (CellAxis, CellAxis) {
    (CellAxis { pixels: chart.height, side: side.0 }, CellAxis { pixels: chart.width, side: side.1 })
}

/// Rows of chart pixels of a strip: more than the cells that a pixel contributes to, mirrored ones included.
fn strip_px(side: usize) -> usize {
    BLOCK_PX * ((2 * REACH * side).div_ceil(BLOCK_PX))
}

/// Sums a strip of the chart into cells.
struct StripReader<'a> {
    chart: &'a dyn ChartSource,
    band: usize,
    /// Of the chart's rows and columns.
    weights: (&'a PixelWeights, &'a PixelWeights),
    /// Cells of a row.
    width: usize,
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
        chart: &'a dyn ChartSource,
        band: usize,
        weights: (&'a PixelWeights, &'a PixelWeights),
        width: usize,
    ) -> Self {
        Self {
            chart,
            band,
            weights,
            width,
            pixels: Vec::new(),
            down: Vec::new(),
            first_cell: 0,
            cells: Vec::new(),
        }
    }

    /// Sums the `height` rows from `top` on.
    fn read(&mut self, top: usize, height: usize) -> Result<(), SourceSinkError> {
        let of_rows = &self.weights.0[top..top + height];
        let cells = || of_rows.iter().flatten().map(|(cell, _)| *cell as usize);
        self.first_cell = cells().min().expect("a row has cells");
        let count = cells().max().expect("a row has cells") + 1 - self.first_cell;
        self.cells.clear();
        self.cells.resize(count * self.width, 0.0);
        let chart_width = self.chart.size().width;
        for left in (0..chart_width).step_by(BLOCK_PX) {
            let width = BLOCK_PX.min(chart_width - left);
            self.down.clear();
            self.down.resize(count * width, 0.0);
            for row in (0..height).step_by(BLOCK_PX) {
                let rows = BLOCK_PX.min(height - row);
                let rect = Rect::new((top + row) as i64, left as i64, rows, width);
                crate::buffer::resize_exact(&mut self.pixels, rows * width);
                self.chart.read(self.band, rect, &mut self.pixels)?;
                for (pixels, taps) in self.pixels.chunks_exact(width).zip(&of_rows[row..]) {
                    for (cell, w) in taps {
                        let to = &mut self.down[(*cell as usize - self.first_cell) * width..][..width];
                        to.iter_mut().zip(pixels).for_each(|(to, v)| *to += w * v);
                    }
                }
            }
            let of_columns = &self.weights.1[left..left + width];
            for (to, sums) in self.cells.chunks_exact_mut(self.width).zip(self.down.chunks_exact(width)) {
                for (v, taps) in sums.iter().zip(of_columns) {
                    for (cell, w) in taps {
                        to[*cell as usize] += w * v;
                    }
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
