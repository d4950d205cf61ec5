//! The samples that films make kernels from: how many PSFs they allow, and the errors of kernels by them.
//!
//! Films make kernels of wide PSFs from fewer samples than are traced ([`crate::psf::coarse`]). Where those do not allow the heights that the tolerance needs, the band
//! states even fewer, of more PSFs, if the error of nodes and samples together is smaller. What samples lose is the L1 of kernels of the PSFs at four heights, integrated
//! from all samples and from those of films ([`FilmPixels`]).

use std::convert::Infallible;

use rayon::prelude::*;

use super::difference::Difference;
use super::options::TraceOptions;
use super::placement::{Placement, Relaxed};
use super::refine::{MAX_SAMPLES, max_samples};
use crate::design::prescription::error::DesignError;
use crate::design::psf::film_pixel::FilmPixels;
use crate::design::psf::pupil_stack::normalise;
use crate::design::psf::{PsfGrid, PsfScratch};
use crate::design::pupil::pupils::Pupils;
use crate::lens::{PsfSample, PsfStack};
use crate::psf::coarse::KernelSamples;

/// Maximum samples of the PSFs of a band as they are traced: that of an array of a lens pack.
const MAX_TRACED: usize = 1 << 29;
/// Heights where the loss by samples is measured.
const MEASURED: usize = 4;

/// Samples of a band's PSFs: nodes are the same with tails, in whose wider windows PSFs may have more.
#[derive(Clone, Debug)]
pub(in crate::design) struct FilmSamples {
    traced: KernelSamples,
    /// Those that films use, from few PSFs to many.
    steps: Vec<KernelSamples>,
}

impl FilmSamples {
    /// Of PSFs with `side` samples of `pitch_um` a side; films use all if `has_all`.
    pub(super) fn new((side, pitch_um): (usize, f64), film_pitch_um: f64, has_all: bool) -> Self {
        let traced = KernelSamples::all(side, pitch_um, film_pitch_um);
        let steps = if has_all { vec![traced] } else { traced.steps() };
        Self { traced, steps }
    }

    /// Samples a side of the PSFs that are traced.
    pub(super) fn side(&self) -> usize {
        self.traced.size
    }

    /// Maximum numbers of PSFs, each with fewer samples of films than that before.
    pub(super) fn allowed(&self, options: &TraceOptions) -> Vec<usize> {
        let last = self.steps.len() - 1;
        let of = |(i, step): (usize, &KernelSamples)| {
            let most = if i == last { max_samples(options) } else { MAX_SAMPLES };
            (most / step.size.pow(2)).min(MAX_TRACED / self.side().pow(2))
        };
        self.steps.iter().enumerate().map(of).collect()
    }

    /// Samples a film pixel that a band of `heights` PSFs states: none if as many are allowed by default, else the most that allow them.
    pub(super) fn stated(&self, heights: usize, options: &TraceOptions) -> Option<f64> {
        let allowed = self.allowed(options);
        let step = allowed.iter().position(|most| heights <= *most).unwrap_or(allowed.len() - 1);
        (step > 0).then(|| self.steps[step].per_pixel())
    }

    /// The last of [`FilmSamples::allowed`], which is the largest.
    pub(super) fn most(&self, options: &TraceOptions) -> usize {
        self.allowed(options).into_iter().max().unwrap_or(0)
    }

    /// Of each number that is allowed, the L1 by which kernels from the samples of films differ from those of all samples, the largest of some heights up to `last_mm`.
    ///
    /// # Errors
    /// A ray that does not reach the image.
    pub(super) fn losses(&self, pupils: &mut Pupils<'_>, last_mm: f64) -> Result<Vec<f64>, DesignError> {
        let heights: Vec<f64> = (1..=MEASURED).map(|i| last_mm * i as f64 / MEASURED as f64).collect();
        pupils.prepare(heights.iter().copied())?;
        let grid = PsfGrid::new(self.side() / 2, self.traced.pitch_um);
        let window = self.traced.window();
        let pixels = |of: &KernelSamples| FilmPixels::new(of.size, of.pitch_um, window, of.film_pitch_um);
        let (of_all, of_steps) = (pixels(&self.traced), self.steps.iter().map(pixels).collect::<Vec<_>>());
        let pupils = &*pupils;
        let at = |height: &f64| -> Vec<f64> {
            let (mut scratch, mut psf) = (PsfScratch::default(), Vec::new());
            grid.psf_into(pupils.at(*height), 0.0, &mut scratch, &mut psf);
            let mut samples = vec![0.0; psf.len()];
            normalise(&psf, &mut samples);
            let stack = PsfStack {
                size: self.side(),
                pitch_um: self.traced.pitch_um,
                sample: PsfSample::Point,
                samples,
            };
            let all = of_all.kernel(&stack.samples);
            let of = |(step, pixels): (&KernelSamples, &FilmPixels)| {
                let Ok(reduced) = step.read(1, 1, |_| Ok::<_, Infallible>(stack.clone()));
                Difference::of(&pixels.kernel(&reduced.samples), &all).l1
            };
            self.steps.iter().zip(&of_steps).map(of).collect()
        };
        let found: Vec<Vec<f64>> = heights.par_iter().map(at).collect();
        let largest = |step: usize| found.iter().map(|losses| losses[step]).fold(0.0, f64::max);
        Ok((0..self.steps.len()).map(largest).collect())
    }
}

/// The steps from few PSFs to many, of which one is chosen.
pub(super) struct Steps<'s> {
    samples: &'s FilmSamples,
    last_mm: f64,
    /// PSFs of each.
    allowed: Vec<usize>,
    /// [`FilmSamples::losses`], once they are needed.
    losses: Option<Vec<f64>>,
    /// Index of that which is chosen.
    chosen: usize,
}

impl<'s> Steps<'s> {
    /// Those of `samples`, with at most `of_checks` PSFs.
    pub(super) fn new(
        samples: &'s FilmSamples,
        last_mm: f64,
        options: &TraceOptions,
        of_checks: usize,
    ) -> Self {
        let allowed = samples.allowed(options).into_iter().map(|n| n.min(of_checks).max(3)).collect();
        Self { samples, last_mm, allowed, losses: None, chosen: 0 }
    }

    /// The first one if it allows the tolerance of heights, or its excess; else that of the least error of nodes and samples together, of which `tolerance` is that of nodes.
    ///
    /// # Errors
    /// A ray that does not reach the image.
    pub(super) fn least_error(
        &mut self,
        placement: &Placement<'_>,
        tolerance: f64,
        pupils: &mut Pupils<'_>,
        report: &mut dyn FnMut(&'static str, usize),
    ) -> Result<Relaxed, DesignError> {
        let first = placement.within(self.allowed[0]);
        if first.by.radial <= placement.options.excess || self.allowed.len() == 1 {
            return Ok(first);
        }
        let all: Vec<Relaxed> = self.allowed.iter().map(|heights| placement.within(*heights)).collect();
        let losses = self.losses(pupils, report)?;
        let errors: Vec<f64> =
            all.iter().zip(losses).map(|(relaxed, loss)| tolerance * relaxed.by.mean() + loss).collect();
        self.chosen = (0..all.len()).min_by(|a, b| errors[*a].total_cmp(&errors[*b])).unwrap_or(0);
        Ok(all[self.chosen])
    }

    /// The PSFs of the next one, which is then chosen, if its samples lose less than `gain` more.
    ///
    /// # Errors
    /// A ray that does not reach the image.
    pub(super) fn further(
        &mut self,
        gain: f64,
        pupils: &mut Pupils<'_>,
        report: &mut dyn FnMut(&'static str, usize),
    ) -> Result<Option<usize>, DesignError> {
        let next = self.chosen + 1;
        if next >= self.allowed.len() || self.allowed[next] <= self.allowed[self.chosen] {
            return Ok(None);
        }
        let chosen = self.chosen;
        let losses = self.losses(pupils, report)?;
        if losses[next] - losses[chosen] >= gain {
            return Ok(None);
        }
        self.chosen = next;
        Ok(Some(self.allowed[next]))
    }

    fn losses(
        &mut self,
        pupils: &mut Pupils<'_>,
        report: &mut dyn FnMut(&'static str, usize),
    ) -> Result<&[f64], DesignError> {
        if self.losses.is_none() {
            self.losses = Some(self.samples.losses(pupils, self.last_mm)?);
            report("probing", MEASURED);
        }
        Ok(self.losses.as_deref().unwrap_or_default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::prescription::system::System;
    use crate::design::rays::ray::Tracer;
    use crate::design::tables::options::MAX_NODES;

    #[test]
    fn fewer_samples_of_films_allow_more_psfs() {
        let options = |max_nodes| TraceOptions { max_nodes, ..TraceOptions::new(vec![550.0], 10.0) };
        let allowed = |samples, has_all, max_nodes| {
            FilmSamples::new(samples, 2.0, has_all).allowed(&options(max_nodes))
        };
        // Six samples a pixel, of 377 pixels: 1507, 1131, 753 and 565 a side; those that are traced have 537 million together.
        let wide = (2261, 1.0 / 3.0);
        assert_eq!(allowed(wide, false, MAX_NODES), [19, 34, 77, 105]);
        assert_eq!(allowed((1133, 1.0 / 3.0), false, MAX_NODES), [77, 136, 309, 418], "189 pixels");
        let stated =
            |heights| FilmSamples::new((1133, 1.0 / 3.0), 2.0, false).stated(heights, &options(MAX_NODES));
        assert_eq!(
            [77, 78, 136, 137, 309, 310].map(stated),
            [None, Some(3.0), Some(3.0), Some(2.0), Some(2.0), Some(1.5)]
        );
        assert_eq!(allowed(wide, true, MAX_NODES), [8]);
        // 67 pixels.
        assert_eq!([1, 2].map(|n| allowed((401, 1.0 / 3.0), false, n * MAX_NODES)), [[273], [547]]);
    }

    #[test]
    fn kernels_of_fewer_samples_lose_more() {
        let system = System::double_gauss_28();
        let tracer = Tracer::new(&system, 0.4).unwrap();
        let mut pupils = Pupils::new(&tracer, &[0.0, 5.0, 10.0]).unwrap();
        let losses = FilmSamples::new((605, 1.0 / 3.0), 2.0, false).losses(&mut pupils, 10.0).unwrap();
        assert!(losses.len() == 4 && losses.is_sorted());
    }

    #[test]
    fn the_step_of_the_least_error_of_nodes_and_samples_is_chosen() {
        let options = TraceOptions::new(vec![400.0], 10.0);
        // 19, 34, 77 or 105 PSFs, of a lens that needs 200.
        let samples = FilmSamples::new((2261, 1.0 / 3.0), 2.0, false);
        let probes = vec![5.0, 10.0];
        let same = |value: f64| [vec![value; 2], vec![value; 2]];
        let (azimuths, spacing) = (same(40.0), Some(same(0.05)));
        let placement = Placement { options: &options, last_mm: 10.0, probes, azimuths, spacing };
        let system = System::double_gauss_28();
        let tracer = Tracer::new(&system, 0.4).unwrap();
        let mut pupils = Pupils::new(&tracer, &[0.0]).unwrap();
        // Chosen step, its PSFs, and what is next if the nodes of more PSFs gain so much.
        let mut steps = |losses: [f64; 4], gain: f64| {
            let losses = Some(losses.to_vec());
            let mut steps = Steps { losses, ..Steps::new(&samples, 10.0, &options, usize::MAX) };
            let found = steps.least_error(&placement, 0.008, &mut pupils, &mut |_, _| ()).unwrap();
            let chosen = steps.chosen;
            let next = steps.further(gain, &mut pupils, &mut |_, _| ()).unwrap();
            (chosen, found.budget.heights, next)
        };
        assert_eq!(steps([0.0; 4], 1.0), (3, 105, None));
        assert_eq!(steps([0.0, 0.01, 0.02, 0.9], 1.0), (2, 77, Some(105)));
        assert_eq!(steps([0.0, 0.01, 0.02, 0.9], 0.8), (2, 77, None), "samples would lose 0.88 more");
        assert_eq!(steps([0.0, 0.01, 0.9, 0.9], 0.8), (1, 34, None));
        assert_eq!(steps([0.0, 9.0, 9.0, 9.0], 9.5), (0, 19, Some(34)));
    }
}
