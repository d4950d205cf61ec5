//! Steps 7 and 8 of a run: the shards of a task are computed and written, and what the run found is checked, recorded and printed.

use super::display::Display;
use super::monitor::{Monitor, RunFailure};
use super::record;
use super::shards;
use super::sink::FilmStoreSink;
use super::task::{ShardCount, Task};
use crate::failure::code;
use crate::film;
use crate::job::Job;
use crate::job::depth::Depth;
use crate::job::stages::prepare;
use crate::progress::interrupt;
use crate::progress::{Bars, detail_line, log_line, number, resume_note};
use anyhow::Result;
use formats::durable::fault_point;
use formats::film::{FilmStore, FilmWriter};
use formats::group::GroupError;
use pipeline::depth::SceneInputs;
use pipeline::depth::counts::{Counts, SharedCounts};
use pipeline::depth::invented::InventedLight;
use pipeline::executor::{BandWork, Summary, Work, run};
use pipeline::stages::StageCompute;
use pipeline::tiling::ShardId;
use std::collections::BTreeSet;
use std::sync::Mutex;

/// Computes and writes the shards `missing`, per position of the job.
pub fn execute(
    task: &Task<'_>,
    job: &Job,
    count: &ShardCount,
    missing: Vec<BTreeSet<ShardId>>,
) -> Result<u8> {
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
    let compute = StageCompute::new(job.frame, job.memory.spectra_in_turn, &prepare)
        .with_surfaces(SceneInputs { sheets: &sheets, invented: invented.as_ref(), counts: Some(&counts) });
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
