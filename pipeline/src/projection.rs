//! Projections of a chart: at which distance from its axis a direction of the scene lies.
//!
//! ```text
//! planar   r = f_D tan θ     the IDEAL image plane, as other renderers make pictures
//! film     r = ρ(θ)          the REAL height at which the chief ray from that direction meets the film, at the primary wavelength λ₀
//! ```
//! θ is the angle from the axis at the centre of the entrance pupil, f_D the distortion focal length of the lens. A planar chart of a fisheye has (f_D tan θ)² of
//! area: one of 85° needs 90 times the pixels of its film. On a chart in the projection of the film, the point of ideal height h lies at ρ(atan(h/f_D)), and
//! where a band is that of λ₀ each film pixel shows the chart pixel in the same place.
//!
//! ```text
//! θ(r) = r Σ_k a_k T_k(2 (r/R)² − 1)   r ≤ R         θ(R) + θ′(R) (r − R)   beyond         T_k: Chebyshev polynomials
//! ```
//! θ is odd in r. The coefficients interpolate it at the Chebyshev points of (r/R)²; ρ is its inverse by Newton's iteration.

use crate::real;
use std::f64::consts::{FRAC_PI_2, PI};

/// Largest angle from the axis of a place of a chart in the projection of the film, degrees.
pub const MAX_DEG: f64 = 89.5;
/// Coefficients of θ/r.
pub const COEFFICIENTS: usize = 20;
/// Steps of Newton's iteration, and the error at which it ends, of the height.
const NEWTON: (usize, f64) = (60, 1e-14);
/// Places at which θ must ascend.
const CHECKED: usize = 400;

/// Where a direction of the scene lies on a chart.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Projection {
    /// On the ideal image plane.
    #[default]
    Planar,
    /// Where the lens puts it on the film at its primary wavelength.
    Film(FilmProjection),
}

impl Projection {
    /// The height on the chart of the ideal height `ideal_mm`, both mm from the axis.
    pub fn chart_mm(&self, ideal_mm: f64) -> f64 {
        match self {
            Self::Planar => ideal_mm,
            Self::Film(film) => film.height_mm(real::atan2(ideal_mm, film.focal_mm)),
        }
    }

    /// The ideal height of the height `chart_mm` on the chart, both mm from the axis; infinity from 90° on.
    pub fn ideal_mm(&self, chart_mm: f64) -> f64 {
        match self {
            Self::Planar => chart_mm,
            Self::Film(film) => film.focal_mm * film.tangent(chart_mm),
        }
    }

    /// Ideal height over height on the chart, and the derivative of the one by the other, at `chart_mm` from the axis; infinity from 90° on.
    pub fn scale(&self, chart_mm: f64) -> (f64, f64) {
        match self {
            Self::Planar => (1.0, 1.0),
            Self::Film(film) => {
                let (_, slope) = film.angle_and_slope(chart_mm);
                let tangent = film.tangent(chart_mm);
                let across = if chart_mm == 0.0 { slope } else { tangent / chart_mm };
                (film.focal_mm * across, film.focal_mm * (1.0 + tangent * tangent) * slope)
            }
        }
    }

    /// Angle from the axis of the height `chart_mm` on the chart of a lens of the distortion focal length `focal_mm`, radians.
    pub fn angle_rad(&self, chart_mm: f64, focal_mm: f64) -> f64 {
        match self {
            Self::Planar => real::atan2(chart_mm, focal_mm.abs()),
            Self::Film(film) => film.angle_rad(chart_mm),
        }
    }

    /// Where the point `[x, y]` of the ideal image plane lies on the chart, mm from the axis.
    pub fn point_mm(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        self.moved([x, y], |h| self.chart_mm(h))
    }

    /// Where the point `[x, y]` of the chart lies on the ideal image plane, mm from the axis.
    pub fn ideal_point_mm(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        self.moved([x, y], |h| self.ideal_mm(h))
    }

    fn moved(&self, [x, y]: [f64; 2], height: impl Fn(f64) -> f64) -> [f64; 2] {
        let r = real::hypot(x, y);
        match self {
            Self::Film(_) if r > 0.0 => [x, y].map(|v| v * (height(r) / r)),
            _ => [x, y],
        }
    }
}

/// The projection of a lens on its film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmProjection {
    /// Distortion focal length f_D of the lens, mm.
    pub focal_mm: f64,
    /// R, mm.
    pub radius_mm: f64,
    /// a_k, rad/mm.
    pub coefficients: [f64; COEFFICIENTS],
}

impl FilmProjection {
    /// Interpolates `angle_rad`, the angle of a height on the film in mm, up to the height `radius_mm`; none if the angle does not ascend with the height.
    ///
    /// # Errors
    /// Those of `angle_rad`.
    pub fn fit<E>(
        focal_mm: f64,
        radius_mm: f64,
        mut angle_rad: impl FnMut(f64) -> Result<f64, E>,
    ) -> Result<Option<Self>, E> {
        let n = COEFFICIENTS as f64;
        let phase = |j: usize| PI * (j as f64 + 0.5) / n;
        let mut ratio = [0.0; COEFFICIENTS];
        for (j, ratio) in ratio.iter_mut().enumerate() {
            let r = radius_mm * (0.5 * (1.0 + real::cos(phase(j)))).sqrt();
            *ratio = angle_rad(r)? / r;
        }
        let coefficients = std::array::from_fn(|k| {
            let terms = ratio.iter().enumerate().map(|(j, v)| v * real::cos(k as f64 * phase(j)));
            (if k == 0 { 1.0 } else { 2.0 }) / n * terms.sum::<f64>()
        });
        let fitted = Self { focal_mm, radius_mm, coefficients };
        Ok(fitted.ascends().then_some(fitted))
    }

    /// Whether all numbers are finite and positive where they must be, and the angle ascends with the height.
    pub fn ascends(&self) -> bool {
        let at = |k: usize| self.radius_mm * k as f64 / CHECKED as f64;
        let is_positive = |v: f64| v > 0.0 && v.is_finite();
        is_positive(self.focal_mm)
            && is_positive(self.radius_mm)
            && self.coefficients.iter().all(|a| a.is_finite())
            && (0..=CHECKED).all(|k| self.angle_and_slope(at(k)).1 > 0.0)
    }

    /// θ, radians, of a height on the film, mm.
    pub fn angle_rad(&self, height_mm: f64) -> f64 {
        self.angle_and_slope(height_mm).0
    }

    /// tan θ of a height on the film, mm; infinity from 90° on.
    pub fn tangent(&self, height_mm: f64) -> f64 {
        let angle = self.angle_rad(height_mm);
        if angle.abs() >= FRAC_PI_2 {
            return f64::INFINITY.copysign(angle);
        }
        real::tan(angle)
    }

    /// θ and dθ/dr.
    fn angle_and_slope(&self, height_mm: f64) -> (f64, f64) {
        let r = height_mm.abs().min(self.radius_mm);
        let s = r / self.radius_mm;
        let u = 2.0 * s * s - 1.0;
        // Clenshaw's recurrence of the sum and of its derivative by u.
        let (mut b1, mut b2, mut d1, mut d2) = (0.0, 0.0, 0.0, 0.0);
        for a in self.coefficients[1..].iter().rev() {
            (d1, d2) = (2.0 * (u * d1 + b1) - d2, d1);
            (b1, b2) = (2.0 * u * b1 - b2 + a, b1);
        }
        let ratio = u * b1 - b2 + self.coefficients[0];
        let by_u = b1 + u * d1 - d2;
        // du/dr = 4 r/R².
        let slope = ratio + r * by_u * 4.0 * s / self.radius_mm;
        let angle = r * ratio + (height_mm.abs() - r) * slope;
        (angle.copysign(height_mm), slope)
    }

    /// The height on the film, mm, of the angle θ, radians.
    pub fn height_mm(&self, angle_rad: f64) -> f64 {
        let asked = angle_rad.abs();
        let (last, slope) = self.angle_and_slope(self.radius_mm);
        if asked >= last {
            return (self.radius_mm + (asked - last) / slope).copysign(angle_rad);
        }
        let (mut low, mut high) = (0.0, self.radius_mm);
        let mut r = self.radius_mm * asked / last;
        for _ in 0..NEWTON.0 {
            let (angle, slope) = self.angle_and_slope(r);
            let step = (asked - angle) / slope;
            if step > 0.0 {
                low = r;
            } else {
                high = r;
            }
            let next = r + step;
            if step.abs() <= NEWTON.1 * self.radius_mm {
                r = next;
                break;
            }
            r = if next > low && next < high { next } else { 0.5 * (low + high) };
        }
        r.copysign(angle_rad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// r = 2 f sin(θ/2): equal solid angles have equal areas.
    fn equisolid(focal_mm: f64, radius_mm: f64) -> FilmProjection {
        let angle = |r: f64| {
            let s = r / (2.0 * focal_mm);
            Ok::<_, ()>(2.0 * real::atan2(s, (1.0 - s * s).sqrt()))
        };
        FilmProjection::fit(focal_mm, radius_mm, angle).unwrap().unwrap()
    }

    #[test]
    fn an_equisolid_projection_is_interpolated_and_inverted() {
        let film = equisolid(5.0, 6.9);
        for k in 0..=200 {
            let r = 6.9 * f64::from(k) / 200.0;
            let s: f64 = r / 10.0;
            let angle = 2.0 * s.asin();
            assert!((film.angle_rad(r) - angle).abs() < 1e-13, "{r}");
            assert!((film.height_mm(angle) - r).abs() < 1e-12, "{r}");
            assert_eq!(film.angle_rad(-r), -film.angle_rad(r));
        }
        // Beyond, θ goes on with its slope, dθ/dr = 1/(f cos(θ/2)).
        let (last, slope) = (2.0 * 0.69_f64.asin(), 0.2 / (1.0 - 0.69_f64 * 0.69).sqrt());
        assert!((film.angle_rad(7.1) - last - 0.2 * slope).abs() < 1e-11);
        assert!((film.height_mm(last + 0.2 * slope) - 7.1).abs() < 1e-10);
        let projection = Projection::Film(film);
        assert!((projection.chart_mm(projection.ideal_mm(6.0)) - 6.0).abs() < 1e-12);
        let [x, y] = projection.point_mm([3.0, -4.0]);
        assert!((x / y + 0.75).abs() < 1e-15 && (x.hypot(y) - projection.chart_mm(5.0)).abs() < 1e-14);
        let (across, along) = projection.scale(4.0);
        let ideal = |r: f64| projection.ideal_mm(r);
        assert!((across - ideal(4.0) / 4.0).abs() < 1e-12);
        assert!((along - (ideal(4.0 + 1e-5) - ideal(4.0 - 1e-5)) / 2e-5).abs() < 1e-6);
        assert!((projection.scale(0.0).0 - projection.scale(1e-6).0).abs() < 1e-9);
        let back = projection.ideal_point_mm([x, y]);
        assert!((back[0] - 3.0).abs() < 1e-12 && (back[1] + 4.0).abs() < 1e-12);
        assert_eq!(projection.point_mm([0.0, 0.0]), [0.0, 0.0]);
    }

    #[test]
    fn from_90_degrees_on_there_is_no_ideal_height() {
        let film = equisolid(5.0, 7.0);
        let r = film.height_mm(FRAC_PI_2 + 1e-9);
        assert_eq!(Projection::Film(film).ideal_mm(r), f64::INFINITY);
        assert!(Projection::Film(film).ideal_mm(0.99 * r) < 1e3);
    }

    #[test]
    fn angles_that_do_not_ascend_are_refused() {
        let folded = FilmProjection::fit(5.0, 4.0, |r: f64| Ok::<_, ()>(0.2 * r - 0.012 * r * r * r));
        assert_eq!(folded, Ok(None));
        let broken = FilmProjection { coefficients: [f64::NAN; COEFFICIENTS], ..equisolid(5.0, 6.9) };
        assert!(!broken.ascends());
    }

    #[test]
    fn a_planar_chart_is_the_ideal_image_plane() {
        let planar = Projection::Planar;
        assert_eq!((planar.chart_mm(3.0), planar.ideal_mm(3.0)), (3.0, 3.0));
        assert!((planar.angle_rad(5.0, 5.0) - PI / 4.0).abs() < 1e-15);
    }
}
