//! A design and the film that it is traced for: options of the trace.
//!
//! The *trace pitch* is the film's pitch rounded down to ten steps per decade and at most 50 µm: larger pixels only average over more. Coarser
//! pixels need fewer nodes and admit wider PSFs.

use super::asymmetric::AsymmetricLens;
use super::band_widths::BandWidths;
use crate::args::TracingArgs;
use anyhow::Result;
use pipeline::band::{BandPlan, Options};
use pipeline::depth::plan::Surfaces;
use pipeline::design::System;
use pipeline::design::depth::estimate::DepthEstimate;
use pipeline::design::depth::trace::DepthOptions;
use pipeline::design::trace::{Azimuths, LensTrace, PsfHeights, TraceOptions};
use pipeline::geometry::Frame;
use pipeline::lens::{Lens, LensError};
use pipeline::psf::blocks::Blocks;
use pipeline::stage::Stage;

/// Maximum trace pitch, µm.
const MAX_PITCH_UM: f64 = 50.0;
/// Trace pitch up to which windows have the same limit in pixels, µm; those of coarser ones may have [`MAX_SIDE`] samples at most.
const FINE_PITCH_UM: f64 = 2.0;
/// Maximum samples of a side of a PSF for coarse pixels: those of 639 pixels of 2 µm at f/1.2 and 400 nm.
const MAX_SIDE: f64 = 6400.0;
/// Reach of a band over one whose map does not cover the film.
pub(super) const WIDER: f64 = 1.02;
/// Trace pitches in a decade (R10 series of preferred numbers).
const PITCHES: [f64; 10] = [1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0];
/// Relative amount by which a trace pitch may exceed the film's.
const PITCH_TOLERANCE: f64 = 1e-3;

/// A design with estimated depth nodes, of one band at its primary wavelength.
pub struct EstimatedLens {
    /// Its tables.
    pub lens: Lens,
    /// Largest L1 error of a kernel half-way between nodes.
    pub l1: f64,
    /// What tracing the band's nodes needs.
    pub needed: DepthEstimate,
}

/// What is done with the estimated depth nodes of a design before the first of them is traced.
pub type BeforeTrace<'a> = dyn Fn(&EstimatedLens) -> Result<()> + Sync + 'a;

/// Surfaces for which a design is traced at several object distances.
#[derive(Clone, Copy)]
pub struct TracedFor<'a> {
    /// Vergences of the surfaces.
    pub surfaces: &'a Surfaces,
    /// Focus, range of the nodes, and accuracy between them.
    pub options: DepthOptions,
    /// Called once, unless all bands are in the cache; its error ends the trace.
    pub before_trace: Option<&'a BeforeTrace<'a>>,
}

/// A design and what it is traced for.
#[derive(Clone, Copy)]
pub(super) struct TracingJob<'a> {
    pub(super) system: &'a System,
    pub(super) name: &'a str,
    pub(super) frame: &'a Frame,
    pub(super) options: &'a Options,
    /// Flags of the trace; none in commands without them, which have the defaults.
    pub(super) tracing: Option<&'a TracingArgs>,
    /// Surfaces at several distances.
    pub(super) depth: Option<TracedFor<'a>>,
    /// Widths of the bands; none if a band is one wavelength.
    pub(super) bands: Option<&'a BandWidths>,
    /// The lens that is traced, if it has no rotational symmetry.
    pub(super) asymmetric: Option<&'a AsymmetricLens>,
}

impl TracingJob<'_> {
    /// Whether its bands have tails.
    pub(super) fn has_tails(&self) -> bool {
        let has_psfs = self.options.stages.has(Stage::Svpsf);
        self.asymmetric.is_none()
            && self.tracing.is_some_and(|tracing| tracing.admits_tails(has_psfs, self.depth.is_some()))
    }

    /// How far from the axis its bands are needed, mm: to the film's corner, or as far as is asked for.
    pub(super) fn farthest_mm(&self) -> f64 {
        let asked_mm = self.tracing.and_then(|tracing| tracing.reach_mm).unwrap_or(0.0);
        self.frame.farthest_mm(self.frame.film.rect()).max(asked_mm)
    }

    /// Plan of the band at `nm` with `lens`.
    pub(super) fn plan(&self, lens: &Lens, nm: f64) -> Result<BandPlan, LensError> {
        match self.depth {
            None => BandPlan::new(self.frame, lens, nm, self.options),
            Some(depth) => BandPlan::with_depth(self.frame, lens, nm, self.options, depth.surfaces),
        }
    }

    /// How far from the axis, mm, the film needs the band of `lens` at `nm`, which reaches `reach_mm`; none if that is enough.
    pub(super) fn wider_for_film(&self, lens: &Lens, nm: f64, reach_mm: f64) -> Option<f64> {
        match self.plan(lens, nm) {
            // E.g. film pixels much larger than those of the trace.
            Err(LensError::Outside { needed_mm, .. }) => Some(needed_mm),
            Err(LensError::OutsideMap { .. }) => Some(WIDER * reach_mm),
            // Other errors are reported when the job plans its bands.
            _ => None,
        }
    }
}

/// The largest trace pitch up to `film_pitch_um`.
pub(super) fn trace_pitch_um(film_pitch_um: f64) -> f64 {
    let limit = film_pitch_um.min(MAX_PITCH_UM) * (1.0 + PITCH_TOLERANCE);
    let mut unit = 0.1;
    while limit < PITCHES[0] / unit {
        unit *= 10.0;
    }
    // A quotient of short decimals, so that equal pitches have equal bits.
    let below = PITCHES.iter().map(|p| p / unit).filter(|p| *p <= limit);
    below.fold(PITCHES[0] / unit, f64::max)
}

/// Trace options of a job. Without the PSF stage only two PSFs of a minimum window are traced.
pub(super) fn trace_options(nm: f64, reach_mm: f64, job: &TracingJob<'_>) -> TraceOptions {
    let mut trace = TraceOptions::new(vec![nm], reach_mm);
    trace.film_pitch_um = trace_pitch_um(job.frame.pitch_um);
    if job.depth.is_some() {
        trace.max_window_px = Blocks::widest_window();
    }
    if trace.film_pitch_um > FINE_PITCH_UM {
        trace.max_window_px = trace.max_window_px.min(window_of_samples(job.system, &trace, MAX_SIDE));
    }
    if let Some(TracingArgs { energy, max_window_px, .. }) = job.tracing {
        trace.energy = energy.unwrap_or(trace.energy);
        trace.max_window_px = max_window_px.unwrap_or(trace.max_window_px);
    }
    if !job.options.stages.has(Stage::Svpsf) {
        trace.heights = PsfHeights::Given(vec![0.0, reach_mm]);
        trace.azimuths = Azimuths::Given(4);
        trace.window_px = Some(3);
    }
    trace
}

/// The largest window of about `side` samples near the axis, film pixels of `trace`.
fn window_of_samples(system: &System, trace: &TraceOptions, side: f64) -> usize {
    let on_axis = TraceOptions { max_height_mm: 1e-3, ..trace.clone() };
    let estimate = LensTrace::new(system, &on_axis).and_then(|trace| trace.estimate(0));
    // Errors are those of the trace itself.
    let px = estimate.map_or(f64::INFINITY, |e| side * e.window_px as f64 / e.side as f64);
    (px.clamp(3.0, 2000.0) as usize - 1) | 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearby_pitches_share_their_bands() {
        for (film, traced) in [
            (2.0, 2.0),
            (2.4, 2.0),
            (2.5, 2.5),
            (5.0, 5.0),
            (9.99, 8.0),
            (20.0, 20.0),
            (48.0, 40.0),
            (85.0, 50.0),
            (1.999, 2.0),
            (1.9, 1.6),
            (1.12, 1.0),
            (1.0, 1.0),
            (0.9, 0.8),
            (0.12, 0.1),
            (0.0999, 0.08),
            (0.005, 0.005),
        ] {
            assert_eq!(trace_pitch_um(film), traced, "{film}");
        }
    }
}
