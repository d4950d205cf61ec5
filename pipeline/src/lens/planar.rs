//! Map of a lens without rotational symmetry: the ideal point and the relative illumination of each film place, at one
//! wavelength.
//!
//! ```text
//! (ideal_x_mm, ideal_y_mm)[j, i]   ideal point f·O·(tx, −ty) of the field point whose chief ray meets the film
//!                                  at (X, Y) = (x_mm[i], y_mm[j])
//! relative_illumination[j, i]      irradiance there over irradiance at the film's centre
//! ```
//! Film frame: X right, Y DOWN, mm from the lens's axis; both grids uniform and ascending. Between the nodes each table is the
//! C² bicubic spline of `crate::spline`, 16 times as accurate for each halving of the grid. Film beyond the rectangle of the nodes is
//! an error or, with [`crate::field::Outside::Clamp`], has the displacement (ideal − film) and R of the nearest place of the rectangle. Maps
//! do not fold (`folding`): each ideal point is seen once.

mod folding;

use super::LensError;
use crate::bounds::{self, Bound};

/// Largest distance of a node from its place on a uniform grid, of the grid's side.
const UNIFORM: f64 = 1e-9;

/// Tables of the map at one wavelength.
///
/// ```
/// use lenscube_pipeline::lens::planar::PlanarMap;
///
/// // An ideal lens with its image 10 µm to the right.
/// let x_mm = vec![-3.0, -1.0, 1.0, 3.0];
/// let (across, down) = (|i: usize| x_mm[i % 4] - 0.01, |i: usize| x_mm[i / 4]);
/// let map = PlanarMap {
///     ideal_x_mm: (0..16).map(across).collect(), ideal_y_mm: (0..16).map(down).collect(), relative_illumination: vec![1.0; 16],
///     x_mm: x_mm.clone(), y_mm: x_mm.clone(),
/// };
/// map.check(550.0)?;
/// # Ok::<(), lenscube_pipeline::lens::LensError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct PlanarMap {
    /// REAL film coordinates X of the nodes, mm, uniform, ascending.
    pub x_mm: Vec<f64>,
    /// REAL film coordinates Y (down) of the nodes, mm, uniform, ascending.
    pub y_mm: Vec<f64>,
    /// X of the ideal point, mm, row by row.
    pub ideal_x_mm: Vec<f64>,
    /// Y of the ideal point, mm, row by row.
    pub ideal_y_mm: Vec<f64>,
    /// Relative illumination, 1 at the film's centre, row by row.
    pub relative_illumination: Vec<f64>,
}

/// Tables of a band of a lens without rotational symmetry.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanarBand {
    /// Ideal points and relative illumination over the film.
    pub map: PlanarMap,
    /// Places of the PSFs.
    pub psfs: PsfPlaces,
}

/// Places of the PSFs of a lens without rotational symmetry. The rows of a band's [`PsfStack`](super::PsfStack), and of its energies, are these places.
#[derive(Clone, Debug, PartialEq)]
pub enum PsfPlaces {
    /// About the axis of a lens that would be symmetric without its errors: at each height of `psf_height_mm` the PSFs of A_k azimuths 2πa/A_k, each in
    /// the frame turned by its azimuth (φ from +x towards +y, down). Rows (k, a), a fastest.
    Polar {
        /// A_k: 1 on the axis.
        azimuth_samples: Vec<usize>,
    },
    /// On columns and rows of the film, not turned; the heights of the band are empty. Rows (j, i), i fastest.
    Cartesian {
        /// REAL film coordinates X, mm, uniform, ascending.
        x_mm: Vec<f64>,
        /// REAL film coordinates Y (down), mm, uniform, ascending.
        y_mm: Vec<f64>,
    },
}

impl PlanarBand {
    /// (1 − share)·self + share·other, linear in wavelength at equal REAL film places; none if the nodes of the maps differ. PSFs have the places of
    /// `self`.
    pub(crate) fn between(&self, other: &Self, share: f64) -> Option<Self> {
        let (a, b) = (&self.map, &other.map);
        let mix = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + share * (b - a)).collect();
        (a.x_mm == b.x_mm && a.y_mm == b.y_mm).then(|| Self {
            map: PlanarMap {
                x_mm: a.x_mm.clone(),
                y_mm: a.y_mm.clone(),
                ideal_x_mm: mix(&a.ideal_x_mm, &b.ideal_x_mm),
                ideal_y_mm: mix(&a.ideal_y_mm, &b.ideal_y_mm),
                relative_illumination: mix(&a.relative_illumination, &b.relative_illumination),
            },
            psfs: self.psfs.clone(),
        })
    }
}

impl PsfPlaces {
    /// Number of PSFs.
    pub fn count(&self) -> usize {
        match self {
            Self::Polar { azimuth_samples } => azimuth_samples.iter().sum(),
            Self::Cartesian { x_mm, y_mm } => x_mm.len() * y_mm.len(),
        }
    }
}

impl PlanarMap {
    /// Distances of the nodes in X and in Y, mm.
    pub fn steps_mm(&self) -> (f64, f64) {
        let step = |at: &[f64]| (at[at.len() - 1] - at[0]) / (at.len() - 1) as f64;
        (step(&self.x_mm), step(&self.y_mm))
    }

    /// The corner of the map that is farthest from the axis, mm.
    pub fn farthest_corner_mm(&self) -> [f64; 2] {
        [&self.x_mm, &self.y_mm].map(|at| {
            let (first, last) = (at[0], at[at.len() - 1]);
            if first.abs() > last.abs() { first } else { last }
        })
    }

    /// Ideal point at film coordinates (X, Y), mm, linear between nodes: for estimates, films have the spline.
    pub fn ideal_point_at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let cell = |nodes: &[f64], step: f64, at: f64| {
            let along = ((at - nodes[0]) / step).clamp(0.0, (nodes.len() - 1) as f64);
            let i = (along as usize).min(nodes.len() - 2);
            (i, along - i as f64)
        };
        let (step_x, step_y) = self.steps_mm();
        let ((i, u), (j, v)) = (cell(&self.x_mm, step_x, x), cell(&self.y_mm, step_y, y));
        let width = self.x_mm.len();
        [&self.ideal_x_mm, &self.ideal_y_mm].map(|table| {
            let row = |j: usize| table[j * width + i] + u * (table[j * width + i + 1] - table[j * width + i]);
            row(j) + v * (row(j + 1) - row(j))
        })
    }

    /// Ideal length over REAL length at the axis: √ of the ratio of areas of a cell.
    pub fn scale_on_axis(&self) -> f64 {
        let (x, y) = self.steps_mm();
        let [a, b, c] = [[0.0, 0.0], [x, 0.0], [0.0, y]].map(|at| self.ideal_point_at(at));
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        (area / (x * y)).abs().sqrt()
    }

    /// Checks the contract of every table of the band `wavelength_nm`, and that the map does not fold.
    ///
    /// # Errors
    /// [`LensError::Table`] with the first table that violates it.
    pub fn check(&self, wavelength_nm: f64) -> Result<(), LensError> {
        let bad = |table, problem| Err(LensError::Table { wavelength_nm, table, problem });
        for (name, nodes) in [("map_x", &self.x_mm), ("map_y", &self.y_mm)] {
            if let Err(problem) = uniform(nodes, bounds::MAP_NODES) {
                return bad(name, problem);
            }
        }
        let (height, width) = (self.y_mm.len(), self.x_mm.len());
        let tables: [(_, Bound, _); 3] = [
            ("map_ideal_x", bounds::IDEAL_POINT_MM, &self.ideal_x_mm),
            ("map_ideal_y", bounds::IDEAL_POINT_MM, &self.ideal_y_mm),
            ("map_relative_illumination", bounds::RELATIVE_ILLUMINATION, &self.relative_illumination),
        ];
        for (name, bound, table) in tables {
            if table.len() != height * width {
                return bad(name, format!("has {} values, expected {height} x {width}", table.len()));
            }
            if let Err((i, e)) = bound.check_all(table) {
                let (row, column) = (i / width, i % width);
                return bad(name, format!("is out of bounds at row {row}, column {column}: {e}"));
            }
        }
        match folding::least_area(self) {
            (_, area) if area > 0.0 => Ok(()),
            ((x, y), area) => bad(
                "map_ideal_x, map_ideal_y",
                format!(
                    "folds at ({x:.3}, {y:.3}) mm of the film: an area of film has {area:.3e} times its area on the ideal plane, \
                     expected more than 0; use a smaller film or a finer map"
                ),
            ),
        }
    }
}

/// Checks `count` and places of the nodes of a grid.
pub(super) fn uniform(nodes: &[f64], count: Bound) -> Result<(), String> {
    if let Err(e) = count.check_count(nodes.len()) {
        return Err(format!("is out of bounds: {e}"));
    }
    if let Err((i, e)) = bounds::FILM_POINT_MM.check_all(nodes) {
        return Err(format!("is out of bounds at index {i}: {e}"));
    }
    let (first, last) = (nodes[0], nodes[nodes.len() - 1]);
    if nodes.len() > 1 && last <= first {
        return Err(format!("does not ascend: {first} mm at index 0, {last} mm at the last"));
    }
    let expected = |i: usize| first + (last - first) * i as f64 / (nodes.len() - 1).max(1) as f64;
    match (0..nodes.len()).find(|&i| (nodes[i] - expected(i)).abs() > UNIFORM * (last - first)) {
        None => Ok(()),
        Some(i) => Err(format!("is not uniform: {} mm at index {i}, expected {} mm", nodes[i], expected(i))),
    }
}

#[cfg(test)]
pub(crate) mod tests;
