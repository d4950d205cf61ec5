//! Coordinates of one block: r and θ of every pixel about the optical axis, relative to the block's centre, in f32; x and y for Cartesian
//! grids of nodes.
//!
//! Far from the axis, with (a, b) the offset of a pixel along and across the ray to the block's centre at radius rc,
//! ```text
//! t = b/(rc + a),   r − rc = a + b·t/(√(1 + t²) + 1),   θ − θc = atan t,   |t| ≤ 0.6
//! ```
//! without cancellation and with one division. Near the axis (rc < 2.6 half sides) both are computed in f64.

use crate::real;
use std::f64::consts::TAU;

/// Block half sides below which azimuths are computed in f64 and may wrap. At 2.6 the farthest pixel across,
/// √2 half sides off the ray, is at most atan(0.6) away: the domain of [`ATAN`].
const NEAR_HALF_SIDES: f64 = 2.6;

/// atan(t)/t as a polynomial in t² on t² ≤ 0.36: Chebyshev interpolation at 8 nodes, error below 3e-8 with f32 coefficients (see test).
pub(crate) const ATAN: [f32; 8] = [
    1.0,
    -0.333_333_28,
    0.199_996_62,
    -0.142_780_1,
    0.110_234_95,
    -0.085_345_78,
    0.056_279_43,
    -0.021_495_929,
];

/// 1/(√(1 + z) + 1) as a polynomial in z = t² ≤ 0.36: Chebyshev interpolation at 6 nodes, error below 2e-8 (see test),
/// which is 1e-6 px at the corner of a 200-px block.
pub(crate) const SECANT: [f32; 6] =
    [0.5, -0.124_998_435, 0.062_448_15, -0.038_421_456, 0.023_619_473, -0.009_596_474];

/// A block's first pixel relative to the axis (px) and its size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockPlace {
    /// Row of the first pixel minus the axis row.
    pub dy_px: f64,
    /// Column of the first pixel minus the axis column.
    pub dx_px: f64,
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
}

/// Extent of a block of pixels in polar coordinates about the axis. Of a Cartesian grid, x stands for r and y for θ, in px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolarExtent {
    /// Radius of the block's centre, px.
    pub r_px: f64,
    /// Azimuth of the block's centre, rad.
    pub azimuth_rad: f64,
    /// Smallest and largest r of a pixel, relative to `r_px`.
    pub r: (f32, f32),
    /// Smallest and largest θ of a pixel, relative to `azimuth_rad`; not used if `wraps`.
    pub theta: (f32, f32),
    /// Whether the block is so near the axis that azimuths may wrap inside it.
    pub wraps: bool,
}

impl BlockPlace {
    /// (centre's offset from the first pixel (y, x); centre radius, px; centre azimuth, rad; whether near the axis).
    pub(crate) fn centre(&self) -> (f64, f64, f64, f64, bool) {
        let (hy, hx) = ((self.rows as f64 - 1.0) / 2.0, (self.cols as f64 - 1.0) / 2.0);
        let (y, x) = (self.dy_px + hy, self.dx_px + hx);
        let r = real::hypot(y, x);
        (hy, hx, r, real::atan2(y, x), r < NEAR_HALF_SIDES * hy.max(hx).max(0.5))
    }

    /// Fills `r` and `theta` (`rows` × `cols`, row stride `stride`) and returns the block's extent.
    pub fn polar(&self, stride: usize, r: &mut [f32], theta: &mut [f32]) -> PolarExtent {
        let (hy, hx, rc, ac, wraps) = self.centre();
        let mut extent = PolarExtent {
            r_px: rc,
            azimuth_rad: ac,
            r: (f32::INFINITY, f32::NEG_INFINITY),
            theta: (f32::INFINITY, f32::NEG_INFINITY),
            wraps,
        };
        let (cos, sin) = (real::cos(ac) as f32, real::sin(ac) as f32);
        let rcf = rc as f32;
        for y in 0..self.rows {
            let r = &mut r[y * stride..][..self.cols];
            let theta = &mut theta[y * stride..][..self.cols];
            if wraps {
                for (x, (r, theta)) in r.iter_mut().zip(theta.iter_mut()).enumerate() {
                    let (dy, dx) = (self.dy_px + y as f64, self.dx_px + x as f64);
                    let angle = real::atan2(dy, dx) - ac;
                    *r = (real::hypot(dy, dx) - rc) as f32;
                    *theta = (angle - TAU * (angle / TAU).round()) as f32;
                }
            } else {
                let dy = (y as f64 - hy) as f32;
                for (x, (r, theta)) in r.iter_mut().zip(theta.iter_mut()).enumerate() {
                    let dx = x as f32 - hx as f32;
                    let (along, across) = (dx * cos + dy * sin, dy * cos - dx * sin);
                    let t = across / (rcf + along);
                    *r = along + across * t * polynomial(&SECANT, t * t);
                    *theta = t * polynomial(&ATAN, t * t);
                }
            }
            for (&r, &t) in r.iter().zip(theta.iter()) {
                extent.r = (extent.r.0.min(r), extent.r.1.max(r));
                extent.theta = (extent.theta.0.min(t), extent.theta.1.max(t));
            }
        }
        extent
    }

    /// As [`BlockPlace::polar`], with x right and y down from the axis in place of r and θ: exact.
    pub fn cartesian(&self, stride: usize, x: &mut [f32], y: &mut [f32]) -> PolarExtent {
        let (hy, hx) = ((self.rows as f64 - 1.0) / 2.0, (self.cols as f64 - 1.0) / 2.0);
        for row in 0..self.rows {
            let dy = (row as f64 - hy) as f32;
            y[row * stride..][..self.cols].fill(dy);
            for (col, x) in x[row * stride..][..self.cols].iter_mut().enumerate() {
                *x = (col as f64 - hx) as f32;
            }
        }
        self.cartesian_extent()
    }

    /// The extent of [`BlockPlace::cartesian`].
    pub(crate) fn cartesian_extent(&self) -> PolarExtent {
        let (hy, hx) = ((self.rows as f64 - 1.0) / 2.0, (self.cols as f64 - 1.0) / 2.0);
        PolarExtent {
            r_px: self.dx_px + hx,
            azimuth_rad: self.dy_px + hy,
            r: (-hx as f32, hx as f32),
            theta: (-hy as f32, hy as f32),
            wraps: false,
        }
    }
}

/// Σ coefficients[i]·x^i by Horner's rule.
fn polynomial(coefficients: &[f32], x: f32) -> f32 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_approximate_over_their_domain() {
        let at = |coefficients: &[f32], x: f64| {
            coefficients.iter().rev().fold(0.0, |sum, c| sum * x + f64::from(*c))
        };
        for i in 0..=1000 {
            let t = 0.6 * f64::from(i) / 1000.0;
            let atan = t * at(&ATAN, t * t) - t.atan();
            assert!(atan.abs() < 3e-8, "{t}: {atan}");
            let secant = at(&SECANT, t * t) - 1.0 / ((1.0 + t * t).sqrt() + 1.0);
            assert!(secant.abs() < 2e-8, "{t}: {secant}");
        }
    }

    #[test]
    fn relative_coordinates_agree_with_f64() {
        for (dy_px, dx_px) in
            [(-7070.0, -7070.0), (-71.0, -71.0), (300.0, -20.5), (-3.0, 6900.25), (0.0, 0.0)]
        {
            let place = BlockPlace { dy_px, dx_px, rows: 142, cols: 131 };
            let (mut r, mut theta) = (vec![0f32; 142 * 131], vec![0f32; 142 * 131]);
            let extent = place.polar(131, &mut r, &mut theta);
            for (y, x) in [(0, 0), (141, 130), (70, 3), (5, 99), (141, 0)] {
                let (py, px) = (dy_px + y as f64, dx_px + x as f64);
                let i = y * 131 + x;
                assert!((f64::from(r[i]) + extent.r_px - py.hypot(px)).abs() < 2e-5);
                let error = f64::from(theta[i]) + extent.azimuth_rad - py.atan2(px);
                let error = error - TAU * (error / TAU).round();
                assert!(error.abs() < 3e-7 || py.hypot(px) == 0.0, "{error}");
            }
        }
    }
}
