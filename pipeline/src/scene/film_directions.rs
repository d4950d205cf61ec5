//! Directions of a chart in the projection of the film ([`crate::projection`]): of the places of the chart, and the other way.
//!
//! ```text
//! (x, y) = (X, Y)·t(ρ)      ρ = √(X² + Y²),  t = tan θ(ρ)/ρ        X, Y in mm from the axis
//! ```
//! t is a table over ρ, linear between its points: within 10⁻⁵ px of θ(ρ) up to 85°. x grows with X, and y with Y, as θ grows with ρ.
//!
//! A rectangle of places becomes one of directions: x is largest on the side of the largest X, where |Y| is least or largest or t has an extremum. The same
//! holds the other way.

use super::frame::Bounds;
use crate::projection::{FilmProjection, MAX_DEG, Projection};
use crate::real;

/// Points of the table.
const POINTS: usize = 1 << 16;
/// Points of the table between those at which extrema of t are looked for.
const COARSE: usize = 256;
/// Largest x or y of a direction whose place is looked for: 90° but for rounding.
const FARTHEST: f64 = 1e12;

/// Directions of the places of a chart.
#[derive(Debug, PartialEq)]
pub struct FilmDirections {
    projection: FilmProjection,
    /// Points per mm.
    per_mm: f64,
    /// t at multiples of the distance of two points.
    scale: Vec<f64>,
    /// Heights of the extrema of t, mm, and the tangents of their angles.
    turns_mm: Vec<f64>,
    turns_tan: Vec<f64>,
}

impl FilmDirections {
    /// Of places up to `reach_mm` from the axis; none if their angles exceed [`MAX_DEG`].
    pub fn new(projection: FilmProjection, reach_mm: f64) -> Option<Self> {
        if projection.angle_rad(reach_mm).to_degrees() > MAX_DEG {
            return None;
        }
        let per_mm = (POINTS - 2) as f64 / reach_mm;
        let film = Projection::Film(projection);
        let at = |k: usize| film.scale(k as f64 / per_mm).0 / projection.focal_mm;
        let scale: Vec<f64> = (0..POINTS).map(at).collect();
        let coarse = |k: usize| scale[k * COARSE];
        let is_turn = |k: &usize| (coarse(*k) - coarse(k - 1)) * (coarse(k + 1) - coarse(*k)) <= 0.0;
        let turns_mm: Vec<f64> =
            (1..POINTS / COARSE - 1).filter(is_turn).map(|k| (k * COARSE) as f64 / per_mm).collect();
        let turns_tan = turns_mm.iter().map(|mm| projection.tangent(*mm)).collect();
        Some(Self { projection, per_mm, scale, turns_mm, turns_tan })
    }

    /// The direction of a place, mm from the axis.
    #[inline]
    pub fn direction(&self, x_mm: f64, y_mm: f64) -> (f64, f64) {
        let at = (x_mm * x_mm + y_mm * y_mm).sqrt() * self.per_mm;
        let k = (at as usize).min(POINTS - 2);
        let (a, b) = (self.scale[k], self.scale[k + 1]);
        let t = a + (at - k as f64) * (b - a);
        (x_mm * t, y_mm * t)
    }

    /// The place of a direction, mm from the axis.
    fn place(&self, x: f64, y: f64) -> (f64, f64) {
        let rho = real::hypot(x, y);
        let share = self.height_mm(rho) / if rho > 0.0 { rho } else { 1.0 };
        (x * share, y * share)
    }

    fn height_mm(&self, tangent: f64) -> f64 {
        self.projection.height_mm(real::atan(tangent))
    }

    /// How the direction (x, y) changes where its place moves by `step_mm`.
    pub(super) fn change(&self, (x, y): (f64, f64), step_mm: [f64; 2]) -> [f64; 2] {
        let rho = real::hypot(x, y);
        let (across, along) = Projection::Film(self.projection).scale(self.height_mm(rho));
        let axis = if rho > 0.0 { [x / rho, y / rho] } else { [1.0, 0.0] };
        let outwards = axis[0] * step_mm[0] + axis[1] * step_mm[1];
        std::array::from_fn(|k| {
            let beside = step_mm[k] - outwards * axis[k];
            (beside * across + outwards * axis[k] * along) / self.projection.focal_mm
        })
    }

    /// The rectangle of the directions of a rectangle of places in mm.
    pub(super) fn directions(&self, mm: Bounds) -> Bounds {
        bounds(mm, &self.turns_mm, |x, y| self.direction(x, y))
    }

    /// The rectangle of the places, mm, of a rectangle of directions.
    pub(super) fn heights(&self, (low, high): Bounds) -> Bounds {
        let limited = |v: [f64; 2]| v.map(|v| v.clamp(-FARTHEST, FARTHEST));
        bounds((limited(low), limited(high)), &self.turns_tan, |x, y| self.place(x, y))
    }
}

/// Bounds of `map` on a rectangle: radial, growing with each coordinate along it, with extrema of its scale at the radii `turns`.
fn bounds((low, high): Bounds, turns: &[f64], map: impl Fn(f64, f64) -> (f64, f64)) -> Bounds {
    let mut found = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for k in 0..2 {
        let other = 1 - k;
        for side in [low[k], high[k]] {
            let turned = turns.iter().map(|r| (r * r - side * side).max(0.0).sqrt()).flat_map(|v| [-v, v]);
            let inside = turned.chain([0.0]).filter(|v| (low[other]..=high[other]).contains(v));
            for v in [low[other], high[other]].into_iter().chain(inside) {
                let (x, y) = if k == 0 { map(side, v) } else { map(v, side) };
                let at = [x, y][k];
                found.0[k] = found.0[k].min(at);
                found.1[k] = found.1[k].max(at);
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// θ = r/f + c r³ + d r⁵: t turns within the reach where c takes more than tan adds, and d gives it back.
    fn lens(focal_mm: f64, [c, d]: [f64; 2], reach_mm: f64) -> FilmDirections {
        let angle = |r: f64| Ok::<_, ()>(r / focal_mm + c * r.powi(3) + d * r.powi(5));
        let projection = FilmProjection::fit(focal_mm, reach_mm, angle).unwrap().unwrap();
        FilmDirections::new(projection, reach_mm).unwrap()
    }

    #[test]
    fn places_and_directions_are_inverse() {
        let film = lens(5.0, [0.0; 2], 7.2);
        for k in 0..=100 {
            let (x, y) = (7.2 * f64::from(k) / 141.5, -7.2 * f64::from(k % 11) / 15.5);
            let (dx, dy) = film.direction(x, y);
            let r = x.hypot(y);
            let expected = if r > 0.0 { (r / 5.0).tan() / r } else { 0.2 };
            assert!((dx - x * expected).abs() < 2e-7 * (1.0 + dx * dx), "{x} {y}");
            let (px, py) = film.place(dx, dy);
            assert!((px - x).abs() < 1e-8 && (py - y).abs() < 1e-8, "{x} {y}");
            if r > 0.0 {
                let step = 1e-4;
                let by_x = film.change((dx, dy), [step, 0.0]);
                let (ax, ay) = film.direction(x + step / 2.0, y);
                let (bx, by) = film.direction(x - step / 2.0, y);
                let size = (ax - bx).abs() + (ay - by).abs();
                assert!((by_x[0] - (ax - bx)).abs() < 2e-3 * size, "{x} {y}");
                assert!((by_x[1] - (ay - by)).abs() < 2e-3 * size, "{x} {y}");
            }
        }
    }

    #[test]
    fn bounds_hold_all_places_and_directions_of_a_rectangle() {
        let turned = || lens(20.0, [-5e-5, 2.5e-7], 14.0);
        for film in [lens(5.0, [0.0; 2], 7.2), turned(), lens(20.0, [4e-6, 0.0], 14.0)] {
            let reach = film.scale.len() as f64 / film.per_mm / 1.5;
            for i in 0..40 {
                let low = [f64::from(i % 7) / 7.0 * 1.4 - 0.9, f64::from(i % 11) / 11.0 * 1.4 - 0.9];
                let high = [low[0] + 0.05 * f64::from(i % 5), low[1] + 0.04 * f64::from(i % 3)];
                let (low, high) = (low.map(|v| v * reach), high.map(|v| v * reach));
                let (from, to) = film.directions((low, high));
                let (back_low, back_high) = film.heights((from, to));
                for a in 0..=10 {
                    for b in 0..=10 {
                        let at = |k: usize, share: i32| low[k] + (high[k] - low[k]) * f64::from(share) / 10.0;
                        let (x, y) = (at(0, a), at(1, b));
                        let (dx, dy) = film.direction(x, y);
                        let slack = 1e-4 * reach;
                        for (v, k) in [(dx, 0), (dy, 1)] {
                            assert!(v >= from[k] - slack && v <= to[k] + slack, "{v} {from:?} {to:?}");
                        }
                        for (v, k) in [(x, 0), (y, 1)] {
                            assert!(v >= back_low[k] - slack && v <= back_high[k] + slack);
                        }
                    }
                }
            }
        }
        let near = |v: &f64| (3.0..8.0).contains(v);
        assert!(turned().turns_mm.iter().any(near), "{:?}", turned().turns_mm);
    }

    #[test]
    fn a_chart_does_not_reach_90_degrees() {
        let projection = FilmProjection::fit(5.0, 7.0, |r: f64| Ok::<_, ()>(r / 5.0)).unwrap().unwrap();
        assert!(FilmDirections::new(projection, 7.8).is_some());
        assert!(FilmDirections::new(projection, 7.9).is_none());
    }
}
