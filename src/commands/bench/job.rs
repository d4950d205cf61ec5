//! Complete job in a separate process, compared with its bound.

use super::storage::drop_from_page_cache;
use super::{Bench, FILM_MM, PAPER_BANDS, PAPER_PX};
use crate::commands::chart::write;
use crate::progress::log_line;
use anyhow::{Context, Result, ensure};
use formats::chart::Codec;
use pipeline::chart::Generator;
use pipeline::clock::Phase;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};

pub(super) fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let args = bench.args;
    let (chart, film) = (bench.scratch.0.join("chart.zarr"), bench.scratch.0.join("film.zarr"));
    let wavelengths = wavelengths(args.bands);
    let pitch_um = FILM_MM * 1e3 / f64::from(args.film_size);
    let spec =
        format!("composite?size={}&pitch_um={pitch_um}&wavelengths={wavelengths}&noise=0.01", args.film_size);
    let drawn: Generator = spec.parse()?;
    write(&drawn, &chart, Codec::default(), bench.threads, true)?;
    let mut records = Vec::new();
    for round in 0..bench.rounds {
        drop_from_page_cache(&chart)?;
        log_line(format!("     run {} of {}", round + 1, bench.rounds));
        let record = run(bench, &chart, &film)?;
        records.push((number(&record, "wall_s")?, record));
    }
    records.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (wall, record) = records.swap_remove(records.len() / 2);
    let label = format!("job: {} bands ({wavelengths} nm), store to store", args.bands);
    bench.add_number("job_s", wall, "s", &label);
    let core = &record["core_s"];
    let stages_s = Phase::ALL.iter().map(|p| number(core, p.name())).collect::<Result<Vec<_>>>()?;
    let core_s: f64 = stages_s.iter().sum();
    let (read, written) = (number(&record, "bytes_read")?, number(&record, "bytes_written")?);
    let disk_s = 1e-6 * (read / bench.get("disk_read_mb_s") + written / bench.get("disk_write_mb_s"));
    let cores = std::thread::available_parallelism().map_or(1, usize::from).min(bench.threads) as f64;
    let stream_s = add_streams(bench, &record)?;
    let bound = disk_s.max(core_s / cores).max(stream_s);
    let label = match stream_s > 0.0 {
        true => "  its bound, max(disk, core seconds / cores, GPU streams)",
        false => "  its bound, max(disk, core seconds / cores)",
    };
    bench.add_number("job_bound_s", bound, "s", label);
    bench.add_number("job_over_bound", wall / bound, "", "  time over bound");
    bench.add_number("job_disk_s", disk_s, "s", "  disk: bytes over the measured rates");
    bench.add_number("job_core_s", core_s, "s", "  core seconds of all stages");
    for (phase, seconds) in Phase::ALL.iter().zip(stages_s) {
        let name = phase.name();
        bench.add_number(&format!("job_core_{name}_s"), seconds, "s", &format!("    {name}"));
    }
    // Shares of the wall time that the bounds of reading and writing are.
    for (key, bytes, rate, label) in [
        ("job_read_of_wall", read, "disk_read_mb_s", "  reading at the disk's rate, of the time"),
        ("job_write_of_wall", written, "disk_write_mb_s", "  writing at the disk's rate, of the time"),
    ] {
        bench.add_number(key, 1e-6 * bytes / bench.get(rate) / wall, "", label);
    }
    bench.add_number("job_read_gb", read * 1e-9, "GB", "  read");
    bench.add_number("job_written_gb", written * 1e-9, "GB", "  written");
    // Not known on every system.
    if let Some(bytes) = record["peak_resident_bytes"].as_f64() {
        bench.add_number("peak_rss_mib", bytes / f64::from(1 << 20), "MiB", "  peak memory");
    }
    let scale = PAPER_BANDS / f64::from(args.bands) * (PAPER_PX / f64::from(args.film_size)).powi(2);
    let label = "forecast of the paper's job (31 bands of 14141 x 14141 px)";
    bench.add_number("forecast_paper_job_s", wall * scale, "s", label);
    Ok(())
}

/// Streams of a GPU: key in the record, key and label of the busy share.
const STREAMS: [(&str, &str, &str); 3] = [
    ("upload_s", "gpu_upload_busy", "  upload stream busy, of the GPU's time"),
    ("compute_s", "gpu_compute_busy", "  compute stream busy"),
    ("download_s", "gpu_download_busy", "  download stream busy"),
];

/// Adds the busy shares of the streams, over all GPUs; the seconds of the busiest stream.
///
/// # Errors
/// The record lacks a figure.
fn add_streams(bench: &mut Bench<'_>, record: &Value) -> Result<f64> {
    let devices = record["devices"].as_array().context("the run record has no list `devices`")?;
    let (mut span_s, mut busy_s, mut busiest_s) = (0.0, [0.0; STREAMS.len()], 0.0f64);
    for device in devices {
        span_s += number(&device["did"], "span_s")?;
        for (sum, (key, ..)) in busy_s.iter_mut().zip(STREAMS) {
            let seconds = number(&device["did"], key)?;
            *sum += seconds;
            busiest_s = busiest_s.max(seconds);
        }
    }
    if span_s > 0.0 {
        for (sum, (_, share, label)) in busy_s.into_iter().zip(STREAMS) {
            bench.add_number(share, sum / span_s, "", label);
        }
    }
    Ok(busiest_s)
}

/// `bands` wavelengths of 400..700 nm step 10, evenly spaced.
fn wavelengths(bands: u32) -> String {
    let nm = |i: u32| 400 + 10 * ((31 * (2 * i + 1)) / (2 * bands));
    (0..bands).map(|i| nm(i).to_string()).collect::<Vec<_>>().join(",")
}

/// A figure of a run's record.
///
/// # Errors
/// There is no such number.
fn number(record: &Value, key: &str) -> Result<f64> {
    record[key].as_f64().with_context(|| format!("the run record has no number `{key}`"))
}

/// Runs the job and reads its record.
fn run(bench: &Bench<'_>, chart: &Path, film: &Path) -> Result<Value> {
    let program = std::env::current_exe().context("finding this program")?;
    let mut command = Command::new(program);
    command.arg("run").arg(chart).arg(film).args(["--overwrite", "--lens", &bench.args.lens]);
    command.args(["--device", &bench.args.device.to_string()]);
    command.args(["--engine", &bench.args.engine.to_string()]);
    command.args(["--threads", &bench.threads.to_string(), "--memory", &bench.args.memory.to_string()]);
    let done = command.stdin(Stdio::null()).output().context("starting `lenscube run`")?;
    let log = String::from_utf8_lossy(&done.stderr);
    ensure!(done.status.success(), "`lenscube run` failed: {}", log.lines().last().unwrap_or_default());
    let runs = film.join("runs");
    let mut records = std::fs::read_dir(&runs).with_context(|| format!("listing {}", runs.display()))?;
    let record = records.next().context("the run wrote no record")??.path();
    let text = std::fs::read(&record).with_context(|| format!("reading {}", record.display()))?;
    serde_json::from_slice(&text).with_context(|| format!("parsing {}", record.display()))
}

#[cfg(test)]
mod tests {
    #[test]
    fn figure_missing_in_the_record_is_an_error() {
        let record = serde_json::json!({ "wall_s": 2.5, "peak_resident_bytes": null });
        assert_eq!(super::number(&record, "wall_s").unwrap(), 2.5);
        for key in ["peak_resident_bytes", "bytes_read"] {
            let error = super::number(&record, key).unwrap_err().to_string();
            assert!(error.contains(&format!("`{key}`")), "{error}");
        }
    }

    #[test]
    fn wavelengths_are_evenly_spaced_over_the_bands_of_the_paper() {
        assert_eq!(super::wavelengths(1), "550");
        assert_eq!(super::wavelengths(2), "470,630");
        let all = super::wavelengths(31);
        assert!(all.starts_with("400,410,420") && all.ends_with("690,700"), "{all}");
    }
}
