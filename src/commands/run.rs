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
mod execute;
mod forecast;
#[cfg(feature = "mesh")]
pub mod mesh;
mod monitor;
mod record;
mod samples;
mod shards;
mod sink;
mod task;
mod units;

use crate::args::{MeshArgs, ProgressArg, RunArgs, RunCommand};
use crate::commands::cache;
use crate::commands::plan::CommandLine;
use crate::commands::pyramid;
use crate::design;
use crate::failure::usage;
use crate::film;
use crate::job::Job;
use crate::job::film_engine;
use crate::job::lens::shown_name;
use crate::job::stages::{layers, without_layers};
use crate::open;
use crate::outputs::Guard;
use crate::progress::interrupt;
use crate::progress::jsonl::Jsonl;
use crate::progress::{detail_line, log_line, plural, resume_note};
use crate::progress::{mib, number};
use anyhow::{Context, Result};
use clap::ArgMatches;
use execute::execute;
use forecast::Forecast;
use formats::durable::{fault_point, is_url, parent_of};
use formats::film::{FilmStore, FilmWriter};
use pipeline::cuda::memory::DeviceQueue;
use pipeline::tiling::ShardId;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use std::time::Instant;
use task::{ShardCount, Task};
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
        true => (String::new(), "spectra cache", job.memory.spectra_in_turn),
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
