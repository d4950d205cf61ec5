//! The MTF of a field at one frequency, for any small shift of the film.
//!
//! ```text
//! OTF(f) = ∫∫ U*(a − e λf/2) U(a + e λf/2) d²a / ∫∫ |U|² d²a,    U = A e^(2πi W/λ),    a = (L, M), e the direction of the pattern
//! MTF = |Σ_λ w_λ OTF_λ| / Σ w_λ
//! ```
//! W about the place of the field for all wavelengths, so that lateral colour is in it. A shift dz of the film along its normal
//! changes W by dz (N + L sx + M sy) for a reference point that moves with the slopes s of the primary wavelength's chief ray, up to
//! a constant. Tangential: e along the azimuth of the place; sagittal: across it; in the film's centre along X and along Y. Source:
//! Goodman, Introduction to Fourier Optics, 6.3-6.4.

use std::f64::consts::TAU;

use super::fields::{Colours, Field, FilmBundle};
use super::pupil_fit::PupilFit;
use crate::design::skew::error::SkewError;
use crate::real;

/// Rings and spokes of rays of a pupil function, and rays on its rim.
pub(super) const PUPIL_RAYS: [usize; 3] = [9, 28, 48];
/// Rows of an integral; columns are as many, and more by the phase.
const ROWS: usize = 20;
const MAX_COLUMNS: usize = 96;

/// MTF of a field, sagittal and tangential, against the shift of the film.
pub(super) struct FocusMtf {
    /// The terms of each wavelength, sagittal and tangential.
    transfers: Vec<[Transfer; 2]>,
}

/// A transfer function: a sum over overlaps.
struct Transfer {
    /// Weight; phase, rad; its change by the film's shift, rad/mm.
    terms: Vec<[f64; 3]>,
}

/// Directions of the sagittal and of the tangential pattern at a place.
fn directions([x, y]: [f64; 2]) -> [[f64; 2]; 2] {
    let r = real::hypot(x, y);
    let [c, s] = if r > 0.0 { [x / r, y / r] } else { [1.0, 0.0] };
    [[-s, c], [c, s]]
}

impl FocusMtf {
    /// Traces `field`, for shifts of the film up to ± `reach_mm`.
    pub(super) fn trace(
        colours: &Colours<'_>,
        field: &Field,
        frequency_per_mm: f64,
        reach_mm: f64,
    ) -> Result<Self, SkewError> {
        let bundles = colours.tracers.iter().filter(|(_, weight)| *weight > 0.0).map(|(tracer, weight)| {
            Ok((tracer.wavelength_um, *weight, FilmBundle::trace(tracer, field, PUPIL_RAYS)?))
        });
        let chief = colours.primary().ray(field.t, 0.0, 0.0)?;
        let slopes = [chief.l.v / chief.n, chief.m.v / chief.n];
        let bundles = bundles.collect::<Result<Vec<_>, SkewError>>()?;
        Ok(Self::new(&bundles, field.place, slopes, frequency_per_mm, reach_mm))
    }

    /// Of bundles with their wavelengths, µm, and weights, at `place`.
    pub(super) fn new(
        bundles: &[(f64, f64, FilmBundle)],
        place: [f64; 2],
        slopes: [f64; 2],
        frequency_per_mm: f64,
        reach_mm: f64,
    ) -> Self {
        let transfer = |(um, weight, bundle): &(f64, f64, FilmBundle)| {
            let fit = PupilFit::new(bundle);
            directions(place).map(|direction| {
                Transfer::new(&fit, bundle, (*um, *weight), direction, slopes, frequency_per_mm, reach_mm)
            })
        };
        Self { transfers: bundles.iter().map(transfer).collect() }
    }

    /// MTF, sagittal and tangential, with the film shifted by `shift_mm`.
    pub(super) fn at(&self, shift_mm: f64) -> [f64; 2] {
        [0, 1].map(|direction| {
            let mut sum = [0.0; 2];
            for transfer in &self.transfers {
                for [weight, phase, by_shift] in &transfer[direction].terms {
                    let (s, c) = real::sin_cos(phase + shift_mm * by_shift);
                    sum = [sum[0] + weight * c, sum[1] + weight * s];
                }
            }
            real::hypot(sum[0], sum[1])
        })
    }

    /// The mean of sagittal and tangential.
    pub(super) fn mean(&self, shift_mm: f64) -> f64 {
        let [sagittal, tangential] = self.at(shift_mm);
        0.5 * (sagittal + tangential)
    }
}

impl Transfer {
    fn new(
        fit: &PupilFit,
        bundle: &FilmBundle,
        (um, weight): (f64, f64),
        direction: [f64; 2],
        slopes: [f64; 2],
        frequency_per_mm: f64,
        reach_mm: f64,
    ) -> Self {
        let along = |v: [f64; 2]| v[0] * direction[0] + v[1] * direction[1];
        // The phase of a term is that of the pattern over the spot.
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for shift in [-reach_mm, reach_mm] {
            for at in bundle.rays.iter().map(|r| along(r.at_mm) + shift * along(r.slopes())) {
                (low, high) = (low.min(at), high.max(at));
            }
        }
        let periods = (high - low) * frequency_per_mm;
        let nodes = [ROWS, ROWS].map(|n| (n + (3.0 * periods) as usize).min(MAX_COLUMNS).next_multiple_of(4));
        let square = |cosines: [f64; 2]| fit.at(cosines)[1].powi(2);
        let norm: f64 = fit.overlap(direction, 0.0, [ROWS; 2]).iter().map(|(a, w)| w * square(*a)).sum();
        let index_squared = bundle
            .rays
            .first()
            .map_or(1.0, |r| r.cosines[0] * r.cosines[0] + r.cosines[1] * r.cosines[1] + r.n * r.n);
        let defocus = |[l, m]: [f64; 2]| {
            (index_squared - l * l - m * m).max(0.0).sqrt() + l * slopes[0] + m * slopes[1]
        };
        let wavelength_mm = um * 1e-3;
        let shift = wavelength_mm * frequency_per_mm;
        let terms = fit.overlap(direction, shift, nodes).into_iter().map(|(a, w)| {
            let moved = |by: f64| [a[0] + by * direction[0], a[1] + by * direction[1]];
            let ends = [moved(-shift / 2.0), moved(shift / 2.0)];
            let [before, behind] = ends.map(|end| fit.at(end));
            let per_mm = TAU / wavelength_mm;
            [
                weight * w * before[1] * behind[1] / norm,
                per_mm * (behind[0] - before[0]),
                per_mm * (defocus(ends[1]) - defocus(ends[0])),
            ]
        });
        Self { terms: terms.collect() }
    }
}
