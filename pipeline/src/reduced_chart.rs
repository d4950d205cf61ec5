//! The reduced chart of a band: means over s × s chart pixels, from which smooth layers of light are computed before the tiles.
//!
//! ```text
//! reduced(i, j) = Σ_x Σ_y chart(y, x) / number of pixels     i·s ≤ y < (i+1)·s, j·s ≤ x < (j+1)·s, inside the chart
//! ```
//! Values are as the image reads them (scale, offset, treatment of NaN). In f64: each column of a cell from top to bottom, then the columns
//! from left to right; the mean is rounded to f32 once. So its bits do not depend on the rectangles that are read or on the threads.
//!
//! Each chart pixel is read once, in rectangles of at most 512 px squared that begin at multiples of it, which are those of usual chunks.

use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Rect, Size};
use crate::parts::for_each_part;
use crate::resample::Surround;
use std::sync::atomic::{AtomicBool, Ordering};

/// Side of the rectangles that are read, chart pixels.
const BLOCK_PX: usize = 512;
/// Largest side of a cell, chart pixels.
const MAX_SIDE_PX: usize = 1 << 20;

/// Means of cells of chart pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct ReducedChart {
    /// Side of a cell, chart pixels, a power of two. Cells at the far edges have fewer.
    side: usize,
    /// Cells.
    size: Size,
    /// Row-major.
    values: Vec<f32>,
}

/// The band was not read to its end: the run is being stopped.
#[derive(Debug, thiserror::Error)]
#[error("stopped while the chart was read for a layer of light")]
pub struct Stopped;

impl ReducedChart {
    /// The largest side of cells within `bin` chart pixels, a power of two.
    pub fn side_within(bin: f64) -> usize {
        let mut side = 1;
        while side < MAX_SIDE_PX && (2 * side) as f64 <= bin {
            side *= 2;
        }
        side
    }

    /// Cells of `side` px of a chart of `chart` px.
    pub fn cells(chart: Size, side: usize) -> Size {
        Size::new(chart.height.div_ceil(side), chart.width.div_ceil(side))
    }

    /// Bytes of the reduced chart, and of what `threads` threads need to compute it.
    pub fn bytes(chart: Size, side: usize, threads: usize) -> (usize, usize) {
        let of_thread =
            BLOCK_PX * BLOCK_PX.min(chart.height) * 4 + BLOCK_PX * 8 + chart.width.div_ceil(side) * 8;
        (4 * Self::cells(chart, side).pixels(), of_thread * threads)
    }

    /// Pixels that a thread reads at a time, at most.
    pub const fn block_pixels() -> usize {
        BLOCK_PX * BLOCK_PX
    }

    /// Reads band `band` of `chart` on `threads` threads; `cancel` stops it.
    ///
    /// ```
    /// use lenscube_pipeline::flow::{ChartSource, SourceSinkError};
    /// use lenscube_pipeline::geometry::{Rect, Size};
    /// use lenscube_pipeline::reduced_chart::ReducedChart;
    /// use std::sync::atomic::AtomicBool;
    ///
    /// /// Column numbers.
    /// struct Columns;
    /// impl ChartSource for Columns {
    ///     fn size(&self) -> Size {
    ///         Size::new(10, 6)
    ///     }
    ///     fn read(&self, _: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
    ///         out.iter_mut().enumerate().for_each(|(i, v)| *v = (rect.x as usize + i % rect.width) as f32);
    ///         Ok(())
    ///     }
    /// }
    ///
    /// let reduced = ReducedChart::read(&Columns, 0, 4, 2, &AtomicBool::new(false)).unwrap();
    /// assert_eq!(reduced.size(), Size::new(3, 2));
    /// assert_eq!(reduced.values(), [1.5, 4.5, 1.5, 4.5, 1.5, 4.5]);
    /// ```
    ///
    /// # Errors
    /// Those of `chart`; [`Stopped`].
    pub fn read(
        chart: &dyn ChartSource,
        band: usize,
        side: usize,
        threads: usize,
        cancel: &AtomicBool,
    ) -> Result<Self, SourceSinkError> {
        let size = Self::cells(chart.size(), side);
        let mut values = vec![0f32; size.pixels()];
        // Rows of cells that one thread reads at a time: of whole blocks of chart pixels.
        let rows = (BLOCK_PX / side).max(1);
        for_each_part(
            threads,
            values.chunks_mut(rows * size.width).enumerate(),
            || CellRows::new(chart, band, side),
            |reader, (part, values)| match cancel.load(Ordering::Relaxed) {
                true => Err(Stopped.into()),
                false => reader.read(part * rows, values),
            },
        )?;
        Ok(Self { side, size, values })
    }

    /// The reduced chart with these `values`, row by row, of a chart of `chart` px.
    ///
    /// # Panics
    /// Another number of values.
    pub fn of_values(chart: Size, side: usize, values: Vec<f32>) -> Self {
        let size = Self::cells(chart, side);
        assert_eq!(values.len(), size.pixels(), "one value per cell");
        Self { side, size, values }
    }

    /// Side of a cell, chart pixels.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Cells.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Means, row by row.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Bilinear value at chart coordinates (row, column), pixel centres at integers; `surround` beyond the chart.
    #[inline]
    pub fn at(&self, row: f64, column: f64, surround: Surround) -> f64 {
        let place = |at: f64| (at + 0.5) / self.side as f64 - 0.5;
        let (mut y, mut x) = (place(row), place(column));
        let last = (self.size.height as f64 - 1.0, self.size.width as f64 - 1.0);
        if surround == Surround::Edge {
            (y, x) = (y.clamp(0.0, last.0), x.clamp(0.0, last.1));
        }
        let has_pairs = self.size.height > 1 && self.size.width > 1;
        if has_pairs && y >= 0.0 && y <= last.0 && x >= 0.0 && x <= last.1 {
            let (i, j) = ((y as usize).min(self.size.height - 2), (x as usize).min(self.size.width - 2));
            let (fy, fx) = (y - i as f64, x - j as f64);
            let line = |row: usize| {
                let pair = &self.values[row * self.size.width + j..][..2];
                (1.0 - fx) * f64::from(pair[0]) + fx * f64::from(pair[1])
            };
            return (1.0 - fy) * line(i) + fy * line(i + 1);
        }
        self.beyond((y, x), surround)
    }

    /// [`ReducedChart::at`] for the place (row, column) in cells, which need not lie between cells.
    fn beyond(&self, (y, x): (f64, f64), surround: Surround) -> f64 {
        let along = |place: f64, n: usize| {
            let cell = place.floor();
            let index = |i: f64| surround.index(i as i64, n);
            (index(cell), index(cell + 1.0), place - cell)
        };
        let ((top, bottom, fy), (left, right, fx)) = (along(y, self.size.height), along(x, self.size.width));
        let value = |row: Option<usize>, column: Option<usize>| match (row, column) {
            (Some(row), Some(column)) => f64::from(self.values[row * self.size.width + column]),
            _ => 0.0,
        };
        let line = |row| (1.0 - fx) * value(row, left) + fx * value(row, right);
        (1.0 - fy) * line(top) + fy * line(bottom)
    }
}

/// Reads rows of cells.
struct CellRows<'a> {
    chart: &'a dyn ChartSource,
    band: usize,
    side: usize,
    pixels: Vec<f32>,
    /// Sums of the columns of a block in the present row of cells.
    columns: Vec<f64>,
    /// Sums of a row of cells.
    cells: Vec<f64>,
}

impl<'a> CellRows<'a> {
    fn new(chart: &'a dyn ChartSource, band: usize, side: usize) -> Self {
        let cells = vec![0.0; chart.size().width.div_ceil(side)];
        Self { chart, band, side, pixels: Vec::new(), columns: vec![0.0; BLOCK_PX], cells }
    }

    /// Means of the rows of cells from `first` on into `values`: one row of cells, or as many as a block has.
    fn read(&mut self, first: usize, values: &mut [f32]) -> Result<(), SourceSinkError> {
        match self.side >= BLOCK_PX {
            true => self.read_high_row(first, values),
            false => self.read_low_rows(first, values),
        }
    }

    /// Rows of cells that lie in one row of blocks, block by block.
    fn read_low_rows(&mut self, first: usize, values: &mut [f32]) -> Result<(), SourceSinkError> {
        let (side, size, cells) = (self.side, self.chart.size(), self.cells.len());
        let top = first * side;
        let height = (values.len() / cells * side).min(size.height - top);
        for left in (0..size.width).step_by(BLOCK_PX) {
            let width = BLOCK_PX.min(size.width - left);
            self.fetch(Rect::new(top as i64, left as i64, height, width))?;
            for (row, rows) in self.pixels[..height * width].chunks(side * width).enumerate() {
                let columns = &mut self.columns[..width];
                columns.fill(0.0);
                add_rows(columns, rows);
                let to = &mut values[row * cells + left / side..];
                for (to, columns) in to.iter_mut().zip(columns.chunks(side)) {
                    let sum = columns.iter().fold(0.0, |sum, column| sum + column);
                    *to = (sum / (columns.len() * (rows.len() / width)) as f64) as f32;
                }
            }
        }
        Ok(())
    }

    /// A row of cells of one or more blocks: the columns of each cell are summed over all blocks below each other.
    fn read_high_row(&mut self, first: usize, values: &mut [f32]) -> Result<(), SourceSinkError> {
        let (side, size) = (self.side, self.chart.size());
        let top = first * side;
        let height = side.min(size.height - top);
        self.cells.fill(0.0);
        for left in (0..size.width).step_by(BLOCK_PX) {
            let width = BLOCK_PX.min(size.width - left);
            self.columns.fill(0.0);
            for row in (0..height).step_by(BLOCK_PX) {
                let rows = BLOCK_PX.min(height - row);
                self.fetch(Rect::new((top + row) as i64, left as i64, rows, width))?;
                add_rows(&mut self.columns[..width], &self.pixels[..rows * width]);
            }
            let cell = &mut self.cells[left / side];
            *cell = self.columns[..width].iter().fold(*cell, |sum, column| sum + column);
        }
        for (j, (to, sum)) in values.iter_mut().zip(&self.cells).enumerate() {
            let width = side.min(size.width - j * side);
            *to = (sum / (height as f64 * width as f64)) as f32;
        }
        Ok(())
    }

    /// Reads the chart rectangle `rect`.
    fn fetch(&mut self, rect: Rect) -> Result<(), SourceSinkError> {
        let n = rect.size().pixels();
        crate::buffer::resize_exact(&mut self.pixels, n);
        self.chart.read(self.band, rect, &mut self.pixels[..n])
    }
}

/// Adds `rows` of pixels to the sums of their columns, from top to bottom.
fn add_rows(columns: &mut [f64], rows: &[f32]) {
    for row in rows.chunks_exact(columns.len()) {
        columns.iter_mut().zip(row).for_each(|(sum, pixel)| *sum += f64::from(*pixel));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chart of noise; reading fails at a row.
    struct Noise {
        size: Size,
        fails_at: Option<i64>,
    }

    fn value(y: i64, x: i64) -> f32 {
        let mixed = ((y as u64) << 32 | x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (mixed >> 40) as f32 / (1 << 24) as f32
    }

    impl ChartSource for Noise {
        fn size(&self) -> Size {
            self.size
        }
        fn read(&self, _: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
            assert!(self.size.rect().contains(rect) && rect.height <= BLOCK_PX && rect.width <= BLOCK_PX);
            if self.fails_at.is_some_and(|row| (rect.y..rect.bottom()).contains(&row)) {
                return Err("damaged".into());
            }
            for (y, row) in (rect.y..).zip(out.chunks_exact_mut(rect.width)) {
                (rect.x..).zip(row).for_each(|(x, to)| *to = value(y, x));
            }
            Ok(())
        }
    }

    fn read(size: Size, side: usize, threads: usize) -> Vec<f32> {
        let chart = Noise { size, fails_at: None };
        ReducedChart::read(&chart, 0, side, threads, &AtomicBool::new(false)).unwrap().values
    }

    /// The mean of a cell by the rule of the module: columns from top to bottom, then from left to right.
    fn mean(size: Size, side: usize, (i, j): (usize, usize)) -> f32 {
        let (rows, columns) =
            (i * side..((i + 1) * side).min(size.height), j * side..((j + 1) * side).min(size.width));
        let column = |x: usize| rows.clone().fold(0.0, |sum, y| sum + f64::from(value(y as i64, x as i64)));
        let sum = columns.clone().fold(0.0, |sum, x| sum + column(x));
        (sum / (rows.len() * columns.len()) as f64) as f32
    }

    #[test]
    fn cells_have_the_bits_of_their_sum_in_the_fixed_order() {
        for size in [Size::new(203, 331), Size::new(1100, 1537), Size::new(1, 1)] {
            for side in [1, 4, 16, 64, 512, 1024] {
                let (found, cells) = (read(size, side, 1), ReducedChart::cells(size, side));
                for (k, found) in found.iter().enumerate() {
                    let expected = mean(size, side, (k / cells.width, k % cells.width));
                    assert_eq!(found.to_bits(), expected.to_bits(), "{size}, {side}, cell {k}");
                }
                assert_eq!(read(size, side, 3), found);
            }
        }
    }

    #[test]
    fn errors_and_a_stop_end_the_reading() {
        let chart = Noise { size: Size::new(1200, 40), fails_at: Some(1100) };
        let error = ReducedChart::read(&chart, 0, 8, 2, &AtomicBool::new(false)).unwrap_err();
        assert_eq!(error.to_string(), "damaged");
        let error = ReducedChart::read(&chart, 0, 8, 2, &AtomicBool::new(true)).unwrap_err();
        assert!(error.is::<Stopped>());
    }

    #[test]
    fn side_is_the_largest_power_of_two_within_a_bin() {
        assert_eq!([0.4, 1.0, 7.9, 8.0, 33.0].map(ReducedChart::side_within), [1, 1, 4, 8, 32]);
    }

    /// A plane is interpolated exactly between the centres of complete cells; beyond the chart by the surround.
    #[test]
    fn values_between_cells_are_bilinear() {
        let chart = Size::new(64, 64);
        let plane = |i: usize| (i / 8) as f32 * 8.0 + 3.5 + 2.0 * ((i % 8) as f32 * 8.0 + 3.5);
        let reduced = ReducedChart::of_values(chart, 8, (0..64).map(plane).collect());
        for (row, column) in [(3.5, 3.5), (10.25, 40.0), (59.5, 20.125)] {
            assert!((reduced.at(row, column, Surround::Edge) - (row + 2.0 * column)).abs() < 1e-12);
        }
        assert_eq!(reduced.at(-100.0, 3.5, Surround::Edge), f64::from(plane(0)));
        assert_eq!(reduced.at(-100.0, 3.5, Surround::Black), 0.0);
        assert_eq!(reduced.at(-4.5, 3.5, Surround::Mirror), f64::from(plane(0)));
    }
}
