//! `run --tolerances --lens-sample FIRST:END`: a film of each of several lenses as built.
//!
//! The path of the film has {sample} in place of the index of the lens. A lens that cannot be traced is reported, the others go on (exit code 4).

use super::{forecast, run_job};
use crate::args::{LensSamples, ProgressArg, RunArgs, RunCommand};
use crate::failure::{code, line, usage};
use crate::outputs::Guard;
use crate::progress::log_line;
use anyhow::{Error, Result};
use pipeline::design::DesignError;
use pipeline::design::skew::error::SkewError;
use std::path::PathBuf;

/// What the path of a film has in place of the index of its lens.
const SAMPLE: &str = "{sample}";

/// Whether the command makes films of several lenses, or names its film by the lens.
pub fn is_of_samples(args: &RunArgs) -> bool {
    args.built.tolerances.is_some()
        && (args.built.lens_sample.only().is_none() || args.film.to_string_lossy().contains(SAMPLE))
}

/// The job of the lens `sample`.
fn job_of(args: &RunArgs, sample: u64) -> RunArgs {
    let film = args.film.to_string_lossy().replace(SAMPLE, &sample.to_string());
    let mut job = RunArgs { film: PathBuf::from(film), ..args.clone() };
    job.built.lens_sample = LensSamples::one(sample);
    job
}

/// Computes the films, one after another; the exit code.
///
/// # Errors
/// Usage: a path without the index; those of a film but of its lens.
pub fn run(args: &RunCommand) -> Result<u8> {
    let job = &args.job;
    let samples = job.built.lens_sample;
    if !job.film.to_string_lossy().contains(SAMPLE) {
        return Err(usage(format!(
            "--lens-sample {samples}: FILM `{}` needs {SAMPLE} in its path, as film-{SAMPLE}.zarr",
            job.film.display()
        )));
    }
    if args.work.progress == ProgressArg::Jsonl && samples.only().is_none() {
        return Err(usage(format!(
            "--progress jsonl: expected one film, --lens-sample {samples} makes several"
        )));
    }
    samples.range().try_for_each(|sample| Guard::of_job(&job_of(job, sample)).check())?;
    if args.dry_run {
        // The others differ in their lens alone.
        return forecast::print(&job_of(job, samples.first)).map(|()| 0);
    }
    let mut failed = Vec::new();
    for sample in samples.range() {
        match run_job(&job_of(job, sample), None, args.work.progress) {
            Ok(0) => {}
            Ok(code) => return Ok(code),
            Err(error) if is_of_lens(&error) && samples.only().is_none() => {
                log_line(format!("lens {sample}: {}", line(&error)));
                failed.push(sample.to_string());
            }
            Err(error) => return Err(error),
        }
    }
    if failed.is_empty() {
        return Ok(0);
    }
    log_line(format!("no film of lens {} of {samples}", failed.join(", ")));
    Ok(code::WRONG)
}

/// Whether an error is one of a lens that cannot be traced.
fn is_of_lens(error: &Error) -> bool {
    let of_design = |e: &DesignError| !matches!(e, DesignError::Sink { .. });
    error.downcast_ref::<DesignError>().is_some_and(of_design)
        || error.downcast_ref::<SkewError>().is_some_and(|e| match e {
            SkewError::Design(e) => of_design(e),
            _ => true,
        })
}
