//! OpenCV's fisheye model, COLMAP's OPENCV_FISHEYE.
//!
//! ```text
//! r/f = θ·(1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)      θ in rad
//! ```
//! Source: Kannala and Brandt, IEEE Trans. PAMI 28 (2006), p. 1335; OpenCV 4, module calib3d, fisheye.

use super::target::{Target, horner};
use super::{CameraModelError, check_ascends};

/// k1 to k4.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fisheye {
    /// The coefficients.
    pub k: [f64; 4],
}

impl Fisheye {
    /// The fit.
    ///
    /// # Errors
    /// It does not ascend over the field.
    pub fn fit(target: &Target) -> Result<Self, CameraModelError> {
        let right = |p: &super::field_map::FieldPoint| p.real_mm / target.focal_mm - p.angle_rad;
        let k = target.polynomial([3, 5, 7, 9], |p| p.angle_rad, right);
        let fit = Self { k: k.ok_or(CameraModelError::Undetermined { model: MODEL })? };
        check_ascends(MODEL, target, target.fold_mm(|p| p.angle_rad, |angle| fit.radius(angle)), "ftheta")?;
        Ok(fit)
    }

    /// r/f at an angle.
    pub fn radius(&self, angle_rad: f64) -> f64 {
        let [k1, k2, k3, k4] = self.k;
        angle_rad * horner(&[1.0, k1, k2, k3, k4], angle_rad * angle_rad)
    }
}

const MODEL: &str = "opencv-fisheye";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera_model::target::synthetic;

    #[test]
    fn coefficients_are_recovered() {
        let known = Fisheye { k: [-0.031, 0.0072, -0.0041, 0.00053] };
        let target = synthetic(5.2, 88f64.to_radians().tan(), |t| 5.2 * known.radius(t.atan()));
        let fit = Fisheye::fit(&target).unwrap();
        for (f, e) in std::iter::zip(fit.k, known.k) {
            assert!((f - e).abs() < 1e-9, "{fit:?}");
        }
        assert!(target.residual_px(|p| 5.2 * fit.radius(p.angle_rad)).max < 1e-9);
    }

    #[test]
    fn rectilinear_lens_is_fitted_over_its_angle() {
        // tan θ is not a polynomial of θ: at 30 degrees the next term is 62/2835 θ⁹ of the series and is fitted, too.
        let target = synthetic(4.0, 30f64.to_radians().tan(), |t| 4.0 * t);
        let fit = Fisheye::fit(&target).unwrap();
        assert!((fit.k[0] - 1.0 / 3.0).abs() < 1e-3, "{fit:?}");
        assert!(target.residual_px(|p| 4.0 * fit.radius(p.angle_rad)).max < 1e-3);
    }
}
