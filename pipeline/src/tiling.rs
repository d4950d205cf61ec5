//! Partition of each band into tiles and of the film into shards, and which tiles contribute to which shard.
//!
//! The remapped image of a band is the film grown by half its PSF window on every side (the margin). Tiles divide that rectangle row by
//! row from its first pixel; a tile contributes to its own rectangle grown by the margin. Outputs are regions of the film (the complete
//! film, or regions of interest), each divided into shards from its first pixel. Nothing here depends on memory, threads or timing.

use crate::geometry::{Rect, Size};
use crate::psf::blocks::Blocks;
use std::collections::BTreeSet;

/// Side of a tile of a band without PSF stage, px.
const TILE_WITHOUT_PSF_PX: usize = 512;

/// Tiles of one band, on the film and its margin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tiling {
    grown: Rect,
    margin: usize,
    tile: usize,
}

impl Tiling {
    /// Tiles for a film of `film` px; `blocks` is `None` for a band without PSF stage.
    pub fn new(film: Size, blocks: Option<&Blocks>) -> Self {
        let (margin, tile) = blocks.map_or((0, TILE_WITHOUT_PSF_PX), |b| (b.window / 2, b.tile));
        Self { grown: film.rect().grown(margin), margin, tile }
    }

    /// The film with its margin.
    pub fn grown(&self) -> Rect {
        self.grown
    }

    /// Half the PSF window, px.
    pub fn margin(&self) -> usize {
        self.margin
    }

    /// Tile side, px.
    pub fn tile(&self) -> usize {
        self.tile
    }

    /// Tile rows and columns.
    pub fn count(&self) -> (usize, usize) {
        (self.grown.height.div_ceil(self.tile), self.grown.width.div_ceil(self.tile))
    }

    /// Rectangle of tile (i, j) of the remapped image.
    pub fn rect(&self, (i, j): (usize, usize)) -> Rect {
        let (y, x) = (i * self.tile, j * self.tile);
        Rect::new(
            self.grown.y + y as i64,
            self.grown.x + x as i64,
            self.tile.min(self.grown.height - y),
            self.tile.min(self.grown.width - x),
        )
    }

    /// Rectangle that receives the contribution of tile (i, j).
    pub fn reach(&self, tile: (usize, usize)) -> Rect {
        self.rect(tile).grown(self.margin)
    }

    /// Tile rows and columns (first, end) that contribute to the film rectangle `part`.
    pub fn tiles_reaching(&self, part: Rect) -> ((usize, usize), (usize, usize)) {
        let (rows, cols) = self.count();
        let range = |first: i64, end: i64, count: usize| {
            // Tile i reaches [i·tile − 2·margin, (i + 1)·tile).
            let first = first.max(0) as usize / self.tile;
            let end = (end.max(0) as usize + 2 * self.margin).div_ceil(self.tile);
            (first.min(count), end.min(count))
        };
        (range(part.y, part.bottom(), rows), range(part.x, part.right(), cols))
    }
}

/// One output: a region of the film, divided into shards from its first pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FilmRegion {
    /// The region on the film.
    pub rect: Rect,
    /// Shard height and width, px.
    pub shard: Size,
}

/// A shard of one band of one output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ShardId {
    /// Position of its band in the job, which need not be its band in the chart, the film or the lens.
    pub position: usize,
    /// Index of the output region.
    pub region: usize,
    /// Shard row.
    pub row: usize,
    /// Shard column.
    pub col: usize,
}

impl FilmRegion {
    /// Shard rows and columns.
    pub fn count(&self) -> (usize, usize) {
        (self.rect.height.div_ceil(self.shard.height), self.rect.width.div_ceil(self.shard.width))
    }

    /// Film rectangle of shard (row, col), clipped to the region.
    pub fn shard_rect(&self, row: usize, col: usize) -> Rect {
        let (y, x) = (row * self.shard.height, col * self.shard.width);
        Rect::new(
            self.rect.y + y as i64,
            self.rect.x + x as i64,
            self.shard.height.min(self.rect.height - y),
            self.shard.width.min(self.rect.width - x),
        )
    }

    /// Shards (row, col) that intersect `part` of the film.
    pub fn touched(&self, part: Rect) -> impl Iterator<Item = (usize, usize)> + use<> {
        let common = self.rect.intersect(part);
        let range = |first: i64, count: usize, shard: usize| match count {
            0 => 0..0,
            _ => first as usize / shard..(first as usize + count).div_ceil(shard),
        };
        let rows = range(common.y - self.rect.y, common.height, self.shard.height);
        let cols = range(common.x - self.rect.x, common.width, self.shard.width);
        rows.flat_map(move |row| cols.clone().map(move |col| (row, col)))
    }
}

/// Film columns from the first to the last of `regions`.
pub fn film_columns(regions: &[FilmRegion]) -> std::ops::Range<i64> {
    let first = regions.iter().map(|w| w.rect.x).min().unwrap_or(0);
    first..regions.iter().map(|w| w.rect.right()).max().unwrap_or(first)
}

/// The tiles of one band that contribute to any of `shards`, row by row.
pub fn tiles_needed(
    tiling: &Tiling,
    regions: &[FilmRegion],
    shards: &BTreeSet<ShardId>,
) -> Vec<(usize, usize)> {
    let mut tiles = BTreeSet::new();
    for id in shards {
        let ((i0, i1), (j0, j1)) = tiling.tiles_reaching(regions[id.region].shard_rect(id.row, id.col));
        tiles.extend((i0..i1).flat_map(|i| (j0..j1).map(move |j| (i, j))));
    }
    tiles.into_iter().collect()
}

/// The shards among `requested`, of the band at `position`, that the contribution of `tile` reaches.
pub fn shards_reached(
    tiling: &Tiling,
    regions: &[FilmRegion],
    requested: &BTreeSet<ShardId>,
    position: usize,
    tile: (usize, usize),
) -> Vec<ShardId> {
    let reach = tiling.reach(tile);
    let ids = regions.iter().enumerate().flat_map(|(region, area)| {
        area.touched(reach).map(move |(row, col)| ShardId { position, region, row, col })
    });
    ids.filter(|id| requested.contains(id)).collect()
}

/// The tiles of [`tiles_needed`], in the order of the shards that they contribute to, each tile with the first of them: neighbouring
/// tiles read the same chart and use the same PSFs, and few shards are begun at a time.
pub fn tiles_by_shard(
    tiling: &Tiling,
    regions: &[FilmRegion],
    shards: &BTreeSet<ShardId>,
) -> Vec<(usize, usize)> {
    let (mut tiles, mut listed) = (Vec::new(), BTreeSet::new());
    for id in shards {
        let ((i0, i1), (j0, j1)) = tiling.tiles_reaching(regions[id.region].shard_rect(id.row, id.col));
        let reaching = (i0..i1).flat_map(|i| (j0..j1).map(move |j| (i, j)));
        tiles.extend(reaching.filter(|tile| listed.insert(*tile)));
    }
    tiles
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blocks(window: usize, tile: usize) -> Blocks {
        Blocks { window, fft: 64, block: tile, tile }
    }

    #[test]
    fn tiles_reaching_a_shard_are_those_that_intersect_it() {
        for (film, window, tile) in
            [(Size::new(700, 333), 51, 142), (Size::new(5, 9), 7, 32), (Size::new(300, 300), 1, 64)]
        {
            let tiling = Tiling::new(film, Some(&blocks(window, tile)));
            let out = FilmRegion { rect: film.rect(), shard: Size::new(128, 100) };
            let (rows, cols) = out.count();
            for (row, col) in (0..rows).flat_map(|r| (0..cols).map(move |c| (r, c))) {
                let part = out.shard_rect(row, col);
                let ((i0, i1), (j0, j1)) = tiling.tiles_reaching(part);
                let (ni, nj) = tiling.count();
                for (i, j) in (0..ni).flat_map(|i| (0..nj).map(move |j| (i, j))) {
                    let meets = !tiling.reach((i, j)).intersect(part).is_empty();
                    let listed = (i0..i1).contains(&i) && (j0..j1).contains(&j);
                    assert_eq!(meets, listed, "film {film}, tile {i},{j}, shard {row},{col}");
                    assert_eq!(meets, out.touched(tiling.reach((i, j))).any(|s| s == (row, col)));
                }
            }
        }
    }
}
