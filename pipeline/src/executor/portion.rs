//! A portion: rows of shards of a band that one GPU computes, and their pixels while film rows arrive.

use super::overlap_add::FinishedShard;
use super::tile_source::Batch;
use super::work::BandWork;
use crate::buffer::ShardPixels;
use crate::geometry::Rect;
use crate::tiling::{FilmRegion, ShardId, shards_reached, tiles_needed};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicI64, AtomicUsize, Ordering};

/// Rows of shards of a band.
pub(super) struct Portion<B> {
    /// Its rows, claimed from the band.
    pub(super) batch: Batch<B>,
    /// The tiles that reach it, row by row.
    pub(super) tiles: Vec<(usize, usize)>,
    /// Film rows from its first shard to its last.
    pub(super) film_rows: Range<i64>,
    shards: BTreeMap<ShardId, Shard>,
    rows: Vec<ShardRow>,
    /// End of the film rows that are downloaded.
    downloaded: AtomicI64,
    /// End of the film rows that will be computed.
    end: AtomicI64,
}

struct Shard {
    rect: Rect,
    /// Index of its row of shards in the portion.
    row: usize,
    /// Its pixels and the number of rows that are present; none once it is finished or discarded.
    pixels: Mutex<Option<(ShardPixels, usize)>>,
}

struct ShardRow {
    /// End of its film rows.
    bottom: i64,
    /// Shards that are neither finished nor discarded.
    left: AtomicUsize,
}

/// Receives the events of a portion.
pub(super) trait PortionEvents<B> {
    /// A buffer for a strip of a shard.
    fn strip(&self) -> Vec<f32>;
    /// A shard of a band with these stages is complete.
    fn finished(&self, stages: &B, shard: FinishedShard);
    /// All shards of a row are finished or discarded: its sequence number.
    fn row_done(&self, sequence: usize);
}

impl<B> Portion<B> {
    /// The rows of shards `batch` of `work`.
    pub(super) fn new(batch: Batch<B>, work: &BandWork, regions: &[FilmRegion]) -> Self {
        let (mut shards, mut rows) = (BTreeMap::new(), Vec::new());
        for (row, (_, item)) in batch.items().enumerate() {
            let ids = work.shards.iter().filter(|id| (id.region, id.row) == item);
            let (mut bottom, mut count) = (i64::MIN, 0);
            for id in ids {
                let rect = regions[id.region].shard_rect(id.row, id.col);
                bottom = bottom.max(rect.bottom());
                count += 1;
                let empty = Mutex::new(Some((ShardPixels::new(rect.size()), 0)));
                shards.insert(*id, Shard { rect, row, pixels: empty });
            }
            rows.push(ShardRow { bottom, left: AtomicUsize::new(count) });
        }
        let ids: BTreeSet<ShardId> = shards.keys().copied().collect();
        let rects = || shards.values().map(|shard: &Shard| shard.rect);
        let top = rects().map(|r| r.y).min().unwrap_or(0);
        Self {
            tiles: tiles_needed(&work.tiling, regions, &ids),
            film_rows: top..rects().map(|r| r.bottom()).max().unwrap_or(top),
            batch,
            shards,
            rows,
            downloaded: AtomicI64::new(i64::MIN),
            end: AtomicI64::new(i64::MAX),
        }
    }

    /// Discards the shards that `tile` reaches, whose chart cannot be read; returns them.
    pub(super) fn discard(
        &self,
        tile: (usize, usize),
        work: &BandWork,
        regions: &[FilmRegion],
        events: &dyn PortionEvents<B>,
    ) -> Vec<ShardId> {
        let position = self.batch.band.position;
        let mut ids = shards_reached(&work.tiling, regions, &work.shards, position, tile);
        ids.retain(|id| self.shards.contains_key(id));
        for id in &ids {
            let shard = &self.shards[id];
            if lock(&shard.pixels).take().is_some() {
                self.shard_done(shard.row, events);
            }
        }
        ids
    }

    /// Counts the film rows up to `end` as downloaded.
    pub(super) fn set_downloaded(&self, end: i64) {
        self.downloaded.fetch_max(end, Ordering::SeqCst);
    }

    /// Ends the portion at the film row `end`: the run was cancelled. The rows of shards beyond are done without any shard.
    pub(super) fn end_at(&self, end: i64, events: &dyn PortionEvents<B>) {
        self.end.store(end, Ordering::SeqCst);
        for (row, (sequence, _)) in self.rows.iter().zip(self.batch.items()) {
            if row.bottom > end {
                events.row_done(sequence);
            }
        }
    }

    /// The rows of shards that were neither downloaded nor given up, to be requeued.
    pub(super) fn missing(&self) -> Vec<Batch<B>> {
        let (downloaded, end) = (self.downloaded.load(Ordering::SeqCst), self.end.load(Ordering::SeqCst));
        let missing = |row: &ShardRow| {
            row.bottom > downloaded && row.bottom <= end && row.left.load(Ordering::SeqCst) > 0
        };
        let indices = self.rows.iter().enumerate().filter(|(_, row)| missing(row));
        indices.map(|(index, _)| self.batch.part(index, 1)).collect()
    }

    /// Copies `values` of the film rectangle `rect` to the shards.
    pub(super) fn place(&self, rect: Rect, values: &[f32], events: &dyn PortionEvents<B>) {
        for (id, shard) in &self.shards {
            let common = shard.rect.intersect(rect);
            if common.is_empty() {
                continue;
            }
            let mut guard = lock(&shard.pixels);
            let Some((pixels, present)) = guard.as_mut() else { continue };
            pixels.reach((common.bottom() - shard.rect.y) as usize, || events.strip());
            for y in common.y..common.bottom() {
                let from = (y - rect.y) as usize * rect.width + (common.x - rect.x) as usize;
                let to = &mut pixels.row_mut((y - shard.rect.y) as usize);
                to[(common.x - shard.rect.x) as usize..][..common.width]
                    .copy_from_slice(&values[from..][..common.width]);
            }
            *present += common.height;
            if *present < shard.rect.height {
                continue;
            }
            let finished = guard.take();
            drop(guard);
            if let Some((pixels, _)) = finished {
                let finished = FinishedShard { id: *id, rect: shard.rect, pixels };
                events.finished(&self.batch.band.stages, finished);
            }
            self.shard_done(shard.row, events);
        }
    }

    fn shard_done(&self, row: usize, events: &dyn PortionEvents<B>) {
        if self.rows[row].left.fetch_sub(1, Ordering::SeqCst) == 1 {
            events.row_done(self.batch.sequence + row);
        }
    }
}

fn lock<V>(mutex: &Mutex<V>) -> std::sync::MutexGuard<'_, V> {
    mutex.lock().expect("no panic while held")
}
