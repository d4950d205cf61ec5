//! `lenscube lens trace`: traces a design into a lens pack.

mod built;
pub mod depth;
mod estimate;
mod ghosts;
mod sealed;
mod writer;

use crate::args::{Store, TraceArgs};
use crate::design;
use crate::failure::usage;
use crate::job::lens::attributes::attributes;
use crate::job::lens::built::unmoved;
use crate::job::lens::drawn::DrawnLens;
use crate::job::lens::energy::{MissedEnergy, percent};
use crate::job::lens::tails;
use crate::progress::{TracingBar, detail_line, log_line, number, plural};
use anyhow::{Context, Result, anyhow};
use estimate::{Needed, estimate};
use formats::design::builtin::SAMPLE;
use formats::lens::LensPackWriter;
use pipeline::bounds::HEIGHT_MM;
use pipeline::design::System;
use pipeline::design::depth::trace::DepthOptions;
use pipeline::design::describe::field_tan;
use pipeline::design::image_circle::EDGE;
use pipeline::design::image_cone::image_cones;
use pipeline::design::ray::Tracer;
use pipeline::design::skew::system::BuiltLens;
use pipeline::design::trace::{
    BandReport, ESF_SHARE, LensTrace, NodeError, Progress, PsfHeights, TraceOptions, TracedBand,
};
use pipeline::lens::cone_field::ConeField;
use pipeline::lens::planar::PsfPlaces;
use pipeline::psf::blocks::Blocks;
use std::path::Path;
use std::time::Instant;
use writer::{Stopped, write_beside};

/// Largest height of the sample lens without `--max-height-mm`, mm: the corner of the examples' film of 14141² px of 2 µm.
const SAMPLE_HEIGHT_MM: f64 = 20.5;
/// A trace that takes longer is announced with what it needs, s.
const LONG_S: f64 = 10.0;
/// Maximum of the PSFs of a pack by default, MB uncompressed; above it the pack has pupil functions.
const MAX_PSF_MB: f64 = 1000.0;
/// Maximum of the PSFs of a band, which are in memory at a time, likewise.
const MAX_BAND_MB: f64 = 300.0;

/// Runs the command.
pub fn command(args: &TraceArgs) -> Result<()> {
    let start = Instant::now();
    sealed::check(args)?;
    ghosts::check(args)?;
    let (system, depth) = system(args)?;
    for note in &system.notes {
        log_line(format!("note: {note}"));
    }
    let options = options(args, &system)?;
    if system.asymmetry.is_some() {
        ghosts::check_symmetric(args)?;
        if args.built.tolerances.is_some() {
            return Err(usage(format!(
                "--tolerances: expected a design with rotational symmetry, {} has none",
                args.design
            )));
        }
        let lens = BuiltLens::of_design(&system).with_context(|| format!("design {}", args.design))?;
        return built::trace_design(args, &lens, &options, start);
    }
    let drawn = DrawnLens::new(&args.built, &system)?;
    if let Some(drawn) = &drawn {
        built::check_flat(args)?;
        if !drawn.is_nominal() {
            return built::trace(args, drawn, &options, start);
        }
    }
    if args.film_size.is_some() && drawn.is_none() {
        return Err(usage(format!(
            "--film-size: expected a lens without rotational symmetry or --tolerances; {} has tables over image height (--max-height-mm)",
            args.design
        )));
    }
    if let Some(depth) = depth {
        if args.tails {
            log_line("note: a pack with depth nodes has no tails: its PSFs are scaled into their windows");
        }
        return depth::trace(args, &system, &options, &depth, start);
    }
    let ghosts = ghosts::asked(args, &options)?;
    let Needed { seconds, psf_mb, band_mb, text } =
        estimate(&system, &options).with_context(|| format!("tracing {}", args.design))?;
    log_needed(seconds, text);
    let stored = sealed::stored(args, default_store(psf_mb, band_mb));
    if args.store.is_none() && stored == Store::Pupils {
        log_line(pupils_note(psf_mb));
    }
    let pack = LensPackWriter::create(&args.out)?;
    let bar = TracingBar::new(options.wavelengths_nm.len());
    let mut reports: Vec<BandReport> = Vec::new();
    let mut progress = |p: Progress| {
        bar.set_bands(p.band);
        bar.step(format!("{} nm: {} ({} PSFs)", number(options.wavelengths_nm[p.band]), p.step, p.psfs));
    };
    let result = write_beside(pack, |write| {
        let trace = LensTrace::new(&system, &options)?.with_tails(args.tails);
        let kept = if stored == Store::Pupils { 0 } else { usize::MAX };
        trace.with_psfs_up_to(kept).all(&mut progress, |index, band| {
            bar.suspend(|| log_line(band_line(&band)));
            reports.push(band.report);
            match missed_tolerance(args.psf_tolerance, &reports) {
                None => write(index, band, stored),
                Some(_) => Err(Stopped),
            }
        })
    });
    bar.finish();
    if let Some(missed) = missed_tolerance(args.psf_tolerance, &reports) {
        return Err(missed);
    }
    let context = || format!("tracing {}", args.design);
    let (traced, mut pack) = result.with_context(context)?;
    let mut lens = traced.with_context(context)?;
    if args.cones {
        for band in &mut lens.bands {
            let cones = image_cones(&system, band.wavelength_nm * 1e-3, options.max_height_mm);
            band.cones = Some(ConeField::Symmetric(cones.with_context(context)?));
        }
    }
    if let Some(ghosts) = &ghosts {
        ghosts::add(&system, &options.wavelengths_nm, ghosts, (&mut pack, args.sealed))
            .with_context(context)?;
    }
    let mut attributes = attributes(&args.design, &args.parameters, &options, &reports);
    if let Some(drawn) = drawn {
        (attributes.errors, attributes.compensators) = (Some(drawn.record), Some(unmoved()));
    }
    sealed::finish(args, pack, &lens, attributes)?;
    if let Some(note) = tails::note(&reports) {
        log_line(note);
    }
    for line in summary(&args.out, &options, &reports, start.elapsed().as_secs_f64()) {
        log_line(line);
    }
    Ok(())
}

/// The error of the first band that misses the `--psf-tolerance` that was given.
fn missed_tolerance(tolerance: Option<f64>, reports: &[BandReport]) -> Option<anyhow::Error> {
    let tolerance = tolerance?;
    let errors = reports.iter().filter_map(|report| Some((report.wavelength_nm, report.psf_error?)));
    let of_edges = ESF_SHARE * tolerance;
    let misses = |error: &NodeError| error.worst > tolerance || error.edge > of_edges;
    let (nm, missed) = errors.into_iter().find(|(_, error)| misses(error))?;
    let found = match missed.worst > tolerance {
        true => format!(
            "kernels between the nodes have errors up to {:.3} % (at {:.2} mm), expected at most {} % (--psf-tolerance)",
            100.0 * missed.worst,
            missed.at_mm,
            number(100.0 * tolerance)
        ),
        false => format!(
            "edges between the nodes have errors up to {:.3} % of white, expected at most {} % (a fifth of --psf-tolerance)",
            100.0 * missed.edge,
            number(100.0 * of_edges)
        ),
    };
    Some(anyhow!(
        "{} nm: {found}: give more --max-nodes, a larger --psf-tolerance, or none for the error that can be reached",
        number(nm)
    ))
}

/// Prints what a trace of `seconds` needs: under `--verbose` unless it is long.
fn log_needed(seconds: f64, text: String) {
    if seconds > LONG_S { log_line(text) } else { detail_line(text) }
}

/// What a pack has by default if its PSFs would have `psf_mb` MB uncompressed, those of a band at most `band_mb`.
fn default_store(psf_mb: f64, band_mb: f64) -> Store {
    if psf_mb > MAX_PSF_MB || band_mb > MAX_BAND_MB { Store::Pupils } else { Store::Psfs }
}

/// A pack has pupil functions, as its PSFs would have `psf_mb` MB uncompressed.
fn pupils_note(psf_mb: f64) -> String {
    format!(
        "the pack has pupil functions, from which PSFs are computed when it is read: its PSFs would have {:.1} GB uncompressed (`--store psfs` \
         stores them)",
        1e-3 * psf_mb
    )
}

/// The line of a traced band: window, nodes, kernel error.
fn band_line(TracedBand { tables, report, .. }: &TracedBand) -> String {
    let nodes: usize = tables.azimuth_count.iter().sum();
    let error = report.psf_error.map_or("given".into(), |e| {
        let [worst, median, edge] = [e.worst, e.median, e.edge].map(|share| 100.0 * share);
        let limited = if e.limited { " (limited by --max-nodes)" } else { "" };
        format!("{worst:.2} % at {:.2} mm, median {median:.2} %, edges {edge:.2} %{limited}", e.at_mm)
    });
    let places = match tables.planar.as_ref().map(|planar| &planar.psfs) {
        Some(PsfPlaces::Cartesian { x_mm, y_mm }) => format!("{} x {} nodes", x_mm.len(), y_mm.len()),
        _ => format!("{} heights, {nodes} nodes", tables.psf_height_mm.len()),
    };
    format!(
        "{} nm: window {} px with at least {:.2} % of the light, {places}, kernel error {error}",
        number(report.wavelength_nm),
        report.window_px,
        100.0 * report.min_energy,
    )
}

/// The design, focused as `args` say, and the options of its depth nodes.
fn system(args: &TraceArgs) -> Result<(System, Option<DepthOptions>)> {
    let parameters = &args.parameters;
    let (system, _) = design::focused(&args.design, parameters, args.focus_m)?;
    let Some(range) = args.depths_m else { return Ok((system, None)) };
    let focus = match args.focus_m {
        Some(focus_m) => 1.0 / focus_m,
        None => system.object_vergence()?,
    };
    Ok((system, Some(DepthOptions { focus, range, tolerance: args.depth_tolerance, is_for_film: false })))
}

/// Summary over all bands: kernel error, light inside the windows, time, size, use.
fn summary(out: &Path, options: &TraceOptions, reports: &[BandReport], seconds: f64) -> [String; 2] {
    let largest = |number: fn(&NodeError) -> f64| {
        reports.iter().filter_map(|r| Some(number(r.psf_error.as_ref()?))).reduce(f64::max)
    };
    let bound = largest(|e| e.worst).zip(largest(|e| e.edge)).map_or_else(
        || "given heights, kernel error not measured".to_owned(),
        |(worst, edge)| {
            let further = match options.excess > 1.0 {
                true => format!(
                    ", {} % where that takes more than {} nodes",
                    number(100.0 * options.excess * options.psf_tolerance),
                    options.base_nodes()
                ),
                false => String::new(),
            };
            let [l1, of_edges] =
                [1.0, ESF_SHARE].map(|share| number(100.0 * share * options.psf_tolerance));
            let [worst, edge] = [worst, edge].map(|share| 100.0 * share);
            format!(
                "kernel error at most {worst:.2} % (requested {l1} %{further}), of edges {edge:.2} % of white (requested {of_edges} %)"
            )
        },
    );
    let least = reports.iter().map(|r| r.min_energy).fold(1.0, f64::min);
    let psfs: usize = reports.iter().map(|r| r.psfs).sum();
    let missed = reports.iter().filter_map(|r| MissedEnergy::new(options, r.min_energy, r.window_px));
    let worst = missed.min_by(|a, b| a.least.total_cmp(&b.least));
    let requested = worst.map_or_else(String::new, |missed| format!(" ({})", missed.request()));
    [
        format!("{bound}; every window contains at least {} of the light{requested}", percent(least)),
        format!(
            "{}: {}, {psfs} PSFs traced in {seconds:.1} s, {:.1} MB; use it with `lenscube run CHART FILM --lens {0}`",
            out.display(),
            plural(reports.len(), "band"),
            bytes_of(out) as f64 * 1e-6,
        ),
    ]
}

/// Size of a file or directory tree, bytes; unreadable entries count as 0.
pub fn bytes_of(path: &Path) -> u64 {
    match std::fs::read_dir(path) {
        Ok(entries) => entries.flatten().map(|e| bytes_of(&e.path())).sum(),
        Err(_) => std::fs::metadata(path).map_or(0, |m| m.len()),
    }
}

fn options(args: &TraceArgs, system: &System) -> Result<TraceOptions> {
    let wavelengths = wavelengths(&args.wavelengths)?;
    let given = args.heights.as_deref().map(heights).transpose()?;
    let max_mm = match args.max_height_mm {
        Some(mm) => mm,
        None if system.asymmetry.is_some() => built::max_height_mm(args)?,
        None => max_height_mm(args, system, given.as_deref())?,
    };
    let mut options = TraceOptions::new(wavelengths, max_mm);
    options.energy = args.energy;
    let widest_px = args.depths_m.map_or(TraceOptions::MAX_WINDOW_PX, |_| Blocks::widest_window());
    options.max_window_px = args.max_window_px.unwrap_or(widest_px);
    if args.depths_m.is_some() && options.max_window_px > Blocks::widest_window() {
        return Err(usage(format!(
            "--max-window-px {}: expected at most {} px for a pack with depth nodes",
            options.max_window_px,
            Blocks::widest_window()
        )));
    }
    if let Some(given) = args.psf_tolerance {
        (options.psf_tolerance, options.excess) = (given, 1.0);
    }
    options.max_nodes = args.max_nodes;
    options.psf_pitch_um = args.psf_pitch_um;
    options.film_pitch_um = args.film_pitch_um;
    if let Some(given) = given {
        options.heights = PsfHeights::Given(given);
    }
    Ok(options)
}

/// Largest height without `--max-height-mm`: of the given heights, of the design's outermost field point, or the image circle.
fn max_height_mm(args: &TraceArgs, system: &System, given: Option<&[f64]>) -> Result<f64> {
    if args.design == SAMPLE {
        return Ok(SAMPLE_HEIGHT_MM);
    }
    if let Some(mm) = given.and_then(|list| list.iter().copied().reduce(f64::max)).filter(|mm| *mm > 0.0) {
        return Ok(mm);
    }
    let tracer = Tracer::new(system, system.primary_um())?;
    let tans = system.fields.iter().map(|field| field_tan(system, &tracer.primary, *field).abs());
    let tan = tans.fold(0.0, f64::max);
    if tan == 0.0 {
        let mm = tracer.image_circle_mm().ok_or_else(|| {
            usage(format!(
                "{} has no field point off the axis, and no clear aperture that ends its image circle; give the largest image height \
                 with `--max-height-mm`",
                args.design
            ))
        })?;
        log_line(format!(
            "heights up to {mm:.4} mm, the image circle: the design has no field point off the axis, and from there on the relative \
             illumination is below {:.0} % (`--max-height-mm` for others)",
            100.0 * EDGE
        ));
        return Ok(mm);
    }
    let mm = tracer.chief_height_mm(tan).with_context(|| {
        format!(
            "the outermost field point of {}; give a smaller image height with `--max-height-mm`",
            args.design
        )
    })?;
    log_line(format!(
        "heights up to {mm:.4} mm, of the design's outermost field point (`--max-height-mm` for others)"
    ));
    Ok(mm)
}

/// Parses `--wavelengths`; ascending.
pub fn wavelengths(text: &str) -> Result<Vec<f64>> {
    let list = pipeline::wavelengths::parse(text);
    let mut list = list.map_err(|e| usage(format!("--wavelengths {text}: {e}")))?;
    list.sort_by(f64::total_cmp);
    Ok(list)
}

/// Parses `--heights`: `0:21:1` (both ends included) or `0,3,7.5`, real image heights in mm.
pub fn heights(text: &str) -> Result<Vec<f64>> {
    parse_heights(text).map_err(|e| usage(format!("--heights {text}: {e}")))
}

fn parse_heights(text: &str) -> Result<Vec<f64>, String> {
    let number = |t: &str| {
        let v = t.trim().parse::<f64>().ok().filter(|v| v.is_finite() && *v >= 0.0);
        HEIGHT_MM.check(v.ok_or(format!("`{t}` is not a height in mm"))?).map_err(|e| e.to_string())
    };
    let fields: Vec<&str> = text.split(':').collect();
    let [first, last, step] = fields[..] else { return text.split(',').map(number).collect() };
    let (first, last, step) = (number(first)?, number(last)?, number(step)?);
    if !(step > 0.0 && last > first && (last - first) / step <= 10_000.0) {
        return Err("expected FIRST:LAST:STEP with at most 10000 steps".into());
    }
    Ok((0..=((last - first) / step + 1e-9) as usize).map(|i| first + i as f64 * step).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packs_of_more_than_a_gigabyte_of_psfs_have_pupil_functions() {
        let stores =
            [(999.0, 299.0), (1001.0, 100.0), (301.0, 301.0)].map(|(all, band)| default_store(all, band));
        assert_eq!(stores, [Store::Psfs, Store::Pupils, Store::Pupils]);
    }

    #[test]
    fn a_given_tolerance_is_missed_by_kernels_or_by_edges() {
        let error = |worst, edge| NodeError { worst, at_mm: 3.0, median: 0.5 * worst, edge, limited: true };
        let report = |nm, psf_error| BandReport {
            wavelength_nm: nm,
            psf_error,
            window_px: 41,
            min_energy: 0.99,
            psfs: 1,
            no_tail: None,
        };
        let missed = |tolerance, worst, edge| {
            let reports = [report(450.0, None), report(550.0, Some(error(worst, edge)))];
            missed_tolerance(tolerance, &reports).map(|error| error.to_string())
        };
        assert_eq!(missed(None, 0.5, 0.5), None);
        assert_eq!(missed(Some(0.01), 0.01, 0.002), None);
        let kernels = missed(Some(0.01), 0.0123, 0.003).unwrap();
        assert!(
            kernels.starts_with("550 nm: kernels between the nodes have errors up to 1.230 %"),
            "{kernels}"
        );
        let edges = missed(Some(0.01), 0.009, 0.0021).unwrap();
        let expected =
            "550 nm: edges between the nodes have errors up to 0.210 % of white, expected at most 0.2 %";
        assert!(edges.starts_with(expected) && edges.contains("--psf-tolerance"), "{edges}");
    }
}
