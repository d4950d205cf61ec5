//! The directions of the light over the film, of lenses with and without rotational symmetry.
//!
//! The cone of a place is an ellipse of direction cosines (l, m) in a frame of two axes of the film, with the area, the centroid and the second moments of the bundle's part of the (l, m) plane:
//!
//! ```text
//! (l, m) = ⟨(l, m)⟩ + L u,  |u| ≤ 1        L lower triangular,  L Lᵀ = 4 ⟨δ δᵀ⟩,  δ = (l, m) − ⟨(l, m)⟩
//! ```
//! Of a lens with rotational symmetry the first axis points away from the optical axis: L is diagonal, its elements the half axes ([`super::cone`]). Of other lenses the axes are those of the film,
//! right and down, and the numbers lie on a uniform grid of film places; between them cubic polynomials through four along both axes.

use super::cone::{Cone, ConeTable};
use super::planar::uniform;
use crate::bounds;
use crate::spline::lagrange_around;

/// Places along a side at which the angles of a grid are examined.
const PLACES: usize = 97;

/// The directions of the light at a place of the film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedCone {
    /// The first axis of its frame, a unit vector (right, down); the second one is that turned from right to down.
    pub axis: [f64; 2],
    /// Direction cosines of the chief ray in the frame.
    pub chief: [f64; 2],
    /// Middle of the ellipse, likewise.
    pub centre: [f64; 2],
    /// L₀₀, L₁₀ and L₁₁.
    pub root: [f64; 3],
}

impl PlacedCone {
    /// That of `cone` in the direction `away` (right, down) from the axis.
    pub fn symmetric(cone: &Cone, away: [f64; 2]) -> Self {
        Self {
            axis: away,
            chief: [cone.chief, 0.0],
            centre: [cone.centre, 0.0],
            root: [cone.tangential, 0.0, cone.sagittal],
        }
    }

    /// Direction cosines in the frame of a point of the unit disc.
    pub fn direction(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let [along, shear, across] = self.root;
        [self.centre[0] + along * u, self.centre[1] + (shear * u + across * v)]
    }

    /// A vector of the frame on the film: right and down.
    pub fn on_film(&self, [l, m]: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.axis;
        [l * x - m * y, l * y + m * x]
    }

    /// The largest direction cosine from the film's normal of the cone and the chief ray, the sine of the angle of incidence, or a little more.
    fn largest_sine(&self) -> f64 {
        let length = |[l, m]: [f64; 2]| (l * l + m * m).sqrt();
        let [a, b, c] = self.root;
        // The larger singular value of L.
        let (sum, product) = (a * a + b * b + c * c, a * c);
        let square = 0.5 * (sum + (sum * sum - 4.0 * product * product).max(0.0).sqrt());
        (length(self.centre) + square.sqrt()).max(length(self.chief))
    }
}

/// Cones over a rectangle of the film.
#[derive(Clone, Debug, PartialEq)]
pub struct ConeGrid {
    x_mm: Vec<f64>,
    y_mm: Vec<f64>,
    /// Row by row: those of [`ConeGrid::NUMBERS`].
    cones: Vec<[f64; Self::NUMBERS]>,
}

impl ConeGrid {
    /// Numbers of a place: direction cosines (right, down) of the chief ray and of the ellipse's middle, L₀₀, L₁₀, L₁₁.
    pub const NUMBERS: usize = 7;

    /// `cones` at REAL film coordinates X and Y (down), mm, uniform and ascending, row by row.
    ///
    /// # Errors
    /// A text: what is expected of coordinates and cones.
    pub fn new(x_mm: Vec<f64>, y_mm: Vec<f64>, cones: Vec<[f64; Self::NUMBERS]>) -> Result<Self, String> {
        for (name, nodes) in [("x", &x_mm), ("y", &y_mm)] {
            uniform(nodes, bounds::MAP_NODES).map_err(|problem| format!("{name} {problem}"))?;
        }
        if cones.len() != x_mm.len() * y_mm.len() {
            return Err(format!("expected {} x {} cones, found {}", y_mm.len(), x_mm.len(), cones.len()));
        }
        let is_cone = |c: &&[f64; Self::NUMBERS]| {
            c.iter().all(|v| v.abs() < 1.0)
                && c[4] > 0.0
                && c[6] > 0.0
                && Self::placed(**c).largest_sine() < 1.0
        };
        match cones.iter().find(|cone| !is_cone(cone)) {
            Some(bad) => Err(format!(
                "expected directions less than 90 degrees from the film's normal, diagonals above 0, found {bad:?}"
            )),
            None => Ok(Self { x_mm, y_mm, cones }),
        }
    }

    /// REAL film coordinates of its columns (X) and rows (Y, down), mm.
    pub fn nodes_mm(&self) -> [&[f64]; 2] {
        [&self.x_mm, &self.y_mm]
    }

    /// The numbers of its places, row by row.
    pub fn cones(&self) -> &[[f64; Self::NUMBERS]] {
        &self.cones
    }

    fn placed([chief_x, chief_y, x, y, a, b, c]: [f64; Self::NUMBERS]) -> PlacedCone {
        PlacedCone { axis: [1.0, 0.0], chief: [chief_x, chief_y], centre: [x, y], root: [a, b, c] }
    }

    /// The cone at film coordinates X and Y, mm; beyond the grid that of the polynomials at its edge.
    pub fn at(&self, [x, y]: [f64; 2]) -> PlacedCone {
        let along = |nodes: &[f64], at: f64| {
            let cells = nodes.len() - 1;
            lagrange_around((at - nodes[0]) / (nodes[cells] - nodes[0]) * cells as f64, cells)
        };
        let ((i, across), (j, down)) = (along(&self.x_mm, x), along(&self.y_mm, y));
        let mut sum = [0.0; Self::NUMBERS];
        for (row, of_row) in down.into_iter().enumerate() {
            let first = (j + row) * self.x_mm.len() + i;
            for (cone, weight) in self.cones[first..first + 4].iter().zip(across) {
                sum.iter_mut().zip(cone).for_each(|(sum, v)| *sum += of_row * weight * v);
            }
        }
        Self::placed(sum)
    }

    /// Whether it covers the places from `first` to `last`, within `slack` of their distance.
    fn covers(&self, first: [f64; 2], last: [f64; 2], slack: f64) -> bool {
        let is_within = |(nodes, (a, b)): (&Vec<f64>, (f64, f64))| {
            let margin = slack * (b - a);
            nodes[0] <= a + margin && nodes[nodes.len() - 1] >= b - margin
        };
        [(&self.x_mm, (first[0], last[0])), (&self.y_mm, (first[1], last[1]))].into_iter().all(is_within)
    }
}

/// The directions of the light over the film of a lens at one wavelength.
#[derive(Clone, Debug, PartialEq)]
pub enum ConeField {
    /// With rotational symmetry.
    Symmetric(ConeTable),
    /// Without.
    Planar(ConeGrid),
}

impl ConeField {
    /// The cone at film coordinates X and Y, mm, which is `away` (right, down) from the axis by `height_mm`.
    pub fn at(&self, place_mm: [f64; 2], (height_mm, away): (f64, [f64; 2])) -> PlacedCone {
        match self {
            Self::Symmetric(table) => PlacedCone::symmetric(&table.at(height_mm), away),
            Self::Planar(grid) => grid.at(place_mm),
        }
    }

    /// Whether it covers the rectangle of the film from `first` to `last` (X, Y), mm, whose farthest corner is `reach_mm` from the axis, within a share `slack`.
    pub fn covers(&self, [first, last]: [[f64; 2]; 2], reach_mm: f64, slack: f64) -> bool {
        match self {
            Self::Symmetric(table) => table.last_mm() >= reach_mm / (1.0 + slack),
            Self::Planar(grid) => grid.covers(first, last, slack),
        }
    }

    /// Places X, Y (mm) and the largest sine of incidence there: at `steps` + 1 heights up to `reach_mm`, or of a grid at places over the rectangle of the film from `first` to `last`.
    pub fn sines(&self, [first, last]: [[f64; 2]; 2], reach_mm: f64, steps: usize) -> Vec<([f64; 2], f64)> {
        match self {
            Self::Symmetric(table) => (0..=steps)
                .map(|k| reach_mm * k as f64 / steps as f64)
                .map(|height_mm| ([height_mm, 0.0], table.at(height_mm).largest_sine()))
                .collect(),
            Self::Planar(grid) => {
                let along = |axis: usize, k: usize| {
                    first[axis] + (last[axis] - first[axis]) * k as f64 / (PLACES - 1) as f64
                };
                let places = (0..PLACES * PLACES).map(|k| [along(0, k % PLACES), along(1, k / PLACES)]);
                places.map(|place| (place, grid.at(place).largest_sine())).collect()
            }
        }
    }

    /// All numbers that determine it, for an identity.
    pub fn numbers(&self) -> Vec<f64> {
        match self {
            Self::Symmetric(table) => {
                std::iter::once(table.step_mm()).chain(table.directions().flatten()).collect()
            }
            Self::Planar(grid) => {
                let counts = [grid.x_mm.len() as f64, grid.y_mm.len() as f64];
                [&counts[..], &grid.x_mm, &grid.y_mm, grid.cones.as_flattened()].concat()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::real;

    fn law(x: f64, y: f64) -> [f64; 7] {
        let chief = [0.03 * x + 1e-3 * x * y, 0.02 * y - 1e-4 * y * y * y];
        let root = [0.2 - 1e-3 * x * x, 2e-3 * x * y, 0.15 + 1e-3 * y];
        [chief[0], chief[1], 0.9 * chief[0] + 0.01, 0.8 * chief[1], root[0], root[1], root[2]]
    }

    fn grid() -> ConeGrid {
        let at = |first: f64, step: f64, n: u32| -> Vec<f64> {
            (0..n).map(|k| first + step * f64::from(k)).collect()
        };
        let (x_mm, y_mm) = (at(-3.0, 0.5, 11), at(-1.0, 0.75, 7));
        let cones = y_mm.iter().flat_map(|y| x_mm.iter().map(|x| law(*x, *y))).collect();
        ConeGrid::new(x_mm, y_mm, cones).unwrap()
    }

    #[test]
    fn cones_between_nodes_are_those_of_a_cubic_law() {
        let grid = grid();
        for (x, y) in [(-3.0, -1.0), (0.1, 0.2), (1.99, 3.4), (-2.9, 1.3)] {
            let expected = ConeGrid::placed(law(x, y));
            let found = grid.at([x, y]);
            let numbers = |c: &PlacedCone| [c.chief, c.centre, [c.root[0], c.root[1]], [c.root[2], 0.0]];
            for (a, b) in numbers(&found).as_flattened().iter().zip(numbers(&expected).as_flattened()) {
                assert!((a - b).abs() < 1e-14, "{x} {y}: {found:?} {expected:?}");
            }
        }
        let field = ConeField::Planar(grid);
        assert!(field.covers([[-3.0, -1.0], [2.0, 3.5]], 9.0, 1e-9));
        assert!(!field.covers([[-3.1, -1.0], [2.0, 3.5]], 9.0, 1e-9));
        assert!(field.covers([[-3.0 - 4e-6, -1.0], [2.0, 3.5]], 9.0, 1e-6));
    }

    /// The farthest direction of an ellipse on the line through its middle that is also its longer axis; L is one of many roots.
    #[test]
    fn largest_sine_is_that_of_the_rim() {
        let (sin, cos) = real::sin_cos(0.4);
        let (long, short, at) = (0.3, 0.1, 0.2);
        // 4 · covariance: long² and short² in axes turned by 0.4 rad.
        let [xx, xy, yy] = [
            long * long * cos * cos + short * short * sin * sin,
            (long * long - short * short) * sin * cos,
            long * long * sin * sin + short * short * cos * cos,
        ];
        let root = [xx.sqrt(), xy / xx.sqrt(), (yy - xy * xy / xx).sqrt()];
        let cone = PlacedCone { axis: [1.0, 0.0], chief: [0.0; 2], centre: [at * cos, at * sin], root };
        assert!((cone.largest_sine() - (at + long)).abs() < 1e-15);
        let rim = |k: u32| {
            let (v, u) = real::sin_cos(f64::from(k) / 1000.0 * std::f64::consts::TAU);
            let [l, m] = cone.direction([u, v]);
            (l * l + m * m).sqrt()
        };
        let farthest = (0..1000).map(rim).fold(0.0, f64::max);
        assert!((farthest - (at + long)).abs() < 1e-5, "{farthest}");
    }

    #[test]
    fn numbers_that_are_no_cones_are_refused() {
        let nodes = vec![0.0, 1.0, 2.0, 3.0];
        let with = |change: &dyn Fn(&mut Vec<[f64; 7]>)| {
            let mut cones = vec![[0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.1]; 16];
            change(&mut cones);
            ConeGrid::new(nodes.clone(), nodes.clone(), cones)
        };
        assert!(with(&|_| ()).is_ok());
        assert!(with(&|cones| cones[3][6] = 0.0).unwrap_err().contains("above 0"));
        assert!(with(&|cones| cones[3][1] = f64::NAN).unwrap_err().contains("90 degrees"));
        // Each below 1, together beyond 90 degrees.
        assert!(with(&|cones| cones[3] = [0.8, 0.8, 0.0, 0.0, 0.1, 0.0, 0.1]).is_err());
        assert!(with(&|cones| cones[3] = [0.0, 0.0, 0.5, 0.5, 0.5, 0.0, 0.1]).is_err());
        assert!(with(&|cones| cones.truncate(15)).unwrap_err().contains("4 x 4 cones, found 15"));
        assert!(
            ConeGrid::new(nodes.clone(), vec![0.0, 1.0, 3.0, 4.0], vec![]).unwrap_err().contains("uniform")
        );
    }
}
