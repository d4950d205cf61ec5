//! The second thread of a GPU queue: waits for the last event of each batch, submits its tiles, and counts the device's work.

use super::Compute;
use super::ordered_adder::{TileId, TileOutput};
use super::run_state::RunState;
use super::tile_source::Batch;
use crate::cuda::band::{BatchBuffers, BatchEvents, GpuBatchTile};
use crate::cuda::handle::CudaEvent;
use crate::cuda::memory::DeviceQueue;
use crate::cuda::pool::Pinned;
use crate::cuda::{CudaError, GpuFigures};
use crate::flow::FilmSink;
use crossbeam::channel::{Receiver, Sender};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// Message from the collector to the launching thread.
pub(super) enum Collected {
    /// A batch is downloaded; its batch buffer is free.
    Free(BatchBuffers),
    /// The device has failed.
    Failed(CudaError),
}

/// A batch on the device, before its last event.
pub(super) struct Launched<B> {
    pub(super) batch: Batch<B>,
    pub(super) buffers: BatchBuffers,
    pub(super) tiles: Vec<GpuBatchTile>,
    /// Sequence numbers of tiles whose chart could not be read.
    pub(super) unreadable: Vec<usize>,
    pub(super) events: BatchEvents,
    /// Returns the buffers of the charts to their pool.
    pub(super) charts: Sender<Pinned>,
}

/// The thread that waits for downloads.
pub(super) struct Collector<'a, 'b, C: Compute, S: FilmSink> {
    run: &'a RunState<'b, C, S>,
    queue: &'a DeviceQueue,
    failed: &'a AtomicBool,
    figures: &'a Mutex<GpuFigures>,
    first: Option<CudaEvent>,
}

impl<'a, 'b, C: Compute, S: FilmSink> Collector<'a, 'b, C, S> {
    /// For `queue`; sets `failed` when its device fails.
    pub(super) fn new(
        run: &'a RunState<'b, C, S>,
        queue: &'a DeviceQueue,
        failed: &'a AtomicBool,
        figures: &'a Mutex<GpuFigures>,
    ) -> Self {
        Self { run, queue, failed, figures, first: None }
    }

    /// Submits the tiles of each batch, in the order of launching.
    pub(super) fn run(mut self, launched: &Receiver<Launched<C::Band>>, collected: &Sender<Collected>) {
        let mut failed = false;
        for Launched { batch, buffers, tiles, unreadable, events, charts } in launched {
            let downloaded = match failed {
                false => self.wait(&batch, &tiles, events),
                true => Err(None),
            };
            if let Err(error) = downloaded {
                failed = true;
                self.failed.store(true, Ordering::SeqCst);
                // Copies may still use the buffers that are freed here.
                let _ = self.queue.device.synchronize("after a failure");
                self.run.requeue(batch);
                if let Some(error) = error {
                    // Not received if the launching thread has ended for another reason.
                    let _ = collected.send(Collected::Failed(error));
                }
                continue;
            }
            let _ = collected.send(Collected::Free(buffers));
            let mut done: Vec<(usize, TileOutput)> =
                unreadable.into_iter().map(|sequence| (sequence, TileOutput::Unreadable)).collect();
            for GpuBatchTile { sequence, chart, output, .. } in tiles {
                let _ = charts.send(chart);
                done.push((sequence, TileOutput::Gpu(output)));
            }
            for (sequence, output) in done {
                let tile = batch.band.tiles[batch.first + sequence - batch.sequence];
                self.run.submit(TileId { position: batch.band.position, sequence, tile }, output);
            }
        }
    }

    /// Waits until `tiles` are downloaded and counts them.
    fn wait(
        &mut self,
        batch: &Batch<C::Band>,
        tiles: &[GpuBatchTile],
        events: BatchEvents,
    ) -> Result<(), Option<CudaError>> {
        let device = &self.queue.device;
        let failed = |e| Some(CudaError::new(device.index(), "computing tiles", e));
        events.download[1].synchronize().map_err(failed)?;
        let seconds =
            |[a, b]: &[CudaEvent; 2]| a.elapsed_ms(b).map(|ms| f64::from(ms) * 1e-3).map_err(failed);
        let (upload, download) = (seconds(&events.upload)?, seconds(&events.download)?);
        let compute = events.kernels.iter().map(seconds).sum::<Result<f64, _>>()?;
        let mut f = self.figures.lock().expect("no panic while held");
        let [start, _] = events.upload;
        let first = self.first.get_or_insert(start);
        f.span_s = f64::from(first.elapsed_ms(&events.download[1]).map_err(failed)?) * 1e-3;
        f.upload_s += upload;
        f.compute_s += compute;
        f.host.descriptors_s += events.host.descriptors_s;
        f.host.base_kernels_s += events.host.base_kernels_s;
        f.download_s += download;
        f.batches += 1;
        f.tiles += batch.count as u64;
        f.pixels += tiles.iter().map(|t| t.rect.size().pixels() as u64).sum::<u64>();
        f.bytes_up += tiles.iter().map(|t| 4 * t.chart_rect.size().pixels() as u64).sum::<u64>();
        f.bytes_down += tiles.iter().map(|t| 4 * t.output.data().len() as u64).sum::<u64>();
        Ok(())
    }
}
