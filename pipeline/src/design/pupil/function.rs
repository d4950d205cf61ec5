//! The pupil function of a field point: phase, direction cosines and amplitude of its rays over the open pupil.
//!
//! ```text
//! W = path − L (x − x₀) − M y,   A = √(Φ J / N),   J = |d(L, M)/d(p, q)|,   Φ = flux per dp dq     ([`crate::design::psf`])
//! ```
//! All are smooth over each segment of the pupil ([`super::openings`]): they are interpolated from rays at Chebyshev points of (ρ, θ), as
//! many in each direction as it needs. The error is checked at rays in between, in ρ alone, in θ alone, and in both.
//! Of a pupil that is symmetric about the meridian the function has the upper half, θ in [0, π]; of any other the whole, θ in (−π, π]
//! ([`crate::design::skew::pupil`]).

use crate::real;
use std::f64::consts::PI;

use super::chebyshev::{chebyshev, lagrange};
use super::openings::{Pupil, Segment, with_openings};
use super::quadrature::unit_interval;
use crate::design::prescription::error::DesignError;
use crate::design::rays::aim::LastAim;
use crate::design::rays::ray::{ImageRay, Tracer};

/// Maximum error of the interpolated phase, rad, and relative error of the amplitude.
const SMOOTH_TOLERANCE: f64 = 1e-5;
/// Maximum half-width of a window for the phase tolerance, µm: 401 film pixels of 2 µm.
pub(in crate::design) const MAX_REACH_UM: f64 = 401.0;

/// Points that a direction begins with (ρ, θ), and those from which on it is not refined; twice as many in θ for more than a half circle.
const POINTS: [(usize, usize); 2] = [(12, 14), (60, 70)];
/// Places between the points where the error is determined: ρ, and the share of the segment in θ.
pub(super) const RHO: [f64; 4] = [0.013, 0.51, 0.96, 0.999];
pub(super) const THETA: [f64; 4] = [0.011, 0.34, 0.72, 0.988];

/// Rays that may be aimed for a pupil function; one with eight segments on the largest grids needs 400,000.
const MAX_RAYS: u32 = 500_000;
/// Energy at or below which a pupil is dark; that of a lens in units of mm² is near 1, and smaller ones would be lost in rounding.
const LEAST_ENERGY: f64 = 1e-100;

/// The pupil function of a field point: phase, direction cosines and amplitude over the open pupil, or over its upper half.
#[derive(Clone, Debug, PartialEq)]
pub struct PupilFunction {
    /// Wavelength, µm.
    pub wavelength_um: f64,
    pub(super) pupil: Pupil,
    pub(in crate::design) patches: Vec<Patch>,
    /// Total energy of the field point, in the units of |U|²·µm².
    energy: f64,
    /// Real chief-ray height, mm.
    pub height_mm: f64,
    /// Extent of the direction cosines: minimum and maximum of L, and of M.
    pub extent: [(f64, f64); 2],
    /// Whether the segments are of the whole pupil: else the lower half is the mirror image of the upper one.
    pub is_whole: bool,
}

/// One segment of the pupil on a Chebyshev grid, θ as the fast index.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::design) struct Patch {
    pub(in crate::design) segment: Segment,
    pub(in crate::design) rings: usize,
    pub(in crate::design) spokes: usize,
    /// W [µm], L, M, amplitude × B², flux / N × B², each rings × spokes; the last two negative behind an obscuration.
    pub(in crate::design) tables: [Vec<f64>; 5],
    /// Maxima of |d(L, M)| and of |dW| = |x dL + y dM| [µm]: along ρ from each ring to the next, and along θ, over ρ, on each ring.
    radial: Vec<(f64, f64)>,
    angular: Vec<(f64, f64)>,
}

/// Errors of the values of a patch: of the phase at the edge of the largest window in rad, of amplitude and flux relative to their maxima.
struct Errors([f64; 5]);

impl Errors {
    fn new(wavelength_um: f64, patch: &Patch) -> Self {
        let k = 2.0 * PI / wavelength_um;
        let size = |table: &Vec<f64>| table.iter().fold(1e-300_f64, |a, v| a.max(v.abs()));
        let [.., amplitude, flux] = &patch.tables;
        Self([k, k * MAX_REACH_UM, k * MAX_REACH_UM, 1.0 / size(amplitude), 1.0 / size(flux)])
    }

    fn worst(&self, a: &[f64; 5], b: &[f64; 5]) -> f64 {
        (0..5).map(|i| self.0[i] * (a[i] - b[i]).abs()).fold(0.0, f64::max)
    }
}

/// Phase [µm], direction cosines, amplitude and flux / N at pupil coordinates (p, q).
pub(in crate::design) type Values<'a> = dyn Fn(f64, f64) -> Result<[f64; 5], DesignError> + 'a;

/// B(θ) of a segment at ascending angles.
pub(in crate::design) type Rims<'a> = dyn Fn(&Segment, &[f64]) -> Vec<f64> + 'a;

/// Calls `with` with the values of the rays of the field point at `tan`, whose chief ray is given.
pub(super) fn with_ray_values<T>(
    tracer: &Tracer<'_>,
    tan: f64,
    chief: &ImageRay,
    with: impl FnOnce(&Values<'_>) -> T,
) -> T {
    let last = LastAim::default();
    with(&|p, q| {
        let (r, _) = tracer.ray_from(&last, tan, p, q)?;
        let (dx, dy) = (r.x.v - chief.x.v, r.y.v);
        Ok(ray_values(&r, chief, (dx, dy)))
    })
}

/// The values of `r`, which lands at (dx, dy) mm from `chief`.
pub(in crate::design) fn ray_values(r: &ImageRay, chief: &ImageRay, (dx, dy): (f64, f64)) -> [f64; 5] {
    let path = r.path.v - chief.path.v - r.l.v * dx - r.m.v * dy;
    [path * 1e3, r.l.v, r.m.v, (r.flux * r.solid_angle() / r.n).sqrt(), r.flux / r.n]
}

/// Samples of the pupil function of one field point.
pub(in crate::design) struct Sampler<'a> {
    pub(in crate::design) wavelength_um: f64,
    pub(in crate::design) rims: &'a Rims<'a>,
    pub(in crate::design) values: &'a Values<'a>,
}

/// Whether a segment is more than half a circle: its two halves are then examined like two segments.
fn is_wide(segment: &Segment) -> bool {
    segment.to - segment.from > PI
}

/// Number of parts of a pupil like that of its segments: 1, or 2 halves.
fn parts(is_whole: bool) -> f64 {
    if is_whole { 1.0 } else { 2.0 }
}

/// Points of `segment` to begin with, and those from which on it is not refined.
fn points(segment: &Segment) -> [(usize, usize); 2] {
    let halves = if is_wide(segment) { 2 } else { 1 };
    POINTS.map(|(rings, spokes)| (rings, halves * spokes))
}

impl Sampler<'_> {
    /// The values of [`Patch::tables`] at (ρ, θ) of `segment` with the rim `b`.
    fn at(&self, segment: &Segment, rho: f64, theta: f64, b: f64) -> Result<[f64; 5], DesignError> {
        let (s, c) = real::sin_cos(theta);
        let [w, l, m, amplitude, flux] =
            (self.values)(segment.centre + rho * b * c, segment.across + rho * b * s)?;
        let area = segment.sign * b * b;
        Ok([w, l, m, amplitude * area, flux * area])
    }

    /// The patch of `segment` on a grid of `rings` × `spokes`.
    fn patch(&self, segment: Segment, (rings, spokes): (usize, usize)) -> Result<Patch, DesignError> {
        let (rho, theta) = (chebyshev(rings, 0.0, 1.0), chebyshev(spokes, segment.from, segment.to));
        let rims = (self.rims)(&segment, &theta);
        let mut tables = [const { Vec::new() }; 5];
        for r in &rho {
            for (t, b) in std::iter::zip(&theta, &rims) {
                let values = self.at(&segment, *r, *t, *b)?;
                tables.iter_mut().zip(values).for_each(|(table, v)| table.push(v));
            }
        }
        Ok(Patch::new(segment, rings, spokes, tables))
    }

    /// Maximum error of `patch` at the places `rho` × `theta`, over the tolerance.
    fn error(&self, patch: &Patch, rho: &[f64], theta: &[f64]) -> Result<f64, DesignError> {
        let errors = Errors::new(self.wavelength_um, patch);
        let mut worst = 0.0_f64;
        for (t, b) in theta.iter().zip((self.rims)(&patch.segment, theta)) {
            for r in rho {
                let expected = self.at(&patch.segment, *r, *t, b)?;
                worst = worst.max(errors.worst(&patch.at(*r, *t), &expected));
            }
        }
        Ok(worst / SMOOTH_TOLERANCE)
    }

    /// The patch of `segment`, refined from a grid of `points` on until its error is below the tolerance.
    pub(super) fn accurate_patch(
        &self,
        segment: Segment,
        mut points: (usize, usize),
    ) -> Result<Patch, DesignError> {
        let at = |share: f64| segment.from + share * (segment.to - segment.from);
        let between: Vec<f64> = match is_wide(&segment) {
            false => THETA.map(at).to_vec(),
            true => [0.0, 0.5].iter().flat_map(|half| THETA.map(|t| at(half + 0.5 * t))).collect(),
        };
        let [_, most] = self::points(&segment);
        loop {
            let patch = self.patch(segment, points)?;
            if self.error(&patch, &RHO, &between)? < 1.0 {
                return Ok(patch);
            }
            let (rings, spokes) = points;
            let (rho, theta) = (chebyshev(rings, 0.0, 1.0), chebyshev(spokes, segment.from, segment.to));
            let along =
                [theta[1], theta[spokes / 4], theta[spokes / 2], theta[3 * spokes / 4], theta[spokes - 2]];
            let in_rho = match is_wide(&segment) {
                false => self.error(&patch, &RHO, &[along[0], along[2], along[4]])?,
                true => self.error(&patch, &RHO, &along)?,
            };
            let in_theta = self.error(&patch, &[rho[rings / 2], rho[rings - 1]], &between)?;
            let (grow_rings, grow_spokes) =
                (in_rho > 0.5 || in_theta <= 0.5, in_theta > 0.5 || in_rho <= 0.5);
            // No place of the check may be where more rings are needed.
            let grow_rings = grow_rings || (is_wide(&segment) && spokes >= most.1);
            points = (
                if grow_rings && rings < most.0 { rings * 4 / 3 } else { rings },
                if grow_spokes && spokes < most.1 { spokes * 4 / 3 } else { spokes },
            );
            if points == (rings, spokes) {
                return Ok(patch);
            }
        }
    }
}

impl Sampler<'_> {
    /// The patch of the unit circle, on a grid of at least `points`; none if the largest grid is not enough.
    pub(super) fn open_patch(&self, points: Option<(usize, usize)>) -> Result<Option<Patch>, DesignError> {
        let patch = self.accurate_patch(Segment::OPEN, points.unwrap_or(POINTS[0]))?;
        let is_largest = patch.rings >= POINTS[1].0 || patch.spokes >= POINTS[1].1;
        Ok(Some(patch).filter(|_| !is_largest))
    }

    /// The patches of `pupil`, beginning with the grids of `nearby` if it has the same rims.
    pub(in crate::design) fn patches(
        &self,
        pupil: &Pupil,
        nearby: Option<&PupilFunction>,
    ) -> Result<Vec<Patch>, DesignError> {
        let like = nearby.filter(|f| f.pupil.has_rims_of(pupil));
        let first = |(i, s): (usize, &Segment)| {
            like.map_or(points(s)[0], |f| (f.patches[i].rings, f.patches[i].spokes))
        };
        pupil.segments.iter().enumerate().map(|s| self.accurate_patch(*s.1, first(s))).collect()
    }
}

impl PupilFunction {
    /// Traces the pupil function of the field point at tan(field angle) `tan`.
    ///
    /// # Errors
    /// [`DesignError::Ray`] if a ray within the apertures does not reach the image.
    pub fn trace(tracer: &Tracer<'_>, tan: f64) -> Result<Self, DesignError> {
        Self::trace_from(tracer, tan, None)
    }

    /// [`PupilFunction::trace`], beginning with the grid of a field point nearby where their pupils have the same rims.
    ///
    /// # Errors
    /// As there.
    pub fn trace_from(tracer: &Tracer<'_>, tan: f64, nearby: Option<&Self>) -> Result<Self, DesignError> {
        tracer.within_budget(tan, MAX_RAYS, |tracer| {
            let pupil = Pupil::new(tracer, tan)?;
            let chief = tracer.ray(tan, 0.0, 0.0)?;
            let patches = with_openings(tracer, tan, |openings| {
                with_ray_values(tracer, tan, &chief, |values| {
                    let rims: &Rims<'_> = &|s, angles| s.radii(openings, angles.iter().copied());
                    let sampler = Sampler { wavelength_um: tracer.wavelength_um, rims, values };
                    sampler.patches(&pupil, nearby)
                })
            })?;
            Self::new(tracer.wavelength_um, (pupil, false), patches, chief.x.v).lit()
        })
    }

    /// Of the patches of `pupil`: of the whole pupil, or of its upper half.
    pub(in crate::design) fn new(
        wavelength_um: f64,
        (pupil, is_whole): (Pupil, bool),
        patches: Vec<Patch>,
        height_mm: f64,
    ) -> Self {
        let energy: f64 = patches.iter().map(|patch| patch.flux(&pupil)).sum();
        let extent = |table: usize, pick: fn(f64, f64) -> f64, first: f64| {
            patches.iter().flat_map(|p| &p.tables[table]).fold(first, |a, v| pick(a, *v))
        };
        let range =
            |table| (extent(table, f64::min, f64::INFINITY), extent(table, f64::max, f64::NEG_INFINITY));
        let across = match is_whole {
            true => range(2),
            false => {
                // Of the upper half of the pupil, whose rays run towards −y behind it.
                let most = extent(2, |a, v| a.max(v.abs()), 0.0);
                (-most, most)
            }
        };
        let extent = [range(1), across];
        let energy = parts(is_whole) * wavelength_um * wavelength_um * energy;
        Self { wavelength_um, pupil, patches, energy, height_mm, extent, is_whole }
    }

    /// This function.
    ///
    /// # Errors
    /// [`DesignError::Dark`] if no light passes.
    pub(in crate::design) fn lit(self) -> Result<Self, DesignError> {
        match self.energy > LEAST_ENERGY {
            true => Ok(self),
            false => Err(DesignError::Dark { wavelength_um: self.wavelength_um }),
        }
    }

    /// Number of parts of the pupil like that of the segments: 1, or 2 halves.
    pub(super) fn parts(&self) -> f64 {
        parts(self.is_whole)
    }

    /// The function of a film that is turned by −`azimuth_rad`: its PSF is turned by `azimuth_rad` (row down: from +x towards +y).
    #[must_use]
    pub(in crate::design) fn turned(mut self, azimuth_rad: f64) -> Self {
        let (sin, cos) = real::sin_cos(azimuth_rad);
        let patches = std::mem::take(&mut self.patches).into_iter().map(|patch| {
            let Patch { segment, rings, spokes, tables: [w, mut l, mut m, amplitude, flux], .. } = patch;
            for (l, m) in l.iter_mut().zip(&mut m) {
                (*l, *m) = (*l * cos - *m * sin, *l * sin + *m * cos);
            }
            Patch::new(segment, rings, spokes, [w, l, m, amplitude, flux])
        });
        let patches = patches.collect();
        Self::new(self.wavelength_um, (self.pupil, true), patches, self.height_mm)
    }

    /// Nyquist pitch of the PSF: λ over twice the larger extent of the direction cosines, µm.
    pub fn nyquist_um(&self) -> f64 {
        let [along, across] = self.extent.map(|(least, most)| most - least);
        self.wavelength_um / (2.0 * along.max(across))
    }

    /// Share of the total energy on a sample of `pitch_um` at the peak of the PSF that the same amplitudes have in one phase: the denominator
    /// of the Strehl ratio.
    pub fn ideal_peak(&self, pitch_um: f64) -> f64 {
        let amplitude: f64 = self.patches.iter().map(|patch| patch.integral(3, &self.pupil)).sum();
        let amplitude = self.parts() * amplitude;
        self.share(pitch_um) * amplitude * amplitude
    }

    /// ∬ |A|² dL dM = ∬ Φ/N dp dq over the whole pupil.
    pub(super) fn power(&self) -> f64 {
        self.energy / (self.wavelength_um * self.wavelength_um)
    }

    /// Share of the total energy per unit of |U|² on a sample of `pitch_um`.
    pub(in crate::design) fn share(&self, pitch_um: f64) -> f64 {
        pitch_um * pitch_um / self.energy
    }
}

impl Patch {
    /// With the bounds of its tables' derivatives, from the differences between neighbouring points.
    pub(in crate::design) fn new(
        segment: Segment,
        rings: usize,
        spokes: usize,
        tables: [Vec<f64>; 5],
    ) -> Self {
        let (rho, theta) = (chebyshev(rings, 0.0, 1.0), chebyshev(spokes, segment.from, segment.to));
        let bound = |(most, shift): (f64, f64), a: usize, b: usize, step: f64| {
            let slope = |table: &Vec<f64>| (table[b] - table[a]) / step;
            let [w, l, m, ..] = &tables;
            (most.max(real::hypot(slope(l), slope(m))), shift.max(slope(w).abs()))
        };
        let radial = (0..rings.saturating_sub(1))
            .map(|i| {
                let pairs = (i * spokes..(i + 1) * spokes).map(|at| (at, at + spokes));
                pairs.fold((0.0, 0.0), |most, (a, b)| bound(most, a, b, rho[i + 1] - rho[i]))
            })
            .collect();
        let angular = (0..rings)
            .map(|i| {
                let steps = (0..spokes.saturating_sub(1)).map(|j| (i * spokes + j, theta[j + 1] - theta[j]));
                steps.fold((0.0, 0.0), |most, (at, step)| bound(most, at, at + 1, rho[i] * step))
            })
            .collect();
        Self { segment, rings, spokes, tables, radial, angular }
    }

    /// Maxima of |d(L, M)| and |dW| between two values of ρ: along ρ, and along θ over ρ.
    pub(in crate::design) fn change(&self, from: f64, to: f64) -> ((f64, f64), (f64, f64)) {
        let rho = chebyshev(self.rings, 0.0, 1.0);
        let most = |a: (f64, f64), b: &(f64, f64)| (a.0.max(b.0), a.1.max(b.1));
        // With the ring before and the ring behind.
        let first = rho.partition_point(|r| *r < from).saturating_sub(1);
        let last = rho.partition_point(|r| *r <= to).min(self.rings - 1);
        let radial = &self.radial[first.min(self.radial.len())..last.min(self.radial.len())];
        let maximum = |bounds: &[(f64, f64)]| bounds.iter().fold((0.0, 0.0), most);
        (maximum(radial), maximum(&self.angular[first..=last]))
    }

    /// The table `table` at the angles of `spokes`: rings × spokes.
    fn along_theta(&self, table: usize, spokes: &[(f64, f64)]) -> Vec<f64> {
        let basis = lagrange(self.spokes, self.segment.from, self.segment.to);
        // One row of weights per point of the grid.
        let mut weights = vec![0.0; self.spokes * spokes.len()];
        for (i, (t, _)) in spokes.iter().enumerate() {
            for (k, w) in basis.weights(*t).into_iter().enumerate() {
                weights[k * spokes.len() + i] = w;
            }
        }
        let mut fine = vec![0.0; self.rings * spokes.len()];
        for (to, ring) in
            fine.chunks_exact_mut(spokes.len()).zip(self.tables[table].chunks_exact(self.spokes))
        {
            for (v, row) in ring.iter().zip(weights.chunks_exact(spokes.len())) {
                to.iter_mut().zip(row).for_each(|(to, w)| *to += w * v);
            }
        }
        fine
    }

    /// The values at (ρ, θ).
    pub(in crate::design) fn at(&self, rho: f64, theta: f64) -> [f64; 5] {
        let along = lagrange(self.spokes, self.segment.from, self.segment.to).weights(theta);
        let across = lagrange(self.rings, 0.0, 1.0).weights(rho);
        std::array::from_fn(|i| {
            let rings = self.tables[i].chunks_exact(self.spokes);
            let at_ring = |ring: &[f64]| ring.iter().zip(&along).map(|(v, w)| w * v).sum::<f64>();
            rings.zip(&across).map(|(ring, w)| at_ring(ring) * w).sum()
        })
    }

    /// ∫∫ Φ/N dp dq over the patch.
    fn flux(&self, pupil: &Pupil) -> f64 {
        self.integral(4, pupil)
    }

    /// ∫∫ of the amplitude (table 3) or of Φ/N (table 4) dp dq over the patch.
    fn integral(&self, table: usize, pupil: &Pupil) -> f64 {
        let angles = pupil.angles(&self.segment, 24);
        let fine = self.along_theta(table, &angles);
        let to_ring = lagrange(self.rings, 0.0, 1.0);
        let ring = |rho: f64| -> f64 {
            let rows = to_ring.weights(rho).into_iter().zip(fine.chunks_exact(angles.len()));
            rows.map(|(w, row)| w * row.iter().zip(&angles).map(|(v, a)| v * a.1).sum::<f64>()).sum()
        };
        unit_interval(16).iter().map(|(rho, w)| w * rho * ring(*rho)).sum()
    }
}
