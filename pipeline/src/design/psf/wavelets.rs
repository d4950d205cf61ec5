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
use crate::real::cos_sin_of_turns;
use crate::simd::lanes::{Lanes, SimdOp};
use crate::simd::{Simd, UnfusedOp};

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

/// Angles that one operation works on.
const ANGLES: usize = 8;

/// Angles of the rings of a patch, as many as one of them needs.
#[derive(Default)]
struct Spokes {
    /// Weights of the quadrature.
    weights: Vec<f64>,
    /// Value at each angle from those at the points of the patch: for each [`ANGLES`] of them, the weights of every point.
    from_points: Vec<[f64; ANGLES]>,
    /// W, L, M and amplitude at the points of a ring.
    at_points: Vec<[f64; 4]>,
    /// L, M and real and imaginary part of the amplitude times e^{ikW} at each angle of it.
    values: Vec<[[f64; ANGLES]; 4]>,
}

impl PupilFunction {
    /// Wavelets of light of `wavelength_um` dense enough for a window of ± `reach_um` in x and y, of the part of the pupil that this function has, into `out`.
    pub(super) fn wavelets_into(&self, reach_um: f64, wavelength_um: f64, out: &mut Vec<Wavelet>) {
        let (simd, k) = (Simd::detect(), 2.0 * PI / wavelength_um);
        let corner = std::f64::consts::SQRT_2 * reach_um;
        let middle = self.extent.map(|(least, most)| 0.5 * (least + most));
        out.clear();
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
                    spokes.interpolate(simd, patch, &to_ring.weights(rho), wavelength_um);
                    let angles = spokes.weights.chunks(ANGLES).zip(&spokes.values);
                    out.extend(angles.flat_map(|(weights, [l, m, re, im])| {
                        weights.iter().enumerate().map(move |(i, weight_in_theta)| Wavelet {
                            l: l[i] - middle[0],
                            m: m[i] - middle[1],
                            c: Complex::new(re[i], im[i]) * (weight * weight_in_theta),
                        })
                    }));
                }
            }
        }
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
        let parts = angles.len().div_ceil(ANGLES);
        self.from_points = vec![[0.0; ANGLES]; patch.spokes * parts];
        for (i, (theta, _)) in angles.iter().enumerate() {
            let part = &mut self.from_points[i / ANGLES * patch.spokes..][..patch.spokes];
            for (point, weight) in part.iter_mut().zip(basis.weights(*theta)) {
                point[i % ANGLES] = weight;
            }
        }
        self.values.resize(parts, [[0.0; ANGLES]; 4]);
        self.weights = angles.into_iter().map(|(_, weight)| weight).collect();
    }

    /// Computes the values at the angles, on the ring with the weights `to_ring` of the rings of `patch`.
    fn interpolate(&mut self, simd: Simd, patch: &Patch, to_ring: &[f64], wavelength_um: f64) {
        self.at_points.clear();
        self.at_points.resize(patch.spokes, [0.0; 4]);
        OnRing { spokes: self, patch, to_ring, wavelength_um }.run_unfused(simd);
    }
}

/// Computes the values on a ring.
struct OnRing<'a> {
    spokes: &'a mut Spokes,
    patch: &'a Patch,
    to_ring: &'a [f64],
    wavelength_um: f64,
}

impl<V: Lanes> SimdOp<V> for OnRing<'_> {
    #[inline(always)]
    fn run(self) {
        let Self { spokes: Spokes { from_points, at_points, values, .. }, patch, to_ring, wavelength_um } =
            self;
        for (table, samples) in patch.tables[..4].iter().enumerate() {
            for (weight, row) in to_ring.iter().zip(samples.chunks_exact(patch.spokes)) {
                at_points.iter_mut().zip(row).for_each(|(to, v)| to[table] += weight * v);
            }
        }
        for (to, weights) in values.iter_mut().zip(from_points.chunks_exact(patch.spokes)) {
            // In registers.
            let mut sums = [[0.0; ANGLES]; 4];
            for (at, weights) in at_points.iter().zip(weights) {
                for table in 0..4 {
                    for i in 0..ANGLES {
                        sums[table][i] += weights[i] * at[table];
                    }
                }
            }
            let [w, l, m, amplitude] = sums;
            let (mut re, mut im) = ([0.0; ANGLES], [0.0; ANGLES]);
            for i in 0..ANGLES {
                let [cos, sin] = cos_sin_of_turns(w[i] / wavelength_um);
                (re[i], im[i]) = (amplitude[i] * cos, amplitude[i] * sin);
            }
            *to = [l, m, re, im];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::prescription::system::System;
    use crate::design::rays::ray::Tracer;
    use crate::simd::Isa;

    #[test]
    fn values_on_a_ring_have_the_same_bits_with_any_instructions() {
        let system = System::double_gauss_28();
        let f = PupilFunction::trace(&Tracer::new(&system, 0.55).unwrap(), 0.15).unwrap();
        let patch = &f.patches[0];
        let to_ring = lagrange(patch.rings, 0.0, 1.0).weights(0.7);
        let values = |simd| {
            let mut spokes = Spokes::default();
            spokes.prepare(patch, 40.0);
            spokes.interpolate(simd, patch, &to_ring, f.wavelength_um);
            spokes.values
        };
        let expected = values(Simd::PORTABLE);
        assert!(expected.iter().flatten().flatten().any(|v| *v != 0.0));
        for simd in Isa::ALL.into_iter().filter_map(|isa| Simd::require(isa).ok()) {
            assert!(values(simd) == expected, "{simd:?}: other bits");
        }
    }
}
