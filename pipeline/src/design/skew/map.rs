//! The map of a band of a built lens: ideal point and relative illumination at places of the film.
//!
//! ```text
//! film pixel (X, Y) shows chart(I(X, Y)) · R(X, Y),      I = f O (tx, −ty),  t the field whose chief ray lands at (X, Y)
//! ```
//! f and O = ±1 of the NOMINAL lens at the primary wavelength: all bands and all built lenses share one ideal plane. Samples on a
//! uniform grid of REAL film coordinates (film frame: X right, Y down, mm); between them the bicubic spline of `crate::spline`.
//! I are values, R = 1 at the film's centre. Distortion, boresight, keystone and lateral colour are in I; the obliquity of a
//! tilted film is in R.
//! *Folding*: det ∂I/∂(X, Y) > 0 at the samples and on a grid three times as fine.

use super::error::SkewError;
use crate::spline::tensor::{MIN_NODES, TensorSpline};

/// Rectangle of the film, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmRange {
    /// First and last X.
    pub x_mm: [f64; 2],
    /// First and last Y.
    pub y_mm: [f64; 2],
}

impl FilmRange {
    /// The rectangle of `half_mm` to either side of the film's centre.
    pub fn centred([x, y]: [f64; 2]) -> Self {
        Self { x_mm: [-x, x], y_mm: [-y, y] }
    }

    /// The place at the shares (u, v) of its sides.
    pub fn at(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let along = |[a, b]: [f64; 2], u: f64| a + (b - a) * u;
        [along(self.x_mm, u), along(self.y_mm, v)]
    }
}

/// Ideal point and relative illumination on a uniform grid of film places.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmMap {
    range: FilmRange,
    counts: [usize; 2],
    /// I_x, I_y [mm] and R, rows of X.
    values: [Vec<f64>; 3],
    splines: [TensorSpline; 3],
}

/// A map at one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapPoint {
    /// Ideal point, mm.
    pub ideal_mm: [f64; 2],
    /// d(I_x, I_y)/d(X, Y).
    pub by_film: [[f64; 2]; 2],
    /// R.
    pub relative_illumination: f64,
}

impl MapPoint {
    /// det ∂I/∂(X, Y).
    pub fn determinant(&self) -> f64 {
        let [a, b] = self.by_film;
        a[0] * b[1] - a[1] * b[0]
    }
}

/// Cells by which places may lie beyond the grid, for rounding.
const SLACK: f64 = 1e-9;

impl FilmMap {
    /// From samples of I_x, I_y (mm) and R in rows of X; none if a direction has fewer than four or they are not as many as
    /// `counts` says.
    pub fn new(range: FilmRange, counts: [usize; 2], values: [Vec<f64>; 3]) -> Option<Self> {
        let fits =
            counts.iter().all(|n| *n >= MIN_NODES) && values.iter().all(|v| v.len() == counts[0] * counts[1]);
        fits.then(|| {
            let splines = [0, 1, 2].map(|i| TensorSpline::new(&values[i], counts[0]));
            Self { range, counts, splines, values }
        })
    }

    /// The rectangle that it covers.
    pub fn range(&self) -> FilmRange {
        self.range
    }

    /// Samples along X and along Y.
    pub fn counts(&self) -> [usize; 2] {
        self.counts
    }

    /// Samples of I_x, I_y (mm) and R, rows of X.
    pub fn values(&self) -> &[Vec<f64>; 3] {
        &self.values
    }

    /// The place of sample `i` along X and `j` along Y, mm.
    pub fn place(&self, [i, j]: [usize; 2]) -> [f64; 2] {
        let share = |i: usize, n: usize| i as f64 / (n - 1) as f64;
        self.range.at([share(i, self.counts[0]), share(j, self.counts[1])])
    }

    fn step_mm(&self) -> [f64; 2] {
        let FilmRange { x_mm, y_mm } = self.range;
        [(x_mm[1] - x_mm[0]) / (self.counts[0] - 1) as f64, (y_mm[1] - y_mm[0]) / (self.counts[1] - 1) as f64]
    }

    /// The map at `film_mm`.
    ///
    /// # Errors
    /// [`SkewError::Beyond`] outside its rectangle.
    pub fn at(&self, film_mm: [f64; 2]) -> Result<MapPoint, SkewError> {
        let (step, [x, y]) = (self.step_mm(), film_mm);
        let (u, v) = ((x - self.range.x_mm[0]) / step[0], (y - self.range.y_mm[0]) / step[1]);
        let is_inside = |u: f64, n: usize| {
            let last = (n - 1) as f64;
            u >= -SLACK * last && u <= last * (1.0 + SLACK)
        };
        if !(is_inside(u, self.counts[0]) && is_inside(v, self.counts[1])) {
            return Err(SkewError::Beyond { x_mm: x, y_mm: y });
        }
        let [ix, iy, [relative_illumination, ..]] = [0, 1, 2].map(|k| self.splines[k].at(v, u));
        let by = |[_, down, across]: [f64; 3]| [across / step[0], down / step[1]];
        Ok(MapPoint { ideal_mm: [ix[0], iy[0]], by_film: [by(ix), by(iy)], relative_illumination })
    }

    /// Checks that no two places near each other show the same field point.
    ///
    /// # Errors
    /// [`SkewError::Folds`] with the place of the smallest determinant, if it is not positive.
    pub fn check_folds(&self, wavelength_um: f64) -> Result<(), SkewError> {
        let [nx, ny] = self.counts.map(|n| 3 * (n - 1));
        let (mut least, mut place) = (f64::INFINITY, [0.0; 2]);
        for (i, j) in (0..=ny).flat_map(|j| (0..=nx).map(move |i| (i, j))) {
            let at = self.range.at([i as f64 / nx as f64, j as f64 / ny as f64]);
            let determinant = self.at(at)?.determinant();
            if determinant.is_nan() || determinant < least {
                (least, place) = (determinant, at);
            }
        }
        match least > 0.0 {
            true => Ok(()),
            false => Err(SkewError::Folds { x_mm: place[0], y_mm: place[1], wavelength_um }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: FilmRange = FilmRange { x_mm: [-3.0, 4.0], y_mm: [-2.0, 2.0] };

    fn map(counts: [usize; 2], f: impl Fn(f64, f64) -> [f64; 3]) -> FilmMap {
        let mut values = [vec![], vec![], vec![]];
        for k in 0..counts[0] * counts[1] {
            let share = [k % counts[0], k / counts[0]];
            let at = RANGE.at([0, 1].map(|i| share[i] as f64 / (counts[i] - 1) as f64));
            f(at[0], at[1]).into_iter().zip(&mut values).for_each(|(v, to)| to.push(v));
        }
        FilmMap::new(RANGE, counts, values).unwrap()
    }

    #[test]
    fn exact_for_cubics_with_its_determinant() {
        let x3 = |x: f64| x * x * x;
        let f = |x: f64, y: f64| {
            [
                x + 0.01 * x3(x) - 0.02 * x * y * y + 0.003 * x3(x) * x3(y),
                y - 0.01 * x * y,
                1.0 - 0.01 * x * x,
            ]
        };
        let m = map([9, 7], f);
        for (x, y) in [(-2.9, 1.9), (0.3, -0.7), (3.99, 1.01), (-3.0, -2.0), (4.0, 2.0)] {
            let (found, [ix, iy, r]) = (m.at([x, y]).unwrap(), f(x, y));
            assert!((found.ideal_mm[0] - ix).abs() < 1e-12 && (found.ideal_mm[1] - iy).abs() < 1e-12);
            assert!((found.relative_illumination - r).abs() < 1e-12);
            let a = 1.0 + 0.03 * x * x - 0.02 * y * y + 0.009 * x * x * x3(y);
            let b = -0.04 * x * y + 0.009 * x3(x) * y * y;
            let exact = a * (1.0 - 0.01 * x) - b * (-0.01 * y);
            assert!((found.determinant() - exact).abs() < 1e-11);
        }
        assert!(m.check_folds(0.55).is_ok());
        assert!(matches!(m.at([4.01, 0.0]), Err(SkewError::Beyond { .. })));
        assert!(matches!(m.at([0.0, f64::NAN]), Err(SkewError::Beyond { .. })));
    }

    #[test]
    fn a_fold_is_found() {
        // The fold of x − 0.1 x³ is at |x| = 1.826; the least determinant at x = 4.
        let folded = map([9, 7], |x, y| [x - 0.1 * x * x * x, y, 1.0]);
        match folded.check_folds(0.55) {
            Err(SkewError::Folds { x_mm, .. }) => assert_eq!(x_mm, 4.0),
            other => panic!("{other:?}"),
        }
    }
}
