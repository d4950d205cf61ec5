//! Flags resolved: chart, lens, film, memory, the job's identity. What can fail early fails here, before any pixel.

use crate::args::{
    CodecArg, Device, DtypeArg, FilmUnits, InterpArg, NanArg, OutsideArg, RunArgs, Stage, SurroundArg, bands,
};
use crate::device::Choice;
use crate::engine::{self, Engine};
use crate::failure::{self, other_job, usage};
use crate::lens::source::{Named, Source};
use crate::memory::{Memory, Needs, OnDevices, RemapNeeds, default_limit};
use crate::open::{Chart, is_builtin};
use anyhow::{Context, Result};
use formats::chart::{Codec, MAX_VALUE, NanPolicy};
use formats::film::{FilmOutput, FilmSpec, FilmStore, SampleType};
use formats::lens::LensPackError;
use pipeline::band::{BandPlan, Options, PsfBetween};
use pipeline::bounds;
use pipeline::cuda;
use pipeline::cuda::memory::{BandNeeds, DeviceQueue};
use pipeline::field::Outside;
use pipeline::geometry::{Frame, Size};
use pipeline::lens::PsfSample;
use pipeline::plan::Window;
use pipeline::psf::cuda::PsfOnDevice;
use pipeline::remap::{Reading, Remap, Stages};
use pipeline::resample::{Interp, Surround};
use pipeline::simd::Simd;
use serde_json::{Map, Value, json};
use std::path::Path;

/// Planck's constant times the speed of light, J·m (SI, exact).
const HC_J_M: f64 = 6.626_070_15e-34 * 299_792_458.0;

/// A job, ready to run.
pub struct Job {
    /// The chart.
    pub chart: Chart,
    /// The lens.
    pub lens: Source,
    /// Film, axis, chart.
    pub frame: Frame,
    /// How bands are made.
    pub options: Options,
    /// Band of the chart per position of the job.
    pub chart_bands: Vec<usize>,
    /// Band of the film per position: all of them, unless the job is a [`Part`].
    pub film_bands: Vec<usize>,
    /// Plan per position.
    pub plans: Vec<BandPlan>,
    /// Factor on the remap per position (film units).
    pub gains: Vec<f64>,
    /// The film's layout.
    pub film: FilmSpec,
    /// Its outputs as the pipeline sees them.
    pub windows: Vec<Window>,
    /// All that changes pixels, readable.
    pub identity: Map<String, Value>,
    /// Memory.
    pub memory: Memory,
    /// Worker threads.
    pub threads: usize,
    /// GPUs that compute, a queue each; none: the workers do.
    pub queues: Vec<DeviceQueue>,
    /// The implementation of the arithmetic that computes the pixels.
    pub engine: Engine,
    /// What the user should know before it starts.
    pub notes: Vec<String>,
}

/// The part of a planned job that one process does: the bands that it opens, and what the plan knows of the others.
#[derive(Clone, Copy)]
pub struct Part<'a> {
    /// Bands of the film, ascending.
    pub bands: &'a [usize],
    /// [`Source::band_digest`] of every band of the film.
    pub lens_bands: &'a [String],
    /// Digest of the whole lens.
    pub lens_digest: &'a str,
}

impl Part<'_> {
    /// The whole lens's digest if the bands at hand are the planned ones; else one that differs from it.
    fn lens_digest(&self, lens: &Source, plans: &[BandPlan]) -> Result<String, LensPackError> {
        for (band, plan) in std::iter::zip(self.bands, plans) {
            let own = lens.band_digest(plan.choice)?;
            if self.lens_bands.get(*band) != Some(&own) {
                return Ok(own);
            }
        }
        Ok(self.lens_digest.to_owned())
    }
}

/// Worker threads: as asked, or all cores.
pub fn threads(asked: Option<usize>) -> usize {
    asked.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from))
}

impl Job {
    /// Resolves `args`.
    ///
    /// # Errors
    /// Whatever would stop the run later and can be known now.
    pub fn new(args: &RunArgs) -> Result<Self> {
        Self::of(args, None)
    }

    /// Resolves `args` for some of the job's bands; what is told of the film and the job's identity is of the whole job.
    ///
    /// # Errors
    /// As [`Job::new`]; a chart that has fewer bands than planned.
    pub fn of(args: &RunArgs, part: Option<Part<'_>>) -> Result<Self> {
        let film_engine = engine::of_film_at(&args.film, args.overwrite)?;
        let mut device = Choice::new(&args.device, args.engine.named(), film_engine)?;
        let nan = match args.nan {
            NanArg::Error => NanPolicy::Error,
            NanArg::Zero => NanPolicy::Zero,
        };
        let open = |cache_bytes: usize| match (&args.chart_shape, &args.chart_dtype) {
            (Some(shape), Some(dtype)) => {
                Chart::raw(&args.chart, shape, dtype, args.wavelengths.as_deref(), nan)
            }
            _ => Chart::open(&args.chart, args.wavelengths.as_deref(), nan, cache_bytes),
        };
        let chart = open(0)?;
        let named = Named::open(&args.lens)?;
        let all_nm = chart.wavelengths_nm()?;
        let asked: Vec<usize> = match &args.bands {
            None => (0..all_nm.len()).collect(),
            Some(text) => bands(text, all_nm.len()).map_err(|e| usage(format!("--bands {text}: {e}")))?,
        };
        let film_bands: Vec<usize> = part.map_or_else(|| (0..asked.len()).collect(), |p| p.bands.to_vec());
        if let Some(beyond) = film_bands.iter().find(|b| **b >= asked.len()) {
            return Err(other_job(format!(
                "chart `{}` has {} bands, so it is not the planned one, which has a band {beyond}",
                args.chart,
                all_nm.len()
            )));
        }
        let chart_bands: Vec<usize> = film_bands.iter().map(|&b| asked[b]).collect();
        let nm_of = |bands: &[usize]| bands.iter().map(|&b| all_nm[b]).collect::<Vec<f64>>();
        let wavelengths_nm = nm_of(&chart_bands);
        let frame = frame(args, &chart, scale(args, &chart, &named)?)?;
        let mut options = options(args, device.simd);
        let film = film_spec(args, &frame, nm_of(&asked), &chart)?;
        let threads = threads(args.threads);
        let lens = Source::new(named, &frame, &wavelengths_nm, &options, threads)?;
        let plan = |&nm: &f64| BandPlan::new(&frame, lens.lens(), nm, &options);
        let plans: Vec<BandPlan> = wavelengths_nm.iter().map(plan).collect::<Result<_, _>>()?;
        let gains: Vec<f64> = plans.iter().map(|p| gain(args.film_units, p, &frame)).collect();
        let windows: Vec<Window> = (0..film.outputs.len())
            .map(|i| {
                let (height, width) = film.shard_shape(i);
                Window { rect: film.outputs[i].rect, shard: Size::new(height, width) }
            })
            .collect();
        let chart_rows = |rows: usize| chart.cache_for_rows(rows);
        let needs = Needs {
            limit: args.memory.unwrap_or_else(default_limit),
            plans: &plans,
            windows: &windows,
            threads,
            writers: FilmStore::writers(&args.film),
            chart_rows: &chart_rows,
            chunks: chart.chunks(&chart_bands),
            remap: RemapNeeds::new(&frame, &plans, &options),
            chart_px: frame.chart.pixels(),
            lens_reading: lens.largest_reading_bytes(),
            psf_reading: &|plan: &BandPlan| lens.psf_reading_bytes(plan.choice.first),
            scale: frame.scale.0.min(frame.scale.1),
        };
        let bands = device_needs(&frame, &options, &plans, &device);
        let (memory, queues) = plan_memory(&needs, &bands, &args.device, &mut device)?;
        options.simd = device.simd;
        // Opened again now that the cache's size is known; the first time only metadata were read.
        let mut chart = open(memory.chart_cache)?;
        chart.limit_values(largest_value(&gains))?;
        let lens_digest = match part {
            None => lens.digest().map(str::to_owned),
            Some(part) => part.lens_digest(&lens, &plans),
        };
        let lens_words = (lens.lens().name.as_str(), lens_digest.context("reading the lens pack")?);
        let identity = identity(args, options.stages, &chart, lens_words, &frame, &asked)?;
        let mut notes = notes(args, &chart, &lens, &plans)?;
        notes.extend(needs.remap.note());
        if args.device == Device::Auto {
            notes.push(device.why);
        }
        notes.extend(device.notes);
        Ok(Self {
            chart,
            lens,
            frame,
            options,
            chart_bands,
            film_bands,
            plans,
            gains,
            film,
            windows,
            identity,
            memory,
            threads,
            queues,
            engine: device.engine,
            notes,
        })
    }
}

impl Job {
    /// What computes, in a word as `--device` takes it.
    pub fn device(&self) -> String {
        let indices = self.queues.iter().map(|q| q.device.index()).collect();
        match self.queues.is_empty() {
            true => Device::Cpu.to_string(),
            false => Device::Cuda(indices).to_string(),
        }
    }
}

/// What each band needs of a GPU; nothing where there is none. The largest rectangle of the chart is taken from tiles spread over
/// the film; a run looks at all of them.
fn device_needs(frame: &Frame, options: &Options, plans: &[BandPlan], device: &Choice) -> Vec<BandNeeds> {
    let of = |plan: &BandPlan| {
        let remap = Remap::new(frame, &plan.lens, options.stages, options.reading, 1.0, options.simd);
        let (rows, cols) = plan.tiling.count();
        let spread = |n: usize| [0, n / 2, n - 1];
        let tiles: Vec<_> = spread(rows).iter().flat_map(|&i| spread(cols).map(|j| (i, j))).collect();
        let psf = plan.blocks.as_ref().zip(plan.grid.as_ref());
        let least = psf.map(|(blocks, grid)| PsfOnDevice::least_bytes(blocks, grid, plan.tiling.tile()));
        cuda::needs(&remap, &plan.tiling, tiles.iter(), least)
    };
    match device.devices.is_empty() {
        true => Vec::new(),
        false => plans.iter().map(of).collect(),
    }
}

/// Memory of the host and of the GPUs; under `auto` the processor computes where it does not suffice for GPUs.
fn plan_memory(
    needs: &Needs<'_>,
    bands: &[BandNeeds],
    asked: &Device,
    device: &mut Choice,
) -> Result<(Memory, Vec<DeviceQueue>)> {
    if device.devices.is_empty() {
        return Ok((Memory::plan(needs, &OnDevices::NONE)?, Vec::new()));
    }
    let on_gpus = Memory::plan(needs, &OnDevices::new(device.devices.len(), bands)).and_then(|memory| {
        let queues = device.queues(asked, bands, memory.pinned)?;
        Ok((memory, queues))
    });
    match on_gpus {
        Err(error) if device.may_fall_back(asked) => {
            *device = Choice::cpu(&failure::line(&error));
            Ok((Memory::plan(needs, &OnDevices::NONE)?, Vec::new()))
        }
        planned => planned,
    }
}

/// Film pixel pitch.
fn pitch_um(args: &RunArgs, chart: &Chart) -> Result<f64> {
    args.film_pitch_um.or_else(|| chart.pitch_um()).ok_or_else(|| {
        usage(format!(
            "chart `{}` has no attribute pitch_um; say the film's pixel pitch, e.g. `--film-pitch-um 2`",
            args.chart
        ))
    })
}

/// Film pixels per chart pixel, (y, x): as asked, or |magnification| · chart pitch / film pitch. The magnification's sign
/// turns the image about the axis; the film is upright as its viewer sees it, so only its size counts.
fn scale(args: &RunArgs, chart: &Chart, lens: &Named) -> Result<(f64, f64)> {
    let Some(chart_pitch_mm) = args.chart_pitch_mm else { return Ok((args.scale.1, args.scale.0)) };
    let asked = format!("--chart-pitch-mm {chart_pitch_mm}");
    let Some((magnification, distance_mm)) = lens.conjugate()? else {
        return Err(usage(format!(
            "{asked}: lens `{}` is for an object at infinity, which has no magnification; make its pack for the chart's \
             distance D by `lenscube lens trace DESIGN OUT.lens.zarr --object-distance-mm D`, or give `--scale`",
            args.lens
        )));
    };
    let scale = magnification.abs() * chart_pitch_mm * 1e3 / pitch_um(args, chart)?;
    if !bounds::SCALE.holds(scale) {
        return Err(usage(format!(
            "{asked}: at magnification {magnification} (object at {distance_mm} mm) that is {scale:e} film pixels per chart \
             pixel, expected 0.001 to 1000"
        )));
    }
    Ok((scale, scale))
}

fn frame(args: &RunArgs, chart: &Chart, scale: (f64, f64)) -> Result<Frame> {
    let size = chart.size();
    let pitch_um = pitch_um(args, chart)?;
    let scaled = |n: usize, s: f64| ((n as f64 * s).round() as usize).max(1);
    let own = chart.film_size().filter(|_| scale == (1.0, 1.0));
    let film = args
        .film_size
        .or(own)
        .unwrap_or(Size::new(scaled(size.height, scale.0), scaled(size.width, scale.1)));
    bounds::film_size(film)
        .map_err(|e| usage(format!("{e}; give its size, e.g. `--film-size 2000x3000`")))?;
    let mut frame = Frame { scale, ..Frame::centred(film, size, pitch_um) };
    if let Some((x, y)) = args.axis {
        frame.axis_px = (y, x);
    }
    frame.center_mm = (args.center.1, args.center.0);
    Ok(frame)
}

fn options(args: &RunArgs, simd: Simd) -> Options {
    let on = |s: Stage| args.stages.contains(&s);
    Options {
        stages: Stages { ri: on(Stage::Ri), distortion: on(Stage::Distortion), svpsf: on(Stage::Svpsf) },
        reading: Reading {
            interp: match args.interp {
                InterpArg::Bicubic => Interp::Bicubic,
                InterpArg::Bilinear => Interp::Bilinear,
            },
            surround: match args.surround {
                SurroundArg::Edge => Surround::Edge,
                SurroundArg::Black => Surround::Black,
                SurroundArg::Mirror => Surround::Mirror,
            },
            outside: match args.outside {
                OutsideArg::Error => Outside::Error,
                OutsideArg::Clamp => Outside::Clamp,
            },
        },
        azimuths: args.azimuths,
        psf_window: args.psf_window,
        between: if args.interpolate_psf { PsfBetween::Interpolate } else { PsfBetween::Error },
        simd,
    }
}

/// Film value per chart value on the axis: 1; τ·Ω (E = L·τ·Ω·R); or photons, E·λ/(hc)·pixel area.
fn gain(units: FilmUnits, plan: &BandPlan, frame: &Frame) -> f64 {
    let irradiance = plan.lens.transmission * plan.lens.solid_angle_sr;
    match units {
        FilmUnits::Relative => 1.0,
        FilmUnits::Irradiance => irradiance,
        FilmUnits::Photons => {
            let per_joule = plan.lens.wavelength_nm * 1e-9 / HC_J_M;
            irradiance * per_joule * (frame.pitch_um * 1e-6).powi(2)
        }
    }
}

/// Largest chart value that the bands' gains leave computable.
fn largest_value(gains: &[f64]) -> f32 {
    (f64::from(MAX_VALUE) / gains.iter().fold(1.0, |m, g| f64::max(m, *g))) as f32
}

fn film_spec(args: &RunArgs, frame: &Frame, wavelengths_nm: Vec<f64>, chart: &Chart) -> Result<FilmSpec> {
    if args.chunk == 0 || args.shard == 0 || !args.shard.is_multiple_of(args.chunk) {
        return Err(usage(format!(
            "--shard {} is not a multiple of --chunk {}; e.g. `--shard 2048 --chunk 512`",
            args.shard, args.chunk
        )));
    }
    let mut outputs = Vec::new();
    for (i, rect) in args.roi.iter().enumerate() {
        if !frame.film.rect().contains(*rect) {
            return Err(usage(format!(
                "--roi {},{},{},{} leaves the film of {} (rows x columns)",
                rect.x, rect.y, rect.width, rect.height, frame.film
            )));
        }
        outputs.push(FilmOutput { name: format!("roi_{i}"), rect: *rect });
    }
    if outputs.is_empty() {
        outputs.push(FilmOutput { name: "film".into(), rect: frame.film.rect() });
    }
    let units = match args.film_units {
        FilmUnits::Relative => chart.units().unwrap_or("relative").to_owned(),
        FilmUnits::Irradiance => "W m-2 nm-1".into(),
        FilmUnits::Photons => "s-1 nm-1".into(),
    };
    let spec = FilmSpec {
        outputs,
        film: frame.film,
        wavelengths_nm,
        pitch_um: frame.pitch_um,
        axis_px: frame.axis_px,
        units,
        sample: match args.dtype {
            DtypeArg::F32 => SampleType::F32,
            DtypeArg::F16 => SampleType::F16,
        },
        shard: args.shard,
        chunk: args.chunk,
        codec: codec(args.codec),
    };
    spec.check().map_err(|e| usage(e.to_string()))?;
    Ok(spec)
}

/// The store's codec for a word of the command line.
pub fn codec(arg: CodecArg) -> Codec {
    match arg {
        CodecArg::None => Codec::None,
        CodecArg::Lz4 => Codec::Lz4,
        CodecArg::Zstd => Codec::Zstd,
    }
}

/// All that changes pixels, in words a person can read and compare.
fn identity(
    args: &RunArgs,
    stages: Stages,
    chart: &Chart,
    (lens_name, lens_digest): (&str, String),
    frame: &Frame,
    chart_bands: &[usize],
) -> Result<Map<String, Value>> {
    let (content, mtimes) = chart.identity()?;
    let value = json!({
        "numeric_version": NUMERIC_VERSION,
        "chart": content,
        "chart_mtimes": mtimes,
        "chart_bands": chart_bands,
        "lens_name": lens_name,
        "lens_digest": lens_digest,
        "stages": { "ri": stages.ri, "distortion": stages.distortion, "svpsf": stages.svpsf },
        "film_size": [frame.film.height, frame.film.width],
        "film_pitch_um": frame.pitch_um,
        "axis_px": { "x": frame.axis_px.1, "y": frame.axis_px.0 },
        "scale": { "x": frame.scale.1, "y": frame.scale.0 },
        "center_mm": { "x": frame.center_mm.1, "y": frame.center_mm.0 },
        "interp": format!("{:?}", args.interp).to_lowercase(),
        "surround": format!("{:?}", args.surround).to_lowercase(),
        "outside": format!("{:?}", args.outside).to_lowercase(),
        "nan": format!("{:?}", args.nan).to_lowercase(),
        "azimuths": args.azimuths,
        "psf_window": args.psf_window,
        "interpolate_psf": args.interpolate_psf,
        "film_units": format!("{:?}", args.film_units).to_lowercase(),
        "rois": args.roi.iter().map(|r| [r.x, r.y, r.width as i64, r.height as i64]).collect::<Vec<_>>(),
    });
    let Value::Object(map) = value else { unreachable!("an object is written above") };
    Ok(map)
}

/// Raised whenever the program gives other pixel values for the same job.
pub const NUMERIC_VERSION: u32 = 3;

fn notes(args: &RunArgs, chart: &Chart, lens: &Source, plans: &[BandPlan]) -> Result<Vec<String>> {
    let mut notes = lens.notes().to_vec();
    notes.extend(chart.notes());
    if is_builtin(&args.lens) && Path::new(&args.lens).symlink_metadata().is_ok() {
        notes.push(format!(
            "--lens {0} is the built-in lens; for the file of that name, --lens ./{0}",
            args.lens
        ));
    }
    let tables = lens.lens();
    if args.stages.contains(&Stage::Svpsf) {
        let least = tables.bands.iter().flat_map(|b| &b.psf_energy).fold(f64::INFINITY, |m, e| m.min(*e));
        if least < 0.9 {
            notes.push(format!(
                "the lens pack's PSF windows hold as little as {:.0} % of the light at some bands; the rest is \
                 normalised away (see `lenscube lens show`)",
                100.0 * least
            ));
        }
        notes.extend(turning_note(lens, plans)?);
    }
    if args.film_units != FilmUnits::Relative && chart.units().is_none_or(|u| !is_radiance(u)) {
        notes.push(format!(
            "--film-units {:?} takes the chart as spectral radiance in W m-2 sr-1 nm-1, but its units are {}",
            args.film_units,
            chart.units().unwrap_or("not given")
        ));
    }
    Ok(notes)
}

/// For integrated samples that are turned by more than quarter turns: the estimated error at the primary wavelength.
fn turning_note(lens: &Source, plans: &[BandPlan]) -> Result<Option<String>> {
    let Some(pack) = lens.pack() else { return Ok(None) };
    let tables = lens.lens();
    let turned = plans.iter().filter_map(|p| p.grid.as_ref()).any(|g| g.azimuths().iter().any(|&j| j > 4));
    if tables.psf_sample != PsfSample::Integrated || !turned {
        return Ok(None);
    }
    Ok(crate::lens::turning_error(pack)?.map(|error| {
        format!(
            "the lens pack's PSFs are integrated over their pitch: exact at quarter turns, turned by cubic interpolation \
             between; estimated error there {:.0} % of the light (L1, worst height at {:.0} nm); a pack of point samples \
             has none of it",
            100.0 * error,
            tables.primary_wavelength_nm
        )
    }))
}

fn is_radiance(units: &str) -> bool {
    let u = units.replace(['^', '·', '*', ' '], "").to_lowercase();
    u.contains("sr-1") && u.contains("nm-1") && u.starts_with('w')
}
