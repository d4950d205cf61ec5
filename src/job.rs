//! A job, resolved from its arguments before any pixel is computed, in six steps:
//!
//! ```text
//! Opened       chart, lens, names of the surfaces' arrays                  inputs
//! Arguments    device, engine, options                                     arguments
//! Inputs       bands, film geometry, surfaces                              inputs, frame, depth
//! UntracedJob  lens that is not traced yet, layers of stray light, film    ghosts, veil, film
//! JobPlan      lens at the job's wavelengths, band plans, tails            bands, tails
//! resources    memory, GPU queues                                          resources, stretch
//! ```
//! then its identity (`identity`) and the notes to print (`notes`). Every error that can be found early is found here.

pub mod arguments;
pub mod arrays;
mod bands;
pub mod cost;
mod coverage;
pub mod depth;
pub mod depth_forecast;
mod field_height;
mod film;
pub mod film_engine;
mod frame;
pub mod ghosts;
mod identity;
pub mod inputs;
mod keys;
pub mod layers;
pub mod lens;
pub mod light_units;
pub mod memory;
mod notes;
mod numeric_version;
mod own_layers;
pub mod preview;
pub mod recorded_lens;
mod reduced;
mod resources;
mod scatter;
pub mod stages;
pub mod stretch;
mod tails;
mod tile_cost;
mod veil;
mod window_light;

pub use arguments::default_options;
pub use bands::PlannedBands;
pub use identity::{Contents, KERNELS_VERSION, contents};
pub use inputs::chosen_bands;
pub use keys::{DIGEST, GHOSTS, MTIMES, SAMPLE, argument};
pub use numeric_version::numeric_version;
pub use tails::{TAILS, tail_bins_px};

use crate::args::engine::Engine;
use crate::args::{Device, RunArgs};
use crate::job::layers::JobLayer;
use crate::job::lens::known::KnownLenses;
use crate::job::lens::request::difference;
use crate::job::lens::{JobLens, UntracedLens};
use crate::job::memory::{Memory, least};
use crate::machine::{MAX_DEFAULT, MemoryLimit, excess_note};
use crate::open::{self, Chart};
use anyhow::{Context, Result};
use arguments::Arguments;
use bands::JobPlan;
use coverage::Coverage;
use depth_forecast::DepthForecast;
use formats::chart::ArrayChart;
use formats::film::FilmSpec;
use identity::Effects;
use inputs::{Inputs, Opened};
use keys::FileState;
use pipeline::band::{BandPlan, Options};
use pipeline::cuda::memory::DeviceQueue;
use pipeline::geometry::Frame;
use pipeline::tiling::FilmRegion;
use reduced::ReducedCharts;
use serde_json::{Map, Value};
use std::sync::Arc;
use stretch::RemapStretch;
use tails::JobTail;

/// Key of the record of a design in the attribute `source` of a film.
const LENS_REQUEST: &str = "lens_request";

/// A job, ready to run. A *position* is the index of a band among those that this process computes.
pub struct Job {
    /// The chart.
    pub chart: Chart,
    /// The lens.
    pub lens: JobLens,
    /// Surfaces at several distances.
    pub depth: Option<depth::Depth>,
    /// Film, axis, placement of the chart.
    pub frame: Frame,
    /// Stages, interpolation and accuracy.
    pub options: Options,
    /// Band of the chart per position.
    pub chart_bands: Vec<usize>,
    /// Band of the film per position.
    pub film_bands: Vec<usize>,
    /// Plan per position.
    pub plans: Vec<BandPlan>,
    /// Film value per chart value on the axis, per position.
    pub gains: Vec<f64>,
    /// Layout of the film.
    pub film: FilmSpec,
    /// Layers of light of the film, in the order of its layout.
    pub layers: Vec<Box<dyn JobLayer>>,
    /// Reduced charts, of which the layers are computed.
    pub reduced: ReducedCharts,
    /// Regions of the film to compute.
    pub regions: Vec<FilmRegion>,
    /// Everything that changes pixels, as readable JSON.
    pub identity: Map<String, Value>,
    /// Where chart and lens are and what they are, for people; not part of the identity.
    pub source: Value,
    /// Memory plan.
    pub memory: Memory,
    /// Worker threads.
    pub threads: usize,
    /// Queues of the GPUs that compute; empty: the workers compute.
    pub queues: Vec<DeviceQueue>,
    /// Implementation of the arithmetic.
    pub engine: Engine,
    /// Size of the chart and its share of the lens's field, for the user.
    pub coverage: String,
    /// Notes to print before the run.
    pub notes: Vec<String>,
    /// Notes to print with `--verbose`.
    pub details: Vec<String>,
}

impl Job {
    /// Resolves `args` for some bands of a plan. Film and identity are those of the complete job.
    ///
    /// # Errors
    /// Every error of the run that can be found before its first pixel; a chart with fewer bands than planned (exit code 3).
    pub fn for_planned_bands(args: &RunArgs, planned: PlannedBands<'_>) -> Result<Self> {
        UntracedJob::resolve(args, Some(planned))?.traced()
    }

    /// Resolves `args` for arrays in memory, which no film in a store is for; its lens is one of `known`, or kept there.
    ///
    /// # Errors
    /// As [`Job::for_planned_bands`].
    pub fn of_arrays(args: &RunArgs, chart: ArrayChart, known: &Arc<KnownLenses>) -> Result<Self> {
        let opened = Opened::with_chart(args, Chart::Array(Box::new(chart)))?.among(known);
        UntracedJob::resolve_opened(args, opened, None)?.traced()
    }

    /// The device that computes, in the form of `--device`.
    pub fn device(&self) -> String {
        let indices = self.queues.iter().map(|q| q.device.index()).collect();
        match self.queues.is_empty() {
            true => Device::Cpu.to_string(),
            false => Device::Cuda(indices).to_string(),
        }
    }
}

/// A job before its lens is traced: what is known without that, for checks before it.
pub struct UntracedJob<'a> {
    args: &'a RunArgs,
    planned: Option<PlannedBands<'a>>,
    arguments: Arguments<'a>,
    inputs: Inputs,
    lens: UntracedLens,
    /// Whether the film has the tails of PSFs, of bands that have any.
    has_tails: bool,
    layers: Vec<Box<dyn JobLayer>>,
    /// Layout of the film.
    pub film: FilmSpec,
}

impl<'a> UntracedJob<'a> {
    /// Resolves `args` up to the trace of its lens.
    ///
    /// # Errors
    /// Every error of the run that can be found without tracing.
    pub fn new(args: &'a RunArgs) -> Result<Self> {
        Self::resolve(args, None)
    }

    /// Whether its lens is a pack.
    pub fn has_pack(&self) -> bool {
        matches!(self.lens, UntracedLens::Pack(_))
    }

    /// Whether the surfaces of its chart lie at several distances.
    pub fn has_distances(&self) -> bool {
        self.inputs.depth.is_some()
    }

    fn resolve(args: &'a RunArgs, planned: Option<PlannedBands<'a>>) -> Result<Self> {
        Self::resolve_opened(args, Opened::new(args)?, planned)
    }

    fn resolve_opened(args: &'a RunArgs, opened: Opened, planned: Option<PlannedBands<'a>>) -> Result<Self> {
        let arguments = Arguments::resolve(args, opened.has_depth(), opened.on_cpu())?;
        let (inputs, lens) = Inputs::new(args, opened, planned.map(|p| p.bands))?;
        let layers = own_layers::layers(args, &inputs, &lens, arguments.threads)?;
        let film = film::film_spec(&arguments, &inputs.frame, inputs.selected_nm.clone(), &inputs, &layers)?;
        window_light::check_pitch(args, &lens)?;
        let has_tails = tails::has_tails(args, inputs.depth.is_some(), &lens)?;
        Ok(Self { args, planned, arguments, inputs, lens, has_tails, layers, film })
    }

    /// What it needs, if it has surfaces at several distances and a lens to be traced for them.
    ///
    /// # Errors
    /// As [`DepthForecast::new`].
    pub fn depth_forecast(&self) -> Result<Option<DepthForecast>> {
        DepthForecast::new((&self.arguments, &self.inputs, &self.film), &self.lens)
    }

    /// What GPUs do not compute of it.
    pub fn on_cpu(&self) -> Option<&str> {
        self.arguments.on_cpu.as_deref()
    }

    /// Name of its lens.
    pub fn lens_name(&self) -> &str {
        self.lens.name()
    }

    /// Its threads.
    pub fn threads(&self) -> usize {
        self.arguments.threads
    }

    /// Whether its lens is a design, which is traced unless its bands are in the cache.
    pub fn is_design(&self) -> bool {
        matches!(self.lens, UntracedLens::Design(_))
    }

    /// Bytes of the film before compression, and of the temporary file of the chart's bands beside it.
    pub fn bytes(&self) -> (u64, u64) {
        let pixels: u64 = self.film.outputs.iter().map(|output| output.rect.size().pixels() as u64).sum();
        let bands = self.inputs.chart_bands();
        let film = pixels * self.film.sample.bytes() as u64 * bands.len() as u64;
        (film, self.inputs.chart.temporary_bytes(&bands))
    }

    /// Why the lens of a film with the attribute `source` is not that of this job, as far as that is known before it is traced.
    pub fn lens_difference(&self, source: &Value) -> Option<String> {
        difference(source.get(LENS_REQUEST)?, &self.lens.request(self.args)?)
    }

    /// The identity of the job with the lens of `recorded`, without the state of the chart's files where their content identifies them.
    ///
    /// # Errors
    /// The chart's chunks cannot be listed.
    pub fn identity_with_lens_of(&self, recorded: &Map<String, Value>) -> Result<Map<String, Value>> {
        let text = |key: &str| recorded.get(key).and_then(Value::as_str).unwrap_or_default();
        let lens = (text("lens_name"), text("lens_digest"));
        let stages = self.arguments.options.stages;
        let by_content = self.arguments.files == FileState::Digest;
        let effects = Effects {
            keep_bits: self.film.keep_bits,
            has_tails: self.has_tails,
            is_coarse: recorded.contains_key(KERNELS_VERSION.0),
        };
        let mut map = identity::identity(
            self.args,
            stages,
            &self.inputs,
            effects,
            lens,
            if by_content { FileState::Times } else { self.arguments.files },
        )?;
        if by_content {
            map.remove(MTIMES);
            map.extend(recorded.get(DIGEST).map(|digest| (DIGEST.to_owned(), digest.clone())));
        }
        Ok(map)
    }

    /// The job with its lens, which is traced if it is a design.
    ///
    /// # Errors
    /// Every other error of the run that can be found before its first pixel.
    pub fn traced(self) -> Result<Job> {
        let Self { args, planned, mut arguments, mut inputs, lens, has_tails, mut layers, film } = self;
        if matches!(lens, UntracedLens::Design(_)) {
            let chunks = inputs.chart.chunk_memory(&inputs.chart_bands());
            let limit = MemoryLimit::new(args.memory, MAX_DEFAULT);
            let of_film = (&film, inputs.film_bands.len(), &film::regions(&film)[..]);
            least::check(limit, of_film, chunks, arguments.threads)?;
        }
        let request = lens.request(args);
        let mut plan = JobPlan::new(&arguments, &inputs, lens, film)?;
        if has_tails {
            plan.add_tails(&inputs, &arguments.options);
        }
        let tail_bins_px = planned.map_or(&[][..], |planned| planned.tail_bins_px);
        if let Some(tail) = JobTail::new(&plan, &inputs, tail_bins_px, arguments.threads) {
            // Added before the veil.
            plan.film.layers.insert(0, tail.stored().clone());
            layers.insert(0, Box::new(tail));
        }
        window_light::check(args, &plan.bands)?;
        let stretch = RemapStretch::new(&inputs.frame, &plan.bands, &arguments.options);
        let chart_bands = inputs.chart_bands();
        open::read_past_page_cache(&mut inputs.chart, &chart_bands, arguments.threads);
        let (memory, queues) = resources::allocate(&mut arguments, &inputs, &mut plan, &stretch, &layers)?;
        inputs.chart.set_cache_bytes(memory.chart_cache);
        if let Some(depth) = &mut inputs.depth {
            depth.set_cache_for_rows(depth_forecast::depth_rows(&plan.bands, &stretch, &inputs.frame));
        }
        let max = film::max_chart_value(&plan.gains);
        inputs.chart.limit_values(max)?;
        inputs.depth.as_mut().map_or(Ok(()), |depth| depth.limit_values(max))?;
        let lens_digest = match planned {
            None => plan.lens.digest().map(str::to_owned),
            Some(planned) => planned.lens_digest(&plan.lens, &plan.bands),
        };
        let lens = (plan.lens.lens().name.as_str(), &*lens_digest.context("reading the lens pack")?);
        // A plan of a program before these kernels has none: the identity then differs from its film's.
        let is_coarse =
            planned.is_some_and(|planned| planned.is_coarse) || plan.bands.iter().any(BandPlan::is_coarse);
        let identity = identity::identity(
            args,
            arguments.options.stages,
            &inputs,
            Effects { keep_bits: plan.film.keep_bits, has_tails, is_coarse },
            lens,
            arguments.files,
        )?;
        let reduced = match layers.is_empty() {
            true => ReducedCharts::none(),
            false => ReducedCharts::new(&inputs.chart, inputs.depth.as_ref(), args.nan)?,
        };
        let mut notes = notes::notes(args, &inputs.chart, &plan)?;
        notes.extend(tails::note(args, &plan, inputs.depth.is_some()));
        let coverage = Coverage::new(args, &inputs, &plan);
        notes.extend(coverage.note(args));
        notes.append(&mut inputs.depth_notes);
        notes.extend(stretch.note());
        notes.extend(excess_note(memory.planned));
        let device = arguments.device;
        let mut details = plan.lens.details().to_vec();
        // What GPUs do not compute is on the CPU whatever devices there are.
        match args.device == Device::Auto && arguments.on_cpu.is_none() {
            true if device.no_gpu => details.push(device.reason),
            true => notes.push(device.reason),
            false => {}
        }
        notes.extend(device.notes);
        let mut source = identity::source(args, &inputs.chart);
        if plan.lens.is_sealed() {
            source["lens"] = plan.lens.lens().name.clone().into();
        }
        if let Some(request) = request {
            source[LENS_REQUEST] = request;
        }
        for (key, value) in plan.lens.errors().into_iter().flatten() {
            source[key] = value;
        }
        Ok(Job {
            source,
            chart_bands,
            chart: inputs.chart,
            depth: inputs.depth,
            lens: plan.lens,
            frame: inputs.frame,
            options: Options { simd: device.simd, ..arguments.options },
            film_bands: inputs.film_bands,
            plans: plan.bands,
            gains: plan.gains,
            film: plan.film,
            layers,
            reduced,
            regions: plan.regions,
            identity,
            memory,
            threads: arguments.threads,
            queues,
            engine: device.engine,
            coverage: coverage.to_string(),
            notes,
            details,
        })
    }
}
