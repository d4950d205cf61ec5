//! Chief rays: place on the film as a function of the field's slopes, its Jacobian, and the inverse.
//!
//! ```text
//! C(t) = (X, Y) of the chief ray, (p, q) = 0;    dC/dt = ∂C/∂t + ∂C/∂x · dx/dt,    dx/dt = −(∂S/∂x)⁻¹ ∂S/∂t
//! ```
//! (S the point in the stop as built, x the point in the entrance pupil plane, dx/dt = 0 for paraxial aiming). Two rays with
//! derivatives, by t and by x, give both. The inverse: Newton's method with halved steps, from the field of the nominal lens or
//! of a neighbour.

use super::error::SkewError;
use super::trace::SkewTracer;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::RayAiming;
use crate::design::rays::scalar::{Dual, Scalar};
use crate::real;

/// Iterations of Newton's method; real lenses need 3 to 5.
const ITERATIONS: u32 = 40;
/// Halvings of a step that does not come nearer.
const HALVINGS: u32 = 12;
/// Steps from the film's centre to a place whose field is far from that of the nominal lens.
const OUTWARD_STEPS: u32 = 16;
/// Convergence limit on the film, mm.
const TOLERANCE_MM: f64 = 1e-12;

/// The chief ray of a field on the film, in the film frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chief {
    /// Place on the film, mm.
    pub at_mm: [f64; 2],
    /// d(X, Y)/d(tx, ty), mm.
    pub by_slopes: [[f64; 2]; 2],
}

impl Chief {
    /// det d(X, Y)/d(tx, ty), mm²: negative for an upright map, as Y is down and ty is up.
    pub fn determinant(&self) -> f64 {
        let [a, b] = self.by_slopes;
        a[0] * b[1] - a[1] * b[0]
    }
}

impl SkewTracer<'_> {
    /// The chief ray of the field of slopes `t`. Apertures are ignored.
    ///
    /// # Errors
    /// [`DesignError::Ray`] if it does not reach the film.
    pub fn chief(&self, t: [f64; 2]) -> Result<Chief, DesignError> {
        let [x, y] = self.aim(t, 0.0, 0.0)?.map(|v| v.v);
        let (stop, film) = (self.system().stop, self.system().image());
        let trace = |t: [Dual; 2], x: Dual, y: Dual| {
            let mut at_stop = [[0.0; 2]; 2];
            let ray = self.run(self.launch(t, x, y), film, |i, ray| {
                if i == stop {
                    at_stop = [ray.p[0].d, ray.p[1].d];
                }
            });
            ray.map(|ray| ([ray.p[0], -ray.p[1]], at_stop))
                .map_err(|lost| self.lost(t.map(|v| v.v), 0.0, 0.0, lost))
        };
        let [tx, ty] = t;
        let (at, stop_by_t) =
            trace([Dual::new(tx, 1.0, 0.0), Dual::new(ty, 0.0, 1.0)], Dual::of(x), Dual::of(y))?;
        let mut by_slopes = at.map(|v| v.d);
        if self.aiming() == RayAiming::Real {
            let (by_x, s) = trace(t.map(Dual::from), Dual::new(x, 1.0, 0.0), Dual::new(y, 0.0, 1.0))?;
            let det = s[0][0] * s[1][1] - s[0][1] * s[1][0];
            let inverse = [[s[1][1] / det, -s[0][1] / det], [-s[1][0] / det, s[0][0] / det]];
            let product = |a: [[f64; 2]; 2], b: [[f64; 2]; 2]| {
                a.map(|row| [0, 1].map(|j| row[0] * b[0][j] + row[1] * b[1][j]))
            };
            let follow = product(by_x.map(|v| v.d), product(inverse, stop_by_t));
            by_slopes = [0, 1].map(|i| [0, 1].map(|j| by_slopes[i][j] - follow[i][j]));
        }
        Ok(Chief { at_mm: at.map(|v| v.v), by_slopes })
    }

    /// The slopes of the field whose chief ray lands at `film_mm`, from those of the nominal lens.
    ///
    /// # Errors
    /// [`SkewError::Place`] if there is none.
    pub fn field_of(&self, film_mm: [f64; 2]) -> Result<[f64; 2], SkewError> {
        Ok(self.field_and_chief(film_mm)?.0)
    }

    /// [`SkewTracer::field_of`] with its chief ray.
    ///
    /// # Errors
    /// [`SkewError::Place`] if there is none.
    pub fn field_and_chief(&self, film_mm: [f64; 2]) -> Result<([f64; 2], Chief), SkewError> {
        self.field_near(film_mm, self.nominal_field_of(film_mm)).or_else(|first| {
            // Outwards from the film's centre.
            let mut t = self.nominal_field_of([0.0; 2]);
            let mut found = Err(first.clone());
            for step in 0..=OUTWARD_STEPS {
                let share = f64::from(step) / f64::from(OUTWARD_STEPS);
                found = self.field_near(film_mm.map(|v| share * v), t);
                let Ok((near, _)) = &found else { return Err(first) };
                t = *near;
            }
            found
        })
    }

    /// [`SkewTracer::field_of`] with its chief ray, from the slopes `near`.
    ///
    /// # Errors
    /// [`SkewError::Place`] if there is none.
    pub fn field_near(&self, film_mm: [f64; 2], near: [f64; 2]) -> Result<([f64; 2], Chief), SkewError> {
        let nowhere = |problem: String| SkewError::Place {
            x_mm: film_mm[0],
            y_mm: film_mm[1],
            wavelength_um: self.wavelength_um,
            problem,
        };
        let miss = |c: &Chief| [film_mm[0] - c.at_mm[0], film_mm[1] - c.at_mm[1]];
        let size = |m: [f64; 2]| m[0].abs().max(m[1].abs());
        let tolerance = TOLERANCE_MM * size(film_mm).max(1.0);
        let mut t = near;
        let mut chief = self.chief(t).map_err(|e| nowhere(e.to_string()))?;
        for _ in 0..ITERATIONS {
            let (now, det, [a, b]) = (miss(&chief), chief.determinant(), chief.by_slopes);
            if size(now) < tolerance {
                return Ok((t, chief));
            }
            let step = [(b[1] * now[0] - a[1] * now[1]) / det, (a[0] * now[1] - b[0] * now[0]) / det];
            if !(step[0].is_finite() && step[1].is_finite()) {
                break;
            }
            // A step within the rounding of the slopes is the result.
            if size(step) <= 2.0 * f64::EPSILON * size(t) {
                return Ok((t, chief));
            }
            let next = (0..HALVINGS).find_map(|k| {
                let part = 0.5_f64.powi(k as i32);
                let tried = [t[0] + part * step[0], t[1] + part * step[1]];
                let found = self.chief(tried).ok()?;
                (size(miss(&found)) < size(now)).then_some((tried, found))
            });
            let Some(next) = next else {
                // No step comes nearer: rounding, or no field lands there.
                return if size(now) < 100.0 * tolerance {
                    Ok((t, chief))
                } else {
                    Err(nowhere(ends(size(now))))
                };
            };
            (t, chief) = next;
        }
        Err(nowhere(ends(size(miss(&chief)))))
    }

    /// The field that the nominal lens images to `film_mm`, or its farthest one in that direction; of an asymmetric design that of the
    /// ideal plane.
    fn nominal_field_of(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        if self.lens.is_asymmetric_design() {
            return self.slopes_of_ideal([x, y]);
        }
        let r = real::hypot(x, y);
        if r == 0.0 {
            return [0.0; 2];
        }
        let tan = self.nominal.field_of_height(r).unwrap_or_else(|_| self.nominal.farthest_field().1);
        let tan = tan * self.nominal.image_sign();
        [tan * x / r, -tan * y / r]
    }
}

fn ends(miss_mm: f64) -> String {
    format!("the nearest one lands {miss_mm:.3e} mm from it")
}
