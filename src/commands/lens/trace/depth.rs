//! `lenscube lens trace --depths-m`: a pack with depth nodes.

use super::{bytes_of, log_needed, missed_tolerance, sealed};
use crate::args::TraceArgs;
use crate::failure::usage;
use crate::job::lens::attributes::attributes;
use crate::job::lens::depth_nodes::needed;
use crate::job::lens::energy::{MissedEnergy, percent};
use crate::progress::short_number;
use crate::progress::{TracingBar, log_line, number, plural};
use anyhow::{Context, Result};
use formats::lens::LensPackWriter;
use pipeline::design::System;
use pipeline::design::depth::estimate::{estimate, range_that_fits};
use pipeline::design::depth::trace::{DepthOptions, band, estimated_nodes, header, nodes};
use pipeline::design::trace::{BandReport, Progress, TraceOptions, lens_header};
use pipeline::lens::depth::{BandDepth, DepthNode};
use std::time::Instant;

/// Traces all bands at their depth nodes into the pack of `args`.
///
/// # Errors
/// A ray that does not reach the image; an object too near; the disk.
pub fn trace(
    args: &TraceArgs,
    system: &System,
    options: &TraceOptions,
    depth: &DepthOptions,
    start: Instant,
) -> Result<()> {
    let tracing = || format!("tracing {}", args.design);
    let mut lens = lens_header(system).with_context(tracing)?;
    let mut head = header(system, depth).with_context(tracing)?;
    log_line(format!(
        "focus at {} m, depth nodes from {} to {} m; the blur radius grows by {:.1} px per dioptre",
        short_number(1.0 / depth.focus),
        short_number(1.0 / depth.range.1),
        short_number(1.0 / depth.range.0),
        head.blur_per_dioptre_um / options.film_pitch_um
    ));
    announce(args, system, options, depth).with_context(tracing)?;
    let mut pack = LensPackWriter::create(&args.out)?;
    let bar = TracingBar::new(options.wavelengths_nm.len());
    let mut reports = Vec::new();
    for (index, nm) in options.wavelengths_nm.iter().copied().map(number).enumerate() {
        let mut progress = |p: Progress| {
            bar.set_bands(p.band);
            bar.step(format!("{nm} nm: {}", p.step));
        };
        let sink = |node: usize, stack: &_| pack.psf_of_node(index, node, stack);
        bar.step(format!("{nm} nm: placing depth nodes"));
        let placement = nodes(system, options, index, depth).with_context(tracing)?;
        let placed = (depth, placement);
        let traced = band(system, options, index, placed, &mut progress, sink).with_context(tracing)?;
        let (placement, nodes) = (&traced.placement, &traced.reports);
        let windows = nodes.iter().map(|r| r.window_px);
        bar.suspend(|| {
            log_line(format!(
                "{nm} nm: {} depth nodes, error between them at most {:.2} % (edge spread {:.3} %), windows of {} to {} px",
                nodes.len(),
                100.0 * placement.l1,
                100.0 * placement.esf,
                windows.clone().min().unwrap_or(0),
                windows.max().unwrap_or(0),
            ));
        });
        if let Some(missed) = missed_tolerance(args.psf_tolerance, nodes) {
            return Err(missed);
        }
        reports.push(traced.reports[traced.nodes.nearest(depth.focus)]);
        lens.bands.push(traced.tables);
        head.bands.push(traced.nodes);
    }
    bar.finish();
    let of_band = |(band, nodes): (&BandReport, &BandDepth)| {
        let of_node = |n: &DepthNode| {
            let least = n.psf_energy.iter().copied().fold(1.0, f64::min);
            let window_px = n.psf_size as f64 * n.psf_pitch_um / options.film_pitch_um;
            MissedEnergy::new(options, least, window_px.round() as usize)
        };
        nodes
            .nodes
            .iter()
            .filter_map(of_node)
            .map(|missed| (missed, number(band.wavelength_nm)))
            .collect::<Vec<_>>()
    };
    let missed = std::iter::zip(&reports, &head.bands).flat_map(of_band);
    if let Some((missed, nm)) = missed.min_by(|a, b| a.0.least.total_cmp(&b.0.least)) {
        log_line(format!(
            "windows contain at least {} of the light, at {nm} nm ({})",
            percent(missed.least),
            missed.request()
        ));
    }
    let nodes: usize = head.bands.iter().map(|b| b.nodes.len()).sum();
    lens.depth = Some(head);
    let attributes = attributes(&args.design, &args.parameters, options, &reports);
    sealed::finish(args, pack, &lens, attributes)?;
    log_line(format!(
        "{}: {}, {nodes} depth nodes traced in {:.1} s, {:.1} MB; use it with `lenscube run CHART FILM --lens {0} --depth DEPTH`",
        args.out.display(),
        plural(lens.bands.len(), "band"),
        start.elapsed().as_secs_f64(),
        bytes_of(&args.out) as f64 * 1e-6,
    ));
    Ok(())
}

/// Prints what the depth nodes of all bands need, before any is traced.
///
/// # Errors
/// Usage: PSFs are wider than the largest window; the pack is larger than `--max-gb`.
fn announce(args: &TraceArgs, system: &System, options: &TraceOptions, depth: &DepthOptions) -> Result<()> {
    let fits = range_that_fits(system, options, depth)?;
    if depth.range.0 < fits.0 || fits.1 < depth.range.1 {
        let farthest = if fits.0 > 0.0 { format!("{:.4}", 1.0 / fits.0) } else { "inf".to_owned() };
        return Err(usage(format!(
            "--depths-m: surfaces there are blurred more widely than the largest PSF window, {} px; with this focus it holds --depths-m \
             {:.4}:{farthest}",
            options.max_window_px,
            1.0 / fits.1,
        )));
    }
    let (bands, middle) = (options.wavelengths_nm.len(), options.wavelengths_nm.len() / 2);
    let expected = estimated_nodes(system, options, middle, depth)?;
    let all = estimate(system, options, middle, depth, &expected)?.times(bands);
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    let (seconds, text) = needed(&all, cores);
    let gb = all.bytes as f64 * 1e-9;
    if gb > args.max_gb {
        return Err(usage(format!(
            "{text}; --max-gb {} is the limit: a shorter range of --depths-m, fewer --wavelengths, a smaller --max-height-mm or a larger \
             --depth-tolerance need less, `lenscube run CHART FILM --lens {} --focus-m M --depth DEPTH` traces the nodes that its scene needs, \
             `--max-gb {}` allows it",
            args.max_gb,
            args.design,
            gb.ceil()
        )));
    }
    log_needed(seconds, text);
    Ok(())
}
