//! Two reports of `lenscube bench --json` side by side, and a forecast of the first one's job on the machine of the second.
//!
//! ```text
//! core seconds on B = Σ over stages  core seconds on A · (rate on A / rate on B)      rates of one thread
//! forecast = (time over bound on A) · max(disk on B, core seconds on B / threads of B)
//! ```
//! The rate of a stage is that of its benchmark: reading as decoding, preparing as making kernels, and adding and writing as copying
//! memory. Left out: GPUs, and that threads share caches and memory in other ways on the two machines.

use crate::failure::usage;
use crate::progress::print;
use anyhow::{Context, Result};
use serde_json::{Map, Value};
use std::path::Path;

/// Core seconds of a stage in a report, the rate of its benchmark, and whether that rate is of all threads.
const STAGES: [(&str, &str, bool); 7] = [
    ("job_core_read_s", "decode_mpx_s", false),
    ("job_core_remap_s", "remap_mpx_s", true),
    ("job_core_svpsf_s", "svpsf_lens_mpx_s", true),
    ("job_core_add_s", "memory_mb_s", true),
    ("job_core_encode_s", "encode_mpx_s", false),
    ("job_core_write_s", "memory_mb_s", true),
    ("job_core_prepare_s", "kernels_per_s", false),
];

type Report = Map<String, Value>;

/// Prints the comparison of the reports at `a` and `b`.
pub(super) fn command(a: &Path, b: &Path) -> Result<()> {
    let (a, b) = (read(a)?, read(b)?);
    lines(&a, &b).iter().for_each(print);
    Ok(())
}

fn read(path: &Path) -> Result<Report> {
    let text = std::fs::read(path).with_context(|| format!("reading {}", path.display()))?;
    let report: Report = serde_json::from_slice(&text).map_err(|e| {
        usage(format!("{}: {e}; expected the output of `lenscube bench --json`", path.display()))
    })?;
    let program = report.get("program").and_then(Value::as_str).unwrap_or_default();
    if !program.starts_with("lenscube ") || number(&report, "threads").is_none() {
        return Err(usage(format!("{} is not an output of `lenscube bench --json`", path.display())));
    }
    Ok(report)
}

/// A number above 0.
fn number(report: &Report, key: &str) -> Option<f64> {
    report.get(key).and_then(Value::as_f64).filter(|v| *v > 0.0)
}

fn lines(a: &Report, b: &Report) -> Vec<String> {
    let mut lines = vec![format!("{:<24} {:>14} {:>14} {:>8}", "", "A", "B", "B / A")];
    let only_b = b.keys().filter(|key| !a.contains_key(*key));
    for key in a.keys().chain(only_b) {
        let show = |report: &Report| match report.get(key) {
            None => "-".to_owned(),
            Some(Value::String(text)) => text.clone(),
            Some(value) => value.to_string(),
        };
        let ratio =
            number(a, key).zip(number(b, key)).map_or(String::new(), |(a, b)| format!("{:.3}", b / a));
        lines.push(format!("{key:<24} {:>14} {:>14} {ratio:>8}", show(a), show(b)).trim_end().to_owned());
    }
    lines.push(match forecast(a, b) {
        Ok(seconds) => {
            let bands = number(a, "bands").unwrap_or_default();
            let size = number(a, "size_px").unwrap_or_default();
            format!("forecast of A's job ({bands} bands of {size} px) on B: {seconds:.1} s")
        }
        Err(missing) => format!("no forecast of A's job on B: {missing}"),
    });
    lines
}

/// Seconds of A's job on the machine of B; else what is missing.
fn forecast(a: &Report, b: &Report) -> Result<f64, String> {
    let of = |report: &Report, name: &str, key: &str| {
        number(report, key).ok_or_else(|| match report.get("job_error").and_then(Value::as_str) {
            Some(error) if key.starts_with("job_") => format!("{name}'s job was not measured: {error}"),
            _ => format!("{name} has no {key}"),
        })
    };
    let threads = (of(a, "A", "threads")?, of(b, "B", "threads")?);
    let over_bound = of(a, "A", "job_over_bound")?;
    let mut core_s = 0.0;
    for (seconds, rate, shared) in STAGES {
        // A stage that took no time has no figure above 0.
        let Some(seconds) = number(a, seconds) else { continue };
        let (mut on_a, mut on_b) = (of(a, "A", rate)?, of(b, "B", rate)?);
        if shared {
            (on_a, on_b) = (on_a / threads.0, on_b / threads.1);
        }
        core_s += seconds * on_a / on_b;
    }
    let disk_s = 1e3
        * (number(a, "job_read_gb").unwrap_or(0.0) / of(b, "B", "disk_read_mb_s")?
            + number(a, "job_written_gb").unwrap_or(0.0) / of(b, "B", "disk_write_mb_s")?);
    Ok(over_bound * disk_s.max(core_s / threads.1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn report(threads: u32, rate: f64, disk: f64) -> Report {
        let value = json!({
            "program": "lenscube 0", "threads": threads, "size_px": 1000, "bands": 2,
            "decode_mpx_s": rate, "encode_mpx_s": rate, "kernels_per_s": rate,
            "remap_mpx_s": rate * f64::from(threads), "svpsf_lens_mpx_s": rate * f64::from(threads),
            "memory_mb_s": rate * f64::from(threads),
            "disk_read_mb_s": disk, "disk_write_mb_s": disk,
            "job_s": 11.0, "job_over_bound": 1.1, "job_read_gb": 3.0, "job_written_gb": 1.0,
            "job_core_read_s": 5.0, "job_core_svpsf_s": 15.0,
        });
        value.as_object().unwrap().clone()
    }

    #[test]
    fn forecast_on_the_same_machine_is_the_bound_times_the_distance_to_it() {
        let a = report(2, 100.0, 4000.0);
        assert!((forecast(&a, &a).unwrap() - 11.0).abs() < 1e-9);
    }

    #[test]
    fn forecast_scales_with_cores_and_speed_until_the_disk_is_the_bound() {
        let a = report(2, 100.0, 4000.0);
        // 20 core seconds at twice the speed on 8 threads: 1.25 s; the disk takes 1 s.
        assert!((forecast(&a, &report(8, 200.0, 4000.0)).unwrap() - 1.1 * 1.25).abs() < 1e-9);
        // 4 GB at 0.4 GB/s.
        assert!((forecast(&a, &report(8, 200.0, 400.0)).unwrap() - 1.1 * 10.0).abs() < 1e-9);
    }

    #[test]
    fn report_without_a_job_is_compared_but_not_forecast() {
        let mut a = report(2, 100.0, 4000.0);
        a.remove("job_over_bound");
        a.insert("job_error".into(), "no space".into());
        let lines = lines(&a, &report(8, 200.0, 400.0));
        assert!(lines.iter().any(|l| l.starts_with("decode_mpx_s") && l.ends_with("2.000")), "{lines:?}");
        assert!(lines.last().unwrap().ends_with("A's job was not measured: no space"), "{lines:?}");
    }
}
