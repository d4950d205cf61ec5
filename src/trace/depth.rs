//! `lenscube lens trace --depths-m`: a pack with depth nodes.

use super::{attributes, bytes_of, create_pack};
use crate::args::TraceArgs;
use crate::progress::{log_line, tracing_bar};
use anyhow::{Context, Result};
use pipeline::design::System;
use pipeline::design::depth::trace::{DepthOptions, band, header};
use pipeline::design::trace::{Progress, TraceOptions, lens_header};
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
        1.0 / depth.focus,
        1.0 / depth.range.1,
        1.0 / depth.range.0,
        head.blur_per_dioptre_um / options.film_pitch_um
    ));
    let mut pack = create_pack(&args.out)?;
    let bar = tracing_bar(options.wavelengths_nm.len());
    let mut reports = Vec::new();
    for (index, nm) in options.wavelengths_nm.iter().enumerate() {
        let mut progress = |p: Progress| {
            bar.set_position(p.band as u64);
            bar.set_message(format!("{nm} nm: {}", p.step));
        };
        let sink = |node: usize, stack: &_| pack.psf_of_node(index, node, stack);
        let traced = band(system, options, index, depth, &mut progress, sink).with_context(tracing)?;
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
        reports.push(traced.reports[traced.nodes.nearest(depth.focus)]);
        lens.bands.push(traced.tables);
        head.bands.push(traced.nodes);
    }
    bar.finish_and_clear();
    let nodes: usize = head.bands.iter().map(|b| b.nodes.len()).sum();
    lens.depth = Some(head);
    pack.finish(&lens, &attributes(&args.design, &args.parameters, options, &reports))?;
    log_line(format!(
        "{}: {} bands, {nodes} depth nodes traced in {:.1} s, {:.1} MB; use it with `lenscube run CHART FILM --lens {0} --depth DEPTH`",
        args.out.display(),
        lens.bands.len(),
        start.elapsed().as_secs_f64(),
        bytes_of(&args.out) as f64 * 1e-6,
    ));
    Ok(())
}
