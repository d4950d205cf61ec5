//! State shared by all threads of a run: the parts of the scheduler, and the first error.

use super::Compute;
use super::Progress;
use super::chart_reads::ChartReads;
use super::error::RunError;
use super::ordered_adder::{OrderedAdder, TileId, TileOutput};
use super::shard_writer::ShardWriter;
use super::signal::Signal;
use super::tile_source::{Batch, Claim, TileSource};
use super::walk::Walk;
use super::work::{BandInFlight, BandWork, Work};
use crate::clock::Clock;
use crate::cuda::CudaError;
use crate::flow::{ChartSource, FilmSink, SourceSinkError};
use crate::plan::tiles_needed;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// The parts of the scheduler, each with a separate lock.
pub(super) struct RunState<'a, C: Compute, S: FilmSink> {
    pub(super) work: &'a Work<'a>,
    pub(super) compute: &'a C,
    pub(super) chart: &'a dyn ChartSource,
    pub(super) progress: &'a dyn Progress,
    pub(super) clock: &'a Clock,
    pub(super) signal: &'a Signal,
    pub(super) source: TileSource<'a, C::Band>,
    pub(super) reads: ChartReads<'a, C::Band>,
    pub(super) adder: OrderedAdder<'a>,
    pub(super) writer: ShardWriter<'a, S>,
    pub(super) error: Mutex<Option<RunError>>,
    pub(super) failed: AtomicBool,
}

impl<C: Compute, S: FilmSink> RunState<'_, C, S> {
    /// Stops the run with `error`, unless [`Progress::continue_after`] continues without the shards that depend on it.
    pub(super) fn fail(&self, error: RunError) {
        if self.progress.continue_after(&error) {
            return;
        }
        self.error.lock().expect("no panic while held").get_or_insert(error);
        self.failed.store(true, Ordering::SeqCst);
        self.reads.close();
        self.source.close();
        self.signal.notify_all();
    }

    /// Whether the run has failed.
    pub(super) fn failed(&self) -> bool {
        self.failed.load(Ordering::SeqCst)
    }

    /// Prepares bands, one ahead of the band being computed.
    pub(super) fn prepare_bands(&self) {
        for (position, band) in self.work.bands.iter().enumerate() {
            let (tiles, distance, waiting) = self.tiles(band);
            if tiles.is_empty() || !self.source.is_open() {
                continue;
            }
            match self.clock.prepare.time(|| self.compute.prepare(position)) {
                Ok(stages) => {
                    if !self.source.offer(BandInFlight { position, stages, tiles, distance, waiting }) {
                        break;
                    }
                }
                Err(source) => self.fail(RunError::Prepare { position, source }),
            }
        }
        self.source.end_of_bands();
    }

    /// The tiles of `band` in the order of computation, and the limits of [`Walk`], which do not concern GPUs.
    fn tiles(&self, band: &BandWork) -> (Vec<(usize, usize)>, usize, usize) {
        if self.work.gpus.is_empty() {
            let walk = Walk::new(&band.tiling, self.work.regions, &band.shards);
            return (walk.tiles, walk.distance, walk.waiting);
        }
        (tiles_needed(&band.tiling, self.work.regions, &band.shards), 0, 0)
    }

    /// See [`TileSource::claim_tile`].
    pub(super) fn claim_tile(&self) -> Claim<C::Band> {
        self.source.claim_tile(super::MAX_TILES_AHEAD_PER_WORKER * self.work.threads.max(1), &|band| {
            self.report_band(band)
        })
    }

    /// See [`TileSource::claim_batch`].
    pub(super) fn claim_batch(&self, max_tiles: &dyn Fn(&BandInFlight<C::Band>) -> usize) -> Claim<C::Band> {
        self.source.claim_batch(max_tiles, &|band| self.report_band(band))
    }

    fn report_band(&self, band: &BandInFlight<C::Band>) {
        let (tiling, film) = (&self.work.bands[band.position].tiling, self.work.film.rect());
        let pixels = band.tiles.iter().map(|&t| tiling.rect(t).intersect(film).size().pixels() as u64);
        self.progress.band(band.position, pixels.sum());
    }

    /// Submits a tile, to be added in order.
    pub(super) fn submit(&self, place: TileId, output: TileOutput) {
        let finished = |shard| self.writer.push(shard);
        let added = |place: TileId, pixels| {
            self.progress.tile(place.position, pixels);
            self.source.tile_added(place.sequence);
        };
        self.adder.submit(place, output, &finished, &added);
    }

    /// Fails because the chart under `tile` could not be read.
    pub(super) fn unreadable(&self, position: usize, tile: (usize, usize), source: SourceSinkError) {
        let rect = self.work.bands[position].tiling.rect(tile);
        let shards = self.adder.shards(position, tile);
        self.fail(RunError::Read { position, rect, shards, source });
    }

    /// Requeues a batch that a GPU could not compute.
    pub(super) fn requeue(&self, batch: Batch<C::Band>) {
        self.source.requeue(batch);
    }

    /// Removes a GPU queue after `error`. The run fails with the last one.
    pub(super) fn remove_gpu(&self, gpu: &str, error: CudaError) {
        let (left, position) = self.source.remove_gpu();
        self.progress.gpu_removed(gpu, &error, left);
        if left == 0 {
            self.fail(RunError::Device { position, source: Box::new(error) });
        }
    }
}
