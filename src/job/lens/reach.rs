//! Reach of a traced band: the real image height up to which a design is traced.
//!
//! Nodes, tables and windows of a band depend on its reach, so the reach belongs to the lens, not to the film: films of any size and axis within
//! the same *step* have the same bands. Steps are image heights:
//!
//! 1. the design's outermost field point F, and below it F/√2, F/2, … F/16: each has half the area of the one above. One step for all films would give
//!    small ones the wide windows and the sparse nodes of the edge of the field;
//! 2. beyond F, and for designs with an axial field point alone, 20 steps a decade from F or from 1 mm.
//!
//! Bands with depth nodes, which have hundreds of times the PSFs of others and belong to a range of distances as well, have the steps of 1 for every lens, and further
//! ones down to F/256: a small film in the middle of the field then needs a few heights of each node.
//!
//! A band reaches beyond its step by half the diagonal of its PSF window, whatever the film needs. Where a lens cannot be traced so far, the margin
//! is smaller, then the band reaches as far as its film needs, and at last to the film's corner.

use super::samples::design_reach_mm;
use super::tracing_job::{TracingJob, trace_options, trace_pitch_um};
use crate::design;
use anyhow::Result;
use formats::lens::LensPack;
use pipeline::design::ray::Tracer;
use pipeline::design::trace::LensTrace;
use pipeline::real;
use std::f64::consts::FRAC_1_SQRT_2;

/// Minimum reach beyond a step, mm: half a window of 177 pixels of 2 µm, along the diagonal.
const MARGIN_MM: f64 = 0.25;
/// A further step of the built-in lens, mm: with the margin the reach of its reference tables.
const BUILTIN_STEP_MM: f64 = 20.25;
/// Steps below the outermost field point.
const STEPS_WITHIN: u32 = 8;
/// The same of bands with depth nodes.
const DEPTH_STEPS_WITHIN: u32 = 16;
/// Steps in a decade beyond the outermost field point.
const STEPS_PER_DECADE: f64 = 20.0;
/// Maximum reach over the largest image height of a chief ray.
const OF_FARTHEST: f64 = 0.99;
/// Relative amount by which a film may exceed a step: rounding from pixels to mm.
const ROUNDING: f64 = 1e-9;
/// Film pitches over their trace pitch, at most: the largest ratio of two trace pitches.
const LARGER_PITCH: f64 = 1.3;
/// Film pixels beyond the film's corner that a band reaches at least.
const EDGE_PX: f64 = 2.0;
/// Windows over their estimate from rays.
const OVER_ESTIMATE: f64 = 1.1;

/// `mm` rounded up to a multiple of 5 in its third digit: 20.35 to 20.5, 3.02 to 3.05.
fn rounded_up(mm: f64) -> f64 {
    let step = 5.0 * 10f64.powi(real::log10(mm).floor() as i32 - 2);
    // A multiple of the step, so that equal films have bitwise equal reaches.
    (mm / step - 1e-9).ceil() * step
}

/// Steps of the lens of a job.
pub(super) struct Reach<'a> {
    job: TracingJob<'a>,
    /// Image height of the outermost field point, mm; 0 if all are on the axis.
    field_mm: f64,
    /// Steps up to it, mm, ascending.
    steps_mm: Vec<f64>,
    /// Half the diagonal of the windows of surfaces out of focus, mm.
    blur_mm: f64,
    /// Upper bound of the pitch of films with the job's trace pitch, µm.
    film_pitch_um: f64,
}

/// How far a band is traced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BandReach {
    /// Its step, mm; none if the reach is that of a film.
    pub(super) step_mm: Option<f64>,
    /// Its reach, mm.
    pub(super) reach_mm: f64,
}

impl BandReach {
    /// The reach of a film that needs `mm`.
    pub(super) fn up_to(mm: f64) -> Self {
        Self { step_mm: None, reach_mm: rounded_up(mm) }
    }
}

impl<'a> Reach<'a> {
    /// The steps of the lens of `job`; `blur_mm`: half the diagonal of the windows of surfaces out of focus.
    ///
    /// # Errors
    /// A design without first-order properties.
    pub(super) fn new(job: &TracingJob<'a>, blur_mm: f64) -> Result<Self> {
        let field_mm = design_reach_mm(job.system)?;
        let within = |steps: u32| (0..=steps).map(|k| field_mm * real::pow(0.5, 0.5 * f64::from(k)));
        let mut steps_mm: Vec<f64> = match (job.depth.is_some(), job.name == design::BUILTIN) {
            (true, _) => within(DEPTH_STEPS_WITHIN).collect(),
            (false, true) => vec![field_mm, BUILTIN_STEP_MM],
            (false, false) => within(STEPS_WITHIN).collect(),
        };
        steps_mm.retain(|mm| *mm > 0.0);
        steps_mm.sort_by(f64::total_cmp);
        let film_pitch_um = LARGER_PITCH * trace_pitch_um(job.frame.pitch_um);
        Ok(Self { job: *job, field_mm, steps_mm, blur_mm, film_pitch_um })
    }

    /// The smallest step from `mm` on, mm.
    fn step_mm(&self, mm: f64) -> f64 {
        let within = self.steps_mm.iter().find(|step| mm <= **step * (1.0 + ROUNDING));
        within.copied().unwrap_or_else(|| {
            let first_mm = if self.field_mm > 0.0 { self.field_mm } else { 1.0 };
            let k = (STEPS_PER_DECADE * real::log10(mm / first_mm) - ROUNDING).ceil();
            first_mm * real::pow(10.0, k / STEPS_PER_DECADE)
        })
    }

    /// The reaches of the band of `tracer` for a film up to `film_mm` from the axis: each is tried if the lens cannot be traced up to the ones before.
    pub(super) fn of(&self, tracer: &Tracer<'_>, film_mm: f64) -> Vec<BandReach> {
        let step_mm = self.step_mm(film_mm);
        let window_mm = self.window_mm(tracer.wavelength_um, step_mm).max(self.blur_mm);
        let (margin_mm, last_mm) = (window_mm.max(MARGIN_MM), OF_FARTHEST * tracer.farthest_field().0);
        let own = BandReach::up_to(film_mm + margin_mm);
        let mut of_step = vec![rounded_up(step_mm + margin_mm), rounded_up(step_mm + window_mm)];
        of_step.dedup();
        of_step.retain(|mm| *mm <= last_mm);
        if of_step.is_empty() && own.reach_mm <= last_mm {
            of_step.push(last_mm);
        }
        let of_step = of_step.into_iter().map(|reach_mm| BandReach { step_mm: Some(step_mm), reach_mm });
        // Of the film alone: with that margin, with its own windows, and no farther than the film.
        let window_mm = self.window_mm(tracer.wavelength_um, film_mm).max(self.blur_mm);
        let edge_mm = film_mm + EDGE_PX * 1e-3 * self.film_pitch_um;
        let of_film =
            [own, BandReach::up_to(film_mm + window_mm), BandReach { step_mm: None, reach_mm: edge_mm }];
        let mut all: Vec<BandReach> = Vec::new();
        for reach in of_step.chain(of_film) {
            if all.last().is_none_or(|before| reach.reach_mm < before.reach_mm) {
                all.push(reach);
            }
        }
        all
    }

    /// Half the diagonal of the kernels that are expected from rays at `um` up to `step_mm`, mm; 0 without an estimate.
    fn window_mm(&self, um: f64, step_mm: f64) -> f64 {
        let options = trace_options(1e3 * um, step_mm, &self.job);
        let estimate = LensTrace::new(self.job.system, &options).and_then(|trace| trace.estimate(0));
        estimate.map_or(0.0, |e| {
            self.half_diagonal_mm(OVER_ESTIMATE * e.window_px as f64 * options.film_pitch_um)
        })
    }

    /// Half the diagonal of the kernels of windows of `side_um`, mm: up to two film pixels wider.
    fn half_diagonal_mm(&self, side_um: f64) -> f64 {
        1e-3 * FRAC_1_SQRT_2 * (side_um + 2.0 * self.film_pitch_um)
    }

    /// The wider reach that the window of the traced band `pack` needs beyond its step; none if `traced` is enough.
    pub(super) fn wider(&self, tracer: &Tracer<'_>, traced: BandReach, pack: &LensPack) -> Option<BandReach> {
        let step_mm = traced.step_mm?;
        let lens = pack.lens();
        let of_band = lens.bands.iter().map(|band| band.psf_size as f64 * band.psf_pitch_um);
        let nodes = lens.depth.iter().flat_map(|depth| &depth.bands).flat_map(|band| &band.nodes);
        let of_nodes = nodes.map(|node| node.psf_size as f64 * node.psf_pitch_um);
        let side_um = of_band.chain(of_nodes).fold(0.0, f64::max);
        let needed_mm = step_mm + self.half_diagonal_mm(side_um);
        let reach_mm = rounded_up(needed_mm);
        let is_reached = reach_mm <= OF_FARTHEST * tracer.farthest_field().0;
        (needed_mm > traced.reach_mm && is_reached).then_some(BandReach { step_mm: Some(step_mm), reach_mm })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::default_options;
    use crate::job::lens::TracedFor;
    use formats::design::builtin::BuiltinLens;
    use pipeline::band::Options;
    use pipeline::depth::occupancy::Occupancy;
    use pipeline::depth::plan::Surfaces;
    use pipeline::design::depth::trace::DepthOptions;
    use pipeline::geometry::{Frame, Size};
    use pipeline::stage::{Stage, Stages};
    use std::sync::Arc;

    /// The reaches of a film up to `film_mm` from the axis of a Double Gauss with these steps, without PSFs.
    fn reaches(field_mm: f64, steps_mm: &[f64], film_mm: f64) -> Vec<BandReach> {
        let system = BuiltinLens::named("double-gauss-28").unwrap().system();
        let size = Size::new(9, 9);
        let stages = Stages::of(&[Stage::Ri, Stage::Distortion]);
        let options = Options { stages, ..default_options() };
        let frame = Frame::centred(size, size, 2.0);
        let job = TracingJob {
            system: &system,
            name: "test",
            frame: &frame,
            options: &options,
            tracing: None,
            depth: None,
            bands: None,
            asymmetric: None,
        };
        let reach = Reach { field_mm, steps_mm: steps_mm.to_vec(), ..Reach::new(&job, 0.0).unwrap() };
        reach.of(&Tracer::new(&system, 0.55).unwrap(), film_mm)
    }

    #[test]
    fn films_within_a_step_have_one_reach() {
        let of =
            |field_mm: f64, steps_mm: &[f64], film_mm: f64| reaches(field_mm, steps_mm, film_mm)[0].reach_mm;
        let one = |film_mm: f64| of(20.0, &[20.0], film_mm);
        assert!([0.1, 3.0, 11.0, 20.0, 20.0 * (1.0 + 1e-12)].iter().all(|mm| one(*mm) == 20.5));
        let two = |film_mm: f64| of(20.0, &[5.0, 20.0], film_mm);
        assert_eq!([0.1, 5.0, 5.1, 20.0].map(two), [5.25, 5.25, 20.5, 20.5]);
        // Beyond the field and without one: 20 steps a decade.
        assert!([21.0, 22.4].iter().all(|mm| one(*mm) == one(20.1)) && one(22.5) > one(20.1));
        let axial = |film_mm: f64| of(0.0, &[], film_mm);
        assert!(axial(8.95) == axial(10.0) && axial(10.01) > axial(10.0));
    }

    #[test]
    fn bands_with_depth_nodes_reach_little_farther_than_small_films() {
        let system = BuiltinLens::named(design::BUILTIN).unwrap().system();
        let (size, options) = (Size::new(700, 1000), default_options());
        let frame = Frame::centred(size, size, 2.0);
        let surfaces = Surfaces {
            first: 0.5,
            last: 0.5,
            is_opaque: true,
            occupancy: Arc::new(Occupancy::new(size)),
            is_invented: false,
        };
        let depth = DepthOptions { focus: 0.5, range: (0.5, 0.5), tolerance: 0.02, is_for_film: true };
        let depth = TracedFor { surfaces: &surfaces, options: depth, before_trace: None };
        let step_mm = |depth: Option<TracedFor<'_>>, film_mm: f64| {
            let (options, name) = (&options, design::BUILTIN);
            let frame = &frame;
            let job = TracingJob {
                system: &system,
                name,
                frame,
                options,
                tracing: None,
                depth,
                bands: None,
                asymmetric: None,
            };
            Reach::new(&job, 0.0).unwrap().step_mm(film_mm)
        };
        assert!(step_mm(None, 1.22) > 15.0);
        let small = step_mm(Some(depth), 1.22);
        assert!((1.22..1.22 * 1.42).contains(&small), "{small}");
    }

    #[test]
    fn reach_ends_before_the_last_chief_ray_and_with_the_film() {
        let system = BuiltinLens::named("double-gauss-28").unwrap().system();
        let last_mm = 0.99 * Tracer::new(&system, 0.55).unwrap().farthest_field().0;
        let within = BandReach { step_mm: Some(last_mm), reach_mm: last_mm };
        let film_mm = last_mm - 1.0;
        // Without PSFs there is no window: at last the film alone.
        let edge = |mm: f64| BandReach { step_mm: None, reach_mm: mm + 2.0 * 1.3 * 2e-3 };
        let of_film = |mm: f64| [BandReach::up_to(mm + 0.25), BandReach::up_to(mm + 2.1e-3 * 1.3), edge(mm)];
        let all = reaches(last_mm, &[last_mm], film_mm);
        assert_eq!((all[0], all[1], *all.last().unwrap()), (within, of_film(film_mm)[0], edge(film_mm)));
        let all = reaches(last_mm, &[last_mm], last_mm);
        assert_eq!((all[0], *all.last().unwrap()), (of_film(last_mm)[0], edge(last_mm)));
        assert!(all.windows(2).all(|pair| pair[1].reach_mm < pair[0].reach_mm), "{all:?}");
    }

    #[test]
    fn reach_is_rounded_up_to_5_in_the_third_digit() {
        for (mm, up) in
            [(20.35, 20.5), (20.5, 20.5), (3.02, 3.05), (0.9701, 0.975), (99.7, 100.0), (100.0, 100.0)]
        {
            assert!((rounded_up(mm) - up).abs() < 1e-9, "{mm}: {}", rounded_up(mm));
        }
    }
}
