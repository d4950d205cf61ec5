//! Polar maps of one block: r and θ of every pixel about the optical axis, relative to the block's centre, in f32.
//!
//! Far from the axis, with (a, b) the offset of a pixel along and across the ray to the block's centre at radius rc,
//!     t = b/(rc + a),   r − rc = a + b·t/(√(1 + t²) + 1),   θ − θc = atan t,   |t| ≤ 0.6
//! which loses nothing to cancellation and takes one division. Near the axis (rc < 2.6 half sides) both are taken in f64.

use crate::psf::grid::Reach;
use crate::real;
use std::f64::consts::TAU;

/// Block half sides below which azimuths are computed in f64 and may wrap. At 2.6 the farthest pixel across,
/// √2 half sides off the ray, sees at most atan(0.6): the domain of [`ATAN`].
const NEAR: f64 = 2.6;

/// atan(t)/t as a polynomial in t² on t² ≤ 0.36: Chebyshev interpolation at 8 nodes, error below 2e-9 (see test).
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

impl BlockPlace {
    /// (centre's offset from the first pixel (y, x); centre radius, px; centre azimuth, rad; whether near the axis).
    pub(crate) fn centre(&self) -> (f64, f64, f64, f64, bool) {
        let (hy, hx) = ((self.rows as f64 - 1.0) / 2.0, (self.cols as f64 - 1.0) / 2.0);
        let (y, x) = (self.dy_px + hy, self.dx_px + hx);
        let r = real::hypot(y, x);
        (hy, hx, r, real::atan2(y, x), r < NEAR * hy.max(hx).max(0.5))
    }

    /// Fills `r` and `theta` (`rows` × `cols`, row stride `stride`) and tells the block's reach.
    pub fn polar(&self, stride: usize, r: &mut [f32], theta: &mut [f32]) -> Reach {
        let (hy, hx, rc, ac, around) = self.centre();
        let mut reach = Reach {
            r_px: rc,
            azimuth_rad: ac,
            r: (f32::INFINITY, f32::NEG_INFINITY),
            theta: (f32::INFINITY, f32::NEG_INFINITY),
            around,
        };
        let (cos, sin) = (real::cos(ac) as f32, real::sin(ac) as f32);
        let rcf = rc as f32;
        for y in 0..self.rows {
            let r = &mut r[y * stride..][..self.cols];
            let theta = &mut theta[y * stride..][..self.cols];
            if around {
                for (x, (r, theta)) in r.iter_mut().zip(theta.iter_mut()).enumerate() {
                    let (dy, dx) = (self.dy_px + y as f64, self.dx_px + x as f64);
                    let turn = real::atan2(dy, dx) - ac;
                    *r = (real::hypot(dy, dx) - rc) as f32;
                    *theta = (turn - TAU * (turn / TAU).round()) as f32;
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
                reach.r = (reach.r.0.min(r), reach.r.1.max(r));
                reach.theta = (reach.theta.0.min(t), reach.theta.1.max(t));
            }
        }
        reach
    }
}

/// By Horner's rule.
fn polynomial(coefficients: &[f32], x: f32) -> f32 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_hold_over_their_domain() {
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
    fn relative_maps_agree_with_f64_everywhere() {
        for (dy_px, dx_px) in
            [(-7070.0, -7070.0), (-71.0, -71.0), (300.0, -20.5), (-3.0, 6900.25), (0.0, 0.0)]
        {
            let place = BlockPlace { dy_px, dx_px, rows: 142, cols: 131 };
            let (mut r, mut theta) = (vec![0f32; 142 * 131], vec![0f32; 142 * 131]);
            let reach = place.polar(131, &mut r, &mut theta);
            for (y, x) in [(0, 0), (141, 130), (70, 3), (5, 99), (141, 0)] {
                let (py, px) = (dy_px + y as f64, dx_px + x as f64);
                let i = y * 131 + x;
                assert!((f64::from(r[i]) + reach.r_px - py.hypot(px)).abs() < 2e-5);
                let turn = f64::from(theta[i]) + reach.azimuth_rad - py.atan2(px);
                let turn = turn - TAU * (turn / TAU).round();
                assert!(turn.abs() < 3e-7 || py.hypot(px) == 0.0, "{turn}");
            }
        }
    }
}
