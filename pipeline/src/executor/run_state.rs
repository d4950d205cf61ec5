//! State shared by all threads of a run: the parts of the scheduler, and the first error.

use super::computed_tile::{TileId, TileOutput};
use super::error::RunError;
use super::gpu_tasks::{ChartRead, DownloadedRows, TaskQueue};
use super::ordered_adder::OrderedAdder;
use super::overlap_add::FinishedShard;
use super::portion::PortionEvents;
use super::progress::Progress;
use super::shard_writer::ShardWriter;
use super::signal::Signal;
use super::tile_source::{Batch, Claim, TileSource};
use super::walk::Walk;
use super::work::{BandInFlight, BandWork, Work};
use crate::clock::{Clock, Phase};
use crate::cuda::CudaError;
use crate::flow::{ChartSource, FilmSink, SourceSinkError};
use crate::stages::Compute;
use crate::tiling::{ShardId, tiles_needed};
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
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
    pub(super) reads: TaskQueue<'a, ChartRead<C::Band>>,
    pub(super) rows: TaskQueue<'a, DownloadedRows<C::Band>>,
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
        self.stop();
    }

    /// Runs `work` of a thread; if it panics, the other threads end as well, so that the panic reaches the caller of the run.
    pub(super) fn or_stop(&self, work: impl FnOnce()) {
        if let Err(panic) = catch_unwind(AssertUnwindSafe(work)) {
            self.stop();
            resume_unwind(panic);
        }
    }

    fn stop(&self) {
        self.failed.store(true, Ordering::SeqCst);
        self.source.close();
        self.signal.notify_all();
        self.reads.close();
        self.rows.close();
    }

    /// Whether the run has failed.
    pub(super) fn failed(&self) -> bool {
        self.failed.load(Ordering::SeqCst)
    }

    /// Prepares bands, one ahead of the band being computed.
    pub(super) fn prepare_bands(&self) {
        for (position, band) in self.work.bands.iter().enumerate() {
            let (items, distance, waiting) = self.items(band);
            if items.is_empty() || !self.source.is_open() {
                continue;
            }
            match self.clock.of(Phase::Prepare).time(|| self.compute.prepare(position)) {
                Ok(stages) => {
                    let bands_after = self.work.bands[position + 1..].iter();
                    let bands_after = bands_after.filter(|band| !band.shards.is_empty()).count();
                    let counted = Mutex::default();
                    let band =
                        BandInFlight { position, stages, items, bands_after, distance, waiting, counted };
                    if !self.source.offer(band) {
                        break;
                    }
                }
                // A band that is stopped while it is prepared.
                Err(_) if self.work.cancel.load(Ordering::Relaxed) => break,
                Err(source) => self.fail(RunError::Prepare { position, source }),
            }
        }
        self.source.end_of_bands();
    }

    /// The tiles of `band` in the order of computation and the limits of [`Walk`]; for GPUs its rows of shards, without limits.
    fn items(&self, band: &BandWork) -> (Vec<(usize, usize)>, usize, usize) {
        if self.work.gpus.is_empty() {
            let walk = Walk::new(&band.tiling, self.work.regions, &band.shards);
            return (walk.tiles, walk.distance, walk.waiting);
        }
        let rows: BTreeSet<_> = band.shards.iter().map(|id| (id.region, id.row)).collect();
        (rows.into_iter().collect(), 0, 0)
    }

    /// See [`TileSource::claim_tile`].
    pub(super) fn claim_tile(&self) -> Claim<C::Band> {
        self.source
            .claim_tile(super::memory::MAX_TILES_AHEAD_PER_WORKER * self.work.threads.max(1), &|band| {
                self.report_band(band)
            })
    }

    /// See [`TileSource::claim_portion`].
    pub(super) fn claim_portion(&self) -> Claim<C::Band> {
        self.source.claim_portion(&|band| self.report_band(band))
    }

    fn report_band(&self, band: &BandInFlight<C::Band>) {
        let work = &self.work.bands[band.position];
        let of_tile = |&tile: &_| self.film_pixels(band.position, tile) as u64;
        let pixels = match self.work.gpus.is_empty() {
            true => band.items.iter().map(of_tile).sum(),
            false => tiles_needed(&work.tiling, self.work.regions, &work.shards).iter().map(of_tile).sum(),
        };
        self.progress.band(band.position, pixels);
    }

    /// Number of film pixels of a tile of the band at `position`.
    fn film_pixels(&self, position: usize, tile: (usize, usize)) -> usize {
        self.work.bands[position].tiling.rect(tile).intersect(self.work.film.rect()).size().pixels()
    }

    /// Counts tiles of `band` that a GPU has added, unless they were counted before: another GPU may have computed them for other shards.
    pub(super) fn count_tiles(
        &self,
        band: &BandInFlight<C::Band>,
        tiles: impl Iterator<Item = (usize, usize)>,
    ) {
        let mut counted = band.counted.lock().expect("no panic while held");
        for tile in tiles.filter(|tile| counted.insert(*tile)) {
            let pixels = self.film_pixels(band.position, tile);
            self.adder.count(pixels);
            self.progress.tile(band.position, pixels);
        }
    }

    /// Submits a tile, to be added in order. The shards that it completes are queued for writing when this returns.
    pub(super) fn submit(&self, band: &C::Band, place: TileId, output: TileOutput) {
        let finished = |shard| self.finish(band, shard);
        let added = |place: TileId, pixels| {
            self.progress.tile(place.position, pixels);
            self.source.item_done(place.sequence);
        };
        self.adder.submit(place, output, &finished, &added);
        self.source.tile_submitted();
    }

    /// Completes a shard of `band` to which all tiles are added, and queues it for writing.
    fn finish(&self, band: &C::Band, mut shard: FinishedShard) {
        self.compute.finish(band, shard.rect, &mut shard.pixels);
        self.writer.push(shard);
    }

    /// Fails because the chart under `tile`, which reaches `shards`, could not be read.
    pub(super) fn unreadable(
        &self,
        position: usize,
        tile: (usize, usize),
        shards: Vec<ShardId>,
        source: SourceSinkError,
    ) {
        let rect = self.work.bands[position].tiling.rect(tile);
        self.fail(RunError::Read { position, rect, shards, source });
    }

    /// Requeues rows of shards that a GPU could not compute.
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

impl<C: Compute, S: FilmSink> PortionEvents<C::Band> for RunState<'_, C, S> {
    fn strip(&self) -> Vec<f32> {
        self.adder.strip()
    }
    fn finished(&self, band: &C::Band, shard: FinishedShard) {
        self.finish(band, shard);
    }
    fn row_done(&self, sequence: usize) {
        self.source.item_done(sequence);
    }
}
