//! SVPSF with SIMD: the same sums as [`crate::psf::portable`], 16 or 8 columns per register.
//!
//! Per block:
//!   1. pack it with its coordinates, one panel (as many columns as lanes) at a time ([`block`]);
//!   2. per node that touches it, per panel in which the node's weight is above 0: weight → right-angle transform along y →
//!      transpose into groups of spectral rows;
//!   3. per group: FFT along x ([`fft`]), whose last stage multiplies by the node's spectrum and accumulates;
//!   4. once: inverse along x, transpose, inverse along y, add to the output.
//!
//! For speed: no bit reversal, no partly filled register, all F/2 spectral rows use the same code, weights computed from 12 bytes per
//! pixel instead of stored, panels of zero weight or zero pixels skipped, all buffers of a block in L2. A spectrum is stored in the
//! order of its product: `[F/2/LANES groups][F columns, digits reversed][LANES re, LANES im]`, scaled by 2/F².
//!
//! `unsafe` is confined to [`crate::simd`] (dispatch, intrinsics), the loops of [`fft`] and the layout of [`complex`].

mod block;
mod complex;
mod fft;
mod gather;
pub(crate) mod images;

use crate::buffer::AlignedBuf;
use crate::psf::block_view::{BlockView, Spectra};
use crate::psf::blocks::Blocks;
use crate::psf::grid::{Node, NodeGrid, NodeWeight};
use crate::psf::polar::PolarExtent;
use crate::real;
use crate::simd::Simd;
use crate::simd::lanes::{Dispatch, Lanes};
use block::{
    AddTo, ApplyWeight, Coordinates, FromGroups, KernelColumns, Pack, PanelExtent, Pixels, ToGroups,
    clear_columns,
};
use bytemuck::{cast_slice, cast_slice_mut};
use complex::Complex;
use fft::Fft;

/// Transforms of one FFT size, one column per lane of `V`.
#[derive(Debug)]
pub(crate) struct Columns<V: Lanes> {
    dispatch: Dispatch<V>,
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
pub(crate) struct Scratch {
    packed: AlignedBuf,
    extents: Vec<PanelExtent>,
    /// r and θ of a block near the axis.
    near: (Vec<f32>, Vec<f32>),
    panel: AlignedBuf,
    groups: AlignedBuf,
    sum: AlignedBuf,
    nodes: Vec<(Node, NodeWeight)>,
}

impl<V: Lanes> Columns<V> {
    /// Plans the transforms of `blocks`; `simd` selects the instructions of `V`.
    pub(crate) fn new(blocks: &Blocks, simd: Simd) -> Self {
        let dispatch = Dispatch::new(simd);
        let (fft, half) = (blocks.fft, blocks.fft / 2);
        assert!(half.is_multiple_of(V::LANES), "FFT sizes are multiples of 32");
        let omega = |y: usize| {
            let (sin, cos) = real::sin_cos(std::f64::consts::PI * y as f64 / fft as f64);
            [cos as f32, sin as f32]
        };
        Self {
            dispatch,
            fft,
            half,
            window: blocks.window,
            block: blocks.block,
            omega: (0..half).map(omega).collect(),
            along_x: Fft::new(fft, dispatch),
            along_y: Fft::new(half, dispatch),
        }
    }

    /// Length of one spectrum in f32.
    pub(crate) fn spectrum_len(&self) -> usize {
        self.fft * self.half * 2
    }

    /// Buffers for one worker.
    pub(crate) fn scratch(&self) -> Scratch {
        let panels = self.block.div_ceil(V::LANES);
        let empty = PanelExtent { nonzero: false, r: (0.0, 0.0), theta: (0.0, 0.0) };
        Scratch {
            packed: AlignedBuf::zeroed(panels * self.block * 3 * V::LANES),
            extents: vec![empty; panels],
            near: (vec![0.0; self.block * self.block], vec![0.0; self.block * self.block]),
            panel: AlignedBuf::zeroed(self.half * 2 * V::LANES),
            groups: AlignedBuf::zeroed(self.spectrum_len()),
            sum: AlignedBuf::zeroed(self.spectrum_len()),
            nodes: Vec::new(),
        }
    }

    /// Spectrum of a kernel (window × window) whose first sample is at the origin, in the memory of `buffer`.
    pub(crate) fn spectrum(&self, kernel: &[f32], s: &mut Scratch, buffer: AlignedBuf) -> AlignedBuf {
        let (n, lanes) = (self.window, V::LANES);
        let norm = 2.0 / (self.fft * self.fft) as f32;
        let mut spectrum = buffer;
        spectrum.reset(self.spectrum_len());
        let groups: &mut [Complex<V>] = cast_slice_mut(&mut spectrum);
        for first_column in (0..n).step_by(lanes) {
            let panel: &mut [Complex<V>] = cast_slice_mut(&mut s.panel);
            self.dispatch.run(KernelColumns {
                kernel,
                window: n,
                first_column,
                norm,
                omega: &self.omega,
                panel,
            });
            self.along_y.forward(panel);
            self.dispatch.run(ToGroups { panel, groups, fft: self.fft, first_column });
        }
        for group in groups.chunks_exact_mut(self.fft) {
            self.along_x.forward(group);
        }
        spectrum
    }

    /// Adds the contribution of one block of the remapped image to `out`: `rows + window − 1` rows of `cols + window − 1` values,
    /// rounded up to complete panels. The first value of `out` is the film pixel (window − 1)/2 above and left of the block's first
    /// pixel.
    pub(crate) fn scatter(
        &self,
        block: &BlockView<'_>,
        grid: &NodeGrid,
        spectra: &dyn Spectra,
        out: &mut [f32],
        out_stride: usize,
        s: &mut Scratch,
    ) {
        let (rows, cols) = (block.place.rows, block.place.cols);
        let panels = cols.div_ceil(V::LANES);
        let block_extent = self.pack(block, grid, s);
        grid.touching(&block_extent, &mut s.nodes);
        let (packed, panel, groups, sum): (&[Pixels<V>], _, _, _) = (
            cast_slice(&s.packed),
            cast_slice_mut::<_, Complex<V>>(&mut s.panel),
            cast_slice_mut::<_, Complex<V>>(&mut s.groups),
            cast_slice_mut::<_, Complex<V>>(&mut s.sum),
        );
        let mut first = true;
        for (node, weight) in &s.nodes {
            let touches = |extent: &PanelExtent| extent.touches(weight, block_extent.wraps);
            if !s.extents[..panels].iter().any(touches) {
                continue;
            }
            for (i, extent) in s.extents[..panels].iter().enumerate() {
                let first_column = i * V::LANES;
                if !touches(extent) {
                    clear_columns::<V>(groups, self.fft, first_column);
                    continue;
                }
                let pixels = &packed[i * self.block..][..rows];
                self.apply_weight(weight, block_extent.wraps, pixels, panel);
                self.along_y.forward(panel);
                self.dispatch.run(ToGroups { panel, groups, fft: self.fft, first_column });
            }
            let spectrum = spectra.get(*node);
            let spectrum: &[Complex<V>] = cast_slice(&spectrum);
            let products = groups.chunks_exact_mut(self.fft).zip(spectrum.chunks_exact(self.fft));
            for ((group, spectrum), sum) in products.zip(sum.chunks_exact_mut(self.fft)) {
                self.along_x.forward_onto(group, panels * V::LANES, spectrum, sum, first);
            }
            first = false;
        }
        if first {
            return; // all pixels are 0
        }
        self.add_inverse((rows, cols), out, out_stride, s);
    }

    /// Adds the inverse transform of `s.sum`, of a block of `rows` × `cols` pixels, to `out`.
    fn add_inverse(&self, (rows, cols): (usize, usize), out: &mut [f32], out_stride: usize, s: &mut Scratch) {
        let panel = cast_slice_mut::<_, Complex<V>>(&mut s.panel);
        let sum = cast_slice_mut::<_, Complex<V>>(&mut s.sum);
        for group in sum.chunks_exact_mut(self.fft) {
            self.along_x.inverse(group);
        }
        let (rows, stride) = (rows + self.window - 1, out_stride);
        for first_column in (0..cols + self.window - 1).step_by(V::LANES) {
            self.dispatch.run(FromGroups { groups: sum, panel, fft: self.fft, first_column });
            self.along_y.inverse(panel);
            let out = &mut out[first_column..];
            self.dispatch.run(AddTo { panel, omega: &self.omega, out, stride, rows });
        }
    }

    /// Packs the block; returns its extent.
    fn pack(&self, block: &BlockView<'_>, grid: &NodeGrid, s: &mut Scratch) -> PolarExtent {
        let place = &block.place;
        let extents = &mut s.extents[..place.cols.div_ceil(V::LANES)];
        if let NodeGrid::Cartesian(_) = grid {
            let (coordinates, to) = (Coordinates::Cartesian, cast_slice_mut(&mut s.packed));
            self.dispatch.run(Pack { block, rows: self.block, to, extents, coordinates });
            return place.cartesian_extent();
        }
        let (_, _, r_px, azimuth_rad, wraps) = place.centre();
        let mut extent = PolarExtent { r_px, azimuth_rad, r: (0.0, 0.0), theta: (0.0, 0.0), wraps };
        if wraps {
            extent = place.polar(place.cols, &mut s.near.0, &mut s.near.1);
        }
        let coordinates = match wraps {
            true => Coordinates::Given(&s.near.0, &s.near.1),
            false => Coordinates::FarPolar,
        };
        let to = cast_slice_mut(&mut s.packed);
        self.dispatch.run(Pack { block, rows: self.block, to, extents, coordinates });
        if !wraps {
            let union = |of: fn(&PanelExtent) -> (f32, f32)| {
                let all = extents.iter().map(of);
                all.fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), (c, d)| (a.min(c), b.max(d)))
            };
            extent.r = union(|e| e.r);
            extent.theta = union(|e| e.theta);
        }
        extent
    }

    fn apply_weight(&self, weight: &NodeWeight, wraps: bool, pixels: &[Pixels<V>], panel: &mut [Complex<V>]) {
        let omega = &self.omega[..];
        match wraps {
            true => self.dispatch.run(ApplyWeight::<V, true> { weight, pixels, omega, panel }),
            false => self.dispatch.run(ApplyWeight::<V, false> { weight, pixels, omega, panel }),
        }
    }
}
