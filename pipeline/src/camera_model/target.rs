//! What a model is fitted to: field points over the area of the film, each with the share of the film that it stands for.
//!
//! ```text
//! φ(r) = 4·max(0, asin(min(1, a/r)) + asin(min(1, b/r)) − π/2)      a, b half of the sides between the outermost pixel centres, mm;  2π of a circle
//! ```
//! The corner has no area, but its residual counts for the maximum.

use super::field_map::{FieldPoint, FieldSource};
use crate::design::error::DesignError;
use crate::geometry::Size;
use crate::least_squares::Qr;
use crate::real;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};

/// Steps of the REAL image height from the axis to the outermost field point.
const STEPS: u32 = 1000;
/// Steps at which a fitted model is checked between two field points.
const FINE: u32 = 4;

/// The part of the film plane that a model is fitted on: a circle about the axis, within the film if it has one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmArea {
    half_mm: Option<[f64; 2]>,
    last_mm: f64,
}

impl FilmArea {
    /// The circle of radius `last_mm`.
    pub fn circle(last_mm: f64) -> Self {
        Self { half_mm: None, last_mm }
    }

    /// The pixel centres of a film whose middle is on the axis, within the circle of radius `last_mm`.
    pub fn film(size: Size, pitch_mm: f64, last_mm: f64) -> Self {
        let half_mm = [size.width, size.height].map(|n| (n as f64 - 1.0) / 2.0 * pitch_mm);
        Self { half_mm: Some(half_mm), last_mm: last_mm.min(real::hypot(half_mm[0], half_mm[1])) }
    }

    /// Radius of the outermost point, mm.
    pub fn last_mm(&self) -> f64 {
        self.last_mm
    }

    /// Angle of the circle of radius `r_mm` that lies on the film, rad.
    fn arc_rad(&self, r_mm: f64) -> f64 {
        let Some(half_mm) = self.half_mm else { return 2.0 * PI };
        let [a, b] = half_mm.map(|half| real::asin((half / r_mm).min(1.0)));
        (4.0 * (a + b - FRAC_PI_2)).max(0.0)
    }
}

/// Field points with weights.
#[derive(Clone, Debug)]
pub struct Target {
    /// Focal length on the axis, mm.
    pub focal_mm: f64,
    /// Without the axis, ascending.
    pub points: Vec<FieldPoint>,
    weights: Vec<f64>,
    pitch_mm: f64,
}

/// Differences of a model from the lens over the film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Residual {
    /// Maximum of the absolute difference.
    pub max: f64,
    /// REAL image height of the maximum, mm.
    pub at_mm: f64,
    /// Root of the mean square over the area.
    pub rms: f64,
}

impl Target {
    /// The field points of `source` on `area`, whose pixels have `pitch_mm`.
    ///
    /// # Errors
    /// An area beyond the field.
    pub fn new(source: &FieldSource<'_>, area: &FilmArea, pitch_mm: f64) -> Result<Self, DesignError> {
        let height = |i: u32| area.last_mm * f64::from(i) / f64::from(STEPS);
        let points = (1..=STEPS).into_par_iter().map(|i| source.point_at(height(i)));
        let points: Vec<FieldPoint> = points.collect::<Result<_, _>>()?;
        Ok(Self::of_points(source.focal_mm()?, points, area, pitch_mm))
    }

    /// These field points, without the axis, ascending.
    pub fn of_points(focal_mm: f64, points: Vec<FieldPoint>, area: &FilmArea, pitch_mm: f64) -> Self {
        let weights = points.iter().map(|p| p.real_mm * area.arc_rad(p.real_mm)).collect();
        Self { focal_mm, points, weights, pitch_mm }
    }

    /// Each `step`th field point, up to the last.
    pub(super) fn thinned(&self, step: usize) -> Self {
        fn of<T: Copy>(all: &[T], step: usize) -> Vec<T> {
            let mut kept: Vec<T> = all.iter().rev().step_by(step).copied().collect();
            kept.reverse();
            kept
        }
        Self { points: of(&self.points, step), weights: of(&self.weights, step), ..*self }
    }

    /// Pixel pitch, mm.
    pub fn pitch_mm(&self) -> f64 {
        self.pitch_mm
    }

    /// The outermost field point.
    pub fn last(&self) -> FieldPoint {
        self.points[self.points.len() - 1]
    }

    /// The x that minimises Σ w (Σ_j x_j·column_j − right)² over the field points; none if columns depend on each other.
    pub(super) fn solve<const N: usize>(
        &self,
        columns: impl Fn(usize, &FieldPoint) -> ([f64; N], f64),
        count: usize,
    ) -> Option<Vec<f64>> {
        let mut matrix = vec![Vec::with_capacity(self.points.len()); count];
        let mut right = Vec::with_capacity(self.points.len());
        for (i, point) in self.points.iter().enumerate() {
            let root = self.weights[i].sqrt();
            let (row, value) = columns(i, point);
            std::iter::zip(&mut matrix, row).for_each(|(column, v)| column.push(root * v));
            right.push(root * value);
        }
        Some(Qr::new(matrix)?.solve(&right))
    }

    /// `c_j` of min Σ w (Σ_j c_j·v^`powers_j` − `right`)² for a variable v of the field points; powers of v over its maximum are well scaled.
    pub(super) fn polynomial<const N: usize>(
        &self,
        powers: [i32; N],
        variable: impl Fn(&FieldPoint) -> f64,
        right: impl Fn(&FieldPoint) -> f64,
    ) -> Option<[f64; N]> {
        let last = variable(&self.last());
        let row = |point: &FieldPoint| powers.map(|p| (variable(point) / last).powi(p));
        let found = self.solve(|_, point| (row(point), right(point)), N)?;
        Some(std::array::from_fn(|j| found[j] / last.powi(powers[j])))
    }

    /// `difference` of the field points over the film.
    pub fn residual(&self, difference: impl Fn(&FieldPoint) -> f64) -> Residual {
        let mut all = Residual { max: 0.0, at_mm: 0.0, rms: 0.0 };
        let mut total = 0.0;
        for (point, weight) in std::iter::zip(&self.points, &self.weights) {
            let v = difference(point);
            if v.abs() > all.max || v.is_nan() {
                (all.max, all.at_mm) = (v.abs(), point.real_mm);
            }
            all.rms += weight * v * v;
            total += weight;
        }
        Residual { rms: (all.rms / total).sqrt(), ..all }
    }

    /// Residual of a model in pixels, of its REAL image height in mm.
    pub fn residual_px(&self, model_mm: impl Fn(&FieldPoint) -> f64) -> Residual {
        self.residual(|point| (model_mm(point) - point.real_mm) / self.pitch_mm)
    }

    /// The REAL image height, mm, from which on `model` does not ascend with its variable, whose value at the field points is `variable`; none if it ascends
    /// from 0 to the last.
    pub(super) fn fold_mm(
        &self,
        variable: impl Fn(&FieldPoint) -> f64,
        model: impl Fn(f64) -> f64,
    ) -> Option<f64> {
        let (mut from, mut before) = (0.0, 0.0);
        for point in &self.points {
            let until = variable(point);
            for k in 1..=FINE {
                let value = model(from + (until - from) * f64::from(k) / f64::from(FINE));
                if value.is_nan() || value <= before {
                    return Some(point.real_mm);
                }
                before = value;
            }
            from = until;
        }
        None
    }
}

/// Σ c_j v^j by Horner's rule.
pub(super) fn horner(coefficients: &[f64], v: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * v + c)
}

/// Field points of a lens with REAL heights `real_mm(t)`, up to `last_tan`, on their circle of pixels of 1 µm, with the focal length `focal_mm`.
#[cfg(test)]
pub(super) fn synthetic(focal_mm: f64, last_tan: f64, real_mm: impl Fn(f64) -> f64) -> Target {
    let point = |i: u32| {
        let tan = last_tan * f64::from(i) / f64::from(STEPS);
        FieldPoint::new(tan, real_mm(tan))
    };
    let points: Vec<FieldPoint> = (1..=STEPS).map(point).collect();
    let area = FilmArea::circle(points[points.len() - 1].real_mm);
    Target::of_points(focal_mm, points, &area, 1e-3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_the_area_of_the_film() {
        let size = Size::new(301, 401);
        let area = FilmArea::film(size, 0.01, 100.0);
        assert!((area.last_mm() - 2.5).abs() < 1e-12);
        let step = 1e-4;
        let sum: f64 =
            (0..25_000).map(|i| (f64::from(i) + 0.5) * step).map(|r| r * area.arc_rad(r) * step).sum();
        assert!((sum - 3.0 * 4.0).abs() < 1e-4, "{sum} mm²");
        assert!((FilmArea::film(size, 0.01, 1.0).last_mm() - 1.0).abs() < 1e-12, "a smaller field");
        // 4 quadrants, of which none is inside beyond the corner.
        assert_eq!((FilmArea::circle(1.0).arc_rad(0.3), area.arc_rad(2.6)), (2.0 * PI, 0.0));
    }

    #[test]
    fn residual_is_weighted_by_area() {
        let target = synthetic(10.0, 0.5, |t| 10.0 * t);
        // r in px over the disc: maximum R, mean square R²/2.
        let residual = target.residual_px(|p| 2.0 * p.real_mm);
        assert!((residual.max - 5000.0).abs() < 1e-9 && (residual.at_mm - 5.0).abs() < 1e-12);
        assert!((residual.rms - 5000.0 / 2f64.sqrt()).abs() < 5.0, "{residual:?}");
    }

    #[test]
    fn decreasing_models_are_found() {
        let target = synthetic(10.0, 1.0, |t| 10.0 * t);
        assert_eq!(target.fold_mm(|p| p.tan, |t| t + t * t), None);
        let fold = target.fold_mm(|p| p.tan, |t| t - t.powi(3)).unwrap();
        assert!((fold - 10.0 / 3f64.sqrt()).abs() < 0.02, "{fold}");
    }
}
