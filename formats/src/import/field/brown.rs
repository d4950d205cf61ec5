//! Distortion by Brown's model, with the coefficients of OpenCV, and its inverse.
//!
//! ```text
//! x_d = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2x²)        r² = x² + y²
//! y_d = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2y²) + 2 p2 x y
//! film pixel = c + f·(x_d, y_d)       ideal point = f·pitch·(x, y)
//! ```
//! (x, y) are slopes of the field point, y down; pixel (0, 0) is the centre of the first one. OpenCV's order of coefficients
//! is (k1, k2, p1, p2, k3). Source: D. C. Brown, "Decentering distortion of lenses", Photogrammetric Engineering 32 (1966)
//! 444-462; OpenCV, module calib3d. The inverse is found by Newton's rule along the line from the principal point, where both
//! agree.

/// Steps along the line.
const STEPS: usize = 8;
/// Maximum iterations of a step.
const MAX_ITERATIONS: usize = 50;

/// A calibrated camera.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Brown {
    /// Focal length, px.
    pub f_px: f64,
    /// Principal point, px.
    pub c_px: [f64; 2],
    /// Radial coefficients.
    pub k: [f64; 3],
    /// Tangential coefficients.
    pub p: [f64; 2],
    /// Width and height of the film, px.
    pub size_px: [f64; 2],
    /// Pitch of its pixels, µm.
    pub pitch_um: f64,
}

impl Brown {
    /// f·pitch, mm.
    pub fn focal_length_mm(&self) -> f64 {
        self.f_px * self.pitch_um * 1e-3
    }

    /// Half the width (0) or height (1) of the film, mm.
    pub fn half_side_mm(&self, axis: usize) -> f64 {
        0.5e-3 * self.size_px[axis] * self.pitch_um
    }

    /// The ideal point of a film place, mm; none where the model has no inverse.
    pub fn ideal_mm(&self, film_mm: [f64; 2]) -> Option<[f64; 2]> {
        let distorted = [0, 1].map(|axis| {
            let px = film_mm[axis] / (self.pitch_um * 1e-3) + 0.5 * (self.size_px[axis] - 1.0);
            (px - self.c_px[axis]) / self.f_px
        });
        Some(self.undistorted(distorted)?.map(|slope| slope * self.focal_length_mm()))
    }

    /// Slopes as the film has them, and their derivatives [∂x_d/∂x, ∂x_d/∂y = ∂y_d/∂x, ∂y_d/∂y].
    fn distorted(&self, [x, y]: [f64; 2]) -> ([f64; 2], [f64; 3]) {
        let ([k1, k2, k3], [p1, p2]) = (self.k, self.p);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3));
        let point = [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ];
        let derivatives = [
            radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
            x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y,
            radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
        ];
        (point, derivatives)
    }

    /// Slopes without distortion; none where the model turns back or Newton's rule does not converge.
    fn undistorted(&self, to: [f64; 2]) -> Option<[f64; 2]> {
        let mut at = [0.0, 0.0];
        for step in 1..=STEPS {
            at = self.newton(at, to.map(|v| v * step as f64 / STEPS as f64))?;
        }
        Some(at)
    }

    fn newton(&self, mut at: [f64; 2], to: [f64; 2]) -> Option<[f64; 2]> {
        let scale = 1.0 + to[0].abs().max(to[1].abs());
        for _ in 0..MAX_ITERATIONS {
            let (found, [xx, xy, yy]) = self.distorted(at);
            let det = xx * yy - xy * xy;
            if !(det > 0.0 && det.is_finite() && xx + yy > 0.0) {
                return None;
            }
            let [x, y] = [to[0] - found[0], to[1] - found[1]];
            if x.abs().max(y.abs()) <= 4.0 * f64::EPSILON * scale {
                return Some(at);
            }
            let by = [(yy * x - xy * y) / det, (xx * y - xy * x) / det];
            at = [at[0] + by[0], at[1] + by[1]];
            if by[0].abs().max(by[1].abs()) <= f64::EPSILON * scale {
                return Some(at);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(k: [f64; 3], p: [f64; 2]) -> Brown {
        Brown { f_px: 3000.0, c_px: [2010.3, 1490.7], k, p, size_px: [4000.0, 3000.0], pitch_um: 2.0 }
    }

    /// `cv2.projectPoints`, written out: the distorted pixel of slopes (0.4, −0.3), with numbers worked by hand.
    #[test]
    fn order_of_the_coefficients_is_that_of_opencv() {
        let camera = camera([-0.2, 0.05, 0.01], [1e-3, -2e-3]);
        let ([x, y], _) = camera.distorted([0.4, -0.3]);
        // r² = 0.25: radial 1 − 0.05 + 0.003125 + 0.00015625 = 0.95328125.
        assert!((x - (0.3813125 - 2.4e-4 - 2e-3 * 0.57)).abs() < 1e-15, "{x}");
        assert!((y - (-0.285984375 + 1e-3 * 0.43 + 4.8e-4)).abs() < 1e-15, "{y}");
    }

    #[test]
    fn inverse_meets_forward_evaluation_to_1e_10() {
        let camera = camera([-0.2, 0.05, 0.01], [1e-3, -2e-3]);
        let mut worst: f64 = 0.0;
        for (x, y) in
            (-10..=10).flat_map(|j| (-10..=10).map(move |i| (0.06 * f64::from(i), 0.045 * f64::from(j))))
        {
            let ([u, v], _) = camera.distorted([x, y]);
            let film = [0, 1].map(|axis| {
                (camera.c_px[axis] + 3000.0 * [u, v][axis] - 0.5 * (camera.size_px[axis] - 1.0)) * 2e-3
            });
            let ideal = camera.ideal_mm(film).unwrap();
            worst = worst.max((ideal[0] - 6.0 * x).abs()).max((ideal[1] - 6.0 * y).abs());
        }
        assert!(worst < 1e-10, "{worst} mm");
    }

    /// x(1 − x²) has its largest value 2/(3√3) = 0.3849 at x = 1/√3.
    #[test]
    fn beyond_the_turning_point_is_no_ideal_point() {
        let camera = camera([-1.0, 0.0, 0.0], [0.0; 2]);
        assert!(camera.undistorted([0.38, 0.0]).is_some());
        assert_eq!(camera.undistorted([0.39, 0.0]), None);
    }
}
