//! Real rays along a ghost path.
//!
//! Rays start in the plane of the first vertex, from an object point of the meridian. A ray that misses a surface, arrives at one from behind or is totally reflected ends. One that
//! a clear radius or an obscuration blocks is followed on, as long as it can be: its overshoot is the largest r/a − 1 (clear radius) or 1 − r/a (obscuration) of its
//! crossings, so that the rim of the light can be found between rays.

use super::path::{Act, Crossing, GhostLens};
use crate::design::rays::surface::Ray;

/// How a ray meets a surface, for its light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meeting {
    /// Cosine of the angle of incidence.
    pub cos: f64,
    /// Cosine and sine of the turn from the s direction of the surface before to that of this one, about the ray.
    pub turn: [f64; 2],
    /// Distance from the surface before, mm.
    pub length_mm: f64,
}

/// Where a ray lands on the film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landing {
    /// x, mm: the image of the object point lies on +x.
    pub x: f64,
    /// y, mm.
    pub y: f64,
    /// Largest overshoot of a clear radius or an obscuration: not positive if nothing blocks the ray.
    pub overshoot: f64,
}

/// Distance that rounding may put behind a surface, mm.
const BEHIND_MM: f64 = -1e-9;
/// Sine of an angle of incidence below which all directions across the ray are s.
const NORMAL_INCIDENCE: f64 = 1e-12;

impl GhostLens<'_> {
    /// The ray from the object point at tan(field angle) `tan` through (x, y) in the plane of the first vertex, and the flux per dx dy: 1 for an object at infinity, else
    /// d(L, M)/d(x, y) at the object.
    pub(super) fn start(&self, tan: f64, x: f64, y: f64) -> (Ray<f64>, f64) {
        let tan = self.tracer.image_sign() * tan;
        let p = [x, y, 0.0];
        let Some(distance) = self.tracer.object_distance_mm() else {
            let n = 1.0 / (1.0 + tan * tan).sqrt();
            return (Ray { p, d: [tan * n, 0.0, n], path: 0.0 }, 1.0);
        };
        let dx = x + tan * (distance + self.tracer.primary.entrance_pupil_mm);
        let length = (dx * dx + y * y + distance * distance).sqrt();
        let flux = distance * distance / length.powi(4);
        (Ray { p, d: [dx / length, y / length, distance / length], path: 0.0 }, flux)
    }

    /// Follows the ray from `start` along `crossings`; how it meets each surface but the last goes to `meetings`. None if it ends on the way.
    pub(super) fn follow(
        &self,
        crossings: &[Crossing<'_>],
        start: Ray<f64>,
        meetings: &mut Vec<Meeting>,
    ) -> Option<Landing> {
        meetings.clear();
        let (mut ray, mut overshoot) = (start, f64::NEG_INFINITY);
        let mut across = transverse(ray.d);
        // Distance since the last surface that bends light: none before the first one.
        let mut since = f64::INFINITY;
        let last = crossings.len() - 1;
        for (index, crossing) in crossings.iter().enumerate() {
            let before = ray.path;
            crossing.shape.meet(&mut ray, 1.0).ok()?;
            let length_mm = ray.path - before;
            since += length_mm;
            if crossing.is_boundary && since < BEHIND_MM {
                return None;
            }
            if index == last {
                // Meetings end before the film, the way to it is absorbed, too.
                meetings.push(Meeting { cos: 1.0, turn: [1.0, 0.0], length_mm });
                return Some(Landing { x: ray.p[0], y: ray.p[1], overshoot });
            }
            let r = (ray.p[0] * ray.p[0] + ray.p[1] * ray.p[1]).sqrt();
            overshoot = overshoot.max(r / self.apertures.clear_mm[crossing.surface] - 1.0);
            if let Some(hidden) = self.apertures.hidden_mm[crossing.surface] {
                overshoot = overshoot.max(1.0 - r / hidden);
            }
            if !crossing.is_boundary {
                meetings.push(Meeting { cos: 1.0, turn: [1.0, 0.0], length_mm });
                ray.p[2] -= crossing.gap_mm;
                continue;
            }
            since = 0.0;
            let d = ray.d;
            let m = crossing.shape.normal(&ray).ok()?;
            let s = cross(d, m);
            let sine = dot(s, s).sqrt();
            let s = if sine > NORMAL_INCIDENCE { s.map(|v| v / sine) } else { across };
            let turn = [dot(across, s), dot(cross(d, across), s)];
            meetings.push(Meeting { cos: dot(d, m).abs().min(1.0), turn, length_mm });
            match (crossing.act, &crossing.ideal) {
                (Act::Reflects | Act::Mirrors, _) => crossing.shape.reflect(&mut ray).ok()?,
                (_, Some(ideal)) => ideal.bend(&mut ray, crossing.indices.0, crossing.indices.1).ok()?,
                _ => crossing.shape.refract(&mut ray, crossing.indices.0, crossing.indices.1).ok()?,
            }
            across = s;
            if matches!(crossing.act, Act::Reflects | Act::Mirrors) {
                across[2] = -across[2];
            }
            ray.p[2] -= crossing.gap_mm;
        }
        None
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A unit vector at right angles to `d`.
fn transverse(d: [f64; 3]) -> [f64; 3] {
    let reference = if d[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let u = cross(reference, d);
    let length = dot(u, u).sqrt();
    u.map(|v| v / length)
}
