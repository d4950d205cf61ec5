//! Columns of a triangle in each row of pixels of a tile.
//!
//! The sides of the projected triangle meet the line between two rows at the columns L ≤ R. The triangle is convex: in the row between two lines it reaches
//! from the least L to the largest R of both, or to a corner in the row; and between the larger L and the lesser R it covers the whole row, where the
//! edge functions need not be evaluated.
//!
//! The edge functions have the sign of the exact ones from a distance of 10⁻⁸ px of the side's line on: n = v_i × v_j has a rounding of 10⁻¹⁶ of each component, and
//! a pixel is 10⁻⁶ or more. The columns are rounded by 1/64 px to the safe side, which is 10⁻⁶ px across a side of the largest slope, and 10⁻⁶ px in rows
//! change them by less. No columns are known on a chart that is not planar, where sides are curved, of triangles with a corner behind the camera or 10⁶ px away, and of those whose angles are below 10⁻⁶; steeper sides
//! than the largest slope have all their columns.

use crate::scene::frame::Frame;

/// What is added to columns, px.
const COLUMN_MARGIN_PX: f64 = 1.0 / 64.0;
/// What is added to rows, px.
const ROW_MARGIN_PX: f64 = 1e-6;
/// Largest change of the column with the row of a side.
const MAX_SLOPE: f64 = 1e4;
/// Corners are not farther from the first pixel, px.
const MAX_PX: f64 = 1e6;
/// Least area of a triangle, of the square of its longest side.
const MIN_AREA: f64 = 1e-6;

/// Columns of a row of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct RowSpan {
    /// First column with hits, and one past the last.
    pub(crate) all: (u8, u8),
    /// First column of which all samples have hits, and one past the last.
    pub(crate) covered: (u8, u8),
}

impl RowSpan {
    /// Hits may be in these columns; of none it is known that all samples have hits.
    pub(super) fn uncovered(columns: (usize, usize)) -> Self {
        let all = (columns.0 as u8, columns.1 as u8);
        Self { all, covered: (all.1, all.1) }
    }
}

/// A side of a projected triangle, in rows and columns of px.
struct Side {
    rows: (f64, f64),
    columns: (f64, f64),
    /// A corner.
    at: [f64; 2],
    /// Columns per row; 0 if it is too large.
    slope: f64,
    is_flat: bool,
}

impl Side {
    fn new(a: [f64; 2], b: [f64; 2]) -> Self {
        let (down, across) = (b[0] - a[0], b[1] - a[1]);
        let is_flat = across.abs() > MAX_SLOPE * down.abs();
        let slope = if is_flat || down == 0.0 { 0.0 } else { across / down };
        let rows = (a[0].min(b[0]) - ROW_MARGIN_PX, a[0].max(b[0]) + ROW_MARGIN_PX);
        Self { rows, columns: (a[1].min(b[1]), a[1].max(b[1])), at: a, slope, is_flat }
    }
}

/// Where a line between two rows meets the triangle.
#[derive(Clone, Copy)]
struct Section {
    left: f64,
    right: f64,
    /// Whether the columns are those of the triangle but for rounding.
    is_exact: bool,
}

/// Projected corners (row, column) of a triangle, with its sides.
pub(super) struct Outline {
    corners: [[f64; 2]; 3],
    sides: [Side; 3],
}

impl Outline {
    /// Of the corners; `None` if no columns are known.
    pub(super) fn new(frame: &Frame, corners: &[[f64; 3]; 3]) -> Option<Self> {
        if frame.film.is_some() || corners.iter().any(|c| c[2] <= 0.0) {
            return None;
        }
        let [a, b, c] = corners.map(|c| [frame.row(c[1] / c[2]), frame.column(c[0] / c[2])]);
        if ![a, b, c].iter().flatten().all(|v| v.abs() <= MAX_PX) {
            return None;
        }
        let (u, v, w) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]], [c[0] - b[0], c[1] - b[1]]);
        let longest = [u, v, w].map(|s| s[0] * s[0] + s[1] * s[1]).into_iter().fold(0.0, f64::max);
        let area = (u[0] * v[1] - u[1] * v[0]).abs();
        let sides = [Side::new(a, b), Side::new(b, c), Side::new(c, a)];
        (area > MIN_AREA * longest).then_some(Self { corners: [a, b, c], sides })
    }

    /// The line at `row`.
    #[inline]
    fn section(&self, row: f64) -> Section {
        let mut section = Section { left: f64::INFINITY, right: f64::NEG_INFINITY, is_exact: true };
        for side in &self.sides {
            if row < side.rows.0 || row > side.rows.1 {
                continue;
            }
            let (left, right) = if side.is_flat {
                section.is_exact = false;
                side.columns
            } else {
                let column = side.at[1] + (row - side.at[0]) * side.slope;
                (column, column)
            };
            section.left = if left < section.left { left } else { section.left };
            section.right = if right > section.right { right } else { section.right };
        }
        section
    }

    /// Adds the columns of the rows of a tile whose first pixel is (`row`, `column`) to `spans`: of the rows `rows` of the tile, within its columns `columns`.
    pub(super) fn add_spans(
        &self,
        (row, column): (usize, usize),
        rows: (usize, usize),
        columns: (usize, usize),
        spans: &mut Vec<RowSpan>,
    ) {
        // Columns of the tile, whose limits are whole numbers of 0 or more: the cast rounds down.
        let limit = |c: f64| (c - column as f64).clamp(columns.0 as f64, columns.1 as f64) as u8;
        let line = |r: usize| (row + r) as f64 - 0.5;
        let mut above = self.section(line(rows.0));
        for r in rows.0..rows.1 {
            let below = self.section(line(r + 1));
            let (mut left, mut right) = (above.left.min(below.left), above.right.max(below.right));
            for [corner_row, corner_column] in self.corners {
                if corner_row >= line(r) - ROW_MARGIN_PX && corner_row <= line(r + 1) + ROW_MARGIN_PX {
                    left = left.min(corner_column);
                    right = right.max(corner_column);
                }
            }
            // Pixel c has samples from c − ½ to c + ½. Sums are negative or infinite where nothing is met; then limits are equal.
            let all = (limit(left - COLUMN_MARGIN_PX + 0.5), limit(right + COLUMN_MARGIN_PX + 1.5));
            let inner = (above.left.max(below.left), above.right.min(below.right));
            let covered = (limit(inner.0 + COLUMN_MARGIN_PX + 1.5), limit(inner.1 - COLUMN_MARGIN_PX + 0.5));
            let is_known = above.is_exact && below.is_exact && covered.0 < covered.1;
            let all = if all.0 < all.1 { all } else { (all.1, all.1) };
            spans.push(RowSpan { all, covered: if is_known { covered } else { (all.1, all.1) } });
            above = below;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::test_mesh::Random;
    use crate::scene::visibility::bins::{Span, pixels};
    use crate::scene::visibility::triangle::{Edges, along};

    const FRAME: Frame = Frame::centred(160, 192, 0.05, 50.0);
    /// First pixel of the tile.
    const TILE: (usize, usize) = (64, 64);

    /// Spans of the rows of the tile from the first one on, with its number.
    fn spans(corners: &[[f64; 3]; 3]) -> Option<(usize, Vec<RowSpan>)> {
        let Span { rows, columns } = pixels(&FRAME, corners)?;
        let part = |(first, end): (usize, usize), of: usize| {
            let (first, end) = (first.max(of), end.min(of + 64));
            (first < end).then(|| (first - of, end - of))
        };
        let (rows, columns) = (part(rows, TILE.0)?, part(columns, TILE.1)?);
        let mut spans = Vec::new();
        Outline::new(&FRAME, corners)?.add_spans(TILE, rows, columns, &mut spans);
        Some((rows.0, spans))
    }

    /// A corner at a place of the chart in px, at distance z.
    fn corner(row: f64, column: f64, z: f64) -> [f64; 3] {
        let (x, y) = FRAME.direction(row, column);
        [x * z, y * z, z].map(|v| f64::from(v as f32))
    }

    #[test]
    fn a_right_triangle_has_the_columns_of_its_sides() {
        // Columns 70 to 110 at row 70, none at row 110.
        let corners = [corner(70.0, 70.0, 1.0), corner(70.0, 110.0, 2.0), corner(110.0, 70.0, 3.0)];
        let (first, spans) = spans(&corners).unwrap();
        assert_eq!((first, spans.len()), (6, 41));
        for (k, span) in spans.iter().enumerate() {
            // The sides are at column 70, and at 180 − r in row r: 110.5 − k at the upper limit of row 70 + k, 109.5 − k at the lower one.
            assert_eq!(span.all, (6, if k == 0 { 47 } else { 48 - k as u8 }), "{k}");
            match k {
                1..38 => assert_eq!(span.covered, (7, 45 - k as u8), "{k}"),
                _ => assert!(span.covered.0 >= span.covered.1, "{k} {span:?}"),
            }
        }
    }

    #[test]
    fn hits_are_in_the_spans_and_covered_pixels_are_hit() {
        let mut random = Random(5);
        let (mut known, mut hit, mut covered) = (0, 0, 0);
        for round in 0..4000 {
            let size = [0.3, 3.0, 30.0, 300.0][round % 4];
            let (row, column) = (random.between(60.0, 132.0), random.between(60.0, 132.0));
            let mut place = || [random.between(-size, size), random.between(-size, size)];
            let mut at = [place(), place(), place()];
            match round % 7 {
                0 => at[1][0] = at[0][0],
                1 => at[1] = [at[0][0] + 1e-5, at[0][1] + size],
                2 => at[2] = [0, 1].map(|k| 0.5 * (at[0][k] + at[1][k]) + 1e-3 * at[2][k]),
                3 => at = at.map(|p| p.map(|v| (v * 2.0).round() * 0.5)),
                _ => {}
            }
            let corners =
                at.map(|p| corner(row.round() + p[0], column.round() + p[1], random.between(0.5, 2.0)));
            let (Some(edges), Some((first, spans))) = (Edges::new(corners), spans(&corners)) else {
                continue;
            };
            known += 1;
            for (k, span) in spans.iter().enumerate() {
                for column in 0..64u8 {
                    for (dy, dx) in [(-0.5, -0.5), (0.375, -0.125), (0.0, 0.0), (-0.375, 0.125), (0.5, 0.5)] {
                        let row = (TILE.0 + first + k) as f64 + dy;
                        let (x, y) = FRAME.direction(row, (TILE.1 + usize::from(column)) as f64 + dx);
                        let positive = [0, 1, 2].map(|k| along(&edges.n[k], x, y) >= edges.least[k]);
                        let is_hit = positive == [true; 3] || positive == [false; 3];
                        let is_in = |(first, end): (u8, u8)| (first..end).contains(&column);
                        assert!(is_in(span.all) || !is_hit, "{round} {k} {column} {span:?}");
                        assert!(is_hit || !is_in(span.covered), "{round} {k} {column} {span:?}");
                        hit += usize::from(is_hit);
                        covered += usize::from(is_in(span.covered));
                    }
                }
            }
        }
        assert!(known > 2000 && hit > 1_000_000 && covered * 10 > hit * 9, "{known} {hit} {covered}");
    }

    #[test]
    fn slivers_and_triangles_about_the_camera_have_no_outline() {
        let a = [corner(70.0, 70.0, 1.0), corner(70.0, 110.0, 1.0), corner(90.0, 70.0, 1.0)];
        assert!(Outline::new(&FRAME, &a).is_some());
        assert!(Outline::new(&FRAME, &[a[0], a[1], [0.1, 0.1, -1.0]]).is_none());
        assert!(Outline::new(&FRAME, &[a[0], a[1], [0.1, 0.1, 0.0]]).is_none());
        assert!(Outline::new(&FRAME, &[a[0], a[1], [0.1, 0.1, 1e-9]]).is_none());
        let middle = [0, 1, 2].map(|k| f64::midpoint(a[0][k], a[1][k]));
        assert!(Outline::new(&FRAME, &[a[0], a[1], middle]).is_none());
    }
}
