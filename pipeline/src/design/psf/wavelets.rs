//! Plane wavelets of a pupil function: the nodes of the quadrature of the Huygens sum ([`super::huygens`]).
//!
//! ```text
//! c = √(Φ J / N) e^{ikW} · w,    w = weight of the quadrature in dp dq,    k = 2π/λ
//! ```
//! The integrand of a point X of the film oscillates with k (W + L X + M Y). Its change of phase per unit of ρ and of θ is at most
//! κ = k (√2 reach · |d(L, M)| + |dW|), so the density of the nodes follows from the window: about one per period in each direction
//! ([`oscillating`]). Inner rings have fewer of them in θ, and groups of rings where rays change less have fewer rings.

use std::f64::consts::PI;

use rustfft::num_complex::Complex;

use crate::design::pupil::chebyshev::lagrange;
use crate::design::pupil::function::{Patch, PupilFunction};
use crate::design::pupil::quadrature::oscillating;
use crate::real;

/// Margin of the slopes between neighbouring points, which are below the maximum in between.
const MARGIN: f64 = 1.03;
/// Groups of rings of equal width in ρ that have their own quadrature.
const RING_GROUPS: u8 = 4;
/// Change of phase over ρ from which on they pay, rad: by diffraction at the corner of the window, and by aberrations.
const WIDE: f64 = 400.0;
const ABERRATED: f64 = 2000.0;

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

/// Angles of the rings of a patch, as many as one of them needs.
#[derive(Default)]
struct Spokes {
    /// Weights of the quadrature.
    weights: Vec<f64>,
    /// Value at each angle from those at the points of the patch: points × angles.
    from_points: Vec<f64>,
}

impl PupilFunction {
    /// Wavelets dense enough for a window of ± `reach_um` in x and y, rotated by `azimuth_rad`; `mirrored` adds the lower half of the
    /// pupil, if this function has only the upper one.
    pub fn wavelets(&self, reach_um: f64, azimuth_rad: f64, mirrored: bool) -> Vec<Wavelet> {
        let k = 2.0 * PI / self.wavelength_um;
        let corner = std::f64::consts::SQRT_2 * reach_um;
        let (sin, cos) = real::sin_cos(azimuth_rad);
        let mirrored = mirrored && !self.is_whole;
        let middle = self.extent.map(|(least, most)| 0.5 * (least + most));
        let mut out = Vec::new();
        for patch in &self.patches {
            let to_ring = lagrange(patch.rings, 0.0, 1.0);
            let (diffraction, aberration) = patch.change(0.0, 1.0).1;
            let is_wide = k * corner * diffraction > WIDE || k * aberration > ABERRATED;
            let groups = if is_wide { RING_GROUPS } else { 1 };
            let mut spokes = Spokes::default();
            for group in 0..groups {
                let [from, to] = [group, group + 1].map(|g| f64::from(g) / f64::from(groups));
                let changes = patch.change(from, to);
                let [along_rho, along_theta] =
                    [changes.0, changes.1].map(|(lm, w)| MARGIN * k * (corner * lm + w));
                for (share, weight) in oscillating(along_rho * (to - from)).iter() {
                    let rho = from + (to - from) * share;
                    let weight = (to - from) * weight * rho;
                    spokes.prepare(patch, along_theta * rho);
                    let [w, l, m, amplitude] = spokes.values(patch, &to_ring.weights(rho));
                    for (i, weight_in_theta) in spokes.weights.iter().enumerate() {
                        let (sin_w, cos_w) = real::sin_cos(k * w[i]);
                        let c = Complex::new(cos_w, sin_w) * (amplitude[i] * weight * weight_in_theta);
                        let (l, m) = (l[i] - middle[0], m[i] - middle[1]);
                        out.push(Wavelet { l: l * cos - m * sin, m: l * sin + m * cos, c });
                        if mirrored {
                            out.push(Wavelet { l: l * cos + m * sin, m: l * sin - m * cos, c });
                        }
                    }
                }
            }
        }
        out
    }
}

impl Spokes {
    /// Angles of `patch` for an integrand whose phase changes by at most `change` per radian.
    fn prepare(&mut self, patch: &Patch, change: f64) {
        let angles = patch.segment.angles(change);
        // The same number at the ring before: the same angles.
        if angles.len() == self.weights.len() {
            return;
        }
        let basis = lagrange(patch.spokes, patch.segment.from, patch.segment.to);
        self.from_points = vec![0.0; patch.spokes * angles.len()];
        for (i, (theta, _)) in angles.iter().enumerate() {
            for (point, weight) in basis.weights(*theta).into_iter().enumerate() {
                self.from_points[point * angles.len() + i] = weight;
            }
        }
        self.weights = angles.into_iter().map(|(_, weight)| weight).collect();
    }

    /// W, L, M and amplitude at the angles, on the ring with the weights `to_ring` of the rings of `patch`.
    fn values(&self, patch: &Patch, to_ring: &[f64]) -> [Vec<f64>; 4] {
        std::array::from_fn(|table| {
            let mut at_points = vec![0.0; patch.spokes];
            for (weight, row) in to_ring.iter().zip(patch.tables[table].chunks_exact(patch.spokes)) {
                at_points.iter_mut().zip(row).for_each(|(to, v)| *to += weight * v);
            }
            let mut values = vec![0.0; self.weights.len()];
            for (v, row) in at_points.iter().zip(self.from_points.chunks_exact(self.weights.len())) {
                values.iter_mut().zip(row).for_each(|(to, weight)| *to += weight * v);
            }
            values
        })
    }
}
