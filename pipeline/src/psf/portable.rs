//! SVPSF of one block with realfft and rustfft: the portable engine, and the readable form of the SIMD engines.
//!
//! For each node that touches the block: weighted copy → rows (real FFT of length F) → columns (complex FFT of length F) → multiply
//! by the node's spectrum, accumulate. Then one inverse transform, added to the output (overlap-add). Spectra are stored
//! transposed, column by column: (F/2 + 1) × F complex, scaled by 1/F².

use crate::buffer::AlignedBuf;
use crate::psf::block_view::{BlockView, Spectra};
use crate::psf::blocks::Blocks;
use crate::psf::grid::{Node, NodeGrid, NodeWeight};
use crate::psf::polar::BlockPlace;
use num_complex::Complex32;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::{Fft, FftPlanner};
use std::sync::Arc;

/// Weighted pixels below this are set to 0: denormals made the transforms 18 % slower; the value is far below the rounding of any
/// film.
pub(crate) const NEGLIGIBLE_PIXEL: f32 = 1e-30;

/// Transforms of one FFT size.
pub struct Portable {
    fft: usize,
    half: usize,
    window: usize,
    forward: Arc<dyn RealToComplex<f32>>,
    inverse: Arc<dyn ComplexToReal<f32>>,
    columns: Arc<dyn Fft<f32>>,
    columns_inverse: Arc<dyn Fft<f32>>,
}

impl std::fmt::Debug for Portable {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Portable(F = {}, n = {})", self.fft, self.window)
    }
}

/// Buffers of one worker.
#[derive(Debug)]
pub struct Scratch {
    r: Vec<f32>,
    theta: Vec<f32>,
    row: Vec<f32>,
    rows: Vec<Complex32>,
    transposed: Vec<Complex32>,
    sum: Vec<Complex32>,
    fft: Vec<Complex32>,
    nodes: Vec<(Node, NodeWeight)>,
}

impl Portable {
    /// Plans the transforms of `blocks`.
    pub fn new(blocks: &Blocks) -> Self {
        let f = blocks.fft;
        let (mut real, mut complex) = (RealFftPlanner::new(), FftPlanner::new());
        Self {
            fft: f,
            half: f / 2 + 1,
            window: blocks.window,
            forward: real.plan_fft_forward(f),
            inverse: real.plan_fft_inverse(f),
            columns: complex.plan_fft_forward(f),
            columns_inverse: complex.plan_fft_inverse(f),
        }
    }

    /// Length of one spectrum in f32.
    pub fn spectrum_len(&self) -> usize {
        self.fft * self.half * 2
    }

    /// Buffers for one worker.
    pub fn scratch(&self) -> Scratch {
        let block = self.fft - self.window + 1;
        let zero = Complex32::default();
        let fft = self
            .columns
            .get_inplace_scratch_len()
            .max(self.columns_inverse.get_inplace_scratch_len())
            .max(self.forward.get_scratch_len())
            .max(self.inverse.get_scratch_len());
        Scratch {
            r: vec![0.0; block * block],
            theta: vec![0.0; block * block],
            row: vec![0.0; self.fft],
            rows: vec![zero; self.fft * self.half],
            transposed: vec![zero; self.fft * self.half],
            sum: vec![zero; self.fft * self.half],
            fft: vec![zero; fft],
            nodes: Vec::new(),
        }
    }

    /// Spectrum of a kernel (window × window) whose first sample is at the origin, in the memory of `buffer`.
    pub fn spectrum(&self, kernel: &[f32], s: &mut Scratch, buffer: AlignedBuf) -> AlignedBuf {
        let norm = 1.0 / (self.fft * self.fft) as f32;
        for y in 0..self.window {
            for (to, from) in s.row.iter_mut().zip(&kernel[y * self.window..][..self.window]) {
                *to = from * norm;
            }
            s.row[self.window..].fill(0.0);
            self.row_forward(y, s);
        }
        self.columns_forward(self.window, s);
        let mut out = buffer;
        out.resize(self.spectrum_len());
        out.copy_from_slice(bytemuck::cast_slice(&s.transposed));
        out
    }

    /// Adds the contribution of one block of the remapped image to `out`, `rows + window − 1` × `cols + window − 1` values. The first
    /// value of `out` is the film pixel (window − 1)/2 above and left of the block's first pixel.
    pub fn scatter(
        &self,
        block: &BlockView<'_>,
        grid: &NodeGrid,
        spectra: &dyn Spectra,
        out: &mut [f32],
        out_stride: usize,
        s: &mut Scratch,
    ) {
        let (rows, cols) = (block.place.rows, block.place.cols);
        let extent = grid.coordinates(&block.place, cols, &mut s.r, &mut s.theta);
        let mut nodes = std::mem::take(&mut s.nodes);
        grid.touching(&extent, &mut nodes);
        s.sum.fill(Complex32::default());
        for (node, weight) in &nodes {
            let mut block_nonzero = false;
            for y in 0..rows {
                let mut row_nonzero = false;
                let pixels = &block.pixels[y * block.stride..][..cols];
                let polar = s.r[y * cols..][..cols].iter().zip(&s.theta[y * cols..][..cols]);
                for ((to, pixel), (r, theta)) in s.row.iter_mut().zip(pixels).zip(polar) {
                    let value = weight.at(*r, *theta, extent.wraps) * pixel;
                    *to = if value.abs() < NEGLIGIBLE_PIXEL { 0.0 } else { value };
                    row_nonzero |= *to != 0.0;
                }
                if !row_nonzero {
                    s.rows[y * self.half..][..self.half].fill(Complex32::default());
                    continue;
                }
                block_nonzero = true;
                s.row[cols..].fill(0.0);
                self.row_forward(y, s);
            }
            if !block_nonzero {
                continue;
            }
            self.columns_forward(rows, s);
            let spectrum = spectra.get(*node);
            let spectrum: &[Complex32] = bytemuck::cast_slice(&spectrum);
            for ((sum, a), b) in s.sum.iter_mut().zip(&s.transposed).zip(spectrum) {
                *sum += a * b;
            }
        }
        s.nodes = nodes;
        let cols = cols + self.window - 1;
        self.inverse(rows + self.window - 1, s, |y, line| {
            out[y * out_stride..][..cols].iter_mut().zip(line).for_each(|(to, from)| *to += from);
        });
    }

    /// The transpose of [`Portable::scatter`]: adds to `out`, rows `out_stride` apart, at each pixel of the block at `place` the film under the kernels of the pixel.
    /// `film` has the `rows + window − 1` × `cols + window − 1` film pixels that the block contributes to, rows `film_stride` apart.
    pub fn gather(
        &self,
        (film, film_stride): (&[f32], usize),
        place: &BlockPlace,
        grid: &NodeGrid,
        spectra: &dyn Spectra,
        (out, out_stride): (&mut [f32], usize),
        s: &mut Scratch,
    ) {
        let (rows, cols, tail) = (place.rows, place.cols, self.window - 1);
        let extent = grid.coordinates(place, cols, &mut s.r, &mut s.theta);
        for y in 0..rows + tail {
            s.row[..cols + tail].copy_from_slice(&film[y * film_stride..][..cols + tail]);
            s.row[cols + tail..].fill(0.0);
            self.row_forward(y, s);
        }
        self.columns_forward(rows + tail, s);
        let mut nodes = std::mem::take(&mut s.nodes);
        grid.touching(&extent, &mut nodes);
        let (r, theta) = (std::mem::take(&mut s.r), std::mem::take(&mut s.theta));
        for (node, weight) in &nodes {
            let at = |i: usize| weight.at(r[i], theta[i], extent.wraps);
            if (0..rows * cols).all(|i| at(i) == 0.0) {
                continue;
            }
            let spectrum = spectra.get(*node);
            let spectrum: &[Complex32] = bytemuck::cast_slice(&spectrum);
            for ((to, a), b) in s.sum.iter_mut().zip(&s.transposed).zip(spectrum) {
                *to = a * b.conj();
            }
            self.inverse(rows, s, |y, line| {
                for (x, (to, v)) in out[y * out_stride..][..cols].iter_mut().zip(line).enumerate() {
                    *to += at(y * cols + x) * v;
                }
            });
        }
        (s.nodes, s.r, s.theta) = (nodes, r, theta);
    }

    fn row_forward(&self, y: usize, s: &mut Scratch) {
        let row = &mut s.rows[y * self.half..][..self.half];
        self.forward.process_with_scratch(&mut s.row, row, &mut s.fft).expect("planned lengths");
    }

    /// Transposes `rows` transformed rows and transforms along columns, into `s.transposed`.
    fn columns_forward(&self, rows: usize, s: &mut Scratch) {
        s.rows[rows * self.half..].fill(Complex32::default());
        transpose(&s.rows, &mut s.transposed, self.fft, self.half);
        self.columns.process_with_scratch(&mut s.transposed, &mut s.fft);
    }

    /// Inverse transform of `s.sum`, passed to `each` row by row.
    fn inverse(&self, rows: usize, s: &mut Scratch, mut each: impl FnMut(usize, &[f32])) {
        self.columns_inverse.process_with_scratch(&mut s.sum, &mut s.fft);
        transpose(&s.sum, &mut s.rows, self.half, self.fft);
        for (y, line) in s.rows.chunks_exact_mut(self.half).take(rows).enumerate() {
            line[0].im = 0.0;
            line[self.half - 1].im = 0.0;
            self.inverse.process_with_scratch(line, &mut s.row, &mut s.fft).expect("planned lengths");
            each(y, &s.row);
        }
    }
}

/// Transposes `from` (rows × cols) into `to` (cols × rows), in 16 × 16 tiles that stay in L1.
fn transpose(from: &[Complex32], to: &mut [Complex32], rows: usize, cols: usize) {
    const SIDE: usize = 16;
    for y0 in (0..rows).step_by(SIDE) {
        for x0 in (0..cols).step_by(SIDE) {
            for y in y0..(y0 + SIDE).min(rows) {
                for x in x0..(x0 + SIDE).min(cols) {
                    to[x * rows + y] = from[y * cols + x];
                }
            }
        }
    }
}
