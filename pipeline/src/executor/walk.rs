//! The order in which workers compute the tiles of a band, and what is in memory meanwhile.
//!
//! Tiles are computed shard by shard ([`tiles_by_shard`]), so that few shards are open at a time and the first is finished early; each
//! shard adds its tiles row by row ([`super::overlap_add`]). A tile that reaches two shards may therefore wait for tiles that come later
//! in the order. [`Walk`] follows one worker along the order and finds the largest distance from the tile being claimed to the oldest one
//! not yet added, and the largest number of tiles that wait. Several workers may exceed both by a constant: whatever they have claimed,
//! the tiles that one worker would have added by then can all be added, so a tile can always be claimed.

use crate::buffer::ShardPixels;
use crate::geometry::Rect;
use crate::tiling::{FilmRegion, ShardId, Tiling, shards_reached, tiles_by_shard};
use std::collections::{BTreeMap, BTreeSet};

/// Tiles of one band in the order of computation; see the module.
#[derive(Clone, Debug)]
pub struct Walk {
    /// Tiles (row, column).
    pub tiles: Vec<(usize, usize)>,
    /// Largest distance from the tile that one worker claims to the oldest tile not yet added.
    pub distance: usize,
    /// Largest number of computed tiles that are not yet added.
    pub waiting: usize,
    /// Pixels allocated for shards.
    allocations: Vec<Allocation>,
}

/// Rows of a shard that are allocated.
#[derive(Clone, Copy, Debug)]
struct Allocation {
    /// Index of the tile that reaches them.
    tile: usize,
    /// Index of the tile that finishes the shard.
    last: usize,
    pixels: usize,
}

struct OpenShard {
    rect: Rect,
    /// First tile row and column, and number of columns, of the tiles that reach it.
    first: (usize, usize),
    columns: usize,
    /// Number of tiles added.
    added: usize,
    /// Tiles that wait, by position among its tiles: index in the order.
    waiting: BTreeMap<usize, usize>,
    rows: usize,
    allocations: Vec<(usize, usize)>,
}

impl OpenShard {
    fn new(rect: Rect, tiling: &Tiling) -> Self {
        let ((i0, _), (j0, j1)) = tiling.tiles_reaching(rect);
        let (waiting, allocations) = (BTreeMap::new(), Vec::new());
        Self { rect, first: (i0, j0), columns: j1 - j0, added: 0, waiting, rows: 0, allocations }
    }

    /// Adds the tile at `index` of `tiles` and those that wait for it; returns their indices.
    fn add(&mut self, index: usize, tiles: &[(usize, usize)], tiling: &Tiling) -> Vec<usize> {
        let (i, j) = tiles[index];
        self.waiting.insert((i - self.first.0) * self.columns + j - self.first.1, index);
        let mut added = Vec::new();
        while let Some(tile) = self.waiting.remove(&self.added) {
            self.added += 1;
            let reached = (tiling.reach(tiles[tile]).bottom() - self.rect.y).max(0) as usize;
            let rows = ShardPixels::allocated_rows(self.rect.height, reached);
            if rows > self.rows {
                self.allocations.push((index, (rows - self.rows) * self.rect.width));
                self.rows = rows;
            }
            added.push(tile);
        }
        added
    }
}

impl Walk {
    /// The tiles that `shards` need.
    pub fn new(tiling: &Tiling, regions: &[FilmRegion], shards: &BTreeSet<ShardId>) -> Self {
        let tiles = tiles_by_shard(tiling, regions, shards);
        let mut open: BTreeMap<ShardId, OpenShard> = BTreeMap::new();
        let mut last: BTreeMap<ShardId, usize> = BTreeMap::new();
        // Of each tile, the number of shards that have not yet added it.
        let mut missing = vec![0; tiles.len()];
        let (mut oldest, mut added) = (0, 0);
        let (mut distance, mut waiting) = (0, 0);
        let position = shards.first().map_or(0, |id| id.position);
        for (index, &tile) in tiles.iter().enumerate() {
            distance = distance.max(index - oldest);
            waiting = waiting.max(index - added);
            let ids = shards_reached(tiling, regions, shards, position, tile);
            missing[index] = ids.len();
            for id in ids {
                let rect = regions[id.region].shard_rect(id.row, id.col);
                let shard = open.entry(id).or_insert_with(|| OpenShard::new(rect, tiling));
                last.insert(id, index);
                for tile in shard.add(index, &tiles, tiling) {
                    missing[tile] -= 1;
                    added += usize::from(missing[tile] == 0);
                }
            }
            while oldest <= index && missing[oldest] == 0 {
                oldest += 1;
            }
        }
        let allocations = open.iter().flat_map(|(id, shard)| {
            let last = last[id];
            shard.allocations.iter().map(move |&(tile, pixels)| Allocation { tile, last, pixels })
        });
        let allocations = allocations.collect();
        Self { tiles, distance, waiting, allocations }
    }

    /// The tiles of all shards of `regions`.
    pub fn of_all(tiling: &Tiling, regions: &[FilmRegion]) -> Self {
        let shards = regions.iter().enumerate().flat_map(|(region, area)| {
            let (rows, columns) = area.count();
            (0..rows)
                .flat_map(move |row| (0..columns).map(move |col| ShardId { position: 0, region, row, col }))
        });
        Self::new(tiling, regions, &shards.collect())
    }

    /// Pixels of open shards at a time at most, where workers claim tiles up to `ahead` beyond [`Walk::distance`].
    pub fn open_pixels(&self, ahead: usize) -> usize {
        // While `oldest` is the oldest tile not yet added: what the tiles before `oldest + distance + ahead` reach, of shards that are
        // finished by `oldest` or a later one.
        let mut change = vec![0isize; self.tiles.len() + 1];
        for a in &self.allocations {
            change[a.tile.saturating_sub(self.distance + ahead)] += a.pixels as isize;
            change[a.last + 1] -= a.pixels as isize;
        }
        let open = change.iter().scan(0, |open, change| {
            *open += change;
            Some(*open)
        });
        open.max().unwrap_or(0) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::buffer::STRIP_ROWS;
    use crate::geometry::Size;
    use crate::psf::blocks::Blocks;
    use crate::tiling::tiles_needed;

    fn tiling(film: Size, window: usize, tile: usize) -> Tiling {
        Tiling::new(film, Some(&Blocks { window, fft: 64, block: tile, tile }))
    }

    #[test]
    fn walk_has_every_tile_once_and_ends_without_a_waiting_tile() {
        for (film, window, tile, shard) in [
            (Size::new(700, 333), 51, 142, Size::new(128, 100)),
            (Size::new(5, 9), 7, 32, Size::new(2, 2)),
            (Size::new(900, 900), 1, 64, Size::new(256, 256)),
            (Size::new(900, 700), 101, 100, Size::new(450, 50)),
        ] {
            let tiling = tiling(film, window, tile);
            let regions = [FilmRegion { rect: film.rect(), shard }];
            let walk = Walk::of_all(&tiling, &regions);
            let (rows, columns) = tiling.count();
            let mut sorted = walk.tiles.clone();
            sorted.sort_unstable();
            let all: Vec<_> = (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))).collect();
            assert_eq!(sorted, all);
            assert!(walk.waiting <= walk.distance && walk.distance < walk.tiles.len());
            let allocated: usize = walk.allocations.iter().map(|a| a.pixels).sum();
            assert_eq!(allocated, film.pixels(), "every shard is allocated once");
            assert_eq!(walk.open_pixels(walk.tiles.len()), film.pixels());
        }
    }

    #[test]
    fn walk_holds_one_shard_and_the_begun_rows_of_its_neighbours() {
        let (film, shard) = (Size::new(8192, 8192), Size::new(2048, 2048));
        let tiling = tiling(film, 101, 500);
        let regions = [FilmRegion { rect: film.rect(), shard }];
        let walk = Walk::of_all(&tiling, &regions);
        // One shard and the one right of it; of each in the next row at most a tile with its tail.
        let begun = (500 + 2 * 100 + STRIP_ROWS) * film.width;
        assert!(walk.open_pixels(0) <= 3 * shard.pixels() + begun, "{}", walk.open_pixels(0));
        assert!(walk.waiting <= 12, "{}", walk.waiting);
    }

    #[test]
    fn walk_of_some_shards_has_the_tiles_that_they_need() {
        let film = Size::new(1000, 1000);
        let tiling = tiling(film, 31, 90);
        let regions = [FilmRegion { rect: film.rect(), shard: Size::new(300, 300) }];
        let shards = [(0, 3), (2, 1)].map(|(row, col)| ShardId { position: 4, region: 0, row, col });
        let shards = BTreeSet::from(shards);
        let mut walk = Walk::new(&tiling, &regions, &shards).tiles;
        walk.sort_unstable();
        assert_eq!(walk, tiles_needed(&tiling, &regions, &shards));
    }
}
