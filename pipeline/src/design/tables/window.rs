//! Choice of the PSF window of a band: the minimum odd number of film pixels that contains the requested share of the light of every
//! sampled field point.
//!
//! Limits: the maximum window; and the samples that the budget of the band allows ([`super::refine`]), as long as the share of the light
//! does not fall below 95 % (or the request) by that. A window of the maximum size that contains less is an error.
//! With tails ([`crate::lens::tail`]) windows are larger where the rays at the edge of the pupil come near their border, and on large pixels ([`for_tails`]).
//! Nodes are chosen by the errors of kernels in a smaller window, the *core*, of 95 % of the light: it needs a fifth of the samples where diffraction
//! determines the windows, and the light that it leaves out has errors of the same relative size.
//! The shares are sums of PSFs sampled twice as coarsely as those of the pack, still finer than the field's own Nyquist pitch, so the
//! sums equal the integrals of |U|² but for the samples at the edges of the squares, between which they are interpolated.

use rayon::prelude::*;

use super::options::TraceOptions;
use super::refine::max_side;
use crate::design::prescription::error::DesignError;
use crate::design::psf::squares::{squares, within};
use crate::design::psf::tails::CLEAR;
use crate::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use crate::design::pupil::bundle::Bundle;
use crate::design::pupil::pupils::Pupils;
use crate::design::rays::ray::Tracer;

/// Share of the light that a limited window may leave out without `energy` being set lower.
const MAX_LEFT_OUT: f64 = 0.05;
/// Pitch of the samples here over that of the pack's.
const COARSER: f64 = 1.5;
/// The same where light alone is summed, and of kernels that are compared in wide windows.
const COARSEST: f64 = 2.0;
/// Share of the light in the window in which errors of kernels are measured.
const CORE_LIGHT: f64 = 0.95;
/// Share of the light in the inner part of that window, in which they are compared where that window is wide ([`super::kernels`]).
const INNER_LIGHT: f64 = 0.7;

/// Samples to either side and pitch [µm] of PSFs whose kernels of `core_px` pixels are compared, not kept: coarser than `pitch_um` where a film
/// pixel has at least two samples a side.
pub(in crate::design) fn core_samples(core_px: usize, film_pitch_um: f64, pitch_um: f64) -> (usize, f64) {
    samples(core_px, film_pitch_um, coarse_um(film_pitch_um, pitch_um))
}

/// The same in a wide window: the blur has hardly any light at the frequencies that then look like those that film pixels pass.
pub(super) fn wide_core_samples(core_px: usize, film_pitch_um: f64, pitch_um: f64) -> (usize, f64) {
    samples(core_px, film_pitch_um, coarser_um(film_pitch_um, pitch_um, COARSEST))
}

/// Pitch of [`core_samples`], µm.
pub(super) fn coarse_um(film_pitch_um: f64, pitch_um: f64) -> f64 {
    coarser_um(film_pitch_um, pitch_um, COARSER)
}

fn samples(core_px: usize, film_pitch_um: f64, coarse_um: f64) -> (usize, f64) {
    (half_samples(core_px, film_pitch_um, coarse_um), coarse_um)
}

fn coarser_um(film_pitch_um: f64, pitch_um: f64, coarser: f64) -> f64 {
    (coarser * pitch_um).min(0.5 * film_pitch_um).max(pitch_um)
}

/// Side of the window that is examined first, at least, and by how much it exceeds the estimate from rays, µm; on pixels below [`FINE_UM`] as many pixels
/// as on those.
const FIRST_UM: f64 = 130.0;
const SPARE_UM: f64 = 16.0;
/// Pixels up to which the window that is examined first is in pixels, µm.
const FINE_UM: f64 = 2.0;

/// Least windows of bands with tails, film pixels: bins have 4 px on films of pixels up to a step of pitch larger; on large pixels, of which films
/// have few, 2 px; where that takes few more pixels, 8 px.
pub const LEAST_TAIL_WINDOW_PX: usize = 27;
const LEAST_COARSE_PX: usize = 15;
const LEAST_LARGE_PX: usize = 41;
/// Windows below which pixels are large.
const COARSE_PX: usize = 11;
/// Windows from which on bins have 8 px: tails then take less time by more than the PSFs take more.
const LARGE_PX: usize = 31;

/// Windows of a band, odd numbers of film pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::design) struct Windows {
    /// That of its PSFs.
    pub(in crate::design) px: usize,
    /// That in which errors of kernels are measured.
    pub(in crate::design) core_px: usize,
}

/// The windows that [`search`] finds, and the light in others.
#[derive(Clone, Debug)]
pub(in crate::design) struct Found {
    pub(in crate::design) windows: Windows,
    /// That of [`INNER_LIGHT`].
    pub(super) inner_px: usize,
    pub(super) light: SquareLight,
}

/// Shares of the light in squares about the chief ray, for each height.
#[derive(Clone, Debug)]
pub(super) struct SquareLight {
    pitch_um: f64,
    /// In squares of 1, 3, 5… samples.
    squares: Vec<Vec<f64>>,
}

impl SquareLight {
    /// The shares in squares of `side_um`; none if that is more than was examined.
    pub(super) fn within_um(&self, side_um: f64) -> Option<Vec<f64>> {
        let side = side_um / self.pitch_um;
        let one =
            |squares: &Vec<f64>| (side <= (2 * squares.len() - 1) as f64).then(|| within(squares, side));
        self.squares.iter().map(one).collect()
    }
}

/// The windows of a band.
pub(super) fn window(
    options: &TraceOptions,
    tracer: &Tracer<'_>,
    (heights, pupils): (&[f64], &Pupils<'_>),
    pitch_um: f64,
) -> Result<Found, DesignError> {
    let (film, max) = (options.film_pitch_um, options.max_window_px);
    let allowed = options.energy.min(1.0 - MAX_LEFT_OUT);
    let bundles: Vec<(f64, Bundle)> = heights
        .par_iter()
        .step_by(3)
        .map(|h| Ok((*h, Bundle::trace(tracer, tracer.field_of_height(*h)?, 12, 16)?)))
        .collect::<Result<_, DesignError>>()?;
    let widest = |b: &Bundle| b.light_outside(0.5 * film * max as f64);
    let worst = bundles.iter().max_by(|a, b| widest(&a.1).total_cmp(&widest(&b.1)));
    // Clearly too wide by the estimate: no PSF is computed.
    if let Some((height, bundle)) = worst
        && 1.0 - widest(bundle) < allowed - 0.05
    {
        return Err(too_wide(options, tracer.wavelength_um, *height, 1.0 - widest(bundle)));
    }
    let expected = expected(options, bundles.iter().map(|(_, b)| b), pitch_um).px;
    let spare = |um: f64, least: f64| (um / film).clamp(least, um / FINE_UM) as usize;
    let first = spare(FIRST_UM, 9.0);
    let px = (expected + expected / 4 + spare(SPARE_UM, 2.0)).clamp(first, max.max(first));
    let functions: Vec<(f64, &PupilFunction)> = heights.iter().map(|h| (*h, pupils.at(*h))).collect();
    search(options, &functions, pitch_um, px)
}

/// The error of a window that does not hold enough light at any size.
fn too_wide(options: &TraceOptions, wavelength_um: f64, height_mm: f64, held: f64) -> DesignError {
    let requested = options.energy.min(1.0 - MAX_LEFT_OUT);
    DesignError::Window { max_px: options.max_window_px, height_mm, wavelength_um, held, requested }
}

/// The windows of the PSFs of `functions` at their heights (mm); windows of `first` film pixels are examined first.
pub(in crate::design) fn search(
    options: &TraceOptions,
    functions: &[(f64, &PupilFunction)],
    pitch_um: f64,
    first: usize,
) -> Result<Found, DesignError> {
    let (film, max) = (options.film_pitch_um, options.max_window_px);
    let allowed = options.energy.min(1.0 - MAX_LEFT_OUT);
    let budget = odd_pixels(max_side(options), pitch_um, film).min(max);
    let mut px = first.min(max) | 1;
    loop {
        let coarse_um = COARSEST * pitch_um;
        let grid = PsfGrid::for_comparison(half_samples(px, film, coarse_um) + 1, coarse_um, 1.0);
        let squares = functions
            .par_iter()
            .map_init(<(PsfScratch, Vec<f32>)>::default, |(scratch, psf), (_, function)| {
                grid.psf_into(function, 0.0, scratch, psf);
                squares(psf, grid.size())
            })
            .collect();
        let light = SquareLight { pitch_um: coarse_um, squares };
        let shares: Vec<Vec<f64>> = light
            .squares
            .iter()
            .map(|held| (0..=px / 2).map(|i| within(held, (2 * i + 1) as f64 * film / coarse_um)).collect())
            .collect();
        let least = |energy: f64| {
            let one = |held: &Vec<f64>| (1..=px / 2).find(|i| held[*i] >= energy).map(|i| 2 * i + 1);
            shares.iter().try_fold(3, |widest, held| one(held).map(|w| widest.max(w)))
        };
        let core_px = least(options.energy.min(CORE_LIGHT)).map_or(px, |w| w + 2);
        let inner_px = least(options.energy.min(INNER_LIGHT)).map_or(px, |w| w + 2);
        let windows = |px: usize| Windows { px, core_px: core_px.min(px) };
        let found = match (least(options.energy), least(allowed)) {
            (Some(w), _) if w <= budget => Some(w),
            (_, Some(w)) if w.max(budget) < px => Some(w.max(budget)),
            (requested, _) => requested,
        };
        let (height, held) = functions
            .iter()
            .zip(&shares)
            .map(|((h, _), held)| (*h, held[px / 2]))
            .fold((0.0, 1.0), |a, b| if b.1 < a.1 { b } else { a });
        match found {
            // Margin for field points between the sampled ones.
            Some(w) => return Ok(Found { windows: windows((w + 2).min(max)), inner_px, light }),
            None if px >= max && held < allowed => {
                let wavelength_um = functions.first().map_or(0.0, |(_, f)| f.wavelength_um);
                return Err(too_wide(options, wavelength_um, height, held));
            }
            None if px >= max => return Ok(Found { windows: windows(max), inner_px, light }),
            None => px = (2 * px - 1).min(max),
        }
    }
}

/// The windows as estimated from rays.
pub(super) fn expected<'b>(
    options: &TraceOptions,
    bundles: impl Iterator<Item = &'b Bundle> + Clone,
    pitch_um: f64,
) -> Windows {
    let (film, max) = (options.film_pitch_um, options.max_window_px);
    let guess = |energy: f64| {
        bundles.clone().map(|b| b.window_px(energy, film, max).unwrap_or(max)).max().unwrap_or(max)
    };
    let budget = odd_pixels(max_side(options), pitch_um, film).min(max);
    let px = guess(options.energy).min(guess(options.energy.min(1.0 - MAX_LEFT_OUT)).max(budget));
    Windows { px, core_px: guess(options.energy.min(CORE_LIGHT)).min(px) }
}

/// The window of a band with tails for one of `px` film pixels that holds the light requested: at least so large that the rays at the edge of the pupil, which
/// land up to `blur_um` from the chief ray, are clear of its border, and that the coarse grid of its tails fits; `px` where that is beyond the
/// limits.
pub(super) fn for_tails(options: &TraceOptions, px: usize, blur_um: f64, pitch_um: f64) -> usize {
    let film = options.film_pitch_um;
    // Half a window of `CLEAR` blurs is a whole number of samples.
    let clear = 2 * ((CLEAR * blur_um + pitch_um) / film).ceil() as usize + 1;
    let least = match px.max(clear) {
        LARGE_PX.. => LEAST_LARGE_PX,
        _ if px < COARSE_PX => LEAST_COARSE_PX,
        _ => LEAST_TAIL_WINDOW_PX,
    };
    let wanted = px.max(clear).max(least);
    // Four times the samples at most: on pixels of 50 µm, with windows of 3 px, tracing would take seven times as long.
    let limit = odd_pixels(max_side(options), pitch_um, film).min(options.max_window_px).min(2 * px);
    if wanted <= limit { wanted } else { px }
}

/// Samples to either side of the centre in a window of `px` film pixels.
pub(in crate::design) fn half_samples(px: usize, film_pitch_um: f64, pitch_um: f64) -> usize {
    ((px as f64 * film_pitch_um / pitch_um - 1.0 + 1e-9) / 2.0).floor() as usize
}

/// Maximum odd number of film pixels, at least 3, that `side` samples cover.
fn odd_pixels(side: usize, pitch_um: f64, film_pitch_um: f64) -> usize {
    (((side as f64 * pitch_um / film_pitch_um) as usize).max(4) - 1) | 1
}
