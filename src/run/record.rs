//! What a run did: on the terminal, and in the film's `runs/*.json`, which may differ from run to run.

use super::faults::{Failed, Follow};
use super::units::Units;
use crate::failure;
use crate::job::Job;
use crate::memory::peak_resident;
use crate::open::Chart;
use crate::progress::jsonl::Jsonl;
use crate::progress::{json_path, say, summary_lines};
use formats::durable::Maker;
use formats::film::FilmStore;
use pipeline::clock::StageTimes;
use pipeline::cuda::memory::DeviceQueue;
use pipeline::executor::Summary;
use serde_json::{Value, json};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::SystemTime;

/// Says to programs that all was done before.
pub fn nothing_to_do(jsonl: Option<&Jsonl>, store: &FilmStore, shards: usize) {
    let Some(jsonl) = jsonl else { return };
    jsonl.line(
        "start",
        json!({ "film": json_path(store.path()), "shards": shards, "shards_done": shards, "tiles": 0, "pixels": 0 }),
    );
    jsonl.line("done", json!({ "code": 0, "shards": 0, "tiles": 0, "pixels": 0, "bytes_read": 0, "bytes_written": 0, "wall_s": 0.0 }));
}

/// Says to programs that all is done.
pub fn done(jsonl: Option<&Jsonl>, job: &Job, summary: &Summary) {
    let Some(jsonl) = jsonl else { return };
    let bytes_read = match &job.chart {
        Chart::Store(s) => Some(s.stats().bytes_read),
        Chart::Raster(r) => Some(r.stats().0),
        Chart::Exr(e) => Some(e.stats().0),
        Chart::Drawn(_) => None,
    };
    let fields = json!({
        "code": 0,
        "shards": summary.shards,
        "tiles": summary.tiles,
        "pixels": summary.pixels,
        "bytes_read": bytes_read,
        "bytes_written": summary.bytes_written,
        "peak_resident_bytes": peak_resident(),
        "wall_s": summary.wall_s,
    });
    jsonl.line("done", fields);
}

/// Tells and keeps what the run did, however it ended.
pub fn write(
    job: &Job,
    store: &FilmStore,
    units: Option<&Units>,
    follow: &Follow<'_>,
    outcome: &Result<Summary, Box<Failed>>,
    light_held: &[Option<f64>],
) {
    let (summary, error) = match outcome {
        Ok(summary) => (Some(summary), None),
        Err(failed) => (failed.summary.as_ref(), Some(failure::line(&failed.error))),
    };
    let (bytes_read, pieces, missing, replaced) = match &job.chart {
        Chart::Store(s) => {
            let s = s.stats();
            (Some(s.bytes_read), Some(s.pieces_decoded), s.missing_pieces, s.nan_replaced)
        }
        Chart::Raster(r) => {
            let (bytes, replaced) = r.stats();
            (Some(bytes), None, 0, replaced)
        }
        Chart::Exr(e) => {
            let (bytes, replaced) = e.stats();
            (Some(bytes), None, 0, replaced)
        }
        Chart::Drawn(_) => (None, None, 0, 0),
    };
    let peak = peak_resident();
    if let Some(summary) = summary {
        let outside = light_held.iter().flatten().map(|held| 1.0 - held);
        let range = outside.fold((1.0f64, 0.0f64), |(a, b), e| (a.min(e), b.max(e)));
        summary_lines(summary, bytes_read.unwrap_or(0), peak, range).into_iter().for_each(say);
    }
    if missing > 0 {
        say(format!("note: {missing} chunks are missing from the chart and were read as its fill value"));
    }
    if replaced > 0 {
        say(format!("note: {replaced} NaN or infinite pixels or fill values of the chart were read as 0"));
    }
    let seconds = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_secs());
    let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
    let interrupted = summary.is_some_and(|s| s.interrupted);
    let record = json!({
        "finished_unix_s": seconds,
        "program": concat!("lenscube ", env!("CARGO_PKG_VERSION")),
        "outcome": if error.is_some() { "failed" } else if interrupted { "interrupted" } else { "complete" },
        "error": error,
        "host": Maker::here().host,
        "plan": units.map(|u| &u.name),
        "units": units.map(Units::listed),
        "bands": job.film_bands,
        "startup_s": follow.startup_s,
        "threads": job.threads,
        "device": job.device(),
        "devices": devices(job, summary),
        "engine": job.engine.to_string(),
        "memory_limit_bytes": job.memory.limit,
        "peak_resident_bytes": peak,
        "wall_s": summary.map_or_else(|| follow.start.elapsed().as_secs_f64(), |s| s.wall_s),
        "tiles": count(&follow.tiles),
        "pixels": count(&follow.pixels),
        "shards": count(&follow.shards),
        "bytes_written": count(&follow.bytes),
        "bytes_read": bytes_read,
        "chart_pieces_decoded": pieces,
        "spectra_built": summary.map(|s| s.spectra),
        "light_in_psf_window": light_held,
        "interrupted": interrupted,
        "thread_s": summary.map(|s| stage_times(&s.times)),
        "core_s": summary.map(|s| stage_times(&s.core)),
    });
    // Workers in containers often have one process id.
    let name = format!("runs/{seconds}-{}-{}.json", Maker::here().host, std::process::id());
    if let Err(e) = store.write_beside(&name, record.to_string().as_bytes()) {
        say(format!("note: the run's record {name} could not be written: {e}"));
    }
}

/// Each queue's GPU, and what it did if the run came to an end.
fn devices(job: &Job, summary: Option<&Summary>) -> Vec<Value> {
    let one = |(i, queue): (usize, &DeviceQueue)| {
        let info = &queue.device.info;
        let mut value = json!({
            "index": info.index,
            "name": info.name,
            "compute_capability": format!("{}.{}", info.compute_capability.0, info.compute_capability.1),
            "driver": format!("{}.{}", info.driver_version.0, info.driver_version.1),
            "device_bytes": queue.device_bytes,
            "host_bytes": queue.host_bytes,
        });
        if let Some(f) = summary.and_then(|s| s.gpus.get(i)) {
            value["did"] = json!({
                "tiles": f.tiles, "batches": f.batches, "pixels": f.pixels,
                "upload_s": f.upload_s, "compute_s": f.compute_s, "download_s": f.download_s, "span_s": f.span_s,
                "bytes_up": f.bytes_up, "bytes_down": f.bytes_down, "left": f.removed,
            });
        }
        value
    };
    job.queues.iter().enumerate().map(one).collect()
}

fn stage_times(t: &StageTimes) -> Value {
    json!({
        "read": t.read_s, "remap": t.remap_s, "svpsf": t.svpsf_s, "add": t.add_s,
        "encode": t.encode_s, "write": t.write_s, "prepare": t.prepare_s,
    })
}
