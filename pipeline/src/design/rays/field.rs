//! Chief rays: image height as a function of the field angle, its derivative, and the inverse.
//!
//! ```text
//! h(t) = height in the image plane of the chief ray at t = tan θ;    dh/dt = ∂h/∂t + ∂h/∂x · dx/dt,    dx/dt = −(∂X/∂t)/(∂X/∂x)
//! ```
//! (X the height in the stop, x the point in the entrance pupil plane, dx/dt = 0 for paraxial aiming). One ray with derivatives by t and
//! x gives both. The inverse: bracketed by the chief rays that [`super::aim`] follows from the axis, then Newton's method.

use super::ray::Tracer;
use super::scalar::Dual;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::RayAiming;

impl Tracer<'_> {
    /// Real chief-ray height in the image plane, mm.
    ///
    /// # Errors
    /// [`DesignError::Ray`] if the chief ray does not reach the image.
    pub fn chief_height_mm(&self, tan: f64) -> Result<f64, DesignError> {
        Ok(self.chief_height_and_slope(tan)?.0)
    }

    /// Real chief-ray height in the image plane, mm, and its derivative by `tan`.
    ///
    /// # Errors
    /// [`DesignError::Ray`] if the chief ray does not reach the image.
    pub fn chief_height_and_slope(&self, tan: f64) -> Result<(f64, f64), DesignError> {
        let [x, _] = self.aim(tan, 0.0, 0.0)?;
        // Derivatives by (tan, x).
        let ray = self.launch(Dual::new(tan, 1.0, 0.0), Dual::new(x, 0.0, 1.0), Dual::new(0.0, 0.0, 0.0));
        let mut at_stop = Dual::new(0.0, 0.0, 1.0);
        let image = self.run(ray, self.image(), |i, ray| {
            if i == self.stop() {
                at_stop = ray.p[0];
            }
        });
        let h = image.map_err(|lost| self.lost(tan, 0.0, 0.0, lost))?.p[0];
        // What is left of the distance from the centre of the stop, and how x follows from tan.
        let [missed, follow] = match self.aiming() {
            RayAiming::Paraxial => [0.0; 2],
            RayAiming::Real => [at_stop.v, at_stop.d[0]].map(|v| -v / at_stop.d[1]),
        };
        Ok((h.v + h.d[1] * missed, h.d[0] + h.d[1] * follow))
    }

    /// The field point whose chief ray has the image height `height_mm`, as tan of its field angle.
    ///
    /// # Errors
    /// [`DesignError::Height`] if there is none.
    pub fn field_of_height(&self, height_mm: f64) -> Result<f64, DesignError> {
        if height_mm == 0.0 {
            return Ok(0.0);
        }
        let chiefs = self.chiefs();
        let Some(k) = chiefs.reaching(height_mm) else { return Err(self.beyond(height_mm)) };
        let (mut low, mut high) = (chiefs.rays[k - 1].tan, chiefs.rays[k].tan);
        let (below, above) = (chiefs.rays[k - 1].height_mm, chiefs.rays[k].height_mm);
        let mut tan = low + (high - low) * (height_mm - below) / (above - below);
        for _ in 0..80 {
            let (height, slope) = self.chief_height_and_slope(tan)?;
            let miss = height - height_mm;
            if miss.abs() < 1e-13 * height_mm.max(1.0) {
                return Ok(tan);
            }
            if miss < 0.0 {
                low = tan
            } else {
                high = tan
            }
            let next = tan - miss / slope;
            // A step within the rounding of the height is the result.
            if (next - tan).abs() <= 2.0 * f64::EPSILON * tan {
                return Ok(tan);
            }
            tan = if next > low && next < high { next } else { 0.5 * (low + high) };
        }
        Ok(tan)
    }

    /// The largest real image height of a chief ray, mm, and the tangent of its field angle.
    pub fn farthest_field(&self) -> (f64, f64) {
        let (ray, _) = self.chiefs().farthest();
        (ray.height_mm, ray.tan)
    }

    fn beyond(&self, height_mm: f64) -> DesignError {
        let chiefs = self.chiefs();
        let (last, folds) = chiefs.farthest();
        let degrees = last.angle.to_degrees();
        let problem = match &chiefs.end {
            _ if folds => format!("beyond {degrees:.2} degrees the image height of the chief ray decreases"),
            Some(DesignError::Ray { problem, .. }) => {
                format!("beyond {degrees:.2} degrees the chief ray {problem}")
            }
            _ => format!("the chief ray at {degrees:.2} degrees has this height"),
        };
        DesignError::Height {
            requested_mm: height_mm,
            reached_mm: last.height_mm,
            wavelength_um: self.wavelength_um,
            problem,
        }
    }
}
