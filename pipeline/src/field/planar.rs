//! Displacement and relative illumination of a lens without rotational symmetry, ready for lookup in film pixels.
//!
//! ```text
//! (D_y, D_x)(dy, dx)   ideal point minus film place, px;  R(dy, dx)·gain;   film place (dy, dx) px from the axis
//! ```
//! Each is a C² bicubic spline ([`crate::lens::planar`]) of the nodes of the map. Along a film row it is reduced in y once: the
//! coefficients of four rows of nodes are summed with the weights of β³, and D_y, D_x and R are then cubics in x for each cell,
//! ```text
//! a_0 + f·(a_1 + f·(a_2 + f·a_3)),   f = fraction of the cell
//! ```
//! whose third derivative alone jumps from cell to cell. Beyond the nodes the values of the nearest place of the map are used.
//! Plain f64 arithmetic without fused operations: the bits do not depend on the instruction set.
#![allow(clippy::needless_range_loop, reason = "lanes of several arrays at once")]

use super::Outside;
use crate::geometry::{Frame, Rect};
use crate::lens::LensError;
use crate::lens::planar::PlanarMap;
use crate::spline::tensor::{TensorSpline, cell_of, slope_weights};
use crate::spline::weights;
use std::array::from_fn;

/// D_y, D_x and R.
type Three = [f64; 3];

/// Coefficients a_0 to a_3 of D_y, D_x and R in the fraction of a cell.
pub(crate) type CellCubic = [Three; 4];

/// Displacement and relative illumination over the film.
#[derive(Clone, Debug)]
pub struct PlanarField {
    /// Place (y, x) of the first node from the axis, px.
    first_px: (f64, f64),
    /// Nodes per px, down and across.
    nodes_per_px: (f64, f64),
    /// Cells down and across.
    cells: (usize, usize),
    /// Coefficients of nodes −1 to the last but one, row by row.
    coefficients: Vec<Three>,
}

/// The cubics of the cells along a film row.
#[derive(Debug, Default)]
pub(crate) struct FilmRow {
    /// Cell of the first cubic.
    first: usize,
    reduced: Vec<Three>,
    cubics: Vec<CellCubic>,
}

/// Largest values of derivatives of D_y and D_x over a part of the film, per px of film.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Bend {
    /// |∂²/∂y²| of D_y and D_x, 1/px.
    pub(crate) down: [f64; 2],
    /// |∂²/∂x²|, 1/px.
    pub(crate) across: [f64; 2],
    /// |∂²/∂x∂y|, 1/px.
    pub(crate) mixed: [f64; 2],
}

impl PlanarField {
    /// The tables of `map` on a film of `pitch_mm`. Without `distortion` the displacement is 0; without `illumination` R = 1;
    /// `gain` multiplies R (film units).
    ///
    /// # Panics
    /// Tables that [`PlanarMap::check`] rejects.
    pub fn new(map: &PlanarMap, pitch_mm: f64, distortion: bool, illumination: bool, gain: f64) -> Self {
        let (rows, columns) = (map.y_mm.len(), map.x_mm.len());
        let displacement = |ideal: &[f64], at: &dyn Fn(usize) -> f64| -> Vec<f64> {
            let of = |(i, ideal): (usize, &f64)| if distortion { (ideal - at(i)) / pitch_mm } else { 0.0 };
            ideal.iter().enumerate().map(of).collect()
        };
        let down = displacement(&map.ideal_y_mm, &|i| map.y_mm[i / columns]);
        let across = displacement(&map.ideal_x_mm, &|i| map.x_mm[i % columns]);
        let light = map.relative_illumination.iter().map(|r| if illumination { gain * r } else { gain });
        let [down, across, light] =
            [down, across, light.collect()].map(|table| TensorSpline::new(&table, columns).coefficients);
        let (step_x, step_y) = map.steps_mm();
        Self {
            first_px: (map.y_mm[0] / pitch_mm, map.x_mm[0] / pitch_mm),
            nodes_per_px: (pitch_mm / step_y, pitch_mm / step_x),
            cells: (rows - 1, columns - 1),
            coefficients: (0..down.len()).map(|i| [down[i], across[i], light[i]]).collect(),
        }
    }

    /// (D_y, D_x) in px and R·gain at film place (dy, dx), px from the axis.
    #[inline]
    pub fn at(&self, dy: f64, dx: f64) -> [f64; 3] {
        let (cell, fraction) = self.column(dx);
        let (cell_row, w) = self.row_weights(dy);
        let rows = self.rows_of_nodes(cell_row, cell, 4);
        let node = |i: usize| weighted(&w, [rows[0][i], rows[1][i], rows[2][i], rows[3][i]]);
        value(&cubic([node(0), node(1), node(2), node(3)]), fraction)
    }

    /// The cubics along the film row at `dy`, of the cells that the film columns from `from` to `to` (px from the axis) lie in.
    #[inline(always)]
    pub(crate) fn row(&self, dy: f64, (from, to): (f64, f64), row: &mut FilmRow) {
        let (first, last) = (self.column(from).0, self.column(to).0);
        let (cell_row, w) = self.row_weights(dy);
        let n = last - first + 4;
        let rows = self.rows_of_nodes(cell_row, first, n);
        row.first = first;
        row.reduced.resize(n, [0.0; 3]);
        for i in 0..n {
            row.reduced[i] = weighted(&w, [rows[0][i], rows[1][i], rows[2][i], rows[3][i]]);
        }
        row.cubics.resize(n - 3, CellCubic::default());
        for (to, from) in row.cubics.iter_mut().zip(row.reduced.windows(4)) {
            *to = cubic([from[0], from[1], from[2], from[3]]);
        }
    }

    /// Cell and fraction across at film column `dx`, px from the axis.
    #[inline(always)]
    pub(crate) fn column(&self, dx: f64) -> (usize, f64) {
        cell_of(self.nodes_to(dx), self.cells.1)
    }

    /// Nodes from the first to film column `dx`, px from the axis; also beyond the map.
    #[inline(always)]
    pub(crate) fn nodes_to(&self, dx: f64) -> f64 {
        (dx - self.first_px.1) * self.nodes_per_px.1
    }

    /// Cells down and across.
    pub(crate) fn cells(&self) -> (usize, usize) {
        self.cells
    }

    /// Nodes per px, down and across.
    pub(crate) fn nodes_per_px(&self) -> (f64, f64) {
        self.nodes_per_px
    }

    /// First and last place (rows, columns) of the map, px from the axis.
    pub(crate) fn ends_px(&self) -> ((f64, f64), (f64, f64)) {
        let end = |first: f64, per_px: f64, cells: usize| (first, first + cells as f64 / per_px);
        (
            end(self.first_px.0, self.nodes_per_px.0, self.cells.0),
            end(self.first_px.1, self.nodes_per_px.1, self.cells.1),
        )
    }

    /// First and last cell of rows `dy` and of columns `dx`, px from the axis.
    pub(crate) fn cells_under(&self, dy: (f64, f64), dx: (f64, f64)) -> ((usize, usize), (usize, usize)) {
        ((self.row_weights(dy.0).0, self.row_weights(dy.1).0), (self.column(dx.0).0, self.column(dx.1).0))
    }

    /// Slopes in the middle of cell (row, column), px per px: ∂D_y/∂y, ∂D_y/∂x, ∂D_x/∂y, ∂D_x/∂x.
    pub(crate) fn slopes(&self, (row, column): (usize, usize)) -> [[f64; 2]; 2] {
        let rows = self.rows_of_nodes(row, column, 4);
        let (middle, slope) = (weights(0.5), slope_weights(0.5));
        let sum = |wy: &[f64; 4], wx: &[f64; 4], of: usize| -> f64 {
            (0..16).map(|k| wy[k / 4] * wx[k % 4] * rows[k / 4][k % 4][of]).sum()
        };
        from_fn(|of| {
            [sum(&slope, &middle, of) * self.nodes_per_px.0, sum(&middle, &slope, of) * self.nodes_per_px.1]
        })
    }

    /// Bounds of the second derivatives over cell (row, column).
    ///
    /// Within a cell ∂²D/∂x² is a mean, with weights ≥ 0, of the second differences of the coefficients across; the others
    /// likewise.
    pub(crate) fn bend(&self, (row, column): (usize, usize)) -> Bend {
        let rows = self.rows_of_nodes(row, column, 4);
        let (per_y, per_x) = self.nodes_per_px;
        let most =
            |count: usize, of: &dyn Fn(usize) -> f64| (0..count).map(|k| of(k).abs()).fold(0.0, f64::max);
        Bend {
            down: from_fn(|of| {
                let c = |j: usize, i: usize| rows[j][i][of];
                most(8, &|k| c(k / 4, k % 4) - 2.0 * c(k / 4 + 1, k % 4) + c(k / 4 + 2, k % 4))
                    * per_y
                    * per_y
            }),
            across: from_fn(|of| {
                let c = |j: usize, i: usize| rows[j][i][of];
                most(8, &|k| c(k % 4, k / 4) - 2.0 * c(k % 4, k / 4 + 1) + c(k % 4, k / 4 + 2))
                    * per_x
                    * per_x
            }),
            mixed: from_fn(|of| {
                let c = |j: usize, i: usize| rows[j][i][of];
                let difference = |j: usize, i: usize| c(j + 1, i + 1) - c(j + 1, i) - c(j, i + 1) + c(j, i);
                most(9, &|k| difference(k / 3, k % 3)) * per_x * per_y
            }),
        }
    }

    /// Cell down, and the weights of its four rows of nodes, at film row `dy`.
    #[inline(always)]
    fn row_weights(&self, dy: f64) -> (usize, [f64; 4]) {
        let (cell, fraction) = cell_of((dy - self.first_px.0) * self.nodes_per_px.0, self.cells.0);
        (cell, weights(fraction))
    }

    /// `n` coefficients from cell `column` on, of the four rows of nodes of cell row `row`.
    #[inline(always)]
    fn rows_of_nodes(&self, row: usize, column: usize, n: usize) -> [&[Three]; 4] {
        let width = self.cells.1 + 3;
        from_fn(|j| &self.coefficients[(row + j) * width + column..][..n])
    }
}

impl FilmRow {
    /// The cubic of `cell`.
    #[inline(always)]
    pub(crate) fn cubic(&self, cell: usize) -> &CellCubic {
        &self.cubics[cell - self.first]
    }

    /// The cubics, and the cell of the first.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub(crate) fn cubics(&self) -> (&[CellCubic], usize) {
        (&self.cubics, self.first)
    }
}

/// Checks that `map` of the band `wavelength_nm` covers the film rectangle `rect` of `frame`, unless it is clamped.
///
/// # Errors
/// [`LensError::OutsideMap`] with both rectangles.
pub fn check_covers(
    map: &PlanarMap,
    wavelength_nm: f64,
    frame: &Frame,
    rect: Rect,
    outside: Outside,
) -> Result<(), LensError> {
    let ends = |first: i64, end: i64, axis: f64| {
        [first as f64, (end - 1) as f64].map(|pixel| (pixel - axis) * frame.pitch_mm())
    };
    let (x, y) = (ends(rect.x, rect.right(), frame.axis_px.1), ends(rect.y, rect.bottom(), frame.axis_px.0));
    let last = |nodes: &[f64]| [nodes[0], nodes[nodes.len() - 1]];
    let (map_x, map_y) = (last(&map.x_mm), last(&map.y_mm));
    // Tolerance for a film that ends exactly at the end of the map, rounded from px to mm.
    let covers = |needed: [f64; 2], map: [f64; 2]| {
        let slack = 1e-9 * (map[1] - map[0]);
        needed[0] >= map[0] - slack && needed[1] <= map[1] + slack
    };
    match outside == Outside::Clamp || (covers(x, map_x) && covers(y, map_y)) {
        true => Ok(()),
        false => Err(LensError::OutsideMap { wavelength_nm, x, y, map_x, map_y }),
    }
}

/// Bytes of the tables of a map of `nodes` (rows, columns).
pub const fn planar_table_bytes(nodes: (usize, usize)) -> usize {
    size_of::<Three>() * (nodes.0 + 2) * (nodes.1 + 2)
}

/// Bytes of the cubics along a film row.
pub(crate) const fn film_row_bytes(cells: usize) -> usize {
    size_of::<CellCubic>() * cells + size_of::<Three>() * (cells + 3)
}

#[inline(always)]
fn weighted(w: &[f64; 4], v: [Three; 4]) -> Three {
    let mut sum = [0.0; 3];
    for of in 0..3 {
        sum[of] = ((w[0] * v[0][of] + w[1] * v[1][of]) + w[2] * v[2][of]) + w[3] * v[3][of];
    }
    sum
}

/// The cubic of a cell with coefficients `c`.
#[inline(always)]
fn cubic(c: [Three; 4]) -> CellCubic {
    let mut a = CellCubic::default();
    for of in 0..3 {
        let [before, left, right, after] = [c[0][of], c[1][of], c[2][of], c[3][of]];
        a[0][of] = (before + 4.0 * left + right) * (1.0 / 6.0);
        a[1][of] = (right - before) * 0.5;
        a[2][of] = (before - 2.0 * left + right) * 0.5;
        a[3][of] = ((after - before) + 3.0 * (left - right)) * (1.0 / 6.0);
    }
    a
}

/// Its value at fraction `f`.
#[inline(always)]
pub(crate) fn value(a: &CellCubic, f: f64) -> Three {
    let mut sum = [0.0; 3];
    for of in 0..3 {
        sum[of] = a[0][of] + f * (a[1][of] + f * (a[2][of] + f * a[3][of]));
    }
    sum
}
