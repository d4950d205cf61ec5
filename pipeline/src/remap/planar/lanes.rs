//! SIMD: expansion of the anchors of a map without rotational symmetry to pixel coordinates ([`super::anchors`]).

use super::super::lanes::{Expand, Pixels};
use super::super::map::ANCHOR_SPACING_PX;
use super::PlanarChartMap;
use super::anchors::{Group, PlanarAnchors};
use super::columns::{Expansion, GroupColumns};
use crate::field::planar::FilmRow;
use crate::geometry::Rect;
use crate::simd::lanes::{Lanes, SimdOp};

/// Computes the anchors of a film rectangle.
pub(in crate::remap) struct FillPlanarAnchors<'a> {
    pub(in crate::remap) map: PlanarChartMap<'a>,
    pub(in crate::remap) rect: Rect,
    pub(in crate::remap) film_row: &'a mut FilmRow,
    pub(in crate::remap) to: &'a mut PlanarAnchors,
}

impl<V: Lanes> SimdOp<V> for FillPlanarAnchors<'_> {
    #[inline(always)]
    fn run(self) {
        self.to.fill(&self.map, self.rect, self.film_row);
    }
}

impl Expand for &PlanarAnchors {
    type Group = Group;
    type Line<V: Lanes> = ();

    #[inline(always)]
    fn blocks(&self) -> (i64, usize) {
        (self.x, self.count)
    }

    #[inline(always)]
    fn groups(&self, row: usize) -> &[Group] {
        self.row(row)
    }

    #[inline(always)]
    fn line<V: Lanes>(&self, _: usize) {}

    #[inline(always)]
    fn pixels<V: Lanes>(&self, (): &(), (g, group): (usize, &Group), i: usize, first: usize) -> Pixels<V> {
        let columns = &self.columns[g];
        match self.exact(group, i) {
            Some(exact) => Pixels::load(exact, first),
            None if columns.expansion[i] == Expansion::Knot => expand::<V, true>(group, columns, i, first),
            None => expand::<V, false>(group, columns, i, first),
        }
    }
}

/// The pixels of block `i` of a group from its `first` on; `KNOT` if there is a knot in it.
#[inline(always)]
fn expand<V: Lanes, const KNOT: bool>(
    group: &Group,
    columns: &GroupColumns,
    i: usize,
    first: usize,
) -> Pixels<V> {
    let t = V::iota() + V::splat(first as f32 - (ANCHOR_SPACING_PX / 2) as f32);
    let [r1, r2, r3] = [V::splat(group.rows[0][i]), V::splat(group.rows[1][i]), V::splat(group.rows[2][i])];
    let [c1, c2, c3] =
        [V::splat(group.columns[0][i]), V::splat(group.columns[1][i]), V::splat(group.columns[2][i])];
    let [g1, g2, g3] = [V::splat(group.gain[1][i]), V::splat(group.gain[2][i]), V::splat(group.gain[3][i])];
    let mut row = t * t.mul_add(t.mul_add(r3, r2), r1);
    let mut col = t * t.mul_add(t.mul_add(c3, c2), c1);
    let mut gain = t.mul_add(t.mul_add(t.mul_add(g3, g2), g1), V::splat(group.gain[0][i]));
    if KNOT {
        let past = ((t - V::splat(columns.knot_at[i])) * V::splat(columns.side[i])).max(V::splat(0.0));
        let cube = past * past * past;
        row = cube.mul_add(V::splat(group.knot[0][i]), row);
        col = cube.mul_add(V::splat(group.knot[1][i]), col);
        gain = cube.mul_add(V::splat(group.knot[2][i]), gain);
    }
    row = row + V::splat(group.row_fraction[i]);
    col = col + V::splat(group.col_fraction[i]);
    let (row_cell, col_cell) = (row.floor(), col.floor());
    Pixels {
        rows: V::add_i32(row_cell.to_i32(), group.row[i]),
        cols: V::add_i32(t.mul_add(V::splat(group.integer_columns[i]), col_cell).to_i32(), group.col[i]),
        row_fraction: row - row_cell,
        col_fraction: col - col_cell,
        gain,
    }
}
