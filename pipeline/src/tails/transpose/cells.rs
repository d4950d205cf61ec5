//! The transpose of a chart on cells: light on cells, from places between them, and from there on the chart's pixels.

use super::super::axis::{CellGrid, CellWeights};
use crate::geometry::Size;
use crate::parts::for_each_part;
use crate::resample::Surround;
use std::convert::Infallible;

/// Light on the cells of a chart, summed in f64: beyond an edge many places read the same cells.
pub(super) struct CellSums {
    grid: CellGrid,
    /// Row-major, margin included.
    values: Vec<f64>,
}

/// Cells and weights of one chart pixel along an axis.
type PixelCells = Vec<(usize, f64)>;

impl CellSums {
    /// No light on the cells of `side` (rows, columns) px of a chart of `chart` px.
    pub(super) fn new(chart: Size, side: (usize, usize), surround: Surround) -> Self {
        let grid = CellGrid::new(chart, side, surround);
        Self { grid, values: vec![0.0; grid.count()] }
    }

    /// The transpose of [`ChartCells::at`](crate::tails::cells::ChartCells::at): adds `value` at chart coordinates (row, column).
    pub(super) fn add_at(&mut self, row: f64, column: f64, value: f64) {
        let ((top, down), (left, across)) = self.grid.around(row, column);
        let width = self.grid.columns.cells();
        for (i, down) in down.into_iter().enumerate() {
            let to = &mut self.values[(top + i) * width + left..][..4];
            to.iter_mut().zip(across).for_each(|(to, across)| *to += down * across * value);
        }
    }

    /// The transpose of [`ChartCells::read`](crate::tails::cells::ChartCells::read): adds the light to the pixels of `chart`, the same for any number of `threads`.
    pub(super) fn add_to_chart(&self, chart: &mut [f32], threads: usize) {
        let CellGrid { rows, columns, .. } = self.grid;
        let (of_rows, of_columns) = self.grid.weights();
        let of_rows = pixel_cells(rows.pixels, &of_rows);
        let of_columns = pixel_cells(columns.pixels, &of_columns);
        let width = columns.cells();
        let done: Result<(), Infallible> = for_each_part(
            threads,
            chart.chunks_mut(columns.pixels).zip(&of_rows),
            || vec![0.0; width],
            |line, (pixels, cells)| {
                line.fill(0.0);
                for (cell, w) in cells {
                    let from = &self.values[cell * width..][..width];
                    line.iter_mut().zip(from).for_each(|(to, v)| *to += w * v);
                }
                for (to, cells) in pixels.iter_mut().zip(&of_columns) {
                    let sum: f64 = cells.iter().map(|(cell, w)| w * line[*cell]).sum();
                    *to += sum as f32;
                }
                Ok(())
            },
        );
        let Ok(()) = done;
    }
}

/// The cells of each of `pixels` chart pixels along an axis, by the weights that they are read with.
fn pixel_cells(pixels: usize, cells: &[CellWeights]) -> Vec<PixelCells> {
    let mut all = vec![PixelCells::new(); pixels];
    for (cell, CellWeights { first, weights }) in cells.iter().enumerate() {
        for (pixel, w) in (*first..).zip(weights).filter(|(_, w)| **w != 0.0) {
            all[pixel].push((cell, f64::from(*w)));
        }
    }
    all
}
