//! `lenscube run`: chart → remap → film, and the film's life: created, resumed, finished.

mod faults;
pub mod film;
pub mod interrupt;
mod record;
mod shards;
mod shown;
mod units;

use crate::args::{ProgressArg, RunArgs, RunCommand};
use crate::engine;
use crate::failure::code;
use crate::job::Job;
use crate::memory::mib;
use crate::progress::jsonl::Jsonl;
use crate::progress::{Bars, json_path, report_kept, say};
use crate::pyramid;
use anyhow::{Context, Result};
use faults::{Failed, Follow};
use formats::durable::{Lock, Maker, fault_point, is_url, parent_of};
use formats::film::{EncodedShard, FilmError, FilmStore};
use formats::lens::LensPackError;
use pipeline::cuda::memory::DeviceQueue;
use pipeline::executor::{BandWork, Summary, Work, run};
use pipeline::flow::{FilmSink, SourceSinkError};
use pipeline::geometry::Rect;
use pipeline::plan::ShardId;
use pipeline::stages::StageCompute;
use serde_json::json;
use shown::Shown;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;
use units::Units;

/// The film as the pipeline's sink, and its bands by position of the job.
struct Sink<'a>(&'a FilmStore, &'a [usize]);

impl FilmSink for Sink<'_> {
    type Encoded = EncodedShard;

    fn encode(&self, id: ShardId, rect: Rect, pixels: &[f32]) -> Result<EncodedShard, SourceSinkError> {
        // No stage makes such a value of finite numbers, unless their products leave f32.
        if let Some(i) = pixels.iter().position(|v| !v.is_finite()) {
            let (row, column) = (rect.y + (i / rect.width) as i64, rect.x + (i % rect.width) as i64);
            return Err(format!(
                "row {row}, column {column} of the film comes out as {}: values of the chart times illumination and film units \
                 leave the range of float32; scale the chart down",
                pixels[i]
            )
            .into());
        }
        Ok(self.0.encode_shard(id.window, self.1[id.band], (id.row, id.col), pixels)?)
    }

    fn commit(&self, encoded: EncodedShard) -> Result<u64, SourceSinkError> {
        self.0.commit(&encoded)?;
        Ok(encoded.bytes().len() as u64)
    }

    fn writers(&self) -> usize {
        FilmStore::writers(self.0.path())
    }
}

/// A band's error: of the lens tables or of the pack.
#[derive(Debug, thiserror::Error)]
enum StageError {
    #[error(transparent)]
    Lens(#[from] pipeline::lens::LensError),
    #[error(transparent)]
    Pack(#[from] LensPackError),
}

/// The unit of work that a run without units does; its lock has this name.
pub const WHOLE: &str = "whole";

/// Runs the command; the exit code.
pub fn command(typed: &RunCommand) -> Result<u8> {
    if typed.work.die_with_parent {
        interrupt::die_with_parent().context("--die-with-parent")?;
    }
    let jsonl = (typed.work.progress == ProgressArg::Jsonl).then(Jsonl::new);
    let result = begin(typed, jsonl.as_ref());
    if let Some(jsonl) = &jsonl {
        jsonl.end(&result);
    }
    result
}

/// Finds out what is to be done.
fn begin(typed: &RunCommand, jsonl: Option<&Jsonl>) -> Result<u8> {
    let start = Instant::now();
    let Some(path) = &typed.work.plan else {
        let job = Job::new(&typed.job)?;
        film::keep_apart(&job, &typed.job.film)?;
        interrupt::listen();
        let store = film::open(&job, &typed.job)?;
        fault_point("film-opened");
        let args = &typed.job;
        return match work(Task { args, store: &store, units: None, jsonl, start }, job)? {
            0 if args.pyramid => pyramid::make(&store, args.threads, args.memory, args.take_over),
            code => Ok(code),
        };
    };
    let units = Units::read(path.clone(), typed.work.unit.as_deref())?;
    if let Some(jsonl) = jsonl {
        jsonl.of_plan(&units.name, &units.listed());
    }
    let args = units.args(typed)?;
    interrupt::listen();
    let store = units.film(&args)?;
    engine::check_named(&store, &args)?;
    fault_point("film-opened");
    if let Some(shards) = units.all_done(&store)? {
        // Leavings of a worker that was killed after its last shard.
        let _ = (units.lock(&store), store.sweep());
        fault_point("shards-made");
        store.check_in_place()?;
        say(format!(
            "units {} of {} are complete: {shards} shards, nothing to do",
            units.listed(),
            store.path().display()
        ));
        record::nothing_to_do(jsonl, &store, shards);
        return Ok(0);
    }
    let job = units.job(&args)?;
    fault_point("job-ready");
    work(Task { args: &args, store: &store, units: Some(&units), jsonl, start }, job)
}

/// What a process is to do of a job.
struct Task<'a> {
    args: &'a RunArgs,
    store: &'a FilmStore,
    units: Option<&'a Units>,
    jsonl: Option<&'a Jsonl>,
    start: Instant,
}

impl Task<'_> {
    /// What it is called.
    fn name(&self) -> String {
        let film = self.store.path().display();
        self.units.map_or_else(|| film.to_string(), |u| format!("units {} of {film}", u.listed()))
    }

    fn lock(&self) -> Result<Option<Lock>> {
        match self.units {
            Some(units) => units.lock(self.store),
            None => Ok(self.store.lock(WHOLE, self.args.take_over)?),
        }
    }

    /// Says to programs what is about to be done: shards (all, there already), tiles and their pixels.
    fn tell_start(&self, job: &Job, shards: (usize, usize), tiles: (u64, u64)) {
        let Some(jsonl) = self.jsonl else { return };
        jsonl.begin(((shards.0 - shards.1) as u64, tiles.0, tiles.1));
        let fields = json!({
            "film": json_path(self.store.path()),
            "device": job.device(),
            "engine": job.engine.to_string(),
            "threads": job.threads,
            "pid": std::process::id(),
            "host": Maker::here().host,
            "shards": shards.0,
            "shards_done": shards.1,
            "tiles": tiles.0,
            "pixels": tiles.1,
            "startup_s": self.start.elapsed().as_secs_f64(),
        });
        jsonl.line("start", fields);
    }
}

/// Makes the shards of a task that are not there.
fn work(task: Task<'_>, mut job: Job) -> Result<u8> {
    let Task { args, store, units, .. } = task;
    engine::check_named(store, args)?;
    let asked = shards::asked(&job, units);
    let all: usize = asked.iter().map(BTreeSet::len).sum();
    if shards::missing(&job, store, &asked)?.iter().all(BTreeSet::is_empty) {
        // Leavings of a run that was killed after its last shard; a film that nobody may write to is complete as well.
        let _ = (task.lock(), store.sweep());
        fault_point("shards-made");
        store.check_in_place()?;
        say(format!("{} is complete: {all} shards, nothing to do", task.name()));
        record::nothing_to_do(task.jsonl, store, all);
        return Ok(0);
    }
    let lock = task.lock()?;
    if let Some(lock) = &lock {
        interrupt::release_on_exit(lock.path());
    }
    fault_point("locked");
    if args.no_fsync {
        say("--no-fsync: a power cut may cost shards that were reported as written");
    }
    let swept = store.sweep()?;
    report_kept(&swept);
    if !swept.removed.is_empty() {
        say(format!("removed {} temp files of an interrupted run", swept.removed.len()));
    }
    let wanted = shards::missing(&job, store, &asked)?;
    let missing: usize = wanted.iter().map(BTreeSet::len).sum();
    if missing < all {
        say(format!("resuming {}: {missing} of {all} shards to make", task.name()));
    }
    engine::check(store, job.engine, args)?;
    lay_out(&mut job, &args.film, &wanted)?;
    tell(&job, all);
    let work = Work {
        film: job.frame.film,
        windows: &job.windows,
        bands: std::iter::zip(wanted, std::iter::zip(&job.plans, &job.chart_bands))
            .map(|(wanted, (plan, &chart_band))| BandWork { chart_band, tiling: plan.tiling, wanted })
            .collect(),
        threads: job.threads,
        gpus: &job.queues,
        cancel: interrupt::finish_tiles(),
    };
    let held = Mutex::new(vec![None; job.plans.len()]);
    let prepare = |i: usize| {
        let plan = &job.plans[i];
        let stack = |band: usize| Ok::<_, StageError>(job.lens.psf(band)?);
        let stages =
            plan.stages(i, &job.frame, &job.options, job.gains[i], stack).map_err(SourceSinkError::from)?;
        if let Some(psf) = &stages.psf {
            let of_all =
                plan.lens.psf_energy.iter().zip(psf.kernels().energy()).map(|(pack, crop)| pack * crop);
            let mean = of_all.sum::<f64>() / plan.lens.psf_energy.len() as f64;
            held.lock().expect("no panic while held")[i] = Some(mean);
        }
        Ok(stages)
    };
    let tiles = shards::tiles(&work);
    task.tell_start(&job, (all, all - missing), tiles.iter().fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1)));
    let shown = match task.jsonl {
        Some(jsonl) => Shown::Lines { jsonl, job: &job, store },
        None => {
            let names = job.plans.iter().map(|p| format!("{} nm", p.lens.wavelength_nm)).collect();
            Shown::Bars(Bars::new(names, &tiles.iter().map(|t| t.1).collect::<Vec<_>>()))
        }
    };
    let follow = Follow::new(shown, task.start.elapsed().as_secs_f64(), args.keep_going);
    fault_point("tiles-begin");
    let compute = StageCompute::new(job.frame, job.memory.spectra, &prepare);
    let result = run(&work, job.chart.source(), &Sink(store, &job.film_bands), &compute, &follow);
    follow.shown.finish();
    fault_point("shards-made");
    let outcome = in_place(store, follow.outcome(&job, store, missing as u64, result));
    let outcome =
        outcome.and_then(|summary| match film::same_chart(&job).and_then(|()| job.lens.check_unchanged()) {
            Ok(()) => Ok(summary),
            Err(error) => Err(Box::new(Failed { error, summary: Some(summary) })),
        });
    record::write(&job, store, units, &follow, &outcome, &held.into_inner().expect("no panic while held"));
    let summary = outcome.map_err(|e| e.error)?;
    if summary.shards < missing as u64 {
        say(format!(
            "interrupted: {} of {missing} shards are left; the same command resumes",
            missing as u64 - summary.shards
        ));
        return Ok(code::INTERRUPTED);
    }
    record::done(task.jsonl, &job, &summary);
    Ok(0)
}

/// What a run gave, unless its film was replaced: then whatever it wrote is gone, and that is all there is to report.
fn in_place(store: &FilmStore, outcome: Result<Summary, Box<Failed>>) -> Result<Summary, Box<Failed>> {
    let error = match (store.check_in_place(), &outcome) {
        (Ok(()), _) => return outcome,
        (Err(e @ (FilmError::Replaced { .. } | FilmError::Renewed { .. })), _) | (Err(e), Ok(_)) => e,
        (Err(_), Err(_)) => return outcome,
    };
    let summary = outcome.map_or_else(|failed| failed.summary, Some);
    Err(Box::new(Failed { error: error.into(), summary }))
}

/// A chart whose bands lie among each other is cut into bands once, beside the film.
fn lay_out(job: &mut Job, film: &Path, wanted: &[BTreeSet<ShardId>]) -> Result<()> {
    let open = std::iter::zip(&job.chart_bands, wanted).filter(|(_, wanted)| !wanted.is_empty());
    let bands: Vec<usize> = open.map(|(band, _)| *band).collect();
    let temp = std::env::temp_dir();
    let beside = if is_url(film) { &temp } else { parent_of(film) };
    job.chart.lay_out(&bands, beside, job.memory.decoders)
}

fn tell(job: &Job, shards: usize) {
    let f = &job.frame;
    let on: Vec<String> = job.queues.iter().map(DeviceQueue::name).collect();
    let on = if on.is_empty() { String::new() } else { format!(" beside {}", on.join(", ")) };
    say(format!(
        "{}: {} bands, film {} px of {} µm, {} shards; {} threads{on}, engine {}, memory {} (chart {}, {} {})",
        job.lens.lens().name,
        job.plans.len(),
        f.film,
        f.pitch_um,
        shards,
        job.threads,
        job.engine,
        mib(job.memory.limit),
        mib(job.memory.chart_cache),
        if job.queues.is_empty() { "spectra" } else { "page-locked a GPU" },
        mib(if job.queues.is_empty() { job.memory.spectra } else { job.memory.pinned }),
    ));
    for note in &job.notes {
        say(format!("note: {note}"));
    }
}
