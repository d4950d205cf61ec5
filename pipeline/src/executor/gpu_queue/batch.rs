//! The charts and outputs of a batch in page-locked memory: reads queued for the workers, and the batch once they are done.

use super::Queue;
use crate::cuda::CudaError;
use crate::cuda::band::{BatchBuffers, GpuBatchTile};
use crate::cuda::kernel_timer::timed;
use crate::cuda::pool::GpuTile;
use crate::executor::Compute;
use crate::executor::chart_reads::{ChartRead, ChartReply};
use crate::executor::tile_source::Batch;
use crate::flow::FilmSink;
use crate::geometry::Rect;
use crossbeam::channel::{Receiver, unbounded};
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// A batch whose charts are being read.
pub(super) struct PendingReads<B> {
    pub(super) batch: Batch<B>,
    pub(super) buffers: BatchBuffers,
    pub(super) rects: Vec<Rect>,
    pub(super) replies: Receiver<ChartReply>,
}

/// A batch whose charts are read.
pub(super) struct Assembled {
    pub(super) tiles: Vec<GpuBatchTile>,
    /// Sequence numbers of tiles whose chart could not be read.
    pub(super) unreadable: Vec<usize>,
}

impl<C: Compute, S: FilmSink> Queue<'_, '_, C, S> {
    /// Queues the reads of the charts of `batch`, in the band that has begun.
    pub(super) fn queue_reads(&mut self, batch: Batch<C::Band>) -> Result<(), CudaError> {
        let tiling = &self.run.work.bands[batch.band.position].tiling;
        let chart_rect = |tile| self.run.compute.chart_rect(&batch.band.stages, tiling.rect(tile));
        let rects: Vec<Rect> = batch.tiles().map(|(_, tile)| chart_rect(tile)).collect();
        let mut chart_buffers = Vec::new();
        for _ in &rects {
            match self.charts.take(&self.queue.device, true, &|| false) {
                Ok(buffer) => chart_buffers.extend(buffer),
                Err(error) => {
                    self.run.requeue(batch);
                    return Err(error);
                }
            }
        }
        let (reply, replies) = unbounded();
        for (i, (into, &rect)) in chart_buffers.into_iter().zip(&rects).enumerate() {
            let (band, index) = (Arc::clone(&batch.band), batch.first + i);
            self.run.reads.push(ChartRead { band, index, rect, into, reply: reply.clone() });
        }
        let buffers = self.free.pop().expect("claimed with a free buffer, or a band just begun");
        self.reading.push_back(PendingReads { batch, buffers, rects, replies });
        Ok(())
    }

    /// Waits for the charts of `batch` and allocates the output buffers; `None` if the run or the device fails meanwhile.
    pub(super) fn assemble(
        &mut self,
        batch: &Batch<C::Band>,
        rects: &[Rect],
        replies: &Receiver<ChartReply>,
    ) -> Result<Option<Assembled>, CudaError> {
        let receive = || replies.iter().take(rects.len()).collect();
        let mut read: Vec<ChartReply> = timed(&mut self.waits.chart_s, receive);
        if read.len() < rects.len() {
            return Ok(None);
        }
        read.sort_by_key(|reply| reply.0);
        let tiling = &self.run.work.bands[batch.band.position].tiling;
        let (mut tiles, mut unreadable) = (Vec::new(), Vec::new());
        for (((sequence, tile), &chart_rect), (_, chart, outcome)) in batch.tiles().zip(rects).zip(read) {
            if let Err(source) = outcome {
                self.run.unreadable(batch.band.position, tile, source);
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
        self.band.as_ref().is_some_and(|(_, band)| band.needs.contribution_px > 0)
    }

    /// A buffer for the contribution on `reach`. A requeued batch may exceed the bound, since it may contain the next tiles in order.
    fn output(&mut self, batch: &Batch<C::Band>, reach: Rect) -> Result<Option<GpuTile>, CudaError> {
        let stopped = || self.run.failed() || self.failed.load(Ordering::SeqCst);
        let take = || self.outputs.take(&self.queue.device, batch.requeued, &stopped);
        let buffer = timed(&mut self.waits.output_s, take)?;
        Ok(buffer.map(|buffer| GpuTile::new(buffer, reach.size().pixels(), reach.width, &self.outputs)))
    }
}
