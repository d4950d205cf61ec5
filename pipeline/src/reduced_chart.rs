//! The reduced chart of a band: means over s × s chart pixels, from which smooth layers of light are computed before the tiles.
//!
//! ```text
//! reduced(i, j) = Σ_x Σ_y chart(y, x) / number of pixels     i·s ≤ y < (i+1)·s, j·s ≤ x < (j+1)·s, inside the chart
//! ```
//! Values are as the image reads them (scale, offset, treatment of NaN). In f64: each column of a cell from top to bottom, then the columns
//! from left to right; the mean is rounded to f32 once. So its bits do not depend on the rectangles that are read or on the threads. With them are the
//! *rims*: means of the outermost rows and columns of pixels over the cells along them, and the pixels of the corners, of which what surrounds the chart is made
//! ([`extended`](super::extended_chart)).
//!
//! Each chart pixel is read once, in rectangles of at most 512 px squared that begin at multiples of it, which are those of usual chunks.

use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Rect, Size};
use crate::parts::for_each_part;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// Side of the rectangles that are read, chart pixels.
const BLOCK_PX: usize = 512;
/// Largest side of a cell, chart pixels.
const MAX_SIDE_PX: usize = 1 << 20;

/// Means of cells of chart pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct ReducedChart {
    /// Chart size, pixels.
    chart: Size,
    /// Side of a cell, chart pixels, a power of two. Cells at the far edges have fewer.
    side: usize,
    /// Cells row by row; then the left and the right rim from top to bottom, and the upper and the lower rim from left to right with the pixels of the corners.
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

    /// Number of [`stored`](Self::stored) values.
    pub fn count(chart: Size, side: usize) -> usize {
        let cells = Self::cells(chart, side);
        cells.pixels() + 2 * cells.height + 2 * (cells.width + 2)
    }

    /// Bytes of the reduced chart, and of what `threads` threads need to compute it.
    pub fn bytes(chart: Size, side: usize, threads: usize) -> (usize, usize) {
        let of_thread =
            BLOCK_PX * BLOCK_PX.min(chart.height) * 4 + BLOCK_PX * 8 + 3 * chart.width.div_ceil(side) * 8;
        (4 * Self::count(chart, side), of_thread * threads)
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
        let mut values = vec![0f32; Self::count(chart.size(), side)];
        let (cells, rims) = values.split_at_mut(size.pixels());
        let (left, rims) = rims.split_at_mut(size.height);
        let (right, rims) = rims.split_at_mut(size.height);
        let rims = Mutex::new(rims.split_at_mut(size.width + 2));
        // Rows of cells that one thread reads at a time: of whole blocks of chart pixels.
        let rows = (BLOCK_PX / side).max(1);
        let parts =
            cells.chunks_mut(rows * size.width).zip(left.chunks_mut(rows)).zip(right.chunks_mut(rows));
        for_each_part(
            threads,
            parts.enumerate(),
            || CellRows::new(chart, band, side),
            |reader, (part, ((cells, left), right))| -> Result<(), SourceSinkError> {
                if cancel.load(Ordering::Relaxed) {
                    return Err(Stopped.into());
                }
                reader.read(part * rows, Part { cells, left, right })?;
                let mut rims = rims.lock().expect("no panic while held");
                if part == 0 {
                    rims.0.copy_from_slice(&reader.top.means(side, chart.size().width));
                }
                if (part + 1) * rows >= size.height {
                    rims.1.copy_from_slice(&reader.bottom.means(side, chart.size().width));
                }
                Ok(())
            },
        )?;
        Ok(Self { chart: chart.size(), side, values })
    }

    /// The reduced chart with these [`stored`](Self::stored) values of a chart of `chart` px.
    ///
    /// # Panics
    /// Another number of values.
    pub fn of_stored(chart: Size, side: usize, values: Vec<f32>) -> Self {
        assert_eq!(values.len(), Self::count(chart, side), "cells and rims");
        Self { chart, side, values }
    }

    /// The reduced chart of a chart of `chart` px whose cells have these `cells`, and rims the values of the cells at them.
    ///
    /// # Panics
    /// Another number of cells.
    pub fn of_cells(chart: Size, side: usize, cells: Vec<f32>) -> Self {
        let size = Self::cells(chart, side);
        assert_eq!(cells.len(), size.pixels(), "one value per cell");
        let column = |j: usize| cells.iter().skip(j).step_by(size.width).copied().collect::<Vec<f32>>();
        let row = |i: usize| {
            let row = &cells[i * size.width..][..size.width];
            [&row[..1], row, &row[size.width - 1..]].concat()
        };
        let values =
            [&cells[..], &column(0), &column(size.width - 1), &row(0), &row(size.height - 1)].concat();
        Self { chart, side, values }
    }

    /// Chart size, pixels.
    pub fn chart(&self) -> Size {
        self.chart
    }

    /// Side of a cell, chart pixels.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Cells.
    pub fn size(&self) -> Size {
        Self::cells(self.chart, self.side)
    }

    /// Means of the cells, row by row.
    pub fn values(&self) -> &[f32] {
        &self.values[..self.size().pixels()]
    }

    /// All values: cells, rims, corners.
    pub fn stored(&self) -> &[f32] {
        &self.values
    }

    /// Rims: left, right (from top to bottom), upper, lower (from left to right, with the corners).
    pub(crate) fn rims(&self) -> [&[f32]; 4] {
        let size = self.size();
        let rims = &self.values[size.pixels()..];
        let (left, rims) = rims.split_at(size.height);
        let (right, rims) = rims.split_at(size.height);
        let (top, bottom) = rims.split_at(size.width + 2);
        [left, right, top, bottom]
    }
}

/// Where the cells of some rows, and the ends of these rows, go.
struct Part<'a> {
    cells: &'a mut [f32],
    left: &'a mut [f32],
    right: &'a mut [f32],
}

/// The upper or the lower rim: sums over the pixels of each cell, and the pixels at both ends.
#[derive(Default)]
struct Rim {
    sums: Vec<f64>,
    ends: [f32; 2],
}

impl Rim {
    /// Adds the pixels of the outermost row from column `left` on, of a chart of `width` px.
    fn add(&mut self, pixels: &[f32], left: usize, side: usize, width: usize) {
        self.sums.resize(width.div_ceil(side), 0.0);
        if left == 0 {
            self.sums.fill(0.0);
            self.ends[0] = pixels[0];
        }
        for (column, pixel) in pixels.iter().enumerate() {
            self.sums[(left + column) / side] += f64::from(*pixel);
        }
        if left + pixels.len() == width {
            self.ends[1] = pixels[pixels.len() - 1];
        }
    }

    /// First pixel, means of the cells, last pixel.
    fn means(&self, side: usize, width: usize) -> Vec<f32> {
        let mean = |(j, sum): (usize, &f64)| (sum / side.min(width - j * side) as f64) as f32;
        let cells: Vec<f32> = self.sums.iter().enumerate().map(mean).collect();
        [&self.ends[..1], &cells, &self.ends[1..]].concat()
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
    /// Of the part that was read last.
    top: Rim,
    bottom: Rim,
}

impl<'a> CellRows<'a> {
    fn new(chart: &'a dyn ChartSource, band: usize, side: usize) -> Self {
        let (cells, columns) = (vec![0.0; chart.size().width.div_ceil(side)], vec![0.0; BLOCK_PX]);
        Self {
            chart,
            band,
            side,
            pixels: Vec::new(),
            columns,
            cells,
            top: Rim::default(),
            bottom: Rim::default(),
        }
    }

    /// Means of the rows of cells from `first` on into `part`: one row of cells, or as many as a block has.
    fn read(&mut self, first: usize, part: Part<'_>) -> Result<(), SourceSinkError> {
        match self.side >= BLOCK_PX {
            true => self.read_high_row(first, part),
            false => self.read_low_rows(first, part),
        }
    }

    /// Rows of cells that lie in one row of blocks, block by block.
    fn read_low_rows(&mut self, first: usize, part: Part<'_>) -> Result<(), SourceSinkError> {
        let (side, size, cells) = (self.side, self.chart.size(), self.cells.len());
        let top = first * side;
        let height = (part.cells.len() / cells * side).min(size.height - top);
        for left in (0..size.width).step_by(BLOCK_PX) {
            let width = BLOCK_PX.min(size.width - left);
            self.fetch(Rect::new(top as i64, left as i64, height, width))?;
            self.add_rims((top, left), (height, width));
            for (row, rows) in self.pixels[..height * width].chunks(side * width).enumerate() {
                let (columns, count) = (&mut self.columns[..width], (rows.len() / width) as f64);
                columns.fill(0.0);
                add_rows(columns, rows);
                let to = &mut part.cells[row * cells + left / side..];
                for (to, columns) in to.iter_mut().zip(columns.chunks(side)) {
                    let sum = columns.iter().fold(0.0, |sum, column| sum + column);
                    *to = (sum / (columns.len() as f64 * count)) as f32;
                }
                if left == 0 {
                    part.left[row] = (columns[0] / count) as f32;
                }
                if left + width == size.width {
                    part.right[row] = (columns[width - 1] / count) as f32;
                }
            }
        }
        Ok(())
    }

    /// A row of cells of one or more blocks: the columns of each cell are summed over all blocks below each other.
    fn read_high_row(&mut self, first: usize, part: Part<'_>) -> Result<(), SourceSinkError> {
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
                self.add_rims((top + row, left), (rows, width));
                add_rows(&mut self.columns[..width], &self.pixels[..rows * width]);
            }
            let cell = &mut self.cells[left / side];
            *cell = self.columns[..width].iter().fold(*cell, |sum, column| sum + column);
            if left == 0 {
                part.left[0] = (self.columns[0] / height as f64) as f32;
            }
            if left + width == size.width {
                part.right[0] = (self.columns[width - 1] / height as f64) as f32;
            }
        }
        for (j, (to, sum)) in part.cells.iter_mut().zip(&self.cells).enumerate() {
            let width = side.min(size.width - j * side);
            *to = (sum / (height as f64 * width as f64)) as f32;
        }
        Ok(())
    }

    /// Adds the first and the last row of the chart, where the block of `height` x `width` px at (`top`, `left`) has them.
    fn add_rims(&mut self, (top, left): (usize, usize), (height, width): (usize, usize)) {
        let size = self.chart.size();
        if top == 0 {
            self.top.add(&self.pixels[..width], left, self.side, size.width);
        }
        if top + height == size.height {
            self.bottom.add(&self.pixels[(height - 1) * width..][..width], left, self.side, size.width);
        }
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
        ReducedChart::read(&chart, 0, side, threads, &AtomicBool::new(false)).unwrap().values().to_vec()
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

    /// Outermost rows and columns, whatever the side of the cells.
    #[test]
    fn rims_are_means_of_the_outermost_pixels() {
        let size = Size::new(1100, 700);
        for side in [4, 64, 512, 1024] {
            let chart = Noise { size, fails_at: None };
            let reduced = ReducedChart::read(&chart, 0, side, 2, &AtomicBool::new(false)).unwrap();
            let [left, right, top, bottom] = reduced.rims();
            let mean = |range: std::ops::Range<usize>, at: &dyn Fn(i64) -> f32| {
                let count = range.len() as f64;
                (range.map(|i| f64::from(at(i as i64))).sum::<f64>() / count) as f32
            };
            for (i, (left, right)) in std::iter::zip(left, right).enumerate() {
                let rows = i * side..((i + 1) * side).min(size.height);
                assert!((left - mean(rows.clone(), &|y| value(y, 0))).abs() < 1e-6);
                assert!((right - mean(rows, &|y| value(y, 699))).abs() < 1e-6);
            }
            for (rim, y) in [(top, 0), (bottom, 1099)] {
                assert_eq!([rim[0], rim[rim.len() - 1]], [value(y, 0), value(y, 699)]);
                for (j, found) in rim[1..rim.len() - 1].iter().enumerate() {
                    let columns = j * side..((j + 1) * side).min(size.width);
                    assert!((found - mean(columns, &|x| value(y, x))).abs() < 1e-6, "{side}, {j}");
                }
            }
        }
    }
}
