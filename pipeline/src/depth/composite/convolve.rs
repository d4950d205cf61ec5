//! Convolutions of the planes of a tile with the kernels of a depth node.

use super::{Composite, CompositeScratch};
use crate::buffer::resize_exact;
use crate::depth::planes::Planes;
use crate::geometry::Rect;

impl Composite<'_> {
    /// Adds the convolution of `value` (by index in the planes) with the kernels of `node` on `tile` to `to`.
    pub(super) fn add_convolved(
        &self,
        node: usize,
        planes: &Planes,
        tile: Rect,
        value: impl Fn(usize) -> f32,
        to: &mut [f32],
        s: &mut CompositeScratch,
    ) {
        if self.spread(node, planes, tile, value, s) {
            self.add_scattered(node, tile, s, to, |to, v, _| *to += v);
        }
    }

    /// Convolves `value` (by index in the planes) with the kernels of `node` into `scattered`, where the slab is needed; `false`: all values are 0.
    pub(super) fn spread(
        &self,
        node: usize,
        planes: &Planes,
        tile: Rect,
        value: impl Fn(usize) -> f32,
        s: &mut CompositeScratch,
    ) -> bool {
        self.spread_blocks(node, planes, tile, value, s, |is_wanted| is_wanted)
    }

    /// As [`Composite::spread`], of the FFT blocks that `adds` selects, which is called for each in order with whether it reaches to where the slab is
    /// needed.
    pub(super) fn spread_blocks(
        &self,
        node: usize,
        planes: &Planes,
        tile: Rect,
        value: impl Fn(usize) -> f32,
        s: &mut CompositeScratch,
        mut adds: impl FnMut(bool) -> bool,
    ) -> bool {
        let psf = self.psf(node);
        let from = planes.rect.expect("computed before");
        let rect = tile.grown(psf.margin());
        resize_exact(&mut s.source, rect.size().pixels());
        let first = (rect.y - from.y) as usize * from.width + (rect.x - from.x) as usize;
        let mut any = false;
        for (y, to) in s.source.chunks_exact_mut(rect.width).enumerate() {
            for (x, to) in to.iter_mut().enumerate() {
                *to = value(first + y * from.width + x);
                any |= *to != 0.0;
            }
        }
        if any {
            let (wanted, margin) = (&s.wanted, psf.margin());
            let is_wanted = |block: Rect| adds(wanted.reaches(block.grown(margin)));
            psf.scatter_blocks(
                self.frame,
                rect,
                &s.source,
                self.spectra,
                &mut s.scattered,
                &mut s.psf,
                is_wanted,
            );
        }
        any
    }

    /// Adds what [`Composite::spread`] computed on `tile` to `to` by `add`.
    pub(super) fn add_scattered(
        &self,
        node: usize,
        tile: Rect,
        s: &CompositeScratch,
        to: &mut [f32],
        add: impl Fn(&mut f32, f32, usize),
    ) {
        // The contribution covers the tile grown by the whole window.
        let (edge, stride) = (2 * self.psf(node).margin(), s.scattered.stride);
        for (y, to) in to.chunks_exact_mut(tile.width).enumerate() {
            let from = &s.scattered.data[(y + edge) * stride + edge..][..tile.width];
            for (x, (to, v)) in std::iter::zip(to, from).enumerate() {
                add(to, *v, y * tile.width + x);
            }
        }
    }
}
