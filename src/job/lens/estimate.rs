//! Depth nodes of a design without its PSFs, for a forecast.
//!
//! Vergences are placed as by a trace, from kernels at the axis and the film's corner; over a wide range of blur they are
//! estimated from some of these kernels. Each node's window is estimated from rays
//! ([`LensTrace::estimate`]); heights and azimuths are typical ones, evenly spaced, on which the number of kernels that reach a block depends.

use super::blur::{check_blur, margin_mm};
use super::reach::Reach;
use super::tracing_job::{EstimatedLens, TracedFor, TracingJob, trace_options};
use crate::args::TracingArgs;
use anyhow::Result;
use pipeline::band::Options;
use pipeline::design::depth::estimate::estimate;
use pipeline::design::depth::nodes::{ESF_TOLERANCE, Placement};
use pipeline::design::depth::trace::{estimated_nodes, header, nodes};
use pipeline::design::ray::Tracer;
use pipeline::design::trace::{LensTrace, lens_header};
use pipeline::design::{DesignError, System};
use pipeline::field::Outside;
use pipeline::geometry::Frame;
use pipeline::lens::LensBand;
use pipeline::lens::depth::{BandDepth, DepthNode};

/// PSF heights of a node and azimuths of each: those of traced lenses are 40 to 54 and 32 to 96.
const HEIGHTS: usize = 48;
const AZIMUTHS: usize = 64;
/// Range of blur radii, film px and µm, up to which nodes are placed as by a trace; of a larger one they are estimated.
const PLACED: (f64, f64) = (16.0, 32.0);
/// Field points of the tables.
const FIELD_POINTS: usize = 65;

/// The depth nodes of `system`, called `name`, for the surfaces of `traced_for` on the film of `frame`.
///
/// # Errors
/// A ray that does not reach the image; an object too near; a film larger than the lens's field; usage: a surface too far from focus.
pub fn estimated(
    (system, name, tracing): (&System, &str, &TracingArgs),
    frame: &Frame,
    options: &Options,
    traced_for: TracedFor<'_>,
) -> Result<EstimatedLens> {
    let depth = Some(traced_for);
    of_job(
        &TracingJob {
            system,
            name,
            frame,
            options,
            tracing: Some(tracing),
            depth,
            bands: None,
            asymmetric: None,
        },
        traced_for,
    )
}

/// The depth nodes of `job` for the surfaces of `traced_for`.
///
/// # Errors
/// As [`estimated`].
pub(super) fn of_job(job: &TracingJob<'_>, traced_for: TracedFor<'_>) -> Result<EstimatedLens> {
    let TracingJob { system, frame, options, .. } = *job;
    let nm = system.primary_um() * 1e3;
    let at_primary = trace_options(nm, 1.0, job);
    check_blur(job, &traced_for, &at_primary)?;
    let depth = &traced_for.options;
    let reach = Reach::new(job, margin_mm(job, &at_primary)?)?;
    let tracer = Tracer::new(system, system.primary_um())?;
    let wanted_mm = reach.of(&tracer, job.farthest_mm())[0].reach_mm;
    let reach_mm = match tracer.field_of_height(wanted_mm) {
        Err(DesignError::Height { reached_mm, .. }) if options.interpolation.outside == Outside::Clamp => {
            0.99 * reached_mm
        }
        reached => reached.map(|_| wanted_mm)?,
    };
    let trace = trace_options(nm, reach_mm, job);
    let mut head = header(system, depth)?;
    let blur_px = head.blur_per_dioptre_um / trace.film_pitch_um;
    let placement =
        match (depth.range.1 - depth.range.0) * blur_px <= PLACED.0.min(PLACED.1 / trace.film_pitch_um) {
            true => nodes(system, &trace, 0, depth)?,
            false => {
                let vergence = estimated_nodes(system, &trace, 0, depth)?;
                Placement { vergence, l1: depth.tolerance, esf: ESF_TOLERANCE }
            }
        };
    let in_use = traced_for.surfaces.nodes_in_use(&placement.vergence, depth.focus, frame.chart);
    let l1 = placement.l1;
    let vergence = placement.only(&in_use).vergence;
    let needed = estimate(system, &trace, 0, depth, &vergence)?;
    let psf_height_mm: Vec<f64> = spaced(HEIGHTS, reach_mm);
    let azimuth_count: Vec<usize> = (0..HEIGHTS).map(|k| if k == 0 { 1 } else { AZIMUTHS }).collect();
    let node = |v: &f64| -> Result<DepthNode> {
        let moved = system.at_vergence(*v)?;
        let window = LensTrace::new(&moved, &trace)?.estimate(0)?;
        Ok(DepthNode {
            psf_height_mm: psf_height_mm.clone(),
            azimuth_count: azimuth_count.clone(),
            psf_energy: vec![1.0; HEIGHTS],
            psf_size: window.side,
            psf_pitch_um: window.window_px as f64 * trace.film_pitch_um / window.side as f64,
            etendue_ratio: vec![1.0; FIELD_POINTS],
        })
    };
    let list = vergence.iter().map(node).collect::<Result<Vec<_>>>()?;
    let nodes = BandDepth { vergence, nodes: list, pupil_shift_mm: vec![0.0; FIELD_POINTS] };
    let mut lens = lens_header(system)?;
    let mut tables = tables(system, nm, reach_mm)?;
    nodes.set_psfs(&mut tables, nodes.nearest(depth.focus));
    lens.bands.push(tables);
    head.bands.push(nodes);
    lens.depth = Some(head);
    Ok(EstimatedLens { lens, l1, needed })
}

/// Heights of the chief rays up to `reach_mm`; no illumination, no PSFs.
fn tables(system: &System, nm: f64, reach_mm: f64) -> Result<LensBand> {
    let tracer = Tracer::new(system, nm / 1e3)?;
    let image_height_mm = spaced(FIELD_POINTS, reach_mm);
    let ideal = |r: &f64| Ok(tracer.field_of_height(*r)? * tracer.ideal_scale_mm().abs());
    Ok(LensBand {
        ideal_height_mm: image_height_mm.iter().map(ideal).collect::<Result<_>>()?,
        psf_height_mm: Vec::new(),
        azimuth_count: Vec::new(),
        psf_energy: Vec::new(),
        ..LensBand::ideal(nm, image_height_mm)
    })
}

/// `count` numbers from 0 to `last`.
fn spaced(count: usize, last: f64) -> Vec<f64> {
    (0..count).map(|i| last * i as f64 / (count - 1) as f64).collect()
}
