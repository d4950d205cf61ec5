//! Step 4: memory, and GPU queues within it. Under `--device auto` the CPU computes if the memory does not suffice for GPUs.

use super::arguments::Arguments;
use super::bands::JobPlan;
use super::depth::Depth;
use super::inputs::Inputs;
use super::stretch::RemapStretch;
use crate::device::DeviceSelection;
use crate::failure;
use crate::memory::{GpuDemand, Memory, MemoryInputs, default_limit};
use anyhow::Result;
use formats::film::FilmStore;
use pipeline::band::{BandPlan, Options};
use pipeline::cuda;
use pipeline::cuda::memory::{BandNeeds, DeviceQueue};
use pipeline::executor::memory::Walk;
use pipeline::geometry::Frame;
use pipeline::psf::cuda::PsfOnDevice;
use pipeline::remap::Remap;

/// Divides the memory; opens a queue per GPU, none if the CPU computes. May change the device of `arguments`.
///
/// # Errors
/// Memory or GPU too small.
pub fn allocate(
    arguments: &mut Arguments<'_>,
    inputs: &Inputs,
    plan: &JobPlan,
    stretch: &RemapStretch,
) -> Result<(Memory, Vec<DeviceQueue>)> {
    let args = arguments.given;
    let chart_rows = |rows: usize| inputs.chart.cache_for_rows(rows);
    let walks = walks(plan);
    let memory = MemoryInputs {
        limit: args.memory.unwrap_or_else(default_limit),
        frame: &inputs.frame,
        options: &arguments.options,
        bands: &plan.bands,
        regions: &plan.regions,
        film: &plan.film,
        threads: arguments.threads,
        writers: FilmStore::concurrent_writes(&args.film),
        chart_rows: &chart_rows,
        chunks: inputs.chart.chunk_memory(&inputs.chart_bands()),
        walks: &walks,
        stretch,
        psf_reading: &|p: &BandPlan| plan.lens.psf_reading_bytes(p.lens_bands.first),
        max_psf_reading: plan.lens.max_reading_bytes(),
        surfaces: inputs.depth.as_ref().map_or(0, Depth::count),
        surface_caches: inputs
            .depth
            .as_ref()
            .map_or(0, |depth| depth.cache_bytes(depth_rows(plan, stretch, &inputs.frame))),
    };
    let device = &mut arguments.device;
    let without_gpus = || Ok((Memory::plan(&memory, GpuDemand::default())?, Vec::new()));
    if device.devices.is_empty() {
        return without_gpus();
    }
    let needs: Vec<BandNeeds> =
        plan.bands.iter().map(|band| gpu_needs(&inputs.frame, &arguments.options, band)).collect();
    let gpus = GpuDemand::new(device.devices.len(), &needs);
    let with_gpus = Memory::plan(&memory, gpus).and_then(|planned| {
        let queues = device.queues(&args.device, &needs, planned.pinned)?;
        Ok((planned, queues))
    });
    match with_gpus {
        Err(error) if device.may_fall_back(&args.device) => {
            *device = DeviceSelection::cpu(&failure::line(&error));
            without_gpus()
        }
        planned => planned,
    }
}

/// Rows of the chart under a tile of a depth stage with its margin.
pub fn depth_rows(plan: &JobPlan, stretch: &RemapStretch, frame: &Frame) -> usize {
    let rows = |band: &BandPlan| band.depth.as_ref().map_or(0, |d| band.tiling.tile() + 2 * d.margin());
    let rows = plan.bands.iter().map(rows).max().unwrap_or(0);
    (rows as f64 * stretch.range.1.max(1.0) / frame.scale.0.min(1.0)) as usize
}

/// Order of the tiles of the first band with each tiling.
fn walks(plan: &JobPlan) -> Vec<(usize, Walk)> {
    let mut walks: Vec<(usize, Walk)> = Vec::new();
    for (band, tiling) in plan.bands.iter().map(|band| &band.tiling).enumerate() {
        if walks.iter().all(|(other, _)| plan.bands[*other].tiling != *tiling) {
            walks.push((band, Walk::of_all(tiling, &plan.regions)));
        }
    }
    walks
}

/// Memory that a band needs on a GPU. The largest rectangle of the chart is taken from nine tiles spread over the film; the run itself
/// examines all tiles.
fn gpu_needs(frame: &Frame, options: &Options, plan: &BandPlan) -> BandNeeds {
    let remap = Remap::new(frame, &plan.lens, options.stages, options.interpolation, 1.0, options.simd);
    let (rows, cols) = plan.tiling.count();
    let spread = |n: usize| [0, n / 2, n - 1];
    let tiles: Vec<_> = spread(rows).iter().flat_map(|&i| spread(cols).map(|j| (i, j))).collect();
    let psf = plan.blocks.as_ref().zip(plan.grid.as_ref());
    let min_psf = psf.map(|(blocks, grid)| PsfOnDevice::min_bytes(blocks, grid, plan.tiling.tile()));
    cuda::band_needs(&remap, &plan.tiling, tiles.iter(), min_psf)
}
