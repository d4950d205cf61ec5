//! The transpose of a block's [`Columns::scatter`], from the film to the pixels of the block.
//!
//! ```text
//! out(x) += Σ_node w_node(x) · Σ_v film(v)·kernel_node(v − x)
//! ```
//! One forward transform of the film that the block contributes to; per node the product with the conjugate of the node's spectrum, the transform of a
//! correlation; its inverse transform; and in each panel in which the node's weight is above 0 the same weights as forward, added in the order of the nodes.
//!
//! The correlation is skew-circular along y and circular along x. A pixel of the block is at most F − n, so film pixels before it meet the kernel from its sample n on:
//! zeros.

use super::block::{FromGroups, ImageColumns, PanelExtent, Pixels, SplatWeight, ToGroups, clear_columns};
use super::complex::Complex;
use super::{Columns, Scratch};
use crate::psf::block_view::{BlockView, Spectra};
use crate::psf::grid::{NodeGrid, NodeWeight};
use crate::psf::polar::BlockPlace;
use crate::simd::lanes::{Lanes, SimdOp};
use bytemuck::{cast_slice, cast_slice_mut};

impl<V: Lanes> Columns<V> {
    /// Adds to each pixel of the block at `place`, in `out`, the film under the kernels of the pixel; `film` has the `rows + window − 1` × `cols + window − 1` film pixels that
    /// the block contributes to. Both are buffers and the pixels from row to row, complete panels; those of the film beyond its columns are 0.
    pub(crate) fn gather(
        &self,
        (film, film_stride): (&[f32], usize),
        place: &BlockPlace,
        grid: &NodeGrid,
        spectra: &dyn Spectra,
        (out, stride): (&mut [f32], usize),
        s: &mut Scratch,
    ) {
        let (rows, tail) = (place.rows, self.window - 1);
        let panels = place.cols.div_ceil(V::LANES);
        let block_extent = self.pack(&BlockView { pixels: out, stride, place: *place }, grid, s);
        // A pixel of 0 has a film, too.
        s.extents[..panels].iter_mut().for_each(|extent| extent.nonzero = true);
        self.touching(&block_extent, panels, grid, s);
        self.transform_film((film, film_stride), (rows + tail, place.cols + tail), s);
        let packed = cast_slice_mut::<_, Pixels<V>>(&mut s.packed);
        let panel = cast_slice_mut::<_, Complex<V>>(&mut s.panel);
        let (film, product) = (
            cast_slice::<_, Complex<V>>(&s.groups[..self.spectrum_len()]),
            cast_slice_mut::<_, Complex<V>>(&mut s.sum),
        );
        for (node, weight) in &s.nodes {
            let touches = |extent: &PanelExtent| extent.touches(weight, block_extent.wraps);
            let spectrum = spectra.get(*node);
            let spectrum: &[Complex<V>] = cast_slice(&spectrum);
            let groups = film.chunks_exact(self.fft).zip(spectrum.chunks_exact(self.fft));
            for ((film, spectrum), to) in groups.zip(product.chunks_exact_mut(self.fft)) {
                self.dispatch.run(ConjugateProduct { film, spectrum, to });
                self.along_x.inverse(to);
            }
            for (i, _) in s.extents[..panels].iter().enumerate().filter(|(_, extent)| touches(extent)) {
                let first_column = i * V::LANES;
                self.dispatch.run(FromGroups { groups: product, panel, fft: self.fft, first_column });
                self.along_y.inverse(panel);
                let pixels = &mut packed[i * self.block..][..rows];
                self.add_weighted(weight, block_extent.wraps, panel, pixels);
            }
        }
        for (i, panel) in packed.chunks_exact(self.block).take(panels).enumerate() {
            self.dispatch.run(Unpack { panel: &panel[..rows], out: &mut out[i * V::LANES..], stride });
        }
    }

    /// The transform of the `rows` × `cols` first values of `film` in `s.groups`.
    pub(super) fn transform_film(
        &self,
        (film, stride): (&[f32], usize),
        (rows, cols): (usize, usize),
        s: &mut Scratch,
    ) {
        let panel = cast_slice_mut::<_, Complex<V>>(&mut s.panel);
        let groups = cast_slice_mut::<_, Complex<V>>(&mut s.groups[..self.fft * self.half * 2]);
        for first_column in (0..self.fft).step_by(V::LANES) {
            if first_column >= cols {
                clear_columns::<V>(groups, self.fft, first_column);
                continue;
            }
            let image = &film[first_column..];
            self.dispatch.run(ImageColumns { image, stride, rows, omega: &self.omega, panel });
            self.along_y.forward(panel);
            self.dispatch.run(ToGroups { panel, groups, stride: self.fft, first_column });
        }
        for group in groups.chunks_exact_mut(self.fft) {
            self.along_x.forward(group);
        }
    }

    fn add_weighted(&self, weight: &NodeWeight, wraps: bool, panel: &[Complex<V>], pixels: &mut [Pixels<V>]) {
        let omega = &self.omega[..];
        match wraps {
            true => self.dispatch.run(AddWeighted::<V, true> { weight, panel, omega, pixels }),
            false => self.dispatch.run(AddWeighted::<V, false> { weight, panel, omega, pixels }),
        }
    }
}

/// `film` times the conjugate of `spectrum`.
pub(super) struct ConjugateProduct<'a, V> {
    pub(super) film: &'a [Complex<V>],
    pub(super) spectrum: &'a [Complex<V>],
    pub(super) to: &'a mut [Complex<V>],
}

impl<V: Lanes> SimdOp<V> for ConjugateProduct<'_, V> {
    #[inline(always)]
    fn run(self) {
        for ((to, a), k) in self.to.iter_mut().zip(self.film).zip(self.spectrum) {
            *to = Complex { re: a.re.mul_add(k.re, a.im * k.im), im: a.im.mul_sub(k.re, a.re * k.im) };
        }
    }
}

/// Adds one panel after its inverse transform, times a node's weights, to the packed pixels.
struct AddWeighted<'a, V, const WRAPS: bool> {
    weight: &'a NodeWeight,
    panel: &'a [Complex<V>],
    omega: &'a [[f32; 2]],
    /// The rows of the block.
    pixels: &'a mut [Pixels<V>],
}

impl<V: Lanes, const WRAPS: bool> SimdOp<V> for AddWeighted<'_, V, WRAPS> {
    #[inline(always)]
    fn run(self) {
        let weight = SplatWeight::<V>::new(self.weight);
        let upper_rows = self.pixels.len().min(self.panel.len());
        let (upper, lower) = self.pixels.split_at_mut(upper_rows);
        for (y, ((upper, z), w)) in upper.iter_mut().zip(self.panel).zip(self.omega).enumerate() {
            let x = z.times_conjugate(*w);
            upper[0] = x.re.mul_add(weight.at::<WRAPS>(upper), upper[0]);
            if let Some(lower) = lower.get_mut(y) {
                lower[0] = x.im.mul_add(weight.at::<WRAPS>(lower), lower[0]);
            }
        }
    }
}

/// Stores the pixels of a packed panel.
struct Unpack<'a, V> {
    panel: &'a [Pixels<V>],
    /// From the panel's first column on, rows `stride` apart.
    out: &'a mut [f32],
    stride: usize,
}

impl<V: Lanes> SimdOp<V> for Unpack<'_, V> {
    #[inline(always)]
    fn run(self) {
        for (y, pixels) in self.panel.iter().enumerate() {
            pixels[0].store(&mut self.out[y * self.stride..]);
        }
    }
}
