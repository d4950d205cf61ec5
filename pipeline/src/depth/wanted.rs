//! Where in a tile a slab is needed, in cells of 32 × 32 pixels: where light passes the slabs in front of it and its pixels reach to.
//!
//! A convolution needs those FFT blocks only whose windows reach a cell that is needed; elsewhere the slab changes nothing.

use crate::geometry::Rect;

/// Side of a cell, px.
const CELL_PX: usize = 32;

/// Cells of a tile.
#[derive(Debug, Default)]
pub(super) struct Wanted {
    tile: Option<Rect>,
    columns: usize,
    cells: Vec<bool>,
}

impl Wanted {
    /// Everything is needed.
    pub(super) fn everywhere(&mut self) {
        self.tile = None;
    }

    /// What is needed of a slab with the shares `a` on the rectangle `from`, of kernels that reach `margin` px, behind slabs that let `passing` of the light
    /// of each pixel of `tile` pass.
    pub(super) fn set(&mut self, tile: Rect, passing: &[f32], from: Rect, a: &[f32], margin: usize) {
        (self.tile, self.columns) = (Some(tile), tile.width.div_ceil(CELL_PX));
        self.cells.clear();
        self.cells.resize(tile.height.div_ceil(CELL_PX) * self.columns, false);
        // Cells of the larger rectangle with pixels of the slab; the first cell of the tile is a cell of it.
        for (y, row) in a.chunks_exact(from.width).enumerate() {
            for (first, part) in row.chunks(CELL_PX).enumerate() {
                if part.iter().any(|a| *a > 0.0) {
                    let rect = Rect::new(from.y + y as i64, from.x + (first * CELL_PX) as i64, 1, part.len());
                    self.mark(rect.grown(margin));
                }
            }
        }
        let (columns, cells) = (self.columns, &mut self.cells);
        let mut lit = vec![false; cells.len()];
        for (y, row) in passing.chunks_exact(tile.width).enumerate() {
            let lit = &mut lit[y / CELL_PX * columns..];
            for (part, lit) in std::iter::zip(row.chunks(CELL_PX), lit) {
                *lit = *lit || part.iter().any(|t| *t != 0.0);
            }
        }
        cells.iter_mut().zip(lit).for_each(|(cell, lit)| *cell &= lit);
    }

    /// Whether pixel `i` of the tile, row by row, is needed.
    pub(super) fn pixel(&self, i: usize) -> bool {
        let Some(tile) = self.tile else { return true };
        self.cells[i / tile.width / CELL_PX * self.columns + i % tile.width / CELL_PX]
    }

    /// Whether any pixel of `rect` of the film is needed.
    pub(super) fn reaches(&self, rect: Rect) -> bool {
        self.tile.is_none()
            || self.of(rect).is_some_and(|(rows, cols)| {
                rows.into_iter()
                    .any(|y| self.cells[y * self.columns..][cols.clone()].iter().any(|cell| *cell))
            })
    }

    fn mark(&mut self, rect: Rect) {
        let Some((rows, cols)) = self.of(rect) else { return };
        for y in rows {
            self.cells[y * self.columns..][cols.clone()].fill(true);
        }
    }

    /// Rows and columns of the cells that `rect` touches.
    #[allow(clippy::type_complexity, reason = "rows and columns")]
    fn of(&self, rect: Rect) -> Option<(std::ops::Range<usize>, std::ops::Range<usize>)> {
        let tile = self.tile?;
        let common = tile.intersect(rect);
        let cells = |first: i64, end: i64| first as usize / CELL_PX..(end as usize).div_ceil(CELL_PX);
        let rows = cells(common.y - tile.y, common.bottom() - tile.y);
        let cols = cells(common.x - tile.x, common.right() - tile.x);
        (!common.is_empty()).then_some((rows, cols))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn needed_is_what_is_reached_and_lit() {
        let (tile, from) = (Rect::new(100, 200, 70, 100), Rect::new(90, 190, 90, 120));
        let mut wanted = Wanted::default();
        assert!(wanted.pixel(0) && wanted.reaches(tile));
        // One pixel of the slab, at film row 95, column 240: above the tile.
        let mut a = vec![0.0; 90 * 120];
        a[5 * 120 + 50] = 0.5;
        let mut passing = vec![1.0; 7000];
        wanted.set(tile, &passing, from, &a, 4);
        assert!(!wanted.reaches(tile), "beyond the margin");
        wanted.set(tile, &passing, from, &a, 6);
        let needed: Vec<_> =
            (0..7000).filter(|&i| wanted.pixel(i)).map(|i| (i / 100 / 32, i % 100 / 32)).collect();
        assert!(needed.contains(&(0, 1)) && needed.iter().all(|cell| cell.0 == 0 && cell.1 < 3));
        assert!(wanted.reaches(Rect::new(90, 230, 20, 20)) && !wanted.reaches(Rect::new(140, 230, 30, 30)));
        passing[..32 * 100].fill(0.0);
        wanted.set(tile, &passing, from, &a, 6);
        assert!(!wanted.reaches(tile), "nothing passes there");
    }
}
