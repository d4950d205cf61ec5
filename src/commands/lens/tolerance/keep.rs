//! `--keep`: packs of single lenses of a batch, as `lens trace` writes them, `packs/K.lens.zarr` of lens K.

use super::found::Found;
use super::request::Request;
use crate::args::{BuiltArgs, LensSamples, TraceArgs};
use crate::commands::lens::trace;
use crate::failure::{other_job, usage};
use crate::progress::{as_step, log_line};
use anyhow::{Context, Result};
use clap::{Args, FromArgMatches};
use formats::durable::create_directories;
use std::path::{Path, PathBuf};

/// Directory of the packs in `--out`.
pub const DIRECTORY: &str = "packs";
/// Largest image height of a pack over the height of the film's corner: margin for PSFs.
const MARGIN: f64 = 1.03;

/// Fails (exit code 3) if packs exist in `out`, which packs of other lenses would lie beside: they are never replaced. Called before a lens is drawn.
pub fn check_absent(out: &Path) -> Result<()> {
    let directory = out.join(DIRECTORY);
    match std::fs::read_dir(&directory).is_ok_and(|mut entries| entries.next().is_some()) {
        false => Ok(()),
        true => Err(other_job(format!(
            "{} has lens packs, which --keep does not replace; remove it, or give another --out",
            directory.display()
        ))),
    }
}

/// Writes the packs of the lenses that `--keep` names.
///
/// # Errors
/// A lens that cannot be traced over the film; a pack that exists.
pub fn keep(out: &Path, request: &Request<'_>, found: &Found) -> Result<()> {
    let args = request.args;
    let mut kept: Vec<u64> = Vec::new();
    for which in &args.keep {
        let sample = found.summary.sample(*which, request.better());
        let sample = sample.ok_or_else(|| usage("--keep: all lenses failed, none has a criterion"))?;
        if !kept.contains(&sample) {
            kept.push(sample);
        }
    }
    if kept.is_empty() {
        return Ok(());
    }
    let directory = out.join(DIRECTORY);
    create_directories(&directory, true)?;
    for sample in kept {
        let pack = directory.join(format!("{sample}.lens.zarr"));
        let context = || format!("pack of lens {sample}");
        as_step(|| trace::command(&trace_args(request, pack.clone(), sample)?)).with_context(context)?;
        log_line(format!("lens {sample}: {}", pack.display()));
    }
    Ok(())
}

/// The arguments of `lens trace` for lens `sample`.
fn trace_args(request: &Request<'_>, pack: PathBuf, sample: u64) -> Result<TraceArgs> {
    let args = request.args;
    let parser = TraceArgs::augment_args(clap::Command::new("trace"));
    let words = ["trace".as_ref(), "-".as_ref(), pack.as_os_str()];
    let mut trace = TraceArgs::from_arg_matches(&parser.try_get_matches_from(words)?)?;
    trace.design = args.design.clone();
    trace.parameters = args.parameters.clone();
    trace.wavelengths = args.wavelengths.clone();
    trace.built = BuiltArgs {
        tolerances: args.tolerances.clone(),
        seed: args.seed,
        lens_sample: LensSamples::one(sample),
    };
    trace.max_height_mm = Some(request.corner_mm);
    if let (Some(size), Some(pitch_um)) = (args.film_size, args.film_pitch_um) {
        (trace.film_size, trace.film_pitch_um) = (Some(size), pitch_um);
        trace.max_height_mm = Some(MARGIN * request.corner_mm);
    }
    Ok(trace)
}
