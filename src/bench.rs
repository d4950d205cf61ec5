//! `lenscube bench`: what this machine does with the paper's film, stage by stage and all together.
//!
//! Every figure is the median of some rounds. Rates of stages count all threads at once, those of codecs one core. The job
//! at the end is a `lenscube run` of its own process, store to store, on a chart with 1 % noise; its bound is
//!     max(disk, core seconds / cores),   disk = bytes read / read rate + bytes written / write rate
//! with the rates measured here on the same disk, and every stage's core seconds as the run itself counts them.

mod gpu;
mod job;
mod stages;
mod storage;

use crate::args::{BenchArgs, Device, check_directory};
use crate::device::Choice;
use crate::job::threads;
use crate::progress::{print, say};
use anyhow::{Context, Result};
use formats::durable::{create_directories, sweep_entries, temp_name};
use pipeline::simd::Simd;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The paper's film: side in mm and in pixels, bands.
const FILM_MM: f64 = 28.282;
const PAPER_PX: f64 = 14_141.0;
const PAPER_BANDS: f64 = 31.0;

/// What is measured, and with what.
struct Bench<'a> {
    args: &'a BenchArgs,
    threads: usize,
    rounds: usize,
    simd: Simd,
    scratch: Scratch,
    figures: Vec<Figure>,
}

/// One number of the report.
struct Figure {
    key: &'static str,
    value: Value,
    words: String,
}

impl Bench<'_> {
    fn number(&mut self, key: &'static str, value: f64, unit: &str, words: &str) {
        let digits = if value < 10.0 { 2 } else { 1 };
        let text = format!("{words:<58} {value:>10.digits$} {unit}");
        self.figures.push(Figure { key, value: json!((value * 1e4).round() / 1e4), words: text });
    }

    fn word(&mut self, key: &'static str, value: Value) {
        let words = format!("{key:<58} {}", value.as_str().unwrap_or_default());
        self.figures.push(Figure { key, value, words });
    }

    /// The median over the rounds of what `f` tells.
    fn median(&self, mut f: impl FnMut() -> Result<f64>) -> Result<f64> {
        Ok(median((0..self.rounds).map(|_| f()).collect::<Result<_>>()?))
    }

    /// Median rate in `amount` per second.
    fn rate(&self, amount: f64, mut f: impl FnMut() -> Result<()>) -> Result<f64> {
        self.median(|| {
            let start = Instant::now();
            f()?;
            Ok(amount / start.elapsed().as_secs_f64())
        })
    }

    fn get(&self, key: &str) -> f64 {
        let found = self.figures.iter().find(|f| f.key == key);
        found.and_then(|f| f.value.as_f64()).expect("measured before")
    }
}

fn median(mut all: Vec<f64>) -> f64 {
    all.sort_by(f64::total_cmp);
    (all[(all.len() - 1) / 2] + all[all.len() / 2]) / 2.0
}

/// A directory of the bench's own, removed when it ends; what a killed one left is swept by the next in the same place.
struct Scratch(PathBuf);

impl Scratch {
    fn new(beside: &Path) -> Result<Self> {
        create_directories(beside, false)?;
        sweep_entries(beside)?;
        let path = beside.join(temp_name());
        std::fs::create_dir(&path).with_context(|| format!("creating {}", path.display()))?;
        Ok(Self(path))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // What cannot be removed is said by nobody: the measurement is over.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Runs the command.
pub fn command(args: &BenchArgs) -> Result<()> {
    check_directory(&args.dir)?;
    let of_cpu = match args.device {
        Device::Cpu => Some(Choice::new(&args.device, args.engine.named(), None)?),
        // The job's choice; what is measured of the processor beside GPUs is not theirs.
        Device::Cuda(_) | Device::Auto => None,
    };
    let simd = of_cpu.map_or_else(Simd::detect, |choice| choice.simd);
    let mut bench = Bench {
        args,
        threads: threads(args.threads),
        rounds: args.rounds as usize,
        simd,
        scratch: Scratch::new(&args.dir)?,
        figures: Vec::new(),
    };
    say(format!(
        "{} threads of {}, medians of {}; film {} px of {:.3} µm",
        bench.threads,
        simd.isa().name(),
        bench.rounds,
        args.size,
        FILM_MM * 1e3 / f64::from(args.size)
    ));
    match args.device {
        Device::Cpu => {
            say("1/3  stages, in memory");
            stages::measure(&mut bench)?;
        }
        Device::Cuda(_) | Device::Auto => {
            say("1/3  kernels and copies");
            gpu::measure(&mut bench)?;
        }
    }
    say("2/3  codecs and disk");
    storage::measure(&mut bench)?;
    say("3/3  a job, store to store");
    job::measure(&mut bench)?;
    report(&bench);
    Ok(())
}

fn report(bench: &Bench<'_>) {
    if !bench.args.json {
        for figure in &bench.figures {
            print(&figure.words);
        }
        return;
    }
    let mut map = Map::new();
    map.insert("program".into(), concat!("lenscube ", env!("CARGO_PKG_VERSION")).into());
    map.insert("threads".into(), bench.threads.into());
    map.insert("device".into(), bench.args.device.to_string().into());
    map.insert("engine".into(), bench.simd.isa().name().into());
    map.insert("rounds".into(), bench.rounds.into());
    map.insert("size_px".into(), bench.args.size.into());
    map.insert("bands".into(), bench.args.bands.into());
    map.insert("lens".into(), bench.args.lens.clone().into());
    map.extend(bench.figures.iter().map(|f| (f.key.to_owned(), f.value.clone())));
    print(format!("{:#}", Value::Object(map)));
}
