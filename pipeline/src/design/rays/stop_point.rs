//! The point of the entrance pupil plane whose ray crosses the stop at a given point, by Newton's method:
//!
//!   a ← a + J⁻¹·(s − S(a)),   J = ∂S/∂a
//!
//! a: point of the entrance pupil plane, mm. S(a): where its ray crosses the stop, mm, with exact derivatives. s: the given point
//! of the stop, mm: (p, q)·(radius of the stop) for the pupil coordinates (p, q). Once a step is short, one more squares
//! its error. Where the method fails from the first guess, (p, q) is approached along its radius from another point.

use super::scalar::Dual;
use crate::real;

/// Iterations; rays of real lenses need 3 to 8.
const ITERATIONS: u32 = 20;
/// Steps towards a point that cannot be aimed at directly.
const PUPIL_STEPS: u32 = 12;

/// A point of the entrance pupil plane.
#[derive(Clone, Copy, Debug)]
pub(in crate::design) struct PupilPoint {
    /// x and y, mm.
    pub(in crate::design) at: [f64; 2],
    /// d(x, y)/d(p, q), mm.
    pub(in crate::design) by: [[f64; 2]; 2],
}

impl PupilPoint {
    /// x and y with derivatives by p and q, mm.
    pub(in crate::design) fn dual(self) -> [Dual; 2] {
        [0, 1].map(|i| Dual { v: self.at[i], d: self.by[i] })
    }
}

/// The point whose ray crosses the stop at (p, q)·`radius_mm`, from the first guess `at`; none if there is no such ray nearby. `stop`: where
/// the ray of a point crosses the stop. `short_mm`: a step after which one more suffices.
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
    let mut done = false;
    for _ in 0..ITERATIONS {
        let hit = stop([Dual::new(at[0], 1.0, 0.0), Dual::new(at[1], 0.0, 1.0)])?;
        let (a, b) = (hit[0].d, hit[1].d);
        let det = a[0] * b[1] - a[1] * b[0];
        // Columns of the inverse: d(pupil plane)/d(stop).
        let inverse = [[b[1] / det, -a[1] / det], [-b[0] / det, a[0] / det]];
        let miss = [radius_mm * p - hit[0].v, radius_mm * q - hit[1].v];
        let step = inverse.map(|row| row[0] * miss[0] + row[1] * miss[1]);
        if !(step[0].is_finite() && step[1].is_finite()) {
            break;
        }
        at = [at[0] + step[0], at[1] + step[1]];
        if done {
            return Ok(Some(PupilPoint { at, by: inverse.map(|row| row.map(|v| v * radius_mm)) }));
        }
        // One more iteration squares the error of the point and computes the derivatives there.
        done = real::hypot(step[0], step[1]) < short_mm;
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
