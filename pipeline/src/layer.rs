//! A layer: smooth light that is added to the film of a band, as coefficients on a grid of bins.
//!
//! ```text
//! film(y, x) += Σ_j w_j(v) · Σ_i w_i(u) · c(k + i, l + j)      i, j = −1, 0, 1, 2
//! ```
//! Bin (k, l) covers the film pixels [k·b, (k+1)·b) × [l·b, (l+1)·b) ([`BinGrid`]); u = frac((y + ½)/b − ½) is the place of a pixel between
//! the centres of the bins k = ⌊(y + ½)/b − ½⌋ and k + 1, and v the same of columns. The weights w are those of a [`Taps`].
//!
//! A layer is added to a finished shard once, after all contributions of tiles and before the shard is encoded, whatever computed them. All
//! in f32: first the four rows of coefficients, then the four columns, taps in ascending order, multiplications and additions not fused. So the
//! bits depend neither on the shards and regions of the film nor on the engine.

mod grid;
mod taps;
mod transposed;

pub use grid::{BinGrid, MAX_BIN_PX};
pub use taps::Taps;
pub(crate) use transposed::coefficients_of_film;

use crate::buffer::ShardPixels;
use crate::geometry::Rect;
use crate::simd::lanes::{Lanes, SimdOp};
use crate::simd::{Simd, UnfusedOp};

/// A layer of a band.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    grid: BinGrid,
    /// Weights of each tap at the pixels of a bin.
    weights: [Vec<f32>; 4],
    /// Row-major, on the bins of the grid, margin included.
    coefficients: Vec<f32>,
}

/// Coefficients on each side of a bin that its pixels read.
const REACH: usize = 2;

impl Layer {
    /// The layer with `coefficients` on `grid`, row by row, interpolated with `taps`.
    ///
    /// ```
    /// use lenscube_pipeline::buffer::ShardPixels;
    /// use lenscube_pipeline::geometry::Size;
    /// use lenscube_pipeline::layer::{BinGrid, Layer, Taps};
    ///
    /// // A film of 100 x 64 px in bins of 16 px with the smallest margin: (7 + 4) x (4 + 4) bins.
    /// let film = Size::new(100, 64);
    /// let grid = BinGrid::new(film, 16, 2);
    /// let layer = Layer::new(grid, Taps::BSpline, vec![0.25; 11 * 8]);
    /// let mut pixels = ShardPixels::new(film);
    /// pixels.reach(100, || vec![1.0; 100 * 64]);
    /// layer.add(film.rect(), &mut pixels);
    /// assert!((pixels.row(99)[63] - 1.25).abs() < 1e-6);
    /// ```
    ///
    /// # Panics
    /// Another number of coefficients, bins beyond [`MAX_BIN_PX`], or a margin of fewer than 2 bins.
    pub fn new(grid: BinGrid, taps: Taps, coefficients: Vec<f32>) -> Self {
        assert!(BinGrid::is_bin(grid.bin_px), "bins of {} px", grid.bin_px);
        assert_eq!(coefficients.len(), grid.size().pixels(), "one coefficient per bin");
        assert!(grid.margin >= REACH, "the pixels of the outermost bins read {REACH} bins beyond");
        Self { grid, weights: taps.of_bin(grid.bin_px), coefficients }
    }

    /// Its bins.
    pub fn grid(&self) -> &BinGrid {
        &self.grid
    }

    /// Its coefficients, row by row.
    pub fn coefficients(&self) -> &[f32] {
        &self.coefficients
    }

    /// Bytes of a layer on `grid`.
    pub fn bytes(grid: &BinGrid) -> usize {
        4 * grid.size().pixels()
    }

    /// Adds the layer to `pixels`, of the film rectangle `rect`.
    pub fn add(&self, rect: Rect, pixels: &mut ShardPixels) {
        match self.grid.bin_px {
            2 => self.add_bins::<2, 2>(rect, pixels),
            4 => self.add_bins::<4, 4>(rect, pixels),
            8 => self.add_bins::<8, 8>(rect, pixels),
            16 => self.add_bins::<16, 8>(rect, pixels),
            32 => self.add_bins::<32, 16>(rect, pixels),
            64 => self.add_bins::<64, 32>(rect, pixels),
            other => unreachable!("bins of {other} px"),
        }
    }

    /// [`Layer::add`] with bins of `B` pixels, computed `P` at a time: a bin or half of it.
    fn add_bins<const B: usize, const P: usize>(&self, rect: Rect, pixels: &mut ShardPixels) {
        let (bin, width) = (B as i64, self.grid.size().width);
        let first_bin = rect.x.div_euclid(bin);
        let bins = ((rect.right() - 1).div_euclid(bin) - first_bin + 1) as usize;
        let (mut line, mut values) = (vec![0f32; bins + 2 * REACH], vec![0f32; bins * B]);
        // Index, in a row of coefficients, of the first that the first bin reads.
        let first = self.grid.index(first_bin) - REACH;
        let offset = (rect.x - first_bin * bin) as usize;
        let across: [&[f32; B]; 4] =
            std::array::from_fn(|tap| self.weights[tap][..].try_into().expect("a weight of each pixel"));
        let simd = Simd::detect();
        for y in rect.y..rect.bottom() {
            let in_bin = y.rem_euclid(bin) as usize;
            let top = self.grid.index(y.div_euclid(bin)) - REACH + usize::from(in_bin >= B / 2);
            let rows =
                std::array::from_fn(|tap| &self.coefficients[(top + tap) * width + first..][..line.len()]);
            let down = std::array::from_fn(|tap| self.weights[tap][in_bin]);
            let (line, values) = (&mut line[..], &mut values[..]);
            let pixels = pixels.row_mut((y - rect.y) as usize);
            AddRow::<B, P> { rows, down, across, line, values, offset, pixels }.run_unfused(simd);
        }
    }
}

/// A row of pixels of a layer with bins of `B` pixels. Plain code, compiled for the instructions of an engine: none fuses its products.
struct AddRow<'a, const B: usize, const P: usize> {
    /// The coefficients of the taps, and their weights.
    rows: [&'a [f32]; 4],
    down: [f32; 4],
    /// Weights of the taps along the row at the pixels of a bin.
    across: [&'a [f32; B]; 4],
    /// Scratch: the coefficients along the row, and its values from the first pixel of the first bin on.
    line: &'a mut [f32],
    values: &'a mut [f32],
    /// Pixels of the first bin before the first of `pixels`.
    offset: usize,
    pixels: &'a mut [f32],
}

impl<V: Lanes, const B: usize, const P: usize> SimdOp<V> for AddRow<'_, B, P> {
    #[inline(always)]
    fn run(self) {
        let Self { rows, down: w, across, line, values, .. } = self;
        let coefficients = rows[0].iter().zip(rows[1]).zip(rows[2]).zip(rows[3]);
        for (value, (((a, b), c), d)) in line.iter_mut().zip(coefficients) {
            *value = w[0] * a + w[1] * b + w[2] * c + w[3] * d;
        }
        let (bins, _) = values.as_chunks_mut::<B>();
        for (bin, coefficients) in bins.iter_mut().zip(line.windows(5)) {
            for (part, to) in bin.as_chunks_mut::<P>().0.iter_mut().enumerate() {
                // The pixels of each half of a bin have the same four coefficients, those of the second from one further on.
                let c: [[f32; P]; 4] = std::array::from_fn(|tap| {
                    std::array::from_fn(|i| coefficients[tap + if P < B { part } else { i / (B / 2) }])
                });
                let w: [&[f32; P]; 4] = std::array::from_fn(|tap| &across[tap].as_chunks::<P>().0[part]);
                for i in 0..P {
                    to[i] = w[0][i] * c[0][i] + w[1][i] * c[1][i] + w[2][i] * c[2][i] + w[3][i] * c[3][i];
                }
            }
        }
        self.pixels.iter_mut().zip(&values[self.offset..]).for_each(|(pixel, value)| *pixel += value);
    }
}

#[cfg(test)]
mod tests;
