//! A worker's loop: a shard to encode, else a chart rectangle to read for a GPU, else a tile to compute.
//!
//! Shards come first, for they free memory; where GPUs compute, workers take no tiles.

use super::Compute;
use super::chart_reads::ChartRead;
use super::ordered_adder::TileOutput;
use super::run_state::RunState;
use super::shard_writer::Encoded;
use super::tile_source::{Batch, Claim};
use super::work::BandInFlight;
use crate::flow::FilmSink;
use crate::overlap_add::Finished;
use crossbeam::channel::Sender;

/// Tiles, per worker, between the one that is computed and the one whose chart is fetched: some tens of milliseconds.
const READ_AHEAD: usize = 4;

enum Task<B> {
    Encode(Finished),
    Read(ChartRead<B>),
    Tile(Batch<B>),
    Over,
}

impl<C: Compute, S: FilmSink> RunState<'_, C, S> {
    /// Works until the run is over.
    pub(super) fn worker(&self, encoded: &Sender<Encoded<S>>) {
        let mut scratch = C::Scratch::default();
        loop {
            match self.next_task() {
                Task::Over => break,
                Task::Encode(shard) => self.encode(shard, encoded),
                Task::Read(read) => self.read_for_gpu(read, &mut scratch),
                Task::Tile(batch) => self.compute_tile(&batch, &mut scratch),
            }
        }
        // The thread that prepares bands may still offer one.
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
                // Shards of the last tile were pushed before it was counted as added.
                Claim::Over => return self.writer.pop().map_or(Task::Over, Task::Encode),
                Claim::None => self.signal.wait(seen),
            }
        }
    }

    fn encode(&self, shard: Finished, encoded: &Sender<Encoded<S>>) {
        let (pixels, result) = self.writer.encode(shard);
        self.adder.recycle(pixels);
        match result {
            // Writing threads end before this one only after an error, which they have reported.
            Ok(shard) => drop(encoded.send(shard)),
            Err(error) => self.fail(error),
        }
    }

    fn compute_tile(&self, batch: &Batch<C::Band>, scratch: &mut C::Scratch) {
        let (band, work) = (&batch.band, &self.work.bands[batch.band.position]);
        let tile = band.tiles[batch.first];
        let mut out = self.adder.buffer();
        self.read_ahead(band, batch.first);
        let (rect, chart_band) = (work.tiling.rect(tile), work.chart_band);
        let done =
            self.compute.compute(&band.stages, self.chart, chart_band, rect, &mut out, scratch, self.clock);
        let output = match done {
            Ok(()) => TileOutput::Cpu(out),
            Err(source) => {
                self.unreadable(band, tile, source);
                TileOutput::Unreadable
            }
        };
        self.hand_in(band, (batch.sequence, tile), output);
    }

    fn read_for_gpu(&self, read: ChartRead<C::Band>, scratch: &mut C::Scratch) {
        let ChartRead { band, index, rect, mut into, reply } = read;
        self.read_ahead(&band, index);
        let chart_band = self.work.bands[band.position].chart_band;
        let out = &mut into[..rect.size().pixels()];
        let done = self
            .clock
            .remap
            .time(|| self.compute.read_chart(&band.stages, self.chart, chart_band, rect, out, scratch));
        // A GPU queue that was removed has dropped its end.
        let _ = reply.send((index, into, done));
    }

    /// Lets the chart fetch what a later tile of the band will need.
    fn read_ahead(&self, band: &BandInFlight<C::Band>, index: usize) {
        let work = &self.work.bands[band.position];
        if let Some(&tile) = band.tiles.get(index + READ_AHEAD * self.work.threads.max(1)) {
            let rect = self.compute.chart_hint(&band.stages, self.chart.size(), work.tiling.rect(tile));
            self.clock.remap.time(|| self.chart.prefetch(work.chart_band, rect));
        }
    }
}
