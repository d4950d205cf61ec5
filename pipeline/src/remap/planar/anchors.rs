//! Chart coordinates of the pixels of a film row from one f64 anchor per sixteen pixels, expanded by SIMD (`lanes`).
//!
//! Blocks and anchors lie as those of a lens with rotational symmetry ([`super::super::anchors`]). Along a film row D_y, D_x
//! and R are cubics in each cell of the map, so a pixel t columns from the anchor (|t| ≤ 8) in the same cell has exactly
//! ```text
//! row = row₀ + r₁t + r₂t² + r₃t³,   column = column₀ + n·t + c₁t + c₂t² + c₃t³,   R = R₀ + g₁t + g₂t² + g₃t³
//! ```
//! with n the integer nearest to the slope of the columns. Behind a knot at t_k the third derivative is another one, the lower
//! ones are continuous, so exactly
//! ```text
//! row(t) = the cubic + Δr₃·max(0, ±(t − t_k))³,   Δr₃ = ±(r₃ behind the knot − r₃)   (+ for a knot to the right)
//! ```
//! All terms but the anchor are of the size of the change within a block, for which f32 suffices: coordinates are within 2e-6
//! px of the f64 map. Blocks with several knots (cells narrower than 16 px), with an end of the map, or whose pixels move by
//! more than [`MAX_SHIFT_PX`] are mapped pixel by pixel in f64.

use super::super::extent::{ChartExtent, GROUP, Lane, lower, raise};
use super::super::knots::HALF_PX;
use super::super::map::{ANCHOR_SPACING_PX, ExactBlock};
use super::PlanarChartMap;
use super::columns::{Expansion, GroupColumns};
use crate::field::planar::{CellCubic, FilmRow};
use crate::geometry::Rect;
use crate::resample::Coordinate;

/// Margin of the bounds on cells, px: more than any rounding.
const SLACK_PX: f64 = 1e-3;
/// Blocks whose pixels move by more than this, rows or columns beyond whole ones, are not expanded: the rounding of f32.
const MAX_SHIFT_PX: f64 = 6.0;

/// Values of [`GROUP`] anchors, from which the coordinates of their blocks' pixels follow.
#[derive(Clone, Debug, Default)]
pub(in crate::remap) struct Group {
    pub(super) row: [i32; GROUP],
    pub(super) col: [i32; GROUP],
    pub(super) row_fraction: [f32; GROUP],
    pub(super) col_fraction: [f32; GROUP],
    /// Chart columns per film column, rounded: n.
    pub(super) integer_columns: [f32; GROUP],
    /// Coefficients of t, t², t³ of the row.
    pub(super) rows: [[f32; GROUP]; 3],
    /// The same of the column, n subtracted.
    pub(super) columns: [[f32; GROUP]; 3],
    /// Coefficients of 1, t, t², t³ of R.
    pub(super) gain: [[f32; GROUP]; 4],
    /// Coefficients behind the knot: of row, column and R.
    pub(super) knot: [[f32; GROUP]; 3],
    /// 0, or 1 + the index of an [`ExactBlock`].
    exact: [u32; GROUP],
}

/// Anchors of a film rectangle.
#[derive(Debug, Default)]
pub(crate) struct PlanarAnchors {
    /// First film column of the first block.
    pub(super) x: i64,
    /// Blocks per row.
    pub(super) count: usize,
    pub(super) columns: Vec<GroupColumns>,
    /// Row by row.
    groups: Vec<Group>,
    exact: Vec<ExactBlock>,
    /// (minimum, maximum) chart row and column over all pixels.
    pub(in crate::remap) cells: ((i64, i64), (i64, i64)),
}

impl PlanarAnchors {
    /// The groups of a row of the rectangle.
    #[inline(always)]
    pub(super) fn row(&self, row: usize) -> &[Group] {
        let groups = self.columns.len();
        &self.groups[row * groups..][..groups]
    }

    /// The pixels of the `i`-th block of a group, if they were mapped one by one.
    #[inline(always)]
    pub(super) fn exact(&self, group: &Group, i: usize) -> Option<&ExactBlock> {
        match group.exact[i] {
            0 => None,
            at => Some(&self.exact[at as usize - 1]),
        }
    }

    /// Computes the anchors of `rect`; `film_row` is a buffer.
    #[inline(always)]
    pub(super) fn fill(&mut self, map: &PlanarChartMap<'_>, rect: Rect, film_row: &mut FilmRow) {
        let side = ANCHOR_SPACING_PX as i64;
        self.x = rect.x.div_euclid(side) * side;
        self.count = ((rect.right() - self.x) as usize).div_ceil(ANCHOR_SPACING_PX);
        let groups = self.count.div_ceil(GROUP);
        self.columns.resize(groups, GroupColumns::default());
        self.groups.resize(groups * rect.height, Group::default());
        self.exact.clear();
        // Also the pixels of the last block beyond the rectangle, and its far edge.
        let across = (self.x, self.x + self.count as i64 * side + 1);
        let mut extent = ChartExtent::empty();
        for row in 0..rect.height {
            let y = rect.y + row as i64;
            map.film_row(y, across, film_row);
            if row == 0 {
                for (i, columns) in self.columns.iter_mut().enumerate() {
                    columns.fill(map, film_row, self.x, (i * GROUP, self.count));
                }
            }
            let dy = y as f64 - map.axis_px.0;
            for i in 0..groups {
                let group = &mut self.groups[row * groups + i];
                if group.fill(map, dy, &self.columns[i], film_row.cubics().0, &mut extent) {
                    self.fill_exact(row * groups + i, map, film_row, (y, i), &mut extent);
                }
            }
        }
        self.cells = extent.cells();
    }

    /// Maps the blocks of group `i` of film row `y` that are not expanded.
    #[cold]
    #[inline(never)]
    fn fill_exact(
        &mut self,
        index: usize,
        map: &PlanarChartMap<'_>,
        film_row: &FilmRow,
        (y, i): (i64, usize),
        extent: &mut ChartExtent,
    ) {
        for b in 0..GROUP.min(self.count - i * GROUP) {
            if self.groups[index].exact[b] == 0 {
                continue;
            }
            let mut exact = ExactBlock::default();
            let x = self.x + ((i * GROUP + b) * ANCHOR_SPACING_PX) as i64;
            map.pixel_by_pixel(film_row, y, x, &mut exact.as_block());
            extent.include(span(&exact.row), span(&exact.col));
            self.exact.push(exact);
            self.groups[index].exact[b] = self.exact.len() as u32;
        }
    }
}

/// Minimum and maximum.
fn span(cells: &[i32; ANCHOR_SPACING_PX]) -> (f64, f64) {
    let (low, high) = cells.iter().fold((i32::MAX, i32::MIN), |(low, high), c| (low.min(*c), high.max(*c)));
    (f64::from(low), f64::from(high))
}

/// Intermediate values of the anchors of a group, in f64: D_y, D_x and R.
#[derive(Default)]
struct AnchorLanes {
    /// Coefficients of powers of t.
    powers: [[Lane; 3]; 4],
    /// Change of the coefficient of t³ at the knot.
    knot: [Lane; 3],
}

impl AnchorLanes {
    /// The cubics of the anchors' cells, and the changes at their knots.
    #[inline(always)]
    fn look_up(&mut self, columns: &GroupColumns, cubics: &[CellCubic]) {
        for i in 0..GROUP {
            let cubic = &cubics[columns.cell[i] as usize];
            let beyond = &cubics[columns.beyond[i] as usize][3];
            for of in 0..3 {
                for power in 0..4 {
                    self.powers[power][of][i] = cubic[power][of];
                }
                self.knot[of][i] = beyond[of] - cubic[3][of];
            }
        }
    }

    /// From powers of the fraction of the cell to powers of t.
    #[inline(always)]
    fn move_to_anchors(&mut self, columns: &GroupColumns) {
        for of in 0..3 {
            for i in 0..GROUP {
                let (f, k) = (columns.fraction[i], columns.cells_per_px[i]);
                let [a0, a1, a2, a3] = [0, 1, 2, 3].map(|power: usize| self.powers[power][of][i]);
                self.powers[0][of][i] = a0 + f * (a1 + f * (a2 + f * a3));
                self.powers[1][of][i] = (a1 + f * (2.0 * a2 + 3.0 * f * a3)) * k;
                self.powers[2][of][i] = (a2 + 3.0 * f * a3) * (k * k);
                self.powers[3][of][i] = a3 * (k * k * k);
                self.knot[of][i] = self.knot[of][i] * (k * k * k) * f64::from(columns.side[i]);
            }
        }
    }
}

impl Group {
    /// Computes the anchors of the film row `dy` px below the axis and includes their blocks in `extent`; whether any block is
    /// to be mapped pixel by pixel.
    #[inline(always)]
    fn fill(
        &mut self,
        map: &PlanarChartMap<'_>,
        dy: f64,
        columns: &GroupColumns,
        cubics: &[CellCubic],
        extent: &mut ChartExtent,
    ) -> bool {
        let mut lanes = AnchorLanes::default();
        lanes.look_up(columns, cubics);
        lanes.move_to_anchors(columns);
        let AnchorLanes { powers: p, knot } = &lanes;
        let (per_row, per_col) = map.per_scale;
        let (mut row, mut col, mut slope, mut integer) =
            (Lane::default(), Lane::default(), Lane::default(), Lane::default());
        for i in 0..GROUP {
            row[i] = map.row(dy, p[0][0][i]);
            col[i] = map.column(columns.dx[i], p[0][1][i]);
            let all = (1.0 + p[1][1][i]) * per_col;
            integer[i] = all.round_ties_even();
            slope[i] = all - integer[i];
        }
        let mut unexpandable = 0.0;
        for i in 0..GROUP {
            let shift = |slope: f64, of: usize, scale: f64| {
                let cube = p[3][of][i].abs() + knot[of][i].abs();
                HALF_PX * (slope.abs() + HALF_PX * scale * (p[2][of][i].abs() + HALF_PX * cube)) + SLACK_PX
            };
            let (down, across) = (shift(p[1][0][i] * per_row, 0, per_row), shift(slope[i], 1, per_col));
            let bad =
                (down > MAX_SHIFT_PX) | (across > MAX_SHIFT_PX) | (columns.expansion[i] == Expansion::Exact);
            self.exact[i] = u32::from(bad);
            unexpandable += if bad { 1.0 } else { 0.0 };
            // Blocks that are mapped pixel by pixel are included then.
            let height = if bad { f64::NEG_INFINITY } else { down };
            let width = if bad { f64::NEG_INFINITY } else { HALF_PX * integer[i].abs() + across };
            lower(&mut extent.row.0[i], row[i] - height);
            raise(&mut extent.row.1[i], row[i] + height);
            lower(&mut extent.col.0[i], col[i] - width);
            raise(&mut extent.col.1[i], col[i] + width);
        }
        self.split_coordinates(&row, &col);
        for i in 0..GROUP {
            self.integer_columns[i] = integer[i] as f32;
            self.rows[0][i] = (p[1][0][i] * per_row) as f32;
            self.columns[0][i] = slope[i] as f32;
            self.gain[0][i] = p[0][2][i] as f32;
            self.gain[1][i] = p[1][2][i] as f32;
        }
        for power in 2..4 {
            for i in 0..GROUP {
                self.rows[power - 1][i] = (p[power][0][i] * per_row) as f32;
                self.columns[power - 1][i] = (p[power][1][i] * per_col) as f32;
                self.gain[power][i] = p[power][2][i] as f32;
            }
        }
        for (to, (from, scale)) in self.knot.iter_mut().zip(knot.iter().zip([per_row, per_col, 1.0])) {
            for i in 0..GROUP {
                to[i] = (from[i] * scale) as f32;
            }
        }
        unexpandable > 0.0
    }

    #[inline(always)]
    fn split_coordinates(&mut self, row: &Lane, col: &Lane) {
        for i in 0..GROUP {
            let at = Coordinate::new(row[i]);
            (self.row[i], self.row_fraction[i]) = (at.cell, at.fraction);
        }
        for i in 0..GROUP {
            let at = Coordinate::new(col[i]);
            (self.col[i], self.col_fraction[i]) = (at.cell, at.fraction);
        }
    }
}
