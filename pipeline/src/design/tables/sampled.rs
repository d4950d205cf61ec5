//! What the PSFs of a wavelength are computed with: pupil functions of thirteen heights, sample pitch and windows.
//!
//! Sample pitch: film pitch / m with the minimum m that is 10 % finer than the Nyquist pitch λN/2 of the fastest, max oblique cone of the heights; of the PSFs that
//! films use finer ([`pitch_for_splines`]).
//! Window: the minimum odd number of film pixels that contains the share `energy` of the energy of every sampled field point (`window`), with tails
//! the larger one that rays at the edge of the pupil need.

use rayon::prelude::*;

use super::film_samples::FilmSamples;
use super::kernels::Core;
use super::trace::{LensTrace, PsfHeights, TraceOptions};
use super::window::{Found, Windows, core_samples, expected, for_tails, half_samples, window};
use crate::design::prescription::error::DesignError;
use crate::design::psf::PsfGrid;
use crate::design::psf::tails::blur_um;
use crate::design::pupil::bundle::Bundle;
use crate::design::pupil::edge::Edge;
use crate::design::pupil::pupils::Pupils;
use crate::design::rays::ray::Tracer;

/// What PSFs of a wavelength are computed with.
pub(in crate::design) struct Sampled<'t> {
    pub(super) pupils: Pupils<'t>,
    pub(super) last_mm: f64,
    /// The heights that `pupils` were made with, mm.
    pub(super) first: Vec<f64>,
    /// The edges of the pupils there, for tails.
    pub(super) edges: Option<Vec<Edge>>,
    /// Window and samples of the PSFs, and those for the choice of nodes.
    pub(in crate::design) window_px: usize,
    pub(in crate::design) grid: PsfGrid,
    /// Samples that the budget of nodes is for.
    pub(super) film_samples: FilmSamples,
    /// Windows in which kernels are compared.
    pub(in crate::design) core: Core,
    pub(super) inner: Option<Core>,
    /// What determined the windows, where the light at the first heights did.
    pub(super) found: Option<Found>,
}

impl Sampled<'_> {
    /// Its windows.
    pub(super) fn windows(&self) -> Windows {
        Windows { px: self.window_px, core_px: self.core.px }
    }
}

/// How the PSFs of a depth node are sampled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Sampling {
    /// Windows that are known; none if they are determined by the light of PSFs.
    pub(super) windows: Option<Windows>,
    /// Whether the samples are those of kernels that are compared ([`core_samples`]): a wide blur has hardly any light at frequencies that they alias.
    pub(super) is_coarse: bool,
}

impl LensTrace<'_> {
    /// The windows of band `index` as estimated from rays.
    ///
    /// # Errors
    /// A ray that does not reach the image.
    pub(super) fn expected_windows(&self, index: usize) -> Result<Windows, DesignError> {
        let tracer = Tracer::new(self.system, self.options.wavelengths_nm[index] / 1e3)?;
        let last_mm = self.options.max_height_mm;
        let bundles: Vec<Bundle> = [0.0, 0.5, 1.0]
            .into_par_iter()
            .map(|share| Bundle::trace(&tracer, tracer.field_of_height(share * last_mm)?, 12, 16))
            .collect::<Result<_, DesignError>>()?;
        let pitch_um = self.pitch(smallest(bundles.iter().map(Bundle::nyquist_um)))?;
        Ok(expected(self.options, bundles.iter(), pitch_um))
    }

    /// Pupil functions, samples and windows of a wavelength; `known` is what has determined them before, if it has.
    pub(in crate::design) fn sampled<'t>(
        &self,
        tracer: &'t Tracer<'t>,
        known: Option<Found>,
        report: &mut dyn FnMut(&'static str, usize),
    ) -> Result<Sampled<'t>, DesignError> {
        let options = self.options;
        let last_mm = match &options.heights {
            PsfHeights::ByError => options.max_height_mm,
            PsfHeights::Given(h) => h.last().copied().unwrap_or(0.0),
        };
        report("pupil functions", 0);
        // Those of the kernels that are examined first.
        let heights: Vec<f64> = (0..=12).map(|i| last_mm * f64::from(i) / 12.0).collect();
        let pupils = Pupils::new(tracer, &heights)?;
        let nyquist_um = smallest(heights.iter().map(|h| pupils.at(*h).nyquist_um()));
        let pitch_um = self.pitch(nyquist_um)?;
        report("window", 0);
        let given = options.window_px.map(|px| Windows { px, core_px: px }).or(self.sampling.windows);
        let (Windows { px: plain_px, core_px }, found) = match given {
            Some(windows) => (windows, None),
            None => {
                let found = match known {
                    Some(found) => found,
                    None => {
                        let found = window(options, tracer, (&heights, &pupils), pitch_um)?;
                        report("window", heights.len());
                        found
                    }
                };
                (found.windows, Some(found))
            }
        };
        let spline_pitch_um = self.spline_pitch((pitch_um, nyquist_um), plain_px);
        let edges: Option<Vec<Edge>> = (self.tails && self.band.is_none())
            .then(|| heights.par_iter().map(|h| pupils.at(*h).edge(tracer.surfaces())).collect());
        let window_px = match &edges {
            Some(edges) if options.window_px.is_none() => {
                for_tails(options, plain_px, blur_um(edges), spline_pitch_um)
            }
            _ => plain_px,
        };
        let (half, psf_pitch_um) = match self.sampling.is_coarse {
            false => (half_samples(window_px, options.film_pitch_um, spline_pitch_um), spline_pitch_um),
            true => core_samples(window_px, options.film_pitch_um, pitch_um),
        };
        let grid = PsfGrid::new(half, psf_pitch_um);
        let core = Core::new(core_px, options.film_pitch_um, pitch_um);
        // Depth nodes, lenses as built and means over a band compare fewer kernels.
        let inner_px = found.as_ref().filter(|_| !self.has_base_nodes).map(|found| found.inner_px);
        let inner = inner_px.and_then(|px| core.inner(px, options.film_pitch_um, pitch_um));
        let side = match self.sampling.is_coarse {
            false => 2 * half_samples(plain_px, options.film_pitch_um, spline_pitch_um) + 1,
            true => grid.size(),
        };
        let film_samples = self.film_samples(side, spline_pitch_um);
        Ok(Sampled {
            pupils,
            last_mm,
            first: heights,
            edges,
            window_px,
            grid,
            film_samples,
            core,
            inner,
            found,
        })
    }

    /// Samples of films, of PSFs with `side` samples of `pitch_um` a side.
    pub(super) fn film_samples(&self, side: usize, pitch_um: f64) -> FilmSamples {
        FilmSamples::new((side, pitch_um), self.options.film_pitch_um, self.has_base_nodes)
    }

    /// Pitch that resolves `nyquist_um`, of PSFs whose light and kernels are compared; or that given.
    fn pitch(&self, nyquist_um: f64) -> Result<f64, DesignError> {
        match self.options.psf_pitch_um {
            Some(pitch) if pitch > nyquist_um => Err(DesignError::Option {
                option: "psf pitch",
                value: format!("{pitch} µm"),
                expected: "one finer than Nyquist, λN/2 of the widest cone",
            }),
            Some(pitch) => Ok(pitch),
            None => Ok(pitch_below(self.options, nyquist_um)),
        }
    }

    /// Pitch of the PSFs of films in a window of `px` film pixels, at most `pitch_um`, which resolves `nyquist_um`.
    pub(super) fn spline_pitch(&self, (pitch_um, nyquist_um): (f64, f64), px: usize) -> f64 {
        match self.options.psf_pitch_um.is_some() || self.has_base_nodes {
            true => pitch_um,
            false => pitch_um.min(pitch_for_splines(self.options.film_pitch_um, nyquist_um, px)),
        }
    }
}

/// Smallest of the pitches of `nyquist_um`, µm.
fn smallest(nyquist_um: impl Iterator<Item = f64>) -> f64 {
    nyquist_um.fold(f64::INFINITY, f64::min)
}

/// The largest part of the film pitch, µm, that is 10 % finer than `nyquist_um`.
pub(in crate::design) fn pitch_below(options: &TraceOptions, nyquist_um: f64) -> f64 {
    options.film_pitch_um / (options.film_pitch_um / (0.9 * nyquist_um)).ceil()
}

/// Windows from which on PSFs have many samples, film pixels.
const WIDE_PX: usize = 65;
/// Largest pitch over Nyquist for splines, in windows below [`WIDE_PX`] and in wide ones.
const BELOW_NYQUIST: (f64, f64) = (0.6, 0.65);
/// Most samples a film pixel that splines need, along one direction, in such windows: pixels of more hardly pass what lies near Nyquist.
const MOST: (f64, f64) = (8.0, 3.0);

/// Pitch of samples whose splines, which films rotate, are exact, µm, in a window of `px` film pixels: the film's over a whole number, or over a multiple of one half
/// in wide windows.
///
/// Splines lose what lies near Nyquist. Of 0.7 to 0.9 of it, kernels of PSFs in focus had errors of 0.2 to 1.2 % (L1) and 0.1 % of white at edges, besides those of nodes
/// (`scripts/bench/2026-11-30-edges`). Samples of wide windows take most of the time and the memory of a film.
fn pitch_for_splines(film_pitch_um: f64, nyquist_um: f64, px: usize) -> f64 {
    let needed = |part: f64| film_pitch_um / (part * nyquist_um);
    let count = match px < WIDE_PX {
        true => needed(BELOW_NYQUIST.0).ceil().min(MOST.0),
        false => (0.5 * (2.0 * needed(BELOW_NYQUIST.1)).ceil()).min(MOST.1),
    };
    film_pitch_um / count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_finer_than_nyquist_needs() {
        // f/1.4, f/2.8 and f/4.5 at 550 nm, a mirror lens of f/8 at 700 nm, f/32; samples a pixel at 0.9 of Nyquist, in a narrow and in a wide window.
        let cases = [
            (0.385, [6.0, 8.0, 3.0]),
            (0.77, [3.0, 5.0, 3.0]),
            (1.24, [2.0, 3.0, 2.5]),
            (2.8, [1.0, 2.0, 1.5]),
            (8.8, [1.0, 1.0, 0.5]),
        ];
        let options = TraceOptions::new(vec![550.0], 10.0);
        for (nyquist_um, expected) in cases {
            let pitches = [
                pitch_below(&options, nyquist_um),
                pitch_for_splines(2.0, nyquist_um, 63),
                pitch_for_splines(2.0, nyquist_um, 65),
            ];
            let found = pitches.map(|pitch| options.film_pitch_um / pitch);
            assert!(
                found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12),
                "{nyquist_um}: {found:?}"
            );
        }
    }
}
