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

use super::lanes::{AddRows, Interpolate, Places};
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Rect, Size};
use crate::layer::Taps;
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

/// The chart pixels of a cell along an axis: the first, and the weight of each from there on.
#[derive(Clone, Debug, Default)]
pub(super) struct CellWeights {
    pub(super) first: usize,
    pub(super) weights: Vec<f32>,
}

impl CellWeights {
    /// One past the last pixel.
    fn end(&self) -> usize {
        self.first + self.weights.len()
    }

    /// The weights of the pixels from `from` to `to` that it has, and the first of these pixels.
    fn within(&self, from: usize, to: usize) -> (usize, &[f32]) {
        let (from, to) = (from.max(self.first), to.min(self.end()));
        if from >= to {
            return (from, &[]);
        }
        (from, &self.weights[from - self.first..to - self.first])
    }
}

/// The cells of `all` that have pixels from `from` to `to`.
fn with_pixels(all: &[CellWeights], from: usize, to: usize) -> Range<usize> {
    let has = |cell: &CellWeights| !cell.within(from, to).1.is_empty();
    let last = all.iter().rposition(has).expect("a pixel has cells");
    all.iter().position(has).expect("as the last")..last + 1
}

/// Cells along one axis of the chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CellAxis {
    /// Chart pixels.
    pub(super) pixels: usize,
    /// Side of a cell, chart pixels.
    side: usize,
}

impl CellAxis {
    /// Cells, margin included.
    pub(super) fn cells(&self) -> usize {
        self.pixels.div_ceil(self.side) + 2 * MARGIN
    }

    /// The chart pixels of each cell. Pixels that surroundings repeat have the weights of their copies too.
    pub(super) fn weights(&self, surround: Surround) -> Vec<CellWeights> {
        let reach = match surround {
            Surround::Black => 0,
            Surround::Edge | Surround::Mirror => (REACH * self.side) as i64,
        };
        let (n, side) = (self.pixels, self.side as f64);
        // Pixels of each cell in the order of their places, several times if surroundings repeat them.
        let mut all: Vec<Vec<(usize, f64)>> = vec![Vec::new(); self.cells()];
        for place in -reach..n as i64 + reach {
            let Some(pixel) = surround.index(place, n) else { continue };
            let u = (place as f64 + 0.5) / side - 0.5;
            let cell = u.floor();
            for (tap, w) in Taps::Lagrange.weights(u - cell).into_iter().enumerate() {
                let to = cell as i64 - 1 + tap as i64 + MARGIN as i64;
                let to = usize::try_from(to).ok().and_then(|to| all.get_mut(to));
                if let (Some(pixels), true) = (to, w != 0.0) {
                    pixels.push((pixel, w / side));
                }
            }
        }
        let gathered = |pixels: Vec<(usize, f64)>| {
            let of = || pixels.iter().map(|(pixel, _)| *pixel);
            let (Some(first), Some(last)) = (of().min(), of().max()) else { return CellWeights::default() };
            let mut sums = vec![0.0; last + 1 - first];
            pixels.iter().for_each(|(pixel, w)| sums[pixel - first] += w);
            CellWeights { first, weights: sums.into_iter().map(|w| w as f32).collect() }
        };
        all.into_iter().map(gathered).collect()
    }

    /// First of the four cells around the chart coordinate `at`, margin included, and the fraction of a cell beyond: as [`CellAxis::around`] without folding.
    #[inline(always)]
    fn first_and_fraction(&self, at: f64) -> (i32, f32) {
        /// From the first place and from the last, cells, so that it has four cells.
        const INSIDE: f64 = 1e-9;
        let u = (at + 0.5) / self.side as f64 - 0.5;
        let u = u.clamp(1.0 - MARGIN as f64 + INSIDE, self.last() - INSIDE);
        let (next, fraction) = parts(u + MARGIN as f64);
        (next.wrapping_sub(1), fraction)
    }

    /// Whether the four cells around the chart coordinate `at` are there without folding.
    fn has(&self, at: f64, surround: Surround) -> bool {
        match surround {
            Surround::Mirror => (-0.5..=self.pixels as f64 - 0.5).contains(&at),
            Surround::Black | Surround::Edge => !at.is_nan(),
        }
    }

    /// The last place between cells that is read, cells: beyond it is what is there.
    fn last(&self) -> f64 {
        (self.cells() - 2 * MARGIN) as f64 + (MARGIN - 2) as f64
    }

    /// First of the four cells around the chart coordinate `at`, margin included, and their weights.
    #[inline]
    pub(super) fn around(&self, at: f64, surround: Surround) -> (usize, [f64; 4]) {
        let n = self.pixels as f64;
        let at = match surround {
            Surround::Mirror if !(-0.5..=n - 0.5).contains(&at) => {
                let m = (at + 0.5).rem_euclid(2.0 * n);
                m.min(2.0 * n - m) - 0.5
            }
            _ => at,
        };
        let last = self.last();
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
        let weights = 96 * (chart.height + chart.width);
        (4 * rows.cells() * columns.cells(), weights + of_thread * threads)
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
        let (rows, columns) = axes(chart.size(), side);
        let width = columns.cells();
        let (of_rows, of_columns) = (rows.weights(surround), columns.weights(surround));
        let values = Mutex::new(crate::buffer::zeros(rows.cells() * width));
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
        let values = values.into_inner().expect("no panic while held");
        Ok(Self { rows, columns, surround, values })
    }

    /// The light at chart coordinates (row, column), times a gain (third element), of places 0, 1, … of `out`: polynomials of the place, of which `curve`
    /// has the coefficients. In f32 where no surroundings need folding.
    pub(super) fn along(&self, curve: [[f64; 3]; 3], simd: Simd, out: &mut [f32; MAX_LANES]) {
        let coordinates = |i: usize| -> [f64; 3] {
            let i = i as f64;
            std::array::from_fn(|k| curve[0][k] + i * (curve[1][k] + i * curve[2][k]))
        };
        let width = self.columns.cells();
        let mut places = Places::default();
        let mut has_all = true;
        for lane in 0..MAX_LANES {
            let [row, column, gain] = coordinates(lane);
            has_all &= self.rows.has(row, self.surround) & self.columns.has(column, self.surround);
            let (top, down) = self.rows.first_and_fraction(row);
            let (left, across) = self.columns.first_and_fraction(column);
            places.first[lane] = top.wrapping_mul(width as i32).wrapping_add(left);
            (places.down[lane], places.across[lane]) = (down, across);
            places.gain[lane] = gain as f32;
        }
        if has_all {
            Interpolate { cells: &self.values, width, places: &places, out }.run_unfused(simd);
            return;
        }
        for (i, to) in out.iter_mut().enumerate() {
            let [row, column, gain] = coordinates(i);
            *to = (gain * self.at(row, column)) as f32;
        }
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

/// Integer part and fraction, 0 to 1, of `v`, above 1 and below 2³¹: a sum with 2⁵² is an integer. (A conversion is not vectorised.)
#[inline(always)]
fn parts(v: f64) -> (i32, f32) {
    const TO_INTEGER: f64 = (1u64 << 52) as f64;
    let integer = (v - 0.5) + TO_INTEGER;
    (integer.to_bits() as i32, (v - (integer - TO_INTEGER)) as f32)
}

pub(super) fn axes(chart: Size, side: (usize, usize)) -> (CellAxis, CellAxis) {
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
            for (to, sums) in self.cells.chunks_exact_mut(of_columns.len()).zip(self.down.chunks_exact(width))
            {
                for (to, (pixel, weights)) in to[first..].iter_mut().zip(&parts) {
                    *to += dot(&sums[pixel - left..][..weights.len()], weights);
                }
            }
        }
        Ok(())
    }
}

/// Σ a b: four sums side by side, then these.
#[inline]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    let mut sum = [0.0; 4];
    for (a, b) in a.iter().zip(b) {
        for (sum, (a, b)) in sum.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    (sum[0] + sum[2]) + (sum[1] + sum[3]) + rest
}

#[cfg(test)]
mod tests;
