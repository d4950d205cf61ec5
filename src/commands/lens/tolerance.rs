//! `lenscube lens tolerance`: lenses drawn within manufacturing tolerances, focused and judged.
//!
//! Files of `--out`, all written at the end or none: `lenses.csv`, a row a lens ([`rows`]); `summary.json` ([`summary`]);
//! with `--sensitivity` `sensitivity.csv` ([`sensitivity`]); figures ([`figures`]).

mod figures;
mod found;
mod import;
mod keep;
mod request;
mod rows;
mod sensitivity;
mod summary;

use crate::args::ToleranceArgs;
use crate::design;
use crate::failure::{Coded, code, usage};
use crate::job::lens::drawn::ReadTolerances;
use crate::job::lens::samples::design_reach_mm;
use crate::machine::threads;
use crate::outputs::check_absent_in;
use crate::progress::{counting, log_line, print};
use anyhow::{Context, Result};
use formats::durable::{AtomicFile, create_directories, finish_together};
use formats::picture::style::Style;
use found::Found;
use pipeline::design::System;
use pipeline::design::ray::Tracer;
use pipeline::design::tolerance::Batch;
use pipeline::design::trace::with_threads;
use rayon::prelude::*;
use request::Request;
use rows::Row;
use sensitivity::Sensitivity;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use summary::Summary;

/// Share of failed lenses above which the command fails.
const MAX_FAILED: f64 = 0.1;
const ROWS: &str = "lenses.csv";
const SENSITIVITY: &str = "sensitivity.csv";
const SUMMARY: &str = "summary.json";

/// Names of all files and directories that the command may write into `--out`.
pub fn all_files() -> impl Iterator<Item = &'static str> {
    [ROWS, SENSITIVITY, SUMMARY, keep::DIRECTORY].into_iter().chain(figures::FILES)
}

/// Runs the command.
pub fn command(args: &ToleranceArgs) -> Result<()> {
    let (Some(path), Some(out)) = (&args.tolerances, &args.out) else { return import::command(args) };
    if !design::is_design(&args.design) {
        return Err(usage(format!(
            "`{}` is not a design; errors are those of surfaces and glasses",
            args.design
        )));
    }
    let read = ReadTolerances::open(path)?;
    let system = design::open(&args.design, &args.parameters)?;
    system.notes.iter().for_each(|note| log_line(format!("note: {note}")));
    let tolerances = read.of(&system)?;
    let corner_mm = corner_mm(args, &system)?;
    let request = Request { args, read: &read, system: &system, tolerances: &tolerances, corner_mm };
    check_absent_in(out, all_files(), args.overwrite)?;
    if !args.keep.is_empty() {
        keep::check_absent(out)?;
    }
    let context = || format!("lenses of {}", args.design);
    let found = with_threads(threads(args.threads), || compute(&request)).with_context(context)?;
    write(out, &request, &found)?;
    keep::keep(out, &request, &found)?;
    match args.json {
        true => print(serde_json::to_string_pretty(&found.summary.json(&request))?),
        false => found.summary.text(&request).iter().for_each(print),
    }
    let failed = found.rows.iter().filter(|row| row.outcome.is_err()).count();
    if failed as f64 > MAX_FAILED * found.rows.len() as f64 {
        let message = format!(
            "{failed} of {} failed: tolerances or film are too large for this lens (reasons: {})",
            summary::count(found.rows.len()),
            out.join(ROWS).display()
        );
        return Err(Coded { code: code::WRONG, message }.into());
    }
    Ok(())
}

fn compute(request: &Request<'_>) -> Result<Found> {
    let Request { args, read, system, tolerances, corner_mm } = request;
    let file = &read.file;
    let batch = Batch::new(system, tolerances, file.compensation, &file.criterion, *corner_mm)?;
    let nominal = Row::new(0, vec![0.0; tolerances.parameters().len()], &batch);
    if let Err(failure) = &nominal.outcome {
        anyhow::bail!("the lens without errors: {failure}");
    }
    let extremes = if args.sensitivity { tolerances.extremes() } else { Vec::new() };
    let all = args.samples + 2 * extremes.len() as u64;
    let (bar, update) = counting("lenses");
    let done = AtomicU64::new(0);
    let counted = |row: Row| {
        update(done.fetch_add(1, Relaxed) + 1, all);
        row
    };
    let one = |sample: u64| counted(Row::new(sample, tolerances.draw(args.seed, sample), &batch));
    let rows: Vec<Row> = (0..args.samples).into_par_iter().map(one).collect();
    let sensitivity = args.sensitivity.then(|| {
        let assess = |values: &Vec<f64>| counted(Row::new(0, values.clone(), &batch));
        let both = extremes.par_iter().map(|e| [assess(&e.values[0]), assess(&e.values[1])]);
        let both: Vec<[Row; 2]> = both.collect();
        Sensitivity::new(&nominal, &extremes, both)
    });
    bar.finish_and_clear();
    let summary = Summary::new(request, &rows, &nominal, sensitivity.as_ref());
    Ok(Found { rows, nominal, sensitivity, places: batch.places().to_vec(), summary })
}

fn write(out: &Path, request: &Request<'_>, found: &Found) -> Result<()> {
    create_directories(out, true)?;
    let mut files =
        vec![AtomicFile::with_text(&out.join(ROWS), &rows::csv(request, &found.rows, found.places.len()))?];
    if let Some(sensitivity) = &found.sensitivity {
        files.push(AtomicFile::with_text(&out.join(SENSITIVITY), &sensitivity.csv(request.tolerances))?);
    }
    for (name, figure) in figures::all(request, found, Style::Light) {
        files.push(figure.file(&out.join(name))?);
    }
    let summary = serde_json::to_string_pretty(&found.summary.json(request))? + "\n";
    files.push(AtomicFile::with_text(&out.join(SUMMARY), &summary)?);
    finish_together(files)?;
    Ok(())
}

/// REAL height of the film's corner, mm.
fn corner_mm(args: &ToleranceArgs, system: &System) -> Result<f64> {
    if let Some(mm) = args.max_height_mm {
        return Ok(mm);
    }
    if let (Some(size), Some(pitch_um)) = (args.film_size, args.film_pitch_um) {
        return Ok(0.5e-3 * pitch_um * (size.width as f64).hypot(size.height as f64));
    }
    let outermost = design_reach_mm(system)?;
    let mm = match outermost > 0.0 {
        true => outermost,
        false => {
            let circle = Tracer::new(system, system.primary_um())?.image_circle_mm();
            circle.ok_or_else(|| {
                usage(format!(
                    "{} has no field point off the axis; give the film with --film-size and --film-pitch-um, or --max-height-mm",
                    args.design
                ))
            })?
        }
    };
    log_line(format!("fields up to {mm:.4} mm, of the design (--film-size or --max-height-mm for others)"));
    Ok(mm)
}
