//! What a film of surfaces at several distances needs, before its lens is traced: the trace of its depth nodes and their bytes in the cache, the film's core
//! seconds, and memory. By the nodes, windows and slabs of the estimate of [`super::lens::estimated`].

use super::arguments::Arguments;
use super::depth::Depth;
use super::film::regions;
use super::inputs::Inputs;
use super::lens::depth_nodes::trace_core_s;
use super::lens::{EstimatedLens, TracedFor, UntracedLens, estimated};
use super::memory::{GpuDemand, Memory, MemoryInputs};
use super::stretch::RemapStretch;
use super::tile_cost::core_s;
use crate::machine::{MAX_DEFAULT, MemoryLimit};
use crate::open::Chart;
use crate::progress::mib;
use anyhow::{Context, Result};
use formats::film::{FilmSpec, FilmStore};
use pipeline::band::{BandPlan, Options};
use pipeline::design::trace::with_threads;
use pipeline::executor::memory::Walk;
use pipeline::field::Outside;
use pipeline::geometry::Frame;
use pipeline::lens::Lens;
use pipeline::remap::ChartInterpolation;
use std::path::Path;

/// A run whose estimate needs more than this times its limit is refused before the trace; with less its memory is planned after it.
const SURELY_TOO_SMALL: f64 = 1.3;

/// Bytes of PSFs in the cache over those before compression: 8.8 of 25.5, 11.7 of 27.9, 1.5 of 3.3 MB.
const COMPRESSED: f64 = 0.4;

/// What the memory of a run depends on.
pub struct MemoryRequest<'a> {
    /// Film and place of the chart.
    pub frame: &'a Frame,
    /// Options of the run.
    pub options: &'a Options,
    /// Its chart.
    pub chart: &'a Chart,
    /// Its surfaces.
    pub depth: &'a Depth,
    /// Layout of its film.
    pub film: &'a FilmSpec,
    /// Path of its film.
    pub path: &'a Path,
    /// Its threads.
    pub threads: usize,
    /// Its limit.
    pub limit: MemoryLimit,
    /// Bytes of reading the PSFs of a band.
    pub psf_reading: usize,
}

impl MemoryRequest<'_> {
    /// Memory of the run of the bands `plans` with `lens`.
    ///
    /// # Errors
    /// Usage: the limit is too small.
    pub fn plan(&self, lens: &Lens, plans: &[BandPlan]) -> Result<Memory> {
        let first = plans.first().context("a run has a band")?;
        let (regions, stretch) = (regions(self.film), RemapStretch::new(self.frame, plans, self.options));
        let nodes = lens.depth.iter().flat_map(|depth| &depth.bands[first.lens_bands.first].nodes);
        let samples = nodes.map(|node| node.psf_height_mm.len() * node.psf_size.pow(2)).max().unwrap_or(0);
        let inputs = MemoryInputs {
            limit: self.limit,
            frame: self.frame,
            options: self.options,
            bands: plans,
            regions: &regions,
            film: self.film,
            threads: self.threads,
            writers: FilmStore::concurrent_writes(self.path),
            chart_rows: &|rows| self.chart.cache_for_rows(rows),
            chunks: self.chart.chunk_memory(&[0]),
            walks: &[(0, Walk::of_all(&first.tiling, &regions))],
            stretch: &stretch,
            psf_reading: &|_| self.psf_reading,
            max_psf_reading: 4 * samples + self.psf_reading,
            layer_making: 0,
            surfaces: if first.depth.is_some() { self.depth.count() } else { 0 },
            surface_caches: self.depth.cache_bytes(depth_rows(plans, &stretch, self.frame)),
        };
        Memory::plan(&inputs, GpuDemand::default())
    }
}

/// Forecast of a run.
pub struct DepthForecast {
    /// Depth nodes of a band.
    nodes: usize,
    /// Bands of the run.
    bands: usize,
    /// Core seconds of the trace of all bands.
    trace_core_s: f64,
    /// Bytes of their PSFs in the cache.
    cache_bytes: f64,
    /// Core seconds of the film.
    pub film_core_s: f64,
    memory: Memory,
}

impl DepthForecast {
    /// Of the run of `arguments` and `inputs` with the film `film`, whose lens is to be traced: none for a lens pack and for a flat chart.
    ///
    /// # Errors
    /// As [`estimated`]; usage: the limit of memory is too small.
    pub fn new(
        (arguments, inputs, film): (&Arguments<'_>, &Inputs, &FilmSpec),
        lens: &UntracedLens,
    ) -> Result<Option<Self>> {
        let (Some(depth), UntracedLens::Design(design)) = (&inputs.depth, lens) else { return Ok(None) };
        let (args, frame) = (arguments.given, &inputs.frame);
        let options = lens.depth_options(&args.surfaces, depth.range)?;
        let traced_for = TracedFor { surfaces: &depth.surfaces, options, before_trace: None };
        let estimate = || {
            estimated((&design.system, &design.name, &args.tracing), frame, &arguments.options, traced_for)
        };
        let found = with_threads(arguments.threads, estimate)?;
        Self::of_nodes((arguments, inputs, film), &found).map(Some)
    }

    /// Of the estimated depth nodes `found`.
    ///
    /// # Errors
    /// Usage: the limit of memory is too small.
    pub fn of_nodes(
        (arguments, inputs, film): (&Arguments<'_>, &Inputs, &FilmSpec),
        found: &EstimatedLens,
    ) -> Result<Self> {
        let (args, frame) = (arguments.given, &inputs.frame);
        let depth = inputs.depth.as_ref().context("surfaces at several distances")?;
        let nm = found.lens.bands[0].wavelength_nm;
        // A trace extends its tables to the film with the margin of its windows.
        let options = with_outside(arguments.options, Outside::Clamp);
        let plan = BandPlan::with_depth(frame, &found.lens, nm, &options, &depth.surfaces)?;
        let (rows, columns) = plan.tiling.count();
        let tiles: Vec<_> = (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))).collect();
        let bands = inputs.selected_nm.len();
        let film_core_s = bands as f64 * core_s(&plan, options.stages, &tiles);
        let plans = vec![plan; bands.max(1)];
        let memory = |limit: MemoryLimit| {
            let request = MemoryRequest {
                frame,
                options: &options,
                chart: &inputs.chart,
                depth,
                film,
                path: &args.film,
                threads: arguments.threads,
                limit,
                psf_reading: 0,
            };
            request.plan(&found.lens, &plans)
        };
        let limit = MemoryLimit::new(args.memory, MAX_DEFAULT);
        let memory = memory(limit).or_else(|too_small| {
            let nearly = memory(limit.times(SURELY_TOO_SMALL)).map_err(|_| too_small)?;
            let limit = usize::try_from(limit.bytes).unwrap_or(usize::MAX);
            Ok::<_, anyhow::Error>(Memory { limit, planned: nearly.planned.min(limit), ..nearly })
        })?;
        Ok(Self {
            nodes: found.lens.depth.iter().flat_map(|depth| &depth.bands).map(|band| band.nodes.len()).sum(),
            bands,
            trace_core_s: bands as f64 * trace_core_s(&found.needed),
            cache_bytes: COMPRESSED * bands as f64 * found.needed.bytes as f64,
            film_core_s,
            memory,
        })
    }

    /// What it says about the trace.
    pub fn trace_text(&self) -> String {
        let Self { nodes, bands, trace_core_s, cache_bytes, .. } = self;
        let each = if *bands > 1 { format!(" in each of {bands} bands") } else { String::new() };
        format!(
            "about {nodes} depth nodes{each}: {trace_core_s:.0} core seconds to trace, {:.2} GB in the cache, unless they are there",
            cache_bytes * 1e-9
        )
    }

    /// What it says about memory.
    pub fn memory_text(&self) -> String {
        format!("{} of at most {}", mib(self.memory.planned), mib(self.memory.limit))
    }

    /// One line about all of it.
    pub fn text(&self) -> String {
        format!(
            "{}; the film about {:.0} core seconds, memory {}",
            self.trace_text(),
            self.film_core_s,
            self.memory_text()
        )
    }
}

/// Rows of the chart under a tile of a depth stage with its margin.
pub fn depth_rows(bands: &[BandPlan], stretch: &RemapStretch, frame: &Frame) -> usize {
    let rows = |band: &BandPlan| band.depth.as_ref().map_or(0, |d| band.tiling.tile() + 2 * d.reach);
    let rows = bands.iter().map(rows).max().unwrap_or(0);
    (rows as f64 * stretch.range.1.max(1.0) / frame.scale.0.min(1.0)) as usize
}

/// `options` with `outside`.
pub fn with_outside(options: Options, outside: Outside) -> Options {
    Options { interpolation: ChartInterpolation { outside, ..options.interpolation }, ..options }
}
