//! The convolutions of the levels of a band's tails: of a block of bins, one image a harmonic ([`harmonics`]).
//!
//! By the transforms of the SIMD engines of the PSF stage, on registers that round products: the bits do not depend on the instructions. Nor on the
//! threads: a thread convolves a row of blocks, and no film row has light of more than two of these.

use super::OUT_MARGIN;
use super::harmonics;
use super::levels::{out_size, part};
use super::middle::MiddleLevel;
use super::plan::TailPlan;
use super::weights::{BlockWeights, image_size};
use crate::buffer::AlignedBuf;
use crate::geometry::{Frame, Rect, Size};
use crate::layer::BinGrid;
use crate::parts::for_each_part;
use crate::psf::blocks::Blocks;
use crate::psf::polar::BlockPlace;
use crate::psf::simd::Columns;
use crate::psf::simd::images::ImageSize;
use crate::simd::lanes::{Dispatch, Lanes, MAX_LANES};
#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512, Unfused};
use crate::simd::{Isa, Plain, Simd};
use std::convert::Infallible;
use std::sync::Mutex;

/// The kernels of a band's tails, and how they are convolved. They depend on the lens, the pitch and the size of the film, not on its place in the field.
pub(super) trait ConvolveLevels: Send + Sync {
    /// T_l ∗ `lights[l]` of all levels l, of level 0 the middle part if there is one, each on the film's bins of its level and [`OUT_MARGIN`] around.
    fn levels(&self, frame: &Frame, lights: Vec<Vec<f32>>, threads: usize) -> Vec<Vec<f32>>;

    /// The transpose of [`ConvolveLevels::levels`]: the light of each level, of its result.
    fn lights(&self, frame: &Frame, results: Vec<Vec<f32>>, threads: usize) -> Vec<Vec<f32>>;
}

/// The kernels of `plan`.
pub(super) fn kernels(plan: &TailPlan, simd: Simd) -> Box<dyn ConvolveLevels> {
    match simd.isa() {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => Box::new(Engine::<Unfused<Avx512>>::new(plan, simd)),
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => Box::new(Engine::<Unfused<Avx2>>::new(plan, simd)),
        _ => Box::new(Engine::<Plain>::new(plan, simd)),
    }
}

/// The engine of a band's tails.
pub(super) struct Engine<V: Lanes> {
    pub(super) plan: TailPlan,
    pub(super) blocks: Blocks,
    pub(super) columns: Columns<V>,
    dispatch: Dispatch<V>,
    /// Of level 0, and of level 1 if there is one, whose kernels all further levels have.
    of_levels: Vec<LevelKernels>,
    /// What level 0 has in place of kernels.
    middle: Option<MiddleLevel>,
}

/// The kernels of a level.
#[derive(Default)]
struct LevelKernels {
    /// Spectra of the kernels over their largest values.
    spectra: Vec<AlignedBuf>,
    /// These values.
    peaks: Vec<f64>,
}

impl<V: Lanes> Engine<V> {
    fn new(plan: &TailPlan, simd: Simd) -> Self {
        let blocks = plan.blocks();
        // Rows of blocks then overlap their neighbours alone.
        assert!(blocks.block >= 2 * plan.half(), "{blocks:?}");
        let columns = Columns::new(&blocks, simd);
        let mut scratch = columns.scratch();
        let mut of_level = |level: usize| {
            let (images, peaks): (Vec<_>, Vec<_>) = harmonics::images(plan, level).into_iter().unzip();
            let spectrum = |image: Vec<f64>| {
                let image: Vec<f32> = image.into_iter().map(|v| v as f32).collect();
                columns.spectrum(&image, &mut scratch, AlignedBuf::default())
            };
            LevelKernels { spectra: images.into_iter().map(spectrum).collect(), peaks }
        };
        let middle = MiddleLevel::new(plan);
        let of_levels = middle.iter().map(|_| LevelKernels::default());
        let of_levels = of_levels.chain(plan.of_tails().map(&mut of_level)).collect();
        Self { plan: plan.clone(), blocks, columns, dispatch: Dispatch::new(simd), of_levels, middle }
    }

    /// `light`, an image of `size` of the bins at `place` of `level`, times the weights of each kernel, in `weights`: these images, and the spectra of the kernels.
    pub(super) fn weigh<'a>(
        &'a self,
        level: usize,
        place: (&BlockPlace, ImageSize),
        light: &[f32],
        weights: &'a mut BlockWeights,
    ) -> (&'a mut [f32], impl Iterator<Item = &'a AlignedBuf>) {
        let kernels = &self.of_levels[level.min(1)];
        weights.of_block(self.dispatch, &self.plan, (level, &kernels.peaks), place, light);
        let BlockWeights { kernels: of_block, values, .. } = weights;
        (values, of_block.iter().map(|k| &kernels.spectra[*k]))
    }

    /// T_l ∗ `light` on the film's bins of `level` and [`OUT_MARGIN`] around.
    fn convolve(&self, frame: &Frame, level: usize, light: &[f32], threads: usize) -> Vec<f32> {
        let plan = &self.plan;
        let bins = plan.bins(level);
        let (Size { height: rows, width: columns }, half) = (bins.size(), plan.half());
        let stride = row_stride(columns, half);
        let sum = Mutex::new(crate::buffer::zeros(stride * (rows + 2 * half)));
        let done: Result<(), Infallible> = for_each_part(
            threads,
            (0..rows).step_by(self.blocks.block),
            || (BlockWeights::default(), self.columns.scratch(), Vec::new(), Vec::new()),
            |(weights, scratch, image, out), top| {
                let height = self.blocks.block.min(rows - top);
                out.clear();
                out.resize(stride * (height + 2 * half), 0.0);
                for block in
                    Rect::new(top as i64, 0, height, columns).tiles(self.blocks.block, self.blocks.block)
                {
                    let (x, size) = (block.x as usize, image_size(height, block.width));
                    // Nothing of the block before: a dark block is left out.
                    image.clear();
                    image.resize(size.values(), 0.0);
                    let lines = light.chunks_exact(columns).skip(top);
                    for (to, line) in image.chunks_exact_mut(size.stride).zip(lines) {
                        to[..block.width].copy_from_slice(&line[x..][..block.width]);
                    }
                    if image.iter().all(|v| *v == 0.0) {
                        continue;
                    }
                    let place = place(frame, &bins, block);
                    let (images, spectra) = self.weigh(level, (&place, size), image, weights);
                    self.columns.convolve_images((images, size), spectra, (&mut out[x..], stride), scratch);
                }
                let mut sum = sum.lock().expect("no panic while held");
                sum[top * stride..].iter_mut().zip(&*out).for_each(|(to, v)| *to += v);
                Ok(())
            },
        );
        let Ok(()) = done;
        // The first value is `half` bins before the first bin of the grid.
        let first = half + bins.margin - OUT_MARGIN;
        let sum = sum.into_inner().expect("no panic while held");
        part((&sum, stride), first, out_size(&bins))
    }
}

impl<V: Lanes> ConvolveLevels for Engine<V> {
    fn levels(&self, frame: &Frame, lights: Vec<Vec<f32>>, threads: usize) -> Vec<Vec<f32>> {
        let of_level = |(level, light): (usize, Vec<f32>)| match &self.middle {
            Some(middle) if level == 0 => middle.convolve(frame, &light, threads),
            _ => self.convolve(frame, level, &light, threads),
        };
        lights.into_iter().enumerate().map(of_level).collect()
    }

    fn lights(&self, frame: &Frame, results: Vec<Vec<f32>>, threads: usize) -> Vec<Vec<f32>> {
        let of_level = |(level, result): (usize, Vec<f32>)| match &self.middle {
            Some(middle) if level == 0 => middle.correlate(frame, &result, threads),
            _ => self.correlate(frame, level, &result, threads),
        };
        results.into_iter().enumerate().map(of_level).collect()
    }
}

/// A block of `bins`, in bins from the axis.
pub(super) fn place(frame: &Frame, bins: &BinGrid, block: Rect) -> BlockPlace {
    let axis = |px: f64| (px + 0.5) / bins.bin_px as f64 - 0.5;
    BlockPlace {
        dy_px: (block.y - bins.margin as i64) as f64 - axis(frame.axis_px.0),
        dx_px: (block.x - bins.margin as i64) as f64 - axis(frame.axis_px.1),
        rows: block.height,
        cols: block.width,
    }
}

/// Values of a row of the sum of a level of `columns` bins and kernels of `half` bins a side: its results, and what an engine adds beyond.
pub(super) fn row_stride(columns: usize, half: usize) -> usize {
    columns + 2 * half + MAX_LANES
}
