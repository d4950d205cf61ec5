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
            2 => self.add_halves::<1>(rect, pixels),
            4 => self.add_halves::<2>(rect, pixels),
            8 => self.add_halves::<4>(rect, pixels),
            16 => self.add_halves::<8>(rect, pixels),
            32 => self.add_halves::<16>(rect, pixels),
            64 => self.add_halves::<32>(rect, pixels),
            other => unreachable!("bins of {other} px"),
        }
    }

    /// [`Layer::add`] with bins of 2 `H` pixels: the pixels of each half of a bin have the same four coefficients.
    fn add_halves<const H: usize>(&self, rect: Rect, pixels: &mut ShardPixels) {
        let (bin, width) = (2 * H, self.grid.size().width);
        let first_bin = rect.x.div_euclid(bin as i64);
        let bins = ((rect.right() - 1).div_euclid(bin as i64) - first_bin + 1) as usize;
        let (mut line, mut values) = (vec![0f32; bins + 2 * REACH], vec![0f32; bins * bin]);
        // Index, in a row of coefficients, of the first that the first bin reads.
        let first = self.grid.index(first_bin) - REACH;
        let offset = (rect.x - first_bin * bin as i64) as usize;
        for y in rect.y..rect.bottom() {
            let in_bin = y.rem_euclid(bin as i64) as usize;
            let top = self.grid.index(y.div_euclid(bin as i64)) - REACH + usize::from(in_bin >= H);
            let rows: [&[f32]; 4] =
                std::array::from_fn(|tap| &self.coefficients[(top + tap) * width + first..][..line.len()]);
            let w: [f32; 4] = std::array::from_fn(|tap| self.weights[tap][in_bin]);
            for (i, value) in line.iter_mut().enumerate() {
                *value = w[0] * rows[0][i] + w[1] * rows[1][i] + w[2] * rows[2][i] + w[3] * rows[3][i];
            }
            self.fill_row::<H>(&line, &mut values);
            let row = pixels.row_mut((y - rect.y) as usize);
            row.iter_mut().zip(&values[offset..]).for_each(|(pixel, value)| *pixel += value);
        }
    }

    /// The pixels of the bins of a row, from the coefficients `line` along it.
    fn fill_row<const H: usize>(&self, line: &[f32], values: &mut [f32]) {
        let halves: [[&[f32; H]; 4]; 2] = std::array::from_fn(|half| {
            std::array::from_fn(|tap| {
                self.weights[tap][half * H..][..H].try_into().expect("weights of half a bin")
            })
        });
        for (k, bin) in values.chunks_exact_mut(2 * H).enumerate() {
            for (half, to) in bin.chunks_exact_mut(H).enumerate() {
                let (c, w) = (&line[k + half..][..4], halves[half]);
                let to: &mut [f32; H] = to.try_into().expect("half a bin");
                for i in 0..H {
                    to[i] = w[0][i] * c[0] + w[1][i] * c[1] + w[2][i] * c[2] + w[3][i] * c[3];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
