//! An ideal thin lens (the surface type PARAXIAL of design programs): every point is imaged to a point, whatever the aperture.
//!
//! ```text
//! n' τ' = n τ − P/f                          τ, τ' slopes (L/N, M/N) before and behind, P = (x, y) on the lens, f focal length [mm]
//! φ = n (v P² − 2 τ·P)/(T + A) + n' (v' P² + 2 τ'·P)/(T' + A')
//! v = 1/s,  n' v' = 1/f − n v,  a = P v − τ,  a' = P v' + τ',  A = √(1 + a²),  T = √(1 + τ²), A', T' likewise
//! ```
//! φ is the optical path that the lens adds: all paths from the object point O, which the ray passes at the distance s before the lens, to its
//! image O' at s' = 1/v' behind it are equal to that through the centre of the lens,
//! ```text
//! φ = n (|O| − |O P|) + n' (|O'| − |P O'|)   (both signs reversed for a virtual O, O'),
//! ```
//! which is written with vergences, so that objects and images at infinity are no special case. s is that of the axial object point at
//! this wavelength, by first-order optics; at an image (a field lens) φ = 0. For a bundle that has aberrations before the lens φ is exact to first
//! order in them, as no real surface images all points of space to points.
//! Source: Born & Wolf, section 4.3.1 (collinear imaging of a centred system); path: Fermat's principle for conjugate points.

use super::scalar::Scalar;
use super::surface::{Ray, Stopped};
use crate::design::prescription::system::System;

/// An ideal lens for one wavelength and object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::design) struct IdealLens {
    focal_mm: f64,
    /// 1/s of the axial object point, 1/mm; none if it lies on the lens.
    vergence: Option<f64>,
}

/// The ideal lens of each surface of `system`, if it is one, for the `indices` in front of the surfaces.
pub(super) fn ideal_lenses(system: &System, indices: &[f64]) -> Vec<Option<IdealLens>> {
    let (mut y, mut u) = system.object_distance_mm.map_or((1.0, 0.0), |d| (d, 1.0));
    let mut lenses = Vec::with_capacity(system.surfaces.len());
    for (i, s) in system.surfaces.iter().enumerate() {
        let vergence = Some(u / y).filter(|v: &f64| v.is_finite());
        lenses.push(s.ideal_focal_mm.map(|focal_mm| IdealLens { focal_mm, vergence }));
        if i < system.image() {
            u = s.slope_behind((y, u), (indices[i], indices[i + 1]));
            y += s.thickness_mm * u;
        }
    }
    lenses
}

impl IdealLens {
    /// A lens that bends rays and adds no path.
    pub(in crate::design) fn without_path(focal_mm: f64) -> Self {
        Self { focal_mm, vergence: None }
    }

    /// Bends `ray`, which is on the lens, from index `n1` to `n2`, and adds the path φ.
    ///
    /// # Errors
    /// [`Stopped::Misses`] for a ray along the lens.
    pub(in crate::design) fn bend<T: Scalar>(
        &self,
        ray: &mut Ray<T>,
        n1: f64,
        n2: f64,
    ) -> Result<(), Stopped> {
        let [x, y, _] = ray.p;
        let [l, m, n] = ray.d;
        if n.value() <= 0.0 {
            return Err(Stopped::Misses);
        }
        let (one, two) = (T::of(1.0), T::of(2.0));
        let before = [l / n, m / n];
        let power = T::of(1.0 / self.focal_mm);
        let [tx, ty] = [x, y].map(|p| p * power);
        let behind = [(T::of(n1) * before[0] - tx) / T::of(n2), (T::of(n1) * before[1] - ty) / T::of(n2)];
        let length = |s: [T; 2]| (one + s[0] * s[0] + s[1] * s[1]).sqrt();
        let (t1, t2) = (length(before), length(behind));
        ray.d = [behind[0] / t2, behind[1] / t2, one / t2];
        let Some(v1) = self.vergence else { return Ok(()) };
        let v2 = (1.0 / self.focal_mm - n1 * v1) / n2;
        let square = x * x + y * y;
        let dot = |s: [T; 2]| x * s[0] + y * s[1];
        let a1 = length([x * T::of(v1) - before[0], y * T::of(v1) - before[1]]);
        let a2 = length([x * T::of(v2) + behind[0], y * T::of(v2) + behind[1]]);
        ray.path = ray.path
            + T::of(n1) * (T::of(v1) * square - two * dot(before)) / (t1 + a1)
            + T::of(n2) * (T::of(v2) * square + two * dot(behind)) / (t2 + a2);
        Ok(())
    }
}
