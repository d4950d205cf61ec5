//! Stage 4: adds tiles with their tails into shards, in tile order, and lets a shard go once nothing can reach it.
//!
//! f32 addition does not commute with order, so tails are added in the order of the tiles' sequence numbers, whatever
//! order the workers finish in: the film has the same bits for any number of threads.

use crate::geometry::Rect;
use crate::plan::{ShardId, Tiling, Window};
use std::collections::{BTreeMap, BTreeSet};

/// The shards that tiles are being added to.
#[derive(Debug)]
pub struct OverlapAdd {
    windows: Vec<Window>,
    open: BTreeMap<ShardId, Open>,
    lost: BTreeSet<ShardId>,
    pool: Vec<Vec<f32>>,
}

#[derive(Debug)]
struct Open {
    rect: Rect,
    pixels: Vec<f32>,
    tiles_left: usize,
}

/// A shard that nothing can reach any more.
#[derive(Debug)]
pub struct Finished {
    /// Which one.
    pub id: ShardId,
    /// Its film rectangle.
    pub rect: Rect,
    /// Its pixels, row-major, of `rect`.
    pub pixels: Vec<f32>,
}

/// The tiles of one band that reach any of its wanted shards, in order.
pub fn tiles_needed(tiling: &Tiling, windows: &[Window], wanted: &BTreeSet<ShardId>) -> Vec<(usize, usize)> {
    let mut tiles = BTreeSet::new();
    for id in wanted {
        let ((i0, i1), (j0, j1)) = tiling.reaching(windows[id.window].shard_rect(id.row, id.col));
        tiles.extend((i0..i1).flat_map(|i| (j0..j1).map(move |j| (i, j))));
    }
    tiles.into_iter().collect()
}

impl OverlapAdd {
    /// For the outputs `windows`.
    pub fn new(windows: &[Window]) -> Self {
        Self { windows: windows.to_vec(), open: BTreeMap::new(), lost: BTreeSet::new(), pool: Vec::new() }
    }

    /// Adds a tile of `band` whose light on the film rectangle `reach` is `light`, rows `stride` apart; `wanted` are the shards
    /// to make of it.
    /// Returns the shards this tile was the last to reach.
    pub fn add(
        &mut self,
        band: usize,
        tiling: &Tiling,
        wanted: &BTreeSet<ShardId>,
        reach: Rect,
        light: &[f32],
        stride: usize,
    ) -> Vec<Finished> {
        let mut finished = Vec::new();
        for (index, window) in self.windows.iter().enumerate() {
            for (row, col) in window.touched(reach) {
                let id = ShardId { band, window: index, row, col };
                if !wanted.contains(&id) || self.lost.contains(&id) {
                    continue;
                }
                let open = self.open.entry(id).or_insert_with(|| {
                    let rect = window.shard_rect(row, col);
                    let ((i0, i1), (j0, j1)) = tiling.reaching(rect);
                    let mut pixels = self.pool.pop().unwrap_or_default();
                    pixels.clear();
                    pixels.resize(rect.size().pixels(), 0.0);
                    Open { rect, pixels, tiles_left: (i1 - i0) * (j1 - j0) }
                });
                let common = open.rect.intersect(reach);
                for y in common.y..common.bottom() {
                    let to = (y - open.rect.y) as usize * open.rect.width + (common.x - open.rect.x) as usize;
                    let from = (y - reach.y) as usize * stride + (common.x - reach.x) as usize;
                    let to = &mut open.pixels[to..][..common.width];
                    to.iter_mut().zip(&light[from..][..common.width]).for_each(|(t, f)| *t += f);
                }
                open.tiles_left -= 1;
                if open.tiles_left == 0 {
                    let Open { rect, pixels, .. } = self.open.remove(&id).expect("just there");
                    finished.push(Finished { id, rect, pixels });
                }
            }
        }
        finished
    }

    /// Gives up `shards`: a tile that reaches them has no light to add.
    pub fn lose(&mut self, shards: &[ShardId]) {
        for id in shards {
            self.lost.insert(*id);
            self.pool.extend(self.open.remove(id).map(|open| open.pixels));
        }
    }

    /// Takes a shard's buffer back for the next one.
    pub fn recycle(&mut self, pixels: Vec<f32>) {
        self.pool.push(pixels);
    }
}
