//! `lenscube run`: chart → remapped image → film; the film is created, resumed, or found complete.
//!
//! Order of checks, each before anything that a later one may change:
//!
//! 1. [`Guard`]: the film is no input of the job, contains none and lies in none.
//! 2. [`UntracedJob`](crate::job::UntracedJob) and its trace, before the film is opened for writing: arguments, the film's recorded engine and the device; metadata of chart and lens, film geometry;
//!    film layout, the lens traced or read for all bands; memory; limit of chart values; identity (digests of lens and chart).
//! 3. [`film::open`]: the film is created. If something exists at its path, temporary files beside it are removed and it is opened: metadata,
//!    then identity and layout (exit code 3; `--trust-input` accepts other modification times of the chart; with `--check-input` the content of its files is compared instead).
//! 4. An explicit `--engine` is the film's (exit code 3). If all shards are present: exit code 0.
//! 5. Lock; temporary files of ended processes are removed; missing shards are listed again.
//! 6. The engine is the film's, or is recorded in it with `--mixed-engines` (exit code 3). Then a chart with interleaved bands is copied.
//! 7. During the run: the film is in place before each shard, or batch of shards of a small film, is committed, and chart files are unchanged when they are read.
//! 8. At the end: the film is in place, chart and lens are unchanged.
//!
//! Units of a plan: the digest, schema and numeric version of the plan, the list of units and the arguments; step 1; the film (opened, not
//! created) against the plan; step 4 for these units; then step 2 and the comparison of the job with the plan, and steps 5 to 8.

mod display;
mod forecast;
#[cfg(feature = "mesh")]
pub mod mesh;
mod monitor;
mod record;
mod samples;
mod shards;
mod sink;
mod units;

use crate::args::{MeshArgs, ProgressArg, RunArgs, RunCommand};
use crate::commands::cache;
use crate::commands::plan::CommandLine;
use crate::commands::pyramid;
use crate::design;
use crate::failure::{code, usage};
use crate::film;
use crate::job::Job;
use crate::job::depth::Depth;
use crate::job::film_engine;
use crate::job::lens::shown_name;
use crate::job::stages::{layers, prepare, without_layers};
use crate::open;
use crate::outputs::Guard;
use crate::progress::interrupt;
use crate::progress::jsonl::Jsonl;
use crate::progress::{Bars, detail_line, json_path, log_line, plural, report_kept, resume_note};
use crate::progress::{mib, number};
use anyhow::{Context, Result};
use clap::ArgMatches;
use display::Display;
use forecast::Forecast;
use formats::durable::{Lock, ProcessIdentity, fault_point, is_url, parent_of};
use formats::film::{FilmStore, FilmWriter};
use formats::group::{GroupError, JobGroup};
use monitor::{Monitor, RunFailure};
use pipeline::cuda::memory::DeviceQueue;
use pipeline::depth::SceneInputs;
use pipeline::depth::counts::{Counts, SharedCounts};
use pipeline::depth::invented::InventedLight;
use pipeline::executor::{BandWork, Summary, Work, run};
use pipeline::stages::StageCompute;
use pipeline::tiling::ShardId;
use serde_json::{Value, json};
use sink::FilmStoreSink;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;
use units::Units;

/// Runs the command, parsed from `matches`; the exit code.
pub fn command(args: &RunCommand, matches: &ArgMatches) -> Result<u8> {
    if args.work.die_with_parent {
        interrupt::die_with_parent().context("--die-with-parent")?;
    }
    check_mesh_flags(args)?;
    let jsonl = (args.work.progress == ProgressArg::Jsonl).then(Jsonl::start);
    let result = match &args.work.plan {
        #[cfg(feature = "mesh")]
        None if mesh::is_of_mesh(args) => mesh::run(args, jsonl),
        None if samples::is_of_samples(&args.job) => samples::run(args),
        None if args.dry_run => forecast::print(&args.job).map(|()| 0),
        None => run_job(&args.job, jsonl, args.work.progress),
        Some(plan) => {
            let units = || Units::read(plan.clone(), args.work.unit.as_deref());
            units().and_then(|units| run_units(&units, args, matches, jsonl))
        }
    };
    if let Some(jsonl) = jsonl {
        jsonl.end(&result, resume_note(args.job.process.overwrite));
    }
    result
}

/// Fails if flags of meshes are given for another chart.
fn check_mesh_flags(args: &RunCommand) -> Result<()> {
    #[cfg(feature = "mesh")]
    if mesh::is_of_mesh(args) {
        return Ok(());
    }
    #[cfg(not(feature = "mesh"))]
    if open::is_mesh(&args.job.chart) {
        return Err(usage(formats::features::missing("mesh")));
    }
    if args.mesh != MeshArgs::default() {
        return Err(usage(format!(
            "--camera, --eye, --sun and the other flags of meshes apply to .glb, .gltf, .obj and .ply; chart `{}` is none",
            args.job.chart
        )));
    }
    Ok(())
}

/// Computes a complete film.
///
/// # Errors
/// Those of the run; the exit code otherwise.
pub fn run_job(args: &RunArgs, jsonl: Option<&Jsonl>, progress: ProgressArg) -> Result<u8> {
    run_job_of(args, None, jsonl, progress)
}

/// As [`run_job`], of a film whose attribute `source` has the further field `source`: key and value.
fn run_job_of(
    args: &RunArgs,
    source: Option<(&str, Value)>,
    jsonl: Option<&Jsonl>,
    progress: ProgressArg,
) -> Result<u8> {
    let start = Instant::now();
    let mut job = forecast::resolved(args)?;
    if let Some((key, value)) = source {
        job.source[key] = value;
    }
    forecast::check_space_of_new_film(&job, args)?;
    interrupt::listen();
    let store = film::open(&job, args)?;
    fault_point("film-opened");
    let code = compute_missing(&Task { args, store: &store, units: None, jsonl, progress, start }, job)?;
    trim_cache(args);
    pyramid_of(args, &store, code)
}

/// Reports the complete film `store`, and makes its pyramid if that is asked for.
#[cfg(feature = "mesh")]
fn already_complete(
    args: &RunArgs,
    store: &FilmStore,
    jsonl: Option<&Jsonl>,
    progress: ProgressArg,
) -> Result<u8> {
    film_engine::check_explicit(store, args)?;
    let task = Task { args, store, units: None, jsonl, progress, start: Instant::now() };
    let code = task.already_complete(store.all_shards().count(), "is")?;
    pyramid_of(args, store, code)
}

/// Makes the pyramid of a film whose run ended with `code`, if that is asked for.
fn pyramid_of(args: &RunArgs, store: &FilmStore, code: u8) -> Result<u8> {
    match code {
        0 if args.pyramid => {
            pyramid::make(&store.pyramid(), args.threads, args.memory, args.process.take_over)
        }
        code => Ok(code),
    }
}

/// Computes units of a plan.
fn run_units(units: &Units, given: &RunCommand, matches: &ArgMatches, jsonl: Option<&Jsonl>) -> Result<u8> {
    let start = Instant::now();
    if let Some(jsonl) = jsonl {
        jsonl.set_plan(&units.name, &units.listed());
    }
    if units.is_empty() {
        log_line("--unit names no unit: nothing to do");
        if let Some(jsonl) = jsonl {
            jsonl.write("done", record::nothing_done());
        }
        return Ok(0);
    }
    let args = units.args(&given.job, &CommandLine::given(matches)?)?;
    Guard::of_job(&args).reads("plan", &units.path).check()?;
    interrupt::listen();
    let store = units.film(&args)?;
    film_engine::check_explicit(&store, &args)?;
    fault_point("film-opened");
    let progress = given.work.progress;
    let task = Task { args: &args, store: &store, units: Some(units), jsonl, progress, start };
    // Checked before the chart and the lens are opened, unless the chart's content is to be compared in any case.
    if !args.check_input
        && let Some(shards) = units.completed_shards(&store)?
    {
        return task.already_complete(shards, "are");
    }
    let job = units.job(&args)?;
    fault_point("job-ready");
    let code = compute_missing(&task, job)?;
    trim_cache(&args);
    Ok(code)
}

/// Trims the cache after a run that may have added to it: of traced bands, with a design, or of reduced charts.
fn trim_cache(args: &RunArgs) {
    if design::is_design(&args.lens) || args.veil.is_on() {
        cache::trim_after_run();
    }
}

/// The part of a job that this process computes.
struct Task<'a> {
    args: &'a RunArgs,
    store: &'a FilmStore,
    /// `None`: the complete film.
    units: Option<&'a Units>,
    jsonl: Option<&'a Jsonl>,
    progress: ProgressArg,
    start: Instant,
}

impl Task<'_> {
    /// Name in messages.
    fn name(&self) -> String {
        let film = self.store.path().display();
        self.units.map_or_else(|| film.to_string(), |u| format!("units {} of {film}", u.listed()))
    }

    fn lock(&self) -> Result<Option<Lock>> {
        match self.units {
            Some(units) => units.lock(self.store),
            None => Ok(self.store.group().lock(JobGroup::WHOLE, self.args.process.take_over)?),
        }
    }

    /// All `shards` are present; `verb` fits [`Task::name`].
    fn already_complete(&self, shards: usize, verb: &str) -> Result<u8> {
        // Removes temporary files of a run that was killed after its last shard. Fails on a read-only film, which is complete as well.
        let _ = (self.lock(), self.store.group().sweep());
        fault_point("shards-made");
        self.store.group().check_in_place()?;
        log_line(format!("{} {verb} complete: {}, nothing to do", self.name(), plural(shards, "shard")));
        record::nothing_to_do(self.jsonl, self.store, shards);
        Ok(0)
    }

    /// Locks the film and removes temporary files of ended processes.
    fn lock_and_sweep(&self) -> Result<Option<Lock>> {
        let lock = self.lock()?;
        if let Some(lock) = &lock {
            interrupt::release_on_exit(lock.path());
        }
        fault_point("locked");
        if self.args.no_fsync {
            log_line("--no-fsync: a power failure may lose shards that were reported as written");
        }
        let swept = self.store.group().sweep()?;
        report_kept(&swept);
        if !swept.removed.is_empty() {
            log_line(format!("removed {} temporary files of an interrupted run", swept.removed.len()));
        }
        Ok(lock)
    }

    /// Writes the `start` event.
    fn write_start_event(&self, job: &Job, shards: &ShardCount, tiles: &[(u64, u64)]) {
        let Some(jsonl) = self.jsonl else { return };
        let (tiles, pixels) = tiles.iter().fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        jsonl.set_totals(shards.missing as u64, tiles, pixels);
        let fields = json!({
            "film": json_path(self.store.path()),
            "device": job.device(),
            "engine": job.engine.to_string(),
            "threads": job.threads,
            "pid": std::process::id(),
            "host": ProcessIdentity::current().host,
            "shards": shards.all,
            "shards_done": shards.all - shards.missing,
            "tiles": tiles,
            "pixels": pixels,
            "startup_s": self.start.elapsed().as_secs_f64(),
        });
        jsonl.write("start", fields);
    }
}

/// Shards of a task.
struct ShardCount {
    all: usize,
    missing: usize,
}

/// Computes the shards of a task that are missing.
fn compute_missing(task: &Task<'_>, mut job: Job) -> Result<u8> {
    let Task { args, store, units, .. } = *task;
    film_engine::check_explicit(store, args)?;
    let requested = shards::requested(&job, units);
    let all: usize = requested.iter().map(BTreeSet::len).sum();
    if shards::missing(&job, store, &requested)?.iter().all(BTreeSet::is_empty) {
        restore_layers(task, &job)?;
        return task.already_complete(all, if units.is_some() { "are" } else { "is" });
    }
    let lock = task.lock_and_sweep()?;
    let missing = shards::missing(&job, store, &requested)?;
    let count = ShardCount { all, missing: missing.iter().map(BTreeSet::len).sum() };
    if count.missing < all {
        log_line(format!("resuming {}: {} of {all} shards to compute", task.name(), count.missing));
    }
    film_engine::check_and_record(store, job.engine, args)?;
    Forecast::new(&job, &args.film, &missing)?.check_space(args.process.force)?;
    sort_chart_by_band(&mut job, &args.film, &missing)?;
    print_start(&job, all);
    let code = execute(task, &job, &count, missing);
    drop(lock);
    code
}

/// Computes the layers of light that were lost from a film whose shards, which have their light, are complete.
fn restore_layers(task: &Task<'_>, job: &Job) -> Result<()> {
    let lost = without_layers(job, Some(task.store))?;
    if !lost.contains(&true) {
        return Ok(());
    }
    let _lock = task.lock_and_sweep()?;
    let film = FilmWriter::new(task.store);
    for position in (0..lost.len()).filter(|position| lost[*position]) {
        let nm = job.plans[position].lens.wavelength_nm;
        log_line(format!(
            "layers of light of band {} ({} nm): lost, computed again",
            job.film_bands[position],
            number(nm)
        ));
        layers(job, &film, position).map_err(anyhow::Error::from_boxed)?;
    }
    Ok(film.finish()?)
}

/// Computes and writes the shards `missing`, per position of the job.
fn execute(task: &Task<'_>, job: &Job, count: &ShardCount, missing: Vec<BTreeSet<ShardId>>) -> Result<u8> {
    let store = task.store;
    let bands = std::iter::zip(missing, std::iter::zip(&job.plans, &job.chart_bands));
    let band = |(shards, (plan, &chart_band)): (_, (&pipeline::band::BandPlan, &usize))| BandWork {
        chart_band,
        tiling: plan.tiling,
        shards,
    };
    let work = Work {
        film: job.frame.film,
        regions: &job.regions,
        bands: bands.map(band).collect(),
        threads: job.threads,
        max_encoded_shards: job.memory.encoded_shards,
        gpus: &job.queues,
        cancel: interrupt::cancel_flag(),
    };
    let tiles = shards::tiles(&work);
    task.write_start_event(job, count, &tiles);
    let startup_s = task.start.elapsed().as_secs_f64();
    let monitor = Monitor::new(display(task, job, &tiles), startup_s, task.args.keep_going);
    fault_point("tiles-begin");
    let energy = Mutex::new(vec![None; job.plans.len()]);
    let film = FilmWriter::new(store);
    let prepare = |position: usize| prepare(job, &film, position, &energy);
    let sheets = job.depth.as_ref().map_or_else(Vec::new, Depth::sheets);
    let counts = SharedCounts::default();
    let invented = job.film.has_invented.then(|| InventedLight::new(&job.regions));
    let compute = StageCompute::new(job.frame, job.memory.spectra, &prepare).with_surfaces(SceneInputs {
        sheets: &sheets,
        invented: invented.as_ref(),
        counts: Some(&counts),
    });
    let (film_bands, light) = (&*job.film_bands, Mutex::default());
    let sink = FilmStoreSink { film: &film, film_bands, invented: invented.as_ref(), light };
    let result = run(&work, job.chart.source(), &sink, &compute, &monitor);
    // Also after an interruption or an error: the shards made so far.
    let committed = film.finish();
    monitor.display.finish();
    fault_point("shards-made");
    let outcome = monitor.outcome(job, store, count.missing as u64, result, committed);
    let outcome = check_film_in_place(store, outcome).and_then(|summary| check_inputs(job, summary));
    let energy = energy.into_inner().expect("no panic while held");
    record::write(job, store, task.units, &monitor, &outcome, &energy);
    let summary = outcome.map_err(|failure| failure.error)?;
    print_depth(&counts.sum(), &sink);
    let left = (count.missing as u64).saturating_sub(summary.shards);
    if left > 0 {
        log_line(format!(
            "interrupted: {left} of {} shards are left; {}",
            count.missing,
            resume_note(task.args.process.overwrite)
        ));
        return Ok(code::INTERRUPTED);
    }
    record::write_done_event(task.jsonl, job, &summary);
    Ok(0)
}

/// Prints what the depth stage computed, and the share of the light that comes from invented surfaces.
fn print_depth(counts: &Counts, sink: &FilmStoreSink<'_>) {
    if counts.tiles > 0 {
        detail_line(format!(
            "depth: {} tiles, {:.1} slabs a tile, {} transforms of {:.1} nodes a block, {:.2} of the model",
            counts.tiles,
            counts.slabs_of_a_tile(),
            counts.forward + counts.inverse,
            counts.nodes(),
            counts.of_model(),
        ));
    }
    let (light, invented) = *sink.light.lock().expect("no panic while held");
    if light > 0.0 && sink.invented.is_some() {
        let percent = 100.0 * invented / light;
        detail_line(format!(
            "{percent:.3} % of the light of these shards comes from invented surfaces (array `invented`)"
        ));
    }
}

/// Display of progress: bars, or JSON lines.
fn display<'a>(task: &Task<'a>, job: &'a Job, tiles: &[(u64, u64)]) -> Display<'a> {
    match task.jsonl {
        Some(jsonl) => Display::Lines { jsonl, job, store: task.store },
        None => {
            let names = job.plans.iter().map(|p| format!("{} nm", number(p.lens.wavelength_nm))).collect();
            let pixels: Vec<u64> = tiles.iter().map(|t| t.1).collect();
            Display::Bars(Bars::new(names, &pixels, task.progress))
        }
    }
}

/// `outcome`, unless the film was replaced during the run: then what the run wrote is lost, and that is the error.
fn check_film_in_place(
    store: &FilmStore,
    outcome: Result<Summary, Box<RunFailure>>,
) -> Result<Summary, Box<RunFailure>> {
    let error = match (store.group().check_in_place(), &outcome) {
        (Ok(()), _) => return outcome,
        (Err(e @ (GroupError::Replaced { .. } | GroupError::Recreated { .. })), _) | (Err(e), Ok(_)) => e,
        (Err(_), Err(_)) => return outcome,
    };
    let summary = outcome.map_or_else(|failure| failure.summary, Some);
    Err(Box::new(RunFailure { error: error.into(), summary }))
}

/// Fails if chart or lens changed during the run.
fn check_inputs(job: &Job, summary: Summary) -> Result<Summary, Box<RunFailure>> {
    match film::check_chart_unchanged(job).and_then(|()| job.lens.check_unchanged()) {
        Ok(()) => Ok(summary),
        Err(error) => Err(Box::new(RunFailure { error, summary: Some(summary) })),
    }
}

/// Sorts a chart with interleaved bands by band, into a temporary file beside the film.
fn sort_chart_by_band(job: &mut Job, film: &Path, missing: &[BTreeSet<ShardId>]) -> Result<()> {
    let needed = std::iter::zip(&job.chart_bands, missing).filter(|(_, missing)| !missing.is_empty());
    let bands: Vec<usize> = needed.map(|(band, _)| *band).collect();
    let temp = std::env::temp_dir();
    let directory = if is_url(film) { &temp } else { parent_of(film) };
    open::sort_by_band(&mut job.chart, &bands, directory, job.memory.decoders)
}

fn print_start(job: &Job, shards: usize) {
    let frame = &job.frame;
    let gpus: Vec<String> = job.queues.iter().map(DeviceQueue::name).collect();
    let (gpus, cache, bytes) = match gpus.is_empty() {
        true => (String::new(), "spectra cache", job.memory.spectra),
        false => (format!(" and {}", gpus.join(", ")), "page-locked memory per GPU", job.memory.pinned),
    };
    log_line(format!(
        "{}: {}, film {} px of {} µm, {}; {}{gpus}, engine {}",
        shown_name(&job.lens.lens().name),
        plural(job.plans.len(), "band"),
        frame.film,
        frame.pitch_um,
        plural(shards, "shard"),
        plural(job.threads, "thread"),
        job.engine,
    ));
    log_line(&job.coverage);
    detail_line(format!(
        "memory limit {}, expected peak {}: chart cache {}, {cache} {}",
        mib(job.memory.limit),
        mib(job.memory.planned),
        mib(job.memory.chart_cache),
        mib(bytes),
    ));
    for note in &job.notes {
        log_line(format!("note: {note}"));
    }
    for detail in &job.details {
        detail_line(detail);
    }
}
