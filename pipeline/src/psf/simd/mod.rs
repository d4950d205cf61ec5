//! SVPSF with the columns in lanes: the same sums as [`crate::psf::portable`], 16 or 8 columns at a time.
//!
//! Per block, all in lanes:
//!   1. pack it strip by strip with its polar maps ([`block`]);
//!   2. per node that touches it, per strip that the node has a share in: weigh → right-angle transform along y → transpose
//!      into groups of spectral rows;
//!   3. per group: FFT along x ([`fft`]), whose last stage multiplies by the node's spectrum and accumulates;
//!   4. once: back along x, transpose, back along y, add to the output.
//!
//! Why it is fast: no bit reversal and no half-filled register anywhere, F/2 spectral rows without special ones, weights
//! from 12 bytes a pixel and not from memory of their own, strips of no share or no light skipped, all buffers of a block
//! in L2. A spectrum lies as its product meets it: `[F/2/LANES groups][F columns, digits reversed][LANES re, LANES im]`,
//! scaled by 2/F².
//!
//! `unsafe` lives in [`crate::simd`]'s rooms (the gate, intrinsics) and one loop of [`fft`].

mod block;
mod complex;
mod fft;
pub(super) mod turn;

use crate::buffer::AlignedBuf;
use crate::psf::blocks::Blocks;
use crate::psf::grid::{Node, NodeGrid, Reach, Tent};
use crate::psf::{BlockView, Spectra};
use crate::real;
use crate::simd::Simd;
use crate::simd::lanes::{Gate, Lanes};
use block::{AddTo, Extent, FromGroups, KernelColumns, Pack, Pixels, ToGroups, Weigh, clear_columns};
use bytemuck::{cast_slice, cast_slice_mut};
use complex::Complex;
use fft::Fft;

/// Transforms of one FFT side, columns in the lanes of `V`.
#[derive(Debug)]
pub(super) struct Columns<V: Lanes> {
    gate: Gate<V>,
    fft: usize,
    half: usize,
    window: usize,
    block: usize,
    /// exp(iπy/F).
    omega: Vec<[f32; 2]>,
    along_x: Fft<V>,
    along_y: Fft<V>,
}

/// Buffers of one worker.
#[derive(Debug)]
pub(super) struct Scratch {
    packed: AlignedBuf,
    extents: Vec<Extent>,
    near: (Vec<f32>, Vec<f32>),
    strip: AlignedBuf,
    groups: AlignedBuf,
    sum: AlignedBuf,
    nodes: Vec<(Node, Tent)>,
}

impl<V: Lanes> Columns<V> {
    /// Plans the transforms of `blocks`; `simd` is a choice of `V`'s instructions.
    pub(super) fn new(blocks: &Blocks, simd: Simd) -> Self {
        let gate = Gate::open(simd);
        let (fft, half) = (blocks.fft, blocks.fft / 2);
        assert!(half.is_multiple_of(V::LANES), "FFT sides are multiples of 32");
        let omega = |y: usize| {
            let (sin, cos) = real::sin_cos(std::f64::consts::PI * y as f64 / fft as f64);
            [cos as f32, sin as f32]
        };
        Self {
            gate,
            fft,
            half,
            window: blocks.window,
            block: blocks.block,
            omega: (0..half).map(omega).collect(),
            along_x: Fft::new(fft, gate),
            along_y: Fft::new(half, gate),
        }
    }

    /// f32s of one spectrum.
    pub(super) fn spectrum_len(&self) -> usize {
        self.fft * self.half * 2
    }

    /// Buffers for one worker.
    pub(super) fn scratch(&self) -> Scratch {
        let strips = self.block.div_ceil(V::LANES);
        let nothing = Extent { lit: false, r: (0.0, 0.0), theta: (0.0, 0.0) };
        Scratch {
            packed: AlignedBuf::zeroed(strips * self.block * 3 * V::LANES),
            extents: vec![nothing; strips],
            near: (vec![0.0; self.block * self.block], vec![0.0; self.block * self.block]),
            strip: AlignedBuf::zeroed(self.half * 2 * V::LANES),
            groups: AlignedBuf::zeroed(self.spectrum_len()),
            sum: AlignedBuf::zeroed(self.spectrum_len()),
            nodes: Vec::new(),
        }
    }

    /// Spectrum of a kernel (window × window), its first sample at the origin.
    pub(super) fn spectrum(&self, kernel: &[f32], s: &mut Scratch, buffer: AlignedBuf) -> AlignedBuf {
        let (n, lanes) = (self.window, V::LANES);
        let norm = 2.0 / (self.fft * self.fft) as f32;
        let mut spectrum = buffer;
        spectrum.reset(self.spectrum_len());
        let groups: &mut [Complex<V>] = cast_slice_mut(&mut spectrum);
        for first_column in (0..n).step_by(lanes) {
            let strip: &mut [Complex<V>] = cast_slice_mut(&mut s.strip);
            self.gate.run(KernelColumns { kernel, window: n, first_column, norm, omega: &self.omega, strip });
            self.along_y.forward(strip);
            self.gate.run(ToGroups { strip, groups, fft: self.fft, first_column });
        }
        for group in groups.chunks_exact_mut(self.fft) {
            self.along_x.forward(group);
        }
        spectrum
    }

    /// Scatters one block of the remapped image into `out`, whose first value is the film pixel (window − 1)/2 above and left of the
    /// block's first: `rows + window − 1` rows of `cols + window − 1` values, these rounded up to whole strips.
    pub(super) fn scatter(
        &self,
        block: &BlockView<'_>,
        grid: &NodeGrid,
        spectra: &dyn Spectra,
        out: &mut [f32],
        out_stride: usize,
        s: &mut Scratch,
    ) {
        let (rows, cols) = (block.place.rows, block.place.cols);
        let strips = cols.div_ceil(V::LANES);
        let reach = self.pack(block, s);
        grid.touching(&reach, &mut s.nodes);
        let (packed, strip, groups, sum): (&[Pixels<V>], _, _, _) = (
            cast_slice(&s.packed),
            cast_slice_mut::<_, Complex<V>>(&mut s.strip),
            cast_slice_mut::<_, Complex<V>>(&mut s.groups),
            cast_slice_mut::<_, Complex<V>>(&mut s.sum),
        );
        let mut first = true;
        for (node, tent) in &s.nodes {
            let meets = |extent: &Extent| extent.meets(tent, reach.around);
            if !s.extents[..strips].iter().any(meets) {
                continue;
            }
            for (i, extent) in s.extents[..strips].iter().enumerate() {
                let first_column = i * V::LANES;
                if !meets(extent) {
                    clear_columns::<V>(groups, self.fft, first_column);
                    continue;
                }
                let pixels = &packed[i * self.block..][..rows];
                self.weigh(tent, reach.around, pixels, strip);
                self.along_y.forward(strip);
                self.gate.run(ToGroups { strip, groups, fft: self.fft, first_column });
            }
            let spectrum = spectra.get(*node);
            let spectrum: &[Complex<V>] = cast_slice(&spectrum);
            let pieces = groups.chunks_exact_mut(self.fft).zip(spectrum.chunks_exact(self.fft));
            for ((group, spectrum), sum) in pieces.zip(sum.chunks_exact_mut(self.fft)) {
                self.along_x.forward_onto(group, strips * V::LANES, spectrum, sum, first);
            }
            first = false;
        }
        if first {
            return; // a dark block
        }
        for group in sum.chunks_exact_mut(self.fft) {
            self.along_x.inverse(group);
        }
        let (rows, stride) = (rows + self.window - 1, out_stride);
        for first_column in (0..cols + self.window - 1).step_by(V::LANES) {
            self.gate.run(FromGroups { groups: sum, strip, fft: self.fft, first_column });
            self.along_y.inverse(strip);
            let out = &mut out[first_column..];
            self.gate.run(AddTo { strip, omega: &self.omega, out, stride, rows });
        }
    }

    /// Packs the block and tells its reach.
    fn pack(&self, block: &BlockView<'_>, s: &mut Scratch) -> Reach {
        let place = &block.place;
        let (_, _, r_px, azimuth_rad, around) = place.centre();
        let extents = &mut s.extents[..place.cols.div_ceil(V::LANES)];
        let mut reach = Reach { r_px, azimuth_rad, r: (0.0, 0.0), theta: (0.0, 0.0), around };
        if around {
            reach = place.polar(place.cols, &mut s.near.0, &mut s.near.1);
        }
        let near = around.then_some((&s.near.0[..], &s.near.1[..]));
        self.gate.run(Pack { block, rows: self.block, to: cast_slice_mut(&mut s.packed), extents, near });
        if !around {
            let ends = |of: fn(&Extent) -> (f32, f32)| {
                let all = extents.iter().map(of);
                all.fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), (c, d)| (a.min(c), b.max(d)))
            };
            reach.r = ends(|e| e.r);
            reach.theta = ends(|e| e.theta);
        }
        reach
    }

    fn weigh(&self, tent: &Tent, around: bool, pixels: &[Pixels<V>], strip: &mut [Complex<V>]) {
        let omega = &self.omega[..];
        match around {
            true => self.gate.run(Weigh::<V, true> { tent, pixels, omega, strip }),
            false => self.gate.run(Weigh::<V, false> { tent, pixels, omega, strip }),
        }
    }
}
