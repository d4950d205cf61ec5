//! Record of a run: the summary on the terminal, the `done` event, and the film's `runs/*.json`.

use super::monitor::{Monitor, RunFailure};
use super::units::Units;
use crate::failure;
use crate::film::record::{Outcome, RunRecord};
use crate::job::Job;
use crate::job::depth::Depth;
use crate::job::lens::JobLens;
use crate::machine::peak_resident;
use crate::open::Chart;
use crate::progress::jsonl::Jsonl;
use crate::progress::{detail_line, json_path, log_line, summary_details, summary_line};
use formats::durable::ProcessIdentity;
use formats::film::FilmStore;
use formats::object;
use pipeline::clock::{Phase, PhaseTimes};
use pipeline::cuda::memory::DeviceQueue;
use pipeline::executor::Summary;
use serde_json::{Map, Value, json};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::SystemTime;

/// What was read of the chart.
#[derive(Clone, Copy, Debug, Default)]
struct ChartFigures {
    bytes_read: Option<u64>,
    chunks_decoded: Option<u64>,
    missing_chunks: u64,
    nan_replaced: u64,
}

impl ChartFigures {
    fn new(chart: &Chart) -> Self {
        let Some(stats) = chart.stats() else { return Self::default() };
        // Counted for stores alone.
        let chunks_decoded = matches!(chart, Chart::Store(_)).then_some(stats.chunks_decoded);
        Self {
            bytes_read: Some(stats.bytes_read),
            chunks_decoded,
            missing_chunks: stats.missing_chunks,
            nan_replaced: stats.nan_replaced,
        }
    }
}

/// Writes the events of a task without missing shards.
pub fn nothing_to_do(jsonl: Option<&Jsonl>, store: &FilmStore, shards: usize) {
    let Some(jsonl) = jsonl else { return };
    let film = json_path(store.path());
    jsonl.write(
        "start",
        json!({ "film": film, "shards": shards, "shards_done": shards, "tiles": 0, "pixels": 0 }),
    );
    jsonl.write("done", nothing_done());
}

/// The fields of the `done` event of a command that had nothing to compute.
pub fn nothing_done() -> Value {
    json!({ "code": 0, "shards": 0, "tiles": 0, "pixels": 0, "bytes_read": 0, "bytes_written": 0, "wall_s": 0.0 })
}

/// Writes the `done` event.
pub fn write_done_event(jsonl: Option<&Jsonl>, job: &Job, summary: &Summary) {
    let Some(jsonl) = jsonl else { return };
    let fields = json!({
        "code": 0,
        "shards": summary.shards,
        "tiles": summary.tiles,
        "pixels": summary.pixels,
        "bytes_read": ChartFigures::new(&job.chart).bytes_read,
        "bytes_written": summary.bytes_written,
        "peak_resident_bytes": peak_resident(),
        "wall_s": summary.wall_s,
    });
    jsonl.write("done", fields);
}

/// Prints the summary of a run, however it ended, and writes its record; `energy` is the share of the light inside the PSF windows per
/// position.
pub fn write(
    job: &Job,
    store: &FilmStore,
    units: Option<&Units>,
    monitor: &Monitor<'_>,
    outcome: &Result<Summary, Box<RunFailure>>,
    energy: &[Option<f64>],
) {
    let chart = ChartFigures::new(&job.chart);
    let record = record(job, units, monitor, outcome, energy, &chart);
    let summary = outcome.as_ref().map_or_else(|failure| failure.summary.as_ref(), Some);
    let has_tails = job.plans.iter().any(|plan| plan.tail.is_some());
    print_summary(summary, &chart, (energy, has_tails));
    print_hidden(job);
    // The process number alone is not unique: workers in containers often have the same one.
    let seconds = record.finished_unix_s.unwrap_or(0);
    let name = format!("runs/{seconds}-{}-{}.json", ProcessIdentity::current().host, std::process::id());
    let text = serde_json::to_vec(&record).expect("a record is JSON");
    if let Err(e) = store.group().write_record(&name, &text) {
        log_line(format!("note: the run's record {name} could not be written: {e}"));
    }
}

/// The words of the command; of a sealed lens without the path of its pack.
fn command_line(lens: &JobLens) -> Vec<String> {
    let words = std::env::args_os().map(|word| word.to_string_lossy().into_owned());
    match lens.pack().filter(|_| lens.is_sealed()).map(|pack| pack.path().display().to_string()) {
        None => words.collect(),
        Some(path) => words.map(|word| word.replace(&path, &lens.lens().name)).collect(),
    }
}

fn record(
    job: &Job,
    units: Option<&Units>,
    monitor: &Monitor<'_>,
    outcome: &Result<Summary, Box<RunFailure>>,
    energy: &[Option<f64>],
    chart: &ChartFigures,
) -> RunRecord {
    let (summary, error) = match outcome {
        Ok(summary) => (Some(summary), None),
        Err(failure) => (failure.summary.as_ref(), Some(failure::line(&failure.error))),
    };
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
    let interrupted = summary.is_some_and(|s| s.interrupted);
    let details = object! {
        "program": concat!("lenscube ", env!("CARGO_PKG_VERSION")),
        "command_line": command_line(&job.lens),
        "host": ProcessIdentity::current().host,
        "plan": units.map(|u| &u.name),
        "units": units.map(Units::listed),
        "bands": job.film_bands,
        "startup_s": monitor.startup_s,
        "threads": job.threads,
        "device": job.device(),
        "devices": gpus(job, summary),
        "engine": job.engine.to_string(),
        "memory_limit_bytes": job.memory.limit,
        "memory_planned_bytes": job.memory.planned,
        "peak_resident_bytes": peak_resident(),
        "pixels": count(&monitor.pixels),
        "bytes_written": count(&monitor.bytes),
        "bytes_read": chart.bytes_read,
        "chart_chunks_decoded": chart.chunks_decoded,
        "spectra_built": summary.map(|s| s.spectra),
        "light_in_psf_window": energy,
        "interrupted": interrupted,
        "thread_s": summary.map(|s| seconds_by_phase(&s.times)),
        "core_s": summary.map(|s| seconds_by_phase(&s.core)),
    };
    RunRecord {
        finished_unix_s: Some(now.map_or(0, |d| d.as_secs())),
        outcome: match (&error, interrupted) {
            (Some(_), _) => Outcome::Failed,
            (None, true) => Outcome::Interrupted,
            (None, false) => Outcome::Complete,
        },
        error,
        wall_s: summary.map_or_else(|| monitor.start.elapsed().as_secs_f64(), |s| s.wall_s),
        tiles: count(&monitor.tiles),
        shards: count(&monitor.shards),
        details,
    }
}

fn print_summary(
    summary: Option<&Summary>,
    chart: &ChartFigures,
    (energy, has_tails): (&[Option<f64>], bool),
) {
    if let Some(summary) = summary {
        let outside = energy.iter().flatten().map(|inside| 1.0 - inside);
        let range = outside.fold((1.0f64, 0.0f64), |(a, b), e| (a.min(e), b.max(e)));
        let bytes_read = chart.bytes_read.unwrap_or(0);
        log_line(summary_line(summary));
        let details = summary_details(summary, bytes_read, peak_resident(), range, has_tails);
        details.into_iter().for_each(detail_line);
    }
    if chart.missing_chunks > 0 {
        log_line(format!(
            "note: {} chunks are missing from the chart and were read as its fill value",
            chart.missing_chunks
        ));
    }
    if chart.nan_replaced > 0 {
        log_line(format!(
            "note: {} NaN or infinite pixels or fill values of the chart were read as 0",
            chart.nan_replaced
        ));
    }
}

/// Prints what was missing or replaced in the arrays of distances, and of hidden surfaces.
fn print_hidden(job: &Job) {
    let figures = job.depth.iter().flat_map(Depth::charts).map(ChartFigures::new);
    let (missing, replaced) =
        figures.fold((0, 0), |(m, n), f: ChartFigures| (m + f.missing_chunks, n + f.nan_replaced));
    // A scene of this program leaves out chunks that are empty.
    if missing > 0 && !matches!(job.chart, Chart::Scene(_)) {
        log_line(format!(
            "note: {missing} chunks are missing from distances, coverages or charts of hidden surfaces and were read as their fill values"
        ));
    }
    if replaced > 0 {
        log_line(format!(
            "note: {replaced} NaN or infinite pixels or fill values of charts of hidden surfaces were read as 0"
        ));
    }
}

/// Each queue's GPU, and its work unless the run was stopped by an error.
fn gpus(job: &Job, summary: Option<&Summary>) -> Vec<Value> {
    let gpu = |(i, queue): (usize, &DeviceQueue)| {
        let (info, loading) = (&queue.device.info, queue.device.kernel_loading());
        let threads: Map<String, Value> = queue
            .device
            .thread_resources()
            .into_iter()
            .map(|(kernel, t)| (kernel, json!({ "registers": t.registers, "local_bytes": t.local_bytes })))
            .collect();
        let mut value = json!({
            "index": info.index,
            "name": info.name,
            "compute_capability": format!("{}.{}", info.compute_capability.0, info.compute_capability.1),
            "driver": format!("{}.{}", info.driver_version.0, info.driver_version.1),
            "device_bytes": queue.device_bytes,
            "host_bytes": queue.host_bytes,
            "kernels": { "cubins": loading.cubins, "assembled": loading.assembled, "s": loading.seconds, "threads": threads },
        });
        if let Some(f) = summary.and_then(|s| s.gpus.get(i)) {
            value["did"] = json!({
                "tiles": f.tiles, "batches": f.batches, "pixels": f.pixels, "spectra": f.spectra,
                "upload_s": f.upload_s, "compute_s": f.compute_s, "download_s": f.download_s, "span_s": f.span_s,
                "host": {
                    "descriptors_s": f.host.descriptors_s, "base_kernels_s": f.host.base_kernels_s,
                },
                "launch": {
                    "core_s": f.launch.core_s, "wait_plan_s": f.launch.plan_s, "wait_chart_s": f.launch.chart_s,
                    "wait_strip_s": f.launch.strip_s, "wait_batch_s": f.launch.batch_s,
                },
                "bytes_up": f.bytes_up, "bytes_down": f.bytes_down, "left": f.removed,
            });
        }
        value
    };
    job.queues.iter().enumerate().map(gpu).collect()
}

fn seconds_by_phase(times: &PhaseTimes) -> Value {
    Phase::ALL
        .iter()
        .map(|&phase| (phase.name().to_owned(), json!(times.of(phase))))
        .collect::<Map<_, _>>()
        .into()
}
