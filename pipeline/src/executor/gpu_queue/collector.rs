//! The third thread of a GPU queue: waits for the last event of each batch, passes its film rows to the workers, and counts the device's work.

use super::{Failure, Session};
use crate::cuda::CudaError;
use crate::cuda::handle::CudaEvent;
use crate::cuda::pool::Pinned;
use crate::cuda::slice::CudaSlice;
use crate::executor::gpu_tasks::DownloadedRows;
use crate::executor::portion::Portion;
use crate::flow::FilmSink;
use crate::geometry::Rect;
use crate::stages::Compute;
use crate::stages::cuda::band::{BatchEvents, BatchPlan};
use crossbeam::channel::{Receiver, Sender};
use std::sync::Arc;

/// Finished film rows of a batch, as they are downloaded.
pub(super) struct Strips {
    /// The film rectangle of each strip.
    pub(super) rects: Vec<Rect>,
    pub(super) values: Vec<Pinned>,
    /// Returns the buffers to their pool.
    pub(super) returns: Sender<Pinned>,
}

/// A batch on the device, before its last event.
pub(super) struct Launched<B> {
    pub(super) portion: Arc<Portion<B>>,
    pub(super) plan: BatchPlan,
    pub(super) charts: Pinned,
    /// Returns the buffer of the charts to its pool.
    pub(super) returns: Sender<Pinned>,
    /// Device memory of the charts.
    pub(super) buffer: CudaSlice<f32>,
    pub(super) strips: Strips,
    pub(super) events: BatchEvents,
}

/// The collecting thread.
pub(super) struct Collector<'s, 'a, 'b, C: Compute, S: FilmSink> {
    session: &'s Session<'a, 'b, C, S>,
    free: Sender<CudaSlice<f32>>,
    first: Option<CudaEvent>,
    /// Seconds of earlier sessions.
    earlier_s: f64,
}

impl<'s, 'a, 'b, C: Compute, S: FilmSink> Collector<'s, 'a, 'b, C, S> {
    /// Returns the device memory of charts to `free`.
    pub(super) fn new(session: &'s Session<'a, 'b, C, S>, free: Sender<CudaSlice<f32>>) -> Self {
        let earlier_s = session.figures.lock().expect("no panic while held").span_s;
        Self { session, free, first: None, earlier_s }
    }

    /// Takes each batch, in the order of launching.
    pub(super) fn run(mut self, launched: &Receiver<Launched<C::Band>>) {
        let mut failed = false;
        for batch in launched {
            if !failed && let Err(error) = self.wait(&batch.plan, batch.events, &batch.strips) {
                failed = true;
                self.session.end(Err(Failure::Device(error)));
            }
            if failed {
                // Copies may still use the buffers that are freed here.
                let _ = self.session.streams.synchronize(&self.session.queue.device, "after a failure");
                // The launching thread may wait for it.
                let _ = self.free.send(batch.buffer);
                continue;
            }
            let Launched { portion, plan, charts, returns, buffer, strips, .. } = batch;
            // Not received if the launching thread, or the planning thread, has ended.
            let _ = self.free.send(buffer);
            let _ = returns.send(charts);
            portion.set_downloaded(plan.added.finished.end);
            self.session.run.count_tiles(&portion.batch.band, plan.added.range.tiles());
            for (rect, values) in strips.rects.into_iter().zip(strips.values) {
                let (portion, returns) = (Arc::clone(&portion), strips.returns.clone());
                self.session.run.rows.push(DownloadedRows { portion, rect, values, returns });
            }
        }
    }

    /// Waits until the batch `plan` is downloaded and counts it.
    fn wait(&mut self, plan: &BatchPlan, events: BatchEvents, strips: &Strips) -> Result<(), CudaError> {
        let device = &self.session.queue.device;
        let failed = |e| CudaError::new(device.index(), "computing tiles", e);
        events.download[1].synchronize().map_err(failed)?;
        let seconds =
            |[a, b]: &[CudaEvent; 2]| a.elapsed_ms(b).map(|ms| f64::from(ms) * 1e-3).map_err(failed);
        let (upload, download) = (seconds(&events.upload)?, seconds(&events.download)?);
        let compute = events.kernels.iter().map(seconds).sum::<Result<f64, _>>()?;
        let [start, _] = events.upload;
        let first = self.first.get_or_insert(start);
        let span = f64::from(first.elapsed_ms(&events.download[1]).map_err(failed)?) * 1e-3;
        let bytes =
            |rects: &mut dyn Iterator<Item = Rect>| rects.map(|r| 4 * r.size().pixels() as u64).sum::<u64>();
        let mut f = self.session.figures.lock().expect("no panic while held");
        f.span_s = self.earlier_s + span;
        f.upload_s += upload;
        f.compute_s += compute;
        f.download_s += download;
        f.host.descriptors_s += plan.host().descriptors_s;
        f.host.base_kernels_s += plan.host().base_kernels_s;
        f.batches += 1;
        f.spectra += plan.spectra();
        f.tiles += plan.tiles.len() as u64;
        f.pixels += plan.tiles.iter().map(|t| t.rect.size().pixels() as u64).sum::<u64>();
        f.bytes_up += bytes(&mut plan.tiles.iter().map(|t| t.chart_rect));
        f.bytes_down += bytes(&mut strips.rects.iter().copied());
        Ok(())
    }
}
