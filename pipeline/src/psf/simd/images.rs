//! Sums of convolutions of several images, each with its own kernel, and their transposes, by the transforms of [`Columns`].
//!
//! ```text
//! out        += Σ_i image_i ∗ kernel_i                 a forward transform an image, and one inverse
//! image_i(x)  = Σ_v film(v)·kernel_i(v − x)            one forward transform, and an inverse an image
//! ```
//! Images of a block stand one after the other, their rows complete panels; what is beyond their columns is 0.

use super::block::{AddTo, FromGroups, ImageColumns, ToGroups};
use super::complex::Complex;
use super::gather::ConjugateProduct;
use super::{Columns, Scratch};
use crate::buffer::AlignedBuf;
use crate::simd::lanes::Lanes;
use bytemuck::{cast_slice, cast_slice_mut};

/// Rows and columns of the images of a block, and values from row to row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ImageSize {
    pub(crate) rows: usize,
    pub(crate) cols: usize,
    pub(crate) stride: usize,
}

impl ImageSize {
    /// Values of an image.
    pub(crate) fn values(&self) -> usize {
        self.rows * self.stride
    }
}

impl<V: Lanes> Columns<V> {
    /// Adds the sum of the `images`, each convolved with the kernel of the spectrum that `spectra` has for it, to `out`, which lies as in [`Columns::scatter`].
    pub(crate) fn convolve_images<'a>(
        &self,
        (images, size): (&[f32], ImageSize),
        spectra: impl Iterator<Item = &'a AlignedBuf>,
        (out, out_stride): (&mut [f32], usize),
        s: &mut Scratch,
    ) {
        let ImageSize { rows, cols, stride } = size;
        let filled = cols.next_multiple_of(V::LANES);
        let mut first = true;
        for (image, spectrum) in images.chunks_exact(size.values()).zip(spectra) {
            let panel = cast_slice_mut::<_, Complex<V>>(&mut s.panel);
            let groups = cast_slice_mut::<_, Complex<V>>(&mut s.groups);
            let line = cast_slice_mut::<_, Complex<V>>(&mut s.line);
            let sum = cast_slice_mut::<_, Complex<V>>(&mut s.sum);
            for first_column in (0..cols).step_by(V::LANES) {
                let image = &image[first_column..];
                self.dispatch.run(ImageColumns { image, stride, rows, omega: &self.omega, panel });
                self.along_y.forward(panel);
                self.dispatch.run(ToGroups { panel, groups, stride: self.fft, first_column });
            }
            let products = groups.chunks_exact(self.fft).zip(cast_slice(spectrum).chunks_exact(self.fft));
            for ((group, spectrum), sum) in products.zip(sum.chunks_exact_mut(self.fft)) {
                self.along_x.forward_onto(&group[..filled], line, (spectrum, &[]), sum, first);
            }
            first = false;
        }
        if !first {
            self.add_inverse((rows, cols), out, out_stride, s);
        }
    }

    /// The transpose of [`Columns::convolve_images`]: adds to each of the `images` the correlation of `film` with its kernel; `film` lies as in [`Columns::gather`].
    pub(crate) fn correlate_images<'a>(
        &self,
        film: (&[f32], usize),
        spectra: impl Iterator<Item = &'a AlignedBuf>,
        (images, size): (&mut [f32], ImageSize),
        s: &mut Scratch,
    ) {
        let (ImageSize { rows, cols, stride }, tail) = (size, self.window - 1);
        self.transform_film(film, (rows + tail, cols + tail), s);
        let panel = cast_slice_mut::<_, Complex<V>>(&mut s.panel);
        let (film, product) = (
            cast_slice::<_, Complex<V>>(&s.groups[..self.spectrum_len()]),
            cast_slice_mut::<_, Complex<V>>(&mut s.sum),
        );
        for (image, spectrum) in images.chunks_exact_mut(size.values()).zip(spectra) {
            let groups = film.chunks_exact(self.fft).zip(cast_slice(spectrum).chunks_exact(self.fft));
            for ((film, spectrum), to) in groups.zip(product.chunks_exact_mut(self.fft)) {
                self.dispatch.run(ConjugateProduct { film, spectrum, to });
                self.along_x.inverse(to);
            }
            for first_column in (0..cols).step_by(V::LANES) {
                self.dispatch.run(FromGroups { groups: product, panel, fft: self.fft, first_column });
                self.along_y.inverse(panel);
                let out = &mut image[first_column..];
                self.dispatch.run(AddTo { panel, omega: &self.omega, out, stride, rows });
            }
        }
    }
}
