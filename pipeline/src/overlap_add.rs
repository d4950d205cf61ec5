//! Stage 4, overlap-add: sums the contributions of tiles into shards and emits a shard once it is complete.
//!
//!     film[y, x] = Σ_tiles contribution_tile[y, x]
//! The contribution of a tile covers the tile and its tail, half a PSF window on every side, so contributions overlap. f32 addition is not
//! associative: the caller adds tiles in the order of their sequence numbers, whatever the order in which they are computed, so the
//! film has the same bits for any number of threads. A shard is complete when all tiles that reach it have been added.

use crate::geometry::Rect;
use crate::plan::{FilmRegion, ShardId, Tiling};
use std::collections::{BTreeMap, BTreeSet};

/// The shards under accumulation.
#[derive(Debug)]
pub struct OverlapAdd {
    regions: Vec<FilmRegion>,
    partial: BTreeMap<ShardId, PartialShard>,
    discarded: BTreeSet<ShardId>,
    pool: Vec<Vec<f32>>,
}

#[derive(Debug)]
struct PartialShard {
    rect: Rect,
    pixels: Vec<f32>,
    tiles_left: usize,
}

/// A complete shard.
#[derive(Debug)]
pub struct FinishedShard {
    /// Its identity.
    pub id: ShardId,
    /// Its film rectangle.
    pub rect: Rect,
    /// Its pixels, row-major, of `rect`.
    pub pixels: Vec<f32>,
}

/// The tiles of one band that contribute to any of `shards`, in order.
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

impl OverlapAdd {
    /// For `regions`.
    pub fn new(regions: &[FilmRegion]) -> Self {
        Self {
            regions: regions.to_vec(),
            partial: BTreeMap::new(),
            discarded: BTreeSet::new(),
            pool: Vec::new(),
        }
    }

    /// Adds the contribution of a tile of `band` on the film rectangle `reach`, rows `stride` apart, to those of the shards
    /// `requested` that it reaches. Returns the shards that are now complete.
    pub fn add(
        &mut self,
        band: usize,
        tiling: &Tiling,
        requested: &BTreeSet<ShardId>,
        reach: Rect,
        contribution: &[f32],
        stride: usize,
    ) -> Vec<FinishedShard> {
        let mut finished = Vec::new();
        for (region_index, region) in self.regions.iter().enumerate() {
            for (row, col) in region.touched(reach) {
                let id = ShardId { band, region: region_index, row, col };
                if !requested.contains(&id) || self.discarded.contains(&id) {
                    continue;
                }
                let shard = self.partial.entry(id).or_insert_with(|| {
                    let rect = region.shard_rect(row, col);
                    let ((i0, i1), (j0, j1)) = tiling.tiles_reaching(rect);
                    let mut pixels = self.pool.pop().unwrap_or_default();
                    pixels.clear();
                    pixels.resize(rect.size().pixels(), 0.0);
                    PartialShard { rect, pixels, tiles_left: (i1 - i0) * (j1 - j0) }
                });
                let common = shard.rect.intersect(reach);
                for y in common.y..common.bottom() {
                    let to =
                        (y - shard.rect.y) as usize * shard.rect.width + (common.x - shard.rect.x) as usize;
                    let from = (y - reach.y) as usize * stride + (common.x - reach.x) as usize;
                    let to = &mut shard.pixels[to..][..common.width];
                    to.iter_mut().zip(&contribution[from..][..common.width]).for_each(|(t, f)| *t += f);
                }
                shard.tiles_left -= 1;
                if shard.tiles_left == 0 {
                    let PartialShard { rect, pixels, .. } = self.partial.remove(&id).expect("inserted above");
                    finished.push(FinishedShard { id, rect, pixels });
                }
            }
        }
        finished
    }

    /// Discards `shards`: a tile that reaches them could not be computed.
    pub fn discard(&mut self, shards: &[ShardId]) {
        for id in shards {
            self.discarded.insert(*id);
            self.pool.extend(self.partial.remove(id).map(|shard| shard.pixels));
        }
    }

    /// Returns the buffer of a shard for reuse.
    pub fn recycle(&mut self, pixels: Vec<f32>) {
        self.pool.push(pixels);
    }
}
