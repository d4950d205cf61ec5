//! Overlap-add: sums the contributions of tiles into shards and emits a shard once it is complete.
//!
//! ```text
//! film[y, x] = Σ_tiles contribution_tile[y, x]
//! ```
//! The contribution of a tile covers the tile and its tail, half a PSF window on every side, so contributions overlap. f32 addition is not
//! associative: each shard adds the tiles that reach it in their order in the tiling, whatever the order in which they are computed, so
//! the film has the same bits for any number of threads. The first tile that reaches a pixel sets it, so that shards need not be zeroed. Shards are independent of each other, so threads add to different shards at a
//! time: the thread that submits the next tile of a shard adds it and those that wait for it; the others only queue theirs.

use super::computed_tile::ComputedTile;
use crate::buffer::ShardPixels;
use crate::geometry::Rect;
use crate::tiling::{FilmRegion, ShardId, Tiling};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard};

/// A complete shard.
#[derive(Debug)]
pub(super) struct FinishedShard {
    /// Its identity.
    pub(super) id: ShardId,
    /// Its film rectangle.
    pub(super) rect: Rect,
    /// Its pixels, of `rect`.
    pub(super) pixels: ShardPixels,
}

/// The shards under accumulation.
pub(super) struct OverlapAdd<'a> {
    pub(super) regions: &'a [FilmRegion],
    shards: Mutex<Shards>,
    /// Strips of shards that have been encoded.
    spare: Mutex<Vec<Vec<f32>>>,
}

struct Shards {
    open: BTreeMap<ShardId, Arc<OpenShard>>,
    discarded: BTreeSet<ShardId>,
}

/// A shard that tiles are still to be added to.
struct OpenShard {
    rect: Rect,
    sum: Mutex<Sum>,
}

/// Where a contribution lies on the film.
#[derive(Clone, Copy)]
struct Place {
    reach: Rect,
    /// Row and column from which on (both) no earlier tile reaches its pixels.
    first: (i64, i64),
}

impl Place {
    fn new(tiling: &Tiling, (i, j): (usize, usize)) -> Self {
        let above = i.checked_sub(1).map_or(i64::MIN, |i| tiling.reach((i, j)).bottom());
        let left = j.checked_sub(1).map_or(i64::MIN, |j| tiling.reach((i, j)).right());
        Self { reach: tiling.reach((i, j)), first: (above, left) }
    }
}

struct Sum {
    /// Number of tiles added, or being added.
    begun: usize,
    /// Contributions that wait for earlier ones, by position among the shard's tiles.
    waiting: BTreeMap<usize, (Place, Arc<ComputedTile>)>,
    /// Absent while a thread adds.
    pixels: Option<ShardPixels>,
    discarded: bool,
}

impl<'a> OverlapAdd<'a> {
    /// For `regions`.
    pub(super) fn new(regions: &'a [FilmRegion]) -> Self {
        let shards = Shards { open: BTreeMap::new(), discarded: BTreeSet::new() };
        Self { regions, shards: Mutex::new(shards), spare: Mutex::default() }
    }

    /// Submits the contribution of `tile` of `tiling` to the shards `ids`, which are those it reaches: adds it where it is the next, and
    /// what waits for it. `finished` receives complete shards; `added` each contribution that has been added to all of its shards, after
    /// the shards that it completes.
    pub(super) fn submit(
        &self,
        tiling: &Tiling,
        tile: (usize, usize),
        ids: &[ShardId],
        contribution: ComputedTile,
        finished: &dyn Fn(FinishedShard),
        added: &dyn Fn(ComputedTile),
    ) {
        let (place, contribution) = (Place::new(tiling, tile), Arc::new(contribution));
        for id in ids {
            let rect = self.regions[id.region].shard_rect(id.row, id.col);
            let Some(shard) = self.open(*id, rect) else { continue };
            let ((i0, i1), (j0, j1)) = tiling.tiles_reaching(rect);
            let mut sum = lock(&shard.sum);
            if !sum.discarded {
                let position = (tile.0 - i0) * (j1 - j0) + tile.1 - j0;
                sum.waiting.insert(position, (place, Arc::clone(&contribution)));
            }
            drop(sum);
            self.add_waiting(*id, &shard, (i1 - i0) * (j1 - j0), finished, added);
        }
        release(contribution, added);
    }

    /// Adds the contributions to `shard`, reached by `tiles` tiles, that wait for no earlier one, unless another thread does.
    fn add_waiting(
        &self,
        id: ShardId,
        shard: &OpenShard,
        tiles: usize,
        finished: &dyn Fn(FinishedShard),
        added: &dyn Fn(ComputedTile),
    ) {
        let mut sum = lock(&shard.sum);
        let Some(mut pixels) = sum.pixels.take() else { return };
        loop {
            let next = sum.begun;
            let Some((place, contribution)) = sum.waiting.remove(&next) else { break };
            sum.begun += 1;
            drop(sum);
            let rows = (place.reach.bottom() - shard.rect.y).max(0) as usize;
            pixels.reach(rows, || self.strip());
            add_rows(&mut pixels, shard.rect, &contribution, place);
            if next + 1 == tiles {
                lock(&self.shards).open.remove(&id);
                finished(FinishedShard { id, rect: shard.rect, pixels });
                return release(contribution, added);
            }
            release(contribution, added);
            sum = lock(&shard.sum);
        }
        match sum.discarded {
            true => self.recycle(pixels),
            false => sum.pixels = Some(pixels),
        }
    }

    /// The open shard `id` on the film rectangle `rect`, opened if necessary; `None` if it was discarded.
    fn open(&self, id: ShardId, rect: Rect) -> Option<Arc<OpenShard>> {
        let mut shards = lock(&self.shards);
        if shards.discarded.contains(&id) {
            return None;
        }
        let open = shards.open.entry(id).or_insert_with(|| {
            let sum = Sum {
                begun: 0,
                waiting: BTreeMap::new(),
                pixels: Some(ShardPixels::new(rect.size())),
                discarded: false,
            };
            Arc::new(OpenShard { rect, sum: Mutex::new(sum) })
        });
        Some(Arc::clone(open))
    }

    /// Discards the shards `ids`: a tile that reaches them could not be computed. `added` receives the contributions that only they
    /// waited for.
    pub(super) fn discard(&self, ids: &[ShardId], added: &dyn Fn(ComputedTile)) {
        for id in ids {
            let open = {
                let mut shards = lock(&self.shards);
                shards.discarded.insert(*id);
                shards.open.remove(id)
            };
            let Some(shard) = open else { continue };
            let (waiting, pixels) = {
                let mut sum = lock(&shard.sum);
                sum.discarded = true;
                (std::mem::take(&mut sum.waiting), sum.pixels.take())
            };
            pixels.into_iter().for_each(|pixels| self.recycle(pixels));
            waiting.into_values().for_each(|(_, contribution)| release(contribution, added));
        }
    }

    /// A buffer for a strip of a shard.
    pub(super) fn strip(&self) -> Vec<f32> {
        lock(&self.spare).pop().unwrap_or_default()
    }

    /// Returns the buffers of a shard for reuse.
    pub(super) fn recycle(&self, pixels: ShardPixels) {
        lock(&self.spare).extend(pixels.into_strips());
    }
}

fn lock<V>(mutex: &Mutex<V>) -> MutexGuard<'_, V> {
    mutex.lock().expect("no panic while held")
}

/// Passes a contribution to `added` if no shard waits for it any longer.
fn release(contribution: Arc<ComputedTile>, added: &dyn Fn(ComputedTile)) {
    Arc::into_inner(contribution).into_iter().for_each(added);
}

/// Adds the part of a contribution at `place` that lies within `rect` to `pixels`, of `rect`.
fn add_rows(pixels: &mut ShardPixels, rect: Rect, contribution: &ComputedTile, place: Place) {
    let (values, stride) = contribution.pixels();
    let Place { reach, first } = place;
    let common = rect.intersect(reach);
    for y in common.y..common.bottom() {
        let from = (y - reach.y) as usize * stride + (common.x - reach.x) as usize;
        let from = &values[from..][..common.width];
        let to = &mut pixels.row_mut((y - rect.y) as usize)[(common.x - rect.x) as usize..][..common.width];
        let added = if y < first.0 { common.width } else { (first.1.max(common.x) - common.x) as usize };
        let (from_added, from_set) = from.split_at(added.min(common.width));
        let (to_added, to_set) = to.split_at_mut(from_added.len());
        to_added.iter_mut().zip(from_added).for_each(|(t, f)| *t += f);
        // As if added to 0, so that -0 becomes 0.
        to_set.iter_mut().zip(from_set).for_each(|(t, f)| *t = 0.0 + f);
    }
}
