//! Step 5: memory, and GPU queues within it. Under `--device auto` the CPU computes if the memory does not suffice for GPUs.

use super::arguments::Arguments;
use super::bands::JobPlan;
use super::depth::Depth;
use super::depth_forecast::depth_rows;
use super::inputs::Inputs;
use super::stretch::RemapStretch;
use crate::failure;
use crate::job::layers::JobLayer;
use crate::job::memory::{GpuDemand, Memory, MemoryInputs};
use crate::machine::device::DeviceSelection;
use crate::machine::{MAX_DEFAULT, MemoryLimit};
use anyhow::Result;
use formats::film::FilmStore;
use pipeline::band::{BandPlan, Options};
use pipeline::cuda::memory::{BandNeeds, DeviceQueue, MAX_TILES};
use pipeline::executor::memory::Walk;
use pipeline::geometry::{Frame, Size};
use pipeline::psf::cuda::{PsfOnDevice, gpu_blocks};
use pipeline::remap::Remap;
use pipeline::stages;
use pipeline::tiling::{FilmRegion, Tiling, film_columns};

/// One part in so many of the chart under a tile, for the tiles that are not examined.
const CHART_MARGIN: usize = 32;

/// Divides the memory; opens a queue per GPU, none if the CPU computes. May change the device of `arguments`, and the tiles of `plan` to
/// those of a GPU.
///
/// # Errors
/// Memory or GPU too small.
pub fn allocate(
    arguments: &mut Arguments<'_>,
    inputs: &Inputs,
    plan: &mut JobPlan,
    stretch: &RemapStretch,
    layers: &[Box<dyn JobLayer>],
) -> Result<(Memory, Vec<DeviceQueue>)> {
    if !arguments.device.devices.is_empty() {
        let tiles_of_cpu: Vec<_> = plan.bands.iter().map(|band| (band.blocks, band.tiling)).collect();
        set_gpu_tiles(&mut plan.bands, inputs.frame.film);
        match allocate_with_gpus(arguments, inputs, plan, stretch, layers) {
            Err(error) if arguments.device.may_fall_back(&arguments.given.device) => {
                arguments.device = DeviceSelection::cpu(&failure::line(&error));
            }
            planned => return planned,
        }
        for (band, (blocks, tiling)) in plan.bands.iter_mut().zip(tiles_of_cpu) {
            (band.blocks, band.tiling) = (blocks, tiling);
        }
    }
    Ok((divide(arguments, inputs, plan, stretch, layers, GpuDemand::default())?, Vec::new()))
}

fn allocate_with_gpus(
    arguments: &Arguments<'_>,
    inputs: &Inputs,
    plan: &JobPlan,
    stretch: &RemapStretch,
    layers: &[Box<dyn JobLayer>],
) -> Result<(Memory, Vec<DeviceQueue>)> {
    let (device, options) = (&arguments.device, &arguments.options);
    let needs = |band| gpu_needs(&inputs.frame, options, band, &plan.regions);
    let needs: Vec<BandNeeds> = plan.bands.iter().map(needs).collect();
    let gpus = GpuDemand::new(device.devices.len(), &needs);
    let memory = divide(arguments, inputs, plan, stretch, layers, gpus)?;
    let queues = device.queues(&arguments.given.device, &needs, memory.pinned)?;
    Ok((memory, queues))
}

/// Gives every band the tiles of a GPU.
fn set_gpu_tiles(bands: &mut [BandPlan], film: Size) {
    for band in bands {
        band.blocks = band.blocks.as_ref().map(gpu_blocks);
        band.tiling = Tiling::new(film, band.blocks.as_ref());
    }
}

/// Divides the memory.
fn divide(
    arguments: &Arguments<'_>,
    inputs: &Inputs,
    plan: &JobPlan,
    stretch: &RemapStretch,
    layers: &[Box<dyn JobLayer>],
    gpus: GpuDemand,
) -> Result<Memory> {
    let args = arguments.given;
    let chart_rows = |rows: usize| inputs.chart.cache_for_rows(rows);
    let walks = walks(plan);
    let memory = MemoryInputs {
        limit: MemoryLimit::new(args.memory, MAX_DEFAULT),
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
        layer_making: layers.iter().map(|layer| layer.making_bytes()).max().unwrap_or(0),
        surfaces: inputs.depth.as_ref().map_or(0, Depth::count),
        surface_caches: inputs
            .depth
            .as_ref()
            .map_or(0, |depth| depth.cache_bytes(depth_rows(&plan.bands, stretch, &inputs.frame))),
    };
    Memory::plan(&memory, gpus)
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

/// Memory that a band needs on a GPU. The largest rectangle of the chart is taken from nine tiles spread over the film, with a margin; the
/// run itself examines all tiles.
fn gpu_needs(frame: &Frame, options: &Options, plan: &BandPlan, regions: &[FilmRegion]) -> BandNeeds {
    let remap = Remap::new(frame, &plan.lens, options.stages, options.interpolation, 1.0, options.simd);
    let (rows, cols) = plan.tiling.count();
    let spread = |n: usize| [0, n / 2, n - 1];
    let tiles: Vec<_> = spread(rows).iter().flat_map(|&i| spread(cols).map(|j| (i, j))).collect();
    let psf = plan.blocks.as_ref().zip(plan.grid.as_ref());
    let psf = psf.map(|(blocks, grid)| {
        let tile = plan.tiling.tile();
        (
            PsfOnDevice::min_bytes(blocks, grid, tile),
            PsfOnDevice::max_bytes(blocks, grid, tile, MAX_TILES.min(rows * cols)),
        )
    });
    let columns = film_columns(regions);
    let columns = (columns.end - columns.start) as usize;
    let needs = stages::cuda::band_needs(&remap, &plan.tiling, tiles.iter(), columns, psf);
    BandNeeds { chart_px: needs.chart_px + needs.chart_px / CHART_MARGIN, ..needs }
}
