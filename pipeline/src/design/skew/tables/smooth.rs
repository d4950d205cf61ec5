//! Pupil functions of a built lens at any place of the film, interpolated between traced places.
//!
//! ```text
//! f(h, φ; ρ, θ) = Σ_i Σ_b ℓ_i(h) D(φ − 2πb/B) f(h_i, 2πb/B; ρ, θ)
//! ```
//! f: phase, direction cosines, amplitude and flux of the rays of an open pupil, in the frame that is turned by the azimuth φ of the place, with
//! pupil coordinates that are turned alike ([`turned_pupil_function`]). Without errors f does not depend on φ; errors of a lens add low
//! harmonics, of which the m-th falls with the m-th power of the errors, and f is smooth in the height h, where PSFs are not. ℓ_i: the polynomials
//! through n Chebyshev heights h_i of [0, last]; D: the band-limited interpolation ([`dirichlet`]).
//! The error is measured at places between those heights and azimuths, as that of the phase at the edge of the largest window: a phase error of
//! ε rad (RMS over the pupil) changes a PSF by at most 2ε as an L1 norm. If it exceeds [`TOLERANCE`] there are more heights and azimuths.
//! Pupils that apertures clip are traced at each place: their rims move.

use std::f64::consts::{PI, TAU};

use rayon::prelude::*;

use super::super::error::SkewError;
use super::super::pupil::turned_pupil_function;
use super::super::trace::SkewTracer;
use super::band_limited::{azimuth_of, dirichlet};
use crate::design::pupil::chebyshev::{chebyshev, lagrange};
use crate::design::pupil::function::{MAX_REACH_UM, Patch, PupilFunction};
use crate::design::pupil::{Pupil, Segment};
use crate::real;

/// Heights and azimuths of the traced places, the first ones whose error is within the tolerance.
const LEVELS: [(usize, usize); 4] = [(10, 8), (14, 8), (14, 16), (20, 24)];
/// Places of the check: the extremum of the Chebyshev polynomial of the heights, as a share of their number, and the step of azimuth before it.
const CHECKS: [(f64, usize); 6] = [(1.0, 0), (1.0, 5), (0.9, 2), (0.65, 7), (0.4, 4), (0.12, 1)];
/// Largest error of the phase, rad; a tenth of it in amplitude and flux. L1 errors of PSFs are then below 1e-3.
const TOLERANCE: f64 = 1e-3;
/// Weight of relative errors of amplitude and flux over those of phases.
const WEIGHT: f64 = 10.0;

type Tables = [Vec<f64>; 5];

/// Pupil functions of the places up to a height.
pub(super) struct Smooth {
    wavelength_um: f64,
    last_mm: f64,
    /// Rings and spokes of all tables.
    size: (usize, usize),
    /// By height, of each azimuth.
    rows: Vec<Vec<Tables>>,
}

/// Those of one height: the tables of each azimuth.
pub(super) struct Row<'a> {
    of: &'a Smooth,
    height_mm: f64,
    tables: Vec<Tables>,
}

impl Smooth {
    /// For places up to `last_mm`; none where pupils are clipped, or where the functions are not smooth enough.
    pub(super) fn new(tracer: &SkewTracer<'_>, last_mm: f64) -> Option<Self> {
        for level in LEVELS {
            // A place that cannot be traced is an error where its PSF is needed.
            let (smooth, error) = Self::traced(tracer, last_mm, level).ok().flatten()?;
            if error <= TOLERANCE {
                return Some(smooth);
            }
        }
        None
    }

    /// From places at the heights and azimuths of a level, with the error; none where pupils are clipped.
    fn traced(
        tracer: &SkewTracer<'_>,
        last_mm: f64,
        (heights, azimuths): (usize, usize),
    ) -> Result<Option<(Self, f64)>, SkewError> {
        let heights_mm = chebyshev(heights, 0.0, last_mm);
        // The outermost place has the largest aberrations: the others begin with its grid.
        let outermost = turned_pupil_function(tracer, (heights_mm[heights - 1], 0.0), None)?;
        if !is_open(&outermost) {
            return Ok(None);
        }
        let nodes: Vec<(f64, f64)> = heights_mm
            .iter()
            .flat_map(|h| (0..azimuths).map(move |b| (*h, azimuth_of(b, azimuths))))
            .collect();
        let checks = CHECKS.map(|(share, step)| {
            let extremum = (share * heights as f64).round() / heights as f64;
            let height_mm = 0.5 * last_mm * (1.0 - real::cos(PI * extremum));
            (height_mm, azimuth_of(2 * (step % azimuths) + 1, 2 * azimuths))
        });
        let trace = |place: &(f64, f64)| turned_pupil_function(tracer, *place, Some(&outermost));
        let places: Vec<(f64, f64)> = nodes.iter().chain(&checks).copied().collect();
        let functions = places.par_iter().map(trace).collect::<Result<Vec<_>, SkewError>>()?;
        if !functions.iter().all(is_open) {
            return Ok(None);
        }
        let most = |a: (usize, usize), f: &PupilFunction| {
            (a.0.max(f.patches[0].rings), a.1.max(f.patches[0].spokes))
        };
        let size = functions.iter().fold((0, 0), most);
        let tables: Vec<Tables> = functions.par_iter().map(|f| on_grid(&f.patches[0], size)).collect();
        let (nodes, checked) = tables.split_at(nodes.len());
        let rows = nodes.chunks_exact(azimuths).map(<[Tables]>::to_vec).collect();
        let smooth = Self { wavelength_um: tracer.wavelength_um, last_mm, size, rows };
        let error = |(place, expected): (&(f64, f64), &Tables)| {
            smooth.difference(&smooth.row(place.0).tables(place.1), expected)
        };
        let worst = checks.iter().zip(checked).map(error).fold(0.0, f64::max);
        Ok(Some((smooth, worst)))
    }

    /// Those of a height.
    pub(super) fn row(&self, height_mm: f64) -> Row<'_> {
        let weights = lagrange(self.rows.len(), 0.0, self.last_mm).weights(height_mm);
        let azimuth =
            |b: usize| mixed(self.rows.iter().map(|row| &row[b]).zip(weights.iter().copied()), self.size);
        Row { of: self, height_mm, tables: (0..self.rows[0].len()).map(azimuth).collect() }
    }

    /// Largest difference over the pupil: in phase at the edge of the largest window, rad; [`WEIGHT`] times that relative in amplitude and flux.
    fn difference(&self, found: &Tables, expected: &Tables) -> f64 {
        let phase = TAU / self.wavelength_um;
        let size = |table: &Vec<f64>| WEIGHT / table.iter().fold(1e-300_f64, |a, v| a.max(v.abs()));
        let [.., amplitude, flux] = expected;
        let weights = [phase, phase * MAX_REACH_UM, phase * MAX_REACH_UM, size(amplitude), size(flux)];
        let table = |i: usize| {
            let pairs = found[i].iter().zip(&expected[i]);
            pairs.fold(0.0_f64, |worst, (a, b)| worst.max(weights[i] * (a - b).abs()))
        };
        (0..5).map(table).fold(0.0, f64::max)
    }
}

impl Row<'_> {
    /// The height, mm.
    pub(super) fn height_mm(&self) -> f64 {
        self.height_mm
    }

    /// The pupil function at an azimuth, in the frame that is turned by it.
    pub(super) fn function(&self, azimuth_rad: f64) -> PupilFunction {
        let (rings, spokes) = self.of.size;
        let pupil = Pupil { segments: vec![Segment::WHOLE] };
        let patch = Patch::new(Segment::WHOLE, rings, spokes, self.tables(azimuth_rad));
        PupilFunction::new(self.of.wavelength_um, (pupil, true), vec![patch], self.height_mm)
    }

    fn tables(&self, azimuth_rad: f64) -> Tables {
        let count = self.tables.len();
        let weight = |b: usize| dirichlet(azimuth_rad - azimuth_of(b, count), count);
        mixed(self.tables.iter().zip((0..count).map(weight)), self.of.size)
    }
}

/// Whether no aperture clips the pupil.
fn is_open(f: &PupilFunction) -> bool {
    f.patches.len() == 1 && f.patches[0].segment == Segment::WHOLE
}

/// Sum of tables of `rings` × `spokes` by weight.
fn mixed<'a>(terms: impl Iterator<Item = (&'a Tables, f64)>, (rings, spokes): (usize, usize)) -> Tables {
    let mut sums = std::array::from_fn(|_| vec![0.0; rings * spokes]);
    for (tables, weight) in terms {
        for (sum, table) in sums.iter_mut().zip(tables) {
            sum.iter_mut().zip(table).for_each(|(to, v)| *to += weight * v);
        }
    }
    sums
}

/// The tables of `patch` on a grid of `rings` × `spokes`: exactly on a larger one, as they are polynomials.
fn on_grid(patch: &Patch, (rings, spokes): (usize, usize)) -> Tables {
    if (patch.rings, patch.spokes) == (rings, spokes) {
        return patch.tables.clone();
    }
    let Segment { from, to, .. } = patch.segment;
    let weights = |from_points: usize, points: usize, a: f64, b: f64| -> Vec<Vec<f64>> {
        let basis = lagrange(from_points, a, b);
        chebyshev(points, a, b).into_iter().map(|x| basis.weights(x)).collect()
    };
    let (across, along) = (weights(patch.rings, rings, 0.0, 1.0), weights(patch.spokes, spokes, from, to));
    std::array::from_fn(|i| {
        let table = &patch.tables[i];
        let on_ring = |ring: &Vec<f64>| -> Vec<f64> {
            let mut row = vec![0.0; patch.spokes];
            for (weight, values) in ring.iter().zip(table.chunks_exact(patch.spokes)) {
                row.iter_mut().zip(values).for_each(|(to, v)| *to += weight * v);
            }
            along.iter().map(|spoke| spoke.iter().zip(&row).map(|(w, v)| w * v).sum()).collect()
        };
        across.iter().flat_map(on_ring).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::super::super::system::BuiltLens;
    use super::super::super::tests::lenses::{double_gauss, lens_0};
    use super::*;
    use crate::design::prescription::system::{RayAiming, System};
    use crate::design::psf::{PsfGrid, PsfScratch};

    fn smooth(system: &System, last_mm: f64, check: impl FnOnce(Option<Smooth>, &SkewTracer<'_>)) {
        let built = BuiltLens::new(system, &lens_0()).unwrap();
        let tracer = SkewTracer::new(&built, 0.55).unwrap();
        check(Smooth::new(&tracer, last_mm), &tracer);
    }

    /// At the axis, near it, at the edge, and between; each window has 98 % of the light.
    #[test]
    fn psfs_between_traced_places_are_those_of_their_own_rays() {
        smooth(&double_gauss(RayAiming::Real), 20.0, |smooth, tracer| {
            let smooth = smooth.unwrap();
            for place in [(0.0, 0.4), (0.07, 2.0), (9.3, 3.8), (14.2, 5.1), (20.0, 1.0)] {
                let own = turned_pupil_function(tracer, place, None).unwrap();
                let grid = PsfGrid::new(40, 0.9 * own.nyquist_um());
                let [found, expected] = [smooth.row(place.0).function(place.1), own]
                    .map(|f| grid.psf(&f, 0.0, &mut PsfScratch::default()));
                let l1: f64 = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).sum();
                assert!(l1 < 2e-4, "{place:?}: {l1:e}");
            }
        });
    }

    #[test]
    fn clipped_pupils_are_not_interpolated() {
        let mut clipped = double_gauss(RayAiming::Real);
        clipped.surfaces[0].aperture_mm = Some(24.0);
        smooth(&clipped, 20.0, |smooth, _| assert!(smooth.is_none()));
    }
}
