//! Blur of the surfaces of a job: whether PSFs hold it, and the margin that it needs.

use super::tracing_job::{TracedFor, TracingJob};
use crate::failure::usage;
use crate::progress::short_number;
use anyhow::{Context, Result};
use pipeline::design::depth::estimate::{half_window_px, range_that_fits};
use pipeline::design::depth::trace::header;
use pipeline::design::trace::{LEAST_TAIL_WINDOW_PX, TraceOptions};

/// Fails if a surface lies behind the first vertex, or is blurred by more than the PSFs of a trace hold.
pub(super) fn check_blur(job: &TracingJob<'_>, depth: &TracedFor<'_>, trace: &TraceOptions) -> Result<()> {
    let (system, options) = (job.system, depth.options);
    let (far, near) = options.range;
    system.at_vergence(near).with_context(|| format!("the nearest surface, at {} m", 1.0 / near))?;
    let fits = range_that_fits(system, trace, &options)?;
    if fits.0 <= far && near <= fits.1 {
        return Ok(());
    }
    let worst = if near > fits.1 { near } else { far };
    let blur_mm = 1e-3 * header(system, &options)?.blur_per_dioptre_um * (worst - options.focus).abs();
    let at = |vergence: f64| match vergence > 0.0 {
        true => format!("{} m", short_number(1.0 / vergence)),
        false => "infinity".to_owned(),
    };
    Err(usage(format!(
        "a surface at {} is blurred to a radius of {} mm by {}, in focus at {}; PSFs on this film hold surfaces from {} to {}: choose a \
         focus nearer to the scene (--focus-m), wider PSFs (--max-window-px), a scene of a shorter range of distances, or a lens with a smaller aperture",
        at(worst),
        short_number(blur_mm),
        job.name,
        at(options.focus),
        at(fits.1),
        at(fits.0),
    )))
}

/// Half the diagonal of the largest window that the blur of the surfaces of `job` needs, mm; for a flat chart that of the least window with tails, or 0.
pub(super) fn margin_mm(job: &TracingJob<'_>, trace: &TraceOptions) -> Result<f64> {
    let half_px = match &job.depth {
        Some(depth) => half_window_px(job.system, trace, &depth.options)?,
        None if job.has_tails() => 0.5 * LEAST_TAIL_WINDOW_PX as f64,
        None => 0.0,
    };
    Ok(std::f64::consts::SQRT_2 * half_px * trace.film_pitch_um * 1e-3)
}
