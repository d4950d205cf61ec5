//! SVPSF of one block with realfft and rustfft: the portable engine, and the readable form of the SIMD ones.
//!
//! For each node that touches the block: weighted copy → rows (real FFT of F) → columns (complex FFT of F) → multiply by
//! the node's spectrum, accumulate. Then ONE inverse transform, added to the output (overlap-add). Spectra lie
//! transposed, column by column: (F/2 + 1) × F complex, scaled by 1/F².

use crate::buffer::AlignedBuf;
use crate::psf::blocks::Blocks;
use crate::psf::grid::{Node, NodeGrid, Tent};
use crate::psf::{BlockView, Spectra};
use num_complex::Complex32;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::{Fft, FftPlanner};
use std::sync::Arc;

/// Products below this are zeroed when packed: they would drag denormals through the transforms, 18 % slower and far
/// under any film's rounding.
pub(crate) const TINY: f32 = 1e-30;

/// Transforms of one FFT side.
pub struct Portable {
    fft: usize,
    half: usize,
    window: usize,
    forward: Arc<dyn RealToComplex<f32>>,
    inverse: Arc<dyn ComplexToReal<f32>>,
    columns: Arc<dyn Fft<f32>>,
    columns_back: Arc<dyn Fft<f32>>,
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
    turned: Vec<Complex32>,
    sum: Vec<Complex32>,
    fft: Vec<Complex32>,
    nodes: Vec<(Node, Tent)>,
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
            columns_back: complex.plan_fft_inverse(f),
        }
    }

    /// f32s of one spectrum.
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
            .max(self.columns_back.get_inplace_scratch_len())
            .max(self.forward.get_scratch_len())
            .max(self.inverse.get_scratch_len());
        Scratch {
            r: vec![0.0; block * block],
            theta: vec![0.0; block * block],
            row: vec![0.0; self.fft],
            rows: vec![zero; self.fft * self.half],
            turned: vec![zero; self.fft * self.half],
            sum: vec![zero; self.fft * self.half],
            fft: vec![zero; fft],
            nodes: Vec::new(),
        }
    }

    /// Spectrum of a kernel (window × window), its first sample at the origin.
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
        out.reset(self.spectrum_len());
        out.copy_from_slice(bytemuck::cast_slice(&s.turned));
        out
    }

    /// Scatters one block of the remapped image into `out`, whose first value is the film pixel (window − 1)/2 above and left of the
    /// block's first; adds `rows + window − 1` × `cols + window − 1` values.
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
        let reach = block.place.polar(cols, &mut s.r, &mut s.theta);
        let mut nodes = std::mem::take(&mut s.nodes);
        grid.touching(&reach, &mut nodes);
        s.sum.fill(Complex32::default());
        for (node, tent) in &nodes {
            let mut touched = false;
            for y in 0..rows {
                let mut lit = false;
                let pixels = &block.pixels[y * block.stride..][..cols];
                let polar = s.r[y * cols..][..cols].iter().zip(&s.theta[y * cols..][..cols]);
                for ((to, pixel), (r, theta)) in s.row.iter_mut().zip(pixels).zip(polar) {
                    let share = tent.share(*r, *theta, reach.around);
                    let value = share * pixel;
                    *to = if value.abs() < TINY { 0.0 } else { value };
                    lit |= *to != 0.0;
                }
                if !lit {
                    s.rows[y * self.half..][..self.half].fill(Complex32::default());
                    continue;
                }
                touched = true;
                s.row[cols..].fill(0.0);
                self.row_forward(y, s);
            }
            if !touched {
                continue;
            }
            self.columns_forward(rows, s);
            let spectrum = spectra.get(*node);
            let spectrum: &[Complex32] = bytemuck::cast_slice(&spectrum);
            for ((sum, a), b) in s.sum.iter_mut().zip(&s.turned).zip(spectrum) {
                *sum += a * b;
            }
        }
        s.nodes = nodes;
        self.back(rows + self.window - 1, cols + self.window - 1, out, out_stride, s);
    }

    fn row_forward(&self, y: usize, s: &mut Scratch) {
        let row = &mut s.rows[y * self.half..][..self.half];
        self.forward.process_with_scratch(&mut s.row, row, &mut s.fft).expect("planned lengths");
    }

    /// `rows` transformed rows to columns, and their transform, in `s.turned`.
    fn columns_forward(&self, rows: usize, s: &mut Scratch) {
        s.rows[rows * self.half..].fill(Complex32::default());
        transpose(&s.rows, &mut s.turned, self.fft, self.half);
        self.columns.process_with_scratch(&mut s.turned, &mut s.fft);
    }

    fn back(&self, rows: usize, cols: usize, out: &mut [f32], stride: usize, s: &mut Scratch) {
        self.columns_back.process_with_scratch(&mut s.sum, &mut s.fft);
        transpose(&s.sum, &mut s.rows, self.half, self.fft);
        for (y, line) in s.rows.chunks_exact_mut(self.half).take(rows).enumerate() {
            line[0].im = 0.0;
            line[self.half - 1].im = 0.0;
            self.inverse.process_with_scratch(line, &mut s.row, &mut s.fft).expect("planned lengths");
            for (to, from) in out[y * stride..][..cols].iter_mut().zip(&s.row) {
                *to += from;
            }
        }
    }
}

/// `from` (rows × cols) to `to` (cols × rows), in 16 × 16 pieces that stay in L1.
fn transpose(from: &[Complex32], to: &mut [Complex32], rows: usize, cols: usize) {
    const PIECE: usize = 16;
    for y0 in (0..rows).step_by(PIECE) {
        for x0 in (0..cols).step_by(PIECE) {
            for y in y0..(y0 + PIECE).min(rows) {
                for x in x0..(x0 + PIECE).min(cols) {
                    to[x * rows + y] = from[y * cols + x];
                }
            }
        }
    }
}
