//! The transposes of the convolutions of the levels: correlations with the same kernels, by the same transforms.

use super::super::convolution::{Engine, place};
use super::super::weights::{BlockWeights, image_size};
use crate::buffer::zeros;
use crate::geometry::{Frame, Rect, Size};
use crate::parts::for_each_part;
use crate::simd::lanes::{Lanes, MAX_LANES};
use crate::tails::OUT_MARGIN;
use crate::tails::levels::out_size;
use std::convert::Infallible;

impl<V: Lanes> Engine<V> {
    /// The transpose of [`Engine::convolve`]: the light on the bins of `level`, of `result` on the film's bins and [`OUT_MARGIN`] around.
    pub(in crate::tails) fn correlate(
        &self,
        frame: &Frame,
        level: usize,
        result: &[f32],
        threads: usize,
    ) -> Vec<f32> {
        let plan = &self.plan;
        let bins = plan.bins(level);
        let (Size { height: rows, width: columns }, half) = (bins.size(), plan.half());
        // The bins of `result`, from the first place that the first bin's kernel reaches.
        let size = out_size(&bins);
        let first = (half + bins.margin - OUT_MARGIN) as i64;
        let filled = Rect::new(first, first, size.height, size.width);
        let mut light = zeros(rows * columns);
        let done: Result<(), Infallible> = for_each_part(
            threads,
            light.chunks_mut(self.blocks.block * columns).enumerate(),
            || (BlockWeights::default(), self.columns.scratch(), Vec::new(), Vec::new(), Vec::new()),
            |(weights, scratch, window, ones, images), (row, light)| {
                let strip = Rect::new((row * self.blocks.block) as i64, 0, light.len() / columns, columns);
                for block in strip.tiles(self.blocks.block, self.blocks.block) {
                    let reach = Rect::new(block.y, block.x, block.height + 2 * half, block.width + 2 * half);
                    let common = reach.intersect(filled);
                    let reach_stride = reach.width.next_multiple_of(MAX_LANES);
                    window.clear();
                    window.resize(reach_stride * reach.height, 0.0);
                    for y in common.y..common.bottom() {
                        let from = (y - first) as usize * size.width + (common.x - first) as usize;
                        let to = (y - reach.y) as usize * reach_stride + (common.x - reach.x) as usize;
                        window[to..][..common.width].copy_from_slice(&result[from..][..common.width]);
                    }
                    let place = place(frame, &bins, block);
                    let size = image_size(block.height, block.width);
                    ones.resize(size.values(), 1.0);
                    let (weights, spectra) = self.weigh(level, (&place, size), ones, weights);
                    images.clear();
                    images.resize(weights.len(), 0.0);
                    let film = (&window[..], reach_stride);
                    self.columns.correlate_images(film, spectra, (images, size), scratch);
                    for (image, weights) in
                        images.chunks_exact(size.values()).zip(weights.chunks_exact(size.values()))
                    {
                        let lines = image.chunks_exact(size.stride).zip(weights.chunks_exact(size.stride));
                        for (to, (image, weights)) in light.chunks_exact_mut(columns).zip(lines) {
                            let to = &mut to[block.x as usize..][..block.width];
                            to.iter_mut().zip(image).zip(weights).for_each(|((to, v), w)| *to += v * w);
                        }
                    }
                }
                Ok(())
            },
        );
        let Ok(()) = done;
        light
    }
}
