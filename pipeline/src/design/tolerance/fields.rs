//! The field places of a criterion, and the rays of a place to the film.
//!
//! A place is REAL, mm on the film, as built: its field is that whose chief ray lands there at the primary wavelength. Rays of the
//! other wavelengths come from the same field, so that lateral colour widens spots and lowers the MTF, as on a film that records
//! all wavelengths at once. Behind the last surface rays are straight: where they cross a film that is moved needs no tracing.

use std::f64::consts::TAU;

use rayon::prelude::*;

use super::settings::CriterionFields;
use crate::design::skew::error::SkewError;
use crate::design::skew::opening::Opening;
use crate::design::skew::system::BuiltLens;
use crate::design::skew::trace::SkewTracer;
use crate::real;

/// Directions of the places of [`CriterionFields::Film`] on a circle, and the radii of the circles.
const AZIMUTHS: usize = 8;
const ZONES: [f64; 2] = [0.7, 1.0];

impl CriterionFields {
    /// The places, mm, for a film whose corner is `corner_mm` from its centre.
    pub fn places(&self, corner_mm: f64) -> Vec<[f64; 2]> {
        let Self::Places(places) = self else {
            let on = |zone: f64| {
                (0..AZIMUTHS).map(move |k| {
                    let (s, c) = real::sin_cos(TAU * k as f64 / AZIMUTHS as f64);
                    // Cosines of quarter turns are not exactly 0.
                    [c, s].map(|v| if v.abs() < 1e-15 { 0.0 } else { zone * corner_mm * v })
                })
            };
            return std::iter::once([0.0; 2]).chain(ZONES.into_iter().flat_map(on)).collect();
        };
        places.clone()
    }
}

/// A built lens at the wavelengths of its design.
pub(super) struct Colours<'a> {
    /// With the weight of each, which is not negative; their sum is 1.
    pub(super) tracers: Vec<(SkewTracer<'a>, f64)>,
    primary: usize,
}

impl<'a> Colours<'a> {
    pub(super) fn new(lens: &'a BuiltLens) -> Result<Self, SkewError> {
        let system = lens.nominal();
        let used: Vec<usize> = (0..system.wavelengths_um.len())
            .filter(|i| system.wavelengths_um[*i].1 > 0.0 || *i == system.primary)
            .collect();
        let total: f64 = used.iter().map(|i| system.wavelengths_um[*i].1.max(0.0)).sum();
        // Without any weight the primary wavelength counts alone.
        let weight = |i: usize| match total > 0.0 {
            true => system.wavelengths_um[i].1.max(0.0) / total,
            false => f64::from(i == system.primary),
        };
        let tracer = |i: &usize| Ok((SkewTracer::new(lens, system.wavelengths_um[*i].0)?, weight(*i)));
        Ok(Self {
            tracers: used.iter().map(tracer).collect::<Result<_, SkewError>>()?,
            primary: used.iter().position(|i| *i == system.primary).unwrap_or(0),
        })
    }

    pub(super) fn primary(&self) -> &SkewTracer<'a> {
        &self.tracers[self.primary].0
    }

    pub(super) fn is_primary(&self, index: usize) -> bool {
        index == self.primary
    }

    /// The fields of these places.
    pub(super) fn fields(&self, places: &[[f64; 2]]) -> Result<Vec<Field>, SkewError> {
        let tracer = self.primary();
        in_parallel(places, |place| {
            let t = tracer.field_of(*place)?;
            Ok(Field { place: *place, t, opening: Opening::new(tracer, t)? })
        })
    }

    /// The fields of the same places after the film has moved a little: their openings keep their corners.
    pub(super) fn followed(&self, fields: &[Field]) -> Result<Vec<Field>, SkewError> {
        in_parallel(fields, |f| {
            let (t, _) = self.primary().field_near(f.place, f.t)?;
            Ok(Field { place: f.place, t, opening: f.opening.clone() })
        })
    }
}

/// `each` of all of `list`, in its order; the first error in that order, whatever ended first.
pub(super) fn in_parallel<A: Sync, B: Send>(
    list: &[A],
    each: impl Fn(&A) -> Result<B, SkewError> + Sync + Send,
) -> Result<Vec<B>, SkewError> {
    list.par_iter().map(each).collect::<Vec<_>>().into_iter().collect()
}

/// A field of the criterion.
pub(super) struct Field {
    /// Its place on the film, mm.
    pub(super) place: [f64; 2],
    /// Its slopes, primary wavelength.
    pub(super) t: [f64; 2],
    /// Its pupil at the primary wavelength. At other wavelengths, and after small moves of the film, its corners are taken as they
    /// are and its rims followed: the error of an integral is of second order in the moves of corners.
    pub(super) opening: Opening,
}

/// A ray of a field at the film.
#[derive(Clone, Copy, Debug)]
pub(super) struct FilmRay {
    /// Share of the flux; the shares of a bundle add up to 1. 0 of a ray on the rim.
    pub(super) weight: f64,
    /// From the place of the field, mm, film frame.
    pub(super) at_mm: [f64; 2],
    /// Optical direction cosines along X, Y.
    pub(super) cosines: [f64; 2],
    /// That along the film's normal.
    pub(super) n: f64,
    /// W about the place, mm, 0 of the wavelength's own chief ray.
    pub(super) wavefront_mm: f64,
    /// Amplitude of the pupil function in direction cosines, √(Φ/(J N)).
    pub(super) amplitude: f64,
}

impl FilmRay {
    /// Change of the place per shift of the film along its normal.
    pub(super) fn slopes(&self) -> [f64; 2] {
        self.cosines.map(|c| c / self.n)
    }
}

/// Rays of one field and wavelength.
pub(super) struct FilmBundle {
    pub(super) rays: Vec<FilmRay>,
    /// Rims of the open pupil and of what obscurations hide.
    pub(super) rims: Vec<Rim>,
}

/// Rays on each smooth part of a rim, with both its ends, in order around it.
pub(super) type Rim = Vec<Vec<FilmRay>>;

impl FilmBundle {
    /// The rays of `field` about its place: `rings` and `spokes` of the open pupil, and about `on_rim`
    /// on its rim.
    pub(super) fn trace(
        tracer: &SkewTracer<'_>,
        field: &Field,
        [rings, spokes, on_rim]: [usize; 3],
    ) -> Result<Self, SkewError> {
        let Field { place, t, opening } = field;
        let t = *t;
        let chief = tracer.ray(t, 0.0, 0.0)?;
        let about = |x: f64, y: f64| [x - place[0], y - place[1]];
        let wavefront = |path: f64, [l, m]: [f64; 2], at: [f64; 2]| path - l * at[0] - m * at[1];
        let own = wavefront(chief.path.v, [chief.l.v, chief.m.v], about(chief.x.v, chief.y.v));
        let ray = |p: f64, q: f64, weight: f64| {
            let r = tracer.ray(t, p, q)?;
            let (at_mm, cosines) = (about(r.x.v, r.y.v), [r.l.v, r.m.v]);
            Ok(FilmRay {
                weight: weight * r.flux,
                at_mm,
                cosines,
                n: r.n,
                wavefront_mm: wavefront(r.path.v, cosines, at_mm) - own,
                amplitude: (r.flux / (r.solid_angle() * r.n.abs())).sqrt(),
            })
        };
        let nodes = opening.nodes(tracer, t, rings, spokes);
        let mut rays =
            nodes.iter().map(|n| ray(n.p, n.q, n.weight)).collect::<Result<Vec<_>, SkewError>>()?;
        let flux: f64 = rays.iter().map(|r| r.weight).sum();
        for ray in &mut rays {
            ray.weight /= flux;
        }
        let mut rims: Vec<(f64, Rim)> = Vec::new();
        for segment in opening.segments.iter().filter(|_| on_rim > 0) {
            let span = segment.to - segment.from;
            let n = ((on_rim as f64 * span / TAU).ceil() as usize).max(3);
            let angles: Vec<f64> = (0..=n).map(|i| segment.from + span * i as f64 / n as f64).collect();
            let on_rim = angles.iter().zip(segment.radii(tracer, t, &angles)).map(|(theta, b)| {
                let (s, c) = real::sin_cos(*theta);
                ray(segment.centre[0] + b * c, segment.centre[1] + b * s, 0.0)
            });
            let on_rim = on_rim.collect::<Result<Vec<_>, SkewError>>()?;
            match rims.last_mut().filter(|(sign, _)| *sign == segment.sign) {
                Some((_, rim)) => rim.push(on_rim),
                None => rims.push((segment.sign, vec![on_rim])),
            }
        }
        Ok(Self { rays, rims: rims.into_iter().map(|(_, rim)| rim).collect() })
    }
}
