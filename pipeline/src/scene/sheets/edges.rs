//! Which tiles can show hidden sheets: those within reach of an edge.

use crate::scene::visibility::{TILE_PX, TileGrid};

/// Vergences of sheet 0 at the pixels of a tile's border, 1/m; NaN without coverage.
#[derive(Clone, Debug, PartialEq)]
pub struct Border {
    /// First row.
    pub top: Vec<f32>,
    /// Last row.
    pub bottom: Vec<f32>,
    /// First column.
    pub left: Vec<f32>,
    /// Last column.
    pub right: Vec<f32>,
}

/// Tiles with an edge, as far as known.
pub struct EdgeMap {
    grid: TileGrid,
    gap: f64,
    has_edge: Vec<bool>,
    /// Of tiles with a neighbour that is not known yet.
    borders: Vec<Option<Box<Border>>>,
}

impl EdgeMap {
    /// Without tiles.
    pub fn new(grid: TileGrid, gap_dioptre: f64) -> Self {
        Self {
            grid,
            gap: gap_dioptre,
            has_edge: vec![false; grid.tiles()],
            borders: (0..grid.tiles()).map(|_| None).collect(),
        }
    }

    /// Adds a tile: whether it has an edge, and its border, which is compared with those of its neighbours. Tiles may come in any order, each once.
    pub fn add(&mut self, tile: usize, has_edge: bool, border: Border) {
        let across = self.grid.across();
        self.has_edge[tile] |= has_edge;
        let column = tile % across;
        let sides: [(Option<usize>, Side); 4] = [
            (tile.checked_sub(across), |b| (&b.top, &b.bottom)),
            (Some(tile + across).filter(|&t| t < self.grid.tiles()), |b| (&b.bottom, &b.top)),
            (tile.checked_sub(1).filter(|_| column > 0), |b| (&b.left, &b.right)),
            (Some(tile + 1).filter(|_| column + 1 < across), |b| (&b.right, &b.left)),
        ];
        for (other, side) in sides {
            let Some((other, theirs)) = other.and_then(|o| Some((o, self.borders[o].as_deref()?))) else {
                continue;
            };
            if are_apart(side(&border).0, side(theirs).1, self.gap) {
                self.has_edge[tile] = true;
                self.has_edge[other] = true;
            }
        }
        self.borders[tile] = Some(Box::new(border));
        self.free_around(tile);
    }

    /// Frees the borders about a tile whose neighbours are all known.
    fn free_around(&mut self, tile: usize) {
        let across = self.grid.across();
        let (row, column) = (tile / across, tile % across);
        for (r, c) in [
            (row, column),
            (row.wrapping_sub(1), column),
            (row + 1, column),
            (row, column.wrapping_sub(1)),
            (row, column + 1),
        ] {
            let is_inside = |r: usize, c: usize| r < self.grid.down() && c < across;
            let around = [
                (r.wrapping_sub(1), c),
                (r.wrapping_add(1), c),
                (r, c.wrapping_sub(1)),
                (r, c.wrapping_add(1)),
            ];
            let is_known =
                |(r, c): (usize, usize)| !is_inside(r, c) || self.borders[r * across + c].is_some();
            if is_inside(r, c) && around.into_iter().all(is_known) && self.borders[r * across + c].is_some() {
                // An empty border: the tile is known.
                self.borders[r * across + c] = Some(Box::new(Border::empty()));
            }
        }
    }

    /// Whether a tile has an edge.
    pub fn has_edge(&self, tile: usize) -> bool {
        self.has_edge[tile]
    }

    /// For each tile, whether a pixel of it is within `reach_px` rows and columns of a tile with an edge.
    pub fn in_reach(&self, reach_px: usize) -> Vec<bool> {
        let (across, down) = (self.grid.across(), self.grid.down());
        // Tiles k apart have pixels (k − 1)·64 + 1 px apart.
        let tiles = if reach_px == 0 { 0 } else { (reach_px - 1) / TILE_PX + 1 };
        let along = |from: &[bool], n: usize, lines: usize, step: usize, next: usize| {
            let mut to = vec![false; from.len()];
            for line in 0..lines {
                let at = |i: usize| line * next + i * step;
                let mut last: Option<usize> = None;
                for i in 0..n {
                    last = if from[at(i)] { Some(i) } else { last };
                    to[at(i)] |= last.is_some_and(|l| i - l <= tiles);
                }
                last = None;
                for i in (0..n).rev() {
                    last = if from[at(i)] { Some(i) } else { last };
                    to[at(i)] |= last.is_some_and(|l| l - i <= tiles);
                }
            }
            to
        };
        let rows = along(&self.has_edge, across, down, 1, across);
        along(&rows, down, across, across, 1)
    }
}

/// A side of a border, and the opposite one.
type Side = fn(&Border) -> (&[f32], &[f32]);

impl Border {
    fn empty() -> Self {
        Self { top: Vec::new(), bottom: Vec::new(), left: Vec::new(), right: Vec::new() }
    }
}

/// Whether neighbours are more than `gap` apart, or one of them is covered and the other not.
fn are_apart(a: &[f32], b: &[f32], gap: f64) -> bool {
    a.iter().zip(b).any(|(&a, &b)| is_apart(a, b, gap))
}

/// Whether two neighbours are more than `gap` apart; NaN: not covered.
#[inline]
pub(super) fn is_apart(a: f32, b: f32, gap: f64) -> bool {
    (a.is_nan() != b.is_nan()) | ((f64::from(a) - f64::from(b)).abs() > gap)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(v: f32) -> Border {
        Border { top: vec![v; 64], bottom: vec![v; 64], left: vec![v; 64], right: vec![v; 64] }
    }

    fn map(order: impl Iterator<Item = usize>, values: &[f32; 12]) -> Vec<bool> {
        let mut map = EdgeMap::new(TileGrid { height_px: 192, width_px: 256 }, 0.1);
        order.for_each(|t| map.add(t, false, flat(values[t])));
        assert!(map.borders.iter().all(|b| b.as_ref().unwrap().top.is_empty()), "all are freed");
        (0..12).map(|t| map.has_edge(t)).collect()
    }

    #[test]
    fn edges_between_tiles_belong_to_both_in_any_order() {
        let mut values = [1.0; 12];
        values[6] = 1.2;
        values[0] = f32::NAN;
        let expected: Vec<bool> = (0..12).map(|t| [0, 1, 4, 2, 5, 6, 7, 10].contains(&t)).collect();
        assert_eq!(map(0..12, &values), expected);
        assert_eq!(map((0..12).rev(), &values), expected);
        assert_eq!(map((0..12).map(|t| t * 5 % 12), &values), expected);
        assert_eq!(map(0..12, &[f32::NAN; 12]), [false; 12]);
    }

    #[test]
    fn reach_is_that_of_pixels() {
        let mut map = EdgeMap::new(TileGrid { height_px: 640, width_px: 640 }, 0.1);
        map.has_edge[45] = true;
        for (reach, tiles) in [(0, 0), (1, 1), (64, 1), (65, 2), (200, 4), (5000, 9)] {
            let found = map.in_reach(reach);
            for (t, &is_found) in found.iter().enumerate() {
                let apart = (t / 10).abs_diff(4).max((t % 10).abs_diff(5));
                assert_eq!(is_found, apart <= tiles, "{reach} {t}");
            }
        }
    }
}
