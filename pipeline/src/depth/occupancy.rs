//! Which vergences occur where in a chart: a set of bins per block of 64 × 64 chart pixels.
//!
//! From it follow, before any pixel is computed, the depth nodes whose PSFs a scene needs and the number of slabs in reach of a tile. A bin that
//! reaches into a slab counts for it, so both are upper bounds. The bins cover the vergences found so far: a vergence beyond them doubles their
//! width, so that one pass over a scene is enough.

use super::slabs::Slabs;
use crate::geometry::{Rect, Size};
use std::ops::Range;

/// Side of a block, chart px.
const BLOCK_PX: usize = 64;
/// Words of 64 bins.
const WORDS: usize = 16;
/// Bins of a block.
const BINS: usize = 64 * WORDS;
/// Width of the first range of bins, 1/m.
const FIRST_WIDTH: f64 = 1e-3;

/// A set of bins of vergence.
pub type Bins = [u64; WORDS];

/// Occupied bins per block.
#[derive(Clone, Debug, PartialEq)]
pub struct Occupancy {
    size: Size,
    columns: usize,
    /// Vergences at the ends of the bins, 1/m; `None`: nothing was added.
    range: Option<(f64, f64)>,
    /// Bins per unit of vergence.
    bins_per_dioptre: f64,
    blocks: Vec<Bins>,
}

impl Occupancy {
    /// Nothing, for a chart of `size`.
    pub fn new(size: Size) -> Self {
        let (rows, columns) = (size.height.div_ceil(BLOCK_PX), size.width.div_ceil(BLOCK_PX));
        let blocks = vec![[0; WORDS]; rows * columns];
        Self { size, columns, range: None, bins_per_dioptre: 0.0, blocks }
    }

    /// Adds vergence `v` at a chart pixel.
    pub fn add(&mut self, row: usize, column: usize, v: f64) {
        let first = match self.range {
            Some((first, last)) if first <= v && v <= last => first,
            _ => self.widened(v),
        };
        let bin = ((v - first) * self.bins_per_dioptre) as usize;
        let bin = bin.min(BINS - 1);
        self.blocks[row / BLOCK_PX * self.columns + column / BLOCK_PX][bin / 64] |= 1 << (bin % 64);
    }

    /// Widens the bins until `v` lies in them; where they begin.
    fn widened(&mut self, v: f64) -> f64 {
        let (mut first, mut last) = self.range.unwrap_or((v, v + FIRST_WIDTH));
        while !(first..=last).contains(&v) {
            let width = last - first;
            let below = v < first;
            if below {
                first -= width
            } else {
                last += width
            }
            for bins in self.blocks.iter_mut().filter(|bins| bins.iter().any(|word| *word != 0)) {
                let old = std::mem::take(bins);
                for bin in occupied(&old) {
                    let bin = bin / 2 + if below { BINS / 2 } else { 0 };
                    bins[bin / 64] |= 1 << (bin % 64);
                }
            }
        }
        (self.range, self.bins_per_dioptre) = (Some((first, last)), BINS as f64 / (last - first));
        first
    }

    /// The bins that occur in the chart pixels `rect` and within a block of them; all, for a chart that is repeated beyond its edge.
    pub fn within(&self, rect: Rect) -> Bins {
        let (rows, cols) = self.blocks_of(rect);
        self.union(rows, cols)
    }

    /// The bins that occur in the chart pixels `rect`, or in those nearest to it.
    pub fn inside(&self, rect: Rect) -> Bins {
        let blocks = |first: i64, length: usize, n: usize| {
            let at = |i: i64| (i.clamp(0, n as i64 - 1)) as usize / BLOCK_PX;
            at(first)..at(first + length as i64 - 1) + 1
        };
        self.union(blocks(rect.y, rect.height, self.size.height), blocks(rect.x, rect.width, self.size.width))
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
        // Beyond the chart its edge, or its mirror image, continues: what lies within the same distance of the edge.
        let inside = |first: i64, end: i64, n: usize| {
            let n = n as i64;
            let (before, after) = ((-first).clamp(0, n), (end - n).clamp(0, n));
            first.clamp(0, n - after)..end.clamp(before, n)
        };
        let rows = inside(rect.y, rect.bottom(), self.size.height);
        let cols = inside(rect.x, rect.right(), self.size.width);
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
        let mut is_occupied = vec![false; slabs.count()];
        let Some((first, last)) = self.range else { return is_occupied };
        let width = (last - first) / BINS as f64;
        for bin in occupied(bins) {
            // Rounding may put a vergence at the end of a bin into the next slab.
            let end = |edge: f64| slabs.of(first + edge * width);
            is_occupied[end(bin as f64 - 1e-6)..=end(bin as f64 + 1.0 + 1e-6)].fill(true);
        }
        is_occupied
    }
}

/// The bins of a set.
fn occupied(bins: &Bins) -> impl Iterator<Item = usize> + '_ {
    let of_word = |(i, word): (usize, &u64)| {
        let rest = |word: u64| Some(word).filter(|word| *word != 0);
        let words = std::iter::successors(rest(*word), move |word| rest(word & (word - 1)));
        words.map(move |word| 64 * i + word.trailing_zeros() as usize)
    };
    bins.iter().enumerate().flat_map(of_word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slabs_of_a_rectangle_are_those_of_its_surroundings() {
        let mut occupancy = Occupancy::new(Size::new(640, 1280));
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
        assert_eq!(of(Rect::new(-5, 200, 100, 100)), [false, true, false, false, false]);
        assert_eq!(of(Rect::new(200, 1270, 10, 100)), [false, false, false, false, true]);
        assert_eq!(of(Rect::new(200, 1270, 10, 600)), [false, true, false, false, true], "a mirror image");
        assert_eq!(of(Rect::new(-900, -700, 2000, 10)), [false, true, false, false, true]);
        let inside = |rect| occupancy.slabs(&occupancy.inside(rect), &slabs);
        for rect in [Rect::new(200, 1270, 10, 100), Rect::new(-50, 1300, 10, 9), Rect::new(0, 640, 1, 1)] {
            assert_eq!(inside(rect), [false, false, false, false, true]);
        }
        assert_eq!(inside(Rect::new(200, 630, 1, 11)), [false, true, false, false, true]);
    }

    #[test]
    fn one_vergence_occupies_its_slab() {
        let mut occupancy = Occupancy::new(Size::new(10, 10));
        occupancy.add(3, 3, 0.5);
        let slabs = Slabs::new(&[0.5], 0.5, 10.0);
        assert_eq!(occupancy.slabs(&occupancy.within(Rect::new(0, 0, 10, 10)), &slabs), [true]);
    }

    #[test]
    fn bins_widen_to_either_side_and_keep_what_they_hold() {
        let mut occupancy = Occupancy::new(Size::new(64, 320));
        for (block, v) in [1.0, 1.0004, 7.3, 0.0, 0.9].into_iter().enumerate() {
            occupancy.add(0, 64 * block, v);
        }
        let nodes = [0.0, 0.4, 0.95, 1.2, 7.0, 8.0];
        let slabs = Slabs::new(&nodes, 0.5, 10.0);
        let found: Vec<Vec<usize>> = occupancy
            .blocks
            .iter()
            .map(|bins| {
                let is_occupied = occupancy.slabs(bins, &slabs);
                (0..slabs.count()).filter(|s| is_occupied[*s]).collect()
            })
            .collect();
        assert_eq!(found, [[2], [2], [4], [0], [1]]);
        // Less than four times the range of the vergences, and at most 1024 bins.
        let (first, last) = occupancy.range.unwrap();
        assert!(first <= 0.0 && last >= 7.3 && last - first < 4.0 * 7.3, "{first} {last}");
    }
}
