//! NVIDIA's f-theta model: a polynomial of the angle, and its inverse.
//!
//! ```text
//! r/p = c1 θ + c2 θ² + c3 θ³ + c4 θ⁴ + c5 θ⁵        forward, angle to pixel distance, p the pixel pitch, θ in rad
//! θ   = b1 (r/p) + b2 (r/p)² + … + b5 (r/p)⁵        inverse, pixel distance to angle
//! ```
//! Six coefficients, the first of which is 0 (the axis is at the principal point). Both are fitted to the field points: neither is the exact inverse of the other. The
//! forward polynomial is fitted in pixels; the inverse by weights that make its errors pixels too, θ's times dr/dθ.
//! Source: DriveWorks, dwFThetaCameraConfig (`polynomial`, of either kind, 6 coefficients).

use super::field_map::FieldPoint;
use super::target::{Target, horner};
use super::{CameraModelError, check_ascends};

/// Coefficients of θ⁰ to θ⁵ in px/radʲ, and of the pixel distance to its powers 0 to 5.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FTheta {
    /// Angle to pixel distance.
    pub forward: [f64; 6],
    /// Pixel distance to angle.
    pub inverse: [f64; 6],
}

const POWERS: [i32; 5] = [1, 2, 3, 4, 5];

impl FTheta {
    /// The fit.
    ///
    /// # Errors
    /// It does not ascend over the field.
    pub fn fit(target: &Target) -> Result<Self, CameraModelError> {
        let undetermined = CameraModelError::Undetermined { model: MODEL };
        let pixels = |p: &FieldPoint| p.real_mm / target.pitch_mm();
        let from_zero = |k: [f64; 5]| [0.0, k[0], k[1], k[2], k[3], k[4]];
        let forward = target.polynomial(POWERS, |p| p.angle_rad, pixels).map(from_zero);
        let forward = forward.ok_or_else(|| undetermined.clone())?;
        let slope = |angle: f64| {
            let derivative: Vec<f64> = (1..6).map(|j| j as f64 * forward[j]).collect();
            horner(&derivative, angle)
        };
        // Powers of the share of the last pixel distance are well scaled.
        let last = pixels(&target.last());
        let row = |_, p: &FieldPoint| {
            let (share, scale) = (pixels(p) / last, slope(p.angle_rad));
            (POWERS.map(|power| scale * share.powi(power)), scale * p.angle_rad)
        };
        let found = target.solve(row, 5).ok_or(undetermined)?;
        let inverse = from_zero(std::array::from_fn(|j| found[j] / last.powi(POWERS[j])));
        let fit = Self { forward, inverse };
        let fold = target
            .fold_mm(|p| p.angle_rad, |angle| fit.distance_px(angle))
            .or_else(|| target.fold_mm(pixels, |px| fit.angle_rad(px)));
        check_ascends(MODEL, target, fold, "opencv-fisheye")?;
        Ok(fit)
    }

    /// Pixel distance from the principal point at an angle.
    pub fn distance_px(&self, angle_rad: f64) -> f64 {
        horner(&self.forward, angle_rad)
    }

    /// Angle at a pixel distance, rad.
    pub fn angle_rad(&self, distance_px: f64) -> f64 {
        horner(&self.inverse, distance_px)
    }
}

const MODEL: &str = "ftheta";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera_model::target::synthetic;

    #[test]
    fn coefficients_are_recovered() {
        let known = [0.0, 1500.0, -12.0, -35.0, 8.0, -2.5];
        let target = synthetic(1.5, 85f64.to_radians().tan(), |t| 1e-3 * horner(&known, t.atan()));
        let fit = FTheta::fit(&target).unwrap();
        for (f, e) in std::iter::zip(fit.forward, known) {
            assert!((f - e).abs() < 1e-9 * 1500.0, "{fit:?}");
        }
        let inverse = target.residual(|p| 1500.0 * (fit.angle_rad(p.real_mm / 1e-3) - p.angle_rad));
        assert!(inverse.max < 0.1, "{inverse:?}");
    }

    #[test]
    fn inverse_is_recovered() {
        // θ = b₁ d + b₃ d³: the angle of each pixel distance, whose tangents ascend to 60 degrees.
        let angle = |d: f64| 1e-3 * d + 2e-11 * d.powi(3);
        let points: Vec<FieldPoint> =
            (1..=1000).map(|d| FieldPoint::new(angle(f64::from(d)).tan(), f64::from(d) * 1e-3)).collect();
        let area = super::super::target::FilmArea::circle(1.0);
        let fit = FTheta::fit(&Target::of_points(1.0, points, &area, 1e-3)).unwrap();
        for (f, e) in std::iter::zip(fit.inverse, [0.0, 1e-3, 0.0, 2e-11, 0.0, 0.0]) {
            assert!((f - e).abs() < 1e-12, "{fit:?}");
        }
    }
}
