//! The point spread function of a field point: a Huygens sum of plane wavelets, one per ray.
//!
//!     U(X) = ∫∫ √(Φ J / N) e^{ik(W + L X + M Y)} dp dq      PSF = |U|²,   k = 2π/λ
//!     W = path − L (x − x₀) − M y       X, Y relative to the intersection (x₀, 0) of the chief ray with the film; (x, y) that of the ray
//!     J = |d(L, M)/d(p, q)|,   Φ = flux per dp dq,   (L, M, N) direction cosines in image space
//! Amplitude: |A|² N dL dM is the power of the wavelets in dL dM, which passes through dp dq; so A dL dM = √(Φ J / N) dp dq.
//! A plain FFT of the pupil assumes constant J and N and a round pupil: 5-14 % wrong off axis for a Double Gauss.
//! Total energy: ∫∫ |U|² dX dY = λ² ∫∫ (Φ/N) dp dq (Parseval), so the share inside any window is known without a larger one.
//! Method: W, L, M and the amplitude are smooth over the pupil, so they are interpolated from a few hundred rays at Chebyshev points of
//! (ρ, θ), and checked at rays in between; the integrand oscillates, so the density of its quadrature follows from the window; the sum
//! over its nodes is a nonuniform FFT ([`super::nufft`]). [`direct_sum`] is the same sum without FFT, for tests.
//! Source: Welford, chapter 4 (path); Goodman, Introduction to Fourier Optics, 3.10 (angular spectrum). Scalar; one polarisation.

use crate::real;
use std::f64::consts::PI;

use rustfft::num_complex::Complex;

use super::error::DesignError;
use super::nufft::{Nufft, NufftScratch, Point};
use super::pupil::{Pupil, Segment, unit_interval};
use super::ray::{ImageRay, Tracer};

/// Maximum error of the interpolated phase, rad, and relative error of the amplitude.
const SMOOTH_TOLERANCE: f64 = 2e-6;
/// Maximum half-width of a window for the phase tolerance, µm: 401 film pixels of 2 µm.
const MAX_REACH_UM: f64 = 401.0;

/// The pupil function of a field point: phase, direction cosines and amplitude over the open pupil's upper half.
#[derive(Clone, Debug)]
pub struct PupilFunction {
    wavelength_um: f64,
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
    /// W [µm], L, M, amplitude × B², each rings × spokes.
    tables: [Vec<f64>; 4],
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

impl PupilFunction {
    /// Traces the pupil function of the field point at tan(field angle) `tan`.
    ///
    /// # Errors
    /// [`DesignError::Ray`] if a ray within the apertures does not reach the image.
    pub fn trace(tracer: &Tracer<'_>, tan: f64) -> Result<Self, DesignError> {
        let pupil = Pupil::new(tracer, tan)?;
        let chief = tracer.ray(tan, 0.0, 0.0)?;
        let mut f = Self {
            wavelength_um: tracer.wavelength_um,
            pupil,
            patches: Vec::new(),
            energy: 0.0,
            height_mm: chief.x.v,
            extent: (chief.l.v, chief.l.v, 0.0),
        };
        for segment in f.pupil.segments.clone() {
            let patch = f.patch(tracer, tan, &chief, segment)?;
            f.patches.push(patch);
        }
        for node in f.pupil.nodes(tracer, tan, 16, 24) {
            let r = tracer.ray(tan, node.p, node.q)?;
            f.energy += 2.0 * node.weight * r.flux / r.n;
        }
        f.energy *= f.wavelength_um * f.wavelength_um;
        Ok(f)
    }

    /// Grows the grid until its error at rays between the grid points is below the tolerance.
    fn patch(
        &mut self,
        tracer: &Tracer<'_>,
        tan: f64,
        chief: &ImageRay,
        segment: Segment,
    ) -> Result<Patch, DesignError> {
        let k = 2.0 * PI / self.wavelength_um;
        // The search for the rim costs some rays: once an angle.
        let rims_at = |angles: &[f64]| segment.radii(tracer, tan, angles.iter().copied());
        let sample = |rho: f64, theta: f64, b: f64| -> Result<([f64; 4], ImageRay), DesignError> {
            let (s, c) = real::sin_cos(theta);
            let r = tracer.ray(tan, segment.centre + rho * b * c, rho * b * s)?;
            let path = r.path.v - chief.path.v - r.l.v * (r.x.v - chief.x.v) - r.m.v * r.y.v;
            let amplitude = segment.sign * (r.flux * r.solid_angle() / r.n).sqrt() * b * b;
            Ok(([path * 1e3, r.l.v, r.m.v, amplitude], r))
        };
        let (mut rings, mut spokes) = (12, 14);
        let mut extent = self.extent;
        loop {
            let rho = chebyshev(rings, 0.0, 1.0);
            let theta = chebyshev(spokes, segment.from, segment.to);
            let rims = rims_at(&theta);
            let mut tables = [const { Vec::new() }; 4];
            let (mut radial, mut angular) = ((0.0_f64, 0.0_f64), (0.0_f64, 0.0_f64));
            for r in &rho {
                for (t, b) in std::iter::zip(&theta, &rims) {
                    let (values, ray) = sample(*r, *t, *b)?;
                    for (table, v) in tables.iter_mut().zip(values) {
                        table.push(v);
                    }
                    extent = (extent.0.min(ray.l.v), extent.1.max(ray.l.v), extent.2.max(ray.m.v));
                    let (s, c) = real::sin_cos(*t);
                    let shift = [(ray.x.v - chief.x.v) * 1e3, ray.y.v * 1e3];
                    for (bound, [p, q]) in [(&mut radial, [c, s]), (&mut angular, [-s * r, c * r])] {
                        let (dl, dm) =
                            (b * (ray.l.d[0] * p + ray.l.d[1] * q), b * (ray.m.d[0] * p + ray.m.d[1] * q));
                        bound.0 = bound.0.max(real::hypot(dl, dm));
                        bound.1 = bound.1.max((shift[0] * dl + shift[1] * dm).abs());
                    }
                }
            }
            let patch = Patch { segment, rings, spokes, tables, radial, angular };
            let mut worst = [0.0_f64; 4];
            let size = patch.tables[3].iter().fold(1e-300_f64, |a, v| a.max(v.abs()));
            let between = [0.011, 0.34, 0.72, 0.988].map(|t| segment.from + t * (segment.to - segment.from));
            for (theta, b) in between.into_iter().zip(rims_at(&between)) {
                for r in [0.013, 0.51, 0.96, 0.999] {
                    let (expected, _) = sample(r, theta, b)?;
                    let got = patch.at(r, theta);
                    let weight = [k, k * MAX_REACH_UM, k * MAX_REACH_UM, 1.0 / size];
                    for i in 0..4 {
                        worst[i] = worst[i].max(weight[i] * (got[i] - expected[i]).abs());
                    }
                }
            }
            if worst.iter().all(|w| *w < SMOOTH_TOLERANCE) || rings >= 60 {
                self.extent = extent;
                return Ok(patch);
            }
            // The direction of the error is not known: both grow.
            rings = rings * 4 / 3;
            spokes = spokes * 4 / 3;
        }
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
            let fine = patch.along_theta(&spokes);
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
                    let c = Complex::from_polar(rows[3][i] * wr * wt * rho, k * rows[0][i]);
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
    fn share(&self, pitch_um: f64) -> f64 {
        pitch_um * pitch_um / self.energy
    }
}

/// Computes PSFs on a window of n × n samples at one pitch.
#[derive(Debug)]
pub struct PsfGrid {
    nufft: Nufft,
    pitch_um: f64,
}

/// Buffers of one worker.
#[derive(Default)]
pub struct PsfScratch {
    nufft: NufftScratch,
    points: Vec<Point>,
    field: Vec<Complex<f64>>,
}

impl PsfGrid {
    /// Windows of `2·half + 1` samples of `pitch_um`.
    pub fn new(half: usize, pitch_um: f64) -> Self {
        Self { nufft: Nufft::new(half), pitch_um }
    }

    /// Samples per side.
    pub fn size(&self) -> usize {
        self.nufft.size()
    }

    /// Sample pitch, µm.
    pub fn pitch_um(&self) -> f64 {
        self.pitch_um
    }

    fn reach_um(&self) -> f64 {
        self.pitch_um * (self.size() / 2) as f64
    }

    /// The PSF rotated by `azimuth_rad` (row down: from +x towards +y), as shares of the total energy per sample.
    pub fn psf(&self, f: &PupilFunction, azimuth_rad: f64, scratch: &mut PsfScratch) -> Vec<f64> {
        // Without rotation the lower half of the pupil gives the mirrored field, which is not summed.
        let unrotated = azimuth_rad == 0.0;
        let scale = self.pitch_um / f.wavelength_um;
        scratch.points.clear();
        let wavelets = f.wavelets(self.reach_um(), azimuth_rad, !unrotated);
        scratch.points.extend(wavelets.iter().map(|w| Point { s: w.l * scale, t: w.m * scale, c: w.c }));
        self.nufft.sum(&scratch.points, &mut scratch.nufft, &mut scratch.field);
        let (n, share) = (self.size(), f.share(self.pitch_um));
        let field = &scratch.field;
        if !unrotated {
            return field.iter().map(|u| u.norm_sqr() * share).collect();
        }
        let mut out = Vec::with_capacity(n * n);
        for y in 0..n {
            let mirror = &field[(n - 1 - y) * n..][..n];
            out.extend(field[y * n..][..n].iter().zip(mirror).map(|(a, b)| (a + b).norm_sqr() * share));
        }
        out
    }
}

/// The Huygens sum without FFT: the same wavelets, summed for every sample.
pub fn direct_sum(f: &PupilFunction, half: usize, pitch_um: f64, azimuth_rad: f64) -> Vec<f64> {
    let wavelets = f.wavelets(pitch_um * half as f64, azimuth_rad, true);
    let k = 2.0 * PI / f.wavelength_um;
    let n = 2 * half + 1;
    let at = |i: usize| (i as f64 - half as f64) * pitch_um;
    let mut out = Vec::with_capacity(n * n);
    for y in 0..n {
        for x in 0..n {
            let u: Complex<f64> = wavelets
                .iter()
                .map(|w| w.c * Complex::from_polar(1.0, k * (w.l * at(x) + w.m * at(y))))
                .sum();
            out.push(u.norm_sqr() * f.share(pitch_um));
        }
    }
    out
}

impl Patch {
    /// The tables at the angles of `spokes`: rings × spokes.
    fn along_theta(&self, spokes: &[(f64, f64)]) -> [Vec<f64>; 4] {
        let basis = lagrange(self.spokes, self.segment.from, self.segment.to);
        let weights: Vec<f64> = spokes.iter().flat_map(|(t, _)| basis.weights(*t)).collect();
        [0, 1, 2, 3].map(|i| {
            let mut fine = Vec::with_capacity(self.rings * spokes.len());
            for ring in self.tables[i].chunks_exact(self.spokes) {
                fine.extend(
                    weights
                        .chunks_exact(self.spokes)
                        .map(|w| w.iter().zip(ring).map(|(a, b)| a * b).sum::<f64>()),
                );
            }
            fine
        })
    }

    fn at(&self, rho: f64, theta: f64) -> [f64; 4] {
        let fine = self.along_theta(&[(theta, 1.0)]);
        let w = lagrange(self.rings, 0.0, 1.0).weights(rho);
        fine.map(|column| column.iter().zip(&w).map(|(a, b)| a * b).sum())
    }
}

/// Chebyshev points of the first kind on [a, b], ascending.
fn chebyshev(n: usize, a: f64, b: f64) -> Vec<f64> {
    let x = |i: usize| -real::cos(PI * (i as f64 + 0.5) / n as f64);
    (0..n).map(|i| a + (b - a) * 0.5 * (1.0 + x(i))).collect()
}

/// Interpolation through Chebyshev points, in barycentric form (Berrut & Trefethen, SIAM Review 46, 2004).
struct Lagrange {
    points: Vec<f64>,
}

fn lagrange(n: usize, a: f64, b: f64) -> Lagrange {
    Lagrange { points: chebyshev(n, a, b) }
}

impl Lagrange {
    fn weights(&self, x: f64) -> Vec<f64> {
        let n = self.points.len();
        if let Some(hit) = self.points.iter().position(|p| *p == x) {
            return (0..n).map(|i| if i == hit { 1.0 } else { 0.0 }).collect();
        }
        let mut sum = 0.0;
        let mut w: Vec<f64> = (0..n)
            .map(|i| {
                let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
                let v = sign * real::sin(PI * (i as f64 + 0.5) / n as f64) / (x - self.points[i]);
                sum += v;
                v
            })
            .collect();
        w.iter_mut().for_each(|v| *v /= sum);
        w
    }
}
