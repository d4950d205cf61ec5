//! Ray aiming in two dimensions: the point of the nominal entrance pupil plane for a pupil coordinate.
//!
//! *Paraxial aiming*: the point (p, q)·R. *Real aiming*: the point whose ray crosses the stop as built, in its frame, at (p,
//! q)·(radius of the nominal stop), by Newton's method with exact derivatives. The chief rays are followed from t = 0 outwards
//! along eight azimuths: with the angle θ of the field, the shift s = (x − x₀)/tan θ of each, x₀ that of t = 0, is extrapolated
//! as a polynomial in θ² through the three before, and the step is halved where Newton's method fails. The first guess of any
//! other ray is the chief ray of its field, with the derivatives by (p, q) there: both interpolated in θ² and, in the frame that
//! is rotated with the field's azimuth, linearly in the azimuth: a lens without deviations has no dependence on it, and
//! deviations add low harmonics.

use std::f64::consts::{PI, TAU};

use super::trace::SkewTracer;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::RayAiming;
use crate::design::rays::aim::lagrange;
use crate::design::rays::scalar::Dual;
use crate::design::rays::stop_point::{PupilPoint, aimed, approached};
use crate::real;

/// Length of the last step of Newton's method, of the entrance pupil's radius: derivatives, which are those before it, have about that error.
const SHORT: f64 = 1e-9;
/// Azimuths along which chief rays are followed.
const SPOKES: usize = 8;
/// Step of the chief rays' angle, rad.
const STEP: f64 = PI / 90.0;
/// Minimum step after a failure, rad.
const MIN_STEP: f64 = STEP / 128.0;
/// Maximum angle, rad: 89.5 degrees.
const MAX_ANGLE: f64 = 179.0 * PI / 360.0;

/// The chief ray of one field, in the frame rotated with the azimuth of its spoke.
#[derive(Clone, Copy, Debug)]
struct ChiefAim {
    /// Angle at the entrance pupil, rad.
    angle: f64,
    /// (x − x₀)/tan θ in the entrance pupil plane, mm.
    shift: [f64; 2],
    /// d(x, y)/d(p, q), mm.
    by: [[f64; 2]; 2],
}

/// Aims of the chief rays of all fields.
#[derive(Clone, Debug)]
pub(super) struct Chiefs {
    /// That of t = 0, and its derivatives, not rotated.
    centre: PupilPoint,
    /// Ascending in the angle, without that of t = 0.
    spokes: Vec<Vec<ChiefAim>>,
}

impl SkewTracer<'_> {
    /// The point of the nominal entrance pupil plane, mm, for pupil coordinates (p, q), with derivatives by them.
    ///
    /// # Errors
    /// [`DesignError::Ray`] if no ray of the field crosses the stop there.
    pub fn aim(&self, t: [f64; 2], p: f64, q: f64) -> Result<[Dual; 2], DesignError> {
        let radius = self.primary.entrance_radius_mm;
        if self.aiming() == RayAiming::Paraxial {
            return Ok([Dual::new(p * radius, radius, 0.0), Dual::new(q * radius, 0.0, radius)]);
        }
        let PupilPoint { at, by } = self.chiefs.get_or_init(|| self.follow_chiefs()).near(t);
        let guess = [0, 1].map(|i| at[i] + by[i][0] * p + by[i][1] * q);
        let direct = self.newton(t, p, q, guess);
        let found = direct.or_else(|first| {
            if (p, q) == (0.0, 0.0) {
                return Err(first);
            }
            let centre = self.newton(t, 0.0, 0.0, at).map_err(|_| first.clone())?;
            approached(centre, (p, q), |p, q, guess| self.newton(t, p, q, guess)).map_err(|_| first)
        });
        found.map(PupilPoint::dual)
    }

    /// The point and its derivatives by (p, q), from the first guess `at`.
    fn newton(&self, t: [f64; 2], p: f64, q: f64, at: [f64; 2]) -> Result<PupilPoint, DesignError> {
        let short_mm = SHORT * self.primary.entrance_radius_mm;
        let found = aimed((p, q), self.stop_scale_mm(), at, short_mm, |[x, y]| {
            let hit = self.run(self.launch(t.map(Dual::from), x, y), self.system().stop, |_, _| {});
            let [x, y, ..] = hit.map_err(|lost| self.lost(t, p, q, lost))?.p;
            Ok([x, y])
        })?;
        found.ok_or_else(|| self.ray_error(t, p, q, "cannot be aimed at the stop"))
    }

    /// Follows the chief rays from t = 0 outwards.
    fn follow_chiefs(&self) -> Chiefs {
        let radius = self.primary.entrance_radius_mm;
        let centre = self.newton([0.0; 2], 0.0, 0.0, [0.0; 2]);
        let centre = centre.unwrap_or(PupilPoint { at: [0.0; 2], by: [[radius, 0.0], [0.0, radius]] });
        let spokes = (0..SPOKES).map(|k| self.follow_spoke(TAU * k as f64 / SPOKES as f64, centre.at));
        Chiefs { centre, spokes: spokes.collect() }
    }

    fn follow_spoke(&self, azimuth: f64, centre: [f64; 2]) -> Vec<ChiefAim> {
        let (sin, cos) = real::sin_cos(azimuth);
        let (mut rays, mut last, mut step) = (Vec::<ChiefAim>::new(), 0.0, STEP);
        while step > MIN_STEP {
            let angle = (last + step).min(MAX_ANGLE);
            if angle <= last {
                break;
            }
            let tan = real::tan(angle);
            let t = [tan * cos, tan * sin];
            let shift = [0, 1].map(|i| {
                let known: Vec<(f64, f64)> =
                    rays.iter().rev().take(3).map(|r| (r.angle * r.angle, r.shift[i])).collect();
                tan * lagrange(&known, angle * angle)
            });
            let shift = rotated(shift, (sin, cos));
            match self.newton(t, 0.0, 0.0, [centre[0] + shift[0], centre[1] + shift[1]]) {
                Ok(PupilPoint { at, by }) => {
                    let shift = [(at[0] - centre[0]) / tan, (at[1] - centre[1]) / tan];
                    rays.push(ChiefAim {
                        angle,
                        shift: rotated(shift, (-sin, cos)),
                        by: matrix_rotated(by, (-sin, cos)),
                    });
                    (last, step) = (angle, (2.0 * step).min(STEP));
                }
                Err(_) => step *= 0.5,
            }
        }
        rays
    }
}

impl Chiefs {
    /// Point and derivatives near the chief ray of the field of slopes `t`, interpolated; beyond the last ray of a spoke those of
    /// that.
    fn near(&self, t: [f64; 2]) -> PupilPoint {
        let tan = real::hypot(t[0], t[1]);
        if tan == 0.0 {
            return self.centre;
        }
        let (sin, cos) = (t[1] / tan, t[0] / tan);
        let turn = real::atan2(sin, cos).rem_euclid(TAU) / TAU * SPOKES as f64;
        let (k, part) = (turn.floor() as usize % SPOKES, turn - turn.floor());
        let angle = real::atan(tan);
        let ends = [k, (k + 1) % SPOKES].map(|k| self.on_spoke(k, angle, (sin, cos)));
        let [Some(a), Some(b)] = ends else {
            return ends[0].or(ends[1]).map_or(self.centre, |a| self.placed(&a, tan, (sin, cos)));
        };
        let mix = |a: f64, b: f64| a + part * (b - a);
        let mixed = ChiefAim {
            angle,
            shift: [0, 1].map(|i| mix(a.shift[i], b.shift[i])),
            by: [0, 1].map(|i| [0, 1].map(|j| mix(a.by[i][j], b.by[i][j]))),
        };
        self.placed(&mixed, tan, (sin, cos))
    }

    fn placed(&self, aim: &ChiefAim, tan: f64, turn: (f64, f64)) -> PupilPoint {
        let shift = rotated(aim.shift, turn);
        PupilPoint {
            at: [0, 1].map(|i| self.centre.at[i] + tan * shift[i]),
            by: matrix_rotated(aim.by, turn),
        }
    }

    /// The aim on a spoke at `angle`, in its rotated frame; none if the spoke is empty. `turn`: sine and cosine of the field's
    /// azimuth.
    fn on_spoke(&self, spoke: usize, angle: f64, turn: (f64, f64)) -> Option<ChiefAim> {
        let rays = &self.spokes[spoke];
        let above = rays.partition_point(|r| r.angle < angle);
        let last = rays.last()?;
        let Some(b) = rays.get(above) else { return Some(*last) };
        let square = |v: f64| v * v;
        let (a, from) = match above {
            // The shift, not the point, is smooth: towards t = 0 it is that of the first ray.
            0 => {
                let by = matrix_rotated(self.centre.by, (-turn.0, turn.1));
                (ChiefAim { angle: 0.0, shift: b.shift, by }, 0.0)
            }
            _ => (rays[above - 1], square(rays[above - 1].angle)),
        };
        let u = (square(angle) - from) / (square(b.angle) - from);
        let mix = |a: f64, b: f64| a + u * (b - a);
        Some(ChiefAim {
            angle,
            shift: [0, 1].map(|i| mix(a.shift[i], b.shift[i])),
            by: [0, 1].map(|i| [0, 1].map(|j| mix(a.by[i][j], b.by[i][j]))),
        })
    }
}

/// `v` rotated by the angle of the sine and cosine.
fn rotated(v: [f64; 2], (sin, cos): (f64, f64)) -> [f64; 2] {
    [cos * v[0] - sin * v[1], sin * v[0] + cos * v[1]]
}

/// R m Rᵀ.
fn matrix_rotated(m: [[f64; 2]; 2], turn: (f64, f64)) -> [[f64; 2]; 2] {
    let rows = m.map(|row| rotated(row, turn));
    let [a, b] = [0, 1].map(|j| rotated([rows[0][j], rows[1][j]], turn));
    [[a[0], b[0]], [a[1], b[1]]]
}
