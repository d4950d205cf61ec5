//! Which vergences occur where in a chart: a set of bins per block of 64 × 64 chart pixels.
//!
//! From it follow, before any pixel is computed, the depth nodes whose PSFs a scene needs and the number of slabs in reach of a tile. A bin that
//! reaches into a slab counts for it, so both are upper bounds.

use super::slabs::Slabs;
use crate::geometry::{Rect, Size};
use std::ops::Range;

/// Side of a block, chart px.
const BLOCK_PX: usize = 64;
/// Words of 64 bins.
const WORDS: usize = 16;

/// A set of bins of vergence.
pub type Bins = [u64; WORDS];

/// Occupied bins per block.
#[derive(Clone, Debug, PartialEq)]
pub struct Occupancy {
    size: Size,
    columns: usize,
    /// Vergences of the first and the last bin, 1/m.
    range: (f64, f64),
    blocks: Vec<Bins>,
}

impl Occupancy {
    /// Nothing, for a chart of `size` and vergences of `range` (1/m); others count as its ends.
    pub fn new(size: Size, range: (f64, f64)) -> Self {
        let (rows, columns) = (size.height.div_ceil(BLOCK_PX), size.width.div_ceil(BLOCK_PX));
        Self { size, columns, range, blocks: vec![[0; WORDS]; rows * columns] }
    }

    fn bins_per_dioptre(&self) -> f64 {
        let (first, last) = self.range;
        if last > first { (64 * WORDS) as f64 / (last - first) } else { 0.0 }
    }

    /// Adds vergence `v` at a chart pixel.
    pub fn add(&mut self, row: usize, column: usize, v: f64) {
        let bin = ((v - self.range.0) * self.bins_per_dioptre()).max(0.0) as usize;
        let bin = bin.min(64 * WORDS - 1);
        self.blocks[row / BLOCK_PX * self.columns + column / BLOCK_PX][bin / 64] |= 1 << (bin % 64);
    }

    /// The bins that occur in the chart pixels `rect` and within a block of them; all, for a chart that is repeated beyond its edge.
    pub fn within(&self, rect: Rect) -> Bins {
        let (rows, cols) = self.blocks_of(rect);
        self.union(rows, cols)
    }

    /// Whether `test` is true for the bins of any block of the chart pixels `rect`, or within a block of them, and of the blocks around it.
    pub fn any_neighbourhood(&self, rect: Rect, mut test: impl FnMut(&Bins) -> bool) -> bool {
        let (rows, cols) = self.blocks_of(rect);
        let around = |i: usize, n: usize| i.saturating_sub(1)..(i + 2).min(n);
        let all_rows = self.blocks.len() / self.columns.max(1);
        let mut last = [0; WORDS];
        rows.into_iter().any(|row| {
            cols.clone().any(|col| {
                let bins = self.union(around(row, all_rows), around(col, self.columns));
                // Neighbouring blocks often have the same bins.
                let is_new = std::mem::replace(&mut last, bins) != bins;
                is_new && test(&bins)
            })
        })
    }

    /// Chart rows from the first to the last block under `rect`, or within a block of it, where each of `slabs` may have a surface, without those
    /// of `rect` beyond the chart.
    pub fn rows_of_slabs(&self, rect: Rect, slabs: &Slabs) -> Vec<usize> {
        let (rows, cols) = self.blocks_of(rect);
        let mut spans = vec![0..0; slabs.count()];
        for row in rows {
            let bins = self.union(row..row + 1, cols.clone());
            for (span, _) in std::iter::zip(&mut spans, self.slabs(&bins, slabs)).filter(|(_, is)| *is) {
                *span = if span.end == 0 { row..row + 1 } else { span.start..row + 1 };
            }
        }
        spans.into_iter().map(|span| span.len() * BLOCK_PX).collect()
    }

    /// Rows and columns of the blocks within a block of `rect`.
    fn blocks_of(&self, rect: Rect) -> (Range<usize>, Range<usize>) {
        let rect = rect.grown(BLOCK_PX);
        let (height, width) = (self.size.height as i64, self.size.width as i64);
        // Beyond the chart its edge, or its mirror image, continues.
        let rows = if rect.y < 0 || rect.bottom() > height { 0..height } else { rect.y..rect.bottom() };
        let cols = if rect.x < 0 || rect.right() > width { 0..width } else { rect.x..rect.right() };
        let blocks = |r: Range<i64>| r.start as usize / BLOCK_PX..(r.end as usize).div_ceil(BLOCK_PX);
        (blocks(rows), blocks(cols))
    }

    /// All bins of some blocks.
    fn union(&self, rows: Range<usize>, cols: Range<usize>) -> Bins {
        let mut all = [0; WORDS];
        for row in rows {
            for bins in &self.blocks[row * self.columns..][cols.clone()] {
                all.iter_mut().zip(bins).for_each(|(all, bins)| *all |= bins);
            }
        }
        all
    }

    /// Whether each of `slabs` may have a surface of `bins`.
    pub fn slabs(&self, bins: &Bins, slabs: &Slabs) -> Vec<bool> {
        let mut occupied = vec![false; slabs.count()];
        let per_dioptre = self.bins_per_dioptre();
        for bin in (0..64 * WORDS).filter(|bin| bins[bin / 64] >> (bin % 64) & 1 == 1) {
            // Rounding may put a vergence at the end of a bin into the next slab.
            let end =
                |edge: f64| if per_dioptre > 0.0 { self.range.0 + edge / per_dioptre } else { self.range.0 };
            let (first, last) = (slabs.of(end(bin as f64 - 1e-6)), slabs.of(end(bin as f64 + 1.0 + 1e-6)));
            let last = if bin + 1 == 64 * WORDS { slabs.count() - 1 } else { last };
            let first = if bin == 0 { 0 } else { first };
            occupied[first..=last.max(first)].fill(true);
        }
        occupied
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slabs_of_a_rectangle_are_those_of_its_surroundings() {
        let mut occupancy = Occupancy::new(Size::new(640, 1280), (0.0, 2.0));
        for row in 0..640 {
            for column in 0..1280 {
                occupancy.add(row, column, if column < 640 { 0.3 } else { 1.7 });
            }
        }
        let slabs = Slabs::new(&[0.0, 0.25, 0.5, 1.0, 1.5, 2.0], 0.5, 10.0);
        let of = |rect| occupancy.slabs(&occupancy.within(rect), &slabs);
        assert_eq!(of(Rect::new(200, 200, 100, 100)), [false, true, false, false, false]);
        assert_eq!(of(Rect::new(200, 900, 100, 100)), [false, false, false, false, true]);
        assert_eq!(of(Rect::new(200, 600, 100, 10)), [false, true, false, false, true]);
        assert_eq!(
            occupancy.rows_of_slabs(Rect::new(200, 600, 100, 10), &slabs),
            [0, 256, 0, 0, 256],
            "blocks 2 to 5"
        );
        let both = |bins: &Bins| occupancy.slabs(bins, &slabs) == [false, true, false, false, true];
        let near = |rect| occupancy.any_neighbourhood(rect, both);
        assert!(near(Rect::new(200, 520, 100, 10)) && !near(Rect::new(200, 500, 100, 10)));
        assert_eq!(
            of(Rect::new(-5, 200, 100, 100)),
            [false, true, false, false, false],
            "rows of its columns"
        );
        assert_eq!(of(Rect::new(200, 1270, 10, 100)), [false, true, false, false, true], "all columns");
    }

    #[test]
    fn one_vergence_occupies_its_slab() {
        let mut occupancy = Occupancy::new(Size::new(10, 10), (0.5, 0.5));
        occupancy.add(3, 3, 0.5);
        let slabs = Slabs::new(&[0.5], 0.5, 10.0);
        assert_eq!(occupancy.slabs(&occupancy.within(Rect::new(0, 0, 10, 10)), &slabs), [true]);
    }
}
