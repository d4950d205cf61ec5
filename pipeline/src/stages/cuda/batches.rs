//! Division of the tiles of a band into batches, and the film rows that a batch reaches and finishes, without a device.

use crate::tiling::Tiling;
use std::ops::Range;

/// A rectangle of tiles.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TileRange {
    /// Tile rows.
    pub rows: Range<usize>,
    /// Tile columns.
    pub columns: Range<usize>,
}

impl TileRange {
    /// Its tiles, row by row.
    pub fn tiles(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.rows.clone().flat_map(|i| self.columns.clone().map(move |j| (i, j)))
    }

    /// Number of tiles.
    pub fn len(&self) -> usize {
        self.rows.len() * self.columns.len()
    }

    /// Whether there are no tiles.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The tiles of a batch and what they do to the film rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AddedTiles {
    /// The tiles.
    pub range: TileRange,
    /// Film rows that they reach and that are wanted.
    pub reached: Range<i64>,
    /// Film rows that are complete after them, and not after earlier ones.
    pub finished: Range<i64>,
    /// Whether the rows before these are all downloaded, so that these need not follow them.
    pub begins: bool,
}

/// The batches of `tiles`, row by row, which reach the film rows `wanted`: each a rectangle of at most `max_tiles` tiles and `max_rows` rows.
///
/// A batch has several rows only where these are complete and equal; a long row is divided into equal parts. Film rows are finished once all
/// tiles that reach them are added.
pub fn batches(
    tiling: &Tiling,
    tiles: &[(usize, usize)],
    wanted: &Range<i64>,
    max_tiles: usize,
    max_rows: usize,
) -> Vec<AddedTiles> {
    // Consecutive tiles of a row.
    let mut runs: Vec<TileRange> = Vec::new();
    for &(i, j) in tiles {
        match runs.last_mut() {
            Some(run) if run.rows.start == i && run.columns.end == j => run.columns.end += 1,
            _ => runs.push(TileRange { rows: i..i + 1, columns: j..j + 1 }),
        }
    }
    let only_run = |at: usize| {
        let other = |k: Option<usize>| k.and_then(|k| runs.get(k)).is_some_and(|r| r.rows == runs[at].rows);
        !other(at.checked_sub(1)) && !other(Some(at + 1))
    };
    let (mut ranges, mut at): (Vec<TileRange>, usize) = (Vec::new(), 0);
    while at < runs.len() {
        let run = &runs[at];
        let (length, mut count) = (run.columns.len(), 1);
        while only_run(at)
            && count < max_rows
            && (count + 1) * length <= max_tiles
            && runs.get(at + count).is_some_and(|next| {
                next.rows.start == run.rows.start + count
                    && next.columns == run.columns
                    && only_run(at + count)
            })
        {
            count += 1;
        }
        let rows = run.rows.start..run.rows.start + count;
        let part = length.div_ceil(length.div_ceil(max_tiles.max(1)));
        ranges.extend(run.columns.clone().step_by(part).map(|start| TileRange {
            rows: rows.clone(),
            columns: start..(start + part).min(run.columns.end),
        }));
        at += count;
    }
    let reach = |rows: &Range<usize>| {
        let (tile, tail) = (tiling.tile() as i64, 2 * tiling.margin() as i64);
        (rows.start as i64 * tile - tail).max(wanted.start)..(rows.end as i64 * tile).min(wanted.end)
    };
    let mut end = i64::MIN;
    let mut all: Vec<AddedTiles> = Vec::new();
    for (k, range) in ranges.iter().enumerate() {
        let reached = reach(&range.rows);
        let begins = reached.start >= end;
        let start = if begins { reached.start } else { all.last().map_or(0, |b| b.finished.end) };
        let finished_end = match ranges.get(k + 1) {
            Some(next) if next.rows == range.rows => start,
            Some(next) => reach(&next.rows).start.clamp(start, reached.end.max(start)),
            None => reached.end.max(start),
        };
        end = reached.end;
        all.push(AddedTiles { range: range.clone(), reached, finished: start..finished_end, begins });
    }
    all
}

/// Rows of the ring by a count that never wraps: row `v` is at `v % capacity`.
#[derive(Clone, Debug, Default)]
pub(super) struct Window {
    pub(super) capacity: usize,
    /// Film row `first_film` is row `first`.
    first_film: i64,
    first: u64,
    /// End of the rows that were reached.
    end: u64,
}

impl Window {
    /// No rows yet.
    pub(super) fn new(capacity: usize) -> Self {
        Self { capacity, ..Self::default() }
    }

    /// Extends the rows to those of `tiles`; the new ones.
    pub(super) fn reach(&mut self, tiles: &AddedTiles) -> Range<u64> {
        if tiles.begins {
            (self.first_film, self.first) = (tiles.reached.start, self.end);
        }
        let new = self.end..self.row(tiles.reached.end).max(self.end);
        self.end = new.end;
        new
    }

    pub(super) fn row(&self, film_row: i64) -> u64 {
        self.first + (film_row - self.first_film) as u64
    }

    /// Place in the ring.
    pub(super) fn place(&self, row: u64) -> usize {
        (row % self.capacity as u64) as usize
    }

    /// The places of `rows`, in parts that are contiguous.
    pub(super) fn parts(&self, rows: Range<u64>) -> impl Iterator<Item = Range<usize>> + use<> {
        let (start, count) = (self.place(rows.start), (rows.end - rows.start) as usize);
        let before_wrap = count.min(self.capacity - start);
        [start..start + before_wrap, 0..count - before_wrap].into_iter().filter(|part| !part.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Rect, Size};
    use crate::psf::blocks::Blocks;
    use std::collections::BTreeSet;

    fn tiling(film: Size, window: usize, tile: usize) -> Tiling {
        Tiling::new(film, Some(&Blocks { window, fft: 64, block: tile, tile }))
    }

    /// Every tile is in one batch, in order for every pixel; every wanted row that a tile reaches is finished once, after its last tile, and
    /// fits in the ring.
    fn check(
        tiling: &Tiling,
        tiles: &[(usize, usize)],
        wanted: Range<i64>,
        max_tiles: usize,
        max_rows: usize,
    ) {
        let reaches = |reach: Rect| reach.y < wanted.end && reach.bottom() > wanted.start;
        let tiles: Vec<_> = tiles.iter().copied().filter(|&t| reaches(tiling.reach(t))).collect();
        let batches = batches(tiling, &tiles, &wanted, max_tiles, max_rows);
        let listed: BTreeSet<_> = batches.iter().flat_map(|b| b.range.tiles()).collect();
        assert!(
            listed.iter().eq(tiles.iter())
                && batches.iter().map(|b| b.range.len()).sum::<usize>() == tiles.len()
        );
        let mut finished = BTreeSet::new();
        let mut window = Window::new(max_rows * tiling.tile() + 2 * tiling.margin());
        let mut last = (0, 0);
        for batch in &batches {
            assert!(batch.range.len() <= max_tiles && batch.range.rows.len() <= max_rows);
            assert!(batch.range.rows.start >= last.0 && batch.range.tiles().next() >= Some(last));
            last = batch.range.tiles().last().unwrap();
            window.reach(batch);
            assert!(batch.reached.clone().all(|y| !finished.contains(&y)), "{batch:?} adds to finished rows");
            for y in batch.finished.clone() {
                assert!(finished.insert(y), "row {y} twice");
                assert!(window.row(y) < window.end && window.row(y) + window.capacity as u64 >= window.end);
            }
        }
        let reached = tiles.iter().flat_map(|&t| {
            let reach = tiling.reach(t);
            reach.y.max(wanted.start)..reach.bottom().min(wanted.end)
        });
        assert!(finished == reached.collect());
    }

    #[test]
    fn batches_have_every_tile_and_finish_every_row_once() {
        for (film, window, tile) in [
            (Size::new(700, 333), 51, 142),
            (Size::new(90, 9), 7, 32),
            (Size::new(300, 300), 1, 64),
            (Size::new(500, 400), 201, 60),
        ] {
            let tiling = tiling(film, window, tile);
            let (rows, columns) = tiling.count();
            let all: Vec<_> = (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))).collect();
            let some: Vec<_> = all.iter().copied().filter(|(i, j)| i % 4 != 2 && (i + j) % 3 != 0).collect();
            for (max_tiles, max_rows) in [(1, 1), (2, 1), (columns, 1), (3 * columns, 2), (1000, 1000)] {
                check(&tiling, &all, 0..film.height as i64, max_tiles, max_rows);
                check(&tiling, &all, 20..60, max_tiles, max_rows);
                check(&tiling, &some, 0..film.height as i64, max_tiles, max_rows);
            }
        }
    }

    #[test]
    fn complete_rows_are_joined_and_long_rows_divided() {
        let tiling = tiling(Size::new(300, 300), 1, 100);
        let all: Vec<_> = (0..3).flat_map(|i| (0..3).map(move |j| (i, j))).collect();
        let ranges = |max_tiles| -> Vec<(Range<usize>, Range<usize>)> {
            let batches = batches(&tiling, &all, &(0..300), max_tiles, 9);
            batches.into_iter().map(|b| (b.range.rows, b.range.columns)).collect()
        };
        assert_eq!(ranges(100), [(0..3, 0..3)]);
        assert_eq!(ranges(7), [(0..2, 0..3), (2..3, 0..3)]);
        assert_eq!(ranges(2)[..2], [(0..1, 0..2), (0..1, 2..3)]);
    }
}
