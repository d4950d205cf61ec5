//! `lenscube bench`: performance of this machine on the paper's film, by stage and of a complete job.
//!
//! Every figure is a median over rounds. Rates of stages use all threads, those of codecs one core. The job is a `lenscube run` in a
//! separate process, store to store, on a chart with 1 % noise. Its bound is
//! ```text
//! max(disk, core seconds / cores),   disk = bytes read / read rate + bytes written / write rate
//! ```
//! with the rates measured on the same disk, and the core seconds of all stages from the record of the run. Stages in memory are
//! compared with bounds of their arithmetic and traffic ([`bounds`]); a job that cannot run is reported with the reason.

mod bounds;
mod camera;
mod compare;
mod dataset;
mod gpu;
mod job;
mod stages;
mod storage;

use crate::args::{BenchArgs, Device, check_directory};
use crate::failure;
use crate::machine::device::DeviceSelection;
use crate::machine::threads;
use crate::progress::{log_line, print};
use anyhow::{Context, Result};
use formats::durable::{create_directories, sweep_entries, temp_name};
use pipeline::simd::Simd;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Film of the paper: side in mm and px, number of bands.
const FILM_MM: f64 = 28.282;
const PAPER_PX: f64 = 14_141.0;
const PAPER_BANDS: f64 = 31.0;

/// Settings and results.
struct Bench<'a> {
    args: &'a BenchArgs,
    threads: usize,
    rounds: usize,
    simd: Simd,
    scratch: ScratchDirectory,
    figures: Vec<Figure>,
}

/// One value of the report.
struct Figure {
    key: String,
    value: Value,
}

impl Bench<'_> {
    fn add_number(&mut self, key: &str, value: f64, unit: &str, label: &str) {
        let digits = if value < 10.0 { 2 } else { 1 };
        let line = format!("{label:<58} {value:>10.digits$} {unit}");
        self.add(key, json!((value * 1e4).round() / 1e4), &line);
    }

    fn add_text(&mut self, key: &str, label: &str, value: &str) {
        self.add(key, json!(value), &format!("{label:<58} {value}"));
    }

    /// Adds a figure; without `--json` its line is printed at once, so that it is known whatever fails later.
    fn add(&mut self, key: &str, value: Value, line: &str) {
        if !self.args.json {
            print(line);
        }
        self.figures.push(Figure { key: key.to_owned(), value });
    }

    /// Median of `f` over the rounds.
    fn median(&self, mut f: impl FnMut() -> Result<f64>) -> Result<f64> {
        Ok(median((0..self.rounds).map(|_| f()).collect::<Result<_>>()?))
    }

    /// Median over the rounds of `amount` per second of `f`.
    fn rate(&self, amount: f64, mut f: impl FnMut() -> Result<()>) -> Result<f64> {
        self.median(|| {
            let start = Instant::now();
            f()?;
            Ok(amount / start.elapsed().as_secs_f64())
        })
    }

    /// Value measured earlier.
    fn get(&self, key: &str) -> f64 {
        let found = self.figures.iter().find(|f| f.key == key);
        found.and_then(|f| f.value.as_f64()).expect("measured before")
    }
}

fn median(mut all: Vec<f64>) -> f64 {
    all.sort_by(f64::total_cmp);
    (all[(all.len() - 1) / 2] + all[all.len() / 2]) / 2.0
}

/// Temporary directory, removed when dropped; one left by a killed bench is removed by the next in the same parent.
struct ScratchDirectory(PathBuf);

impl ScratchDirectory {
    fn new(parent: &Path) -> Result<Self> {
        create_directories(parent, false)?;
        sweep_entries(parent)?;
        let path = parent.join(temp_name());
        std::fs::create_dir(&path).with_context(|| format!("creating {}", path.display()))?;
        Ok(Self(path))
    }
}

impl Drop for ScratchDirectory {
    fn drop(&mut self) {
        // An error is ignored: the next bench removes the directory.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Runs the command.
pub fn command(args: &BenchArgs) -> Result<()> {
    if let Some([a, b]) = args.compare.as_deref() {
        return compare::command(a, b);
    }
    check_directory(&args.dir)?;
    let cpu = match args.device {
        Device::Cpu => Some(DeviceSelection::new(&args.device, args.engine.explicit(), None)?),
        // The engine is that of the GPU; codecs are measured with the CPU's default.
        Device::Cuda(_) | Device::Auto => None,
    };
    let simd = cpu.map_or_else(Simd::detect, |choice| choice.simd);
    let mut bench = Bench {
        args,
        threads: threads(args.threads),
        rounds: args.rounds as usize,
        simd,
        scratch: ScratchDirectory::new(&args.dir)?,
        figures: Vec::new(),
    };
    log_line(format!(
        "{} threads of {}, medians of {}; film {} px of {:.3} µm",
        bench.threads,
        simd.isa().name(),
        bench.rounds,
        args.film_size,
        FILM_MM * 1e3 / f64::from(args.film_size)
    ));
    match args.device {
        Device::Cpu => {
            log_line("1/3  stages, in memory");
            stages::measure(&mut bench)?;
            camera::measure(&mut bench)?;
            dataset::measure(&mut bench)?;
        }
        Device::Cuda(_) | Device::Auto => {
            log_line("1/3  GPU kernels and copies");
            gpu::measure(&mut bench)?;
        }
    }
    log_line("2/3  codecs and disk");
    storage::measure(&mut bench)?;
    log_line("3/3  complete job, store to store");
    if let Err(error) = job::measure(&mut bench) {
        let reason = failure::line(&error);
        log_line(format!("note: the job could not be measured: {reason}"));
        bench.add_text("job_error", "job: not measured", &reason);
    }
    if args.json {
        report(&bench);
    }
    Ok(())
}

fn report(bench: &Bench<'_>) {
    let mut map = Map::new();
    map.insert("program".into(), concat!("lenscube ", env!("CARGO_PKG_VERSION")).into());
    map.insert("threads".into(), bench.threads.into());
    map.insert("device".into(), bench.args.device.to_string().into());
    map.insert("engine".into(), bench.simd.isa().name().into());
    map.insert("rounds".into(), bench.rounds.into());
    map.insert("size_px".into(), bench.args.film_size.into());
    map.insert("bands".into(), bench.args.bands.into());
    map.insert("lens".into(), bench.args.lens.clone().into());
    map.extend(bench.figures.iter().map(|f| (f.key.clone(), f.value.clone())));
    print(format!("{:#}", Value::Object(map)));
}
