//! A queue of work for one GPU: batches of tiles are uploaded, remapped, convolved with the PSFs and downloaded, several at a time.
//!
//!     claim → workers read the charts → upload │ compute │ download → add in tile order
//! Three streams, ordered by events: while one batch is computed, the next is uploaded and the last one downloaded. This thread
//! claims and launches; another ([`super::gpu_collector`]) waits for downloads and submits the tiles. The batch buffers bound the
//! number of batches in flight ([`crate::cuda::memory`]). If the device fails, all batches not yet downloaded are requeued for the remaining
//! GPUs; if memory of the device or page-locked memory does not suffice, the queue begins the band again with half of it, down to the
//! minimum.

mod batch;

use super::Compute;
use super::gpu_collector::{Collected, Collector, Launched};
use super::run_state::RunState;
use super::tile_source::{Batch, Claim};
use super::work::BandInFlight;
use crate::cuda::band::{BatchBuffers, GpuBand, Streams};
use crate::cuda::kernel_timer::timed;
use crate::cuda::memory::{DeviceQueue, Halvings, MAX_TILES};
use crate::cuda::pool::PinnedPool;
use crate::cuda::{CudaError, GpuFigures, LaunchWaits};
use crate::flow::FilmSink;
use batch::{Assembled, PendingReads};
use crossbeam::channel::{Receiver, Sender, unbounded};
use std::collections::VecDeque;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// The launching thread's side of a queue.
struct Queue<'a, 'b, C: Compute, S: FilmSink> {
    run: &'a RunState<'b, C, S>,
    queue: &'a DeviceQueue,
    figures: &'a Mutex<GpuFigures>,
    failed: &'a AtomicBool,
    launched: Sender<Launched<C::Band>>,
    collected: Receiver<Collected>,
    streams: Streams,
    charts: PinnedPool,
    outputs: PinnedPool,
    band: Option<(usize, GpuBand)>,
    free: Vec<BatchBuffers>,
    reading: VecDeque<PendingReads<C::Band>>,
    /// Batches on the device.
    in_flight: usize,
    /// How often its memory was halved.
    halvings: Halvings,
    /// The last error of memory.
    shortage: Option<CudaError>,
    waits: LaunchWaits,
}

/// Runs one queue until all tiles are added or its device fails.
pub(super) fn run_queue<C: Compute, S: FilmSink>(
    run: &RunState<'_, C, S>,
    queue: &DeviceQueue,
    figures: &Mutex<GpuFigures>,
) {
    let failed = AtomicBool::new(false);
    let (launched, launched_in) = unbounded();
    let (collected_out, collected) = unbounded();
    let error = std::thread::scope(|scope| {
        let failed = &failed;
        scope.spawn(move || Collector::new(run, queue, failed, figures).run(&launched_in, &collected_out));
        let streams = Streams::new(&queue.device);
        let queue = streams.map(|streams| Queue {
            run,
            queue,
            figures,
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
            halvings: Halvings::default(),
            shortage: None,
            waits: LaunchWaits::default(),
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
        self.figures.lock().expect("no panic while held").waits = self.waits;
        // The collector waits for what is on the device, or requeues it.
        self.launched = unbounded().0;
        let failed = self.collected.iter().find_map(|collected| match collected {
            Collected::Failed(error) => Some(error),
            Collected::Free(_) => None,
        });
        ended.or(failed).map_or(Ok(()), Err)
    }

    /// Claims a batch, or launches one, or waits for one; `false`: all tiles are added.
    fn step(&mut self) -> Result<bool, CudaError> {
        while let Ok(collected) = self.collected.try_recv() {
            self.receive(collected)?;
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
            None => self.wait_for_buffer()?,
        }
        Ok(true)
    }

    /// Claims the next batch; `wait`: waits until there is one or none will follow.
    fn claim(&self, wait: bool) -> Claim<C::Band> {
        let max_tiles = |band: &BandInFlight<C::Band>| match &self.band {
            Some((position, present)) if *position == band.position => present.memory.tiles,
            // The capacity is known only after the band has begun.
            _ => MAX_TILES,
        };
        loop {
            let seen = self.run.signal.generation();
            if self.run.failed() || self.failed.load(Ordering::SeqCst) {
                return Claim::Over;
            }
            match self.run.claim_batch(&max_tiles) {
                Claim::None if wait => self.run.signal.wait_as_queue(seen),
                claim => return claim,
            }
        }
    }

    fn wait_for_buffer(&mut self) -> Result<(), CudaError> {
        let collected = timed(&mut self.waits.batch_s, || self.collected.recv());
        let collected = collected.expect("the collector ends after this thread");
        self.receive(collected)
    }

    fn receive(&mut self, collected: Collected) -> Result<(), CudaError> {
        match collected {
            Collected::Free(buffers) => {
                self.in_flight -= 1;
                self.free.push(buffers);
                Ok(())
            }
            Collected::Failed(error) => Err(error),
        }
    }

    /// Begins the band of `batch` if it is a new one, and queues the reads of its charts.
    fn start(&mut self, mut batch: Batch<C::Band>) -> Result<(), CudaError> {
        if self.band.as_ref().is_none_or(|(position, _)| *position != batch.band.position) {
            let begun = self.begin(&batch.band);
            if begun.is_err() {
                self.run.requeue(batch);
                return begun;
            }
            let max_tiles = self.band.as_ref().map_or(1, |(_, band)| band.memory.tiles);
            batch.split_off(max_tiles).into_iter().for_each(|rest| self.run.requeue(rest));
        }
        self.queue_reads(batch)
    }

    /// Ends the last band, then constructs the stages of `band` on the device.
    fn begin(&mut self, band: &BandInFlight<C::Band>) -> Result<(), CudaError> {
        while let Some(reading) = self.reading.pop_front() {
            self.launch(reading)?;
        }
        self.end_band()?;
        let tiling = &self.run.work.bands[band.position].tiling;
        let (gpu_band, batch_buffers) = self.run.compute.begin_on_gpu(
            &band.stages,
            tiling,
            &band.tiles,
            self.queue,
            self.halvings,
            &self.streams,
        )?;
        let (memory, needs) = (gpu_band.memory, gpu_band.needs);
        self.charts.resize(memory.batches * memory.tiles, needs.chart_px);
        self.outputs
            .resize((memory.batches + 1) * memory.tiles, needs.contribution_px.max(needs.remapped_px));
        (self.band, self.free) = (Some((band.position, gpu_band)), batch_buffers);
        Ok(())
    }

    /// Waits for all that is on the device and frees the band's memory.
    fn end_band(&mut self) -> Result<(), CudaError> {
        while self.in_flight > 0 {
            self.wait_for_buffer()?;
        }
        self.free.clear();
        self.band = None;
        self.streams.synchronize(&self.queue.device, "ending a band")
    }

    /// Launches a batch once its charts are read.
    fn launch(&mut self, reading: PendingReads<C::Band>) -> Result<(), CudaError> {
        let PendingReads { batch, mut buffers, rects, replies } = reading;
        let Assembled { mut tiles, unreadable } = match self.assemble(&batch, &rects, &replies) {
            Ok(Some(assembled)) => assembled,
            // The run or the device has failed.
            ended => {
                self.free.push(buffers);
                self.run.requeue(batch);
                return ended.map(|_| ());
            }
        };
        let (_, band) = self.band.as_mut().expect("begun");
        match band.enqueue(&self.queue.device, &self.streams, &mut buffers, &mut tiles) {
            Ok(events) => {
                self.in_flight += 1;
                let charts = self.charts.returns().clone();
                let launched = Launched { batch, buffers, tiles, unreadable, events, charts };
                self.launched.send(launched).expect("the collector ends after this thread");
                Ok(())
            }
            Err(error) => {
                // Copies may still use the buffers that are freed here.
                let _ = self.streams.synchronize(&self.queue.device, "after a failed launch");
                self.free.push(buffers);
                self.run.requeue(batch);
                Err(error)
            }
        }
    }

    /// Requeues the batches that were not launched.
    fn requeue_unlaunched(&mut self) {
        for PendingReads { batch, buffers, .. } in self.reading.drain(..) {
            self.free.push(buffers);
            self.run.requeue(batch);
        }
    }

    /// After an error of memory: begins the band again with half of it. Returns any other error, and the error of memory if half of it
    /// is too little.
    fn retry_with_half(&mut self, error: CudaError) -> Result<(), CudaError> {
        if !error.is_out_of_memory() {
            let cause = self.shortage.take().filter(|_| matches!(error, CudaError::TooSmall { .. }));
            return Err(cause.unwrap_or(error));
        }
        self.run.progress.gpu_short_of_memory(&self.queue.name(), &error);
        self.requeue_unlaunched();
        self.end_band()?;
        match error {
            CudaError::OutOfHostMemory { .. } => {
                self.halvings.host += 1;
                self.charts.free_unused();
                self.outputs.free_unused();
            }
            _ => self.halvings.device += 1,
        }
        self.shortage = Some(error);
        Ok(())
    }
}
