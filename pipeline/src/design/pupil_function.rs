//! The pupil function of a field point: phase, direction cosines and amplitude of its rays over the open pupil.
//!
//!     W = path − L (x − x₀) − M y,   A = √(Φ J / N),   J = |d(L, M)/d(p, q)|,   Φ = flux per dp dq     ([`super::psf`])
//! All are smooth over each segment of the pupil ([`super::pupil`]): they are interpolated from rays at Chebyshev points of (ρ, θ), as
//! many in each direction as it needs. The error is checked at rays in between, in ρ alone, in θ alone, and in both.

use crate::real;
use std::f64::consts::PI;

use rustfft::num_complex::Complex;

use super::chebyshev::{chebyshev, lagrange};
use super::error::DesignError;
use super::pupil::{Pupil, Segment, unit_interval};
use super::ray::{ImageRay, Tracer};

/// Maximum error of the interpolated phase, rad, and relative error of the amplitude.
const SMOOTH_TOLERANCE: f64 = 1e-5;
/// Maximum half-width of a window for the phase tolerance, µm: 401 film pixels of 2 µm.
const MAX_REACH_UM: f64 = 401.0;

/// Points that a direction begins with (ρ, θ), and those from which on it is not refined.
const POINTS: [(usize, usize); 2] = [(12, 14), (60, 70)];
/// Places between the points where the error is determined: ρ, and the share of the segment in θ.
const RHO: [f64; 4] = [0.013, 0.51, 0.96, 0.999];
const THETA: [f64; 4] = [0.011, 0.34, 0.72, 0.988];

/// The pupil function of a field point: phase, direction cosines and amplitude over the open pupil's upper half.
#[derive(Clone, Debug)]
pub struct PupilFunction {
    /// Wavelength, µm.
    pub wavelength_um: f64,
    pupil: Pupil,
    patches: Vec<Patch>,
    /// Total energy of the field point, in the units of |U|²·µm².
    energy: f64,
    /// Real chief-ray height, mm.
    pub height_mm: f64,
    /// Extent of the direction cosines: minimum of L, maximum of L, maximum of M.
    pub extent: (f64, f64, f64),
}

/// One segment of the pupil on a Chebyshev grid, θ as the fast index.
#[derive(Clone, Debug)]
struct Patch {
    segment: Segment,
    rings: usize,
    spokes: usize,
    /// W [µm], L, M, amplitude × B², flux / N × B², each rings × spokes; the last two negative behind an obscuration.
    tables: [Vec<f64>; 5],
    /// Bounds of |d(L, M)| and of |x dL + y dM| [µm] along ρ and along θ.
    radial: (f64, f64),
    angular: (f64, f64),
}

/// A plane wavelet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wavelet {
    /// Direction cosine along x.
    pub l: f64,
    /// Direction cosine along y.
    pub m: f64,
    /// Complex amplitude at the chief ray's intersection.
    pub c: Complex<f64>,
}

/// Samples of the pupil function of one field point.
struct Sampler<'a> {
    tracer: &'a Tracer<'a>,
    tan: f64,
    chief: ImageRay,
}

impl Sampler<'_> {
    /// Rim of `segment` at ascending angles; the search for it costs some rays each.
    fn rims(&self, segment: &Segment, angles: &[f64]) -> Vec<f64> {
        segment.radii(self.tracer, self.tan, angles.iter().copied())
    }

    /// The values of [`Patch::tables`] at (ρ, θ) of `segment` with the rim `b`, and their ray.
    fn at(
        &self,
        segment: &Segment,
        rho: f64,
        theta: f64,
        b: f64,
    ) -> Result<([f64; 5], ImageRay), DesignError> {
        let (s, c) = real::sin_cos(theta);
        let r = self.tracer.ray(self.tan, segment.centre + rho * b * c, rho * b * s)?;
        let (dx, dy) = (r.x.v - self.chief.x.v, r.y.v);
        let path = r.path.v - self.chief.path.v - r.l.v * dx - r.m.v * dy;
        let area = segment.sign * b * b;
        let amplitude = (r.flux * r.solid_angle() / r.n).sqrt() * area;
        Ok(([path * 1e3, r.l.v, r.m.v, amplitude, r.flux / r.n * area], r))
    }

    /// The patch of `segment` on a grid of `rings` × `spokes`; `extent` grows to that of its direction cosines.
    fn patch(
        &self,
        segment: Segment,
        (rings, spokes): (usize, usize),
        extent: &mut (f64, f64, f64),
    ) -> Result<Patch, DesignError> {
        let (rho, theta) = (chebyshev(rings, 0.0, 1.0), chebyshev(spokes, segment.from, segment.to));
        let rims = self.rims(&segment, &theta);
        let mut tables = [const { Vec::new() }; 5];
        let (mut radial, mut angular) = ((0.0_f64, 0.0_f64), (0.0_f64, 0.0_f64));
        for r in &rho {
            for (t, b) in std::iter::zip(&theta, &rims) {
                let (values, ray) = self.at(&segment, *r, *t, *b)?;
                for (table, v) in tables.iter_mut().zip(values) {
                    table.push(v);
                }
                *extent = (extent.0.min(ray.l.v), extent.1.max(ray.l.v), extent.2.max(ray.m.v));
                let (s, c) = real::sin_cos(*t);
                let shift = [(ray.x.v - self.chief.x.v) * 1e3, ray.y.v * 1e3];
                for (bound, [p, q]) in [(&mut radial, [c, s]), (&mut angular, [-s * r, c * r])] {
                    let (dl, dm) =
                        (b * (ray.l.d[0] * p + ray.l.d[1] * q), b * (ray.m.d[0] * p + ray.m.d[1] * q));
                    bound.0 = bound.0.max(real::hypot(dl, dm));
                    bound.1 = bound.1.max((shift[0] * dl + shift[1] * dm).abs());
                }
            }
        }
        Ok(Patch { segment, rings, spokes, tables, radial, angular })
    }

    /// Maximum error of `patch` at the places `rho` × `theta`, over the tolerance.
    fn error(&self, patch: &Patch, rho: &[f64], theta: &[f64]) -> Result<f64, DesignError> {
        let k = 2.0 * PI / self.tracer.wavelength_um;
        let size = |table: &Vec<f64>| table.iter().fold(1e-300_f64, |a, v| a.max(v.abs()));
        let [.., amplitude, flux] = &patch.tables;
        let weight = [k, k * MAX_REACH_UM, k * MAX_REACH_UM, 1.0 / size(amplitude), 1.0 / size(flux)];
        let mut worst = 0.0_f64;
        for (t, b) in theta.iter().zip(self.rims(&patch.segment, theta)) {
            for r in rho {
                let (expected, _) = self.at(&patch.segment, *r, *t, b)?;
                let found = patch.at(*r, *t);
                for i in 0..5 {
                    worst = worst.max(weight[i] * (found[i] - expected[i]).abs());
                }
            }
        }
        Ok(worst / SMOOTH_TOLERANCE)
    }

    /// The patch of `segment`, refined from a grid of `points` on until its error is below the tolerance.
    fn accurate_patch(
        &self,
        segment: Segment,
        mut points: (usize, usize),
        extent: &mut (f64, f64, f64),
    ) -> Result<Patch, DesignError> {
        let between = THETA.map(|t| segment.from + t * (segment.to - segment.from));
        loop {
            let patch = self.patch(segment, points, extent)?;
            if self.error(&patch, &RHO, &between)? < 1.0 {
                return Ok(patch);
            }
            let (rings, spokes) = points;
            let (rho, theta) = (chebyshev(rings, 0.0, 1.0), chebyshev(spokes, segment.from, segment.to));
            let in_rho = self.error(&patch, &RHO, &[theta[1], theta[spokes / 2], theta[spokes - 2]])?;
            let in_theta = self.error(&patch, &[rho[rings / 2], rho[rings - 1]], &between)?;
            let (grow_rings, grow_spokes) =
                (in_rho > 0.5 || in_theta <= 0.5, in_theta > 0.5 || in_rho <= 0.5);
            points = (
                if grow_rings && rings < POINTS[1].0 { rings * 4 / 3 } else { rings },
                if grow_spokes && spokes < POINTS[1].1 { spokes * 4 / 3 } else { spokes },
            );
            if points == (rings, spokes) {
                return Ok(patch);
            }
        }
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
        let pupil = Pupil::new(tracer, tan)?;
        let chief = tracer.ray(tan, 0.0, 0.0)?;
        let sampler = Sampler { tracer, tan, chief };
        let mut extent = (chief.l.v, chief.l.v, 0.0);
        let like = nearby.filter(|f| f.pupil.has_rims_of(&pupil));
        let mut patches = Vec::new();
        for (i, segment) in pupil.segments.iter().enumerate() {
            let points = like.map_or(POINTS[0], |f| (f.patches[i].rings, f.patches[i].spokes));
            patches.push(sampler.accurate_patch(*segment, points, &mut extent)?);
        }
        let wavelength_um = tracer.wavelength_um;
        let energy: f64 = patches.iter().map(|patch| patch.flux(&pupil)).sum();
        let energy = 2.0 * wavelength_um * wavelength_um * energy;
        Ok(Self { wavelength_um, pupil, patches, energy, height_mm: chief.x.v, extent })
    }

    /// Wavelets dense enough for a window of ± `reach_um` in x and y, rotated by `azimuth_rad`; `mirrored` adds the lower half of the
    /// pupil.
    pub fn wavelets(&self, reach_um: f64, azimuth_rad: f64, mirrored: bool) -> Vec<Wavelet> {
        let k = 2.0 * PI / self.wavelength_um;
        let corner = std::f64::consts::SQRT_2 * reach_um;
        let (sin, cos) = real::sin_cos(azimuth_rad);
        let middle = 0.5 * (self.extent.0 + self.extent.1);
        let mut out = Vec::new();
        for patch in &self.patches {
            // Bounds κ of the change of phase per unit of ρ and of θ. Gauss-Legendre converges from κ/4 nodes on, the midpoint rule on
            // the half circle from κ/2; the additional nodes reduce the error from O(1) to 1e-8.
            let radial = k * (corner * patch.radial.0 + patch.radial.1);
            let angular = k * (corner * patch.angular.0 + patch.angular.1);
            let rings = unit_interval((radial / 4.0 + 2.0 * real::cbrt(radial)) as usize + 10);
            let spokes = (angular / 2.0 + 2.0 * real::cbrt(angular)) as usize + 10;
            let spokes = self.pupil.angles(&patch.segment, spokes);
            let fine = patch.along_theta::<4>(&spokes);
            let width = spokes.len();
            let to_ring = lagrange(patch.rings, 0.0, 1.0);
            let mut rows = [const { Vec::new() }; 4];
            out.reserve(rings.len() * width * if mirrored { 2 } else { 1 });
            for (rho, wr) in rings {
                let weights = to_ring.weights(rho);
                for (row, table) in rows.iter_mut().zip(&fine) {
                    row.clear();
                    row.resize(width, 0.0);
                    for (w, source) in weights.iter().zip(table.chunks_exact(width)) {
                        for (v, s) in row.iter_mut().zip(source) {
                            *v += w * s;
                        }
                    }
                }
                for (i, (_, wt)) in spokes.iter().enumerate() {
                    let (sin_w, cos_w) = real::sin_cos(k * rows[0][i]);
                    let c = Complex::new(cos_w, sin_w) * (rows[3][i] * wr * wt * rho);
                    let (l, m) = (rows[1][i] - middle, rows[2][i]);
                    out.push(Wavelet { l: l * cos - m * sin, m: l * sin + m * cos, c });
                    if mirrored {
                        out.push(Wavelet { l: l * cos + m * sin, m: l * sin - m * cos, c });
                    }
                }
            }
        }
        out
    }

    /// Nyquist pitch of the PSF: λ over twice the larger extent of the direction cosines, µm.
    pub fn nyquist_um(&self) -> f64 {
        let (a, b, m) = self.extent;
        self.wavelength_um / (2.0 * (b - a).max(2.0 * m))
    }

    /// Share of the total energy per unit of |U|² on a sample of `pitch_um`.
    pub(super) fn share(&self, pitch_um: f64) -> f64 {
        pitch_um * pitch_um / self.energy
    }
}

impl Patch {
    /// The first N tables at the angles of `spokes`: rings × spokes.
    fn along_theta<const N: usize>(&self, spokes: &[(f64, f64)]) -> [Vec<f64>; N] {
        let basis = lagrange(self.spokes, self.segment.from, self.segment.to);
        // One row of weights per point of the grid.
        let mut weights = vec![0.0; self.spokes * spokes.len()];
        for (i, (t, _)) in spokes.iter().enumerate() {
            for (k, w) in basis.weights(*t).into_iter().enumerate() {
                weights[k * spokes.len() + i] = w;
            }
        }
        std::array::from_fn(|i| {
            let mut fine = vec![0.0; self.rings * spokes.len()];
            for (to, ring) in
                fine.chunks_exact_mut(spokes.len()).zip(self.tables[i].chunks_exact(self.spokes))
            {
                for (v, row) in ring.iter().zip(weights.chunks_exact(spokes.len())) {
                    to.iter_mut().zip(row).for_each(|(to, w)| *to += w * v);
                }
            }
            fine
        })
    }

    fn at(&self, rho: f64, theta: f64) -> [f64; 5] {
        let fine = self.along_theta::<5>(&[(theta, 1.0)]);
        let w = lagrange(self.rings, 0.0, 1.0).weights(rho);
        fine.map(|column| column.iter().zip(&w).map(|(a, b)| a * b).sum())
    }

    /// ∫∫ Φ/N dp dq over the patch.
    fn flux(&self, pupil: &Pupil) -> f64 {
        let angles = pupil.angles(&self.segment, 24);
        let [.., fine] = self.along_theta::<5>(&angles);
        let to_ring = lagrange(self.rings, 0.0, 1.0);
        let ring = |rho: f64| -> f64 {
            let rows = to_ring.weights(rho).into_iter().zip(fine.chunks_exact(angles.len()));
            rows.map(|(w, row)| w * row.iter().zip(&angles).map(|(v, a)| v * a.1).sum::<f64>()).sum()
        };
        unit_interval(16).into_iter().map(|(rho, w)| w * rho * ring(rho)).sum()
    }
}
