//! Adds contributions in the order of the sequence, independent of the order in which they are computed: f32 sums depend on their order,
//! so the film's bits are independent of threads, devices and timing.
//!
//! The thread that submits the next tile in order adds it and all that follow without a gap; other threads only queue theirs.

use super::tile_source::TileSource;
use super::work::{BandInFlight, BandWork};
use crate::buffer::TileBuffer;
use crate::clock::Clock;
use crate::cuda::pool::GpuTile;
use crate::geometry::Size;
use crate::overlap_add::{FinishedShard, OverlapAdd};
use crate::plan::{FilmRegion, ShardId};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// Contribution of a tile.
pub(super) enum TileOutput {
    /// Computed by a worker.
    Cpu(TileBuffer),
    /// Computed by a GPU.
    Gpu(GpuTile),
    /// The chart could not be read: the shards that the tile reaches are dropped.
    Unreadable,
}

/// A computed tile that waits for its predecessors.
struct Computed<B> {
    band: Arc<BandInFlight<B>>,
    tile: (usize, usize),
    output: TileOutput,
}

/// Adds contributions in order; see the module.
pub(super) struct OrderedAdder<'a, B> {
    film: Size,
    regions: &'a [FilmRegion],
    bands: &'a [BandWork],
    clock: &'a Clock,
    pending: Mutex<Pending<B>>,
    overlap: Mutex<OverlapAdd>,
    free: Mutex<Vec<TileBuffer>>,
}

struct Pending<B> {
    computed: BTreeMap<usize, Computed<B>>,
    next: usize,
    adding: bool,
    pixels: u64,
}

impl<'a, B> OrderedAdder<'a, B> {
    /// For the regions `regions` of a film of `film` px.
    pub(super) fn new(
        film: Size,
        regions: &'a [FilmRegion],
        bands: &'a [BandWork],
        clock: &'a Clock,
    ) -> Self {
        let pending = Pending { computed: BTreeMap::new(), next: 0, adding: false, pixels: 0 };
        let overlap = Mutex::new(OverlapAdd::new(regions));
        Self { film, regions, bands, clock, pending: Mutex::new(pending), overlap, free: Mutex::default() }
    }

    /// A buffer for a worker's next tile.
    pub(super) fn buffer(&self) -> TileBuffer {
        self.free.lock().expect("no panic while held").pop().unwrap_or_default()
    }

    /// Recycles the buffer of an encoded shard.
    pub(super) fn recycle(&self, pixels: Vec<f32>) {
        self.overlap.lock().expect("no panic while held").recycle(pixels);
    }

    /// Number of tiles added so far, and of their film pixels.
    pub(super) fn added(&self) -> (u64, u64) {
        let pending = self.pending.lock().expect("no panic while held");
        (pending.next as u64, pending.pixels)
    }

    /// The shards to compute that the contribution of `tile` reaches.
    pub(super) fn shards(&self, band: &BandInFlight<B>, tile: (usize, usize)) -> Vec<ShardId> {
        let work = &self.bands[band.position];
        let reach = work.tiling.reach(tile);
        let of = |(region, area): (usize, &FilmRegion)| {
            let id = move |(row, col)| ShardId { band: band.position, region, row, col };
            area.touched(reach).map(id).filter(|id| work.shards.contains(id)).collect::<Vec<_>>()
        };
        self.regions.iter().enumerate().flat_map(of).collect()
    }

    /// Submits a tile. If no other thread is adding, adds it and all that follow in order; `finished` receives the shards that no later
    /// tile reaches, `added` the position and film pixels of each tile, before `source` counts it as added.
    #[allow(clippy::too_many_arguments, reason = "a tile, and the receivers of its results")]
    pub(super) fn submit(
        &self,
        source: &TileSource<'_, B>,
        band: &Arc<BandInFlight<B>>,
        (sequence, tile): (usize, (usize, usize)),
        output: TileOutput,
        finished: &dyn Fn(Vec<FinishedShard>),
        added: &dyn Fn(usize, usize),
    ) {
        let mut pending = self.pending.lock().expect("no panic while held");
        pending.computed.insert(sequence, Computed { band: Arc::clone(band), tile, output });
        if pending.adding {
            return;
        }
        pending.adding = true;
        loop {
            let next = pending.next;
            let Some(Computed { band, tile, output }) = pending.computed.remove(&next) else { break };
            drop(pending);
            finished(self.clock.add.time(|| self.add(&band, tile, output)));
            let rect = self.bands[band.position].tiling.rect(tile);
            let pixels = rect.intersect(self.film.rect()).size().pixels();
            added(band.position, pixels);
            pending = self.pending.lock().expect("no panic while held");
            pending.next += 1;
            pending.pixels += pixels as u64;
            source.tile_added();
        }
        pending.adding = false;
    }

    fn add(&self, band: &BandInFlight<B>, tile: (usize, usize), output: TileOutput) -> Vec<FinishedShard> {
        let work = &self.bands[band.position];
        let mut overlap = self.overlap.lock().expect("no panic while held");
        let mut add = |data: &[f32], stride| {
            overlap.add(band.position, &work.tiling, &work.shards, work.tiling.reach(tile), data, stride)
        };
        match output {
            TileOutput::Cpu(buffer) => {
                let finished = add(&buffer.data, buffer.stride);
                self.free.lock().expect("no panic while held").push(buffer);
                finished
            }
            TileOutput::Gpu(tile) => add(tile.data(), tile.stride),
            TileOutput::Unreadable => {
                overlap.discard(&self.shards(band, tile));
                Vec::new()
            }
        }
    }
}
