//! The point of the entrance pupil plane whose ray crosses the stop at a given point, by Newton's method:
//!
//!   a ← a + J⁻¹·(s − S(a)),   J = ∂S/∂a
//!
//! a: point of the entrance pupil plane, mm. S(a): where its ray crosses the stop, mm, with exact derivatives. s: the given point
//! of the stop, mm: (p, q)·(radius of the stop) for the pupil coordinates (p, q). A step about squares the error, in units of the pupil. Where the method fails from the first guess, (p, q) is approached along its radius from another point.

use super::scalar::Dual;
use crate::real;

/// Iterations; rays of real lenses need 1 to 8.
const ITERATIONS: u32 = 20;
/// Steps towards a point that cannot be aimed at directly.
const PUPIL_STEPS: u32 = 12;

/// A point of the entrance pupil plane.
#[derive(Clone, Copy, Debug)]
pub(in crate::design) struct PupilPoint {
    /// x and y, mm.
    pub(in crate::design) at: [f64; 2],
    /// d(x, y)/d(p, q), mm, at the point before the last step.
    pub(in crate::design) by: [[f64; 2]; 2],
}

impl PupilPoint {
    /// x and y with derivatives by p and q, mm.
    pub(in crate::design) fn dual(self) -> [Dual; 2] {
        [0, 1].map(|i| Dual { v: self.at[i], d: self.by[i] })
    }
}

/// A step of Newton's method.
#[derive(Clone, Copy, Debug)]
pub(in crate::design) struct Step {
    /// To the next point, mm.
    pub(in crate::design) mm: [f64; 2],
    /// d(x, y)/d(p, q) at the point before it, mm.
    pub(in crate::design) by: [[f64; 2]; 2],
}

impl Step {
    /// None, of derivatives by (p, q).
    pub(in crate::design) const NONE: Self = Self { mm: [0.0; 2], by: [[1.0, 0.0], [0.0, 1.0]] };

    /// From a point whose ray crosses the stop at `hit`, with derivatives by the point, towards (p, q)·`radius_mm`; none where rays of neighbouring points cross it
    /// at the same place.
    pub(in crate::design) fn new(hit: [Dual; 2], (p, q): (f64, f64), radius_mm: f64) -> Option<Self> {
        let (a, b) = (hit[0].d, hit[1].d);
        let det = a[0] * b[1] - a[1] * b[0];
        // Columns of the inverse: d(pupil plane)/d(stop).
        let inverse = [[b[1] / det, -a[1] / det], [-b[0] / det, a[0] / det]];
        let miss = [radius_mm * p - hit[0].v, radius_mm * q - hit[1].v];
        let mm = inverse.map(|row| row[0] * miss[0] + row[1] * miss[1]);
        let is_finite = mm[0].is_finite() && mm[1].is_finite();
        is_finite.then(|| Self { mm, by: inverse.map(|row| row.map(|v| v * radius_mm)) })
    }

    /// `v`, with derivatives by the point before it, at the next point, with derivatives by (p, q).
    pub(in crate::design) fn carry(&self, v: Dual) -> Dual {
        let along = |d: [f64; 2]| v.d[0] * d[0] + v.d[1] * d[1];
        let [[a, b], [c, d]] = self.by;
        Dual::new(v.v + along(self.mm), along([a, c]), along([b, d]))
    }

    /// Its length, mm.
    pub(in crate::design) fn length_mm(&self) -> f64 {
        real::hypot(self.mm[0], self.mm[1])
    }
}

/// The point whose ray crosses the stop at (p, q)·`radius_mm`, from the first guess `at`, after a step shorter than `short_mm`, which about squares its error; none
/// if there is no such ray nearby. `stop`: where the ray of a point crosses the stop.
///
/// # Errors
/// Those of `stop`.
pub(in crate::design) fn aimed<E>(
    (p, q): (f64, f64),
    radius_mm: f64,
    mut at: [f64; 2],
    short_mm: f64,
    stop: impl Fn([Dual; 2]) -> Result<[Dual; 2], E>,
) -> Result<Option<PupilPoint>, E> {
    for _ in 0..ITERATIONS {
        let hit = stop([Dual::new(at[0], 1.0, 0.0), Dual::new(at[1], 0.0, 1.0)])?;
        let Some(step) = Step::new(hit, (p, q), radius_mm) else { break };
        at = [at[0] + step.mm[0], at[1] + step.mm[1]];
        if step.length_mm() < short_mm {
            return Ok(Some(PupilPoint { at, by: step.by }));
        }
    }
    Ok(None)
}

/// The point of (p, q), approached in steps from `centre`, that of (0, 0). `aim`: the point of pupil coordinates, from a first guess.
///
/// # Errors
/// The first of `aim`.
pub(in crate::design) fn approached<E>(
    centre: PupilPoint,
    (p, q): (f64, f64),
    aim: impl Fn(f64, f64, [f64; 2]) -> Result<PupilPoint, E>,
) -> Result<PupilPoint, E> {
    (1..=PUPIL_STEPS).try_fold(centre, |PupilPoint { at, by }, step| {
        let part = f64::from(step) / f64::from(PUPIL_STEPS);
        // Extrapolated along the derivatives at the point before.
        let guess = [0, 1].map(|i| at[i] + (by[i][0] * p + by[i][1] * q) / f64::from(PUPIL_STEPS));
        aim(p * part, q * part, guess)
    })
}
