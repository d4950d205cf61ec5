//! The middle part of a band's PSFs ([`crate::lens::middle`]) on the bins of level 0: the sum over polar nodes of the PSF stage, of the light of the bins.
//!
//! By the portable engine: the same bits with any instructions. Nor do they depend on the threads: a thread convolves a row of blocks, and no film row has light of more
//! than two of these. Azimuths are fewer than those of the near kernels: the part is as wide as the blur, and has a few percent of the light.

use super::OUT_MARGIN;
use super::levels::{out_size, part};
use super::plan::TailPlan;
use crate::buffer::{TileBuffer, zeros};
use crate::geometry::{Frame, Rect, Size};
use crate::layer::BinGrid;
use crate::lens::{PsfSample, PsfStack};
use crate::parts::for_each_part;
use crate::psf::gather::GatherScratch;
use crate::psf::grid::NodeGrid;
use crate::psf::kernel::NodeKernels;
use crate::psf::spectra::SpectrumCache;
use crate::psf::{BandPsf, PsfScratch};
use crate::simd::Simd;
use std::convert::Infallible;
use std::sync::Mutex;

/// Azimuths of a height off the axis.
const AZIMUTHS: usize = 48;
/// Bytes of spectra and kernels.
pub(super) const CACHE_BYTES: usize = 48 << 20;
/// Bins in half a window, at least: the core ends over three fifths of it.
const BINS_IN_HALF: f64 = 10.0;
/// Bins of level 1 in the radius of the power laws, at least.
const BINS_IN_RADIUS: f64 = 5.0;
/// Largest kernel, bins a side.
const MAX_KERNEL: usize = 401;
/// Rows of a strip of blocks at most: of the largest transform.
pub(super) const MAX_BLOCK: usize = 1280;

/// Bin for windows of half a side `half_px` and power laws from `inner_px` on, both film pixels, of at most `max_px`; none where it would have less than `min_px`, or kernels would be too
/// large.
pub(super) fn bin_px(
    half_px: f64,
    inner_px: f64,
    (min_px, max_px): (usize, usize),
    growth: usize,
) -> Option<usize> {
    let mut bin = max_px;
    while BINS_IN_HALF * bin as f64 > half_px || BINS_IN_RADIUS * (growth * bin) as f64 > inner_px {
        bin /= 2;
    }
    (bin >= min_px && 2.0 * inner_px / bin as f64 + 2.0 <= MAX_KERNEL as f64).then_some(bin)
}

/// The middle part of a band on the bins of level 0.
pub(super) struct MiddleLevel {
    psf: BandPsf,
    bins: BinGrid,
}

impl MiddleLevel {
    /// That of `plan`, if it has one.
    pub(super) fn new(plan: &TailPlan) -> Option<Self> {
        let (height_mm, middle) = plan.middle()?;
        let (bins, pitch_mm) = (plan.bins(0), plan.bin_mm());
        let azimuths: Vec<usize> = height_mm.iter().map(|h| if *h > 0.0 { AZIMUTHS } else { 1 }).collect();
        let grid = NodeGrid::new(height_mm, &azimuths, pitch_mm);
        let stack = PsfStack {
            size: middle.size,
            pitch_um: 1e3 * middle.pitch_mm,
            sample: PsfSample::Point,
            samples: middle.samples.to_vec(),
        };
        let kernels = NodeKernels::with_shares(stack, middle.shares(), 1e3 * pitch_mm, Simd::PORTABLE);
        Some(Self { psf: BandPsf::new(0, grid, kernels, Simd::PORTABLE), bins })
    }

    /// The bins as a film of their own.
    fn frame(&self, frame: &Frame) -> Frame {
        let BinGrid { bin_px, margin, .. } = self.bins;
        let axis = |px: f64| (px + 0.5) / bin_px as f64 - 0.5 + margin as f64;
        let axis_px = (axis(frame.axis_px.0), axis(frame.axis_px.1));
        Frame { film: self.bins.size(), axis_px, ..*frame }
    }

    /// The first bin of a result, from that of the grid.
    fn first(&self) -> usize {
        self.bins.margin - OUT_MARGIN
    }

    /// The middle part of `light` on the film's bins and [`OUT_MARGIN`] around.
    pub(super) fn convolve(&self, frame: &Frame, light: &[f32], threads: usize) -> Vec<f32> {
        let (frame, cache) = (self.frame(frame), SpectrumCache::new(CACHE_BYTES));
        let (block, reach) = (self.psf.blocks().block, self.psf.margin());
        let Size { height: rows, width: columns } = self.bins.size();
        let stride = columns + 2 * reach;
        let sum = Mutex::new(zeros(stride * (rows + 2 * reach)));
        let done: Result<(), Infallible> = for_each_part(
            threads,
            (0..rows).step_by(block),
            || (PsfScratch::default(), TileBuffer::default()),
            |(scratch, out), top| {
                let strip = Rect::new(top as i64, 0, block.min(rows - top), columns);
                let light = &light[top * columns..][..strip.height * columns];
                self.psf.scatter(&frame, strip, light, &cache, out, scratch);
                let mut sum = sum.lock().expect("no panic while held");
                let lines =
                    sum[top * stride..].chunks_exact_mut(stride).zip(out.data.chunks_exact(out.stride));
                for (to, from) in lines.take(strip.height + 2 * reach) {
                    to.iter_mut().zip(from).for_each(|(to, v)| *to += v);
                }
                Ok(())
            },
        );
        let Ok(()) = done;
        let sum = sum.into_inner().expect("no panic while held");
        part((&sum, stride), reach + self.first(), out_size(&self.bins))
    }

    /// The transpose of [`MiddleLevel::convolve`]: the light of the bins, of `result`.
    pub(super) fn correlate(&self, frame: &Frame, result: &[f32], threads: usize) -> Vec<f32> {
        let (frame, cache) = (self.frame(frame), SpectrumCache::new(CACHE_BYTES));
        let (block, first) = (self.psf.blocks().block, self.first());
        let Size { height: rows, width: columns } = self.bins.size();
        let mut film = zeros(rows * columns);
        let width = out_size(&self.bins).width;
        for (to, from) in film.chunks_exact_mut(columns).skip(first).zip(result.chunks_exact(width)) {
            to[first..first + width].copy_from_slice(from);
        }
        let mut light = zeros(rows * columns);
        let done: Result<(), Infallible> = for_each_part(
            threads,
            light.chunks_mut(block * columns).enumerate(),
            GatherScratch::default,
            |scratch, (row, light)| {
                let strip = Rect::new((row * block) as i64, 0, light.len() / columns, columns);
                for block in strip.tiles(block, block) {
                    let (values, stride) = self.psf.gather(&frame, block, &film, &cache, scratch);
                    let lines = light.chunks_exact_mut(columns).zip(values.chunks_exact(stride));
                    for (to, from) in lines {
                        to[block.x as usize..][..block.width].copy_from_slice(&from[..block.width]);
                    }
                }
                Ok(())
            },
        );
        let Ok(()) = done;
        light
    }
}

#[cfg(test)]
mod tests;
