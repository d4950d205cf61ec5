//! `lenscube plan`: a job cut into units that any number of processes do, in any order and more than once.

mod cost;
pub mod cut;
pub mod file;
pub mod list;
mod outputs;
mod pack;
pub mod words;

use crate::args::{Device, EngineArg, PlanArgs, RunArgs};
use crate::engine;
use crate::failure::usage;
use crate::job::{Job, Part};
use crate::open::is_builtin;
use crate::progress::{print, say};
use crate::run::film;
use anyhow::Result;
use file::{Plan, Totals};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use std::time::Instant;
use words::{Words, absolute, absolute_path};

/// Units at which a scheduler's array limit is worth a word.
const MANY: usize = 1000;
/// Share of a unit beyond which start-up is worth a word.
const DEAR: f64 = 0.1;

/// Refuses `--pyramid` where no process knows when the film is complete.
pub fn no_pyramid(args: &RunArgs) -> Result<()> {
    match args.pyramid {
        true => Err(usage(
            "--pyramid: a unit does not end the film; run `lenscube pyramid FILM` after the last one",
        )),
        false => Ok(()),
    }
}

/// Runs the command; the exit code.
pub fn command(args: &PlanArgs) -> Result<u8> {
    no_pyramid(&args.job)?;
    // A plan is made without the devices that its units will run on.
    let mut run = RunArgs { device: Device::Cpu, engine: EngineArg::Auto, ..args.job.clone() };
    // All outputs are checked before any is touched.
    outputs::keep_apart(args)?;
    file::check_place(&args.output)?;
    if let Some(path) = &args.lens_pack {
        run.lens = pack::write(&run, path)?;
    }
    let words = resolved(&run)?;
    let engine = engine::planned(&args.job)?;
    let mut job = Job::new(&run)?;
    job.engine = engine;
    film::keep_apart(&job, &run.film)?;
    let units = cut::units(&job, args.unit_rows);
    let provenance = film::provenance_of(&job, &run)?;
    let told = |key: &str| provenance.get(key).and_then(Value::as_str).unwrap_or_default().to_owned();
    let bands = job.plans.iter().map(|p| job.lens.band_digest(p.choice)).collect::<Result<_, _>>()?;
    let plan = Plan {
        schema: Plan::schema(),
        program: concat!("lenscube ", env!("CARGO_PKG_VERSION")).into(),
        command: words,
        job_digest: told("job_digest"),
        layout_digest: told("layout_digest"),
        engine: told("engine"),
        // As the film says: a chart that was touched since and trusted is the one that it was begun with.
        job: provenance.get("job").and_then(Value::as_object).cloned().unwrap_or_default(),
        layout: film::layout(&job.film),
        lens_bands: bands,
        wavelengths_nm: job.film.wavelengths_nm.clone(),
        outputs: cut::outputs(&job),
        totals: cut::totals(&units),
        units,
    };
    plan.check_output(&args.output)?;
    let store = film::open(&job, &run)?;
    engine::check_planned(&store, engine, run.mixed_engines)?;
    plan.check_film(&args.output, &store)?;
    let path = plan.write(&args.output)?;
    for note in &job.notes {
        say(format!("note: {note}"));
    }
    tell(&plan, &path);
    start_up(&plan, &run)?;
    print(path.display());
    Ok(0)
}

/// The command as other processes must give it: absolute paths, the lens always named. A built-in lens keeps its name, which
/// is no path: what `--lens` means does not depend on the files where a worker starts.
fn resolved(run: &RunArgs) -> Result<Words> {
    let mut words = Words::typed()?;
    let film =
        run.film.to_str().ok_or_else(|| usage("the film's path is no UTF-8, which a plan cannot hold"))?;
    words.chart = Some(absolute(&run.chart)?);
    words.film = Some(absolute_path(film)?);
    let lens = if is_builtin(&run.lens) { run.lens.clone() } else { absolute_path(&run.lens)? };
    words.flags.retain(|flag| !flag.starts_with("--lens="));
    words.flags.insert(0, format!("--lens={lens}"));
    Ok(words)
}

/// What the cut is, for people.
fn tell(plan: &Plan, path: &Path) {
    let Totals { shards, tiles, tiles_again, .. } = plan.totals;
    let n = plan.units.len();
    let first = &plan.units[0];
    let rows: usize = first.rows.values().map(|(first, end)| end - first).sum();
    let most = |of: fn(&Totals) -> u64| plan.units.iter().map(|u| of(&u.cost)).max().unwrap_or(0) as f64;
    let core_s =
        |pick: fn(f64, f64) -> f64| plan.units.iter().map(|u| u.cost.core_s).reduce(pick).unwrap_or(0.0);
    let many = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    say(format!(
        "{}: {}, 0 to {}, of at most {} x {} each, {shards} shards; {tiles_again} of {tiles} tiles ({:.1} %) are computed twice, \
         for light crosses the cuts",
        path.display(),
        many(n, "unit"),
        n - 1,
        many(first.bands.len(), "band"),
        many(rows, "shard row"),
        100.0 * tiles_again as f64 / tiles as f64
    ));
    say(format!(
        "a unit: about {:.2} to {:.2} core seconds, reads {:.2} GB and writes {:.2} GB at most before compression, GPU memory {:.1} GiB",
        core_s(f64::min),
        core_s(f64::max),
        most(|c| c.bytes_read) * 1e-9,
        most(|c| c.bytes_written) * 1e-9,
        most(|c| c.gpu_bytes) / f64::from(1 << 30)
    ));
    if n > MANY {
        say(format!("note: {n} units; array jobs of many clusters take {MANY} at most: larger --unit-rows"));
    }
}

/// Measures what a worker does before its first pixel, on the cheapest unit, and tells it.
fn start_up(plan: &Plan, run: &RunArgs) -> Result<()> {
    let Some(unit) = plan.units.iter().min_by(|a, b| a.cost.core_s.total_cmp(&b.cost.core_s)) else {
        return Ok(());
    };
    let start = Instant::now();
    let bands = plan.bands(&BTreeSet::from([unit.unit]));
    let job = Job::of(run, Some(plan.part(&bands)))?;
    let opening = start.elapsed().as_secs_f64();
    let stack = |band: usize| Ok::<_, anyhow::Error>(job.lens.psf(band)?);
    job.plans[0].stages(0, &job.frame, &job.options, job.gains[0], stack)?;
    let kernels = start.elapsed().as_secs_f64() - opening;
    let all = opening + kernels;
    let share = all / (all + unit.cost.core_s / job.threads as f64);
    say(format!(
        "start-up of a worker, measured here for unit {}: opening {opening:.3} s, kernels {kernels:.3} s; {:.1} % of the unit on {} \
         threads",
        unit.unit,
        100.0 * share,
        job.threads
    ));
    if share > DEAR {
        say("note: so small a job is done soonest by one `lenscube run`");
    }
    Ok(())
}

impl Plan {
    /// What a process that does `bands` needs to know.
    pub fn part<'a>(&'a self, bands: &'a [usize]) -> Part<'a> {
        let lens_digest = self.job.get("lens_digest").and_then(Value::as_str).unwrap_or_default();
        Part { bands, lens_bands: &self.lens_bands, lens_digest }
    }
}
