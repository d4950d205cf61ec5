//! The far tail of a PSF, from the edge of the pupil, in closed form.
//!
//! ```text
//! I(r) = C / r³,    C = λ ∮ |A|² ds / (4 π³ ∬ |A|² dL dM)          light outside r: 2 π C / r
//! ```
//! I is the mean over azimuth of the irradiance at the distance r from a field point of light 1, far beyond its geometric blur; |A|² the light
//! per dL dM, ds the length along the edge in direction cosines (L, M), both of the pupil's outer rim and of obscurations. A round, uniform
//! pupil has C = λ N/π³. In the terms of [`super::function`] |A|² = Φ/(N J) = (Φ/N)²/(Φ J/N), ∬ |A|² dL dM = ∬ Φ/N dp dq.
//!
//! The edge rays' geometric blur: dW = −(x dL + y dM), (x, y) the landing point relative to the chief ray, so (x, y) follow from the slopes
//! of W, L and M along and across the edge.
//!
//! Assumption: the edges are those of the domains of [`super::openings`]. Where an obscuration reaches beyond an aperture, the piece of the aperture's
//! rim that it hides is no edge and is subtracted.
//! Source: stationary phase of the Huygens sum at the edge (Born & Wolf, appendix III), averaged over azimuth and fringes;
//! for a round pupil Born & Wolf, 8.5.2 (encircled energy 1 − 2/(π v)).

use std::f64::consts::PI;

use super::function::{Patch, PupilFunction};
use crate::real;

/// Intervals of the angle on each segment of the rim.
const STEPS: usize = 96;
/// Distances for the slopes: of ρ, and of θ in shares of a segment.
const NEAR: f64 = 0.01;

/// The edge of a pupil.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::design) struct Edge {
    /// C of the far tail, µm.
    pub tail_um: f64,
    /// Largest distance of an edge ray from the chief ray on the film, µm.
    pub blur_um: f64,
}

impl PupilFunction {
    /// The edge of the pupil; `surfaces`: the number of surfaces, from which on those of obscurations are counted.
    pub(in crate::design) fn edge(&self, surfaces: usize) -> Edge {
        let (mut around, mut blur) = (0.0, 0.0_f64);
        for patch in &self.patches {
            let is_aperture = patch.segment.limit.is_none_or(|limit| limit < surfaces);
            let sign = if patch.segment.sign < 0.0 && is_aperture { -1.0 } else { 1.0 };
            let (length, shift) = patch.rim();
            around += sign * length;
            blur = blur.max(shift);
        }
        // The lower half of the pupil may be the mirror image of the upper one.
        let around = self.parts() * around;
        Edge { tail_um: self.wavelength_um * around / (4.0 * PI.powi(3) * self.power()), blur_um: blur }
    }
}

impl Patch {
    /// ∫ |A|² ds along the rim, and the largest distance of its rays from the chief ray, µm.
    fn rim(&self) -> (f64, f64) {
        let (from, span) = (self.segment.from, self.segment.to - self.segment.from);
        let at = |rho: f64, share: f64| self.at(rho, from + span * share);
        let power = |[_, _, _, amplitude, flux]: [f64; 5]| (flux / amplitude).powi(2);
        let (mut sum, mut blur) = (0.0, 0.0_f64);
        let mut last = at(1.0, 0.0);
        for i in 1..=STEPS {
            let this = at(1.0, i as f64 / STEPS as f64);
            sum += 0.5 * (power(last) + power(this)) * real::hypot(this[1] - last[1], this[2] - last[2]);
            last = this;
        }
        for i in 0..=STEPS / 4 {
            let share = (4.0 * i as f64 / STEPS as f64).clamp(NEAR, 1.0 - NEAR);
            let difference = |a: [f64; 5], b: [f64; 5]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
            // The slope at the edge, not a step inwards: three points.
            let [edge, near, far] = [0.0, NEAR, 2.0 * NEAR].map(|step| at(1.0 - step, share));
            let u: [f64; 3] = std::array::from_fn(|i| 3.0 * edge[i] - 4.0 * near[i] + far[i]);
            let v = difference(at(1.0, share + NEAR), at(1.0, share - NEAR));
            // −(x u_L + y u_M) = u_W, the same for v.
            let determinant = u[1] * v[2] - u[2] * v[1];
            let (x, y) = (u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]);
            blur = blur.max(real::hypot(x, y) / determinant.abs());
        }
        (sum, blur)
    }
}
