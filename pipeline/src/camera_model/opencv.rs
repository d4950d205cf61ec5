//! OpenCV's radial distortion, which COLMAP's OPENCV, FULL_OPENCV and RADIAL have too.
//!
//! ```text
//! r/f = t·(1 + k1 t² + k2 t⁴ + k3 t⁶)/(1 + k4 t² + k5 t⁴ + k6 t⁶)      t = tan θ
//! ```
//! Without k4 to k6 the fit is linear. The quotient is fitted by its numerator less r/f times its denominator, over the denominator of the step before (Sanathanan
//! and Koerner, IEEE Trans. Automatic Control 8, 1963, p. 56): the differences of the points are then those of r/f. Where the points do not determine all of
//! k4 to k6, as those of a lens without distortion do not, the last are 0.
//! Pixels: u = fx·x + cx with the centre of the first pixel at 0 (OpenCV) or 0.5 (COLMAP). p1 = p2 = 0.
//! Source: OpenCV 4, module calib3d, detailed description; COLMAP, src/colmap/sensor/models.h. Beyond the last field point the polynomial means nothing;
//! at 90 degrees t is infinite.

use super::field_map::FieldPoint;
use super::target::{Target, horner};
use super::{CameraModelError, WIDE, check_ascends};

/// Steps of the fit of a quotient, and the relative change of its residual that ends them.
const STEPS: usize = 30;
const LEAST_CHANGE: f64 = 1e-9;

/// Coefficients of a numerator and a denominator.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OpenCv {
    /// k1, k2, k3.
    pub numerator: [f64; 3],
    /// k4, k5, k6.
    pub denominator: [f64; 3],
}

impl OpenCv {
    /// The fit of k1 to k3.
    ///
    /// # Errors
    /// It does not ascend over the field.
    pub fn polynomial(target: &Target) -> Result<Self, CameraModelError> {
        let k = target.polynomial([3, 5, 7], |p| p.tan, |p| p.real_mm / target.focal_mm - p.tan);
        Self { numerator: k.ok_or(UNDETERMINED)?, denominator: [0.0; 3] }.checked(target)
    }

    /// The fit of k1 and k2 alone.
    ///
    /// # Errors
    /// It does not ascend over the field.
    pub fn two_terms(target: &Target) -> Result<Self, CameraModelError> {
        let k = target.polynomial([3, 5], |p| p.tan, |p| p.real_mm / target.focal_mm - p.tan);
        let [k1, k2] = k.ok_or(UNDETERMINED)?;
        Self { numerator: [k1, k2, 0.0], denominator: [0.0; 3] }.checked(target)
    }

    /// The fit of k1 to k6.
    ///
    /// # Errors
    /// It does not ascend over the field.
    pub fn rational(target: &Target) -> Result<Self, CameraModelError> {
        let fits = (0..=3).rev().filter_map(|terms| Self::quotient(target, terms));
        let mut best = Err(UNDETERMINED);
        for fit in fits {
            best = fit.checked(target);
            if best.is_ok() {
                break;
            }
        }
        best
    }

    /// The fit with `terms` coefficients of the denominator.
    fn quotient(target: &Target, terms: usize) -> Option<Self> {
        let last = target.last().tan;
        let square = |p: &FieldPoint| (p.tan / last).powi(2);
        let mut divisors = vec![1.0; target.points.len()];
        let mut best: Option<(f64, Self)> = None;
        for _ in 0..STEPS {
            let row = |i: usize, p: &FieldPoint| {
                let (s, ratio, divisor) = (square(p), p.real_mm / target.focal_mm, divisors[i]);
                let powers = [s, s * s, s * s * s];
                let row = std::array::from_fn::<f64, 6, _>(|j| match j {
                    0..3 => p.tan * powers[j] / divisor,
                    _ => -ratio * powers[j - 3] / divisor,
                });
                (row, (ratio - p.tan) / divisor)
            };
            let found = target.solve(row, 3 + terms)?;
            let scaled = |j: usize| found.get(j).map_or(0.0, |v| v / last.powi(2 * (j as i32 % 3 + 1)));
            let fit = Self {
                numerator: std::array::from_fn(scaled),
                denominator: std::array::from_fn(|j| scaled(j + 3)),
            };
            let rms = target.residual_px(|p| target.focal_mm * fit.radius(p.tan)).rms;
            if rms.is_nan() {
                break;
            }
            let change = best.map_or(f64::INFINITY, |(before, _)| (before - rms) / before);
            if change > 0.0 {
                best = Some((rms, fit));
            }
            if terms == 0 || change <= LEAST_CHANGE {
                break;
            }
            divisors = target.points.iter().map(|p| fit.divisor(p.tan * p.tan)).collect();
        }
        best.map(|(_, fit)| fit)
    }

    fn divisor(&self, square: f64) -> f64 {
        let [k4, k5, k6] = self.denominator;
        horner(&[1.0, k4, k5, k6], square)
    }

    /// r/f at `tan`.
    pub fn radius(&self, tan: f64) -> f64 {
        let [k1, k2, k3] = self.numerator;
        tan * horner(&[1.0, k1, k2, k3], tan * tan) / self.divisor(tan * tan)
    }

    fn checked(self, target: &Target) -> Result<Self, CameraModelError> {
        check_ascends(MODEL, target, target.fold_mm(|p| p.tan, |tan| self.radius(tan)), WIDE)?;
        Ok(self)
    }
}

const MODEL: &str = "opencv";
const UNDETERMINED: CameraModelError = CameraModelError::Undetermined { model: MODEL };

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera_model::target::synthetic;

    fn near(found: [f64; 3], expected: [f64; 3], tolerance: f64) {
        for (f, e) in std::iter::zip(found, expected) {
            assert!((f - e).abs() <= tolerance, "{found:?}, expected {expected:?}");
        }
    }

    #[test]
    fn coefficients_are_recovered() {
        let known = OpenCv { numerator: [-0.21, 0.083, -0.017], denominator: [0.0; 3] };
        let target = synthetic(4.0, 0.7, |t| 4.0 * known.radius(t));
        let fit = OpenCv::polynomial(&target).unwrap();
        near(fit.numerator, known.numerator, 1e-9);
        assert!(target.residual_px(|p| 4.0 * fit.radius(p.tan)).max < 1e-9);
        // The quotient contains the polynomial, and so does the one without denominator.
        let quotient = OpenCv::rational(&target).unwrap();
        assert!(target.residual_px(|p| 4.0 * quotient.radius(p.tan)).max < 1e-8);
        let known = OpenCv { numerator: [0.05, -0.004, 0.0], denominator: [0.0; 3] };
        let fit = OpenCv::two_terms(&synthetic(50.0, 0.5, |t| 50.0 * known.radius(t))).unwrap();
        near(fit.numerator, known.numerator, 1e-9);
    }

    #[test]
    fn quotients_are_recovered() {
        let known = OpenCv { numerator: [0.9, -0.3, 0.2], denominator: [1.2, 0.25, 0.1] };
        let target = synthetic(4.0, 1.5, |t| 4.0 * known.radius(t));
        let fit = OpenCv::rational(&target).unwrap();
        assert!(target.residual_px(|p| 4.0 * fit.radius(p.tan)).max < 1e-9);
        near(fit.numerator, known.numerator, 1e-9);
        near(fit.denominator, known.denominator, 1e-9);
    }

    #[test]
    fn lens_without_distortion_has_no_coefficients() {
        let target = synthetic(50.0, 0.5, |t| 50.0 * t);
        for fit in [OpenCv::polynomial(&target), OpenCv::rational(&target)] {
            let fit = fit.unwrap();
            near(fit.numerator, [0.0; 3], 1e-9);
            near(fit.denominator, [0.0; 3], 1e-9);
        }
    }

    #[test]
    fn residual_of_a_noisy_lens_is_that_of_least_squares() {
        // r/f = t + a t⁹ has no such polynomial: a change of any coefficient must not lower the mean square.
        let target = synthetic(5.0, 0.8, |t| 5.0 * (t + 0.01 * t.powi(9)));
        let fit = OpenCv::polynomial(&target).unwrap();
        let rms = |fit: &OpenCv| target.residual_px(|p| 5.0 * fit.radius(p.tan)).rms;
        assert!(rms(&fit) > 1e-3, "{}", rms(&fit));
        for j in 0..3 {
            for step in [1e-5, -1e-5] {
                let mut moved = fit;
                moved.numerator[j] += step;
                assert!(rms(&moved) > rms(&fit));
            }
        }
    }

    #[test]
    fn fisheye_is_refused() {
        let last = 84f64.to_radians().tan();
        let error = OpenCv::polynomial(&synthetic(5.0, last, |t| 5.0 * t.atan())).unwrap_err();
        assert!(
            error.to_string().contains("84.00 degrees") && error.to_string().contains("ftheta"),
            "{error}"
        );
    }
}
