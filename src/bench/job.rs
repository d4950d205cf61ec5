//! A short job of its own process, and what bounds it.

use super::storage::forget;
use super::{Bench, FILM_MM, PAPER_BANDS, PAPER_PX};
use crate::chart::write;
use crate::progress::say;
use anyhow::{Context, Result, ensure};
use formats::chart::Codec;
use pipeline::chart::Generator;
use serde_json::{Value, json};
use std::path::Path;
use std::process::{Command, Stdio};

/// Stages as the run's record names them.
const STAGES: [&str; 7] = ["read", "remap", "svpsf", "add", "encode", "write", "prepare"];

pub(super) fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let args = bench.args;
    let (chart, film) = (bench.scratch.0.join("chart.zarr"), bench.scratch.0.join("film.zarr"));
    let wavelengths = wavelengths(args.bands);
    let pitch_um = FILM_MM * 1e3 / f64::from(args.size);
    let spec =
        format!("composite?size={}&pitch_um={pitch_um}&wavelengths={wavelengths}&noise=0.01", args.size);
    let drawn: Generator = spec.parse()?;
    write(&drawn, &chart, Codec::Zstd, bench.threads, true)?;
    let mut records = Vec::new();
    for round in 0..bench.rounds {
        forget(&chart)?;
        say(format!("     run {} of {}", round + 1, bench.rounds));
        records.push(run(bench, &chart, &film)?);
    }
    records.sort_by(|a, b| number(a, "wall_s").total_cmp(&number(b, "wall_s")));
    let record = records.swap_remove(records.len() / 2);
    let words = format!("job: {} bands ({wavelengths} nm), store to store", args.bands);
    let wall = number(&record, "wall_s");
    bench.number("job_s", wall, "s", &words);
    let core = &record["core_s"];
    let core_s: f64 = STAGES.iter().map(|s| number(core, s)).sum();
    let disk_s = 1e-6
        * (number(&record, "bytes_read") / bench.get("disk_read_mb_s")
            + number(&record, "bytes_written") / bench.get("disk_write_mb_s"));
    let cores = std::thread::available_parallelism().map_or(1, usize::from).min(bench.threads) as f64;
    let on_devices = devices(bench, &record);
    let bound = disk_s.max(core_s / cores).max(on_devices);
    let words = match on_devices > 0.0 {
        true => "  its bound, max(disk, core seconds / cores, GPU streams)",
        false => "  its bound, max(disk, core seconds / cores)",
    };
    bench.number("job_bound_s", bound, "s", words);
    bench.number("job_over_bound", wall / bound, "", "  over its bound");
    bench.number("job_disk_s", disk_s, "s", "  disk: bytes over the rates above");
    bench.number("job_core_s", core_s, "s", "  core seconds of all stages");
    for (stage, key) in STAGES.into_iter().zip(KEYS) {
        bench.number(key, number(core, stage), "s", &format!("    {stage}"));
    }
    bench.number("job_read_gb", number(&record, "bytes_read") * 1e-9, "GB", "  read");
    bench.number("job_written_gb", number(&record, "bytes_written") * 1e-9, "GB", "  written");
    bench.number(
        "peak_rss_mib",
        number(&record, "peak_resident_bytes") / f64::from(1 << 20),
        "MiB",
        "  peak memory",
    );
    let of_paper = PAPER_BANDS / f64::from(args.bands) * (PAPER_PX / f64::from(args.size)).powi(2);
    let words = "forecast of the paper's job (31 bands of 14141 x 14141 px)";
    bench.number("forecast_paper_job_s", wall * of_paper, "s", words);
    Ok(())
}

/// Keys of the busy shares of a GPU's streams.
const STREAMS: [(&str, &str, &str); 3] = [
    ("upload_s", "gpu_upload_busy", "  upload stream busy, of the GPU's time"),
    ("compute_s", "gpu_compute_busy", "  compute stream busy"),
    ("download_s", "gpu_download_busy", "  download stream busy"),
];

/// The busy shares of the GPUs' streams, over all of them; the seconds of the busiest stream.
fn devices(bench: &mut Bench<'_>, record: &Value) -> f64 {
    let all = record["devices"].as_array().map_or(&[][..], Vec::as_slice);
    let sum = |key: &str| all.iter().map(|d| number(&d["did"], key)).sum::<f64>();
    let span = sum("span_s");
    if span > 0.0 {
        for (key, share, words) in STREAMS {
            bench.number(share, sum(key) / span, "", words);
        }
    }
    let busiest = |d: &Value| STREAMS.iter().map(|s| number(&d["did"], s.0)).fold(0.0, f64::max);
    all.iter().map(busiest).fold(0.0, f64::max)
}

/// Keys of the stages' core seconds in the report, in the order of [`STAGES`].
const KEYS: [&str; 7] = [
    "job_core_read_s",
    "job_core_remap_s",
    "job_core_svpsf_s",
    "job_core_add_s",
    "job_core_encode_s",
    "job_core_write_s",
    "job_core_prepare_s",
];

/// `bands` wavelengths of 400..700 nm step 10, spread evenly.
fn wavelengths(bands: u32) -> String {
    let nm = |i: u32| 400 + 10 * ((31 * (2 * i + 1)) / (2 * bands));
    (0..bands).map(|i| nm(i).to_string()).collect::<Vec<_>>().join(",")
}

fn number(record: &Value, key: &str) -> f64 {
    record[key].as_f64().unwrap_or(0.0)
}

/// Runs the job anew and reads its record.
fn run(bench: &Bench<'_>, chart: &Path, film: &Path) -> Result<Value> {
    let program = std::env::current_exe().context("finding this program")?;
    let mut command = Command::new(program);
    command.arg("run").arg(chart).arg(film).args(["--overwrite", "--lens", &bench.args.lens]);
    command.args(["--device", &bench.args.device.to_string()]);
    command.args(["--engine", &bench.args.engine.to_string()]);
    command.args(["--threads", &bench.threads.to_string(), "--memory", &bench.args.memory.to_string()]);
    let done = command.stdin(Stdio::null()).output().context("starting `lenscube run`")?;
    let words = String::from_utf8_lossy(&done.stderr);
    ensure!(done.status.success(), "`lenscube run` failed: {}", words.lines().last().unwrap_or_default());
    let runs = film.join("runs");
    let mut found = std::fs::read_dir(&runs).with_context(|| format!("listing {}", runs.display()))?;
    let record = found.next().context("the run left no record")??.path();
    let text = std::fs::read(&record).with_context(|| format!("reading {}", record.display()))?;
    Ok(serde_json::from_slice(&text).unwrap_or(json!(null)))
}

#[cfg(test)]
mod tests {
    #[test]
    fn bands_are_spread_over_the_papers() {
        assert_eq!(super::wavelengths(1), "550");
        assert_eq!(super::wavelengths(2), "470,630");
        let all = super::wavelengths(31);
        assert!(all.starts_with("400,410,420") && all.ends_with("690,700"), "{all}");
    }
}
