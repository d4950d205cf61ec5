//! What a data set will be, and what was made.

use super::coded;
use super::sample::Maker;
use super::units::Made;
use crate::args::DatasetArgs;
use crate::machine::threads;
use crate::progress::{log_line, mib, plural, print};
use anyhow::Result;
use formats::dataset::recipe::Layout;
use formats::dataset::store::{DatasetSpec, DatasetStore};
use serde_json::{Value, json};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// Prints what would be made, with time and bytes of the first sample.
///
/// # Errors
/// The first sample cannot be made.
pub fn dry_run(args: &DatasetArgs, maker: &Maker<'_>, spec: &DatasetSpec, cancel: &AtomicBool) -> Result<()> {
    let begin = Instant::now();
    maker.make(0, cancel)?;
    let first_s = begin.elapsed().as_secs_f64();
    // Again, with the lens traced and its kernels known.
    let begin = Instant::now();
    let sample = maker.make(0, cancel)?;
    let seconds = begin.elapsed().as_secs_f64();
    let bytes: usize = sample.items.iter().map(|item| item.bytes.len()).sum();
    let part = args.part.map_or(1.0, |part| 1.0 / part.count as f64);
    let count = spec.samples as f64 * part;
    let (all_s, all_bytes) = (first_s + count * seconds / threads(args.threads) as f64, count * bytes as f64);
    let items: Vec<&str> = sample.items.iter().map(|item| item.name.as_str()).collect();
    if let Some(error) = sample.line.get("error") {
        log_line(format!("note: the first sample fails: {error}"));
    }
    if args.json {
        print(json!({
            "samples": spec.samples, "units": spec.units(), "samples_per_unit": spec.per_unit, "pictures": maker.pictures.len(),
            "first_sample_s": first_s, "sample_core_s": seconds, "forecast_s": all_s, "sample_bytes": bytes, "forecast_bytes": all_bytes,
            "items": items,
        }));
        return Ok(());
    }
    print(format!(
        "{} of {}, in {} of up to {}: {}",
        plural(spec.samples, "sample"),
        plural(maker.pictures.len(), "picture"),
        plural(spec.units(), "unit"),
        spec.per_unit,
        items.join(", ")
    ));
    print(format!(
        "about {} and {:.1} min: {bytes} bytes and {:.0} ms a sample on one core, measured on the first, whose lens took {first_s:.1} s before",
        mib(all_bytes as usize),
        all_s / 60.0,
        1e3 * seconds
    ));
    Ok(())
}

/// Prints what was made.
///
/// # Errors
/// JSON.
pub fn print_made(
    args: &DatasetArgs,
    store: &DatasetStore,
    (units, made): (usize, Made),
    finished: bool,
    seconds: f64,
) -> Result<()> {
    let spec = store.spec();
    if args.json {
        print(json!({
            "samples": spec.samples, "units": spec.units(), "made_units": units, "made_samples": made.samples, "failed_samples": made.failed,
            "bytes": made.bytes, "seconds": seconds, "complete": finished,
        }));
        return Ok(());
    }
    let rate = made.samples as f64 / seconds.max(1e-9);
    log_line(format!(
        "{}: {} made, {:.1} samples/s, {}{}",
        args.out.display(),
        plural(made.samples, "sample"),
        rate,
        mib(made.bytes as usize),
        if finished {
            format!("; complete, {}", plural(spec.samples, "sample"))
        } else {
            "; other parts are missing".into()
        }
    ));
    if spec.layout == Layout::Zarr && finished {
        log_line(format!("open it: xarray.open_zarr(\"{}\")", store.path().join("data.zarr").display()));
    }
    Ok(())
}

/// Number of samples of a complete data set that have an error; the first are printed.
///
/// # Errors
/// Its lines cannot be read.
pub fn failed(store: &DatasetStore) -> Result<u64> {
    const SHOWN: u64 = 5;
    let mut count = 0;
    for unit in 0..store.spec().units() {
        for line in store.lines(unit).map_err(coded)?.lines().filter(|line| line.contains("\"error\"")) {
            let line: Value = serde_json::from_str(line)?;
            if let Some(error) = line["error"].as_str() {
                count += 1;
                if count <= SHOWN {
                    log_line(format!("sample {}: {error}", line["sample"]));
                }
            }
        }
    }
    if count > 0 {
        log_line(format!("{} without items; their lines have the error", plural(count, "sample")));
    }
    Ok(count)
}
