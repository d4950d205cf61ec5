//! Ray aiming: the point of the entrance pupil plane for a pupil coordinate, and the chief rays of all field angles.
//!
//! *Paraxial aiming*: the point (p, q)·R of the paraxial entrance pupil. *Real aiming*: the point whose ray crosses the stop at (p, q)·(real
//! radius of the axial marginal ray), by Newton's method with exact derivatives. In a wide-angle lens the real pupil moves along the axis with
//! the field angle θ, in first order by δ ∝ θ², so a ray at 85° aimed at the paraxial pupil misses the lens. The chief rays are therefore
//! followed from the axis outwards in steps of the angle: the shift δ of each is extrapolated as a polynomial in θ² through the three before,
//! and the step is halved where Newton's method fails. The first guess of any other ray is the chief ray of its field angle plus
//! the derivatives there by (p, q), or the ray that a search has aimed before it ([`LastAim`]).
//! The list ends where no chief ray crosses the stop and reaches the image, or at 89.5°.

use std::cell::Cell;
use std::f64::consts::PI;

use super::ray::{Lost, Tracer};
use super::stop_point::{PupilPoint, aimed, approached};
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::RayAiming;
use crate::real;

/// Step of the chief rays' angle, rad.
const STEP: f64 = PI / 180.0;
/// Minimum step after a failure, rad.
const MIN_STEP: f64 = STEP / 64.0;
/// Maximum angle, rad: 89.5 degrees.
const MAX_ANGLE: f64 = 179.0 * PI / 360.0;
/// Steps of the angle that are tried, 179 where none fails.
const MAX_STEPS: u32 = 1000;

/// Length of the last step of Newton's method, of the entrance pupil's radius: the point is then known to about its square. Chief rays are followed with a shorter one, as
/// heights are brackets of others.
pub(super) const SHORT: f64 = 1e-6;
const SHORT_OF_CHIEFS: f64 = 1e-9;
/// Distance in pupil coordinates up to which the next ray is aimed from the last one.
const NEAR: f64 = 0.3;

/// The chief ray of one field angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ChiefRay {
    /// Angle at the paraxial entrance pupil, rad.
    pub(super) angle: f64,
    /// Tangent of the angle.
    pub(super) tan: f64,
    /// Point in the plane of the paraxial entrance pupil, mm, and its derivatives by p (x) and q (y).
    at: [f64; 3],
    /// Height in the image plane, mm.
    pub(super) height_mm: f64,
}

/// Chief rays from the axis to the largest angle at which one reaches the image, and why the next does not.
#[derive(Clone, Debug)]
pub(super) struct ChiefRays {
    pub(super) rays: Vec<ChiefRay>,
    pub(super) end: Option<DesignError>,
}

/// The ray that a search has aimed last, from which it aims the next: tan of its field, pupil coordinates, and point. The last digits of a ray depend on the order of the search,
/// which is the same in every run: one thread has it.
#[derive(Debug, Default)]
pub(in crate::design) struct LastAim(Cell<Option<(f64, [f64; 2], PupilPoint)>>);

impl LastAim {
    /// First guess for (p, q), if the last ray was of the same field and is near.
    fn guess(&self, tan: f64, p: f64, q: f64) -> Option<[f64; 2]> {
        let (of_tan, [p0, q0], PupilPoint { at, by }) = self.0.get()?;
        let [dp, dq] = [p - p0, q - q0];
        let is_near = of_tan == tan && real::hypot(dp, dq) < NEAR;
        is_near.then(|| [0, 1].map(|i| at[i] + by[i][0] * dp + by[i][1] * dq))
    }

    pub(super) fn set(&self, tan: f64, p: f64, q: f64, point: PupilPoint) {
        self.0.set(Some((tan, [p, q], point)));
    }
}

impl Tracer<'_> {
    /// The point of the entrance pupil plane, mm, for pupil coordinates (p, q).
    pub(super) fn aim(&self, tan: f64, p: f64, q: f64) -> Result<[f64; 2], DesignError> {
        self.aim_from(&LastAim::default(), tan, (p, q), SHORT)
    }

    /// [`Tracer::aim`] in a search that has aimed at `last`, after a step shorter than `short` of the entrance pupil's radius.
    pub(super) fn aim_from(
        &self,
        last: &LastAim,
        tan: f64,
        (p, q): (f64, f64),
        short: f64,
    ) -> Result<[f64; 2], DesignError> {
        let radius = self.primary.entrance_radius_mm;
        if self.aiming() == RayAiming::Paraxial {
            return Ok([p * radius, q * radius]);
        }
        let newton = |p: f64, q: f64, at: [f64; 2]| self.newton(tan, (p, q), at, short * radius);
        if let Some(guess) = last.guess(tan, p, q)
            && let Ok(point) = newton(p, q, guess)
        {
            last.set(tan, p, q, point);
            return Ok(point.at);
        }
        let [x, dx, dy] = if tan == 0.0 { [0.0, radius, radius] } else { self.chiefs().near(tan) };
        let point = newton(p, q, [x + p * dx, q * dy]).or_else(|first| {
            if (p, q) == (0.0, 0.0) {
                return Err(first);
            }
            let centre = newton(0.0, 0.0, [x, 0.0]).map_err(|_| first.clone())?;
            approached(centre, (p, q), newton).map_err(|_| first)
        })?;
        last.set(tan, p, q, point);
        Ok(point.at)
    }

    fn newton(
        &self,
        tan: f64,
        (p, q): (f64, f64),
        at: [f64; 2],
        short_mm: f64,
    ) -> Result<PupilPoint, DesignError> {
        let found = aimed((p, q), self.stop_scale_mm(), at, short_mm, |[x, y]| {
            self.count_ray(tan)?;
            let hit = self.run(self.launch(tan, x, y), self.stop(), |_, _| {});
            let [x, y, ..] = hit.map_err(|lost| self.lost_in_search(tan, p, q, lost))?.p;
            Ok([x, y])
        })?;
        found.ok_or_else(|| self.not_aimed(tan, p, q))
    }

    pub(super) fn not_aimed(&self, tan: f64, p: f64, q: f64) -> DesignError {
        self.ray_error(tan, p, q, "cannot be aimed at the stop".to_owned())
    }

    /// Follows the chief rays from the axis outwards.
    pub(super) fn follow_chiefs(&self) -> ChiefRays {
        let radius = self.primary.entrance_radius_mm;
        let axis = ChiefRay { angle: 0.0, tan: 0.0, at: [0.0, radius, radius], height_mm: 0.0 };
        let (mut rays, mut end, mut step) = (vec![axis], None, STEP);
        for tried in 1..=MAX_STEPS {
            let last = rays[rays.len() - 1];
            let angle = (last.angle + step).min(MAX_ANGLE);
            if angle <= last.angle {
                break;
            }
            let tan = real::tan(angle);
            let guess = [-tan * shift(&rays, angle), 0.0];
            match self.chief(tan, guess) {
                Ok((at, height_mm)) => {
                    rays.push(ChiefRay { angle, tan, at, height_mm });
                    step = (2.0 * step).min(STEP);
                }
                Err(e) if step <= MIN_STEP || tried == MAX_STEPS => {
                    end = Some(e);
                    break;
                }
                Err(_) => step *= 0.5,
            }
        }
        ChiefRays { rays, end }
    }

    fn chief(&self, tan: f64, guess: [f64; 2]) -> Result<([f64; 3], f64), DesignError> {
        let radius = self.primary.entrance_radius_mm;
        let PupilPoint { at: [x, y], by } = match self.aiming() {
            RayAiming::Paraxial => PupilPoint { at: [0.0; 2], by: [[radius, 0.0], [0.0, radius]] },
            RayAiming::Real => self.newton(tan, (0.0, 0.0), guess, SHORT_OF_CHIEFS * radius)?,
        };
        let image = self.run(self.launch(tan, x, y), self.image(), |_, _| {});
        let lost = |lost: Lost| self.lost(tan, 0.0, 0.0, lost);
        Ok(([x, by[0][0], by[1][1]], image.map_err(lost)?.p[0]))
    }
}

/// Shift of the real pupil towards the object at `angle`, mm, extrapolated in the square of the angle from up to three rays before it.
fn shift(rays: &[ChiefRay], angle: f64) -> f64 {
    let known: Vec<(f64, f64)> =
        rays[1..].iter().rev().take(3).map(|r| (r.angle * r.angle, -r.at[0] / r.tan)).collect();
    lagrange(&known, angle * angle)
}

/// The polynomial through `points` at `at`.
pub(in crate::design) fn lagrange(points: &[(f64, f64)], at: f64) -> f64 {
    let term = |i: usize| {
        let others = points.iter().enumerate().filter(|(j, _)| *j != i);
        others.fold(points[i].1, |v, (_, p)| v * (at - p.0) / (points[i].0 - p.0))
    };
    (0..points.len()).map(term).sum()
}

impl ChiefRays {
    /// Point and derivatives near the chief ray at `tan`, interpolated; those of the last ray beyond it.
    fn near(&self, tan: f64) -> [f64; 3] {
        let (size, sign) = (tan.abs(), tan.signum());
        let k = self.rays.partition_point(|r| r.tan < size).clamp(1, self.rays.len().max(2) - 1);
        let (Some(a), Some(b)) = (self.rays.get(k - 1), self.rays.get(k)) else { return self.rays[0].at };
        let square = real::atan(size).powi(2);
        let u = ((square - a.angle * a.angle) / (b.angle * b.angle - a.angle * a.angle)).clamp(0.0, 1.5);
        let mix = |x: f64, y: f64| x + (y - x) * u;
        // The shift, not the point, is smooth; on the axis it is that of the next ray.
        let shift = |r: &ChiefRay| r.at[0] / r.tan;
        let first = if a.tan == 0.0 { shift(b) } else { shift(a) };
        [sign * size * mix(first, shift(b)), mix(a.at[1], b.at[1]), mix(a.at[2], b.at[2])]
    }

    /// Index of the first ray whose height is at least `height_mm`, if the heights ascend up to there.
    pub(super) fn reaching(&self, height_mm: f64) -> Option<usize> {
        (1..self.rays.len())
            .take_while(|k| self.rays[*k].height_mm > self.rays[k - 1].height_mm)
            .find(|k| self.rays[*k].height_mm >= height_mm)
    }

    /// The ray of the largest height that the heights ascend to, and whether a ray follows it.
    pub(super) fn farthest(&self) -> (ChiefRay, bool) {
        let k =
            (1..self.rays.len()).take_while(|k| self.rays[*k].height_mm > self.rays[k - 1].height_mm).count();
        (self.rays[k], k + 1 < self.rays.len())
    }
}
