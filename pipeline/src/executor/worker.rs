//! A worker's loop: encodes a shard, else copies film rows of a GPU to shards, else reads a chart rectangle for a GPU, else computes a tile.
//!
//! Shards come first, since encoding frees memory; where GPUs compute, workers claim no tiles.

use super::computed_tile::{TileId, TileOutput};
use super::gpu_tasks::{ChartRead, DownloadedRows};
use super::overlap_add::FinishedShard;
use super::run_state::RunState;
use super::shard_writer::Encoded;
use super::tile_source::{Batch, Claim};
use super::work::BandInFlight;
use crate::clock::Phase;
use crate::flow::FilmSink;
use crate::geometry::Rect;
use crate::stages::Compute;
use crossbeam::channel::Sender;

/// Distance, in tiles per worker, between the tile being computed and the one whose chart is prefetched: some tens of milliseconds.
pub(super) const READ_AHEAD: usize = 4;

enum Task<B> {
    Encode(FinishedShard),
    Place(DownloadedRows<B>),
    Read(ChartRead<B>),
    Tile(Batch<B>),
    Over,
}

impl<C: Compute, S: FilmSink> RunState<'_, C, S> {
    /// Runs until all tiles are added, or the run fails.
    pub(super) fn worker(&self, encoded: &Sender<Encoded<S>>) {
        let mut scratch = C::Scratch::default();
        loop {
            match self.next_task() {
                Task::Over => break,
                Task::Encode(shard) => self.encode(shard, encoded),
                Task::Place(rows) => self.place(rows),
                Task::Read(read) => self.read_for_gpu(read, &mut scratch),
                Task::Tile(batch) => self.compute_tile(&batch, &mut scratch),
            }
        }
        // Ends the thread that prepares bands if it is waiting.
        self.source.close();
    }

    fn next_task(&self) -> Task<C::Band> {
        loop {
            let seen = self.signal.generation();
            if self.failed() {
                return Task::Over;
            }
            if let Some(shard) = self.writer.pop() {
                return Task::Encode(shard);
            }
            if let Some(rows) = self.rows.pop() {
                return Task::Place(rows);
            }
            if let Some(read) = self.reads.pop() {
                return Task::Read(read);
            }
            let claim = match self.work.gpus.is_empty() {
                true => self.claim_tile(),
                false if self.source.is_over() => Claim::Over,
                false => Claim::None,
            };
            match claim {
                Claim::Batch(batch) => return Task::Tile(batch),
                // The last tile's shards were pushed before it was counted as added, or as submitted.
                Claim::Over => return self.writer.pop().map_or(Task::Over, Task::Encode),
                Claim::None => self.signal.wait_as_worker(seen),
            }
        }
    }

    fn encode(&self, shard: FinishedShard, encoded: &Sender<Encoded<S>>) {
        let (pixels, result) = self.writer.encode(shard);
        self.adder.recycle(pixels);
        match result {
            // The writing threads end before this one only after an error that they have reported.
            Ok(shard) => drop(encoded.send(shard)),
            Err(error) => self.fail(error),
        }
    }

    fn compute_tile(&self, batch: &Batch<C::Band>, scratch: &mut C::Scratch) {
        let (band, work) = (&batch.band, &self.work.bands[batch.band.position]);
        let tile = band.items[batch.first];
        let mut out = self.adder.buffer();
        let later = band.items.get(batch.first + READ_AHEAD * self.work.threads.max(1));
        self.read_ahead(band, later.map(|&tile| work.tiling.rect(tile)));
        let (rect, chart_band) = (work.tiling.rect(tile), work.chart_band);
        let done =
            self.compute.compute(&band.stages, self.chart, chart_band, rect, &mut out, scratch, self.clock);
        let output = match done {
            Ok(()) => TileOutput::Cpu(out),
            Err(source) => {
                let shards = self.adder.shards(band.position, tile);
                self.unreadable(band.position, tile, shards, source);
                TileOutput::Unreadable
            }
        };
        self.submit(&band.stages, TileId { position: band.position, sequence: batch.sequence, tile }, output);
    }

    fn read_for_gpu(&self, read: ChartRead<C::Band>, scratch: &mut C::Scratch) {
        let ChartRead { band, index, rect, later, mut into, reply } = read;
        self.read_ahead(&band, later);
        let chart_band = self.work.bands[band.position].chart_band;
        let out = into.as_mut_slice();
        let done = self
            .clock
            .of(Phase::Remap)
            .time(|| self.compute.read_chart(&band.stages, self.chart, chart_band, rect, out, scratch));
        // Not received if the GPU queue was removed.
        let _ = reply.send((index, into, done));
    }

    /// Copies film rows of a GPU to their shards.
    fn place(&self, rows: DownloadedRows<C::Band>) {
        let DownloadedRows { portion, rect, values, returns } = rows;
        let values_of_rect = &values[..rect.size().pixels()];
        self.clock.of(Phase::Add).time(|| portion.place(rect, values_of_rect, self));
        // Freed if the pool no longer exists.
        let _ = returns.send(values);
    }

    /// Prefetches the chart under the film rectangle of a later tile.
    fn read_ahead(&self, band: &BandInFlight<C::Band>, later: Option<Rect>) {
        if let Some(tile) = later {
            let rect = self.compute.chart_hint(&band.stages, self.chart.size(), tile);
            let chart_band = self.work.bands[band.position].chart_band;
            self.clock.of(Phase::Remap).time(|| self.chart.prefetch(chart_band, rect));
        }
    }
}
