//! The rays of a field point over the whole pupil, vignetted or not, and the pupil function within its rims.
//!
//! Phase, direction cosines, amplitude and flux ([`super::function`]), and r²/a² − 1 at each aperture and obscuration, are smooth functions of
//! the pupil coordinates and of the field height, also where light is clipped. They are tabulated over the unit disc at Chebyshev points of
//! (ρ, θ). The zeros of r²/a² − 1 are the rims: between heights a rim moves as a shape. The pupil function of the open part is
//! evaluated from the tables as it otherwise is from rays.

use std::f64::consts::PI;

use super::chebyshev::{Lagrange, chebyshev, lagrange};
use super::function::{MAX_REACH_UM, Patch, PupilFunction, RHO, Rims, Sampler, THETA, with_ray_values};
use super::openings::{Openings, Overshoot, Pupil, Segment};
use crate::design::prescription::error::DesignError;
use crate::design::rays::aim::LastAim;
use crate::design::rays::ray::Tracer;
use crate::real;
use crate::simd::lanes::{Lanes, SimdOp};
use crate::simd::{Simd, UnfusedOp};

/// Largest error of r²/a² − 1 between the points: rims are then within a part of 1e5.
const PLACE_TOLERANCE: f64 = 1e-5;
/// Weight of errors in amplitude and rims over those in phase.
const WEIGHT: f64 = 10.0;
/// Places in ρ, and in θ/π, at which discs of two heights are compared.
const SAMPLED: [f64; 7] = [0.02, 0.23, 0.41, 0.62, 0.79, 0.93, 0.995];
/// Overshoot from which on rays are not compared: they are blocked.
const OUTSIDE: f64 = 0.05;
/// Margin of r²/a² − 1 between the points of the grid, for apertures that clip nothing.
const MARGIN: f64 = 0.01;

const NOT_SMOOTH: &str = "has neighbours of other directions";

/// Rays over the upper half of the unit disc.
#[derive(Clone, Debug)]
pub(super) struct Disc {
    wavelength_um: f64,
    height_mm: f64,
    /// Of the unit circle.
    patch: Patch,
    /// r²/a² − 1 at each of the tracer's limits.
    places: Vec<Vec<f64>>,
    /// Surfaces of the apertures, and of the obscurations.
    limits: [Vec<usize>; 2],
    /// Number of surfaces.
    surfaces: usize,
}

impl Disc {
    /// Traces the field point at tan(field angle) `tan` on a grid of at least `points`, if given.
    ///
    /// # Errors
    /// [`DesignError::Ray`] if a ray does not reach the image, or if the rays do not vary smoothly enough.
    pub(super) fn trace(
        tracer: &Tracer<'_>,
        tan: f64,
        points: Option<(usize, usize)>,
    ) -> Result<Self, DesignError> {
        let chief = tracer.ray(tan, 0.0, 0.0)?;
        let patch = with_ray_values(tracer, tan, &chief, |values| {
            let rims: &Rims<'_> = &|_, angles| vec![1.0; angles.len()];
            Sampler { wavelength_um: tracer.wavelength_um, rims, values }.open_patch(points)
        })?;
        let uneven = || tracer.ray_error(tan, 0.0, 0.0, NOT_SMOOTH.to_owned());
        let patch = patch.ok_or_else(uneven)?;
        let limits = tracer.limits();
        let count = limits[0].len() + limits[1].len();
        let mut disc = Self {
            wavelength_um: tracer.wavelength_um,
            height_mm: chief.x.v,
            patch,
            places: vec![Vec::new(); count],
            limits,
            surfaces: tracer.surfaces(),
        };
        if count > 0 {
            disc.add_places(tracer, tan)?;
        }
        Ok(disc)
    }

    fn add_places(&mut self, tracer: &Tracer<'_>, tan: f64) -> Result<(), DesignError> {
        let (rho, theta) = self.points();
        let last = LastAim::default();
        for r in &rho {
            for t in &theta {
                let (s, c) = real::sin_cos(*t);
                let places = tracer.places(&last, tan, r * c, r * s)?;
                self.places.iter_mut().zip(places).for_each(|(table, v)| table.push(v));
            }
        }
        let evaluator = Evaluator::new(self);
        for (r, share) in RHO.iter().flat_map(|r| THETA.map(|t| (*r, t))) {
            let (s, c) = real::sin_cos(share * PI);
            let (p, q) = (r * c, r * s);
            let weights = evaluator.weights(p, q);
            for (table, expected) in self.places.iter().zip(tracer.places(&last, tan, p, q)?) {
                // Far outside its aperture a ray is blocked anyway.
                if (weights.sum(table) - expected).abs() > PLACE_TOLERANCE * expected.abs().max(1.0) {
                    return Err(tracer.ray_error(tan, p, q, NOT_SMOOTH.to_owned()));
                }
            }
        }
        Ok(())
    }

    /// Rings and spokes of the grid.
    pub(super) fn size(&self) -> (usize, usize) {
        (self.patch.rings, self.patch.spokes)
    }

    fn points(&self) -> (Vec<f64>, Vec<f64>) {
        let Segment { from, to, .. } = self.patch.segment;
        (chebyshev(self.patch.rings, 0.0, 1.0), chebyshev(self.patch.spokes, from, to))
    }

    /// On the larger grid of `rings` × `spokes` points, exactly: its tables are polynomials.
    pub(super) fn resized(self, (rings, spokes): (usize, usize)) -> Self {
        if self.size() == (rings, spokes) {
            return self;
        }
        let Patch { segment, .. } = self.patch;
        let evaluator = Evaluator::new(&self);
        let along: Vec<Vec<f64>> = chebyshev(spokes, segment.from, segment.to)
            .into_iter()
            .map(|t| evaluator.theta.weights(t))
            .collect();
        let across: Vec<Vec<f64>> =
            chebyshev(rings, 0.0, 1.0).into_iter().map(|r| evaluator.rho.weights(r)).collect();
        let resize = |table: &Vec<f64>| -> Vec<f64> {
            let pairs = across.iter().flat_map(|rho| along.iter().map(move |theta| (rho, theta)));
            pairs.map(|(rho, theta)| sum(table, rho, theta)).collect()
        };
        let tables = std::array::from_fn(|i| resize(&self.patch.tables[i]));
        let places = self.places.iter().map(resize).collect();
        Self { patch: Patch::new(segment, rings, spokes, tables), places, ..self }
    }

    /// The disc at `height_mm` from `nodes` of other heights on the same grid: polynomials of the height (Lagrange).
    pub(super) fn between(nodes: &[&Self], height_mm: f64) -> Self {
        let at = |i: usize| nodes[i].height_mm;
        let weight = |i: usize| -> f64 {
            let others = (0..nodes.len()).filter(|j| *j != i);
            others.map(|j| (height_mm - at(j)) / (at(i) - at(j))).product()
        };
        let weights: Vec<f64> = (0..nodes.len()).map(weight).collect();
        let mix = |table: &dyn Fn(&Self) -> &Vec<f64>| {
            let mut out = vec![0.0; table(nodes[0]).len()];
            for (node, w) in nodes.iter().zip(&weights) {
                out.iter_mut().zip(table(node)).for_each(|(to, v)| *to += w * v);
            }
            out
        };
        let tables = std::array::from_fn(|i| mix(&|d| &d.patch.tables[i]));
        let places = (0..nodes[0].places.len()).map(|i| mix(&|d| &d.places[i])).collect();
        let Patch { segment, rings, spokes, .. } = nodes[0].patch;
        Self {
            wavelength_um: nodes[0].wavelength_um,
            height_mm,
            patch: Patch::new(segment, rings, spokes, tables),
            places,
            limits: nodes[0].limits.clone(),
            surfaces: nodes[0].surfaces,
        }
    }

    /// Maximum difference to `other` within the rims: in phase at the edge of the largest window [rad]; [`WEIGHT`] times that relative in amplitude
    /// and in the places of rims.
    pub(super) fn difference(&self, other: &Self) -> f64 {
        let phase = 2.0 * PI / self.wavelength_um;
        let reach = phase * MAX_REACH_UM;
        let size = |table: &Vec<f64>| WEIGHT / table.iter().fold(1e-300_f64, |a, v| a.max(v.abs()));
        let [.., amplitude, flux] = &other.patch.tables;
        let weights = [phase, reach, reach, size(amplitude), size(flux)];
        let [a, b] = [Evaluator::new(self), Evaluator::new(other)];
        let apertures = b.apertures();
        let mut worst = 0.0_f64;
        for (rho, share) in SAMPLED.iter().flat_map(|rho| SAMPLED.map(|share| (*rho, share))) {
            let (s, c) = real::sin_cos(share * PI);
            let (p, q) = (rho * c, rho * s);
            if b.over(&apertures, p, q).0 > OUTSIDE {
                continue;
            }
            let ([found, expected], at) =
                ([a.weights(p, q), b.weights(p, q)], |i: usize| [self, other].map(|d| &d.patch.tables[i]));
            for (i, weight) in weights.iter().enumerate() {
                let [x, y] = at(i);
                worst = worst.max(weight * (found.sum(x) - expected.sum(y)).abs());
            }
            for (x, y) in self.places.iter().zip(&other.places) {
                worst = worst.max(WEIGHT * (found.sum(x) - expected.sum(y)).abs());
            }
        }
        worst
    }

    /// The pupil function within the rims, beginning with the grids of `nearby`; none if no light passes.
    ///
    /// # Errors
    /// None of its own: the tables have a value everywhere.
    pub(super) fn pupil_function(
        &self,
        nearby: Option<&PupilFunction>,
    ) -> Result<Option<PupilFunction>, DesignError> {
        let evaluator = Evaluator::new(self);
        let apertures = evaluator.apertures();
        let over = |p: f64, q: f64| evaluator.over(&apertures, p, q);
        let hidden = |p: f64, q: f64| evaluator.hidden(&apertures, p, q);
        let openings = Openings {
            over: (!apertures.is_empty()).then_some(&over as &Overshoot<'_>),
            hidden: (!self.limits[1].is_empty()).then_some(&hidden as &Overshoot<'_>),
        };
        let Some(pupil) = Pupil::within(openings) else { return Ok(None) };
        let values = |p: f64, q: f64| {
            let weights = evaluator.weights(p, q);
            Ok(std::array::from_fn(|i| weights.sum(&self.patch.tables[i])))
        };
        let patches = match pupil.segments == [self.patch.segment] {
            true => vec![self.patch.clone()],
            false => {
                let rims: &Rims<'_> = &|s, angles| s.radii(openings, angles.iter().copied());
                Sampler { wavelength_um: self.wavelength_um, rims, values: &values }
                    .patches(&pupil, nearby)?
            }
        };
        Ok(Some(PupilFunction::new(self.wavelength_um, (pupil, false), patches, self.height_mm)))
    }
}

/// Evaluates the tables of a disc.
struct Evaluator<'a> {
    disc: &'a Disc,
    rho: Lagrange,
    theta: Lagrange,
}

/// Weights of the points of the grid for the value at a place.
struct Weights {
    rho: Vec<f64>,
    theta: Vec<f64>,
}

impl Weights {
    fn sum(&self, table: &[f64]) -> f64 {
        sum(table, &self.rho, &self.theta)
    }
}

/// ΣΣ rho_i theta_j table_ij, in four partial sums over j.
fn sum(table: &[f64], rho: &[f64], theta: &[f64]) -> f64 {
    let mut lanes = [0.0; 4];
    Sum { table, rho, theta, lanes: &mut lanes }.run_unfused(Simd::detect());
    lanes.iter().sum()
}

/// The partial sums of [`sum`].
struct Sum<'a> {
    table: &'a [f64],
    rho: &'a [f64],
    theta: &'a [f64],
    lanes: &'a mut [f64; 4],
}

impl<V: Lanes> SimdOp<V> for Sum<'_> {
    #[inline(always)]
    fn run(self) {
        let Self { table, rho, theta, lanes } = self;
        let (theta4, theta_rest) = theta.as_chunks::<4>();
        for (row, w) in table.chunks_exact(theta.len()).zip(rho) {
            let (row4, row_rest) = row.as_chunks::<4>();
            let mut along = [0.0; 4];
            for (v, t) in row4.iter().zip(theta4) {
                for i in 0..4 {
                    along[i] += v[i] * t[i];
                }
            }
            for (along, (v, t)) in along.iter_mut().zip(row_rest.iter().zip(theta_rest)) {
                *along += v * t;
            }
            for i in 0..4 {
                lanes[i] += w * along[i];
            }
        }
    }
}

impl<'a> Evaluator<'a> {
    fn new(disc: &'a Disc) -> Self {
        let Patch { segment, rings, spokes, .. } = disc.patch;
        Self { disc, rho: lagrange(rings, 0.0, 1.0), theta: lagrange(spokes, segment.from, segment.to) }
    }

    fn weights(&self, p: f64, q: f64) -> Weights {
        Weights { rho: self.rho.weights(real::hypot(p, q)), theta: self.theta.weights(real::atan2(q, p)) }
    }

    /// Table and surface of the apertures that clip light.
    fn apertures(&self) -> Vec<(&'a [f64], usize)> {
        let all = self.disc.places.iter().map(Vec::as_slice).zip(self.disc.limits[0].iter().copied());
        all.filter(|(table, _)| table.iter().any(|v| *v > -MARGIN)).collect()
    }

    fn over(&self, apertures: &[(&[f64], usize)], p: f64, q: f64) -> (f64, usize) {
        let weights = self.weights(p, q);
        let places = apertures.iter().map(|(table, surface)| (weights.sum(table), *surface));
        places.fold((f64::NEG_INFINITY, 0), |a, b| if b.0 > a.0 { b } else { a })
    }

    /// As [`Tracer::overshoot_of_hidden`].
    fn hidden(&self, apertures: &[(&[f64], usize)], p: f64, q: f64) -> (f64, usize) {
        let weights = self.weights(p, q);
        let [of_apertures, of_obscurations] = &self.disc.limits;
        let tables = self.disc.places[of_apertures.len()..].iter().zip(of_obscurations);
        let places = tables.map(|(table, surface)| (weights.sum(table), self.disc.surfaces + surface));
        let hidden = places.fold((f64::INFINITY, 0), |a, b| if b.0 < a.0 { b } else { a });
        let over = self.over(apertures, p, q);
        if over.0 > hidden.0 { over } else { hidden }
    }
}
