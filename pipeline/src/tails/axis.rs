//! Cells along the axes of a chart: the pixels of each, and places between them.

use super::curve::{Curve, place_on};
use crate::geometry::Size;
use crate::layer::Taps;
use crate::resample::Surround;
use crate::simd::lanes::MAX_LANES;
use std::ops::Range;

/// Cells around those of the chart. Black surroundings have no light in the outermost; other ones are even along the last.
pub(super) const MARGIN: usize = 4;
/// Surroundings that the cells of the margin read, cells.
pub(super) const REACH: usize = MARGIN + 2;

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
    pub(super) fn within(&self, from: usize, to: usize) -> (usize, &[f32]) {
        let (from, to) = (from.max(self.first), to.min(self.end()));
        if from >= to {
            return (from, &[]);
        }
        (from, &self.weights[from - self.first..to - self.first])
    }
}

/// The cells of `all` that have pixels from `from` to `to`.
pub(super) fn with_pixels(all: &[CellWeights], from: usize, to: usize) -> Range<usize> {
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
    #[inline(always)]
    pub(super) fn cells(&self) -> usize {
        self.pixels.div_ceil(self.side) + 2 * MARGIN
    }

    /// The chart pixels of each cell. Pixels that surroundings repeat have the weights of their copies too.
    fn weights(&self, surround: Surround) -> Vec<CellWeights> {
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
    #[inline(always)]
    fn has(&self, at: f64, surround: Surround) -> bool {
        match surround {
            Surround::Mirror => (-0.5..=self.pixels as f64 - 0.5).contains(&at),
            Surround::Black | Surround::Edge => !at.is_nan(),
        }
    }

    /// The last place between cells that is read, cells: beyond it is what is there.
    #[inline(always)]
    fn last(&self) -> f64 {
        (self.cells() - 2 * MARGIN) as f64 + (MARGIN - 2) as f64
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
        let last = self.last();
        let u = ((at + 0.5) / self.side as f64 - 0.5).clamp(1.0 - MARGIN as f64, last);
        let cell = u.floor().min(last - 1.0);
        ((cell + (MARGIN - 1) as f64) as usize, Taps::Lagrange.weights(u - cell))
    }
}

/// Cells of a chart with its surroundings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CellGrid {
    pub(super) rows: CellAxis,
    pub(super) columns: CellAxis,
    pub(super) surround: Surround,
}

/// Places between cells: as many as the longest register has lanes.
#[derive(Debug, Default)]
pub(super) struct Places {
    /// Index of the first of the 4 x 4 cells.
    pub(super) first: [i32; MAX_LANES],
    /// Fractions of a cell, down and across.
    pub(super) down: [f32; MAX_LANES],
    pub(super) across: [f32; MAX_LANES],
    pub(super) gain: [f32; MAX_LANES],
}

impl CellGrid {
    /// Cells of `side` (rows, columns) px of a chart of `chart` px.
    pub(super) fn new(chart: Size, side: (usize, usize), surround: Surround) -> Self {
        let axis = |pixels, side| CellAxis { pixels, side };
        Self { rows: axis(chart.height, side.0), columns: axis(chart.width, side.1), surround }
    }

    /// Cells, margins included.
    pub(super) fn count(&self) -> usize {
        self.rows.cells() * self.columns.cells()
    }

    /// The chart pixels of each row and of each column of cells.
    pub(super) fn weights(&self) -> (Vec<CellWeights>, Vec<CellWeights>) {
        (self.rows.weights(self.surround), self.columns.weights(self.surround))
    }

    /// First of the four cells around the chart coordinates, and their weights, down and across.
    #[inline]
    pub(super) fn around(&self, row: f64, column: f64) -> ((usize, [f64; 4]), (usize, [f64; 4])) {
        (self.rows.around(row, self.surround), self.columns.around(column, self.surround))
    }

    /// The places 0, 1, … of `curve` between cells, and whether all have their four cells without folding.
    #[inline(always)]
    pub(super) fn places(&self, curve: &Curve) -> (Places, bool) {
        let width = self.columns.cells();
        let mut places = Places::default();
        let mut has_all = true;
        for lane in 0..MAX_LANES {
            let [row, column, gain] = place_on(curve, lane);
            has_all &= self.rows.has(row, self.surround) & self.columns.has(column, self.surround);
            let (top, down) = self.rows.first_and_fraction(row);
            let (left, across) = self.columns.first_and_fraction(column);
            places.first[lane] = top.wrapping_mul(width as i32).wrapping_add(left);
            (places.down[lane], places.across[lane]) = (down, across);
            places.gain[lane] = gain as f32;
        }
        (places, has_all)
    }
}

/// Integer part and fraction, 0 to 1, of `v`, above 1 and below 2³¹: a sum with 2⁵² is an integer. (A conversion is not vectorised.)
#[inline(always)]
fn parts(v: f64) -> (i32, f32) {
    const TO_INTEGER: f64 = (1u64 << 52) as f64;
    let integer = (v - 0.5) + TO_INTEGER;
    (integer.to_bits() as i32, (v - (integer - TO_INTEGER)) as f32)
}
