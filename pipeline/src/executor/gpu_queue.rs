//! A queue of work for one GPU: batches of tiles are uploaded, computed by stages 1-3 and downloaded, several at a time.
//!
//!     claim → workers read the charts → upload │ compute │ download → add in tile order
//! Three streams, ordered by events: while one batch is computed, the next is uploaded and the last one downloaded. This thread
//! claims and launches; another ([`super::gpu_collector`]) waits for downloads and hands the tiles in. Work is bounded by the slots
//! ([`crate::cuda::memory`]). When the device fails, all batches that were not downloaded are requeued for the remaining GPUs; when
//! device memory does not suffice, the queue begins the band again with half of it, until even the least does not fit.

use super::Compute;
use super::chart_reads::{ChartRead, ChartReply};
use super::gpu_collector::{Collector, Launched};
use super::run_state::RunState;
use super::tile_source::{Batch, Claim};
use super::work::BandInFlight;
use crate::cuda::band::{GpuBand, GpuBatchTile, Slot, Streams};
use crate::cuda::memory::{DeviceQueue, MAX_TILES};
use crate::cuda::pool::{GpuTile, PinnedPool};
use crate::cuda::{CudaError, GpuFigures};
use crate::flow::FilmSink;
use crate::geometry::Rect;
use crossbeam::channel::{Receiver, Sender, unbounded};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

/// What the launching thread receives from the collector.
pub(super) enum Collected {
    /// A batch is downloaded; its slot is free.
    Free(Slot),
    /// The device has failed.
    Failed(CudaError),
}

/// A batch whose charts are being read.
struct Reading<B> {
    batch: Batch<B>,
    slot: Slot,
    rects: Vec<Rect>,
    replies: Receiver<ChartReply>,
}

/// A batch whose charts are read.
struct Assembled {
    tiles: Vec<GpuBatchTile>,
    /// Places in the sequence of tiles whose chart could not be read.
    unreadable: Vec<usize>,
}

/// The launching thread's side of a queue.
struct Queue<'a, 'b, C: Compute, S: FilmSink> {
    run: &'a RunState<'b, C, S>,
    queue: &'a DeviceQueue,
    failed: &'a AtomicBool,
    launched: Sender<Launched<C::Band>>,
    collected: Receiver<Collected>,
    streams: Streams,
    charts: PinnedPool,
    outputs: PinnedPool,
    band: Option<(usize, GpuBand)>,
    free: Vec<Slot>,
    reading: VecDeque<Reading<C::Band>>,
    /// Slots on the device.
    in_flight: usize,
    /// Times that its share of the device's memory was halved.
    halved: u32,
}

/// Serves one queue until there is no work left or its device fails.
pub(super) fn serve<C: Compute, S: FilmSink>(
    run: &RunState<'_, C, S>,
    queue: &DeviceQueue,
    figures: &Mutex<GpuFigures>,
) {
    let failed = AtomicBool::new(false);
    let (launched, inbox) = unbounded();
    let (outbox, collected) = unbounded();
    let error = std::thread::scope(|scope| {
        let failed = &failed;
        scope.spawn(move || Collector::new(run, queue, failed, figures).run(&inbox, &outbox));
        let streams = Streams::new(&queue.device);
        let queue = streams.map(|streams| Queue {
            run,
            queue,
            failed,
            launched,
            collected,
            streams,
            charts: PinnedPool::new(),
            outputs: PinnedPool::new(),
            band: None,
            free: Vec::new(),
            reading: VecDeque::new(),
            in_flight: 0,
            halved: 0,
        });
        queue.and_then(Queue::run).err()
    });
    if let Some(error) = error {
        figures.lock().expect("no panic while held").removed = Some(error.to_string());
        run.remove_gpu(&queue.name(), error);
    }
}

impl<C: Compute, S: FilmSink> Queue<'_, '_, C, S> {
    fn run(mut self) -> Result<(), CudaError> {
        let ended = loop {
            match self.step() {
                Ok(true) => (),
                Ok(false) => break None,
                Err(error) => match self.retry_with_half(error) {
                    Ok(()) => (),
                    Err(error) => break Some(error),
                },
            }
        };
        if ended.is_some() {
            self.failed.store(true, Ordering::SeqCst);
        }
        self.requeue_unlaunched();
        // The collector waits for what is on the device, or requeues it.
        self.launched = unbounded().0;
        let failed = self.collected.iter().find_map(|collected| match collected {
            Collected::Failed(error) => Some(error),
            Collected::Free(_) => None,
        });
        ended.or(failed).map_or(Ok(()), Err)
    }

    /// Does what can be done next; `false`: there is nothing left to do.
    fn step(&mut self) -> Result<bool, CudaError> {
        while let Ok(collected) = self.collected.try_recv() {
            self.take_back(collected)?;
        }
        if self.band.is_none() || !self.free.is_empty() {
            match self.claim(self.reading.is_empty()) {
                Claim::Batch(batch) => return self.start(batch).map(|()| true),
                Claim::Over if self.reading.is_empty() => return Ok(false),
                Claim::Over | Claim::None => (),
            }
        }
        match self.reading.pop_front() {
            Some(reading) => self.launch(reading)?,
            None => self.wait_for_slot()?,
        }
        Ok(true)
    }

    /// The next batch; `wait`: until there is one, or none will follow.
    fn claim(&self, wait: bool) -> Claim<C::Band> {
        let largest = |band: &BandInFlight<C::Band>| match &self.band {
            Some((position, present)) if *position == band.position => present.memory.tiles,
            // How many fit is known when the band is begun.
            _ => MAX_TILES,
        };
        loop {
            let seen = self.run.signal.generation();
            if self.run.failed() || self.failed.load(Ordering::SeqCst) {
                return Claim::Over;
            }
            match self.run.claim_batch(&largest) {
                Claim::None if wait => self.run.signal.wait(seen),
                claim => return claim,
            }
        }
    }

    fn wait_for_slot(&mut self) -> Result<(), CudaError> {
        let collected = self.collected.recv().expect("the collector ends after this thread");
        self.take_back(collected)
    }

    fn take_back(&mut self, collected: Collected) -> Result<(), CudaError> {
        match collected {
            Collected::Free(slot) => {
                self.in_flight -= 1;
                self.free.push(slot);
                Ok(())
            }
            Collected::Failed(error) => Err(error),
        }
    }

    /// Has the charts of `batch` read, after its band has been begun where it is another one.
    fn start(&mut self, mut batch: Batch<C::Band>) -> Result<(), CudaError> {
        if self.band.as_ref().is_none_or(|(position, _)| *position != batch.band.position) {
            let begun = self.begin(&batch.band);
            if begun.is_err() {
                self.run.requeue(batch);
                return begun;
            }
            let largest = self.band.as_ref().map_or(1, |(_, band)| band.memory.tiles);
            batch.split_off(largest).into_iter().for_each(|rest| self.run.requeue(rest));
        }
        let tiling = &self.run.work.bands[batch.band.position].tiling;
        let chart_rect = |tile| self.run.compute.chart_rect(&batch.band.stages, tiling.rect(tile));
        let rects: Vec<Rect> = batch.tiles().map(|(_, tile)| chart_rect(tile)).collect();
        let mut buffers = Vec::new();
        for _ in &rects {
            match self.charts.take(&self.queue.device, true, &|| false) {
                Ok(buffer) => buffers.extend(buffer),
                Err(error) => {
                    self.run.requeue(batch);
                    return Err(error);
                }
            }
        }
        let (reply, replies) = unbounded();
        for (i, (into, &rect)) in buffers.into_iter().zip(&rects).enumerate() {
            let (band, index) = (Arc::clone(&batch.band), batch.first + i);
            self.run.reads.push(ChartRead { band, index, rect, into, reply: reply.clone() });
        }
        let slot = self.free.pop().expect("claimed with a free slot, or a band just begun");
        self.reading.push_back(Reading { batch, slot, rects, replies });
        Ok(())
    }

    /// Makes the stages of `band` on the device, once nothing of the last one is on it.
    fn begin(&mut self, band: &BandInFlight<C::Band>) -> Result<(), CudaError> {
        while let Some(reading) = self.reading.pop_front() {
            self.launch(reading)?;
        }
        self.end_band()?;
        let tiling = &self.run.work.bands[band.position].tiling;
        let (gpu_band, slots) = self.run.compute.begin_on_gpu(
            &band.stages,
            tiling,
            &band.tiles,
            self.queue,
            self.halved,
            &self.streams,
        )?;
        let (memory, needs) = (gpu_band.memory, gpu_band.needs);
        self.charts.allow(memory.slots * memory.tiles, needs.chart_px);
        self.outputs.allow((memory.slots + 1) * memory.tiles, needs.light_px.max(needs.remapped_px));
        (self.band, self.free) = (Some((band.position, gpu_band)), slots);
        Ok(())
    }

    /// Waits for all that is on the device and frees the band's memory.
    fn end_band(&mut self) -> Result<(), CudaError> {
        while self.in_flight > 0 {
            self.wait_for_slot()?;
        }
        self.free.clear();
        self.band = None;
        self.queue.device.synchronize("ending a band")
    }

    /// Launches a batch once its charts are read.
    fn launch(&mut self, reading: Reading<C::Band>) -> Result<(), CudaError> {
        let Reading { batch, mut slot, rects, replies } = reading;
        let Assembled { mut tiles, unreadable } = match self.assemble(&batch, &rects, &replies) {
            Ok(Some(assembled)) => assembled,
            // The run or the device has failed.
            ended => {
                self.free.push(slot);
                self.run.requeue(batch);
                return ended.map(|_| ());
            }
        };
        let (_, band) = self.band.as_mut().expect("begun");
        match band.enqueue(&self.queue.device, &self.streams, &mut slot, &mut tiles) {
            Ok(events) => {
                self.in_flight += 1;
                let charts = self.charts.returns().clone();
                let launched = Launched { batch, slot, tiles, unreadable, events, charts };
                self.launched.send(launched).expect("the collector ends after this thread");
                Ok(())
            }
            Err(error) => {
                // Copies may be in flight in the buffers that are freed here.
                let _ = self.queue.device.synchronize("after a failed launch");
                self.free.push(slot);
                self.run.requeue(batch);
                Err(error)
            }
        }
    }

    /// The tiles of `batch` with their charts and output buffers, and the places of those whose chart could not be read; `None` if
    /// the run or the device fails meanwhile.
    fn assemble(
        &mut self,
        batch: &Batch<C::Band>,
        rects: &[Rect],
        replies: &Receiver<ChartReply>,
    ) -> Result<Option<Assembled>, CudaError> {
        let mut read: Vec<ChartReply> = replies.iter().take(rects.len()).collect();
        if read.len() < rects.len() {
            return Ok(None);
        }
        read.sort_by_key(|reply| reply.0);
        let tiling = &self.run.work.bands[batch.band.position].tiling;
        let (mut tiles, mut unreadable) = (Vec::new(), Vec::new());
        for (((sequence, tile), &chart_rect), (_, chart, outcome)) in batch.tiles().zip(rects).zip(read) {
            if let Err(source) = outcome {
                self.run.unreadable(&batch.band, tile, source);
                unreadable.push(sequence);
                let _ = self.charts.returns().send(chart);
                continue;
            }
            let rect = tiling.rect(tile);
            let reach = if self.scatters() { tiling.reach(tile) } else { rect };
            let Some(output) = self.output(batch, reach)? else { return Ok(None) };
            tiles.push(GpuBatchTile { sequence, rect, chart_rect, chart, output });
        }
        Ok(Some(Assembled { tiles, unreadable }))
    }

    /// Whether the band has a PSF stage, so that a tile's output is larger than the tile.
    fn scatters(&self) -> bool {
        self.band.as_ref().is_some_and(|(_, band)| band.needs.light_px > 0)
    }

    /// A buffer for the output on `reach`. A requeued batch may exceed the bound: the tiles that are next in order may be in it.
    fn output(&mut self, batch: &Batch<C::Band>, reach: Rect) -> Result<Option<GpuTile>, CudaError> {
        let stopped = || self.run.failed() || self.failed.load(Ordering::SeqCst);
        let buffer = self.outputs.take(&self.queue.device, batch.requeued, &stopped)?;
        Ok(buffer.map(|buffer| GpuTile::new(buffer, reach.size().pixels(), reach.width, &self.outputs)))
    }

    /// Requeues what was not launched.
    fn requeue_unlaunched(&mut self) {
        for Reading { batch, slot, .. } in self.reading.drain(..) {
            self.free.push(slot);
            self.run.requeue(batch);
        }
    }

    /// Begins again with half the device's memory, if that is what did not suffice.
    fn retry_with_half(&mut self, error: CudaError) -> Result<(), CudaError> {
        if !error.out_of_memory() {
            return Err(error);
        }
        self.run.progress.gpu_short_of_memory(&self.queue.name(), &error);
        self.requeue_unlaunched();
        self.end_band()?;
        self.halved += 1;
        Ok(())
    }
}
