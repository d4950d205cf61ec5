//! `lenscube validate`: simulated films of test charts, made by `lenscube run`, compared with the lens data.
//!
//! Three charts are simulated ([`film_maker`]) and measured: a uniform one ([`illumination`]), a grid of points ([`distortion`]) and
//! slanted edges ([`edge`]). [`light`] checks scatter, glare, transmission and ghosts. Expected values come from the lens data alone ([`reference`](mod@reference)). Results are written as figures and
//! curves ([`files`]) and as a page ([`report`]), and compared with the limits of `--require` ([`limits`]).

mod band;
mod distortion;
mod edge;
mod edge_places;
mod error_budget;
mod figures;
mod files;
mod film_maker;
mod illumination;
mod interpolated_lens;
mod light;
mod limits;
mod progress;
mod reference;
mod report;
pub mod setup;
mod tables;
#[cfg(test)]
mod tests;
mod timing;

use crate::args::{ValidateArgs, check_directory};
use crate::failure::{Coded, code, other_job};
use crate::progress::{detail_line, log_line, number};
use anyhow::{Context, Result};
use band::{Band, Films, compare};
pub use film_maker::FilmMaker;
use formats::durable::{AtomicFile, Directory, finish_together};
use light::Check;
use serde_json::Value;
use setup::Setup;
use std::path::Path;

/// What was found.
pub struct Results {
    /// By band.
    bands: Vec<Band>,
    /// Light beside the image.
    light: Vec<Check>,
}

/// Files of a report, in its directory.
pub const FILES: [&str; 7] = [
    "report.html",
    "summary.json",
    "curves/ri.csv",
    "curves/departure.csv",
    "curves/distortion.csv",
    "curves/esf.csv",
    "curves/mtf.csv",
];

/// Maximum size of an earlier `summary.json` that is read.
const MAX_SUMMARY_BYTES: u64 = 64 << 20;

/// Fails if the report would replace files that no validation wrote; a validation is recognised by its `summary.json`.
fn check_out(out: &Path) -> Result<()> {
    let exists = |name: &&str| out.join(name).symlink_metadata().is_ok();
    let Some(name) = ["summary.json", "report.html", "curves"].into_iter().find(exists) else {
        return Ok(());
    };
    let summary = Directory::new(out).read_at_most("summary.json", MAX_SUMMARY_BYTES)?;
    let summary: Value = summary.and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default();
    let program = summary["program"].as_str().unwrap_or_default();
    match program.starts_with("lenscube ") && summary.get("worst").is_some() {
        true => Ok(()),
        false => Err(other_job(format!(
            "{} exists and was not written by an earlier validation; move it away, or choose another --out",
            out.join(name).display()
        ))),
    }
}

/// Runs the command and returns its exit code.
pub fn command(args: &ValidateArgs) -> Result<u8> {
    let times = timing::newest_complete_run(args.timing.as_deref())?;
    check_directory(&args.out)?;
    check_out(&args.out)?;
    let setup = Setup::new(args)?;
    let films = Films::new(&setup, &edge_places::places(setup.size))?;
    let mut bands = Vec::new();
    for band in 0..setup.wavelengths_nm.len() {
        let nm = number(setup.wavelengths_nm[band]);
        let result = compare(&setup, &films, band).with_context(|| format!("comparing {nm} nm"))?;
        setup.steps.step();
        let min_iou = result.edges.iter().map(|e| e.agreement.iou).fold(1.0, f64::min);
        detail_line(format!(
            "{nm} nm: relative illumination, IoU {:.6} %; distortion, mean error {:.5} px; edge spread function, minimum IoU {:.4} %",
            100.0 * result.illumination.agreement.iou,
            distortion::mean_max(&result.points).0,
            100.0 * min_iou
        ));
        bands.push(result);
    }
    let results = Results { light: light::checks(&setup, args).context("checking light")?, bands };
    setup.steps.clear();
    log_line(limits::summary(&results));
    let missed = limits::missed(&results, &args.require);
    let mut files = files::curves(&args.out.join("curves"), &results.bands)?;
    let summary = files::summary(args, &setup, &results, &missed, &times);
    let page = report::html(args, &setup, &results, &missed, &times);
    let all = [("summary.json", serde_json::to_string_pretty(&summary)? + "\n"), ("report.html", page)];
    for (name, text) in all {
        files.push(AtomicFile::with_text(&args.out.join(name), &text)?);
    }
    // Renamed together, the page last, so that it never stands beside curves of another run.
    finish_together(files)?;
    let report = args.out.join("report.html");
    log_line(format!("{}", report.display()));
    if missed.is_empty() {
        return Ok(0);
    }
    let message = format!("--require is not met: {}; see {}", missed.join("; "), report.display());
    Err(Coded { code: code::WRONG, message }.into())
}
