//! Adds the contributions of tiles to the shards they reach ([`OverlapAdd`]), and recycles their buffers.

use super::computed_tile::{ComputedTile, TileId, TileOutput};
use super::overlap_add::{FinishedShard, OverlapAdd};
use super::work::BandWork;
use crate::buffer::{ShardPixels, TileBuffer};
use crate::clock::{Clock, Phase};
use crate::geometry::Size;
use crate::tiling::{FilmRegion, ShardId, shards_reached};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// Adds contributions in order; see the module.
pub(super) struct OrderedAdder<'a> {
    film: Size,
    bands: &'a [BandWork],
    clock: &'a Clock,
    overlap: OverlapAdd<'a>,
    free: Mutex<Vec<TileBuffer>>,
    tiles: AtomicU64,
    pixels: AtomicU64,
}

impl<'a> OrderedAdder<'a> {
    /// For the regions `regions` of a film of `film` px.
    pub(super) fn new(
        film: Size,
        regions: &'a [FilmRegion],
        bands: &'a [BandWork],
        clock: &'a Clock,
    ) -> Self {
        let (tiles, pixels) = (AtomicU64::new(0), AtomicU64::new(0));
        Self { film, bands, clock, overlap: OverlapAdd::new(regions), free: Mutex::default(), tiles, pixels }
    }

    /// A buffer for a worker's next tile.
    pub(super) fn buffer(&self) -> TileBuffer {
        self.free.lock().expect("no panic while held").pop().unwrap_or_default()
    }

    /// A buffer for a strip of a shard.
    pub(super) fn strip(&self) -> Vec<f32> {
        self.overlap.strip()
    }

    /// Recycles the buffers of an encoded shard.
    pub(super) fn recycle(&self, pixels: ShardPixels) {
        self.overlap.recycle(pixels);
    }

    /// Number of tiles added so far, and of their film pixels.
    pub(super) fn added(&self) -> (u64, u64) {
        (self.tiles.load(Ordering::Relaxed), self.pixels.load(Ordering::Relaxed))
    }

    /// The shards to compute that the contribution of a tile of the band at `position` reaches.
    pub(super) fn shards(&self, position: usize, tile: (usize, usize)) -> Vec<ShardId> {
        let work = &self.bands[position];
        shards_reached(&work.tiling, self.overlap.regions, &work.shards, position, tile)
    }

    /// Submits a tile. `finished` receives the shards that no later tile reaches, `added` each tile that has been added, with its
    /// number of film pixels.
    pub(super) fn submit(
        &self,
        place: TileId,
        output: TileOutput,
        finished: &dyn Fn(FinishedShard),
        added: &dyn Fn(TileId, usize),
    ) {
        let tiling = &self.bands[place.position].tiling;
        let ids = self.shards(place.position, place.tile);
        let added = |computed| self.added_tile(computed, added);
        let computed = ComputedTile { place, output };
        self.clock.of(Phase::Add).time(|| match computed.output {
            TileOutput::Unreadable => {
                self.overlap.discard(&ids, &added);
                added(computed);
            }
            _ => self.overlap.submit(tiling, place.tile, &ids, computed, finished, &added),
        });
    }

    /// Counts a tile and recycles its buffer.
    fn added_tile(&self, computed: ComputedTile, added: &dyn Fn(TileId, usize)) {
        let ComputedTile { place, output } = computed;
        if let TileOutput::Cpu(buffer) = output {
            self.free.lock().expect("no panic while held").push(buffer);
        }
        let rect = self.bands[place.position].tiling.rect(place.tile);
        let pixels = rect.intersect(self.film.rect()).size().pixels();
        self.count(pixels);
        added(place, pixels);
    }

    /// Counts a tile of `pixels` film pixels as added.
    pub(super) fn count(&self, pixels: usize) {
        self.tiles.fetch_add(1, Ordering::Relaxed);
        self.pixels.fetch_add(pixels as u64, Ordering::Relaxed);
    }
}
