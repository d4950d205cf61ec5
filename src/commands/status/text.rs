//! The status of a film as text.

use super::report::{BandStatus, LayerStatus, LockStatus, Status};
use crate::job::lens::shown_name;
use crate::progress::{data_size, number, plural};
use formats::film::FilmStore;
use formats::pyramid::PyramidState;
use serde_json::Value;

/// Missing shards and incomplete bands that are listed; `--json` lists all.
const MAX_LISTED: usize = 8;
/// Digits of a digest.
const DIGITS: usize = 12;

/// The lines to print.
pub fn lines(store: &FilmStore, status: &Status) -> Vec<String> {
    let state = if status.complete { "complete" } else { "incomplete; the same `lenscube run` resumes it" };
    let percent = 100.0 * status.shards_done as f64 / status.shards.max(1) as f64;
    let (done, all, size) = (status.shards_done, status.shards, data_size(status.bytes));
    let mut lines = vec![
        format!("{}: {state}", store.path().display()),
        job(store, status),
        format!("  shards  {done} of {all} ({percent:.1} %), {size}"),
        match &status.engines[..] {
            [engine] => format!("  engine  {engine}"),
            engines => {
                format!("  engines {}: mixed, values differ by up to 2e-6 of the peak", engines.join(", "))
            }
        },
        bands(&status.bands),
    ];
    lines.extend(status.layers.iter().map(|layer| {
        let LayerStatus { name, bands, bands_done } = layer;
        format!("  {name:<7} light beside the image of {bands_done} of {bands} bands")
    }));
    // Films of earlier versions lack it.
    lines.extend(source(&status.source));
    lines.extend(store.spec().keep_bits.map(|bits| {
        format!("  samples rounded to {bits} of {} bits of mantissa", store.spec().sample.mantissa_bits())
    }));
    lines.extend(missing(&status.missing));
    if let Some(units) = &status.units {
        let missing = match units.missing.is_empty() {
            true => String::new(),
            false => format!("; missing {}", units.missing),
        };
        lines.push(format!("  units   {} of {}{missing}", units.done, units.all));
    }
    lines.extend(pyramid(status.pyramid).map(str::to_owned));
    let runs = &status.runs;
    lines.push(format!(
        "  runs    {} complete, {} interrupted, {} failed: {:.1} s, {} tiles (a killed run leaves no record)",
        runs.complete, runs.interrupted, runs.failed, runs.wall_s, runs.tiles
    ));
    if let Some(error) = status.last_run.as_ref().and_then(|run| run.error()) {
        lines.push(format!("  last    failed: {error}"));
    }
    lines.extend(status.locks.iter().map(lock));
    lines
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or("unknown")
}

fn job(store: &FilmStore, status: &Status) -> String {
    let applied = status.job["stages"].as_object().into_iter().flatten().filter(|(_, on)| **on == true);
    let stages: Vec<&str> = applied.map(|(name, _)| name.as_str()).collect();
    let spec = store.spec();
    format!(
        "  job     {} through {} ({}), film {} px of {} µm, {}; digest {:.DIGITS$}, layout {:.DIGITS$}",
        text(&status.program),
        shown_name(text(&status.job["lens_name"])),
        stages.join(", "),
        spec.film,
        spec.pitch_um,
        plural(spec.wavelengths_nm.len(), "band"),
        text(&status.job_digest),
        text(&status.layout_digest)
    )
}

fn source(source: &Value) -> Option<String> {
    let chart = source["chart"].as_str()?;
    let px = &source["chart_px"];
    let units = source["chart_units"].as_str().map_or(String::new(), |u| format!(" in {u}"));
    let array = source["array"].as_str().map_or(String::new(), |a| format!("//{a}"));
    Some(format!(
        "  source  chart {chart}{array} of {}x{} px{units}; lens {}",
        px["x"],
        px["y"],
        text(&source["lens"])
    ))
}

fn bands(bands: &[BandStatus]) -> String {
    let count = |test: fn(&BandStatus) -> bool| bands.iter().filter(|b| test(b)).count();
    let partial: Vec<&BandStatus> =
        bands.iter().filter(|b| 0 < b.shards_done && b.shards_done < b.shards).collect();
    let listed = partial.iter().take(MAX_LISTED);
    let listed: Vec<String> = listed
        .map(|b| format!("{} nm: {} of {}", number(b.wavelength_nm), b.shards_done, b.shards))
        .collect();
    format!(
        "  bands   {} complete, {} partly done{}, {} not started",
        count(|b| b.shards_done == b.shards),
        partial.len(),
        if listed.is_empty() { String::new() } else { format!(" ({})", listed.join(", ")) },
        count(|b| b.shards_done == 0)
    )
}

fn missing(keys: &[String]) -> Option<String> {
    let more = match keys.len().saturating_sub(MAX_LISTED) {
        0 => String::new(),
        n => format!(" and {n} more"),
    };
    let listed = &keys[..keys.len().min(MAX_LISTED)];
    (!keys.is_empty()).then(|| format!("  missing {}{more}", listed.join(", ")))
}

fn pyramid(state: PyramidState) -> Option<&'static str> {
    match state {
        PyramidState::None => None,
        PyramidState::Complete => Some("  pyramid complete"),
        PyramidState::Stale => {
            Some("  pyramid of an earlier version of the film; `lenscube pyramid` replaces it")
        }
        PyramidState::Unfinished(..) => Some("  pyramid unfinished; `lenscube pyramid` resumes it"),
    }
}

fn lock(lock: &LockStatus) -> String {
    let alive = match lock.alive {
        Some(true) => "is running",
        Some(false) => "has ended; the next run replaces this lock",
        None => "may be running; if it is not, use --take-over",
    };
    match &lock.owner {
        Some(owner) => {
            format!(
                "  lock    {}: process {} of host {} {alive}",
                owner.unit, owner.process.pid, owner.process.host
            )
        }
        None => format!("  lock    of an unknown process, which {alive}"),
    }
}
