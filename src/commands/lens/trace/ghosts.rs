//! `lens trace --ghosts on`: the operators of ghosts in a pack.

use super::log_needed;
use crate::args::TraceArgs;
use crate::failure::usage;
use crate::job::ghosts::{check_coatings, note_left_out, options, small_ghosts};
use crate::progress::log_line;
use anyhow::Result;
use formats::lens::LensPackWriter;
use pipeline::design::System;
use pipeline::design::ghost::estimate::ghost_seconds;
use pipeline::design::ghost::geometry_nm;
use pipeline::design::ghost::operator::trace_ghosts;
use pipeline::design::ghost::options::GhostOptions;
use pipeline::design::ghost::report::PathFigures;
use pipeline::design::trace::TraceOptions;

/// Fails for flags of ghosts that contradict each other or others.
///
/// # Errors
/// Usage.
pub fn check(args: &TraceArgs) -> Result<()> {
    if let Some(contradiction) = args.ghosts.contradiction() {
        return Err(usage(contradiction));
    }
    if !args.ghosts.is_on() {
        return Ok(());
    }
    let flags = [("--depths-m", args.depths_m.is_some()), ("--tolerances", args.built.tolerances.is_some())];
    match flags.iter().find(|(_, given)| *given) {
        Some((flag, _)) => Err(usage(format!(
            "--ghosts on with {flag}: ghosts belong to a lens with rotational symmetry and one object distance; leave one of both out"
        ))),
        None => check_coatings(&args.parameters.coatings),
    }
}

/// Fails for ghosts of a design without rotational symmetry.
///
/// # Errors
/// Usage.
pub fn check_symmetric(args: &TraceArgs) -> Result<()> {
    match args.ghosts.is_on() {
        true => Err(usage(format!(
            "--ghosts on: expected a design with rotational symmetry, {} has none",
            args.design
        ))),
        false => Ok(()),
    }
}

/// How the ghosts that `args` ask for are computed, of the bands of `trace`; none without them.
///
/// # Errors
/// A reflectance of the film that cannot be read or has not all wavelengths.
pub fn asked(args: &TraceArgs, trace: &TraceOptions) -> Result<Option<GhostOptions>> {
    if !args.ghosts.is_on() {
        return Ok(None);
    }
    let options = options(&args.ghosts, trace.max_height_mm)?;
    for nm in &trace.wavelengths_nm {
        options.film_reflectance.at(*nm)?;
    }
    Ok(Some(options))
}

/// Traces the ghosts of `system` at `wavelengths_nm`, ascending, and writes them to `pack`; a sealed one has no paths.
///
/// # Errors
/// As [`trace_ghosts`] and [`LensPackWriter::ghosts`].
pub fn add(
    system: &System,
    wavelengths_nm: &[f64],
    options: &GhostOptions,
    (pack, is_sealed): (&mut LensPackWriter, bool),
) -> Result<()> {
    note_left_out(system, options);
    let seconds = ghost_seconds(system, options, wavelengths_nm);
    log_needed(seconds, format!("tracing the ghosts: about {seconds:.0} core seconds"));
    let mut band = 0;
    // Bands that share their rays.
    for group in wavelengths_nm.chunk_by(|a, b| geometry_nm(*a) == geometry_nm(*b)) {
        for ghosts in trace_ghosts(system, group, options)? {
            small_ghosts(system, &ghosts).into_iter().for_each(log_line);
            pack.ghosts(band, &ghosts.operator, options.film_reflectance.at(ghosts.wavelength_nm)?)?;
            // The paths name the surfaces.
            if !is_sealed {
                let paths: Vec<PathFigures> =
                    ghosts.paths.iter().map(|p| p.figures(system.image())).collect();
                pack.ghost_paths(band, &paths)?;
            }
            band += 1;
        }
    }
    Ok(())
}
