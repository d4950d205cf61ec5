//! Remap and PSF stages of a job, or its depth stage, as the executor's [`Compute`], on the CPU or on a GPU; and the memory they take.

mod compute;
pub mod cuda;
mod description;

pub use compute::Compute;
pub use description::{Cost, DESCRIPTIONS, Description, default_stages, described, flags_of};

use crate::band::{BandPlan, BandStages};
use crate::buffer::{ShardPixels, TileBuffer};
use crate::clock::{Clock, Phase};
use crate::cuda::memory::QueueMemory;
use crate::cuda::{CudaError, Device};
use crate::depth::{DepthScratch, SceneInputs};
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Frame, Rect, Size};
use crate::psf::PsfScratch;
use crate::psf::spectra::SpectrumCache;
use crate::remap::RemapScratch;
use crate::stages::cuda::band::GpuBand;
use crate::tiling::Tiling;
use std::sync::Arc;

/// Constructs the stages of the band at a position of the job.
pub type Prepare<'a> = dyn Fn(usize) -> Result<BandStages, SourceSinkError> + Sync + 'a;

/// Remap and PSF stages of a job.
pub struct StageCompute<'a> {
    frame: Frame,
    prepare: &'a Prepare<'a>,
    spectra: Arc<SpectrumCache>,
    surfaces: SceneInputs<'a>,
}

/// Buffers of one worker.
#[derive(Debug, Default)]
pub struct StageScratch {
    remapped: Vec<f32>,
    remap: RemapScratch,
    psf: PsfScratch,
    depth: DepthScratch,
}

impl<'a> StageCompute<'a> {
    /// For the film of `frame`, with a cache of `spectra_bytes` for node spectra; `prepare` constructs the stages of a band.
    pub fn new(frame: Frame, spectra_bytes: usize, prepare: &'a Prepare<'a>) -> Self {
        Self::with_spectra(frame, Arc::new(SpectrumCache::in_turn(spectra_bytes)), prepare)
    }

    /// As [`StageCompute::new`], with `spectra` that other computations with the same stages have used.
    pub fn with_spectra(frame: Frame, spectra: Arc<SpectrumCache>, prepare: &'a Prepare<'a>) -> Self {
        Self { frame, prepare, spectra, surfaces: SceneInputs::default() }
    }

    /// With `surfaces` for bands with a depth stage.
    pub fn with_surfaces(self, surfaces: SceneInputs<'a>) -> Self {
        Self { surfaces, ..self }
    }
}

impl Compute for StageCompute<'_> {
    type Band = BandStages;
    type Scratch = StageScratch;

    fn spectra_built(&self) -> u64 {
        self.spectra.built()
    }

    fn prepare(&self, position: usize) -> Result<BandStages, SourceSinkError> {
        (self.prepare)(position)
    }

    fn compute(
        &self,
        band: &BandStages,
        chart: &dyn ChartSource,
        chart_band: usize,
        tile: Rect,
        out: &mut TileBuffer,
        scratch: &mut StageScratch,
        clock: &Clock,
    ) -> Result<(), SourceSinkError> {
        let StageScratch { remapped, remap, psf, depth } = scratch;
        if let Some(stage) = &band.depth {
            let (frame, surfaces, spectra) = (&self.frame, self.surfaces, &self.spectra);
            return stage.compute(frame, chart, chart_band, surfaces, tile, spectra, out, depth, clock);
        }
        remapped.resize(tile.size().pixels(), 0.0);
        clock.of(Phase::Remap).time(|| band.remap.apply(chart, chart_band, tile, remapped, remap))?;
        clock.of(Phase::Svpsf).time(|| match &band.psf {
            Some(stage) => {
                stage.scatter(&self.frame, tile, remapped, &self.spectra, out, psf);
                stage.check_read()
            }
            None => {
                out.copy(remapped, tile.width);
                Ok(())
            }
        })
    }

    fn finish(&self, band: &BandStages, rect: Rect, pixels: &mut ShardPixels) {
        band.layers.iter().for_each(|layer| layer.add(rect, pixels));
    }

    fn chart_hint(&self, band: &BandStages, chart: Size, tile: Rect) -> Rect {
        band.remap.approx_chart_rect(chart, tile)
    }

    fn chart_rect(&self, band: &BandStages, tile: Rect) -> Rect {
        band.remap.upload_rect(tile)
    }

    fn read_chart(
        &self,
        band: &BandStages,
        chart: &dyn ChartSource,
        chart_band: usize,
        rect: Rect,
        out: &mut [f32],
        scratch: &mut StageScratch,
    ) -> Result<(), SourceSinkError> {
        band.remap.fill(chart, chart_band, rect, out, &mut scratch.remap)
    }

    fn begin_on_gpu(
        &self,
        band: &BandStages,
        tiling: &Tiling,
        device: &Arc<Device>,
        memory: &QueueMemory,
    ) -> Result<GpuBand, CudaError> {
        GpuBand::new(&self.frame, band, tiling, device, memory)
    }
}

/// Bytes of a remapped tile.
pub fn remapped_bytes(plan: &BandPlan) -> usize {
    4 * plan.tiling.tile().pow(2)
}

/// Bytes of a tile's contribution: the tile and its tail, rows padded to whole cache lines.
pub fn contribution_bytes(plan: &BandPlan) -> usize {
    let side = plan.tiling.tile() + 2 * plan.tiling.margin();
    4 * side * (side + 15).next_multiple_of(16)
}
