//! Where the anchors of film columns lie on the grid of the map: the same in all film rows.

use super::super::extent::{GROUP, Lane};
use super::super::knots::HALF_PX;
use super::super::map::ANCHOR_SPACING_PX;
use super::PlanarChartMap;
use crate::field::planar::FilmRow;

/// How the pixels of a block follow from its anchor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Expansion {
    /// By its cubic.
    #[default]
    Cubic,
    /// Also by the change of the third derivative at a knot.
    Knot,
    /// Mapped pixel by pixel: several knots, or an end of the map.
    Exact,
}

/// Columns of [`GROUP`] anchors.
#[derive(Clone, Debug, Default)]
pub(super) struct GroupColumns {
    /// Film column of the anchor from the axis, px.
    pub(super) dx: Lane,
    /// Index of its cell among the cubics of the row.
    pub(super) cell: [u32; GROUP],
    pub(super) fraction: Lane,
    /// Cells per px; 0 beyond the map, where nothing changes along the row.
    pub(super) cells_per_px: Lane,
    /// Index of the cell on the other side of the knot in the block; the anchor's own without one.
    pub(super) beyond: [u32; GROUP],
    /// Place of that knot from the anchor, px.
    pub(super) knot_at: [f32; GROUP],
    /// +1: it acts on the pixels to its right; −1: on those to its left.
    pub(super) side: [f32; GROUP],
    pub(super) expansion: [Expansion; GROUP],
}

impl GroupColumns {
    /// The blocks from `block` on of `count`, the first of which begins at film column `x`; past the last block of the row that
    /// block is repeated.
    pub(super) fn fill(
        &mut self,
        map: &PlanarChartMap<'_>,
        row: &FilmRow,
        x: i64,
        (block, count): (usize, usize),
    ) {
        *self = Self::default();
        let first = row.cubics().1;
        let cells = map.field.cells().1;
        let per_px = map.field.nodes_per_px().1;
        for i in 0..GROUP {
            let b = (block + i).min(count - 1);
            let dx = (x + (b * ANCHOR_SPACING_PX) as i64) as f64 + HALF_PX - map.axis_px.1;
            let (cell, fraction) = map.field.column(dx);
            let at = map.field.nodes_to(dx);
            let (low, high) = (at - HALF_PX * per_px, at + HALF_PX * per_px);
            let is_beyond = high <= 0.0 || low >= cells as f64;
            let crosses_end = !is_beyond && (low < 0.0 || high > cells as f64);
            let (left, right) = (low < cell as f64, high > (cell + 1) as f64);
            let several = (left && right) || low < cell as f64 - 1.0 || high > (cell + 2) as f64;
            let expansion = if crosses_end || (several && !is_beyond) {
                Expansion::Exact
            } else if (left || right) && !is_beyond {
                Expansion::Knot
            } else {
                Expansion::Cubic
            };
            let has_knot = expansion == Expansion::Knot;
            let beyond = if has_knot { if left { cell - 1 } else { cell + 1 } } else { cell };
            (self.dx[i], self.fraction[i]) = (dx, fraction);
            self.cells_per_px[i] = if is_beyond { 0.0 } else { per_px };
            (self.cell[i], self.beyond[i]) = ((cell - first) as u32, (beyond - first) as u32);
            self.side[i] = if left { -1.0 } else { 1.0 };
            self.knot_at[i] = ((if left { -fraction } else { 1.0 - fraction }) / per_px) as f32;
            self.expansion[i] = expansion;
        }
    }
}
