//! Columns and rows of an array on the film: uniform, ascending in the film frame.

use super::arrays::Loader;
use super::description::{Grid, Places};
use crate::import::ImportError;
use pipeline::bounds::{self, Bound};
use std::path::Path;

/// Largest distance of a place from the uniform grid through the first and the last one, of a step.
const UNIFORM: f64 = 1e-3;

/// Coordinates along X or Y.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis {
    /// mm, uniform, ascending, film frame.
    pub film_mm: Vec<f64>,
    /// Whether the file has them in the other order.
    reversed: bool,
}

/// Columns and rows.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axes {
    pub x: Axis,
    pub y: Axis,
}

impl Axis {
    /// From the places of a file; `up`: they are −Y.
    fn new(places: &[f64], up: bool) -> Result<Self, String> {
        if let Err((i, e)) = bounds::FILM_POINT_MM.check_all(places) {
            return Err(format!("is out of bounds at index {i}: {e}"));
        }
        let (Some(&first), Some(&last)) = (places.first(), places.last()) else {
            return Err("has no places".into());
        };
        let intervals = (places.len() - 1) as f64;
        let step = if places.len() > 1 { (last - first) / intervals } else { 1.0 };
        let uniform = |i: usize| first + step * i as f64;
        if step == 0.0 {
            return Err(format!("is {first} mm at both ends, expected places that ascend or descend"));
        }
        if let Some(i) = (0..places.len()).find(|&i| (places[i] - uniform(i)).abs() > UNIFORM * step.abs()) {
            return Err(format!(
                "is not uniform: {} mm at index {i}, expected {} mm; scattered places are not read, interpolate to a grid of equal steps",
                places[i],
                uniform(i)
            ));
        }
        let sign = if up { -1.0 } else { 1.0 };
        let reversed = places.len() > 1 && sign * step < 0.0;
        let (from, to) = if reversed { (sign * last, sign * first) } else { (sign * first, sign * last) };
        let film_mm = (0..places.len()).map(|i| from + (to - from) * i as f64 / intervals.max(1.0)).collect();
        Ok(Self { film_mm, reversed })
    }

    /// Of places in the film frame.
    pub fn of_film(film_mm: Vec<f64>) -> Self {
        Self { film_mm, reversed: false }
    }

    pub fn len(&self) -> usize {
        self.film_mm.len()
    }

    /// Index in the file of place `i`.
    pub fn source(&self, i: usize) -> usize {
        if self.reversed { self.len() - 1 - i } else { i }
    }
}

impl Axes {
    /// The places `grid` of the table `name` of the description `path`, each axis with a number of them within `count`.
    pub fn load(
        path: &Path,
        grid: &Grid,
        name: &str,
        count: Bound,
        loader: &mut Loader,
    ) -> Result<Self, ImportError> {
        let mut axis = |key: &str, places: &Places, up: bool| {
            let checked = |values: &[f64]| {
                count.check_count(values.len()).map_err(|e| format!("is out of bounds: {e}"))?;
                Axis::new(values, up)
            };
            match places {
                Places::List(list) => {
                    checked(list).map_err(|e| ImportError::file(path, format!("{name} {key} {e}")))
                }
                Places::File(file) => {
                    let array = loader.load(file)?;
                    if array.shape.len() != 1 {
                        let shape = &array.shape;
                        return Err(file.error(format!("has shape {shape:?}, {name} {key} expects one axis: the places of columns or rows; scattered places are not read")));
                    }
                    checked(&array.values).map_err(|e| file.error(format!("({name} {key}) {e}")))
                }
            }
        };
        Ok(Self { x: axis("x_mm", &grid.x, false)?, y: axis("y_mm", &grid.y, grid.y_up)? })
    }

    /// Columns times rows.
    pub fn count(&self) -> usize {
        self.x.len() * self.y.len()
    }

    /// A table of a file, row by row, in the order of the film.
    pub fn oriented(&self, table: &[f64]) -> Vec<f64> {
        let row = |j: usize| &table[self.y.source(j) * self.x.len()..][..self.x.len()];
        (0..self.y.len()).flat_map(|j| (0..self.x.len()).map(move |i| row(j)[self.x.source(i)])).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_ascend_in_the_film_frame() {
        let axis = |places: &[f64], up| Axis::new(places, up).unwrap();
        for (places, up, film, first) in [
            (&[-1.0, 0.0, 1.0, 2.0][..], false, [-1.0, 0.0, 1.0, 2.0], 0),
            (&[-1.0, 0.0, 1.0, 2.0], true, [-2.0, -1.0, 0.0, 1.0], 3),
            (&[2.0, 1.0, 0.0, -1.0], false, [-1.0, 0.0, 1.0, 2.0], 3),
            (&[2.0, 1.0, 0.0, -1.0], true, [-2.0, -1.0, 0.0, 1.0], 0),
        ] {
            let axis = axis(places, up);
            assert_eq!((axis.film_mm.as_slice(), axis.source(0)), (&film[..], first), "{places:?} {up}");
        }
        assert_eq!(axis(&[3.0], true).film_mm, [-3.0]);
        // A thousandth of a step is rounding of a stage.
        assert_eq!(axis(&[0.0, 1.0005, 2.0], false).film_mm, [0.0, 1.0, 2.0]);
    }

    #[test]
    fn places_that_are_not_uniform_are_errors() {
        let error = |places: &[f64]| Axis::new(places, false).unwrap_err();
        assert!(error(&[0.0, 1.0, 2.1, 3.0]).contains("is not uniform: 2.1 mm at index 2, expected 2 mm"));
        assert!(error(&[1.0, 2.0, 1.0]).contains("is 1 mm at both ends"));
        assert!(
            error(&[0.0, f64::NAN]).contains("out of bounds at index 1") && error(&[]).contains("no places")
        );
    }

    #[test]
    fn tables_follow_both_axes() {
        let axes =
            Axes { x: Axis::new(&[1.0, 0.0], false).unwrap(), y: Axis::new(&[0.0, 1.0], true).unwrap() };
        assert_eq!(axes.oriented(&[1.0, 2.0, 3.0, 4.0]), [4.0, 3.0, 2.0, 1.0]);
    }
}
