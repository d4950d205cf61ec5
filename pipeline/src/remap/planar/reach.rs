//! Bounds of the map over rectangles of film, without mapping their pixels.
//!
//! Over a rectangle of h × w px on which f has bounded second derivatives, f differs from the bilinear interpolant of its
//! corners by at most
//! ```text
//! h²/8·max|∂²f/∂y²| + w²/8·max|∂²f/∂x²|
//! ```
//! (the error of linear interpolation, once in each direction), and that interpolant lies between the corners. The second
//! derivatives are bounded cell by cell by second differences of the spline's coefficients
//! ([`crate::field::planar::PlanarField::bend`]). At an end of the map the slope changes, so a rectangle is divided there.
//!
//! The singular values of the Jacobian ∂(ideal)/∂(film) anywhere in a cell differ from those in its middle by at most the
//! Frobenius norm of the change of the Jacobian (H. Weyl), bounded by half a cell times the second derivatives. Beyond an end
//! of the map the displacement is constant across that end, so there the Jacobian has the column of the identity.

use super::super::reach::{EMPTY, SLACK_PX, Span, union};
use super::PlanarChartMap;
use crate::field::Stretch;
use crate::field::planar::{Bend, PlanarField};
use crate::geometry::Rect;
use std::array::from_fn;

impl PlanarChartMap<'_> {
    /// Bounds of the chart rows and columns of the pixels of `rect`.
    pub(in crate::remap) fn bound(&self, rect: Rect) -> (Span, Span) {
        let (dy, dx) = self.offsets(rect);
        let (rows, columns) = self.field.ends_px();
        let (mut row, mut col) = (EMPTY, EMPTY);
        for y in parts(dy, rows) {
            for x in parts(dx, columns) {
                let (part_row, part_col) = self.bound_part(y, x);
                (row, col) = (union(row, part_row), union(col, part_col));
            }
        }
        (row, col)
    }

    /// Bounds of the chart rows and columns between rows `dy` and columns `dx`, which cross no end of the map.
    fn bound_part(&self, dy: Span, dx: Span) -> (Span, Span) {
        let (mut row, mut col) = (EMPTY, EMPTY);
        for (dy, dx) in [(dy.0, dx.0), (dy.0, dx.1), (dy.1, dx.0), (dy.1, dx.1)] {
            let [down, across, _] = self.field.at(dy, dx);
            let (at_row, at_col) = (self.row(dy, down), self.column(dx, across));
            (row, col) = (union(row, (at_row, at_row)), union(col, (at_col, at_col)));
        }
        let (bend, height, width) = (self.bend(dy, dx), dy.1 - dy.0, dx.1 - dx.0);
        let off = |of: usize| (height * height * bend.down[of] + width * width * bend.across[of]) / 8.0;
        (grown(row, off(0) * self.per_scale.0 + SLACK_PX), grown(col, off(1) * self.per_scale.1 + SLACK_PX))
    }

    /// The stretch over the film rectangle `rect`.
    pub(in crate::remap) fn stretch(&self, rect: Rect) -> Stretch {
        let (dy, dx) = self.offsets(rect);
        let (rows, columns) = self.field.cells_under(dy, dx);
        let mut all = Stretch { least: f64::INFINITY, greatest: 0.0, shear: 0.0 };
        for cell in (rows.0..=rows.1).flat_map(|y| (columns.0..=columns.1).map(move |x| (y, x))) {
            for place in places(self.field, cell, (dy, dx)) {
                let one = cell_stretch(self.field, cell, place);
                all.least = all.least.min(one.least);
                all.greatest = all.greatest.max(one.greatest);
                all.shear = all.shear.max(one.shear);
            }
        }
        all
    }

    /// First and last row and column of `rect`, px from the axis.
    fn offsets(&self, rect: Rect) -> (Span, Span) {
        let ends = |first: i64, end: i64, axis: f64| (first as f64 - axis, (end - 1) as f64 - axis);
        (ends(rect.y, rect.bottom(), self.axis_px.0), ends(rect.x, rect.right(), self.axis_px.1))
    }

    /// Bounds of the second derivatives between rows `dy` and columns `dx`.
    fn bend(&self, dy: Span, dx: Span) -> Bend {
        let (rows, columns) = self.field.cells_under(dy, dx);
        let cells = (rows.0..=rows.1).flat_map(|y| (columns.0..=columns.1).map(move |x| (y, x)));
        cells.map(|cell| self.field.bend(cell)).fold(Bend::default(), |a, b| {
            let max = |a: [f64; 2], b: [f64; 2]| [a[0].max(b[0]), a[1].max(b[1])];
            Bend { down: max(a.down, b.down), across: max(a.across, b.across), mixed: max(a.mixed, b.mixed) }
        })
    }
}

/// Parts of a line that do not cross the ends of the map.
fn parts(line: Span, (first, last): Span) -> impl Iterator<Item = Span> {
    let inside = |at: f64| (line.0 < at && at < line.1).then_some(at);
    let mut from = line.0;
    [inside(first), inside(last), Some(line.1)].into_iter().flatten().map(move |to| {
        let part = (from, to);
        from = to;
        part
    })
}

fn grown((low, high): Span, by: f64) -> Span {
    (low - by, high + by)
}

/// Whether the displacement changes down and across, for the places of a rectangle that have the displacement of a place of
/// `cell`: inside the map, and beyond its ends.
fn places(
    field: &PlanarField,
    (row, column): (usize, usize),
    (dy, dx): (Span, Span),
) -> impl Iterator<Item = (bool, bool)> {
    let (cells, (rows, columns)) = (field.cells(), field.ends_px());
    let beyond = |cell: usize, cells: usize, d: Span, ends: Span| {
        (cell == 0 && d.0 < ends.0) || (cell + 1 == cells && d.1 > ends.1)
    };
    let down = beyond(row, cells.0, dy, rows);
    let across = beyond(column, cells.1, dx, columns);
    [Some((true, true)), down.then_some((false, true)), across.then_some((true, false))]
        .into_iter()
        .chain([(down && across).then_some((false, false))])
        .flatten()
}

/// The stretch over a cell, where the displacement changes as told by `changes` (down, across).
fn cell_stretch(field: &PlanarField, cell: (usize, usize), changes: (bool, bool)) -> Stretch {
    let (slopes, bend) = (field.slopes(cell), field.bend(cell));
    let (per_y, per_x) = field.nodes_per_px();
    let weight = [f64::from(u8::from(changes.0)), f64::from(u8::from(changes.1))];
    // Of the ideal row and column by film row and column.
    let jacobian: [[f64; 2]; 2] =
        from_fn(|of| from_fn(|along| slopes[of][along] * weight[along] + f64::from(u8::from(of == along))));
    // Largest change of each from the middle of the cell.
    let change: [[f64; 2]; 2] = from_fn(|of| {
        [
            (bend.down[of] / per_y + bend.mixed[of] / per_x) / 2.0 * weight[0],
            (bend.mixed[of] / per_y + bend.across[of] / per_x) / 2.0 * weight[1],
        ]
    });
    let norm = change.as_flattened().iter().map(|c| c * c).sum::<f64>().sqrt();
    let (least, greatest) = singular_values(jacobian);
    let shear = (jacobian[0][1].abs() + change[0][1]).max(jacobian[1][0].abs() + change[1][0]);
    Stretch { least: (least - norm).max(0.0), greatest: greatest + norm, shear }
}

/// Least and greatest singular value of a 2 × 2 matrix, from the lengths of its parts that keep and that change orientation.
fn singular_values([[a, b], [c, d]]: [[f64; 2]; 2]) -> (f64, f64) {
    let length = |x: f64, y: f64| (x * x + y * y).sqrt() / 2.0;
    let (keeps, changes) = (length(a + d, c - b), length(a - d, b + c));
    ((keeps - changes).abs(), keeps + changes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn singular_values_are_those_of_closed_forms() {
        assert_eq!(singular_values([[3.0, 0.0], [0.0, -2.0]]), (2.0, 3.0));
        // A shear by 1: the golden ratio and its inverse.
        let (least, greatest) = singular_values([[1.0, 1.0], [0.0, 1.0]]);
        let golden = (1.0 + 5f64.sqrt()) / 2.0;
        assert!((greatest - golden).abs() < 1e-15 && (least - 1.0 / golden).abs() < 1e-15);
    }

    #[test]
    fn lines_are_divided_at_the_ends_of_the_map() {
        let parts = |line, ends| parts(line, ends).collect::<Vec<_>>();
        assert_eq!(parts((-2.0, 3.0), (0.0, 1.0)), [(-2.0, 0.0), (0.0, 1.0), (1.0, 3.0)]);
        assert_eq!(parts((0.2, 3.0), (0.0, 1.0)), [(0.2, 1.0), (1.0, 3.0)]);
        assert_eq!(parts((2.0, 3.0), (0.0, 1.0)), [(2.0, 3.0)]);
        assert_eq!(parts((0.5, 0.5), (0.0, 1.0)), [(0.5, 0.5)]);
    }
}
