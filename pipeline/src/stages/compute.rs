//! Interface between executor and optics: the stages of a band, and the contribution of one tile.
//!
//! [`super::StageCompute`] implements [`Compute`]; [`Compute::begin_on_gpu`] opens the same band on a GPU, whose batches
//! the executor's GPU queue schedules.

use crate::buffer::{ShardPixels, TileBuffer};
use crate::clock::Clock;
use crate::cuda::memory::QueueMemory;
use crate::cuda::{CudaError, Device};
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Rect, Size};
use crate::stages::cuda::band::GpuBand;
use crate::tiling::Tiling;
use std::sync::Arc;

/// Remap and PSF stages of a job. Called from many threads at once.
pub trait Compute: Sync {
    /// The stages of one band, ready to run.
    type Band: Send + Sync;
    /// Buffers of one worker: no allocation after the first tile of a band.
    type Scratch: Default;

    /// Intermediate results (node spectra) built so far.
    fn spectra_built(&self) -> u64;

    /// Constructs the stages of the band at a position of the job.
    ///
    /// # Errors
    /// The band cannot be computed.
    fn prepare(&self, position: usize) -> Result<Self::Band, SourceSinkError>;

    /// Computes the contribution of the film rectangle `tile` (margin included) from band `chart_band` of `chart` into `out`, which
    /// becomes the tile with its tail. Time is counted on `clock`.
    ///
    /// # Errors
    /// Those of `chart`.
    #[allow(
        clippy::too_many_arguments,
        reason = "band, chart, tile, output, scratch and clock are independent"
    )]
    fn compute(
        &self,
        band: &Self::Band,
        chart: &dyn ChartSource,
        chart_band: usize,
        tile: Rect,
        out: &mut TileBuffer,
        scratch: &mut Self::Scratch,
        clock: &Clock,
    ) -> Result<(), SourceSinkError>;

    /// Adds to the pixels of a shard on the film rectangle `rect` what is added once, after the contributions of all tiles.
    fn finish(&self, band: &Self::Band, rect: Rect, pixels: &mut ShardPixels);

    /// Approximate rectangle of a chart of size `chart` under the film rectangle `tile`, for prefetching.
    fn chart_hint(&self, band: &Self::Band, chart: Size, tile: Rect) -> Rect;

    /// The chart rectangle that a GPU needs for the film rectangle `tile`; it may lie outside the chart.
    fn chart_rect(&self, band: &Self::Band, tile: Rect) -> Rect;

    /// Fills `out` (row-major) with band `chart_band` of `chart` on `rect`, its surround where `rect` lies outside.
    ///
    /// # Errors
    /// Those of `chart`.
    fn read_chart(
        &self,
        band: &Self::Band,
        chart: &dyn ChartSource,
        chart_band: usize,
        rect: Rect,
        out: &mut [f32],
        scratch: &mut Self::Scratch,
    ) -> Result<(), SourceSinkError>;

    /// The stages of `band` with tiles of `tiling` on the GPU `device`, for a queue of `memory`.
    ///
    /// # Errors
    /// Those of the driver; too little memory.
    fn begin_on_gpu(
        &self,
        band: &Self::Band,
        tiling: &Tiling,
        device: &Arc<Device>,
        memory: &QueueMemory,
    ) -> Result<GpuBand, CudaError>;
}
