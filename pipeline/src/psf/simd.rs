//! SVPSF with SIMD: the same sums as [`crate::psf::portable`], 16 or 8 columns per register.
//!
//! Per block:
//!   1. pack it with its coordinates, one panel (as many columns as lanes) at a time ([`block`]);
//!   2. per panel, per node whose weight is above 0 in it: weight → right-angle transform along y → transpose into groups of
//!      spectral rows;
//!   3. per group, per node: FFT along x ([`fft`]), whose last stage multiplies by the node's spectrum and accumulates;
//!   4. once: inverse along x, transpose, inverse along y, add to the output.
//!
//! For speed: no bit reversal, no partly filled register, all F/2 spectral rows use the same code, weights computed from 12 bytes per
//! pixel instead of stored, panels of zero weight or zero pixels skipped, all buffers of a block in L2. Nodes take turns, as many as have copies of the
//! block in [`BATCH_BYTES`], within a panel and within a group, so that its pixels, or its part of the sum, stay in L1; meanwhile the next group
//! of each spectrum, which lies in L3 or beyond, is prefetched. A spectrum is stored in the
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
use crate::psf::blocks::{BATCH_BYTES, Blocks};
use crate::psf::grid::{Node, NodeGrid, NodeWeight};
use crate::psf::polar::PolarExtent;
use crate::real;
use crate::simd::Simd;
use crate::simd::lanes::{Dispatch, Lanes};
use block::{
    AddTo, ApplyWeight, Coordinates, FromGroups, KernelColumns, Pack, PanelExtent, Pixels, RadialWeights,
    ToGroups, clear_columns,
};
use bytemuck::{cast_slice, cast_slice_mut};
use complex::Complex;
use fft::{Fft, Prefetch};
use std::sync::Arc;

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
    /// Of a packed panel.
    radial: AlignedBuf,
    panel: AlignedBuf,
    line: AlignedBuf,
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
            radial: AlignedBuf::zeroed(self.block * V::LANES),
            panel: AlignedBuf::zeroed(self.half * 2 * V::LANES),
            line: AlignedBuf::zeroed(self.fft * 2 * V::LANES),
            groups: AlignedBuf::zeroed(self.spectrum_len().max(BATCH_BYTES / size_of::<f32>())),
            sum: AlignedBuf::zeroed(self.spectrum_len()),
            nodes: Vec::new(),
        }
    }

    /// Spectrum of a kernel (window × window) whose first sample is at the origin, in the memory of `buffer`.
    pub(crate) fn spectrum(&self, kernel: &[f32], s: &mut Scratch, buffer: AlignedBuf) -> AlignedBuf {
        let (n, filled) = (self.window, self.window.next_multiple_of(V::LANES));
        let norm = 2.0 / (self.fft * self.fft) as f32;
        let (panel, groups): (&mut [Complex<V>], &mut [Complex<V>]) =
            (cast_slice_mut(&mut s.panel), cast_slice_mut(&mut s.groups));
        for first_column in (0..n).step_by(V::LANES) {
            self.dispatch.run(KernelColumns {
                kernel,
                window: n,
                first_column,
                norm,
                omega: &self.omega,
                panel,
            });
            self.along_y.forward(panel);
            self.dispatch.run(ToGroups { panel, groups, stride: filled, first_column });
        }
        let mut spectrum = buffer;
        spectrum.resize(self.spectrum_len());
        let lines = cast_slice_mut(&mut spectrum).chunks_exact_mut(self.fft);
        for (from, line) in groups.chunks_exact(filled).zip(lines) {
            self.along_x.forward_from(from, line);
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
        let extent = self.pack(block, grid, s);
        self.touching(&extent, panels, grid, s);
        if s.nodes.is_empty() {
            return; // all pixels are 0
        }
        let nodes = std::mem::take(&mut s.nodes);
        for (i, batch) in nodes.chunks(self.batch(panels)).enumerate() {
            let held: Vec<_> = batch.iter().map(|(node, _)| spectra.get(*node)).collect();
            self.transform_weighted(batch, &held, (rows, panels), extent.wraps, s);
            self.accumulate(&held, panels, i == 0, s);
        }
        s.nodes = nodes;
        self.add_inverse((rows, cols), out, out_stride, s);
    }

    /// Collects in `s.nodes` those whose weight may be above 0 at a pixel that is not 0 of a packed block, of `extent` and as many `panels`.
    fn touching(&self, extent: &PolarExtent, panels: usize, grid: &NodeGrid, s: &mut Scratch) {
        grid.touching(extent, &mut s.nodes);
        let panels = &s.extents[..panels];
        s.nodes.retain(|(_, weight)| panels.iter().any(|panel| panel.touches(weight, extent.wraps)));
    }

    /// Number of nodes whose weighted copies of a block of `panels` panels are transformed together.
    fn batch(&self, panels: usize) -> usize {
        (BATCH_BYTES / (size_of::<Complex<V>>() * self.half * panels)).max(1)
    }

    /// Transforms the block times the weight of each node of `batch` along y: to `s.groups`, node after node, groups of the filled columns.
    fn transform_weighted(
        &self,
        batch: &[(Node, NodeWeight)],
        spectra: &[Arc<AlignedBuf>],
        (rows, panels): (usize, usize),
        wraps: bool,
        s: &mut Scratch,
    ) {
        let filled = panels * V::LANES;
        let (packed, radial, panel, groups): (&[Pixels<V>], &mut [V], _, _) = (
            cast_slice(&s.packed),
            cast_slice_mut(&mut s.radial),
            cast_slice_mut::<_, Complex<V>>(&mut s.panel),
            cast_slice_mut::<_, Complex<V>>(&mut s.groups),
        );
        // A panel of pixels serves all nodes while it is in L1.
        for (i, extent) in s.extents[..panels].iter().enumerate() {
            let (first_column, pixels) = (i * V::LANES, &packed[i * self.block..][..rows]);
            let mut height = None;
            let of_nodes = groups.chunks_exact_mut(self.half / V::LANES * filled);
            for (((node, weight), spectrum), groups) in batch.iter().zip(spectra).zip(of_nodes) {
                let first_group = &cast_slice(spectrum)[..self.fft];
                let part = self.fft.div_ceil(panels);
                self.dispatch.run(Prefetch::<V>(first_group.chunks(part).nth(i).unwrap_or_default()));
                if !extent.touches(weight, wraps) {
                    clear_columns::<V>(groups, filled, first_column);
                    continue;
                }
                if height.replace(node.k) != Some(node.k) {
                    self.dispatch.run(RadialWeights { weight, pixels, to: &mut *radial });
                }
                self.apply_weight(weight, wraps, (pixels, &*radial), panel);
                self.along_y.forward(panel);
                self.dispatch.run(ToGroups { panel, groups, stride: filled, first_column });
            }
        }
    }

    /// Transforms the copies of `s.groups`, of `panels` panels each, along x and adds their products with `spectra` to `s.sum`, or assigns it the sum if they are the `first`.
    fn accumulate(&self, spectra: &[Arc<AlignedBuf>], panels: usize, first: bool, s: &mut Scratch) {
        let (line, groups, sum): (_, &[Complex<V>], _) = (
            cast_slice_mut::<_, Complex<V>>(&mut s.line),
            cast_slice(&s.groups),
            cast_slice_mut::<_, Complex<V>>(&mut s.sum),
        );
        let filled = panels * V::LANES;
        // A group of the sum stays in L1 for all nodes.
        for (i, sum) in sum.chunks_exact_mut(self.fft).enumerate() {
            for (node, spectrum) in spectra.iter().enumerate() {
                let from = &groups[(node * (self.half / V::LANES) + i) * filled..][..filled];
                let (spectrum, rest) = cast_slice(spectrum)[i * self.fft..].split_at(self.fft);
                self.along_x.forward_onto(from, line, (spectrum, rest), sum, first && node == 0);
            }
        }
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

    fn apply_weight(
        &self,
        weight: &NodeWeight,
        wraps: bool,
        (pixels, radial): (&[Pixels<V>], &[V]),
        panel: &mut [Complex<V>],
    ) {
        let omega = &self.omega[..];
        match wraps {
            true => self.dispatch.run(ApplyWeight::<V, true> { weight, pixels, radial, omega, panel }),
            false => self.dispatch.run(ApplyWeight::<V, false> { weight, pixels, radial, omega, panel }),
        }
    }
}
